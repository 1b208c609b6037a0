"""Kinds of ports of a mesh: rigid ones, means of their nodes, and points."""

import jax
import jax.numpy as jnp
import meshes
import numpy as np
import pytest
import scipy.linalg
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax import spatial
from romjax.scene.effect.base import AbstractEffect
from romjax.scene.joint.base import AbstractJoint
from romjax.scene.marker import Pose, Twist

# Condition of the eigenproblem: what rounding leaves of the frequency of a natural mode.
CONDITIONED = 1e-8


def plate():
    return rj.ModalBody, *meshes.plate(0.5, 0.2, 4, 2, modulus=2e8)


def brick():
    return spatial.ModalBody, *meshes.brick((0.5, 0.1, 0.08), (3, 1, 1), modulus=2e8)


def edge(nodes, side):
    """The nodes of an end along x."""
    along = side * nodes[:, 0]
    return np.flatnonzero(along > along.max() - 1e-9)


def body(make, ports, **settings):
    kind, stiffness, mass, nodes, rows = make()
    return kind.of_mesh("part", stiffness, mass, nodes, ports, dofs=rows, **settings)


def sharing(nodes, rows, chosen, size):
    """The forces on some nodes that share unit forces and torques on their mean place."""
    arms = nodes[chosen] - nodes[chosen].mean(axis=0)[None]
    d = nodes.shape[1]
    units = np.eye(3) if d == 3 else np.array([[0.0, 0.0, 1.0]])
    moved = [np.broadcast_to(np.eye(d)[i], arms.shape) for i in range(d)]
    moved += [np.cross(unit, np.pad(arms, ((0, 0), (0, 3 - d))))[:, :d] for unit in units]
    motion = np.zeros((size, len(moved)))
    motion[rows[chosen].ravel()] = np.stack([x.ravel() for x in moved], axis=1)
    return motion @ np.linalg.inv(motion.T @ motion)


@pytest.mark.parametrize("make", [plate, brick])
def test_means_leave_the_frequencies_of_the_free_body(make):
    """Rigid ports stiffen it."""
    _, stiffness, mass, nodes, _ = make()
    d = nodes.shape[1]
    full = scipy.linalg.eigvalsh(stiffness.toarray(), mass.toarray())
    wanted = np.sqrt(full[3 * d - 3 :][:4])
    ends = {"start": edge(nodes, -1), "end": edge(nodes, 1)}
    means = {name: {"mean": chosen} for name, chosen in ends.items()}
    for interface in ("fixed", "free"):
        found = body(make, means, modes=4, interface=interface).natural_frequencies()
        assert_close(found[:4], wanted, CONDITIONED, wanted)
    stiff = body(make, ends, modes=4, interface="free").natural_frequencies()
    assert np.all(stiff[:4] > wanted * (1 + 1e-4))
    same = body(make, {name: {"rigid": x} for name, x in ends.items()}, modes=4, interface="free")
    assert np.all(same.natural_frequencies() == stiff)


@pytest.mark.parametrize("make", [plate, brick])
def test_loads_on_means_of_a_free_body_are_exact(make):
    """The work of loads in balance, on two ends: as by all of the mesh."""
    _, stiffness, _, nodes, rows = make()
    ends = [edge(nodes, side) for side in (-1, 1)]
    part = body(make, {f"end {i}": {"mean": x} for i, x in enumerate(ends)}, modes=2)
    shares = np.hstack([sharing(nodes, rows, chosen, rows.size) for chosen in ends])
    shapes = np.concatenate(np.asarray(part.shapes[:2]))
    rigid = scipy.linalg.null_space(stiffness.toarray(), rcond=1e-10)
    balanced = scipy.linalg.null_space(rigid.T @ shares)
    loads = shares @ balanced
    wanted = loads.T @ np.linalg.pinv(stiffness.toarray(), rcond=1e-10) @ loads
    bent = balanced.T @ shapes
    found = bent @ (bent / np.asarray(part.stiffness)[None]).T
    assert_close(found, wanted, CONDITIONED, np.max(np.abs(wanted)))


