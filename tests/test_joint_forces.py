"""Forces of joints and effects: against Newton and Euler's equations written by hand."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from mechanisms import bar, ends
from tolerances import IDENTITY
from zoo import GRAVITY

import romjax as rj
from romjax.assembly.names import unique
from romjax.measure.states import accelerations
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: forces by hand from the same states differ by this, relative to the largest.
FORCES = 1e-8
TIGHT = {"rtol": 1e-11, "solver": diffrax.Dopri8()}


def assert_forces(found, wanted):
    wanted = np.asarray(wanted)
    assert_close(found, wanted, FORCES, np.max(np.abs(wanted)))


def direction(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def across(vector):
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def swept(angle, rate, second):
    """Second rate of a unit vector that turns."""
    ahead = direction(angle)
    return second[:, None] * across(ahead) - rate[:, None] ** 2 * ahead


def test_double_pendulum():
    """Two uniform bars of 1 m and 1 kg, by the angles of both against the horizontal."""
    system = rj.assemble(rj.gallery.chain(2))
    run = rj.simulate(system, jnp.linspace(0.0, 1.0, 41), **TIGHT)
    angles, rates = (np.stack([run[f"bar1.phi{p}"], run[f"bar2.phi{p}"]], 1) for p in ("", "'"))
    c, s = np.cos(angles[:, 0] - angles[:, 1]), np.sin(angles[:, 0] - angles[:, 1])
    mass = np.moveaxis(np.array([[0 * c + 4 / 3, c / 2], [c / 2, 0 * c + 1 / 3]]), 2, 0)
    weight = GRAVITY * np.cos(angles) * [1.5, 0.5]
    load = np.stack([-s / 2 * rates[:, 1] ** 2, s / 2 * rates[:, 0] ** 2], 1) - weight
    second = np.linalg.solve(mass, load[..., None])[..., 0]
    first, other = (swept(angles[:, i], rates[:, i], second[:, i]) for i in (0, 1))
    up = np.array([0.0, GRAVITY])
    on_second = first + other / 2 + up
    on_first = first / 2 + up + on_second
    found = rj.joint_forces(system, run)
    assert found.keys() == ("Revolute(bar1, ground)", "Revolute(bar2, bar1)")
    assert_forces(found["Revolute(bar2, bar1)"].force, on_second)
    assert_forces(found["Revolute(bar2, bar1)"].on("b").force, -on_second)
    assert_forces(found["Revolute(bar1, ground)"].force, on_first)
    assert_close(found["Revolute(bar1, ground)"].torque, 0, 0)


class DryFriction(rj.AbstractMarkerEffect):
    """Coulomb's friction along x with a constant normal force, smooth at rest."""

    at: rj.Marker
    limit: jax.Array = eqx.field(converter=jnp.asarray)
    creep: jax.Array = eqx.field(converter=jnp.asarray)
    needs_twists = True

    def wrenches(self, t, poses, twists):
        strength = -self.limit * jnp.tanh(twists[0].velocity[0] / self.creep)
        force = jnp.stack([strength, jnp.zeros_like(strength)])
        return (rj.Wrench(force, jnp.zeros_like(strength)),)

    def check(self):
        pass


