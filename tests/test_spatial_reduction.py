"""Reduction in space: bases of quaternions, minimal coordinates, local bases, errors of turns."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from motions import through
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial as r
from romjax.basis.snapshots import SnapshotSet
from romjax.linalg import quaternions
from romjax.reduction.lift.affine import AffineLift
from romjax.reduction.lift.base import differentiate

TS = np.linspace(0.0, 1.0, 201)
# The slider of Haug's spatial slider crank ("Computer-Aided Kinematics and Dynamics of Mechanical
# Systems", 1989, pp. 396-401) after one second, from two integrations in 40 digits.
SLIDER = 0.211721661393443778
# Required of one minimal coordinate over several turns.
MINIMAL = 1e-7
# Required of a robot arm with a slow modal mass: its error, and its steps.
CAPPED, FEW = 1e-3, 200


def bars(turn=(1.0, 0.0, 0.0, 0.0), own=(1.0, 0.0, 0.0, 0.0), length=1.0):
    """Two bars on ball joints: the scene turned, other axes of the bodies, other quaternions."""
    turn, own = (np.asarray(x) / np.linalg.norm(x) for x in (turn, own))
    axes, spin = quaternions.matrix(own), np.array([2.0, 0.0, 1.0])

    def moved(x):
        return quaternions.rotate(turn, np.asarray(x, float))

    links = [
        r.RigidBody(
            f"bar {i}",
            1.0,
            axes.T @ np.diag([0.02, 0.08, 0.09]) @ axes,
            position=moved((0.5 + i, 0, 0)),
            orientation=length * quaternions.product(turn, own),
            velocity=moved(np.cross(spin, (0.5 + i, 0, 0))),
            angular_velocity=moved(spin),
        )
        for i in range(2)
    ]
    low, high = axes.T @ (-0.5, 0, 0), axes.T @ (0.5, 0, 0)
    joints = [
        r.Spherical(links[0].at(low), rj.ground.at((0, 0, 0))),
        r.Spherical(links[1].at(low), links[0].at(high)),
    ]
    return rj.assemble(rj.Scene(links, joints, [rj.Gravity(moved((0, 0, -9.81)))]))


def swung(system):
    return zoo.run(system, TS, rtol=1e-11, atol=1e-13)


@pytest.fixture(scope="module")
def swing():
    """Two bars that turn up to 121° from their mean."""
    return swung(bars())


@jax.jit
def bases(snapshots):
    return rj.pod(snapshots, rank=6), rj.sod(snapshots, rank=6)


@jax.jit
def scaled_and_not(run):
    """The snapshots of a run, and the same by quaternions of unit length."""
    scaled = SnapshotSet.of(run)
    return scaled, dataclasses.replace(scaled, q=run.q, v=run.v, turns=None)


def ranks(snapshots):
    values = np.asarray(spectrum(snapshots))
    return [int(np.sum(values > tol * values[0])) for tol in (1e-2, 1e-6, 1e-8)]


spectrum = jax.jit(lambda snapshots: rj.pod(snapshots, rank=1).spectrum)


def test_bases_hold_the_freedoms_of_bodies(swing):
    """Six for each body, where quaternions of unit length fill seven directions."""
    scaled, unit = scaled_and_not(swing)
    turns = np.r_[3:7, 10:14]
    assert ranks(scaled)[1:] == [12, 12]
    assert ranks(unit)[1:] == [14, 14]
    assert ranks(scaled.of_coordinates(turns)) == [5, 6, 6]
    assert ranks(unit.of_coordinates(turns)) == [5, 8, 8]


@pytest.mark.parametrize(
    "change",
    [
        {"turn": (0.3, -0.5, 0.7, 0.2)},
        {"own": (0.2, 0.9, -0.4, 0.1)},
        {"length": 0.1},
        {"length": -10.0},
    ],
)
def test_a_basis_knows_neither_axes_nor_lengths(swing, change):
    run = swung(bars(**change))
    (wanted, *others), (found, *own) = bases(swing), bases(run)
    for right, basis in ((wanted, found), *zip(others, own, strict=True)):
        assert_close(basis.spectrum, right.spectrum, SOLVED, right.spectrum[0])
    if "length" in change:
        assert rj.compare(swing, run).error <= SOLVED
        assert_close(found.modes, wanted.modes, 1e3 * SOLVED)


def test_errors_are_angles_between_turns(swing):
    """By 0.01 rad about the body's own x axis, whatever the lengths and signs."""
    c, s = np.cos(0.005), np.sin(0.005)
    own = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, c, -s], [0, 0, s, c]])
    q = np.array(swing.q)
    cosine = np.abs(q[:, 3:7] @ q[0, 3:7])
    q[:, 3:7] = -3 * q[:, 3:7] @ own
    comparison = rj.compare(swing, dataclasses.replace(swing, q=jax.device_put(q)))
    wanted = 0.01 / np.max(2 * np.arccos(np.minimum(cosine, 1)))
    found = np.asarray(comparison.per_coordinate)
    assert np.allclose(found[3:7], wanted, rtol=1e-6)
    assert np.all(found[7:] == 0)


