"""Modes above a frequency made slower: statics stay exact, and steps may be longer."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Number, as_array
from ...common.checks import check_finite, check_positive, check_shape
from ...common.errors import InputError, SceneError
from ..scene import Scene
from .base import AbstractBody, nameless
from .wrapped import AbstractWrappedBody

__all__ = ["CappedBody", "uncapped", "with_caps", "with_caps_times"]


class CappedBody(AbstractWrappedBody):
    """A flexible body whose modes above a `cap` have more mass, so that they vibrate at the cap.

    Of the motion within the frame only: T grows by ½ Σ (μ_i − 1) q̇_i² with μ_i = (ω_i/ω_cap)²
    where that is above one. Stiffness, damping, shapes and the coordinates stay those of the
    `body`, and so do all forces at rest.
    """

    name: str = eqx.field(static=True)
    body: AbstractBody
    cap: Float[Array, ""]
    modes: int = eqx.field(static=True)

    def __init__(self, body: AbstractBody, cap: Number):
        self.name, self.modes = body.name, body.modes
        self.body, self.cap = nameless(body), as_array(cap)

    @property
    def mode_kind(self) -> str:  # type: ignore[override]
        return self.body.mode_kind

    @property
    def constant_mass(self) -> bool:
        return self.body.constant_mass

    @property
    def excess(self) -> Float[Array, " modes"]:
        """ω_i/ω_cap, one for modes below the cap."""
        return jnp.maximum(self.body.natural_frequencies() / (2 * jnp.pi * self.cap), 1)

    def natural_frequencies(self) -> Float[Array, " modes"]:
        """Angular frequencies ω [rad/s] of the modes, none above the cap."""
        return jnp.minimum(self.body.natural_frequencies(), 2 * jnp.pi * self.cap)

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return self.body.start()

    def started(self, q: Float[Array, " size"], v: Float[Array, " size"]) -> "CappedBody":
        body = self.body.started(q, v)
        moved: CappedBody = eqx.tree_at(lambda capped: capped.body, self, body)
        return moved

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        own = self.body.mass_matrix(q)
        # Modes have unit mass: μ − 1 on the diagonal makes ω² / μ the square of the cap.
        added = jnp.concatenate([jnp.zeros(self.frame_size, q.dtype), self.excess**2 - 1])
        return own + (added if own.ndim == 1 else jnp.diag(added))

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"] | None:
        return self.body.quadratic_velocity_force(q, v)  # what is added is constant

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        return self.body.elastic_energy(q)

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        return self.body.damping_force(v)

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, " d"]:
        return self.body.first_moment(q)

    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions modes"]:
        return self.body.mode_shapes(point)

    def foreshortening(self, point: Float[Array, " d"]) -> Float[Array, "d modes modes"]:
        return self.body.foreshortening(point)

    def check(self) -> None:
        owner = f"body '{self.name}'"
        check_shape(owner, "cap", self.cap, (), SceneError)
        check_finite(owner, "cap", self.cap, SceneError)
        check_positive(owner, "cap", self.cap, "Give it in hertz.", SceneError)


def uncapped(body: AbstractBody) -> AbstractBody:
    """The body without a cap, if it has one."""
    return body.body if isinstance(body, CappedBody) else body


def with_caps_times(scene: Scene, factor: Number) -> Scene | None:
    """The scene with the caps of its modes times a factor; None of one without caps."""
    if not any(isinstance(body, CappedBody) for body in scene.bodies):
        return None
    bodies = [
        eqx.tree_at(lambda capped: capped.cap, body, factor * body.cap)
        if isinstance(body, CappedBody)
        else body
        for body in scene.bodies
    ]
    return Scene(bodies, scene.joints, scene.effects)


def with_caps(scene: Scene, hertz: Number) -> Scene:
    """The scene, from the same start, with no mode of a body above `hertz` [Hz]; see `cap`."""
    if not any(body.modes for body in scene.bodies):
        raise InputError("cap: no body of the scene deforms; there are no modes to cap.")
    bodies = [_capped(body, hertz) if body.modes else body for body in scene.bodies]
    return Scene(bodies, scene.joints, scene.effects)


def _capped(body: AbstractBody, hertz: Number) -> AbstractBody:
    if isinstance(body, CappedBody):
        raise InputError(f"cap: body '{body.name}' is capped already; cap the original scene.")
    body.natural_frequencies()
    return CappedBody(body, hertz)
