"""Outlines: every part is drawn, where the dynamics have it."""

import inspect

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from outlined import ENDS, ONE, TWO, ends, scene_of, signs, some
from tolerances import IDENTITY

import romjax as rj
from romjax.assembly.outlines import SIGN, outlines

SWING = rj.Sine(0.3, 2.0, phase=0.4)


class Ellipse(rj.AbstractCurve):
    """A curve that brings no outline of its own."""

    def __call__(self, point):
        return (point[0] / 0.5) ** 2 + (point[1] / 0.3) ** 2 - 1

    def check(self, owner):
        pass


# In one scene, to be drawn by one program; joints of equal kind have names.
PARTS = [
    rj.Distance(*ENDS, length=0.7),
    rj.Coupling(*ENDS, rj.ground.at(), rj.ground.at(), (0.1, 2.0)),
    rj.FixedAngle(*ENDS),
    rj.Gear(*ENDS, ratio=-2.5),
    rj.Gear(*ENDS, ratio=2.5, name="inner gear"),
    rj.KnifeEdge(*ENDS),
    rj.PointOnCurve(*ENDS, rj.Circle(0.5), name="circle"),
    rj.PointOnCurve(*ENDS, rj.Polynomial([0.1, 0.2, -0.3]), name="polynomial"),
    rj.PointOnCurve(*ENDS, Ellipse(), name="ellipse"),
    rj.PointOnLine(*ENDS),
    rj.PrescribedAngle(*ENDS, SWING),
    rj.PrescribedTravel(*ENDS, SWING),
    rj.PrescribedDistance(*ENDS, SWING),
    rj.Prismatic(*ENDS, value=0.1),
    rj.Revolute(*ENDS),
    rj.RollingWheel(*ENDS, rj.Polynomial([-2.0, 0.2, 0.1]), 0.3),
    rj.Weld(*ENDS),
    rj.Actuator(*ENDS, SWING),
    rj.Bushing(*ENDS, [30.0, 50.0, 4.0]),
    rj.Contact(*ENDS, rj.Circle(0.5), stiffness=10.0),
    rj.Damper(*ENDS, damping=0.8),
    rj.Drag(ENDS[0], 0.5, 0.1),
    rj.Force(ENDS[0], (3.0, 4.0), SWING),
    rj.Force(ENDS[0], (3.0, 4.0), SWING, frame="body"),
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
    rj.Torque(ENDS[0], SWING),
]


@pytest.fixture(scope="module")
def scene() -> rj.Scene:
    return scene_of(*PARTS)


@pytest.fixture(scope="module")
def q(scene) -> np.ndarray:
    return some(scene)


# The swing is positive, and negative twice.
TIMES = np.array([0.05, 0.3, 0.3])


@pytest.fixture(scope="module")
def drawn(scene, q) -> dict[str, list]:
    """The outlines of each part."""
    by_part: dict[str, list] = {}
    for outline in signs(scene, q, TIMES):
        by_part.setdefault(outline.part, []).append(outline)
    return by_part


@pytest.fixture(scope="module")
def places(scene, q) -> list[np.ndarray]:
    """Of both markers over time."""
    return ends(scene, PARTS[0], q)


@pytest.fixture(scope="module")
def size(scene, q, places) -> float:
    """What signs are about as large as, from the bodies and markers that the scene is made of."""
    points = [o.points.reshape(-1, 2) for o in outlines(scene, TIMES, q) if o.style == "body"]
    points += places
    return SIGN * np.linalg.norm(np.ptp(np.concatenate(points), axis=0))


@eqx.filter_jit
def residual_and_shapes(system, q, beam):
    return system.constraint(0.0, q), beam.mode_shapes(jnp.array([0.5, 0.0]))


