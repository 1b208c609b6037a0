"""Motion of markers along a run, or their place at rest."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..assembly.kinematics import Markers
from ..assembly.locate import Located, locate
from ..common.arrays import Vector
from ..common.errors import InputError
from ..integrate.trajectory import Trajectory
from ..linalg.dense import length
from ..scene.marker import Marker, Pose
from ..study.errors.corrected import corrected_with
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .states import Rest, accelerations, along_run, run_or_rest

_QUANTITIES = (
    "position",
    "angle",
    "rotation",
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
    "distance",
    "distance_rate",
)


class Measurement(eqx.Module):
    """The motion of a marker along a run of k outputs, or at rest without an axis for these; or
    that of one marker against another.

    Each property is evaluated when it is asked for, and costs what it needs: positions need no
    velocities, velocities no equations of motion. Made by `measure`.

    - `system`: the one that moved, full or reduced. `run`: how it moved, or where it rests.
    - `located`: the marker, or both.
    - `corrected`: the same of `romjax.corrected`, where errors were asked for.
    """

    system: AbstractSystem
    run: Trajectory | Rest
    located: Located
    corrected: "Measurement | None" = None

    @property
    def error(self) -> "MeasuredError":
        """The estimated errors: `.error.position` is that of `.position`, and so on.

        Raises InputError for what was measured without `error=True`.
        """
        if self.corrected is None:
            raise InputError("Measurement.error: nobody asked for it; measure with error=True.")
        return MeasuredError(self, self.corrected)

    @property
    def position(self) -> Float[Array, "*k d"]:
        """Position [m], in the inertial frame or in that of the second marker."""
        return self._pose().position

    @property
    def angle(self) -> Float[Array, "*k"]:
        """Angle [rad], against the inertial frame or against the second marker, full turns
        counted. Raises InputError in space, where `rotation` is in its place.
        """
        return self._pose().angle

    @property
    def rotation(self) -> Float[Array, "*k 3 3"]:
        """The rotation matrix in space, against the inertial frame or against the second marker.

        Its columns are the marker's axes.
        """
        return self._pose().rotation

    @property
    def velocity(self) -> Float[Array, "*k d"]:
        """Rate of the position [m/s]."""
        return self._rate().position

    @property
    def angular_velocity(self) -> Float[Array, "..."]:
        """Rate of the angle [rad/s]."""
        return self._rate().turn

    @property
    def acceleration(self) -> Float[Array, "*k d"]:
        """Rate of the velocity [m/s²], by the equations of motion without stabilisation."""
        return self._second_rate().position

    @property
    def angular_acceleration(self) -> Float[Array, "..."]:
        """Rate of the angular velocity [rad/s²], by the equations of motion without
        stabilisation.
        """
        return self._second_rate().turn

    @property
    def distance(self) -> Float[Array, "*k"]:
        """Distance of the marker [m] from the second one, or from the inertial origin."""
        distance: Float[Array, "*k"]
        distance = along_run(
            self.run, _distance, self.located.markers, self.located.own(self.run.q)
        )
        return distance

    @property
    def distance_rate(self) -> Float[Array, "*k"]:
        """Rate of the distance [m/s]; at a distance of zero, where it has none, zero."""
        states = self.located.own(self.run.q), self.located.own(self.run.v)
        rate: Float[Array, "*k"] = along_run(
            self.run, _distance_rate, self.located.markers, *states
        )
        return rate

    def _pose(self) -> Pose:
        pose: Pose = along_run(
            self.run, relative, self.located.markers, self.located.own(self.run.q)
        )
        return pose

    def _rate(self) -> Pose:
        states = self.located.own(self.run.q), self.located.own(self.run.v)
        rate: Pose = along_run(self.run, relative_rate, self.located.markers, *states)
        return rate

    def _second_rate(self) -> Pose:
        a = accelerations(without_names(self.system), self.run)
        states = [self.located.own(x) for x in (self.run.q, self.run.v, a)]
        rate: Pose = along_run(self.run, relative_second_rate, self.located.markers, *states)
        return rate


class MeasuredError(eqx.Module):
    """The estimated errors of a `Measurement`, by its names, such as `position`: the magnitudes of
    the differences to the same of a run that is `corrected`.
    """

    measured: Measurement
    corrected: Measurement

    def __getattr__(self, name: str) -> Array:
        if name not in _QUANTITIES:
            raise AttributeError(f"MeasuredError has no {name}; it has {', '.join(_QUANTITIES)}.")
        return jnp.abs(getattr(self.corrected, name) - getattr(self.measured, name))


def measure(
    system: AbstractSystem,
    run: Trajectory | Vector,
    marker: Marker,
    against: Marker | None = None,
    *,
    t: ArrayLike | None = None,
    error: bool = False,
) -> Measurement:
    """The motion of a `marker` along a run: `.position` [m], `.velocity`, `.acceleration` (k, 2),
    `.angle` [rad], `.angular_velocity`, `.angular_acceleration` (k,); in space (k, 3) each, and
    `.rotation` (k, 3, 3) in place of the angle.

    `against` another marker all of them are as an observer sees them who moves and turns with that
    one, along its axes; and `.distance` [m], `.distance_rate` are between both.

    **Arguments:**

    - `system`: full or reduced. `run`: simulated with it; or its coordinates (n,) at rest, such as
      `equilibrium(system)`, for single values in place of k.
    - `marker`: such as `body.at((0.0, -0.4))` or `ground.at()`; `against`: another one, the
      inertial frame unless given.
    - `t`: time of a mechanism at rest [s], at which drives stand where they are; zero unless given.
    - `error`: measure the run of `romjax.corrected` too, so that `.error.position` is the estimated
      error of `.position`, and so on of all others, of a reduced or capped model.

    Works under `jit`, `vmap` and derivatives of any order that the run allows. Raises InputError
    for a body that the system lacks, a run of another system or of other numbers of this one, or a
    system that has no bodies.
    """
    system, moved = run_or_rest("measure", system, run, t)
    markers = [marker] if against is None else [marker, against]
    located = locate("measure", system, markers)
    if not error:
        return Measurement(system, moved, located)
    if isinstance(moved, Rest):
        raise InputError("measure: error=True is of a run, not of a mechanism at rest.")
    other, richer = corrected_with(system, moved)
    return Measurement(system, moved, located, Measurement(richer, other, located))


def relative(markers: Markers, q: Float[Array, " own"]) -> Pose:
    """The pose of the first of one or two `markers`, in the frame of the second if there is one."""
    poses = markers.poses(q)
    a = Pose(poses.position[0], poses.turn[0])
    if len(markers.turns) == 1:
        return a
    return a.against(Pose(poses.position[1], poses.turn[1]))


def relative_rate(markers: Markers, q: Float[Array, " own"], v: Float[Array, " own"]) -> Pose:
    """The rate of `relative` where `q` changes with the rate `v`."""
    rate: Pose
    pose, rate = jax.jvp(lambda q: relative(markers, q), (q,), (v,))
    # Rates of turns are angular velocities, by whatever numbers turns are described.
    return Pose(*pose.twist(rate))


def relative_second_rate(
    markers: Markers, q: Float[Array, " own"], v: Float[Array, " own"], a: Float[Array, " own"]
) -> Pose:
    """The second rate of `relative` where `q` changes with the rates `v` and `a`."""
    rate: Pose
    _, rate = jax.jvp(lambda q, v: relative_rate(markers, q, v), (q, v), (v, a))
    return rate


def _distance(markers: Markers, q: Array) -> Array:
    return length(relative(markers, q).position)


def _distance_rate(markers: Markers, q: Array, v: Array) -> Array:
    rate: Array
    _, rate = jax.jvp(lambda q: _distance(markers, q), (q,), (v,))
    return rate
