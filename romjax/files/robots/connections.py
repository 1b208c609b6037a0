"""The equality constraints of a robot, and its tendons."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...scene.effect.joint_damper import JointDamper
from ...scene.effect.joint_spring import JointSpring
from ...scene.effect.joint_stop import JointStop
from ...scene.effect.rope import Rope
from ...scene.joint.base import AbstractJoint
from ...scene.joint.coupling import Coupling
from ...scene.joint.prescribed import PrescribedAngle, PrescribedTravel
from ...scene.joint.spatial.spherical import Spherical
from ...scene.joint.weld import Weld
from ...scene.marker import Marker
from ...scene.placement import Placement
from ...scene.signal import Constant
from .attributes import open_ends
from .impedance import reference
from .joints import Measured
from .model import Model
from .passive import dissipation, rubbing
from .tree import Tree

_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
_CONNECT, _WELD = 0, 1
# A tendon that needs so many robots' masses to be moved is not moved at first.
_UNMOVED = 1e6
_SITE = 3  # MuJoCo's number of what a tendon passes


def equalities(model: Model, tree: Tree, measured: dict[int, Measured]) -> Iterator[AbstractJoint]:
    """The constraints that hold in addition to the joints; those that are not active hold not."""
    arrays = model.arrays
    for i in range(arrays.neq):
        if not arrays.eq_active0[i]:
            continue
        kind, data, name = int(arrays.eq_type[i]), arrays.eq_data[i], model.numbered("equality", i)
        if kind in (_CONNECT, _WELD):
            pair = _markers(model, tree, i, kind, data)
            if pair[0].body == pair[1].body:
                raise model.refuse("equality", i, "both sides are on one body; take it out.")
            yield Weld(*pair, name=name) if kind == _WELD else Spherical(*pair, name=name)
        else:
            yield _coupling(model, i, measured, data, name)


def _markers(
    model: Model, tree: Tree, number: int, kind: int, data: np.ndarray
) -> tuple[Marker, Marker]:
    arrays = model.arrays
    ids = int(arrays.eq_obj1id[number]), int(arrays.eq_obj2id[number])
    if int(arrays.eq_objtype[number]) == int(model.mujoco.mjtObj.mjOBJ_SITE):
        first, second = (site_marker(arrays, tree, i) for i in ids)
        return first, second
    # MuJoCo stores the points of a weld in the other order, and the turn of the second body.
    points = (data[0:3], data[3:6]) if kind == _CONNECT else (data[3:6], data[0:3])
    turns = (_UNTURNED if kind == _CONNECT else data[6:10], _UNTURNED)
    pairs = zip(ids, points, turns, strict=True)
    first, second = (tree.marker(i, Placement(np.array(p), np.array(t))) for i, p, t in pairs)
    return first, second


def site_marker(arrays: Any, tree: Tree, site: int) -> Marker:
    """A marker at a site, turned as it is."""
    place = Placement(np.array(arrays.site_pos[site]), np.array(arrays.site_quat[site]))
    return tree.marker(int(arrays.site_bodyid[site]), place)


def _coupling(
    model: Model, number: int, measured: dict[int, Measured], data: np.ndarray, name: str
) -> AbstractJoint:
    """Return the joint of q₁ − q₁⁰ = Σ a_k (q₂ − q₂⁰)^k."""
    arrays = model.arrays
    led = measured[int(arrays.eq_obj1id[number])]
    zero = _reference(arrays, int(arrays.eq_obj1id[number]))
    if int(arrays.eq_obj2id[number]) < 0:
        held = Constant(led.sign * (zero + float(data[0])))
        if led.motion in ("angle", "bounded angle"):
            return PrescribedAngle(led.a, led.b, held, name=name)
        if led.motion == "travel":
            return PrescribedTravel(led.a, led.b, held, name=name)
        raise model.refuse("equality", number, "it holds one of several hinges; take that out.")
    leading = measured[int(arrays.eq_obj2id[number])]
    if led.link == leading.link:
        raise model.refuse("equality", number, "both joints are of one body; give it two.")
    # MuJoCo's polynomial is of displacements from the reference positions; here it is of the
    # positions themselves.
    shift = np.polynomial.Polynomial([-_reference(arrays, int(arrays.eq_obj2id[number])), 1.0])
    polynomial: Any = np.polynomial.Polynomial(data[:5])(shift) + zero
    # A motion that is counted the other way changes the sign of odd powers.
    powers = led.sign * polynomial.coef * leading.sign ** np.arange(len(polynomial.coef))
    used = np.flatnonzero(powers)
    powers = powers[: used[-1] + 1] if used.size else powers[:1]
    return Coupling(
        led.a, leading.a, led.b, leading.b, powers, led.motion, leading.motion, name=name
    )


def _reference(arrays: Any, joint: int) -> float:
    return float(arrays.qpos0[arrays.jnt_qposadr[joint]])


def tendon_sites(model: Model, tree: Tree, number: int) -> list[Marker]:
    """The markers of the sites that a tendon runs over in straight pieces."""
    arrays = model.arrays
    first, count = int(arrays.tendon_adr[number]), int(arrays.tendon_num[number])
    if any(int(arrays.wrap_type[first + k]) != _SITE for k in range(count)):
        raise model.refuse("tendon", number, "it is not straight; lead it from site to site.")
    return [site_marker(arrays, tree, int(arrays.wrap_objid[first + k])) for k in range(count)]


def tendon_ends(model: Model, tree: Tree, number: int) -> tuple[Marker, Marker]:
    """The markers of a tendon that is one straight line."""
    sites = tendon_sites(model, tree, number)
    if len(sites) != 2:
        raise model.refuse(
            "tendon",
            number,
            "it runs over several sites, and more than pulls where it is longer than the upper end "
            'of its springlength or range; give springlength="0 …", or lead it between two sites.',
        )
    return sites[0], sites[1]


def tendons(model: Model, tree: Tree) -> Iterator[Any]:
    """The effects of tendons: springs, dampers, friction and stops along straight lines, and ropes
    over several sites.
    """
    arrays = model.arrays
    for i in range(arrays.ntendon):
        if np.any(arrays.tendon_stiffnesspoly[i]) or np.any(arrays.tendon_dampingpoly[i]):
            raise model.refuse("tendon", i, "it has polynomials; give one number each.")
        yield from _ropes(model, tree, i) if arrays.tendon_num[i] > 2 else _line(model, tree, i)


def _line(model: Model, tree: Tree, i: int) -> Iterator[Any]:
    arrays, (a, b) = model.arrays, tendon_ends(model, tree, i)
    stiffness, damping = float(arrays.tendon_stiffness[i]), float(arrays.tendon_damping[i])
    friction = float(arrays.tendon_frictionloss[i])
    shortest, longest = (float(x) for x in arrays.tendon_lengthspring[i])
    if stiffness and shortest == longest:
        yield JointSpring(a, b, stiffness, longest, "distance")
    elif stiffness:
        yield JointStop(a, b, *open_ends((shortest, longest)), stiffness, motion="distance")
    if damping or friction:
        yield JointDamper(a, b, damping, rubbing(model, friction, "distance"), "distance")
    ends = open_ends(arrays.tendon_range[i])
    if arrays.tendon_limited[i] and ends != (None, None):
        loss = dissipation(model, "distance")
        yield JointStop(a, b, *ends, _held(model, i), loss, "distance")


def _ropes(model: Model, tree: Tree, i: int) -> Iterator[Any]:
    """Return the ropes of a tendon over several sites that pulls where it is too long."""
    arrays, (a, *via, b) = model.arrays, tendon_sites(model, tree, i)
    stiffness, (shortest, longest) = (
        float(arrays.tendon_stiffness[i]),
        arrays.tendon_lengthspring[i],
    )
    limited, (least, most) = bool(arrays.tendon_limited[i]), arrays.tendon_range[i]
    pushes = (stiffness and shortest > 0) or (limited and least > 0)
    if pushes or arrays.tendon_damping[i] or arrays.tendon_frictionloss[i]:
        tendon_ends(model, tree, i)
    name = model.numbered("tendon", i)
    if stiffness:
        yield Rope(a, b, float(longest), stiffness, via=via, name=name)
    if limited:
        stop = f"{name}: range" if stiffness else name
        loss = dissipation(model, "distance")
        yield Rope(a, b, float(most), _held(model, i), via=via, dissipation=loss, name=stop)


def _held(model: Model, number: int) -> float:
    """The stiffness [N/m] of a tendon at the ends of its range: that of MuJoCo's for the inertia
    that it moves at first; of the robot's mass where it moves nothing then.
    """
    arrays = model.arrays
    stiffness, _ = reference(model, arrays.tendon_solref_lim[number])
    total, mobility = float(np.sum(arrays.body_mass)), float(arrays.tendon_invweight0[number])
    # The effective mass is the inverse of the mobility at the start; of what does not move there,
    # that of the robot.
    return stiffness / mobility if mobility * total * _UNMOVED > 1 else stiffness * total