def test_slider_crank_with_friction():
    """All forces and the acceleration from nine equations of Newton and Euler."""
    r, l, start = 0.5, 1.3, 0.7  # noqa: E741 the usual letters
    pin, end = r * direction(np.array(start)), np.array([0.0, 0.0])
    end[0] = pin[0] + np.sqrt(l**2 - pin[1] ** 2)
    crank, rod = bar("crank", (0, 0), pin, mass=2.0), bar("rod", pin, end, mass=1.5)
    slider = rj.RigidBody("slider", mass=0.8, inertia=0.02, position=end)
    (root, top), (low, far) = ends(crank), ends(rod)
    scene = rj.Scene(
        [crank, rod, slider],
        [
            rj.Revolute(root, rj.ground.at(), name="main"),
            rj.Revolute(low, top, name="big end"),
            rj.Revolute(far, slider.at(), name="small end"),
            rj.Prismatic(slider.at(), rj.ground.at(), name="rail"),
        ],
        [
            rj.Gravity(),
            rj.Torque(crank.at(), rj.Constant(6.0)),
            DryFriction(slider.at(), 1.7, 0.05),
        ],
    )
    system = rj.assemble(scene)
    run = rj.simulate(system, jnp.linspace(0.0, 1.0, 21), **TIGHT)
    found = rj.joint_forces(system, run)
    friction = -1.7 * np.tanh(run["slider.x'"] / 0.05)
    assert_forces(rj.effect_forces(system, run)["DryFriction(slider)"].force[:, 0], friction)

    theta, omega = np.asarray(run["crank.phi"]), np.asarray(run["crank.phi'"])
    beta = np.arcsin(-r * np.sin(theta) / l)
    beta_rate = -r * np.cos(theta) * omega / (l * np.cos(beta))

    def accelerations(alpha):
        """Of the centres of crank, rod and slider, and the angular one of the rod."""
        turned = r * (np.sin(theta) * omega**2 - np.cos(theta) * alpha)
        second = (turned + l * np.sin(beta) * beta_rate**2) / (l * np.cos(beta))
        tip, along = r * swept(theta, omega, alpha), l * swept(beta, beta_rate, second)
        return tip / 2, tip + along / 2, tip + along, second

    still, moving = accelerations(0 * theta), accelerations(0 * theta + 1)
    to_pin, to_end = r * direction(theta) / 2, l * direction(beta) / 2
    for i in range(len(theta)):
        # Unknown: α, forces of main on crank, of big end on rod, of small end on rod, of the rail
        # on the slider, and its torque.
        rows, right = np.zeros((9, 9)), np.zeros(9)
        own = [m * (b[i] - a[i]) for m, a, b in zip((2, 1.5, 0.8), still, moving, strict=False)]
        for k, (mass, force) in enumerate(zip((2.0, 1.5, 0.8), own, strict=True)):
            rows[3 * k : 3 * k + 2, 0] = force
            right[3 * k : 3 * k + 2] = mass * (np.array([0, -GRAVITY]) - still[k][i])
        right[6] += friction[i]
        unit = np.eye(2)
        rows[0:2, 1:3], rows[0:2, 3:5] = -unit, unit
        rows[3:5, 3:5], rows[3:5, 5:7] = -unit, -unit
        rows[6:8, 5:7], rows[7, 7] = unit, -1

        def lever(arm):  # arm × force
            return np.array([-arm[1], arm[0]])

        rows[2, 0], right[2] = 2 * r**2 / 12, 6.0
        rows[2, 1:3], rows[2, 3:5] = lever(to_pin[i]), lever(to_pin[i])
        rows[5, 0] = 1.5 * l**2 / 12 * (moving[3] - still[3])[i]
        right[5] = -1.5 * l**2 / 12 * still[3][i]
        rows[5, 3:5], rows[5, 5:7] = lever(to_end[i]), -lever(to_end[i])
        rows[8, 8] = 1
        solved = np.linalg.solve(rows, right)
        scale = np.max(np.abs(solved))
        for key, part in (("main", 1), ("big end", 3), ("small end", 5)):
            assert_close(found[key].force[i], solved[part : part + 2], FORCES, scale)
        assert_close(found["rail"].force[i], [0, solved[7]], FORCES, scale)
        assert_close(found["rail"].torque[i], solved[8], FORCES, scale)


def test_root_of_a_clamped_beam():
    """Shear and moment of the weld from the modal equations and the momentum of the modes."""
    m, length, stiffness, damping = 1.5, 1.2, 8.0, 0.03
    beam = rj.Beam(
        "beam",
        m,
        length,
        EI=stiffness,
        modes=3,
        shapes="clamped-free",
        damping=damping,
        position=(length / 2, 0),
    )
    push = rj.Force(beam.at((length / 2, 0)), (0, 1), rj.Sine(0.4, 2.0, phase=0.5))
    scene = rj.Scene([beam], [rj.Weld(beam.at((-length / 2, 0)), rj.ground.at())], [push])
    scene = eqx.tree_at(lambda s: s.effects, scene, (push, rj.Gravity()))
    system = rj.assemble(scene)
    run = rj.simulate(system, jnp.linspace(0.0, 0.5, 21), **TIGHT)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    shapes = bending_shapes("clamped-free", 3, (nodes + 1)[:, None] / 2, np)[0] / np.sqrt(m)
    tip = bending_shapes("clamped-free", 3, 1.0, np)[0] / np.sqrt(m)
    share = m * weights / 2
    total, lever = share @ shapes, (share * (nodes + 1) / 2 * length) @ shapes
    force = 0.4 * np.sin(2 * np.pi * 2.0 * np.asarray(run.t) + 0.5)
    frequency = bending_roots("clamped-free", 3) ** 2 * np.sqrt(stiffness / (m * length**3))
    q, v = np.asarray(run.q[:, 3:]), np.asarray(run.v[:, 3:])
    load = force[:, None] * tip - GRAVITY * total
    second = load - frequency**2 * q - 2 * damping * frequency * v
    found = rj.joint_forces(system, run)["Weld(beam, ground)"]
    assert_forces(found.force[:, 1], second @ total + m * GRAVITY - force)
    moment = second @ lever + m * GRAVITY * length / 2 - force * length
    assert_forces(found.torque, moment)


