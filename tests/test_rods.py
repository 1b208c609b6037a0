"""Rods that bend far: statics in closed form, the mechanics of one rod, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY
from verification_problems.far import cantilever, tip, torque

import romjax as rj
from romjax.system import dynamics

# Of identities of a rod in one frame: sums of some hundred terms, each to some units of the last
# place, of two expressions that share them.
ALIKE = 1e-13
CRITICAL = 1e-9  # relative, of frequencies
# Kinds of rods: (options).
KINDS = {
    "inextensible": {},
    "elastic": {"EA": 20.0, "GA": 30.0, "curvature": (0.5, 1.0)},
    "natural": {"shapes": "pinned-free", "EA": 20.0},
    "loaded": {"shapes": "clamped-clamped", "curvature": 1.0, "loaded": True},
}


def rod(modes=6, kind="inextensible", **options) -> rj.Rod:
    return rj.Rod("rod", 0.7, 1.3, 2.0, modes, **{"rotary": 0.01, **KINDS[kind], **options})


@pytest.mark.slow
def test_a_torque_rolls_a_rod_up():
    """Two circles are what the Gauss points of a rod with few modes just see."""
    turn = 4 * np.pi
    angle, across, shortening = tip(cantilever(4, torque(turn)))
    assert_close(angle, turn, IDENTITY, turn)
    assert_close(np.array([across, shortening]), [0.0, 1.0], 5 * IDENTITY)


# The mechanics of one rod.


@pytest.mark.parametrize("kind", KINDS)
def test_closed_forms_are_those_of_autodiff(kind):
    one, rng = rod(kind=kind), np.random.default_rng(0)
    q, v = jnp.asarray(rng.normal(size=(2, 9)))
    force, of_mass, slopes, of_pose, moment, of_moment = _both(one, q, v)
    assert_close(force, of_mass, ALIKE, np.max(np.abs(force)))
    assert_close(slopes, of_pose, ALIKE, np.max(np.abs(slopes)))
    assert_close(moment, of_moment, ALIKE, np.max(np.abs(moment)))


@jax.jit
def _both(one, q, v):
    """The quadratic velocity force, a marker's gradient and that of the first moment, by the rod
    and by autodiff.
    """
    point, amplitudes = one.prepare(jnp.array([0.3, 0.1])), q[3:]
    pose = lambda a: jnp.append(*one.local_pose(point, a))  # noqa: E731
    return (
        one.quadratic_velocity_force(q, v),
        dynamics.quadratic_velocity_force(one.mass_matrix)(q, v),
        one.local_gradient(point, amplitudes),
        jax.jacfwd(pose)(amplitudes),
        one.first_moment_slope(q),
        jax.jacfwd(one.first_moment)(q),
    )


class Filled(rj.Rod):
    """A rod with as much again in it, of which it says where it is alone."""

    def first_moment(self, q):
        return 2 * super().first_moment(q)


class Weaker(rj.Gravity):
    def energy(self, body, q):
        return 0.25 * super().energy(body, q)


def test_gravity_is_that_of_the_energy_of_a_subclass():
    numbers, q = ("rod", 0.7, 1.3, 2.0, 2), jnp.arange(5.0)
    one, filled = rj.Rod(*numbers), Filled(*numbers)
    forces = jax.jit(lambda g, w: (g.force(one, q), g.force(filled, q), w.force(one, q)))
    known, twice, quarter = forces(rj.Gravity(), Weaker())
    assert_close(twice, 2 * known, ALIKE, np.max(np.abs(known)))
    assert_close(quarter, 0.25 * known, ALIKE, np.max(np.abs(known)))


def test_a_bent_rod_is_placed_and_turned_as_it_is_bent():
    """A quarter of a circle of radius one, in the frame of its start; by its curvature or by its
    first amplitude, which is that of constant curvature.
    """
    arc = np.pi / 2
    curved = rj.Rod("arc", 1.0, arc, 1.0, 2, curvature=1.0)
    bent = rj.Rod("arc", 1.0, arc, 1.0, 2, shapes="static")
    constant = np.linalg.lstsq(np.asarray(bent.strains.basis), np.array([arc, 0.0]), rcond=None)
    for one in (curved, rj.Rod("arc", 1.0, arc, 1.0, 2, amplitudes=constant[0].tolist())):
        placed = one.placed("start", rj.ground.pose((2.0, 3.0)))
        start, end = placed.pose("start"), placed.pose("end")
        assert_close(start.position, [2.0, 3.0], IDENTITY)
        chord = np.asarray(end.position) - np.asarray(start.position)
        assert_close(np.linalg.norm(chord), np.sqrt(2.0), IDENTITY)
        assert_close(np.asarray(end.angle) - np.asarray(start.angle), arc, IDENTITY)


@pytest.mark.instant
def test_static_shapes_and_natural_modes_have_their_frequencies():
    """(βL)⁴ of a free, a pinned and a clamped rod, from cos b cosh b = ±1 and tan b = tanh b."""
    roots = {"free-free": 4.730040744862704, "pinned-free": 3.926602312047919}
    roots |= {"clamped-free": 1.875104068711961, "pinned-pinned": np.pi}
    roots |= {"clamped-clamped": 4.730040744862704, "free-clamped": 1.875104068711961}
    for shapes, root in roots.items():
        one = rj.Rod("rod", 1.0, 1.0, 1.0, 4, shapes=shapes)
        assert_close(np.asarray(one.strains.squares)[0], root**4, CRITICAL, root**4)


WRONG = {
    "without amplitudes": ({"modes": 0}, "modes is 0.*a Beam without EI"),
    "of unknown shapes": ({"shapes": "held-free"}, "shapes is 'held-free'.*pinned-free"),
    "with too few nodes": ({"nodes": 2}, "nodes is 2, too few for its 6 modes"),
    "that shears without inertia": ({"GA": 1.0, "rotary": 0.0}, "rotary is 0; sections that turn"),
    "of no stiffness": ({"EA": 0.0}, r"EA is 0\.0.*positive"),
    "that drives": ({"damping": -0.1}, "damping is .*must not be negative"),
    "of one rate": ({"rates": [1.0]}, r"rates has shape \(1,\)"),
}


@pytest.mark.instant
@pytest.mark.parametrize(("options", "words"), WRONG.values(), ids=WRONG)
def test_rods_that_cannot_be_are_refused(options, words):
    with pytest.raises(rj.SceneError, match=f"(?s)'rod'.*{words}"):
        rod(**options)


@pytest.mark.instant
def test_rooms_that_take_shapes_for_linear_refuse_rods():
    one = rod()
    with pytest.raises(rj.SceneError, match=r"'rod': a Rod bends too far.*body\.in_span"):
        rj.ReducedBody(one, np.eye(6)[:, :2])
    with pytest.raises(rj.SceneError, match="'rod': a Rod has no modes in a frame.*fewer modes"):
        rj.cap(rj.Scene([one]), 10.0)
    with pytest.raises(rj.SceneError, match=r"'rod' is 0\.35 m beyond its end"):
        rj.assemble(rj.Scene([one], [rj.Weld(one.at((1.0, 0.0)), rj.ground.at())]))
