"""Joint coordinates: the same motion as that of all coordinates and constraints."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from joint_trees import tree
from programs import kept

import romjax as rj
from romjax.reduction.joint.formulation import in_joint_coordinates
from romjax.system.constraints import differentiate

# Two solutions of the same equations, by recursion and by multipliers.
SAME = 1e-9
# What rounding leaves of joints and energies of some metres and joules.
ROUNDING = 1e-11


@kept
def both(rom, t, z, w):
    """Physical states, accelerations, energies and masses of a system and of the one it is of, at
    several states.
    """
    full = rom.full
    held = set(rom.structure.constraints)
    cut = np.array([name in held for name in full.structure.constraints], bool)

    def at(z, w):
        q, v = rom.reconstruct(t, z, w)
        a, multipliers = rom.acceleration(t, z, w)
        state = rom.state(t, z, w)
        again = rom.reconstruct(t, *rom.restrict(q, v))
        own = state.physical_acceleration(a), multipliers, state.energy(), again
        unbalanced = rom.mass(z) @ a + state.jacobian().T @ multipliers - rom.force(t, z, w)
        a_full, multipliers = full.acceleration(t, q, v)
        other = a_full, multipliers[cut], full.state(t, q, v).energy()
        rows = full.constraint(t, q)[~cut], (full.state(t, q, v).jacobian() @ v)[~cut]
        return (q, v), own, unbalanced, other, rows

    return jax.vmap(at)(z, w)


def agree(rom, z, w, multiple=SAME):
    """At each of several states, or at one."""
    found = both(rom, 0.0, jnp.atleast_2d(z), jnp.atleast_2d(w))
    for k in range(len(jnp.atleast_2d(z))):
        _agree(*jax.tree.map(lambda x, k=k: np.asarray(x)[k], found), multiple)


def _agree(state, own, unbalanced, other, rows, multiple):
    q, v = state
    a, multipliers, energy, back = own
    a_full, multipliers_full, energy_full = other
    assert np.max(np.abs(rows[0]), initial=0) <= ROUNDING
    assert np.max(np.abs(rows[1]), initial=0) <= ROUNDING * max(1, np.max(np.abs(v)))
    assert np.max(np.abs(a - a_full)) <= multiple * np.max(np.abs(a_full))
    largest = np.max(np.abs(multipliers_full), initial=1)
    assert np.max(np.abs(multipliers - multipliers_full), initial=0) <= multiple * largest
    assert np.max(np.abs(unbalanced)) <= multiple * max(1, np.max(np.abs(a)))
    for kind in ("kinetic", "elastic", "potential"):
        each = (getattr(x, kind) for x in (energy, energy_full))
        np.testing.assert_allclose(*each, rtol=SAME, atol=ROUNDING)
    for found, given in zip(back, (q, v), strict=True):
        np.testing.assert_allclose(found, given, atol=SAME * max(1, np.max(np.abs(given))))


def state_of(rom, seed, size=0.3):
    """A state by lot, whose quaternions keep their lengths."""
    lot = np.random.default_rng(seed)
    z = np.asarray(rom.q0) + size * lot.uniform(-1, 1, rom.n)
    w = lot.uniform(-1, 1, rom.n)
    for first in rom.structure.quaternions:
        p, rate = z[first : first + 4], w[first : first + 4]
        rate -= p * (p @ rate) / (p @ p)
    return jnp.asarray(z), jnp.asarray(w)


@pytest.mark.parametrize(
    ("make", "n"),
    [pytest.param(zoo.bars, 2, marks=pytest.mark.slow), (zoo.ball_bars, 8)],
    ids=["in the plane", "in space"],
)
def test_a_chain_accelerates_as_with_constraints(make, n):
    rom = rj.reduce(zoo.system(make), formulation="joint")
    assert (rom.n, rom.m) == (n, 0)
    agree(rom, *state_of(rom, 1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "space", "loop"),
    # Of which each has three kinds of joints, and those in the plane have all kinds together.
    [(0, False, 0), (2, False, 1), (0, True, 0), (1, True, 1), (2, True, 0)],
)
def test_trees_and_loops_accelerate_as_with_constraints(seed, space, loop):
    """Joints of all kinds, by either marker, flexible and rigid bodies, and free ones; some with a
    loop, whose cut joint asks for the same accelerations where it does not hold.
    """
    scene = tree(seed, space)
    if loop:
        joint = rj.spatial.Spherical if space else rj.Revolute
        ends = scene.bodies[0].at(), scene.bodies[-1].at()
        scene = rj.Scene(scene.bodies, [*scene.joints, joint(*ends, name="last")], scene.effects)
    rom = in_joint_coordinates(rj.assemble(scene))
    assert (rom.m > 0) == loop
    size = 0.1 if rom.structure.flexible else 0.5
    states = [state_of(rom, number, size) for number in range(20)]
    agree(rom, *map(jnp.stack, zip(*states, strict=True)))


def test_the_start_is_that_of_the_system():
    full = zoo.system(zoo.ball_bars)
    rom = rj.reduce(full, formulation=rj.JointCoordinates())
    q, v = eqx.filter_jit(lambda s: s.reconstruct(0.0, s.q0, s.v0))(rom)
    np.testing.assert_allclose(q, full.q0, atol=1e-15)
    np.testing.assert_allclose(v, full.v0, atol=1e-15)
    assert rom.summary == "2 joints of a tree of 2 bodies"


def test_a_basis_is_for_amplitudes():
    full = zoo.system(zoo.bars)
    basis = rj.Basis.from_modes(np.eye(full.n)[:, :2], full.q0)
    with pytest.raises(rj.ReductionError, match="no body of the mechanism deforms"):
        rj.reduce(full, basis, rj.JointCoordinates())
    full = rj.assemble(two_beams(0.0))
    basis = rj.Basis.from_modes(np.eye(full.n)[:, :5], full.q0)
    with pytest.raises(rj.ReductionError, match="has 5 modes, but the bodies have 4 amplitudes"):
        rj.reduce(full, basis, rj.JointCoordinates())


@pytest.mark.slow
def test_joints_kept_and_amplitudes_in_few_modes_predict_from_one_run():
    """Another start than that of the training, which a basis of all coordinates misses."""
    full = rj.assemble(two_beams(0.0))
    other = rj.assemble(two_beams(0.4))
    ts, kept = np.linspace(0.0, 1.0, 101), rj.JointCoordinates()
    options = {"rtol": 1e-8, "max_steps": 20_000, "audit": False}
    basis = kept.basis(full, zoo.run(full, ts, **options), rj.POD(rank=3))
    rom = rj.reduce(full, basis, kept)
    assert (rom.n, rom.m) == (5, 0)
    truth = zoo.run(other, ts, **options)
    run = zoo.run(rom.with_full(other), ts, **options)
    assert rj.compare(truth, run).error < 1e-3


def two_beams(tilt):
    """Two beams on hinges, the first at an angle from the horizontal."""
    along = np.array([np.cos(tilt), np.sin(tilt)])
    beams = [
        rj.Beam(f"beam{i}", 1.0, 1.0, EI=20.0, modes=2, position=(i + 0.5) * along, angle=tilt)
        for i in range(2)
    ]
    joints = [
        rj.Revolute(beams[0].at("start"), rj.ground.at()),
        rj.Revolute(beams[1].at("start"), beams[0].at("end")),
    ]
    return rj.Scene(beams, joints, [rj.Gravity()])


def test_a_basis_is_of_a_full_system():
    """Even if it has as many coordinates as those of joints are, which mean something else."""
    full = zoo.system(zoo.bars)
    rom = rj.reduce(full, formulation="joint")
    basis = rj.Basis.from_modes(np.eye(rom.n), np.zeros(rom.n))
    with pytest.raises(rj.ReductionError, match="is reduced already"):
        rj.reduce(rom, basis)


def test_a_joint_that_is_apart_is_refused():
    bar = rj.RigidBody("bar", 1.0, 0.1, position=(0.5, 0.2))
    hinge = rj.Revolute(bar.at((-0.5, 0.0)), rj.ground.at(), name="hinge")
    with pytest.raises(rj.ReductionError, match=r"'hinge' is apart.*consistent_scene"):
        rj.reduce(rj.assemble(rj.Scene([bar], [hinge])), formulation="joint")


def test_a_drive_may_be_elsewhere_at_zero():
    """The start holds at the time that is given, from which runs begin."""
    moving = {"velocity": (0.0, 1.5), "angular_velocity": 3.0}
    bar = rj.RigidBody("bar", 1.0, 0.1, position=(0.5, 0.0), **moving)
    ends = bar.at((-0.5, 0.0)), rj.ground.at()
    drive = rj.PrescribedAngle(*ends, rj.Ramp(3.0, -6.0), name="drive")
    system = rj.assemble(rj.Scene([bar], [rj.Revolute(*ends), drive]))
    with pytest.raises(rj.ReductionError, match=r"t = 0 s, joint 'drive' is apart.*time=…"):
        rj.reduce(system, formulation="joint")
    rom = rj.reduce(system, formulation=rj.JointCoordinates(time=2.0))
    start = np.array([rom.q0[0], rom.v0[0], rom.time])
    np.testing.assert_allclose(start, [0.0, 3.0, 2.0], atol=ROUNDING)


def test_a_mechanism_without_freedoms_is_refused():
    bar = rj.RigidBody("bar", 1.0, 0.1)
    weld = rj.Weld(bar.at(), rj.ground.at())
    with pytest.raises(rj.ReductionError, match="no freedom"):
        in_joint_coordinates(rj.assemble(rj.Scene([bar], [weld])))


@pytest.mark.slow
def test_a_run_is_that_of_the_redundant_system():
    full = zoo.system(zoo.ball_bars)
    rom = rj.reduce(full, formulation="joint")
    ts = np.linspace(0.0, 1.0, 51)
    own, other = zoo.run(rom, ts, audit=True), zoo.run(full, ts, audit=True)
    np.testing.assert_allclose(own.q, other.q, atol=1e-7)
    assert own.success
    assert not own.warnings()
    forces, given = rj.joint_forces(rom, own), rj.joint_forces(full, own)
    for key in given:
        np.testing.assert_allclose(forces[key].force, given[key].force, atol=1e-7)
    energies = rj.energy(rom, own)
    assert np.max(np.abs(np.asarray(energies.balance))) < 1e-8
    np.testing.assert_allclose(energies.kinetic, rj.energy(full, own).kinetic, rtol=1e-12)


@pytest.mark.slow
def test_energy_does_not_drift_without_stabilisation():
    rom = rj.reduce(zoo.system(zoo.ball_bars), formulation="joint")
    run = zoo.run(rom, np.linspace(0.0, 100.0, 101), rtol=1e-11, audit=False, max_steps=100_000)
    energies = jax.jit(jax.vmap(lambda t, q, v: rom.full.state(t, q, v).energy().total))
    each = np.asarray(energies(run.t, run.q, run.v))
    scale = np.max(np.abs(each - each[0])), 9.81 * 4
    assert scale[0] <= 1e-9 * scale[1]


@pytest.mark.slow
def test_gradients_are_those_of_the_redundant_system():
    def end(mass, joint):
        full = rj.assemble(zoo.bars((mass, 1.0), angles=(0.3, -0.2)))
        system = made.with_full(full) if joint else full
        run = zoo.run(system, jnp.linspace(0.0, 0.5, 6))
        return jnp.sum(run.q[-1] ** 2)

    made = rj.reduce(rj.assemble(zoo.bars((1.3, 1.0), angles=(0.3, -0.2))), formulation="joint")
    own, other = (jax.grad(lambda m, joint=joint: end(m, joint))(1.3) for joint in (True, False))
    np.testing.assert_allclose(own, other, rtol=1e-7)


@pytest.mark.slow
def test_angles_count_turns_without_coordinates_of_their_own():
    """A screw, and a torsion spring against the sense of its hinge, many turns from the start."""
    body = {"mass": 1.0, "inertia": (0.02, 0.08, 0.09)}
    first = rj.spatial.RigidBody("first", **body, position=(0.5, 0, 0))
    second = rj.spatial.RigidBody("second", **body, position=(1.5, 0, 0))
    start, end = (-0.5, 0, 0), (0.5, 0, 0)
    hinge = rj.spatial.Revolute(
        first.at(start, axis=(0, 1, 0)), rj.ground.at((0, 0, 0), axis=(0, 1, 0)), name="hinge"
    )
    screw = rj.spatial.Screw(
        second.at(start, axis=(1, 0, 0)), first.at(end, axis=(1, 0, 0)), pitch=0.3, name="screw"
    )
    back = first.at(start, axis=(0, -1, 0)), rj.ground.at((0, 0, 0), axis=(0, -1, 0))
    effects = [rj.Gravity((0, 0, -9.81)), rj.TorsionSpring(*back, 2.0, 0.1)]
    rom = in_joint_coordinates(rj.assemble(rj.Scene([first, second], [hinge, screw], effects)))
    assert (rom.n, rom.m) == (2, 0)
    assert rom.structure.labels == ("hinge.angle", "screw.angle")
    assert rom.structure.coordinates[0].description == "angle of hinge"
    z, w = state_of(rom, 0)
    agree(rom, z + jnp.array([20.0, -30.0]), w)


@kept
def cut_rows(rom, t, z, w):
    """What cut joints ask for, by twists and by autodiff through the kinematics."""
    state = rom.state(t, z, w)
    slopes = jax.jacfwd(lambda z: rom.constraint(t, z))(z)
    known = differentiate(rom.constraint, t, z, w)
    return (*state.constraints(), state.jacobian()), (*known, slopes)


@pytest.mark.slow
@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_cut_joints_see_the_motion_of_their_markers(space):
    """Of flexible bodies too, off the configurations in which the joints hold."""
    scene = tree(2, space)
    rod = rj.Distance(scene.bodies[0].at(), scene.bodies[-1].at(), 1.0)
    rom = in_joint_coordinates(
        rj.assemble(rj.Scene(scene.bodies, [*scene.joints, rod], scene.effects))
    )
    assert rom.m == 1
    own, known = cut_rows(rom, 0.3, *state_of(rom, 0, 0.1))
    for x, y in zip(own, known, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-11 * max(1, np.max(np.abs(y))))


@pytest.mark.slow
def test_parallel_hinges_close_a_loop_without_locking_it():
    """Most rows of the cut hinge are nothing but rounding: with them it has no freedom."""
    y, corners = (0, 1, 0), np.array([[0, 0, 0], [0.2, 0, 1], [1.2, 0, 1], [1.4, 0, 0]])
    bars, ends = [], [rj.ground.at((0, 0, 0), axis=y)]
    joints = list[rj.AbstractJoint]()
    for i, (a, b) in enumerate(itertools.pairwise(corners)):
        bars.append(rj.spatial.RigidBody(f"bar{i}", 1.0, (0.1, 0.1, 0.1), position=(a + b) / 2))
        joints.append(rj.spatial.Revolute(bars[-1].at((a - b) / 2, axis=y), ends[-1]))
        ends.append(bars[-1].at((b - a) / 2, axis=y))
    joints.append(rj.spatial.Revolute(rj.ground.at(corners[-1], axis=y), ends[-1]))
    full = rj.assemble(rj.Scene(bars, joints, [rj.Gravity((3.0, 0, -9.81))]))
    rom = in_joint_coordinates(full)
    assert (rom.n, rom.m, rom.cut.rank) == (3, 5, 2)
    own, other = accelerations_at_start(rom)
    assert np.max(np.abs(other)) > 1
    np.testing.assert_allclose(own, other, atol=1e-11)


@kept
def accelerations_at_start(rom):
    state = rom.state(0.0, rom.q0, rom.v0)
    own = state.physical_acceleration(rom.acceleration(0.0, rom.q0, rom.v0)[0])
    return own, rom.full.acceleration(0.0, state.q, state.v)[0]


@pytest.mark.slow
def test_a_loop_is_cut_and_closed():
    full = zoo.system(zoo.loop_in_space)
    rom = rj.reduce(full, formulation="joint")
    assert (rom.n, rom.m) == (4, 3)
    assert "cut: 'pin'" in rom.summary
    ts = np.linspace(0.0, 0.5, 51)
    own, other = zoo.run(rom, ts, rtol=1e-9), zoo.run(full, ts, rtol=1e-9)
    np.testing.assert_allclose(own.q, other.q, atol=1e-7)


@pytest.mark.slow
def test_a_row_that_the_others_imply_costs_no_steps():
    """Of the five rows of Bricard's last hinge, four are independent where it holds; off there the
    fifth would be too, and as stiff as the hinge is apart.
    """
    full = rj.assemble(rj.gallery.bricard())
    rom = rj.reduce(full, formulation="joint")
    assert (rom.n, rom.m, rom.cut.rank) == (5, 5, 4)
    ts = np.linspace(0.0, 1.0, 51)
    own, other = zoo.run(rom, ts, rtol=1e-8), zoo.run(full, ts, rtol=1e-8)
    np.testing.assert_allclose(own.q, other.q, atol=1e-6)
    assert own.stats.num_steps <= other.stats.num_steps
    assert np.max(own.violation) <= 1e-6