def test_a_drive():
    """The torque and the power that turn a disc as prescribed: J θ̈ and J θ̈ θ̇."""
    disc = rj.RigidBody("disc", 1.0, 0.3)
    drive = rj.PrescribedAngle(disc.at(), rj.ground.at(), rj.Sine(0.5, 1.0), name="drive")
    scene = rj.Scene([disc], [rj.Revolute(disc.at(), rj.ground.at()), drive])
    system = rj.assemble(scene)
    rate = 2 * np.pi
    v0 = jnp.array([0.0, 0.0, 0.5 * rate])
    run = rj.simulate(system, jnp.linspace(0.0, 1.0, 21), v0=v0, **TIGHT)
    found = rj.joint_forces(system, run)
    torque = -0.3 * 0.5 * rate**2 * np.sin(rate * np.asarray(run.t))
    assert_forces(found["drive"].torque, torque)
    power = torque * 0.5 * rate * np.cos(rate * np.asarray(run.t))
    assert_forces(found["drive"].power, power)
    assert_close(found["Revolute(disc, ground)"].power, 0, IDENTITY)


def test_a_drive_does_the_work():
    """Of a slide that is moved on a rail under load: its power is the rate of all energy."""
    slide = rj.RigidBody("slide", 2.0, 0.1)
    bob = rj.RigidBody("bob", 1.0, 0.05, position=(0.0, -0.5))
    scene = rj.Scene(
        [slide, bob],
        [
            rj.Prismatic(slide.at(), rj.ground.at(angle=0.3)),
            rj.Revolute(slide.at(), bob.at((0.0, 0.5))),
            rj.PrescribedTravel(slide.at(), rj.ground.at(angle=0.3), rj.Step(0.4, 0.0, 1.0)),
        ],
        [rj.Gravity()],
    )
    scene = eqx.tree_at(lambda s: s.bodies[0].angle, scene, 0.3)
    system = rj.assemble(scene)
    run = rj.simulate(system, jnp.linspace(0.0, 1.0, 21), **TIGHT)
    mass = jnp.diagonal(system.mass(system.q0))
    rate = (run.v * accelerations(system, run)) @ mass
    rate += GRAVITY * (2.0 * run["slide.y'"] + run["bob.y'"])
    found = rj.joint_forces(system, run)
    assert_forces(found["PrescribedTravel(slide, ground)"].power, rate)


def pinned(copies):
    """A bar on as many equal hinges as asked for."""
    pendulum = bar("bar", (0, 0), (1, 0), mass=2.0)
    hinge = rj.Revolute(ends(pendulum)[0], rj.ground.at(), name="hinge")
    system = rj.assemble(rj.Scene([pendulum], [hinge] * copies, [rj.Gravity()]))
    run = rj.simulate(system, jnp.linspace(0.0, 0.5, 11), **TIGHT)
    return system, run, rj.joint_forces(system, run)


def test_a_joint_made_twice():
    """The forces of both add up to that of one."""
    *_, one = pinned(1)
    *_, two = pinned(2)
    assert two.keys() == ("hinge 1", "hinge 2")
    assert one.keys() == ("hinge",)
    assert_forces(two["hinge 1"].force + two["hinge 2"].force, one["hinge"].force)


def test_keys():
    system, run, one = pinned(1)
    assert "hinge" in one
    assert len(one) == 1
    assert dict(one.items()).keys() == {"hinge"}
    with pytest.raises(rj.InputError, match="no joint 'hing'. Did you mean 'hinge'"):
        one["hing"]
    *_, two = pinned(2)
    with pytest.raises(rj.InputError, match="no joint 'hinge'.*There are: hinge 1, hinge 2"):
        two["hinge"]
    effects = rj.effect_forces(system, run)
    assert len(effects) == 0
    with pytest.raises(rj.InputError, match="no effect 'Gravity'. There are: none"):
        effects["Gravity"]


def test_keys_are_distinct():
    """Even where a joint is named like a numbered key."""
    labels = ["pin", "pin 1", "rail", "pin", "rail 2"]
    assert unique(labels) == ["pin 2", "pin 1", "rail", "pin 3", "rail 2"]
    assert unique(["a", "a", "a 2", "a 2"]) == ["a 1", "a 3", "a 2 1", "a 2 2"]


def test_no_joints():
    disc = rj.RigidBody("disc", 1.0, 1.0)
    system = rj.assemble(rj.Scene([disc], [], [rj.Gravity()]))
    run = rj.simulate(system, jnp.linspace(0.0, 0.1, 3))
    assert list(rj.joint_forces(system, run)) == []
