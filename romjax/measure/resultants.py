"""Stress resultants along a beam, by the equilibrium of the part beyond each cut."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..assembly.kinematics import Markers
from ..assembly.locate import Located, assembled, bodies_of, located
from ..assembly.wrenches import effect_wrenches, joint_wrenches
from ..common.arrays import Vector, as_array, concrete
from ..common.checks import check_finite, check_shape
from ..common.errors import InputError
from ..integrate.trajectory import Trajectory
from ..linalg import quaternions
from ..scene.body.beam import Beam
from ..scene.body.rigid import RigidBody
from ..scene.body.rod import Rod
from ..scene.body.rod_base import AbstractRod
from ..scene.body.spatial.beam import Beam as SpatialBeam
from ..scene.body.spatial.rigid import RigidBody as SpatialRigidBody
from ..scene.body.spatial.rod import Rod as SpatialRod
from ..scene.effect.base import AbstractField
from ..scene.marker import Pose, Twist, Wrench
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .section_inertia import by_amplitudes, by_poses
from .states import along, check_run, solved

# Bodies that have stress resultants.
Slender = Beam | Rod | SpatialBeam | SpatialRod
# A load at a cut is recognised up to this share of the length.
_SAME = 1e-9


class Resultants(NamedTuple):
    """Stress resultants at some cuts of a beam along a run of k outputs.

    They are what the part beyond the cut does to the part before it, beyond being the side of
    larger positions. With s along the beam's tangent, and n a quarter turn from it,
    counter-clockwise:

    - `axial` (k, positions) [N]: the force along s; tension is positive.
    - `shear` (k, positions) [N]: the force along n.
    - `moment` (k, positions) [N m]: the torque about the cut, counter-clockwise; positive where the
      slope increases with the position. Between loads, dM/ds = −V and dV/ds = −p for a load p per
      length along n, inertia included.

    In space they are by the axes of the section, of which x is along the beam: `shear`
    (k, positions, 2) along y and z, and `moment` (k, positions, 3), the torque about x, which
    twists, and about y and z.
    """

    axial: Float[Array, "k positions"]
    shear: Float[Array, "k positions *yz"]
    moment: Float[Array, "k positions *xyz"]


class _Cut(eqx.Module):
    """A beam and the points of it that the equilibrium at some cuts needs.

    - `length`: of the beam. `gyration`: rotary inertia of its sections per mass [m²], in space
      about their axes, and `bends` whether they turn as it bends, not in rigid motion only.
    - `cuts`: where it is cut, along its axis from its middle.
    - `shares`: mass that each node of the quadrature stands for, (positions, nodes).
    - `points`: the cuts, then the nodes beyond each, one after the other.
    - `axis`: that of the body frame which it lies along; `of_joints`, `of_effects`: which markers
      sit on it.
    """

    length: Float[Array, ""]
    gyration: Float[Array, "*xyz"]
    cuts: Float[Array, " positions"]
    shares: Float[Array, "positions nodes"]
    points: Located
    axis: int = eqx.field(static=True)
    of_joints: tuple[int, ...] = eqx.field(static=True)
    of_effects: tuple[int, ...] = eqx.field(static=True)
    bends: bool = eqx.field(static=True)


def resultants(
    system: AbstractSystem, run: Trajectory, beam: Slender | str, positions: Vector
) -> Resultants:
    """Axial force, shear force and bending moment of a beam or a rod along a run, and in space the
    torque that twists it.

    They are what the part at larger positions does to the part before the cut. Tension is positive;
    the shear force is along a quarter turn from the tangent, the moment counter-clockwise. In space
    shear and moment are by the axes of the section, of which x is along the beam.

    By the equilibrium of the part beyond each cut in the deformed configuration: forces of joints
    and effects on it, weight, and inertia from the accelerations of its points. In a motion without
    acceleration they are exact for any number of modes. In vibration their error falls with the
    fifth power of the number of natural modes, and faster with static ones; that of EI w'', which
    lacks the static part of the natural modes left out, falls with the second.
    Where a load acts at the cut itself, they are those on the side of the beam's middle.

    **Arguments:**

    - `system`: full or reduced. `run`: simulated with it.
    - `beam`: a beam or a rod of the scene, in the plane or in space, or its name.
    - `positions`: of the cuts along the axis of the body frame, the arc length along a rod, from
      the middle [m], from −length / 2 to length / 2.

    A uniform distribution of mass is assumed, and for a beam with an `inertia` of its own that the
    difference to a thin bar is distributed uniformly too, as a rotary inertia. The inertia of a
    beam with `stiffening` is of second order in the deflection: its forces balance all the same,
    its moments but for terms of third order. Of fields other than gravity, what counts is their
    force on a point mass. Raises InputError for a body that is no
    beam, or a position outside of it.
    """
    owner = "resultants"
    check_run(owner, system, run)
    cut = _prepared(owner, system, beam, positions)
    bare = without_names(system)
    loads: Resultants = along(_at, (bare, cut), run.t, run.q, run.v)
    return loads


def _prepared(owner: str, system: AbstractSystem, beam: Slender | str, positions: Vector) -> _Cut:
    name = beam if isinstance(beam, str) else beam.name
    columns, bodies = bodies_of(owner, system, [name])
    body = bodies.get(name)
    if not isinstance(body, Slender):
        kind = "the ground" if body is None else f"a {type(body).__name__}"
        kind += " in space" if body is not None and body.dimension == 3 else ""
        known = "a Beam or a Rod, of romjax or of romjax.spatial,"
        raise InputError(
            f"{owner}: '{name}' is {kind}, but only {known} has them. At a joint, the moment is "
            "that of romjax.joint_forces with the torques of romjax.effect_forces there."
        )
    cuts = as_array(positions)
    check_shape(owner, "positions", cuts, (None,))
    check_finite(owner, "positions", cuts)
    half = concrete(body.length / 2)
    outside = concrete(jnp.abs(cuts))
    if half is not None and outside is not None and np.any(outside > half * (1 + _SAME)):
        raise InputError(
            f"{owner}: a position is {np.max(outside):g} m from the middle of '{name}', which ends "
            f"at {half:g} m; positions are along its axis from its middle."
        )
    # Products of two shapes, of which the highest has `modes` half waves, to rounding.
    nodes, weights = np.polynomial.legendre.leggauss(4 * body.modes + 16)
    beyond = (body.length / 2 - cuts)[:, None]
    places = cuts[:, None] + beyond * ((nodes + 1) / 2)[None]
    axis = int(isinstance(body, Beam) and body.axis == "y")
    along_axis = jnp.concatenate([cuts, places.reshape(-1)])
    points = along_axis[:, None] * np.eye(body.dimension)[None, axis]
    unturned = np.broadcast_to(np.eye(4)[0], (len(points), 4))
    turns = jnp.zeros_like(along_axis) if body.dimension == 2 else jnp.asarray(unturned)
    if isinstance(body, AbstractRod):
        gyration = body.rotary * body.length / body.mass
    else:
        # The sections have that part of the given inertia that a thin rod does not have.
        thin = body.mass * body.length**2 / 12
        thin = thin * np.array([0.0, 1.0, 1.0]) if body.dimension == 3 else thin
        gyration = ((thin if body.inertia is None else body.inertia) - thin) / body.mass
    full, first = assembled(owner, system), columns[name][0]
    return _Cut(
        length=jnp.asarray(body.length),
        gyration=jnp.asarray(gyration),
        cuts=cuts,
        shares=body.mass / body.length * beyond * (weights / 2)[None],
        points=located([name] * len(points), points, turns, columns, bodies),
        axis=axis,
        of_joints=_markers_on(full.joint_markers, first),
        of_effects=_markers_on(full.effect_markers, first),
        bends=body.rotary if isinstance(body, SpatialBeam) else body.bends,
    )


def _markers_on(markers: Markers | None, first: int) -> tuple[int, ...]:
    """The markers on the body whose coordinates begin with the column `first`."""
    if markers is None:
        return ()
    return tuple(i for i, frame in enumerate(markers.frames.rows) if frame[0] == first)


def _at(fixed: tuple[Any, _Cut], t: Array, q: Array, v: Array) -> Resultants:
    """Return the resultants at one output for a system and the cuts of a beam."""
    system, cut = fixed
    a, multipliers = solved(system, t, q, v)
    full, count = system.full, len(cut.cuts)
    own = [cut.points.own(x) for x in (q, v, a)]
    poses, twists, accelerations = _motion(cut.points.markers, *own)
    origin = poses.position[:count]

    def nodes(x: Array) -> Array:
        return x[count:].reshape(*cut.shares.shape, *x.shape[1:])

    weight = _per_mass(full.fields, poses.position)
    # By d'Alembert: what is beyond the cut is in balance with its weight, its inertia, its loads,
    # and the force at the cut.
    forces = cut.shares[:, :, None] * (nodes(weight) - nodes(accelerations.velocity))
    # Moments about the point of the cut as it is deformed.
    arms = nodes(poses.position) - origin[:, None]
    force, torque = jnp.sum(forces, axis=1), jnp.sum(_cross(arms, forces), axis=1)
    if poses.dimension == 3:
        markers = cut.points.markers
        if markers.bending:
            spun = by_poses(cut.gyration, poses, twists, accelerations)
        else:  # turned by amplitudes, as those of beams are
            spun = by_amplitudes(cut.gyration, markers.shapes[:, 3:], cut.bends, *own)
        torque -= jnp.sum(cut.shares[:, :, None] * nodes(spun), axis=1)
    else:
        turning = own[2][2] * jnp.ones_like(cut.shares)
        if cut.bends:
            turning = nodes(accelerations.angular_velocity)
        torque -= cut.gyration * jnp.sum(cut.shares * turning, axis=1)
    loads = []
    if cut.of_joints:
        on_joints = joint_wrenches(full.joints, full.joint_markers, t, q, multipliers)
        loads.append((full.joint_markers, cut.of_joints, on_joints))
    if cut.of_effects:
        on_effects = effect_wrenches(full.now(v).effects, full.effect_markers, t, q, v)
        loads.append((full.effect_markers, cut.of_effects, on_effects))
    for load in loads:
        more, turning = _beyond(cut, origin, q, *load)
        force, torque = force + more, torque + turning
    if poses.dimension == 3:
        axes = quaternions.matrix(poses.turn[:count])
        force, torque = (quaternions.apply_transposed(axes, x) for x in (force, torque))
        return Resultants(axial=force[:, 0], shear=force[:, 1:], moment=torque)
    angle = poses.angle[:count]
    c, s = jnp.cos(angle), jnp.sin(angle)
    # Along the tangent of the deformed axis, and across it.
    x, y = (c, s) if cut.axis == 0 else (-s, c)
    return Resultants(
        axial=x * force[:, 0] + y * force[:, 1],
        shear=x * force[:, 1] - y * force[:, 0],
        moment=torque,
    )


def _beyond(
    cut: _Cut, origin: Array, q: Array, markers: Markers, which: tuple[int, ...], wrenches: Wrench
) -> tuple[Array, Array]:
    """Force and torque about each cut, of the wrenches on the markers beyond it."""
    rows = np.array(which)
    place = markers.points[rows, cut.axis]
    ahead = place[None] - cut.cuts[:, None]
    # A load at the cut itself counts where the beam's middle is before it.
    margin = jnp.where(cut.cuts > 0, -_SAME, _SAME) * cut.length
    counts = (ahead > margin[:, None])[:, :, None]
    forces = jnp.where(counts, wrenches.force[rows][None], 0)
    given = wrenches.torque[rows][None]
    torques = jnp.where(counts if given.ndim == 3 else counts[:, :, 0], given, 0)
    arms = markers.poses(q).position[rows][None] - origin[:, None]
    return jnp.sum(forces, axis=1), jnp.sum(torques + _cross(arms, forces), axis=1)


def _motion(markers: Markers, q: Array, v: Array, a: Array) -> tuple[Pose, Twist, Twist]:
    """Poses and twists, and the rates of these."""
    (poses, twists), (_, accelerations) = jax.jvp(markers.motion, (q, v), (v, a))
    return poses, twists, accelerations


def _per_mass(fields: tuple[AbstractField, ...], points: Array) -> Array:
    """The force of all fields per mass at some points, that on a point mass of 1 kg."""
    total = jnp.zeros_like(points)
    for field in fields:

        def energy(point: Array, field: AbstractField = field) -> Array:
            if len(point) == 2:
                flat = RigidBody("point", mass=1.0, inertia=1.0)
                return field.energy(flat, jnp.concatenate([point, jnp.zeros(1, point.dtype)]))
            probe = SpatialRigidBody("point", mass=1.0, inertia=(1.0, 1.0, 1.0))
            return field.energy(probe, jnp.concatenate([point, np.eye(4, dtype=point.dtype)[0]]))

        total -= jax.vmap(jax.grad(energy))(points)
    return total


def _cross(a: Array, b: Array) -> Array:
    if a.shape[-1] == 3:
        return quaternions.cross(a, b)
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
