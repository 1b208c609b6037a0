"""Motion of markers along a run, or their place at rest."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..assembly.kinematics import Markers
from ..assembly.locate import Located, locate
from ..common.arrays import Vector
from ..integrate.trajectory import Trajectory
from ..scene.marker import Marker, Pose
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .states import Rest, accelerations, along_run, run_or_rest


class Measurement(eqx.Module):
    """The motion of a marker along a run of k outputs, or at rest without an axis for these; or
    that of one marker against another.

    Each property is evaluated when it is asked for, and costs what it needs: positions need no
    velocities, velocities no equations of motion. Made by `measure`.

    - `system`: the one that moved, full or reduced. `run`: how it moved, or where it rests.
    - `located`: the marker, or both.
    """

    system: AbstractSystem
    run: Trajectory | Rest
    located: Located

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


def measure(
    system: AbstractSystem, run: Trajectory | Vector, marker: Marker, against: Marker | None = None
) -> Measurement:
    """The motion of a `marker` along a run: `.position` [m], `.velocity`, `.acceleration` (k, 2),
    `.angle` [rad], `.angular_velocity`, `.angular_acceleration` (k,); in space (k, 3) each, and
    `.rotation` (k, 3, 3) in place of the angle.

    `against` another marker all of them are as an observer sees them who moves and turns with that
    one, along its axes; and `.distance` [m], `.distance_rate` are between both.

    **Arguments:**

    - `system`: full or reduced. `run`: simulated with it; or its coordinates (n,) at rest and at
      t = 0, such as `equilibrium(system)`, for single values in place of k.
    - `marker`: such as `body.at((0.0, -0.4))` or `ground.at()`; `against`: another one, the
      inertial frame unless given.

    Works under `jit`, `vmap` and derivatives of any order that the run allows. Raises InputError
    for a body that the system lacks, a run of another system, or a system that has no bodies.
    """
    moved = run_or_rest("measure", system, run)
    markers = [marker] if against is None else [marker, against]
    return Measurement(system, moved, locate("measure", system, markers))


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
    return Pose(*pose.twist(rate))


def relative_second_rate(
    markers: Markers, q: Float[Array, " own"], v: Float[Array, " own"], a: Float[Array, " own"]
) -> Pose:
    """The second rate of `relative` where `q` changes with the rates `v` and `a`."""
    rate: Pose
    _, rate = jax.jvp(lambda q, v: relative_rate(markers, q, v), (q, v), (v, a))
    return rate


def length(vector: Float[Array, "2"]) -> Float[Array, ""]:
    """|vector|, whose derivative at zero, where it has none, is zero."""
    squared = vector @ vector
    apart = squared > 0
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, squared, 1.0)), 0.0)


def _distance(markers: Markers, q: Array) -> Array:
    return length(relative(markers, q).position)


def _distance_rate(markers: Markers, q: Array, v: Array) -> Array:
    rate: Array
    _, rate = jax.jvp(lambda q: _distance(markers, q), (q,), (v,))
    return rate
