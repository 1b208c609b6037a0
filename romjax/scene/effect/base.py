"""The base of effects: one scalar or one set of forces, given the motion of their markers."""

import abc
import dataclasses
import functools
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...common.arrays import Time, concrete
from ...common.errors import SceneError
from ...common.fields import AbstractClassVar
from .. import marker_checks
from ..body.base import AbstractBody
from ..fields import check_choice, check_numbers
from ..marker import Marker, Pose, Poses, Twists, Wrench, Wrenches
from ..outline import Outlines, linked


class AbstractEffect(eqx.Module):
    """Anything that contributes to the generalized force Q."""

    # The numbers of its markers whose positions are all that it asks for: it never asks how these
    # are turned, nor turns them.
    at_points: ClassVar[tuple[int, ...]] = ()
    # Whether pictures hatch the ground at a marker on it.
    hatched: ClassVar[bool] = False

    def __check_init__(self) -> None:
        marker_checks.check_connected(self)
        self.check()

    @property
    @abc.abstractmethod
    def markers(self) -> tuple[Marker, ...]:
        """The markers that the effect sees."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise a SceneError that names effect, field, value and remedy."""

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Return the outlines for pictures, from the poses of the markers at time t, if any.

        `size` [m] is what a sign such as an arrow should be about as large as.
        """
        del t, poses, size
        return ()

    def label(self) -> str:
        """The label of the effect in messages: its name if it has one, else its kind and bodies."""
        name: str = getattr(self, "name", "")
        return name or f"{type(self).__name__}({', '.join(marker.body for marker in self.markers)})"


class AbstractMarkerEffect(AbstractEffect):
    """An effect that acts on markers: those among its fields, unless it says otherwise."""

    # In the plane (2), in space (3), or in both.
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    # Whether the wrenches depend on velocities; where none do, no velocity is traced.
    needs_twists: AbstractClassVar[bool]
    # Whether it has wrenches: what is only an inertia has none.
    acts: ClassVar[bool] = True
    # What the wrenches consist of, for the balance of energy: those of `energy`, and others, which
    # may give energy (`supplies`) or only take it (`dissipates`).
    stores: ClassVar[bool] = False
    dissipates: ClassVar[bool] = False
    supplies: ClassVar[bool] = True
    # Pairs of its markers, by their numbers, in space whose angle counts full turns: the pose of a
    # counter for each follows those of the markers, see `counted_angle`.
    counted: ClassVar[tuple[tuple[int, int], ...]] = ()
    # Names of its first-order states, and their units where they are known, see
    # `AbstractStateEffect`.
    states: ClassVar[tuple[str, ...]] = ()
    units: ClassVar[tuple[str, ...]] = ()
    # Whether it may begin on the way, as contacts do; then the start shows nothing of it.
    begins: ClassVar[bool] = False
    # Whether the law of one that is `held` goes on smoothly where it does not act.
    goes_on: ClassVar[bool] = False
    # Whether its `room` comes and goes while bodies just turn, as that of a point does.
    oscillates: ClassVar[bool] = True
    # Whether it is right within a `limit` only.
    limited: ClassVar[bool] = False

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The markers that the effect sees: the fields that are Markers, in their order."""
        values = (getattr(self, field.name) for field in dataclasses.fields(self))
        return tuple(value for value in values if isinstance(value, Marker))

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """Return the outlines for pictures, from the poses of the markers at time t.

        They are lines between the markers, unless the effect has a sign of its own, about as large
        as `size` [m].
        """
        del t, size
        return linked(poses)

    def acting(self, acts: Bool[Array, ""]) -> "AbstractMarkerEffect | None":
        """Return an effect that `begins` so that its stiffness shows at any state, if it `acts`.

        None where nobody knows it, as for friction that sticks: such a system is stiff.
        """
        del acts
        return None

    def held(self, side: Float[Array, ""]) -> "AbstractMarkerEffect | None":
        """Return an effect that `begins` with one law on both sides of where it does: with `side` 1
        it does not act, with −1 it acts before too, if its law goes on smoothly there, and with 0
        it is as it was.

        None where nobody knows, unless an effect says more.
        """
        del side
        return None

    def room(self, *poses: Pose) -> Float[Array, ""]:
        """Return how far an effect that `begins` is from that, negative where it acts."""
        return jnp.ones((), poses[0].position.dtype)

    @abc.abstractmethod
    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        """Force [N] and torque [N m] on each marker, in their order."""

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        """Potential energy [J]; asked only of effects that store some."""
        del t
        return jnp.zeros((), poses[0].position.dtype)

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """Return a number that changes sign where the effect's law ceases to hold.

        Only effects that are `limited` are asked. Runs that pass the limit are flagged.
        """
        return jnp.ones((), poses[0].position.dtype)

    def power(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        """Power [W] of the wrenches that have no potential energy, and of the change of `energy`
        with time alone.
        """
        wrenches = self.wrenches(t, poses, twists if self.needs_twists else ())
        total = sum(w.power(twist) for w, twist in zip(wrenches, twists, strict=True))
        if self.stores:
            t = jnp.asarray(t, poses[0].position.dtype)
            rates = tuple(pose.rate(twist) for pose, twist in zip(poses, twists, strict=True))
            total += jax.jvp(self.energy, (t, *poses), (jnp.ones_like(t), *rates))[1]
        return jnp.asarray(total)


class AbstractPotential(AbstractMarkerEffect):
    """A conservative effect, given by its energy; force = −∂energy/∂pose."""

    needs_twists: ClassVar[bool] = False
    stores: ClassVar[bool] = True
    supplies: ClassVar[bool] = False

    @abc.abstractmethod
    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        """Potential energy [J]."""

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del twists
        slopes = jax.grad(lambda poses: self.energy(t, *poses))(poses)
        return tuple(-pose.wrench(slope) for pose, slope in zip(poses, slopes, strict=True))

    def power(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        """Power [W] of what changes the energy with time, at rest."""
        del twists
        t = jnp.asarray(t, poses[0].position.dtype)
        rate: Float[Array, ""] = jax.jvp(
            lambda t: self.energy(t, *poses), (t,), (jnp.ones_like(t),)
        )[1]
        return rate


class AbstractDissipation(AbstractMarkerEffect):
    """A dissipative effect, given by Rayleigh's function R; force = −∂R/∂twist.

    For a linear damper R is half of the power that it takes out.
    """

    needs_twists: ClassVar[bool] = True
    dissipates: ClassVar[bool] = True
    supplies: ClassVar[bool] = False

    @abc.abstractmethod
    def rayleigh(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        """Rayleigh's dissipation function [W]."""

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        slopes = jax.grad(lambda twists: self.rayleigh(t, poses, twists))(twists)
        return tuple(Wrench(-slope.velocity, -slope.angular_velocity) for slope in slopes)


class AbstractField(AbstractEffect):
    """A conservative effect on every body, not on markers, given by its energy; Q = −∂energy/∂q."""

    @property
    def markers(self) -> tuple[Marker, ...]:
        return ()

    @abc.abstractmethod
    def energy(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, ""]:
        """Potential energy [J] of one body with the coordinates q."""

    def force(self, body: AbstractBody, q: Float[Array, " size"]) -> Float[Array, " size"]:
        """Q of one body, by autodiff from the energy unless the field says better."""
        slope: Array = jax.grad(self.energy, argnums=1)(body, q)
        return -slope


# The value, its rate, and the wrenches of a force along it.
Displacement = tuple[
    Float[Array, "*k"],
    Callable[[], Float[Array, "*k"]],
    Callable[[Float[Array, "*k"]], Wrenches],
]


def displacement(
    measure: Callable[..., Float[Array, "*k"]], poses: Poses, twists: Twists
) -> Displacement:
    """A displacement between poses: its value, its rate and the wrenches of a force along it.

    The rate is a function, so that nothing of it is traced where it is not called. The wrenches
    follow by virtual work: force · δ-variation, shared among the markers.
    """
    value, pull_back = jax.vjp(measure, *poses)

    @functools.cache
    def rate() -> Float[Array, "*k"]:
        rates = tuple(pose.rate(twist) for pose, twist in zip(poses, twists, strict=True))
        change: Float[Array, "*k"]
        _, change = jax.jvp(measure, poses, rates)
        return change

    def wrenches(force: Float[Array, "*k"]) -> Wrenches:
        return tuple(p.wrench(slope) for p, slope in zip(poses, pull_back(force), strict=True))

    return value, rate, wrenches


def directed(direction: Float[Array, " d"], frame: str, pose: Pose) -> Float[Array, " d"]:
    """A direction that is fixed to the "world", or to the "body" of a marker, by inertial axes."""
    return pose.turned(direction) if frame == "body" else direction


def check_direction(owner: str, effect: Any, dimension: int) -> None:
    """Check a `direction` of the `dimension` of the scene, and the `frame` that it is fixed to."""
    check_numbers(owner, effect, "direction", shape=(dimension,))
    direction = concrete(effect.direction)
    # Its square, which is divided by, must be a number: of 1e-200 it is zero.
    square = None if direction is None else np.sum(np.square(direction))
    if square is not None and not np.finfo(square.dtype).tiny <= square < np.inf:
        raise SceneError(
            f"{owner}: direction is {direction}; give a vector that is not zero, whose square "
            "numbers can hold.",
            field="direction",
        )
    check_choice(owner, "frame", effect.frame, ("world", "body"))


def check_markers(effect: AbstractEffect) -> str:
    """Check the markers of an effect; returns how messages call it."""
    owner = f"effect '{effect.label()}'"
    marker_checks.check_markers(owner, effect.markers, getattr(effect, "dimensions", (2, 3)))
    return owner