@pytest.mark.parametrize("make", [plate, brick])
@pytest.mark.parametrize("kind", ["mean", "point"])
def test_loads_on_a_held_body_are_exact(make, kind):
    """One end is welded by the rigid motion that holds it; a mean or a point at the other."""
    _, stiffness, _, nodes, rows = make()
    start, end = edge(nodes, -1), edge(nodes, 1)
    d = nodes.shape[1]
    ports = {"start": start, "end": {kind: end if kind == "mean" else end[0]}}
    part = body(make, ports, modes=2)
    assert part.unturned == (() if kind == "mean" else ("end",))
    free = np.setdiff1d(np.arange(rows.size), rows[start])
    loads = np.eye(rows.size)[:, rows[end[0]]]
    if kind == "mean":
        loads = sharing(nodes, rows, end, rows.size)
    inner = stiffness.toarray()[np.ix_(free, free)]
    wanted = loads[free].T @ np.linalg.solve(inner, loads[free])
    # Modes and rigid motion that leave the start where it is.
    turns = np.eye(3) if d == 3 else np.eye(3)[2:]
    rigid = np.stack([np.eye(len(turns) + d)] * 2)
    for own, point in zip(rigid, np.asarray(part.points), strict=False):
        own[:d, d:] = np.cross(turns, np.pad(point, (0, 3 - d))[None]).T[:d]
    moved = np.concatenate([rigid, np.asarray(part.shapes)[:2]], axis=2)
    held = scipy.linalg.null_space(moved[0])
    energy = np.diag(np.concatenate([np.zeros(d + len(turns)), part.stiffness]))
    tip = moved[1][: loads.shape[1]] @ held
    found = tip @ np.linalg.solve(held.T @ energy @ held, tip.T)
    assert_close(found, wanted, CONDITIONED, np.max(np.abs(wanted)))


def test_a_point_of_nodes_with_rotations_turns():
    stiffness, mass, nodes = meshes.beam(6, 1.3, 0.7, 1e5, 3.0)
    bodies = [
        rj.ModalBody.of_mesh("b", stiffness, mass, nodes, {"end": port}, modes=3)
        for port in (6, {"point": 6})
    ]
    assert bodies[1].unturned == ()
    for one, other in zip(*(jax.tree.leaves(b) for b in bodies), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("ports", "words"),
    [
        ({"tip": {"glue": [0, 1]}}, "port 'tip' is {'glue'.*kinds are rigid, mean, point"),
        ({"tip": {"mean": 0, "point": 1}}, "port 'tip' is .*kinds are"),
        ({"tip": {"point": [0, 1]}}, "'tip' is a point of 2 nodes; give one"),
        ({"tip": {"mean": 0}}, "'tip' is one point of displacements alone.*an edge"),
        ({"tip": 0}, "'tip' is one point of a mesh without rotations.*make it a 'point'"),
        ({"tip": {"mean": 99}}, "'tip' has the nodes.*99"),
    ],
)
def test_wrong_ports_are_refused(ports, words):
    with pytest.raises(rj.SceneError, match=words):
        body(plate, ports, modes=1)


def test_points_take_positions_only():
    """A hinge, a spring and a force, but no weld, and no torque."""
    nodes = plate()[3]
    tip = edge(nodes, 1)[0]
    part = body(plate, {"start": edge(nodes, -1), "tip": {"point": tip}}, modes=1)
    marker, fixed = part.at("tip"), rj.ground.at(tuple(nodes[tip]))
    taken = rj.Revolute(marker, fixed), rj.PointOnLine(marker, fixed)
    pulled = rj.Spring(marker, fixed, 1.0), rj.Force(marker, (1.0, 0.0), rj.Constant(1.0))
    rj.Scene([part], taken, pulled).check()
    refused = "port 'tip', a point whose rotation.*make the port 'mean' or 'rigid'"
    for joints, effects in (
        ([rj.Weld(marker, fixed)], []),
        ([rj.PointOnLine(fixed, marker)], []),
        ([], [rj.Torque(marker, rj.Constant(1.0))]),
        ([], [rj.Force(marker, (1.0, 0.0), rj.Constant(1.0), frame="body")]),
    ):
        with pytest.raises(rj.SceneError, match=refused):
            rj.Scene([part], joints, effects).check()


