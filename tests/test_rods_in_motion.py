"""Rods in motion: published and own digits, what is conserved, resultants, and local bases."""

import itertools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from jaxtyping import Array, Float
from tolerances import SOLVED

import romjax as rj
from romjax.integrate.default import default_method
from romjax.scene.fields import number
from romjax.system.frequencies import Frequencies

# Of sums over the part beyond a cut, whose nodes are not the Gauss points of the rod.
OTHER_NODES = 1e-7
ORIGIN = rj.ground.pose((0.0, 0.0))


def pendulum(modes, EI=0.1, shapes="pinned-free", angle=0.0, gravity=9.81, force=0.0, **options):
    """A very flexible rod of 1 m and 1 kg, hinged at the origin, level unless turned, at rest."""
    rod = rj.Rod("rod", 1.0, 1.0, EI, modes, shapes=shapes, rotary=1e-3, angle=angle, **options)
    return hinged(rod.placed("start", ORIGIN), gravity, force)


def hinged(rod, gravity=9.81, force=0.0):
    loads = [rj.Force(rod.at("end"), (1.0, 0.0), rj.Constant(force))]
    hinge = rj.Revolute(rod.at("start"), rj.ground.at((0.0, 0.0)))
    return rj.Scene([rod], [hinge], [rj.Gravity((0.0, -gravity)), *loads])


def test_rods_that_nothing_damps_are_followed_by_an_explicit_method():
    """With damping the fast vibration dies, and Rodas5P steps over it."""
    values = dict.fromkeys(Frequencies._fields, 0.0) | {"rigid": 1.0, "fastest": 2e4}
    start = Frequencies(**{name: np.asarray(x) for name, x in values.items()})
    ts = np.linspace(0.0, 1.0, 101)
    for options, solver in (({}, diffrax.Dopri8), ({"damping": 0.01}, rj.Rodas5P)):
        system = rj.assemble(pendulum(4, **options))
        assert isinstance(default_method(system, ts, None, start).solver, solver)
        taken = []

        def choose(ts, system=system, taken=taken):
            taken.append(default_method(system, ts, None, start).solver)
            return ts

        jax.make_jaxpr(choose)(ts)  # while JAX traces
        assert isinstance(taken[0], solver)


@pytest.mark.slow
def test_a_rod_bends_where_a_beam_cannot():
    """A pendulum whose tip turns by more than a radian against its hinge, with four coordinates
    each: a hundredth of the error of a beam with stiffening, in few steps.
    """
    ts = np.linspace(0.0, 1.0, 101)
    truth = tip_of(pendulum(12), ts, rtol=1e-9)[0]
    rod, steps = tip_of(pendulum(4), ts, rtol=1e-6)
    beam = rj.Beam("rod", 1.0, 1.0, EI=0.1, modes=4, shapes="pinned-free", stiffening=True).placed(
        "start", ORIGIN
    )
    other, _ = tip_of(hinged(beam), ts, rtol=1e-6)
    assert steps <= 70
    assert rms(rod - truth) <= min(1e-3, rms(other - truth) / 100)


def tip_of(scene, ts, **settings):
    """The path of the end of a pendulum, and the number of steps."""
    system = rj.assemble(scene)
    run = rj.simulate(system, ts, solver=zoo.DOPRI8, audit=False, **settings)
    path = rj.measure(system, run, scene.bodies[0].at("end")).position
    return np.asarray(path), int(run.stats.num_steps)


def rms(x):
    return np.sqrt(np.mean(np.sum(x**2, axis=1)))