@jax.jit
def twice_along(lift, z, w):
    """The motion of a lift, and what autodiff makes of its positions alone."""
    return lift.motion(None, 0.0, z, w), differentiate(
        lambda t, z: lift.position(None, t, z), jnp.zeros(()), z, w
    )


def test_a_subspace_turns_by_quaternions_of_unit_length(swing):
    """The velocity, the tangent and the bias of a lift are the derivatives of its positions."""
    basis = bases(swing)[0]
    lift = AffineLift(basis.modes, basis.offset, basis.snapshots.turns)
    for i in (20, 200):
        found, right = twice_along(lift, basis.coordinates[i], np.cos(np.arange(6.0)))
        for x, y in zip(found, right, strict=True):
            assert_close(x, y, IDENTITY, scale=np.max(np.abs(y)))
        assert_close(np.sum(found.q[3:7] ** 2), 1.0, IDENTITY)


@pytest.mark.slow
def test_all_directions_of_far_turns_are_the_full_model(swing):
    """Of 14 coordinates the 12 without the lengths of quaternions, up to 121° from their mean."""
    rom = rj.reduce(bars(), rj.pod(swing, rank=12))
    assert (rom.n, rom.m) == (12, 6)
    assert rj.compare(swing, zoo.run(rom, TS)).error <= MINIMAL


@pytest.mark.parametrize("formulation", [rj.Tabulated(), rj.HyperReduced()], ids=str)
def test_formulations_of_the_plane_say_what_to_take(swing, formulation):
    with pytest.raises(
        rj.ReductionError, match=r"space\. formulation=romjax\.\w+\(\) makes a model"
    ):
        rj.reduce(bars(), bases(swing)[0], formulation)


@pytest.mark.exhaustive
def test_a_slider_crank_has_one_minimal_coordinate():
    """Over nearly two turns of the crank, in several charts."""
    system = zoo.system(zoo.loop_in_space)
    motion = rj.simulate(system, TS, rtol=1e-10)
    rom = rj.reduce(system, rj.pod(motion), "minimal")
    assert (rom.n, rom.m) == (1, 0)
    run = rj.simulate(rom, TS, rtol=1e-10)
    assert rj.compare(motion, run).error <= MINIMAL
    assert abs(run.q[-1, 14] - SLIDER) <= MINIMAL
    assert run.is_valid


class Wheel:
    """A wheel on a torsion spring, φ = 30 sin t: over four turns, in the one angle that it has."""

    def __init__(self):
        wheel = r.RigidBody("wheel", 2.0, (0.3, 0.4, 0.5), angular_velocity=(0, 0, 30.0))
        ends = wheel.at((0, 0, 0)), rj.ground.at((0, 0, 0))
        spring = rj.TorsionSpring(*ends, stiffness=0.5)
        self.system = rj.assemble(rj.Scene([wheel], [r.Revolute(*ends)], [spring]))
        self.angle, rate = 30 * np.sin(TS), 30 * np.cos(TS)
        half = self.angle / 2
        counter = self.system.structure.labels.index(
            "counter of TorsionSpring(wheel, ground).angle"
        )
        q, v = np.zeros((2, len(TS), self.system.n))
        q[:, 3], q[:, 6], q[:, counter] = np.cos(half), np.sin(half), self.angle
        v[:, 3], v[:, 6], v[:, counter] = -rate / 2 * q[:, 6], rate / 2 * q[:, 3], rate
        self.motion = through(self.system, TS, q, v)
        self.rom = rj.reduce(self.system, pod_of_one(self.motion), "minimal")