def test_ports_at_one_place_that_move_apart_are_refused():
    """The rim of a plate and its middle."""
    nodes = plate()[3]
    rim = np.flatnonzero(np.any(abs(nodes) > np.array([[0.2499, 0.0999]]), axis=1))
    middle = int(np.argmin(np.sum(nodes**2, axis=1)))
    part = body(plate, {"rim": {"mean": rim}, "middle": {"point": middle}}, modes=1)
    joint = rj.Revolute(part.at("middle"), rj.ground.at())
    with pytest.raises(rj.SceneError, match="where the ports rim, middle are"):
        rj.Scene([part], [joint]).check()


def test_parts_ask_for_positions_where_they_say_so():
    """Turning such a marker changes nothing, and nothing turns it."""
    flat = [rj.ground.at(), rj.RigidBody("b", 1.0, 1.0).at((0.3, 0.1))]
    deep = [rj.ground.at((0.0, 0.0, 0.0)), spatial.RigidBody("b", 1.0, np.eye(3)).at((0.3, 0.1, 0))]
    ball = spatial.Sphere(1.0)
    parts = [
        (rj.Revolute(*flat), 2),
        (rj.Distance(*flat, 1.0), 2),
        (rj.PointOnLine(*flat), 2),
        (rj.PointOnCurve(*flat, rj.Circle(1.0)), 2),
        (rj.PrescribedTravel(*flat, rj.Sine(1.0, 1.0)), 2),
        (spatial.Spherical(*deep), 3),
        (spatial.PointOnPlane(*deep), 3),
        (spatial.PointOnCurve(*deep, rj.Circle(1.0)), 3),
        (rj.Distance(*deep, 1.0), 3),
        (rj.PrescribedDistance(*deep, rj.Sine(1.0, 1.0)), 3),
        (rj.PointOnLine(*deep), 3),
        (rj.Spring(*flat, 1.0, 0.1), 2),
        (rj.Damper(*flat, 1.0, along_line=True), 2),
        (rj.Force(flat[1], (1.0, 0.0), rj.Constant(1.0)), 2),
        (rj.Drag(flat[1], 0.5, 0.1), 2),
        (rj.Contact(*flat, rj.Circle(1.0), 1e3, friction=rj.Friction(0.3)), 2),
        (spatial.Contact(*deep, ball, 1e3, friction=rj.Friction(0.3)), 3),
        (rj.JointSpring(*flat, 1.0, 0.1, motion="distance"), 2),
        (rj.JointDamper(*deep, 1.0, motion="distance"), 3),
        (rj.JointStop(*flat, upper=0.01, motion="travel"), 2),
        (rj.Rope(*deep, 0.1, 1.0, dissipation=0.1), 3),
        (rj.Actuator(*deep, rj.Constant(1.0), proportional=2.0, motion="travel"), 3),
        (rj.PID(*flat, rj.Constant(1.0), 2.0, derivative=1.0, motion="travel"), 2),
        (rj.LowPass(*deep, rj.Constant(1.0), 0.1, motion="distance"), 3),
        (rj.HydraulicCylinder(*deep, rj.Constant(1.0), 1.0, 0.5, 0.1, 3.0, 9.0, 0.1, 0.1), 3),
    ]
    rng = np.random.default_rng(3)
    states = [
        [rng.normal(size=(2, *shape)) for shape in ((d,), (1 if d == 2 else 4,), (d,), (d,))]
        for d in (2, 3)
    ]

    def answers(turning):
        told, turned = [], []
        for part, d in parts:
            place, turn, velocity, spin = states[d - 2]
            turns = turn + turning[d - 2] * np.isin(np.arange(2), part.at_points)[:, None]
            poses = [
                Pose(jnp.asarray(x), y[0] if d == 2 else y)
                for x, y in zip(place, turns, strict=True)
            ]
            if isinstance(part, AbstractJoint):
                told.append(part.residual(0.3, *poses))
                continue
            spins = spin[:, 0] if d == 2 else spin
            twists = [Twist(jnp.asarray(x), y) for x, y in zip(velocity, spins, strict=True)]
            some = slice(0, len(part.markers))
            # States of effects come last, as rates.
            own = [twists[0]] * len(part.states)
            motion = [*poses[some], *own], [*twists[some], *own]
            for i, wrench in enumerate(part.wrenches(0.3, *(tuple(x) for x in motion))):
                told.append(wrench.force)
                if i in part.at_points:
                    turned.append(jnp.ravel(wrench.torque))
        return jnp.concatenate(told), jnp.concatenate(turned)

    zero = [np.zeros((2, 1)), np.zeros((2, 4))]
    turns = [rng.normal(size=x.shape) for x in zero]
    told, turned = jax.jit(
        lambda: jax.vmap(answers)([jnp.stack(x) for x in zip(zero, turns, strict=True)])
    )()
    assert_close(told[0], told[1], IDENTITY, np.max(np.abs(told[0])))
    assert not np.any(turned)
    assert {type(part).__name__ for part, _ in parts} == declared()


