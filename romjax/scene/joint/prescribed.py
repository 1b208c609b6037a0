"""Motions that are given as functions of time."""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, concrete
from ...common.errors import SceneError
from ..drawing import arrow, on_axis, placed, turning_arrow
from ..fields import UNIT
from ..marker import Marker, Pose, Poses
from ..motion import moved
from ..outline import Outline, Outlines
from ..signal import AbstractSignal, signal_field
from .base import AbstractJoint


class AbstractPrescribed(AbstractJoint):
    """The base of all kinds, which prescribe an angle, a travel or a distance by a signal.

    The signal has no kinks, at which forces would be infinite, and begins where the bodies are
    placed if its offset is left out.
    """

    signal: eqx.AbstractVar[AbstractSignal]
    hatched: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @staticmethod
    @abc.abstractmethod
    def value(a: Pose, b: Pose) -> Float[Array, ""]:
        """Return the prescribed angle [rad], travel or distance [m] from the poses."""

    @property
    def takes_start(self) -> bool:
        return self.signal.takes_start

    def starting_at(self, *poses: Pose) -> "AbstractPrescribed":
        # The offset that was left out becomes what the poses have at the start, so that C = 0
        # there.
        begun = self.signal.starting_at(self.value(*poses))
        joint: AbstractPrescribed = eqx.tree_at(lambda joint: joint.signal, self, begun)
        return joint

    def check(self) -> None:
        super().check()
        owner = self.owner()
        self.signal.check(owner)
        if not self.signal.smooth:
            raise SceneError(
                f"{owner}: signal is a {type(self.signal).__name__}, whose kinks no finite force "
                "can follow; give a smooth one, such as a Sine, a Step or a Sum of them, or "
                "through measured data a spline as a signal of your own (AbstractSignal).",
                field="signal",
            )


class PrescribedAngle(AbstractPrescribed):
    """Marker `a` has the angle `signal(t)` [rad] against marker `b`; its multiplier is a torque.

    In space it is the angle about the z axis of `b`; signals of many turns are followed, and full
    turns at the start make no difference.

    A `Ramp` without an offset begins at the angle at which the bodies are placed. Signals of other
    kinds, and offsets that are given, are the angle itself: the start has to suit them.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field()
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    @staticmethod
    @jax.jit
    def value(a: Pose, b: Pose) -> Float[Array, ""]:
        return a.angle_against(b)

    # The difference is taken near the signal: an angle between −π and π would jump at a half turn.
    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        return a.angle_against(b, self.signal(t))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        del t
        a, _ = poses
        way = placed(a, turning_arrow(size, jnp.ones_like(size)))
        return Outline(way, "load"), Outline(a.position[None], "point")


class PrescribedTravel(AbstractPrescribed):
    """Marker `a` is at x = `signal(t)` [m] in the frame of marker `b`, in space at z; the
    multiplier is the force along this axis.

    A `Ramp` without an offset begins where the bodies are placed, as in `PrescribedAngle`.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field(metadata={UNIT: "m"})
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    at_points: ClassVar[tuple[int, ...]] = (0,)

    @staticmethod
    @jax.jit
    def value(a: Pose, b: Pose) -> Float[Array, ""]:
        return b.along(a.position)

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        return (b.along(a.position) - self.signal(t))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow along the axis of `b`, from its origin to the foot of `a`."""
        del t
        a, b = poses
        way = arrow(b.position, on_axis(b, b.along(a.position)[None])[0], size)
        return Outline(way, "load"), Outline(a.position[None], "point")


class PrescribedDistance(AbstractPrescribed):
    """The distance of the two markers is `signal(t)` [m], as of a cylinder whose stroke is given;
    both bodies may turn, and the multiplier is the force along the line.

    A `Ramp` without an offset begins at the distance at which the bodies are placed, as in
    `PrescribedAngle`. The signal stays positive: at zero the line has no direction, and a run that
    comes there fails.

    Raises SceneError for a constant signal that is not positive; to assemble raises it where a
    signal is to begin at the distance of markers that are in one place.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field(metadata={UNIT: "m"})
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1
    at_points: ClassVar[tuple[int, ...]] = (0, 1)

    @staticmethod
    @jax.jit
    def value(a: Pose, b: Pose) -> Float[Array, ""]:
        return moved("distance", a, b)

    def starting_at(self, *poses: Pose) -> "AbstractPrescribed":
        # Where JAX traces, nobody knows the distance: a run that starts at zero ends with its
        # status.
        ends = [concrete(pose.position) for pose in poses]
        if ends[0] is not None and ends[1] is not None:
            self._check_positive(
                np.asarray(np.linalg.norm(ends[0] - ends[1])), "its markers are apart by"
            )
        return super().starting_at(*poses)

    def check(self) -> None:
        super().check()
        # Other signals are judged by the run.
        value = concrete(self.signal(0.0)) if self.signal.is_constant else None
        if value is not None:
            self._check_positive(value, "its signal is")

    def _check_positive(self, distance: np.ndarray, words: str) -> None:
        if not np.all(distance > 0):
            raise SceneError(
                f"{self.owner()}: {words} {distance:g} m, where the line between them has no "
                "direction; keep the distance positive, or hold them together by a Revolute.",
                field="signal",
            )

    def residual(self, t: Time, a: Pose, b: Pose) -> Float[Array, "1"]:
        return (moved("distance", a, b) - self.signal(t))[None]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """An arrow from `b` to `a`."""
        del t
        a, b = poses
        way = arrow(b.position, a.position, size)
        return Outline(way, "load"), Outline(a.position[None], "point")
