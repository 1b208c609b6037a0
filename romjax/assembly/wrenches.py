"""Wrenches of all joints and of all effects of a system, stacked as their markers are."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..scene.marker import Wrench
from .groups import EffectGroup, JointGroup
from .kinematics import Markers


def effect_wrenches(
    groups: tuple[EffectGroup, ...],
    markers: Markers,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    acting: Sequence[bool] | None = None,
) -> Wrench:
    """Return the wrenches of the effects, by the inertial axes, one row per marker: zero of groups
    that are not `acting`, unless it is given of those that have none.
    """
    acting = [group.effects.acts for group in groups] if acting is None else acting
    twists, chosen = None, list(zip(groups, acting, strict=True))
    # Twists cost the derivatives of all poses, which springs and loads do without.
    if any(group.effects.needs_twists for group, on in chosen if on):
        poses, twists = markers.motion(q, v)
    else:
        poses = markers.poses(q)
    # Each marker has its row, so that the rows of effects that rest are zero.
    none = Wrench(jnp.zeros_like(poses.position), jnp.zeros_like(poses.position))
    if poses.position.shape[1] == 2:
        none = none._replace(torque=none.force[:, 0])
    return _stacked(
        [
            wrench
            for group, on in chosen
            for wrench in (group.wrenches(t, poses, twists) if on else group.markers.take(none))
        ]
    )


def joint_wrenches(
    groups: tuple[JointGroup, ...],
    markers: Markers,
    t: Time,
    q: Float[Array, " n"],
    multipliers: Float[Array, " m"],
) -> Wrench:
    """Return the wrenches of the joints, by the inertial axes, one row per marker.

    With the multipliers λ of M q̈ + C_qᵀ λ = Q.
    """
    poses = markers.poses(q)
    return _stacked([side for group in groups for side in group.wrenches(t, poses, multipliers)])


def _stacked(wrenches: list[Wrench]) -> Wrench:
    joined: Wrench = jax.tree.map(lambda *x: jnp.concatenate(x), *wrenches)
    return joined