def test_a_hinge_on_a_beam_that_shortens_is_where_its_joint_has_it():
    """The joint's residual is its place, since it is hinged to the origin."""
    beam = rj.Beam("beam", 1.0, 1.0, EI=1.0, modes=2, stiffening=True)
    scene = rj.Scene([beam], [rj.Revolute(beam.at((0.5, 0.0)), rj.ground.at())])
    system = rj.assemble(scene)
    q = np.array([[0.1, 0.2, 0.3, 0.1, 0.05], [0.0, 0.0, 0.0, 0.12, 0.0]])
    found = [residual_and_shapes(system, x, beam) for x in q]
    wanted, shapes = np.array([x for x, _ in found]), np.asarray(found[0][1])
    straight = np.array([0.5, 0.12 * shapes[1, 0]])
    assert wanted[1, 0] < 0.45 < straight[0]
    line, hinge, _ = outlines(scene, 0.0, q)
    np.testing.assert_allclose(hinge.points[:, 0], wanted, rtol=0, atol=IDENTITY)
    np.testing.assert_allclose(line.points[:, -1], wanted, rtol=0, atol=IDENTITY)


@pytest.mark.instant
def test_every_kind_is_tested():
    """A new joint or effect of the package has to be drawn here."""
    kinds = {
        kind
        for kind in vars(rj).values()
        if inspect.isclass(kind)
        and issubclass(kind, rj.AbstractJoint | rj.AbstractMarkerEffect)
        and not kind.__name__.startswith("Abstract")
    }
    assert kinds == {type(part) for part in PARTS}


@pytest.mark.parametrize("part", PARTS, ids=lambda part: type(part).__name__)
def test_every_kind_is_drawn_at_its_markers(part, scene, drawn, places, size):
    assert drawn.keys() == {part.label() for part in PARTS}
    points = np.concatenate([outline.points for outline in drawn[part.label()]], axis=1)
    assert np.all(np.isfinite(points))
    for frame, place in enumerate(places[0]):
        assert np.min(np.linalg.norm(points[frame] - place, axis=1)) <= 1.2 * size


@pytest.mark.parametrize("name", ["Spring(one, two)", "Damper(one, two)"])
def test_springs_and_dampers_reach_from_end_to_end(name, drawn, places):
    points = np.concatenate([outline.points for outline in drawn[name]], axis=1)
    for end in places:
        away = np.min(np.linalg.norm(points - end[:, None], axis=2), axis=1)
        np.testing.assert_allclose(away, 0, atol=IDENTITY)


@eqx.filter_jit
def shapes_at(body, point):
    return body.mode_shapes(point)


def local(q, origin, points):
    """Points in the frame of the second marker, which is at `origin`."""
    marker = ENDS[1]
    slope = q[:, 6:] @ np.asarray(shapes_at(TWO, marker.point))[2]
    angle = q[:, 5] + np.asarray(marker.angle) + slope
    away = points - origin[:, None]
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = away[..., 0], away[..., 1]
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=2)


@eqx.filter_jit
def value_and_slope(curve, places):
    return jax.vmap(jax.value_and_grad(curve))(places)


@pytest.mark.parametrize("name", ["circle", "polynomial", "ellipse"])
def test_curves_are_where_their_residual_is_zero(name, q, drawn, places):
    (curve,) = (part.curve for part in PARTS if part.label() == name)
    (track,) = (outline for outline in drawn[name] if outline.style == "track")
    points = local(q, places[1], track.points).reshape(-1, 2)
    value, slope = map(np.asarray, value_and_slope(curve, points))
    # Newton's last step leaves a distance of the square of the one before it.
    np.testing.assert_allclose(value / np.linalg.norm(slope, axis=1), 0, atol=1e-6)
    assert np.ptp(points, axis=0).min() > 0.1


@pytest.mark.parametrize("kind", ["PointOnLine", "Prismatic"])
def test_rails_cross_the_picture(kind, q, drawn, places):
    (rail,) = (outline for outline in drawn[f"{kind}(one, two)"] if outline.style == "track")
    assert rail.endless
    along, across = np.moveaxis(local(q, places[1], rail.points), 2, 0)
    np.testing.assert_allclose(across, 0, atol=IDENTITY * np.max(np.abs(along)))
    assert np.all(along[:, 0] < -4)
    assert np.all(along[:, 1] > 4)


def test_wheels_of_a_gear_touch(drawn, places):
    wheels = [outline.points for outline in drawn["Gear(one, two)"][:2]]
    radii = [np.linalg.norm(w[:, 1] - w[:, 0], axis=1) for w in wheels]
    np.testing.assert_allclose(radii[1], 2.5 * radii[0], rtol=IDENTITY)
    distance = np.linalg.norm(places[0] - places[1], axis=1)
    np.testing.assert_allclose(sum(radii), distance, rtol=IDENTITY)


