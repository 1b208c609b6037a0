"""A flexible body with fewer modes: those in the span of some combinations of its own."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.checks import check_shape
from ...common.errors import SceneError
from ...compiling.program import program_once
from ...linalg.inverse_mass import AbstractBodyInverse
from .base import AbstractBody, nameless
from .inertia import Inertia
from .spatial.inertia import SpatialInertia
from .wrapped import AbstractWrappedBody

__all__ = ["ReducedBody"]


class ReducedBody(AbstractWrappedBody):
    """A body whose amplitudes are q_f = Φ z. Its frame, its points and its markers stay.

    The inertia invariants of a Beam or a ModalBody are polynomials in q_f, so those of z are made
    once and exactly, and a step costs what a body with k modes costs.

    **Arguments:**

    - `body`: the flexible body.
    - `basis` Φ (modes of the body, k): orthonormal in its modal mass, ΦᵀM_ffΦ = I. No columns make
      it rigid.

    Raises SceneError for a basis of another number of rows.
    """

    name: str = eqx.field(static=True)
    body: AbstractBody
    basis: Float[Array, "modes k"]
    inertia: Inertia | SpatialInertia | None
    modes: int = eqx.field(static=True)

    def __init__(self, body: AbstractBody, basis: Float[Array, "modes k"]):
        check_shape(f"body '{body.name}'", "basis", basis, (body.modes, None), SceneError)
        if body.bends:
            raise SceneError(
                f"body '{body.name}': a {type(body).__name__} bends too far for a ReducedBody, "
                "whose markers move linearly; use body.in_span(basis)."
            )
        own = body.invariants()
        self.name, self.body, self.basis = body.name, nameless(body), basis
        self.inertia = None if own is None else own.in_span(basis)
        self.modes = basis.shape[1]

    @property
    def constant_mass(self) -> bool:
        return self.modes == 0 and isinstance(self.inertia, Inertia) and self.inertia.diagonal

    @property
    def inverts_mass(self) -> bool:
        return isinstance(self.inertia, SpatialInertia) and self.inertia.inverts

    def expand(self, q: Float[Array, " size"]) -> Float[Array, " full"]:
        """The coordinates of the body, or velocities, for its own here."""
        frame = self.frame_size
        return jnp.concatenate([q[:frame], self.basis @ q[frame:]])

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        z, w = _in_span(self.body, self.basis, *self.body.start())
        return z, w

    def started(self, q: Float[Array, " size"], v: Float[Array, " size"]) -> "ReducedBody":
        body = self.body.started(self.expand(q), self.expand(v))
        moved: ReducedBody = eqx.tree_at(lambda reduced: reduced.body, self, body)
        return moved

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        if self.inertia is not None:
            return self.inertia.matrix(q)
        full = self.body.mass_matrix(self.expand(q))
        full = jnp.diag(full) if full.ndim == 1 else full
        frame = self.frame_size
        # M of (x, z) with q_f = Φ z is Tᵀ M T, T = diag(1, Φ).
        coupling = full[:frame, frame:] @ self.basis
        modal = self.basis.T @ full[frame:, frame:] @ self.basis
        return jnp.block([[full[:frame, :frame], coupling], [coupling.T, modal]])

    def inverse_mass(self, q: Float[Array, " size"]) -> AbstractBodyInverse:
        assert isinstance(self.inertia, SpatialInertia)
        return self.inertia.inverse(q)

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"] | None:
        if isinstance(self.inertia, SpatialInertia):
            return self.inertia.quadratic_velocity_force(q, v)
        return None

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        return self.body.elastic_energy(self.expand(q))

    def invariants(self) -> Inertia | SpatialInertia | None:
        return self.inertia

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        full = self.body.damping_force(self.expand(v))
        # The power of forces is the same in both coordinates, so that they are Φᵀ f_f on the
        # amplitudes.
        return jnp.concatenate([full[: self.frame_size], full[self.frame_size :] @ self.basis])

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, " d"]:
        if self.inertia is not None:
            return self.inertia.first_moment_at(q)
        return self.body.first_moment(self.expand(q))

    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions k"]:
        return self.body.mode_shapes(point) @ self.basis

    def foreshortening(self, point: Float[Array, " d"]) -> Float[Array, "d k k"]:
        return self.basis.T @ self.body.foreshortening(point) @ self.basis

    def check(self) -> None:
        """Check nothing, since the body and the basis were checked before."""


@program_once
def _in_span(
    body: AbstractBody,
    basis: Float[Array, "modes k"],
    q: Float[Array, " full"],
    v: Float[Array, " full"],
) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
    """Coordinates and velocities whose deflections are the nearest in the modal mass."""
    mass, frame = body.mass_matrix(q), body.frame_size
    modal = jnp.diag(mass[frame:]) if mass.ndim == 1 else mass[frame:, frame:]
    # Φ is orthonormal in M_ff, so that Φᵀ M_ff is its inverse from the left.
    read = basis.T @ modal
    z, w = (jnp.concatenate([x[:frame], read @ x[frame:]]) for x in (q, v))
    return z, w
