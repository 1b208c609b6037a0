"""Outlines in space: every part is drawn where the dynamics have it, and pictures project it."""

import inspect

import jax
import numpy as np
import pytest
from tolerances import IDENTITY

import romjax as rj
from romjax import plot
from romjax.assembly.outlines import outlines
from romjax.linalg import quaternions
from romjax.plot.mechanism import picture_axes, projected
from romjax.scene.drawing import normals

r = rj.spatial

ONE = r.RigidBody("one", 2.0, (0.3, 0.4, 0.5), (0.4, 0.1, -0.2), r.rotation((1, 2, 3), 0.3))
TWO = r.Beam(
    "two", 0.7, 1.1, (1e-3, 0.08, 0.08), EI=4.0, bending=1, position=(1.1, -0.2, 0.3),
    orientation=np.array([0.9, 0.3, -0.1, 0.3]),
)  # fmt: skip
ENDS = ONE.at((0.2, 0.1, 0.3), axis=(1, 1, 0)), TWO.at((-0.1, 0.0, 0.0), axis=(0, 1, 1))
GROUND = rj.ground.at((0.0, 0.0, 0.0))
SWING = rj.Sine(0.3, 2.0, phase=0.4)

# In one scene, to be drawn by one program.
PARTS = [
    r.ConstantVelocity(*ENDS),
    r.Cylindrical(*ENDS),
    r.Gear(*ENDS, GROUND, GROUND, ratio=-2.5),
    r.Planar(*ENDS),
    r.PointOnCurve(*ENDS, r.Helix(0.3, 0.5)),
    r.PointOnCurve(*ENDS, rj.Circle(0.4)),
    r.PointOnPlane(*ENDS),
    r.Prismatic(*ENDS),
    r.Revolute(*ENDS),
    r.Screw(*ENDS, pitch=0.1),
    r.RollingBall(*ENDS, 0.3),
    r.RollingDisc(*ENDS, 0.3),
    r.Spherical(*ENDS),
    r.Universal(*ENDS),
    r.Weld(*ENDS),
    r.Bushing(*ENDS, [3.0, 5.0, 4.0, 1.0, 1.0, 1.0]),
    r.Contact(*ENDS, r.Plane(), 10.0),
    r.Contact(*ENDS, r.Cylinder(0.3), 10.0),
    r.Contact(*ENDS, r.Sphere(0.3), 10.0),
    r.Contact(*ENDS, r.Capsule(0.3, 0.5), 10.0),
    r.Torque(ENDS[0], (0.0, 3.0, 4.0), SWING),
    r.JointInertia(*ENDS, 0.1),
    r.ParallelAxes(*ENDS),
    r.RightAngle(*ENDS),
    r.Untwisted(*ENDS),
    rj.Actuator(*ENDS, SWING),
    rj.Coupling(*ENDS, GROUND, GROUND, (0.1, 2.0)),
    rj.Distance(*ENDS, length=0.7),
    rj.FixedAngle(*ENDS),
    rj.PointOnLine(*ENDS),
    rj.PrescribedAngle(*ENDS, SWING),
    rj.PrescribedTravel(*ENDS, SWING),
    rj.PrescribedDistance(*ENDS, SWING),
    rj.Damper(*ENDS, damping=0.8),
    rj.Drag(ENDS[0], 0.5, 0.1),
    rj.Force(ENDS[0], (0.0, 3.0, 4.0), SWING),
    rj.HydraulicCylinder(*ENDS, SWING, 1.0, 0.5, 0.1, 3.0, 9.0, 0.1, 0.1),
    rj.JointDamper(*ENDS, 0.3, rj.Friction(0.2)),
    rj.JointSpring(*ENDS, 3.0, motion="travel"),
    rj.JointStop(*ENDS, -0.1, 0.1),
    rj.LowPass(*ENDS, SWING, 0.1),
    rj.Motor(*ENDS, SWING, proportional=5.0, derivative=0.4),
    rj.PID(*ENDS, SWING, 1.0),
    rj.Rope(*ENDS, 0.1, 3.0, via=[ENDS[1], ENDS[0]]),
    rj.Spring(*ENDS, stiffness=20.0),
    rj.TorsionDamper(*ENDS, damping=0.8),
    rj.TorsionSpring(*ENDS, stiffness=3.0),
]
FRAMES = 3


@pytest.fixture(scope="module")
def q() -> np.ndarray:
    """Configurations around the start; joints need not hold."""
    start = np.concatenate([np.asarray(body.start()[0]) for body in (ONE, TWO)])
    return start + 0.1 * np.random.default_rng(4).normal(size=(FRAMES, len(start)))


@pytest.fixture(scope="module")
def drawn(q) -> dict[str, list]:
    """The outlines of each part, and the marks of `places`."""
    # Equal ones but for their curve or surface have one label.
    joints = [part for part in PARTS if isinstance(part, rj.AbstractJoint)]
    effects = [part for part in PARTS if part not in joints]
    scene = rj.Scene((ONE, TWO), joints, effects)
    found = outlines(scene, 0.3, q, [ENDS[0], ENDS[1]])
    by_part: dict[str, list] = {}
    for outline in found:
        by_part.setdefault(outline.part, []).append(outline)
    return by_part


def place(drawn, marker) -> np.ndarray:
    (trace,) = (o for o in drawn[marker.body] if o.style == "trace")
    return trace.points[:, 0]


@pytest.mark.instant
def test_every_kind_is_tested():
    """A new joint or effect in space has to be drawn here."""
    kinds = {
        kind
        for kind in (*vars(rj).values(), *vars(r).values())
        if inspect.isclass(kind)
        and issubclass(kind, rj.AbstractJoint | rj.AbstractMarkerEffect)
        and not kind.__name__.startswith("Abstract")
        and 3 in kind.dimensions
    }
    assert kinds == {type(part) for part in PARTS}