@pytest.mark.slow
def test_local_bases_of_strains_predict_unseen_starts_and_loads():
    """POD of one run from level; five other starts and loads, each against the full model. Four
    natural modes err by 7.3e-4, and need no run.
    """
    ts = np.linspace(0.0, 1.0, 101)
    cases = [
        {},
        {"angle": 0.5},
        {"angle": -0.8},
        {"angle": 0.2, "gravity": 12.0},
        {"force": 0.5},
        {"angle": -0.4, "force": -1.0},
    ]
    full = [rj.assemble(pendulum(10, **case)) for case in cases]
    settings = {"solver": zoo.DOPRI8, "audit": False}
    truths = [rj.simulate(system, ts, rtol=1e-8, **settings) for system in full]
    basis = rj.pod(truths[0])
    at = pendulum(10).bodies[0].at("end")
    for rank, tol in ((4, 1.2e-3), (6, 2.5e-4)):
        rom = rj.reduce(full[0], basis, rj.Local(ranks=(rank,)))
        errors = []
        for system, truth in zip(full, truths, strict=True):
            own = rom.with_full(system).starting_at(system.q0, system.v0)
            run = rj.simulate(own, ts, rtol=1e-6, **settings)
            exact, path = (
                np.asarray(rj.measure(one, x, at).position)
                for one, x in ((system, truth), (own, run))
            )
            errors.append(rms(path - exact) / rms(exact))
        assert max(errors) <= tol, errors
        assert max(errors) <= 3 * errors[0], errors


@pytest.mark.slow
def test_resultants_of_a_rod_are_those_of_its_hinge_and_of_its_law():
    scene = pendulum(12)
    system, (rod,) = rj.assemble(scene), scene.bodies
    run = zoo.run(system, np.linspace(0.0, 0.5, 6))
    inner = rj.resultants(system, run, rod, [-0.5, 0.0, 0.5])
    moment = np.asarray(inner.moment)
    assert_close(moment[:, [0, 2]], np.zeros((6, 2)), OTHER_NODES)
    force = np.asarray(rj.joint_forces(system, run)[scene.joints[0].label()].force)
    inside = np.hypot(np.asarray(inner.axial)[:, 0], np.asarray(inner.shear)[:, 0])
    assert_close(inside, np.linalg.norm(force, axis=1), OTHER_NODES, np.max(inside))
    # The law sees what the shapes can: it lacks some of the moment, less with more of them.
    amplitudes = np.asarray(run.q)[:, 3:]
    step = 1e-4
    turns = [
        np.asarray(amplitudes @ np.asarray(rod.prepare(jnp.array([x, 0.0])).turn))
        for x in (-step, step)
    ]
    law = 0.1 * (turns[1] - turns[0]) / (2 * step)
    assert_close(law, moment[:, 1], 2e-2, np.max(np.abs(moment)))


@pytest.mark.slow
def test_joint_coordinates_know_rods():
    """A bent rod hinged to a bar, with a weight welded to its end: the same without constraints."""
    bar = rj.Beam("bar", 0.4, 0.4, angle=0.3).placed("start", ORIGIN)
    bent = {"amplitudes": [0.3, -0.1, 0.05, 0.02], "angle": 0.2}
    rod = rj.Rod("rod", 0.6, 1.2, 0.3, 4, shapes="pinned-free", rotary=1e-3, **bent)
    rod = rod.placed("start", bar.pose("end"))
    end = rod.pose("end")
    weight = rj.RigidBody("weight", 0.2, 0.01, angle=end.angle).placed((0.0, 0.0), end)
    joints = [
        rj.Revolute(bar.at("start"), rj.ground.at((0.0, 0.0))),
        rj.Revolute(rod.at("start"), bar.at("end")),
        rj.Weld(weight.at(), rod.at("end")),
    ]
    full = rj.assemble(rj.Scene([bar, rod, weight], joints, [rj.Gravity()]))
    free = rj.reduce(full, formulation=rj.JointCoordinates())
    assert (free.n, free.m) == (6, 0)
    ts = np.linspace(0.0, 0.5, 26)
    paths = [
        np.asarray(rj.measure(system, zoo.run(system, ts), weight.at()).position)
        for system in (full, free)
    ]
    assert_close(paths[1], paths[0], SOLVED)


class Element(rj.AbstractPotential):
    """A beam of constant strains between two nodes, by the logarithm of the motion from one to the
    other; `stiffness` EA, GA, EI.
    """

    a: rj.Marker
    b: rj.Marker
    length: Float[Array, ""] = number()
    stiffness: Float[Array, "3"] = number()

    def energy(self, t, a, b):
        del t
        turn, (x, y) = b.angle - a.angle, a.local(b.position)
        half = 0.5 * turn
        small = jnp.abs(half) < 1e-4
        factor = jnp.where(small, 1 - half**2 / 3, half / jnp.tan(jnp.where(small, 1.0, half)))
        moved = jnp.stack([factor * x + half * y, factor * y - half * x, turn])
        strains = moved / self.length - np.array([1.0, 0.0, 0.0])
        return 0.5 * self.length * jnp.sum(self.stiffness * strains**2)

    def check(self):
        """Its numbers are those of one test."""