pod_of_one = jax.jit(lambda motion: rj.pod(motion, rank=1))


@pytest.fixture(scope="module")
def wheel():
    return Wheel()


@jax.jit
def state(rom):
    """Of the start: configuration, velocities, and z̈ / ż."""
    a, _ = rom.acceleration(0.0, rom.q0, rom.v0)
    return *rom.reconstruct(0.0, rom.q0, rom.v0), a / rom.v0


@pytest.mark.slow
def test_counters_of_angles_are_coordinates_as_others(wheel):
    """From starts on the way, in any turn: the state that is asked for, and φ̈ = −φ, of an angle
    that z is proportional to.
    """
    motion, turned = wheel.motion, []
    for i in range(0, len(TS), 40):
        q, v, a = state(wheel.rom.starting_at(motion.q[i], motion.v[i]))
        assert_close(q, motion.q[i], IDENTITY, 30.0)
        assert_close(v, motion.v[i], IDENTITY, 30.0**2)
        assert_close(a * v[-1], -wheel.angle[i], IDENTITY, 30.0)
        turned.append(q[-1])
    assert np.ptp(turned) > 6 * np.pi


@pytest.mark.slow
def test_a_wheel_turns_in_one_minimal_coordinate(wheel):
    """Over four turns, in several charts."""
    run = zoo.run(wheel.rom, TS)
    assert run.is_valid, run.warnings()
    counted = run["counter of TorsionSpring(wheel, ground).angle"]
    assert_close(counted, wheel.angle, MINIMAL, 30.0)
    assert rj.compare(wheel.motion, run).error <= MINIMAL


def arm(yaw, lift, duration):
    """A column that turns, one beam that bends and twists, and a load: a robot arm."""
    up, across = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)
    column = r.RigidBody("column", 5.0, (0.05,) * 3, (0, 0, 0.2))
    link = r.Beam(
        "link",
        3.0,
        0.8,
        (1.3e-3, 0.16, 0.16),
        EI=900.0,
        bending=2,
        GJ=450.0,
        torsion=1,
        damping=0.02,
    ).placed("start", column.pose((0.0, 0.0, 0.2)))
    load = r.RigidBody("load", 1.5, (2e-3,) * 3).placed((0.0, 0.0, 0.0), link.pose("end"))
    bearing = column.at((0.0, 0.0, -0.2), axis=up), rj.ground.at((0.0, 0.0, 0.0), axis=up)
    hinge = link.at("start", axis=across), column.at((0.0, 0.0, 0.2), axis=across)
    grip = load.at((0.0, 0.0, 0.0), axis=across), link.at("end", axis=across)
    motors = [
        rj.Motor(*bearing, rj.Step(yaw, 0.0, duration), 900.0, 120.0),
        rj.Motor(*hinge, rj.Step(lift, 0.2, duration), 900.0, 120.0),
    ]
    joints = [r.Revolute(*bearing), r.Revolute(*hinge), r.Weld(*grip)]
    return rj.Scene([column, link, load], joints, [rj.Gravity((0.0, 0.0, -9.81)), *motors])


@pytest.mark.parametrize(
    ("yaw", "lift", "duration"),
    in_groups([(1.0, 0.5, 1.0), (-0.8, 0.6, 0.8)], slow=[(1.0, 0.5, 1.0)]),
)
def test_an_arm_below_a_cap(yaw, lift, duration):
    """Turned by a radian and lifted: no training, so that no move is another than trained."""
    scene, ts = arm(yaw, lift, duration), np.linspace(0.0, 2.0, 101)
    truth = zoo.run(rj.assemble(scene), ts, solver=zoo.RODAS5P, rtol=1e-8)
    run = zoo.run(rj.assemble(rj.cap(scene, 12.0)), ts, rtol=1e-6)
    assert rj.compare(truth, run).error <= CAPPED
    # With 5145 of the full model by the same method, and 261 of Rodas5P, each as dear as many.
    assert run.stats.num_accepted_steps <= FEW
