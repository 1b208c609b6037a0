"""A scene with parts and a basis of one's own: assembled, run, drawn, saved and reduced."""

import pickle
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from mechanisms import bar, ends
from test_bases import VelocityPOD
from test_own_outlines import Belt
from tolerances import SOLVED

import romjax as rj
from romjax import plot
from romjax.assembly.outlines import outlines
from romjax.pages.report import _csv

# Two degrees of freedom: a subspace takes two modes more for the curvature of the motion.
RANKS = {"galerkin": 4, "minimal": 2}
# Required of the belt in a run of the full system, whose stabilisation keeps constraints loosely.
VIOLATED = 1e-6


class Network(eqx.Module):
    """One unit, whose activation is a function among its leaves, as in networks of equinox."""

    weight: jax.Array
    activation: Callable

    def __call__(self, x):
        return self.activation(self.weight * x)


class Learned(rj.AbstractMarkerEffect):
    """A torque by a network."""

    a: rj.Marker
    b: rj.Marker
    network: Network
    needs_twists = False

    def wrenches(self, t, poses, twists):
        del t, twists
        torque = self.network(poses[0].angle)
        still = jnp.zeros_like(poses[0].position)
        return rj.Wrench(still, torque), rj.Wrench(still, -torque)

    def check(self):
        pass


class Magnet(rj.AbstractPotential):
    """Two poles that attract each other, softened: U = −strength / (1 + d²)."""

    a: rj.Marker
    b: rj.Marker
    strength: float

    def energy(self, t, a, b):
        del t
        gap = a.position - b.position
        return -self.strength / (1 + gap @ gap)

    def check(self):
        pass


@pytest.fixture(scope="module")
def scene():
    """A hanging bar whose slider is pulled by the belt of a wheel, near a magnet."""
    swinging = bar("bar", (0.0, 0.0), (0.0, -1.0))
    wheel = rj.RigidBody("wheel", 1.0, 0.1, position=(1.0, 0.0))
    top, tip = ends(swinging)
    slide = rj.PointOnLine(top, rj.ground.at())
    held = rj.Revolute(wheel.at(), rj.ground.at((1.0, 0.0)))
    pole = rj.ground.at((0.4, -1.2))
    effects = [rj.Gravity(), Magnet(tip, pole, 0.5), rj.Torque(wheel.at(), rj.Constant(0.2))]
    return rj.Scene([swinging, wheel], [slide, held, Belt(top, wheel.at())], effects)


@pytest.fixture(scope="module")
def motion(scene):
    system = rj.assemble(scene)
    return system, zoo.run(system, np.linspace(0.0, 0.8, 41))


@pytest.fixture(scope="module")
def basis(motion):
    return VelocityPOD(4)(motion[1])


@eqx.filter_jit
def start_force(system):
    return system.force(0.0, system.q0, system.v0)


def test_the_parts_act(scene, motion):
    """The belt's constraint holds, and the magnet's pull is the slope of its energy."""
    system, run = motion
    assert (system.n, system.m) == (6, 4)
    q = np.asarray(run.q)
    top, pulled = q[:, 0] - 0.5 * np.cos(q[:, 2]), 0.25 * q[:, 5]
    assert np.max(np.abs(pulled)) >= 1e-3
    assert_close(top, pulled, VIOLATED)
    without = rj.Scene(scene.bodies, scene.joints, [scene.effects[0], scene.effects[2]])
    pull = np.subtract(start_force(system), start_force(rj.assemble(without)))
    gap = np.array([0.0, -1.0]) - np.array([0.4, -1.2])
    assert_close(pull[:2], -2 * 0.5 * gap / (1 + gap @ gap) ** 2, 1e-12)


def test_networks_act():
    """Of two equal ones with other weights, each turns its own body."""
    bodies = [rj.RigidBody(name, 1.0, 0.1, angle=0.3) for name in ("first", "second")]
    weights = np.array([0.7, -1.2])
    effects = [
        Learned(body.at(), rj.ground.at(), Network(jnp.asarray(weight), jnp.tanh))
        for body, weight in zip(bodies, weights, strict=True)
    ]
    scene = rj.Scene(bodies, [], effects)
    system = rj.assemble(scene)
    assert len(system.effects) == 1
    assert_close(np.asarray(start_force(system))[[2, 5]], np.tanh(0.3 * weights), 1e-12)
    assert len(outlines(scene, 0.0, np.asarray(system.q0)[None])) >= 2


def test_they_are_drawn(scene, motion, basis):
    _, run = motion
    drawn = outlines(scene, np.asarray(run.t), np.asarray(run.q))
    assert {"belt"} <= {outline.part for outline in drawn}
    assert all(np.all(np.isfinite(outline.points)) for outline in drawn)
    figure = plot.modes(scene, basis)
    assert figure.get_suptitle() == "velocity POD modes"


def test_the_run_is_saved(motion, tmp_path):
    """As comma-separated columns, and as a pickle that compares equal."""
    _, run = motion
    path = tmp_path / "run.csv"
    path.write_text(_csv(run, with_multipliers=True))
    columns = np.loadtxt(path, delimiter=",", skiprows=1)
    parts = [np.asarray(x) for x in (run.t, run.q, run.v, run.multipliers)]
    wanted = np.concatenate([parts[0][:, None], *parts[1:]], axis=1)
    assert_close(columns, wanted, 1e-15, 1 + np.abs(wanted))
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.q, run.q)
    assert (again.summary(), again.labels) == (run.summary(), run.labels)


@pytest.mark.parametrize("formulation", in_groups(RANKS, slow=["minimal"]))
def test_the_scene_is_reduced(motion, formulation):
    system, run = motion
    rom = rj.reduce(system, VelocityPOD(RANKS[formulation])(run), formulation)
    assert (rom.n, rom.degrees_of_freedom) == (RANKS[formulation], 2)
    approx = zoo.run(rom, run.t)
    error = float(rj.compare(run, approx).error)
    assert error <= 10 * SOLVED, f"{formulation}: {error:.1e}"