def declared():
    """The parts of romjax that say so of some markers."""
    found, waiting = set(), [AbstractJoint, AbstractEffect]
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        others = AbstractJoint.at_points, AbstractEffect.at_points
        final = not kind.__name__.startswith("Abstract")
        if kind.__module__.startswith("romjax") and final and kind.at_points not in others:
            found.add(kind.__name__)
    return found


def test_scene_files_have_ports_of_any_kind(tmp_path):
    kind, stiffness, mass, nodes, rows = plate()
    arrays = {"K": stiffness.toarray(), "M": mass.toarray(), "nodes": nodes, "rows": rows}
    start, tip = edge(nodes, -1), int(edge(nodes, 1)[0])
    np.savez(tmp_path / "plate.npz", start=start, **arrays)
    read = "\n".join(
        f'{key} = {{ file = "plate.npz", array = "{array}" }}'
        for key, array in (("stiffness", "K"), ("mass", "M"), ("nodes", "nodes"), ("dofs", "rows"))
    )
    text = f"""
        format = 1
        [bodies.part]
        type = "ModalBody.of_mesh"
        {read}
        modes = 1
        [bodies.part.ports]
        start = {{ mean = {{ file = "plate.npz", array = "start" }} }}
        tip = {{ point = {tip} }}
        [joints]
        pin = {{ type = "Revolute", a = "part.tip", b = "ground" }}
    """
    path = tmp_path / "scene.toml"
    path.write_text(text)
    ports = {"start": {"mean": start}, "tip": {"point": tip}}
    wanted = kind.of_mesh("part", stiffness, mass, nodes, ports, modes=1, dofs=rows)
    scene = rj.load_scene(path)
    scene.save(tmp_path / "again.toml")
    for found in (scene, rj.load_scene(tmp_path / "again.toml")):
        assert found.bodies[0].unturned == ("tip",)
        for one, other in zip(*map(jax.tree.leaves, (found.bodies[0], wanted)), strict=True):
            assert np.array_equal(one, other)
    for old, new, words in (
        ("point =", "glue =", "kinds are rigid, mean, point"),
        ("point =", "point = 1, mean =", r"\[bodies.part\] ports.tip: .*a table of one word"),
        ('"Revolute"', '"Weld"', "port 'tip', a point whose rotation"),
        (f"point = {tip}", "point = true", r"\[bodies.part\] ports.tip.*numbers"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(rj.SceneError, match=words):
            rj.load_scene(path)
