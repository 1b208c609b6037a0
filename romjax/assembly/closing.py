"""Scenes whose joints hold at the start."""

import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common import precision
from ..common.arrays import concrete
from ..compiling.program import program_once
from ..linalg import quaternions
from ..linalg.kkt import KKT
from ..scene.scene import Scene
from ..system.consistent import START_SWEEPS, check_closed, closed, fitting
from ..system.start import Start
from ..system.structure import Structure
from .assemble import assemble
from .assembled import AssembledSystem
from .kinematics import columns_of
from .speeds import fields_of, refuse_speeds


def consistent_scene(scene: Scene) -> Scene:
    """The scene with the nearest start at which all joints hold, in positions and in velocities.

    So that nobody works out the angles of a loop by hand, nor the velocities of what a crank
    drives: place the bodies roughly, and set the speed of the crank.

    - Positions: the frames of bodies move, as little as can be in the mass metric. Amplitudes of
      modes stay as they are given, zero unless set, since a loop that is guessed would be closed by
      bending its beams, with the forces of that; for a start in static balance continue with
      `equilibrium`. Only where no frames suit the joints do bodies bend, of which a warning tells.
    - Velocities: each velocity, angular velocity and vector of modal rates that is not zero is set,
      and stays; what is left out follows, frames first, and rates of modes only where no frames
      can. A speed that follows cannot be set to zero: hold it by a joint.

    Prescribed motions are joints: they hold as they are. Works under `jit`, `grad` and `vmap`; a
    start that is not found there is refused by `simulate`.

    Raises SceneError as `assemble` does, and InputError if there is no such start near, or if
    speeds that are set contradict the joints or each other, with the nearest ones that do not.
    """
    system = assemble(scene)
    if system.m == 0:
        return scene
    closed = _close(system)
    if concrete(closed.start.violation) is not None:
        check_closed("consistent_scene", system, closed.start)
        if not closed.start.fits:
            refuse_speeds(system, closed.q, closed.given, np.asarray(closed.held))
        if closed.bends:
            _warn_of_bending(system, closed.q)
    return started(scene, closed.q, closed.v)


def started(scene: Scene, q: Float[Array, " n"], v: Float[Array, " n"]) -> Scene:
    """The scene with another start."""
    columns, _ = columns_of(scene.bodies)
    own = [slice(columns[b.name][0], columns[b.name][-1] + 1) for b in scene.bodies]
    bodies = [body.started(q[at], v[at]) for body, at in zip(scene.bodies, own, strict=True)]
    return Scene(bodies, scene.joints, scene.effects)


class _Closed(NamedTuple):
    """A start that was looked for.

    - `q`, `v`, `start`: what was found, and its constraints. `bends`: whether by modes.
    - `given`: the velocities of the scene, at `q`. `held`: which of them are set.
    """

    q: Float[Array, " n"]
    v: Float[Array, " n"]
    start: Start
    bends: Bool[Array, ""]
    given: Float[Array, " n"]
    held: Bool[Array, " n"]


@program_once
def _close(system: AssembledSystem) -> _Closed:
    limits, time = precision.of(system.q0.dtype), jnp.zeros((), system.q0.dtype)
    shares = limits.projected, limits.start_tolerance
    frames = np.array(system.structure.rigid)
    # Without modes, the frames are all that can move.
    most = [frames] if frames.all() else [frames, np.ones_like(frames)]

    def is_closed(q: Array) -> Array:
        return Start.of(system, time, q, 0 * q, *shares).closed

    def sweep(q: Array, free: Array) -> Array:
        def kkt(q: Array) -> KKT:
            return system.state(time, q, 0 * q).kkt(free)

        return closed(system, time, q, kkt, START_SWEEPS)

    q, bends = _in_turn(sweep, is_closed, system.q0, most)
    given = _turning_alike(system, q)
    held = _set_speeds(system.structure, given)

    def is_fitting(v: Array) -> Array:
        return Start.of(system, time, q, v, *shares).fits

    def solve(v: Array, free: Array) -> Array:
        kkt = system.state(time, q, v).kkt(free)
        # The first solve leaves 1e-12 of what a far velocity violates, the second nothing.
        return fitting(system, time, q, v, lambda _: kkt, 2)

    v, _ = _in_turn(solve, is_fitting, given, [~held & free for free in most])
    return _Closed(q, v, Start.of(system, time, q, v, *shares), bends, given, held)


def _in_turn(
    step: Callable[[Array, Array], Array],
    is_good: Callable[[Array], Array],
    x: Float[Array, " n"],
    most: Sequence[Bool[Array | np.ndarray, " n"]],
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Try `step` on x with one set of free coordinates after the other, until the result is good.

    Returns the result, and whether the first set has failed.
    """
    frees = jnp.stack([jnp.asarray(free, x.dtype) for free in most])

    def turn(carry: tuple[Array, Array], free: Array) -> tuple[tuple[Array, Array], Array]:
        x, done = carry
        candidate = step(x, free)
        good = is_good(candidate)
        return (jnp.where(done, x, jnp.where(good, candidate, x)), done | good), candidate

    # A loop over the sets, so that the step is compiled once.
    (best, done), tried = jax.lax.scan(turn, (x, jnp.asarray(False)), frees)
    return jnp.where(done, best, tried[-1]), ~is_good(tried[0])


def _turning_alike(system: AssembledSystem, q: Float[Array, " n"]) -> Float[Array, " n"]:
    """The velocities of the start, with the same angular velocities, at other coordinates."""
    starts = system.structure.quaternions
    if not starts:
        return system.v0
    table = quaternions.columns(starts)
    spin = quaternions.angular_velocity(system.q0[table], system.v0[table])
    return system.v0.at[table].set(quaternions.derivative(q[table], spin))


def _set_speeds(structure: Structure, v: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Say of each velocity whether it belongs to a vector of a body that is not zero."""
    fields, count = fields_of(structure)
    moving = jnp.zeros(count, bool).at[fields].max(v != 0).at[-1].set(False)
    return moving[fields]


def _warn_of_bending(system: AssembledSystem, q: Float[Array, " n"]) -> None:
    """Name the bodies whose amplitudes a start has changed."""
    change = np.abs(np.asarray(q) - np.asarray(system.q0)) * ~np.array(system.structure.rigid)
    largest = dict[tuple[str, str], float]()
    for coordinate, by in zip(system.structure.coordinates, change, strict=True):
        of = coordinate.owner, coordinate.unit
        largest[of] = max(largest.get(of, 0.0), float(by))
    bodies = ", ".join(f"'{name}' by {by:.3g} {unit}" for (name, unit), by in largest.items() if by)
    warnings.warn(
        "consistent_scene: no positions of the bodies suit all joints as they are bent, so that "
        f"modes are displaced: of {bodies}. Check lengths and points of the joints, or set the "
        "amplitudes.",
        stacklevel=3,
    )
