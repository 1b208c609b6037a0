"""Scenes with slower modes, which start as their loads ask for."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Number
from ..common.checks import check_kind
from ..compiling.program import program_once
from ..scene.body.capped import CappedBody, with_caps
from ..scene.scene import Scene
from ..system.dynamics import linearize
from .assemble import assemble
from .assembled import AssembledSystem
from .closing import started

# Newton's method takes so many steps, with a derivative that lacks forces of inertia, which hardly
# matter.
_SWEEPS = 4


def cap(scene: Scene, hertz: Number) -> Scene:
    """The scene with no mode of a body above `hertz` [Hz]: those that are faster get more mass.

    What moves slowly keeps its motion, since stiffness and statics are exact; its error is that of
    the inertia of deflections which follow their loads, (driving frequency / cap)². Their rates
    start with those of the loads at t = 0, or else they would vibrate by 1/cap of these. It needs
    no training, and the time of a run no longer depends on how fast the fastest modes are. With two
    caps, `extrapolate` gives a more accurate run and an estimate of the error. Not for impacts, nor
    for vibrations above the cap that are wanted.

    Known as selective mass scaling in explicit finite elements (Olovsson, Simonsson, Unosson, Int.
    J. Numer. Meth. Engng 63, 1436, 2005); here by the modes of each body. Differentiable.

    **Arguments:** a `scene` with bodies that deform; `hertz`, one cap for all.

    Raises InputError for what is no scene and for one without modes, and SceneError for a cap that
    is not positive or a body whose modes are not orthonormal, and as `assemble` does.
    """
    remedy = "the romjax.Scene that a system is assembled from"
    check_kind("cap", "the scene", scene, Scene, remedy)
    slow = with_caps(scene, hertz)
    system = following(assemble(slow))
    return started(slow, system.q0, system.v0)


def following(system: AssembledSystem) -> AssembledSystem:
    """The system with capped modes that follow their loads from the start.

    Impulses on the capped modes change v₀ along the constraints until their accelerations do not
    change at t = 0, d/dt q̈_c = 0. A mode of frequency ω gets the share 1 − ω_cap/ω of that: the
    vibration that is left is as large as that of the mode itself, and one just above the cap keeps
    its start.
    """
    return dataclasses.replace(system, v0=_following_rates(system))


@program_once
def _following_rates(system: AssembledSystem) -> Float[Array, " n"]:
    q, v, zero = system.q0, system.v0, jnp.zeros((), system.q0.dtype)
    columns, shares = list[np.ndarray](), list[Array]()
    for group in system.bodies:
        if isinstance(group.bodies, CappedBody):
            columns.append(group.coordinates.array[:, group.bodies.frame_size :].reshape(-1))
            shares.append(1 - 1 / jax.vmap(lambda body: body.excess)(group.bodies).reshape(-1))
    own, share = np.concatenate(columns), jnp.concatenate(shares)
    kkt, none = system.state(zero, q, v).kkt(), jnp.zeros(system.m, q.dtype)
    units = jnp.eye(system.n, dtype=q.dtype)[own]
    pushes = jax.vmap(lambda impulse: kkt.solve(impulse, none)[0])(units)

    def better(_: Any, impulses: Array) -> Array:
        # With a as a function of t, q and v: d/dt a = a_t + a_q v + a_v a.
        moved = v + impulses @ pushes
        slopes = linearize(system, zero, q, moved)
        of_time = slopes.by_time + slopes.by_position @ moved
        jerk = (of_time + slopes.by_velocity @ slopes.acceleration)[own]
        # Its derivative by v leaves out those of a_q and a_v, which are forces of inertia.
        by_rates = slopes.by_position + slopes.by_velocity @ slopes.by_velocity
        # Nothing pushes the modes below the cap.
        unit = jnp.eye(len(own), dtype=q.dtype)
        matrix = jnp.where(share[:, None] > 0, (by_rates @ pushes.T)[own], unit)
        step: Array = jnp.linalg.solve(matrix, jnp.where(share > 0, jerk, impulses))
        return impulses - step

    impulses = jax.lax.fori_loop(0, _SWEEPS, better, jnp.zeros_like(share))
    rates: Array = v + (share * impulses) @ pushes
    # Loads that cannot be differentiated at the start say nothing.
    known: Array = jnp.where(jnp.all(jnp.isfinite(rates)), rates, v)
    return known