@pytest.mark.parametrize("part", PARTS, ids=lambda part: type(part).__name__)
def test_every_kind_is_drawn_at_its_markers(part, drawn):
    own = drawn[part.label()]
    points = np.concatenate([outline.points for outline in own], axis=1)
    assert points.shape[2] == 3
    assert np.all(np.isfinite(points))
    everything = np.concatenate([o.points for o in (*drawn["one"], *drawn["two"])], axis=1)
    near = 0.1 * np.max(np.ptp(everything, axis=(0, 1)))
    away = np.linalg.norm(points - place(drawn, part.markers[0])[:, None], axis=2)
    assert np.all(np.min(away, axis=1) <= near)


def along(points):
    """Directions from the first to the second point, of length one."""
    way = points[:, 1] - points[:, 0]
    return way / np.linalg.norm(way, axis=1, keepdims=True)


def axis_of(q, marker) -> np.ndarray:
    """The z axis of a marker on the rigid body."""
    frame, local = quaternions.matrix(q[:, 3:7]), quaternions.matrix(np.asarray(marker.turn))
    return frame @ local[:, 2]


def test_axes_of_hinges_are_drawn_along_them(drawn, q):
    """The hinge's axis is that of its second marker; the cross of a universal joint has both."""
    lines = [o for o in drawn["Universal(one, two)"] if o.style == "link"]
    hinge = next(o for o in drawn["Revolute(one, two)"] if o.style == "link")
    np.testing.assert_allclose(along(lines[0].points), axis_of(q, ENDS[0]), atol=IDENTITY)
    np.testing.assert_allclose(lines[1].points, hinge.points, atol=IDENTITY)
    middle = np.mean(hinge.points, axis=1)
    np.testing.assert_allclose(middle, place(drawn, ENDS[1]), atol=IDENTITY)


def test_loads_point_where_they_act(drawn):
    """Sin(2 · 2π · 0.3 + 0.4) is negative: against (0, 3, 4)."""
    wanted = np.tile([0.0, -0.6, -0.8], (FRAMES, 1))
    (force,) = drawn["Force(one)"]
    np.testing.assert_allclose(along(force.points), wanted, atol=IDENTITY)
    turn, axis = drawn["Torque(one)"]
    np.testing.assert_allclose(along(axis.points), wanted, atol=IDENTITY)
    around = np.cross(*(turn.points[:, k] - axis.points[:, 0] for k in (0, 5)))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    np.testing.assert_allclose(around, wanted, atol=IDENTITY)


@pytest.mark.parametrize("name", ["Spring(one, two)", "Damper(one, two)"])
def test_springs_and_dampers_reach_from_end_to_end(name, drawn):
    points = np.concatenate([o.points for o in drawn[name]], axis=1)
    for marker in ENDS:
        away = np.linalg.norm(points - place(drawn, marker)[:, None], axis=2)
        np.testing.assert_allclose(np.min(away, axis=1), 0, atol=IDENTITY)


def test_a_coil_is_one_from_all_sides(drawn):
    """Across its line it is as wide in every direction."""
    (coil,) = drawn["Spring(one, two)"]
    inner = coil.points[0, 2:-2] - np.mean(coil.points[0, 2:-2], axis=0)
    _, spread, _ = np.linalg.svd(inner)
    assert spread[2] > 0.7 * spread[1] > 0


def test_normals_are_orthonormal_and_right_handed():
    """Also along the axes, where most lines are, and nearly against the oblique one."""
    given = np.concatenate([np.eye(3), -np.eye(3), [[2, 3, 6]], [[-2, -3, -6.3]]])
    given = given / np.linalg.norm(given, axis=1, keepdims=True)
    for axis, found in zip(given, np.asarray(jax.jit(jax.vmap(normals))(given)), strict=True):
        frame = np.stack([axis, *found])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(frame) > 0


def test_a_curve_in_space_is_where_its_residual_is_zero(drawn):
    track = next(o for o in drawn["PointOnCurve(one, two)"] if o.endless)
    # The helix 0.3, 0.5 is at one distance from its axis, which is the marker's z axis.
    hinge = next(o for o in drawn["Revolute(one, two)"] if o.style == "link")
    z = along(hinge.points)[:, None]
    arm = track.points - place(drawn, ENDS[1])[:, None]
    across = np.linalg.norm(arm - np.sum(arm * z, axis=2, keepdims=True) * z, axis=2)
    np.testing.assert_allclose(across, 0.3, atol=1e-6)


# Pictures.


@pytest.mark.instant
def test_views_are_as_cameras_see():
    """From azimuth 0 one looks against x, with y to the right and z up; from above along −z."""
    np.testing.assert_allclose(picture_axes((0.0, 0.0)), [[0, 1, 0], [0, 0, 1]], atol=IDENTITY)
    above = picture_axes((-np.pi / 2, np.pi / 2))
    np.testing.assert_allclose(above, [[1, 0, 0], [0, 1, 0]], atol=IDENTITY)


def test_shapes_of_modes_are_seen_from_the_side(q):
    scene = rj.Scene([TWO])
    basis = rj.Basis.from_modes(np.eye(9)[:, 7:], q[0, 7:])
    figure = plot.modes(scene, basis, view=(0.3, 0.2))
    drawn = [line.get_xydata() for line in figure.axes[0].lines]
    (beam,) = projected(outlines(scene, 0.0, q[:1, 7:]), (0.3, 0.2))
    assert any(np.allclose(x[:-1], beam.points[0], atol=1e-9) for x in drawn if len(x) == 22)
