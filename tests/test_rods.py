"""Rods that bend far: statics in closed form, the mechanics of one rod, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.special
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax.system import dynamics

# Of identities of a rod in one frame: sums of some hundred terms, each to some units of the last
# place, of two expressions that share them.
ALIKE = 1e-13
# A cantilever under a dead load across its tip, P L²/EI: angle, deflection and shortening, each in
# units of the length, by elliptic integrals (Bisshopp and Drucker 1945, doi:10.1090/qam/13360).
ELASTICA = {
    1.0: (0.461351949712, 0.301720773800, 0.0564332362834),
    2.0: (0.781749831557, 0.493457480397, 0.160641720825),
    5.0: (1.215368117612, 0.713791523612, 0.387628360725),
    10.0: (1.43028553880385753, 0.81060902488029645, 0.55499559775375127),
}
# Kinds of rods: (options).
KINDS = {
    "inextensible": {},
    "elastic": {"EA": 20.0, "GA": 30.0, "curvature": (0.5, 1.0)},
    "natural": {"shapes": "pinned-free", "EA": 20.0},
    "loaded": {"shapes": "clamped-clamped", "curvature": 1.0, "loaded": True},
}


def rod(modes=6, kind="inextensible", **options) -> rj.Rod:
    return rj.Rod("rod", 0.7, 1.3, 2.0, modes, **{"rotary": 0.01, **KINDS[kind], **options})


def cantilever(modes, load, gravity=0.0) -> tuple[rj.AbstractSystem, rj.Rod]:
    """A straight rod of one metre, one kilogram and EI = 1, clamped to the ground, under the `load`
    of a function of the marker at its tip, and gravity against its axis.
    """
    blade = rj.Rod("blade", 1.0, 1.0, 1.0, modes).placed("start", rj.ground.pose((0.0, 0.0)))
    clamp = rj.Weld(blade.at("start"), rj.ground.at((0.0, 0.0)))
    effects = [load(blade.at("end")), rj.Gravity((-gravity, 0.0))]
    return rj.assemble(rj.Scene([blade], [clamp], effects)), blade


def tip(modes: int, load) -> rj.Pose:
    """Where the tip of a cantilever is in equilibrium, found from the straight start at once."""
    system, blade = cantilever(modes, load)
    q = rj.equilibrium(system)
    return blade.started(q, np.zeros_like(q)).pose("end")


@pytest.mark.slow
@pytest.mark.parametrize(("circles", "tol"), [(1, IDENTITY), (2, 5 * IDENTITY)])
def test_a_torque_rolls_a_rod_up(circles, tol):
    """Two circles are what the Gauss points of a rod with few modes just see."""
    turn = 2 * np.pi * circles
    end = tip(4, lambda at: rj.Torque(at, rj.Constant(turn)))
    assert_close(end.angle, turn, IDENTITY, turn)
    assert_close(end.position, [0.0, 0.0], tol)


@pytest.mark.slow
@pytest.mark.parametrize(("modes", "tol"), [(8, 5e-9), (10, 1e-10)])
def test_dead_loads_bend_a_cantilever_as_the_elastica(modes, tol):
    for load, wanted in ELASTICA.items():
        end = tip(modes, lambda at, load=load: rj.Force(at, (0.0, 1.0), rj.Constant(load)))
        x, y = np.asarray(end.position)
        assert_close(np.array([end.angle, y, 1 - x]), wanted, tol)


# Columns: loads under which the straight one is no longer stable, and its frequencies below them.

COLUMN = 10  # amplitudes
CRITICAL = 1e-9  # relative


def squares(load, gravity=0.0) -> np.ndarray:
    """ω² of a loaded cantilever, ascending, of the linear model about the straight rod."""
    model = rj.linearize(cantilever(COLUMN, load, gravity)[0], {}, ())
    count = model.shapes.shape[1]
    # Of the inverse, whose largest eigenvalues are the accurate ones.
    return np.sort(1 / np.linalg.eigvals(-np.linalg.inv(model.A[count:, :count])).real)


def along(frame: str, size: float):
    """A load along the axis that compresses: dead, or one that follows the tip."""
    return lambda at: rj.Force(at, (-1.0, 0.0), rj.Constant(size), frame=frame)


@pytest.mark.slow
def test_columns_buckle_under_dead_loads():
    """At π²/4 EI/L² under a force (Euler), at 9/4 j² EI/L³ of a weight per length (Greenhill), j
    the first zero of the Bessel function of order −1/3.
    """
    j = scipy.optimize.brentq(lambda x: scipy.special.jv(-1 / 3, x), 1.0, 2.5, xtol=1e-15)
    force = lambda p: np.min(1 / squares(along("world", p)))  # noqa: E731
    weight = lambda g: np.min(1 / squares(along("world", 0.0), g))  # noqa: E731
    for flexibility, critical in ((force, np.pi**2 / 4), (weight, 9 / 4 * j**2)):
        below, above = critical * (1 - CRITICAL), critical * (1 + CRITICAL)
        # The flexibility 1/ω² is positive up to the critical load, and then one is negative.
        assert flexibility(below) > 0 > flexibility(above)


@pytest.mark.slow
def test_a_column_under_a_load_that_follows_it_has_becks_frequencies():
    """2 ω² + P² + 2 ω² cosh a cos b + P ω sinh a sin b = 0 in units of EI, L and m, with a² and
    −b² the roots x of x² + P x − ω² (Beck 1952, doi:10.1007/BF02008828), up to flutter.
    """

    def unbalanced(omega: float, load: float) -> float:
        root = np.sqrt(load**2 / 4 + omega**2)
        a, b = np.sqrt(root - load / 2), np.sqrt(root + load / 2)
        waves = 2 * omega**2 * np.cosh(a) * np.cos(b) + load * omega * np.sinh(a) * np.sin(b)
        return load**2 + 2 * omega**2 + waves

    for load in (5.0, 15.0, 19.0):
        for omega in np.sqrt(squares(along("body", load))[:2]):
            near = (omega * (1 - 1e-4), omega * (1 + 1e-4))
            exact = scipy.optimize.brentq(unbalanced, *near, args=(load,), xtol=1e-14)
            assert_close(omega, exact, CRITICAL, exact)


# The mechanics of one rod.


@pytest.mark.parametrize("kind", KINDS)
def test_closed_forms_are_those_of_autodiff(kind):
    one, rng = rod(kind=kind), np.random.default_rng(0)
    q, v = jnp.asarray(rng.normal(size=(2, 9)))
    force, of_mass, slopes, of_pose = _both(one, q, v)
    assert_close(force, of_mass, ALIKE, np.max(np.abs(force)))
    assert_close(slopes, of_pose, ALIKE, np.max(np.abs(slopes)))


@jax.jit
def _both(one, q, v):
    """The quadratic velocity force and a marker's gradient, by the rod and by autodiff."""
    point, amplitudes = one.prepare(jnp.array([0.3, 0.1])), q[3:]
    pose = lambda a: jnp.append(*one.local_pose(point, a))  # noqa: E731
    return (
        one.quadratic_velocity_force(q, v),
        dynamics.quadratic_velocity_force(one.mass_matrix)(q, v),
        one.local_gradient(point, amplitudes),
        jax.jacfwd(pose)(amplitudes),
    )


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