def chain_of_nodes(count, EA=2e2, GA=1e2, EI=1.0, load=2.0):
    """The tip of a cantilever of one metre under a load across it, of so many elements."""
    size = 1.0 / count
    nodes = [
        rj.RigidBody(f"node{i}", size, size**3, position=(i * size, 0.0)) for i in range(count + 1)
    ]
    parts = [Element(a.at(), b.at(), size, (EA, GA, EI)) for a, b in itertools.pairwise(nodes)]
    push = rj.Force(nodes[-1].at(), (0.0, 1.0), rj.Constant(load))
    clamp = rj.Weld(nodes[0].at(), rj.ground.at((0.0, 0.0)))
    return np.asarray(rj.equilibrium(rj.assemble(rj.Scene(nodes, [clamp], [*parts, push]))))[-3:]


@pytest.mark.slow
def test_beams_of_nodes_tend_to_a_rod():
    """With stretch and shear; what elements of one strain miss falls with their square."""
    rod = rj.Rod("rod", 1.0, 1.0, 1.0, 24, EA=2e2, GA=1e2, rotary=1e-3).placed("start", ORIGIN)
    push = rj.Force(rod.at("end"), (0.0, 1.0), rj.Constant(2.0))
    clamp = rj.Weld(rod.at("start"), rj.ground.at((0.0, 0.0)))
    q = rj.equilibrium(rj.assemble(rj.Scene([rod], [clamp], [push])))
    end = rod.started(q, np.zeros_like(q)).pose("end")
    exact = np.append(np.asarray(end.position), np.asarray(end.angle))
    few, more = chain_of_nodes(8), chain_of_nodes(16)
    assert_close((few - exact) / (more - exact), np.full(3, 4.0), 0.1)
    assert_close((4 * more - few) / 3, exact, 1e-5)


@pytest.mark.slow
def test_local_bases_know_the_coupler_of_a_four_bar():
    """A rod with joints at both ends: its markers are no linear functions of its amplitudes."""
    crank = rj.Beam("crank", 0.4, 0.4, angle=np.pi / 2).placed("start", ORIGIN)
    # The triangle of the coupler's lower end and the rocker's, 1.265 m apart.
    across, sides = np.hypot(1.2, 0.4), (1.2, 0.8)
    inner = np.arccos((sides[0] ** 2 + across**2 - sides[1] ** 2) / (2 * sides[0] * across))
    turn = inner - np.arctan2(0.4, 1.2)
    rod = rj.Rod("coupler", 0.6, 1.2, 2.0, 8, shapes="pinned-pinned", rotary=1e-4, angle=turn)
    rod = rod.placed("start", crank.pose("end"))
    x, y = np.asarray(rod.pose("end").position)
    rocker = rj.Beam("rocker", 0.8, 0.8, angle=np.arctan2(y, x - 1.2))
    rocker = rocker.placed("end", rod.pose("end"))
    joints = [
        rj.Revolute(crank.at("start"), rj.ground.at((0.0, 0.0))),
        rj.Revolute(rod.at("start"), crank.at("end")),
        rj.Revolute(rocker.at("end"), rod.at("end")),
        rj.Revolute(rocker.at("start"), rj.ground.at((1.2, 0.0))),
    ]
    loads = [rj.Gravity(), rj.Torque(crank.at(), rj.Constant(0.8))]
    full = rj.assemble(rj.Scene([crank, rod, rocker], joints, loads))
    ts = np.linspace(0.0, 1.2, 121)
    truth = rj.simulate(full, ts, solver=zoo.DOPRI8, rtol=1e-8, audit=False)
    model = rj.reduce(full, rj.pod(truth), rj.Local(ranks=(0, 4, 0)))
    run = rj.simulate(model, ts, solver=zoo.DOPRI8, rtol=1e-6, audit=False)
    turned = [
        np.asarray(rj.measure(system, own, crank.at()).angle)
        for system, own in ((full, truth), (model, run))
    ]
    assert_close(turned[1], turned[0], 1e-3)
