"""Undeformed bodies in the positions at which joints hold."""

import jax
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assemble import assemble
from ...assembly.counting import bodies_coordinates
from ...common.arrays import as_jax
from ...compiling.program import program_once
from ...scene.scene import Scene
from ...system import unit_length
from ...system.base import AbstractSystem
from ...system.structure import without_names

# Newton's steps: deflections are small, and the second step is for their squares.
_STEPS = 2
# Frames at once, so that any number of them is one program; fewer where their Jacobians have more
# numbers than this.
_FRAMES, _NUMBERS = 64, 2**24
# This share of the trace is added to the weights, so that joints that repeat others do no harm.
_LEAST = 1e-12


def undeformed(
    scene: Scene,
    t: Float[np.ndarray, " frames"],
    q: Float[np.ndarray, "frames n"],
    modal: list[int],
) -> Float[np.ndarray, "frames n"]:
    """The positions `q` with the `modal` coordinates zero, and the frames of the bodies moved so
    that joints hold as they did, as far as they can: by steps of least size, angles times the size
    of the mechanism.
    """
    bent, straight = q, q.copy()
    straight[:, modal] = 0.0
    system = assemble(scene)
    if not system.m:
        return straight
    count = len([c for body in scene.bodies for c in body.coordinates()])
    # States of effects and counters of joints follow those of the bodies.
    behind = np.tile(np.asarray(system.q0)[count:], (len(q), 1))
    parts = (*scene.joints, *scene.effects)
    bent, moved = (
        np.concatenate([bodies_coordinates(parts, x, count), behind], axis=1)
        for x in (bent, straight)
    )
    lengths = np.array([c.unit == "m" for c in system.structure.coordinates])
    scale = np.where(lengths, float(np.ptp(np.asarray(system.q0)[lengths])) or 1.0, 1.0)
    scale[modal] = 0.0
    bare = without_names(system)
    at_once = int(np.clip(_NUMBERS // (system.m * system.n), 1, _FRAMES))
    for first in range(0, len(q), at_once):
        some = np.arange(first, first + at_once).clip(max=len(q) - 1)
        at, own = as_jax(t[some]), moved[some]
        wanted, _ = jax.device_get(_joined(bare, at, as_jax(bent[some])))
        for _ in range(_STEPS):
            violation, rows = jax.device_get(_joined(bare, at, as_jax(own)))
            rows = rows * scale
            weights = rows @ rows.swapaxes(1, 2)
            weights += _LEAST * np.trace(weights[0]) * np.eye(len(weights[0]))
            multipliers = np.linalg.solve(weights, (violation - wanted)[..., None])[..., 0]
            own = own - scale * np.einsum("fij,fi->fj", rows, multipliers)
        moved[some] = own
    straight[:, :count] = moved[:, :count]
    return straight


@program_once
def _joined(
    system: AbstractSystem, t: Float[Array, " frames"], q: Float[Array, "frames n"]
) -> tuple[Float[Array, "frames M"], Float[Array, "frames M n"]]:
    """Constraints, lengths of quaternions included, and their Jacobians."""
    violation: Array = jax.vmap(lambda t, q: unit_length.extended(system, t, q))(t, q)
    rows: Array = jax.vmap(lambda t, q: unit_length.jacobian(system, t, q))(t, q)
    return violation, rows
