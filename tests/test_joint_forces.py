"""Forces of joints and effects: against Newton and Euler's equations written by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from at_rest import clamped_beam, hung_twice
from comparison import assert_close
from mechanisms import bar, ends
from motions import through
from tolerances import IDENTITY
from zoo import GRAVITY

import romjax as rj
from romjax.assembly.names import unique
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: forces by hand from the same states differ by this, relative to the largest.
FORCES = 1e-8
# States at random, on the constraints, of each mechanism.
STATES = 11


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


def in_lanes(seed, *sizes):
    """Numbers of order one for some states, and times."""
    random = np.random.default_rng(seed)
    return np.linspace(0.0, 1.0, STATES), *(random.normal(size=(STATES, *size)) for size in sizes)


def swinging(system):
    """Angles and rates of two bars of 1 m, one hung from the other, and the run through them."""
    t, angles, rates = in_lanes(0, (2,), (2,))
    tips = direction(angles)
    moving = rates[..., None] * across(tips)
    tips, moving = (np.stack([x[:, 0] / 2, x[:, 0] + x[:, 1] / 2], 1) for x in (tips, moving))
    q = np.concatenate([tips, angles[..., None]], axis=2).reshape(STATES, 6)
    v = np.concatenate([moving, rates[..., None]], axis=2).reshape(STATES, 6)
    return angles, rates, through(system, t, q, v)


def test_double_pendulum():
    """Two uniform bars of 1 m and 1 kg, by the angles of both against the horizontal."""
    system = zoo.system(zoo.bars)
    angles, rates, run = swinging(system)
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
    t, theta, omega = in_lanes(1, (), ())
    beta = np.arcsin(-r * np.sin(theta) / l)
    beta_rate = -r * np.cos(theta) * omega / (l * np.cos(beta))
    tip, along = r * direction(theta), l * direction(beta)
    tip_rate = r * omega[:, None] * across(direction(theta))
    along_rate = l * beta_rate[:, None] * across(direction(beta))
    q = [tip / 2, theta, tip + along / 2, beta, tip + along, 0 * theta]
    v = [tip_rate / 2, omega, tip_rate + along_rate / 2, beta_rate, tip_rate + along_rate, 0 * t]
    run = through(system, t, np.column_stack(q), np.column_stack(v))
    found = rj.joint_forces(system, run)
    friction = -1.7 * np.tanh((tip_rate + along_rate)[:, 0] / 0.05)
    assert_forces(rj.effect_forces(system, run)["DryFriction(slider)"].force[:, 0], friction)

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
    scene = clamped_beam(
        m, length, stiffness, damping, push=0.4, frequency=2.0, phase=0.5, gravity=GRAVITY
    )
    system = rj.assemble(scene)
    t, q, v = in_lanes(2, (3,), (3,))
    q, v = 0.1 * q, 3.0 * v
    still = np.broadcast_to([length / 2, 0.0, 0.0], (STATES, 3))
    run = through(system, t, np.hstack([still, q]), np.hstack([0 * still, v]))
    nodes, weights = np.polynomial.legendre.leggauss(60)
    shapes = bending_shapes("clamped-free", 3, (nodes + 1)[:, None] / 2, np)[0] / np.sqrt(m)
    tip = bending_shapes("clamped-free", 3, 1.0, np)[0] / np.sqrt(m)
    share = m * weights / 2
    total, lever = share @ shapes, (share * (nodes + 1) / 2 * length) @ shapes
    force = 0.4 * np.sin(2 * np.pi * 2.0 * t + 0.5)
    frequency = bending_roots("clamped-free", 3) ** 2 * np.sqrt(stiffness / (m * length**3))
    load = force[:, None] * tip - GRAVITY * total
    second = load - frequency**2 * q - 2 * damping * frequency * v
    found = rj.joint_forces(system, run)["root"]
    assert_forces(found.force[:, 1], second @ total + m * GRAVITY - force)
    moment = second @ lever + m * GRAVITY * length / 2 - force * length
    assert_forces(found.torque, moment)


TILT = 0.3


def test_drives():
    """The torque and the power that turn a disc as prescribed, J θ̈ and J θ̈ θ̇; and the force that
    pushes the pivot of a pendulum along a rail, beside the weight and the inertia of both.
    """
    disc = rj.RigidBody("disc", 1.0, 0.3)
    slide = rj.RigidBody("slide", 2.0, 0.1, angle=TILT)
    bob = rj.RigidBody("bob", 1.0, 0.05, position=(0.0, -0.5))
    rail, signal = rj.ground.at(angle=TILT), rj.Sine(0.5, 1.0)
    scene = rj.Scene(
        [disc, slide, bob],
        [
            rj.Revolute(disc.at(), rj.ground.at()),
            rj.PrescribedAngle(disc.at(), rj.ground.at(), signal, name="drive"),
            rj.Prismatic(slide.at(), rail),
            rj.Revolute(slide.at(), bob.at((0.0, 0.5))),
            rj.PrescribedTravel(slide.at(), rail, signal),
        ],
        [rj.Gravity()],
    )
    system = rj.assemble(scene)
    t, angle, rate = in_lanes(3, (), ())
    w, none, along = 2 * np.pi, 0 * t, direction(np.array(TILT))
    place, speed, second = 0.5 * np.sin(w * t), 0.5 * w * np.cos(w * t), -0.5 * w**2 * np.sin(w * t)
    down = direction(angle - np.pi / 2)
    pivot, moving = place[:, None] * along, speed[:, None] * along
    swinging = moving + 0.5 * rate[:, None] * across(down)
    q = np.column_stack([none, none, place, pivot, none + TILT, pivot + 0.5 * down, angle])
    v = np.column_stack([none, none, speed, moving, none, swinging, rate])
    run = through(system, t, q, v)
    found = rj.joint_forces(system, run)
    assert_forces(found["drive"].torque, 0.3 * second)
    assert_forces(found["drive"].power, 0.3 * second * speed)
    assert_close(found["Revolute(disc, ground)"].power, 0, IDENTITY)
    # About the pivot: (J + m l²) φ̈ = l d⊥ · m (g − s̈ e).
    load = np.array([0.0, -GRAVITY]) - second[:, None] * along
    turning = np.sum(0.5 * across(down) * load, axis=1) / (0.05 + 0.25)
    inner = 0.5 * (turning[:, None] * across(down) - rate[:, None] ** 2 * down)
    push = (inner - 3.0 * load) @ along
    force = found["PrescribedTravel(slide, ground)"].force
    assert_forces(force, push[:, None] * along)
    assert_forces(found["PrescribedTravel(slide, ground)"].power, push * speed)


def test_a_joint_made_twice():
    """The forces of both add up to that of one; each has a key."""
    system, twice = zoo.system(zoo.bars), hung_twice()
    *_, run = swinging(system)
    one, two = rj.joint_forces(system, run), rj.joint_forces(twice, run)
    label, other = "Revolute(bar1, ground)", "Revolute(bar2, bar1)"
    assert one.keys() == (label, other)
    assert sorted(two.keys()) == [f"{label} 1", f"{label} 2", other]
    sum_of_both = np.asarray(two[f"{label} 1"].force) + np.asarray(two[f"{label} 2"].force)
    assert_forces(sum_of_both, one[label].force)
    assert label in one
    assert len(one) == 2
    assert dict(one.items()).keys() == {label, other}
    assert len(list(one.values())) == 2
    with pytest.raises(rj.InputError, match=r"no joint 'Revolute\(bar1\)'. Did you mean 'Revolute"):
        one["Revolute(bar1)"]
    with pytest.raises(rj.InputError, match="no joint 'Revolute.*There are: Revolute.* 1, Revo"):
        two[label]
    effects = rj.effect_forces(system, run)
    assert len(effects) == 0
    with pytest.raises(rj.InputError, match="no effect 'Gravity'. There are: none"):
        effects["Gravity"]


@pytest.mark.instant
def test_keys_are_distinct():
    """Even where a joint is named like a numbered key."""
    labels = ["pin", "pin 1", "rail", "pin", "rail 2"]
    assert unique(labels) == ["pin 2", "pin 1", "rail", "pin 3", "rail 2"]
    assert unique(["a", "a", "a 2", "a 2"]) == ["a 1", "a 3", "a 2 1", "a 2 2"]


def test_no_joints():
    system = rj.assemble(rj.Scene([rj.RigidBody("disc", 1.0, 1.0)], [], [rj.Gravity()]))
    assert list(rj.joint_forces(system, through(system))) == []
