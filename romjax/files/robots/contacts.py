"""The contacts of a robot: which of its geoms may touch, and by what force."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ...scene.effect.spatial.contact import Contact
from ...scene.marker import Marker
from ...scene.placement import Placement
from ...scene.surface import AbstractSurface, Capsule, Plane, Sphere
from .impedance import held, reference, resting_depth
from .model import Model
from .passive import rubbing
from .tree import Tree

# MuJoCo's numbers of shapes.
PLANE, SPHERE, CAPSULE = 0, 2, 3
_TOUCHING = (PLANE, SPHERE), (PLANE, CAPSULE), (SPHERE, SPHERE), (SPHERE, CAPSULE)
# How deep what has no weight lies, in sizes of the robot, where its stiffness is taken: as deep as
# a contact by MuJoCo's defaults holds a weight on Earth, of a robot of 1 m.
_DEPTH = 4e-4

_REMEDY = (
    '; say contacts=True for those of planes, spheres and capsules, or <flag contact="disable"/>'
)


class Pair(NamedTuple):
    """Two geoms that may touch, the simpler shape first, and MuJoCo's numbers of their contact.

    - `dimension`: 1 without friction, 3 with it, more with that against pivoting and rolling.
    - `friction`: sliding (2), pivoting, rolling (2). `solref`, `solimp`: how it yields.
    - `other`: what changes the contact and has no counterpart here, in words.
    """

    first: int
    second: int
    dimension: int
    friction: np.ndarray
    solref: np.ndarray
    solimp: np.ndarray
    other: tuple[str, ...]


def contacts(model: Model, tree: Tree) -> Iterator[Contact]:
    """The contacts of spheres and capsules with planes and spheres; of the others the model says
    that they are left out.
    """
    unknown = dict[str, list[Pair]]()
    for pair in _pairs(model):
        kinds = tuple(int(model.arrays.geom_type[i]) for i in (pair.first, pair.second))
        missing = pair.other
        if _is_rigid(model, pair):
            missing = ("contact of what cannot move against each other",)
        elif kinds in _TOUCHING:
            yield from _of_pair(model, tree, pair)
        else:
            names = (model.mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_") for kind in kinds)
            missing = (f"contact of {' and '.join(names).lower()}",)
        for words in missing:
            unknown.setdefault(words, []).append(pair)
    for words, pairs in unknown.items():
        model.left_out.append(_listed(model, words, pairs))
    model.left_out.extend(contacts_left_out(model, asked=True))


def contacts_left_out(model: Model, asked: bool) -> Iterator[str]:
    """Say what is left out besides single pairs, where contacts are asked for or not."""
    if _switched_off(model):
        if asked:
            yield f'{model.root.path}: contacts, which <flag contact="disable"/> switches off'
        return
    geoms = set() if asked else {i for pair in _pairs(model) for i in (pair.first, pair.second)}
    counts = {"geoms": len(geoms), "meshes": model.meshes}
    if parts := [f"{count} {what}" for what, count in counts.items() if count]:
        yield f"{model.root.path}: contacts of {' and '.join(parts)}{'' if asked else _REMEDY}"


def _is_rigid(model: Model, pair: Pair) -> bool:
    """Whether no joint lets the geoms of a pair move against each other."""
    first, second = model.arrays.geom_bodyid[[pair.first, pair.second]]
    return bool(model.arrays.body_weldid[first] == model.arrays.body_weldid[second])


def _listed(model: Model, words: str, pairs: list[Pair]) -> str:
    """A line for what several pairs have."""
    first, second = (model.numbered("geom", i) for i in (pairs[0].first, pairs[0].second))
    place = model.called("geom", pairs[0].second).partition(": geom")[0]
    others = f" and {len(pairs) - 1} more" if len(pairs) > 1 else ""
    return f"{place}: {words}: '{first}' and '{second}'{others}"


# The choice of geoms that may touch.


def _pairs(model: Model) -> Iterator[Pair]:
    """The pairs that a file names, and those that MuJoCo finds by the rules of the format."""
    arrays = model.arrays
    if _switched_off(model):
        return
    named = set[tuple[int, int]]()
    for i in range(arrays.npair):
        first, second = _ordered(arrays, int(arrays.pair_geom1[i]), int(arrays.pair_geom2[i]))
        named.add((first, second))
        numbers = arrays.pair_friction[i], arrays.pair_solref[i], arrays.pair_solimp[i]
        margin, adhesion = arrays.pair_margin[i] - arrays.pair_gap[i], arrays.pair_adhesion[i]
        yield _pair(model, (first, second), int(arrays.pair_dim[i]), *numbers, margin, adhesion)
    for i, j in zip(*np.nonzero(np.triu(_meeting(model))), strict=True):
        first, second = _ordered(arrays, int(i), int(j))
        if (first, second) not in named:
            yield _combined(model, first, second)


def _switched_off(model: Model) -> bool:
    flags = model.arrays.opt.disableflags
    return bool(flags & int(model.mujoco.mjtDisableBit.mjDSBL_CONTACT))


def _ordered(arrays: Any, i: int, j: int) -> tuple[int, int]:
    first, second = sorted((i, j), key=lambda geom: (int(arrays.geom_type[geom]), geom))
    return first, second


def _meeting(model: Model) -> np.ndarray:
    """Return the pairs of geoms that may touch: by their bits, not of one body, and not of bodies
    that a joint connects, unless one of them is the ground; and those of bodies that are excluded
    do not.
    """
    arrays, disabled = model.arrays, model.mujoco.mjtDisableBit
    kinds, others = arrays.geom_contype, arrays.geom_conaffinity
    # A pair meets if the type of either is in the affinity of the other.
    meets = (kinds[:, None] & others[None, :]) != 0
    meets |= meets.T
    own = arrays.geom_bodyid
    body = arrays.body_weldid[own]
    meets &= body[:, None] != body[None, :]
    parent = arrays.body_weldid[arrays.body_parentid[body]]
    if not arrays.opt.disableflags & int(disabled.mjDSBL_FILTERPARENT):
        carries = (parent[:, None] == body[None, :]) & (body[:, None] > 0) & (body[None, :] > 0)
        meets &= ~(carries | carries.T)
    low, high = np.minimum(own[:, None], own[None, :]), np.maximum(own[:, None], own[None, :])
    # MuJoCo keeps an excluded pair as one number, the lower body in its upper 16 bits.
    return np.array(meets & ~np.isin((low << 16) + high, arrays.exclude_signature))


def _combined(model: Model, first: int, second: int) -> Pair:
    """A pair with the numbers of the geom of higher priority, or those of both combined: the larger
    friction, and the mean of the others by their weights.
    """
    arrays, geoms = model.arrays, [first, second]
    margin = np.sum(arrays.geom_margin[geoms]) - np.sum(arrays.geom_gap[geoms])
    adhesion = np.sum(arrays.geom_adhesion[geoms])
    # By MuJoCo's rules: of different priority the higher one decides alone; else friction is the
    # larger one, and the rest is mixed by weights.
    priority = arrays.geom_priority[geoms]
    if priority[0] != priority[1]:
        geoms = [geoms[int(np.argmax(priority))]]
    # mjMINVAL in place of zeros lets two of these count alike.
    weights = np.maximum(arrays.geom_solmix[geoms], 1e-15)
    weights = weights / np.sum(weights)
    solref = arrays.geom_solref[geoms]
    given = np.all(solref[:, 0] > 0)
    friction = np.max(arrays.geom_friction[geoms], axis=0)
    return _pair(
        model,
        (first, second),
        int(np.max(arrays.geom_condim[geoms])),
        # A pair has five: sliding in two directions, pivoting, and rolling about two.
        friction[[0, 0, 1, 2, 2]],
        weights @ solref if given else np.min(solref, axis=0),
        weights @ arrays.geom_solimp[geoms],
        margin,
        adhesion,
    )


def _pair(
    model: Model,
    geoms: tuple[int, int],
    dimension: int,
    friction: np.ndarray,
    solref: np.ndarray,
    solimp: np.ndarray,
    margin: float,
    adhesion: float,
) -> Pair:
    """A pair with its numbers, or those of the options where <flag override="enable"/> says so, and
    what it has that changes its contact and has no counterpart here.
    """
    option = model.arrays.opt
    if option.enableflags & int(model.mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        friction, solref, solimp = option.o_friction, option.o_solref, option.o_solimp
        margin = option.o_margin
    named = {
        "margin of a contact": margin,
        "adhesion of a contact": adhesion,
        "surfacevel of a contact": np.any(model.arrays.geom_surfacevel[list(geoms)]),
        "friction that differs by direction": dimension > 1 and friction[0] != friction[1],
        "friction of a contact against pivoting and rolling": dimension > 3,
    }
    other = tuple(words for words, has in named.items() if has)
    numbers = np.array(friction), np.array(solref), np.array(solimp)
    return Pair(*geoms, dimension, *numbers, other)


# The force of a contact.


def _of_pair(model: Model, tree: Tree, pair: Pair) -> Iterator[Contact]:
    """The contacts of a pair: of both ends of a capsule with a plane, else one."""
    first, second = (_marker(model, tree, i) for i in (pair.first, pair.second))
    radius, half = (float(x) for x in model.arrays.geom_size[pair.second][:2])
    kinds = tuple(int(model.arrays.geom_type[i]) for i in (pair.first, pair.second))
    if kinds[0] == PLANE:
        # A capsule on a plane rests on both ends of its axis, each a ball.
        ends = (half, -half) if kinds[1] == CAPSULE else (0.0,)
        for height in ends:
            end = _marker(model, tree, pair.second, height)
            yield _of_ball(model, pair, end, radius, first, Plane())
        return
    own = float(model.arrays.geom_size[pair.first][0])
    surface = Capsule(radius, 2 * half) if kinds[1] == CAPSULE else Sphere(radius)
    yield _of_ball(model, pair, first, own, second, surface)


def _marker(model: Model, tree: Tree, geom: int, height: float = 0.0) -> Marker:
    """A marker at a geom, with its axes, at a height along z."""
    arrays = model.arrays
    place = Placement(np.array(arrays.geom_pos[geom]), np.array(arrays.geom_quat[geom]))
    up = Placement(np.array([0.0, 0.0, height]))
    return tree.marker(int(arrays.geom_bodyid[geom]), place.then(up))


def _of_ball(
    model: Model, pair: Pair, ball: Marker, radius: float, other: Marker, surface: AbstractSurface
) -> Contact:
    """A contact that yields to the weight of what touches as far as MuJoCo's does, and whose small
    oscillations about that have the damping ratio of the file.
    """
    bodies = model.arrays.geom_bodyid[[pair.first, pair.second]]
    # The mass that a unit force at the contact moves, by the mobilities of both bodies.
    mass = 1 / float(np.sum(model.arrays.body_invweight0[bodies, 0]))
    stiffness, ratio = reference(model, pair.solref)
    if not stiffness:
        raise model.refuse(
            "geom", pair.second, f"solref is {pair.solref}, and holds nothing; give no zeros."
        )
    if weight := float(np.linalg.norm(model.arrays.opt.gravity)):
        depth = resting_depth(stiffness, pair.solimp, weight)
    else:
        depth = _DEPTH * model.size
        weight = held(stiffness, pair.solimp, depth)
    # Hertz's law k δ^(3/2) is made to hold the weight at the same depth as MuJoCo's, and to be
    # damped alike there. At the depth δ of a weight w, a unit of mass has the stiffness
    # ω² = 3/2 w/δ and the damping D w = 2 ζ ω, which gives D = 2 ζ √(3/2 / (w δ)).
    friction = float(pair.friction[0]) if pair.dimension > 1 else 0.0
    return Contact(
        ball,
        other,
        surface,
        stiffness=mass * weight / depth**1.5,
        radius=radius,
        dissipation=2 * ratio * np.sqrt(1.5 / (weight * depth)) if ratio else None,
        friction=rubbing(model, friction, "travel"),
    )
