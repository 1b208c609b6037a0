"""Robots of files move as by MuJoCo: ours, and random trees and loops that a generator writes."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from groups import in_groups
from programs import kept
from robot_files import (
    GALLERY,
    ROBOTS,
    accelerations,
    close_exactly,
    hold,
    loop,
    state,
    tree,
    with_states,
)
from scipy.integrate import solve_ivp
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import run

import romjax as rj
from romjax.assembly.counting import with_counter_starts
from romjax.linalg import quaternions

mujoco = pytest.importorskip("mujoco")

# Required: of accelerations, relative to the largest.
ALIKE = 1e-10
STATES = 100
# How far from the file's: hinges of one body are told apart up to 87 degrees, and loops close near.
FAR, NEAR = 0.3, 0.1
FILES = [
    *ROBOTS,
    *(f"tree of {count}" for count in (2, 3, 4, 6, 9, 16, 26, 40)),
    *(f"loop of {count}" for count in (5, 8, 12, 20, 30)),
]
# A branched tree and three kinds of loops, one of a file that says which joint follows another.
SLOW = ["tree of 4", "leg.xml", "delta.xml", "stewart.xml", "gripper.urdf"]


def written(folder: Path, name: str) -> Path:
    """The file of a name: of the gallery, or one that the generator writes."""
    if name in ROBOTS:
        return GALLERY / name
    kind, count = name.split(" of ")
    path = folder / "robot.xml"
    path.write_text({"tree": tree, "loop": loop}[kind](int(count), seed=int(count)))
    return path


@kept
def computed(system, q, v, with_rates):
    """In several states: violations of the rows, their second derivatives relative to the terms
    that these are sums of where asked for, and the coordinates with their accelerations.
    """

    def one(q, v):
        there = eqx.tree_at(lambda s: (s.q0, s.v0), system, (q, v))
        there = with_counter_starts(there) if system.structure.counters else there

        def constraint(q):
            return there.constraint(0.0, q)

        def rate(q, v):
            return jax.jvp(constraint, (q,), (v,))[1]

        q, v = there.q0, there.v0
        a, _ = there.acceleration(0.0, q, v)
        if not with_rates:
            return constraint(q), jnp.zeros(0), q, v, a
        along, turning = rate(q, a), jax.jvp(lambda q: rate(q, v), (q,), (v,))[1]
        size = 1 + jnp.max(jnp.abs(turning)) + jnp.max(jnp.abs(a))
        return constraint(q), (along + turning) / size, q, v, a

    return jax.vmap(one)(q, v)


def compare_with_mujoco(path: Path, spread: float) -> None:
    """In random states of MuJoCo's all rows hold, their derivatives too, and all bodies accelerate
    as there: loops as by Lagrange's multipliers on MuJoCo's matrices, since its own yield.
    """
    scene, model = rj.load_scene(path), mujoco.MjModel.from_xml_path(str(path))
    system, random, found = rj.assemble(scene), np.random.default_rng(1), []
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, rest = mujoco.MjData(model), np.zeros(system.n - 7 * len(scene.bodies))
    while len(found) < STATES:
        hold(model, data, random, spread)
        if not within(model, data):
            continue
        if model.neq:
            close_exactly(model, data)
        q, v = (np.concatenate([x, rest]) for x in state(scene, model, data))
        found.append((q, v, accelerations(scene, model, data)))
    q, v, expected = (np.stack(x) for x in zip(*found, strict=True))
    violation, second, q, v, rates = (
        np.asarray(x) for x in computed(system, q, v, bool(model.neq))
    )
    assert np.max(np.abs(violation)) < IDENTITY
    assert np.max(np.abs(second), initial=0.0) < ALIKE
    alike = DIFFERENCED if model.neq else ALIKE
    for states, known in zip(np.stack([q, v, rates], axis=1), expected, strict=True):
        own = [of_body(*states[:, 7 * i : 7 * i + 7]) for i in range(len(known))]
        assert np.max(np.abs(own - known)) < alike * np.max(np.abs(known))


def within(model, data) -> bool:
    """Whether no joint is at its stops, which yield there."""
    limited, ends = model.jnt_limited.astype(bool), model.jnt_range
    at = data.qpos[model.jnt_qposadr]
    return bool(np.all(((at > ends[:, 0]) & (at < ends[:, 1]))[limited]))


def of_body(q, v, rates):
    """The acceleration of a centre of mass, and the angular one: of the quaternion p of unit length
    ω' = 2 E p'' − 4 (p·p') E p'.
    """
    p, speed, rate = q[3:], v[3:], rates[3:]
    turning = 2 * quaternions.apply(quaternions.space_matrix(p), rate - 2 * (p @ speed) * speed)
    return np.concatenate([rates[:3], turning])


@pytest.mark.parametrize("name", in_groups(FILES, fast=["tree of 2"], slow=SLOW))
def test_files_move_as_by_mujoco(name, tmp_path):
    compare_with_mujoco(written(tmp_path, name), FAR if name.startswith("tree") else NEAR)


@pytest.mark.slow
def test_soft_loops_of_mujoco_come_near_as_they_stiffen():
    """A palletizer that falls: the parallelogram, exact here, yields less and less there."""
    ends = np.linspace(0.0, 0.2, 3)
    scene = rj.load_scene(GALLERY / "parallelogram_arm.xml")
    system = rj.assemble(scene)
    exact = rj.measure(system, run(system, ends, rtol=1e-8), scene.bodies[2].at("tip"))
    text = (GALLERY / "parallelogram_arm.xml").read_text()
    apart = []
    for time in (0.02, 0.01, 0.005):
        soft = text.replace("<connect ", f'<connect solref="{time} 1" ')
        model = mujoco.MjModel.from_xml_string(soft)
        model.opt.timestep, model.opt.integrator = 2e-4, mujoco.mjtIntegrator.mjINT_RK4
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, round(ends[-1] / model.opt.timestep))
        mujoco.mj_forward(model, data)
        apart.append(np.linalg.norm(data.site("tip").xpos - exact.position[-1]))
    # Nearly as the square of the time that a loop takes to close.
    assert apart[0] > 2 * apart[1] > 4 * apart[2]
    assert apart[2] < 1e-3 * np.linalg.norm(exact.position[-1] - exact.position[0])


@pytest.mark.slow
def test_actuators_with_a_state_move_as_by_mujoco(tmp_path):
    """A filter, a servo for the speed and a cylinder as there; an integrator that stops at a limit,
    where MuJoCo's steps are of first order, by the equation of its hinge.
    """
    path = tmp_path / "robot.xml"
    path.write_text(with_states())
    ends, scene = np.array([0.0, 0.3, 0.6]), rj.load_scene(path, start="k")
    system = rj.assemble(scene)
    swung = run(system, ends)
    turns = [np.asarray(rj.measure(system, swung, x.at()).rotation[-1]) for x in scene.bodies]
    angles = np.array([np.arctan2(r[0, 2], r[0, 0]) for r in turns])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, round(ends[-1] / model.opt.timestep))
    alike = [0, 3, 4]
    np.testing.assert_allclose(angles[alike], data.qpos[alike], atol=DIFFERENCED)
    states = [swung[f"actuator{i}.activation"][-1] for i in alike]
    np.testing.assert_allclose(states, data.act[alike], atol=DIFFERENCED)
    filtered = 0.5 * (1 - np.exp(-ends[-1] / 0.1))
    np.testing.assert_allclose(swung["actuator2.activation"][-1], filtered, atol=SOLVED)

    def turning(t, y):
        torque = 4 * min(2 * t - 0.2, 0.4) - 0.3 * y[1] + 9.81 * 0.3 * np.cos(y[0])
        return y[1], torque / (0.3**2 + 0.4 * 0.1**2)

    reached = np.zeros(2)
    for piece in (ends[:2], ends[1:]):
        reached = solve_ivp(turning, piece, reached, rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(angles[1], reached[0], atol=SOLVED)