def test_loads_point_where_they_act(drawn):
    """A force is drawn along itself, a torque around its marker in its own sense."""
    (arrow, _), (turn, *_) = drawn["Force(one)"], drawn["Torque(one)"]
    way = arrow.points[:, 1] - arrow.points[:, 0]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    wanted = [[0.6, 0.8], [-0.6, -0.8], [-0.6, -0.8]]
    np.testing.assert_allclose(way, wanted, atol=IDENTITY)
    first, second = (turn.points[:, k] - np.mean(turn.points[:, :21:20], axis=1) for k in (0, 1))
    sense = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    assert sense[0] > 0 > sense[1]


def test_the_ground_is_hatched_where_parts_hold_to_it():
    hinge = rj.Revolute(ONE.at(), rj.ground.at((0.5, 0.6)))
    rail = rj.PointOnLine(ONE.at(), rj.ground.at((-1.0, 0.0)))
    spring = rj.Spring(TWO.at(), rj.ground.at((0.5, 0.6)), 1.0)
    scene = scene_of(hinge, rail, spring)
    (ground,) = (o for o in outlines(scene, 0.0, some(scene)) if o.style == "ground")
    middle = np.mean(ground.points[:, ::3], axis=1)
    np.testing.assert_allclose(middle, [[0.5, 0.6]] * 3, atol=IDENTITY)


def test_outline_of_a_turned_rigid_body():
    box = rj.RigidBody("box", mass=1.0, inertia=1.0, extent=(0.4, 0.2))
    q = np.array([[1.0, 2.0, np.pi / 2], [0.0, 0.0, 0.0]])
    (drawn,) = outlines(rj.Scene([box]), 0.0, q)
    turned = [[1.1, 1.8], [1.1, 2.2], [0.9, 2.2], [0.9, 1.8], [1.1, 1.8]]
    np.testing.assert_allclose(drawn.points[0], turned, atol=IDENTITY)
    np.testing.assert_allclose(drawn.points[1, 2], [0.2, 0.1], atol=IDENTITY)


def test_outline_of_a_bent_beam():
    beam = rj.Beam("beam", mass=0.5, length=2.0, frequencies=[5.0, 20.0])
    (drawn,) = outlines(rj.Scene([beam]), 0.0, np.array([[1.0, 2.0, np.pi / 6, 0.05, 0.0]]))
    # Each mode is 2/√m at the lower end and even modes return to it at the other.
    bend = 0.05 * 2 / np.sqrt(0.5)
    cos, sin = np.cos(np.pi / 6), np.sin(np.pi / 6)
    for end, along in ((0, -1.0), (-1, 1.0)):
        place = [1 + cos * along - sin * bend, 2 + sin * along + cos * bend]
        np.testing.assert_allclose(drawn.points[0, end], place, atol=IDENTITY)


def test_gravity_has_no_sign():
    scene = scene_of(rj.Gravity())
    assert not signs(scene, some(scene))


def test_what_outlines_refuse():
    with pytest.raises((rj.SceneError, TypeError), match="style(.|\n)*'dotted'"):
        rj.Outline(jnp.zeros((2, 2)), "dotted")
    with pytest.raises(ValueError, match=r"q has 6 coordinates, but .*\(one, two\) have 8"):
        outlines(scene_of(), 0.0, np.zeros((1, 6)))


def test_coordinates_say_what_they_are():
    """A beam's modes bend, those of a body of any shape are just modes."""
    inertia = rj.Inertia(1.0, 0.1)
    plate = rj.ModalBody("plate", inertia, [4.0], [[0.0, 0.0]], np.zeros((1, 3, 1)))
    structure = rj.assemble(rj.Scene([TWO, plate])).structure
    assert structure.labels == tuple(c.label for c in structure.coordinates)
    named = {c.label: c for c in structure.coordinates}
    assert named["two.q2"].description == "bending mode 2 of two"
    assert named["plate.q1"].description == "mode 1 of plate"
    units = [named[f"plate.{name}"].unit for name in ("x", "y", "phi", "q1")]
    assert units == ["m", "m", "rad", "kg^1/2 m"]
