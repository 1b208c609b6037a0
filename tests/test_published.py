"""The problems of the page of verification, and what of published ones is no single number."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import record
import verification
import zoo
from documents import ROOT
from tolerances import IDENTITY

import romjax as rj
from romjax.scene.body.modes import bending_roots

# Required of the roots of the frequency equation, which are printed to 18 places.
ROOTS = 1e-10
# Required of orders of convergence.
SPREAD = 0.2


PROBLEMS = {p.name: p for problems in verification.THEMES.values() for p in problems}
RECORD = json.loads((ROOT / "benchmarks" / "verification.json").read_text())
FLOORS = record.floors()["verification"]
# Of every kind one; what takes long, or what other tests show of a mechanism of their own, is left
# to the program that measures all of them.
FAST = {"cart and pendulum", "hanging bars"}
# Of which tests of the parts that they are about have the same numbers.
ELSEWHERE = {
    *("damped pendulum", "upright pendulum", "disk seen turning"),  # test_modes
    "floating platform",  # test_modes_in_space
    "bob that is pushed",  # test_equilibrium_in_space
    "passage through the lowest point",  # test_events, the period of a pendulum
    "restitution of a contact",  # test_contact
    *("heavy top", "free body"),  # test_spatial
    "frequencies of a building",  # test_frequencies
    "rod that is rolled up",  # test_rods
    "cantilever of welded beams",  # test_welded_beams
    "free beam",  # test_oracle
    "whirl of a rigid rotor",  # test_turning_in_space
    *("elastica at 1", "elastica at 2", "elastica at 5"),  # that at 10 here, those of test_beams
}
LONG = {
    *ELSEWHERE,
    "pendulum",
    "bouncing ball",
    "two four-bars",
    "Bricard's loop",
    "bar on a torsion spring",
    "Newton's cradle",
    "flap of a rotating blade",
    "whirl of a shaft",
    "flexible slider crank by six modes",
    "slope of the time of an event",
    "rigid slider crank",
    "vehicle axle",
    "Euler's column",
    "Beck's column",
    "slider crank in space",
    "Princeton beam",
    "rod that falls on its end",
    "ball before a racket",
    "flexible slider crank",
    "gradient of a slider crank",
    "slope of an equilibrium",
    "slope of a frequency",
}
GROUPS = {**dict.fromkeys(FAST, ()), **dict.fromkeys(LONG, pytest.mark.exhaustive)}
CASES = [
    pytest.param(name, marks=GROUPS.get(name, pytest.mark.slow)) for name in verification.NAMES
]


@pytest.mark.parametrize("name", CASES)
def test_digits(name):
    """As many as the floor asks for; the program that computes all of them compares times, too."""
    problem = PROBLEMS[name]
    found = [float(x) for x in problem.found()]
    wanted = list(problem.right().values())
    assert verification.digits(found, wanted, problem.scale) >= FLOORS[verification.ratio(name)]


@pytest.mark.instant
def test_problems_are_told_in_full():
    """Each has a statement, a source, two ways and a floor, and stands in the record."""
    assert len(PROBLEMS) == len(verification.NAMES) >= 40
    for name, problem in PROBLEMS.items():
        assert 1 <= len(problem.statement.splitlines()) <= 2, name
        assert problem.source, name
        assert len({*problem.ways}) == 2, name
        assert all(problem.ways), name
    assert {verification.ratio(name) for name in PROBLEMS} == set(FLOORS)
    assert set(RECORD["data"]) == set(PROBLEMS)
    assert [name for name, one in RECORD["ratios"].items() if one["value"] < FLOORS[name]] == []


@pytest.mark.instant
def test_right_values_are_those_of_both_ways():
    """Of those whose second way is printed or takes no time; and the record has these values."""
    for name in ("elastica at 10", "whirl of a rigid rotor", "floating platform", "bouncing ball"):
        problem = PROBLEMS[name]
        right = problem.right()
        assert verification.digits(problem.again(), list(right.values()), problem.scale) > 10
        assert RECORD["data"][name]["right"] == pytest.approx(right, rel=1e-12)


@pytest.mark.instant
def test_digits_are_counted():
    count = verification.digits
    assert count([1.001, 200.0], [1.0, 200.0]) == pytest.approx(3)
    assert count([1e-9, 1.0], [0.0, 1.0], scale=1.0) == pytest.approx(9)
    assert count([1.0], [1.0]) == 16
    assert count([np.nan], [1.0]) == count([1.0, 2.0], [1.0]) == 0


def crosswise(t, q, v):
    return jnp.stack([2 * q[1], -2 * q[0]])


def test_arevalo_orders():
    """Position, velocity and multiplier all converge with order 5.

    A particle driven around a circle: x = sin t², y = cos t², λ = 4t² (Arévalo and Lubich, BIT 35,
    1995), from t = 1.
    """
    particle = rj.CustomSystem(
        zoo.unit_mass,
        crosswise,
        zoo.unit_circle,
        q0=[np.sin(1.0), np.cos(1.0)],
        v0=[2 * np.cos(1.0), -2 * np.sin(1.0)],
    )

    def errors(steps):
        settings = {"solver": zoo.RODAS5P, "stabilization": None, "dt": 1 / steps, "throw": False}
        motion = zoo.run(particle, np.array([1.0, 2.0]), **settings)
        s, c = np.sin(4.0), np.cos(4.0)
        found = (motion.q, motion.v, motion.multipliers)
        wanted = ([s, c], [4 * c, -4 * s], [16.0])
        return [np.max(np.abs(np.asarray(x)[-1] - y)) for x, y in zip(found, wanted, strict=True)]

    orders = np.log2(np.array(errors(80)) / np.array(errors(160)))
    assert np.all(np.abs(orders - 5) <= SPREAD), orders


@pytest.mark.instant
def test_roots_of_free_free_beams():
    """cos(βL) cosh(βL) = 1, from a solution in 28-digit arithmetic."""
    wanted = [
        4.730040744862704,
        7.853204624095838,
        10.995607838001671,
        14.137165491257464,
        17.278759657399481,
    ]
    assert np.allclose(bending_roots("free-free", 5), wanted, rtol=ROOTS, atol=0)


@eqx.filter_jit
def shapes_and_slopes(body, points):
    """The mode shapes at points, and their derivatives by the point."""
    shapes, slopes = (jax.vmap(f) for f in (body.mode_shapes, jax.jacfwd(body.mode_shapes)))
    return shapes(points), slopes(points)


@pytest.mark.parametrize("shapes", ["free-free", "static"])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_mode_shapes_are_orthonormal(axis, shapes):
    """∫ρ w_i w_j ds = δ_ij, and no mode moves the centre of mass or turns the beam; every natural
    mode is 2/√m at the end with the lower coordinate. By Gauss–Legendre quadrature, exact to
    rounding.

    A point turns counter-clockwise by w' where the axis is x, clockwise where it is y.
    """
    mass, length, modes = 0.7, 1.3, 6
    body = rj.Beam("beam", mass, length, EI=1.0, modes=modes, axis=axis, shapes=shapes)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    along = length / 2 * np.append(nodes, -1.0)
    none = np.zeros_like(along)
    lengthwise, across, sign = (0, 1, 1.0) if axis == "x" else (1, 0, -1.0)
    points = np.stack([along, none] if axis == "x" else [none, along], axis=1)
    values, slopes = map(np.asarray, shapes_and_slopes(body, points))
    deflection, tip = values[:-1, across], values[-1, across]
    density = mass * weights / 2
    gram = deflection.T @ (density[:, None] * deflection)
    assert np.allclose(gram, np.eye(modes), rtol=0, atol=IDENTITY)
    assert np.allclose(density @ deflection, 0, rtol=0, atol=IDENTITY)
    assert np.allclose((density * along[:-1]) @ deflection, 0, rtol=0, atol=IDENTITY)
    if shapes == "free-free":
        assert np.allclose(tip, 2 / np.sqrt(mass), rtol=IDENTITY, atol=0)
    slope = sign * slopes[:, across, :, lengthwise]
    largest = np.max(np.abs(slope))
    assert np.allclose(values[:, 2], slope, rtol=0, atol=IDENTITY * largest)
