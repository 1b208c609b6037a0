"""Scene files: what is written is read again to the bit, parts of one's own and parameters too."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp
from comparison import assert_close
from groups import in_groups
from jaxtyping import Array, Float
from meshes import beam
from random_scenes import random_scene
from scene_files import SPACE, assert_same, bits
from scipy.spatial.transform import Rotation
from test_types import PARTS
from tolerances import IDENTITY

import romjax as rj
from romjax.files.write import text_of

SEEDS = 12  # random scenes that are written and read; hundreds have been tried


def through_a_file(scene, folder):
    scene.save(folder / "scene.toml")
    return rj.load_scene(folder / "scene.toml")


# There and back.


@pytest.mark.parametrize("seed", in_groups(range(SEEDS), fast=range(4)))
def test_random_scenes_are_read_as_they_were_written(seed, tmp_path):
    scene = random_scene(seed)
    assert_same(through_a_file(scene, tmp_path), scene)


def test_every_part_is_read_as_it_was_written(tmp_path):
    """Those of typed_parts.py: all that romjax exports, and a joint of one's own; but for a
    controller with a clock, since no file holds a function.
    """
    # Up to the reduced systems that its last lines compute.
    text = PARTS.read_text().partition("\n# Stabilisations, decompositions")[0]
    parts = {}
    exec(compile(text, str(PARTS), "exec"), parts)
    bodies = [parts[name] for name in ("cart", "wheel", "bar", "flat", "plate")]
    others = [parts["slow"], parts["stiff"]]
    for name, body in zip(("slow", "stiff"), others, strict=True):
        object.__setattr__(body, "name", name)
    effects = [part for part in parts["effects"] if not isinstance(part, rj.Sampled)]
    scene = rj.Scene([*bodies, *others], parts["joints"], effects)
    found = through_a_file(scene, tmp_path)
    assert_same(found, scene)
    assert text_of(found) == text_of(scene)


def test_rotations_in_every_way(tmp_path):
    """Of an axis and an angle, of Euler angles and of a matrix, in one program; and back."""
    (tmp_path / "scene.toml").write_text(SPACE)
    scene = jax.jit(rj.load_scene, static_argnums=0)(tmp_path / "scene.toml")
    hinge = scene.joints[0]
    for found, wanted in (
        (scene.bodies[0].orientation, Rotation.from_rotvec([0.0, np.radians(30.0), 0.0])),
        (hinge.a.turn, Rotation.from_euler("ZXZ", [10.0, 20.0, 30.0], degrees=True)),
        (hinge.b.turn, Rotation.from_rotvec([0.0, 0.0, 0.5 * np.pi])),
    ):
        assert_close(found, np.roll(wanted.as_quat(), 1), IDENTITY)
    assert_same(through_a_file(scene, tmp_path), scene)


def test_the_system_is_the_same(tmp_path):
    """With the same structure and numbers, so with the same programs."""
    scene = rj.gallery.cart_pendulum()
    one, other = rj.assemble(scene), rj.assemble(through_a_file(scene, tmp_path))
    assert one.structure == other.structure
    assert_same(other, one)


@pytest.mark.instant
def test_any_name_is_a_name(tmp_path):
    """Dots, quotes, spaces and letters of any alphabet, in bodies, points and joints."""
    names = ["a.b", "a", 'it\'s "it"', "Kolben Ø", "", "a.b"]
    point = {names[1]: (0.1, 0.2), "b": (0.3, 0.0)}
    bodies = [rj.RigidBody(name, 1.0, 1.0, points=point) for name in names[:4]]
    markers = [body.at(name) for body in bodies for name in point]
    joints = [rj.Revolute(m, rj.ground.at(), name=n) for m, n in zip(markers, names, strict=False)]
    assert_same(through_a_file(rj.Scene(bodies, joints), tmp_path), rj.Scene(bodies, joints))


@pytest.mark.instant
@pytest.mark.parametrize("number", [0.1, -0.0, 5e-324, 1.7976931348623157e308, 1 / 3, 1e22])
def test_every_digit_stays(number, tmp_path):
    scene = rj.Scene([rj.RigidBody("a", 1.0, 1.0, position=(number, 0.0))])
    assert_same(through_a_file(scene, tmp_path), scene)


def test_large_arrays_lie_beside_the_file(tmp_path):
    shapes = np.random.default_rng(0).normal(size=(200, 3, 2))
    points = shapes[:, 0]
    body = rj.ModalBody("plate", rj.Inertia(1.0, 1.0), [4.0, 9.0], points, shapes, ports=["rim"])
    scene = rj.Scene([body], [rj.Revolute(body.at("rim"), rj.ground.at())])
    assert_same(through_a_file(scene, tmp_path), scene)
    assert len(list(tmp_path.glob("scene-*.npz"))) == 1
    assert len((tmp_path / "scene.toml").read_text()) < 20_000


class Rope(rj.AbstractPotential):
    """An effect of one's own, with every kind of field."""

    a: rj.Marker
    b: rj.Marker
    lengths: Float[Array, " k"] = eqx.field(converter=jnp.asarray)
    strength: float
    law: rj.AbstractSignal
    knots: int = eqx.field(static=True, default=1)
    loose: bool = eqx.field(static=True, default=False)
    more: tuple[rj.AbstractCurve, ...] = ()

    def energy(self, t, *poses):
        gap = poses[0].position - poses[1].position
        return self.strength * self.law(t) * jnp.sum(self.lengths) * (gap @ gap)

    def check(self):
        pass


class Puck(rj.AbstractBody):
    """A body of one's own."""

    name: str = eqx.field(static=True)
    mass: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    position: Float[Array, "2"] = eqx.field(converter=jnp.asarray)
    angle: Float[Array, ""] = eqx.field(converter=jnp.asarray, metadata={"angle": True})
    modes: int = eqx.field(static=True, default=0)
    constant_mass = True

    def start(self):
        return jnp.append(self.position, self.angle), jnp.zeros(3)

    def mass_matrix(self, q):
        return self.mass * jnp.ones(3)

    def elastic_energy(self, q):
        return jnp.zeros(())

    def first_moment(self, q):
        return self.mass * q[:2]

    def mode_shapes(self, point):
        return jnp.zeros((3, 0))

    def outline(self):
        return jnp.zeros((1, 2))

    def check(self):
        pass


def test_parts_of_ones_own_are_written_and_read(tmp_path):
    puck = Puck("puck", 2.0, (0.1, 0.2), math.radians(30.0))
    curves = (rj.Circle(1.0), rj.Line())
    rope = Rope(
        puck.at(), rj.ground.at(), [1.0, 2.0], 0.5, rj.Constant(2.0), 3, loose=True, more=curves
    )
    scene = rj.Scene([puck], [], [rope])
    assert_same(through_a_file(scene, tmp_path), scene)
    text = (tmp_path / "scene.toml").read_text()
    in_degrees = text.replace(f"angle = {math.radians(30.0)}", "angle_deg = 30.0")
    assert in_degrees != text
    (tmp_path / "scene.toml").write_text(in_degrees)
    assert_same(rj.load_scene(tmp_path / "scene.toml"), scene)


class Whim(rj.AbstractSignal):
    """A signal that no file can hold."""

    law: object

    def __call__(self, t):
        return self.law(t)

    def check(self, owner):
        pass


@pytest.mark.instant
def test_what_no_file_can_hold_is_refused(tmp_path):
    body = rj.RigidBody("a", 1.0, 1.0)
    scene = rj.Scene([body], [], [rj.Torque(body.at(), Whim(jnp.sin))])
    with pytest.raises(rj.SceneError, match="a Whim cannot be written"):
        scene.save(tmp_path / "scene.toml")


# What files say in their own way.


@jax.jit
def violation(system, q):
    return system.constraint(0.0, q)


def test_sections_and_meshes(tmp_path):
    """Class methods of_… are types, and arrays lie in files beside the scene's."""
    stiffness, mass, nodes = beam(6, 1.0, 2.0, 1e5, 10.0)
    np.savez(tmp_path / "rod.npz", nodes=nodes, M=mass.toarray())
    sp.save_npz(tmp_path / "K.npz", sp.csc_matrix(stiffness))
    text = """
        format = 1
        [bodies.rod]
        type = "ModalBody.of_mesh"
        stiffness = { file = "K.npz" }
        mass = { file = "rod.npz", array = "M" }
        nodes = { file = "rod.npz", array = "nodes" }
        ports = { left = 0, right = 6 }
        modes = 2
        [bodies.bar]
        type = "Beam.of_section"
        length = 1.0
        section = { type = "Tube", diameter = 0.02, wall = 0.001 }
        density = 7850
        modulus = 2.1e11
        modes = 1
        damping = 0.01
        [joints]
        pin = { type = "Revolute", a = "rod.left", b = "bar.end" }
    """
    (tmp_path / "scene.toml").write_text(text)
    ports = {"left": 0, "right": 6}
    rod = rj.ModalBody.of_mesh("rod", stiffness, mass, nodes, ports, modes=2)
    tube = rj.sections.Tube(0.02, 0.001)
    bar = rj.Beam.of_section("bar", 1.0, tube, density=7850, modulus=2.1e11, modes=1, damping=0.01)
    pin = rj.Revolute(rod.at("left"), bar.at("end"), name="pin")
    assert_same(rj.load_scene(tmp_path / "scene.toml"), rj.Scene([rod, bar], [pin]))


def test_bodies_are_placed_by_their_points(crank):
    """As `placed` does in Python; a loop is closed, in positions and velocities."""
    text = crank.read_text().replace("consistent = true", "")
    crank.write_text(text)
    first, rod, slider = rj.load_scene(crank).bodies
    mine = rj.Beam("crank", 1.0, 0.2, angle=math.radians(60)).placed("start", rj.ground.pose())
    assert bits(mine.position) == bits(first.position)
    for one, other in ((first.pose("end"), rod.pose("start")), (rod.pose("end"), slider.pose())):
        assert_close(one.position, other.position, IDENTITY)
    assert_close(rod.angle, math.radians(-25.0), IDENTITY)
    system = rj.assemble(rj.consistent_scene(rj.load_scene(crank)))
    assert_close(violation(system, system.q0), np.zeros(8), IDENTITY)
    q, v = rj.consistent(system)
    assert_close(q, system.q0, IDENTITY)
    assert_close(v, system.v0, IDENTITY)


@jax.jit
def gap(amplitudes):
    """Between the hinge and the end of a beam that is placed there, bent."""
    beam = rj.Beam("b", 1.0, 1.0, EI=10.0, modes=2, amplitudes=amplitudes, stiffening=True)
    placed = beam.placed("end", rj.ground.pose((0.3, -0.2)), angle=0.7)
    joint = rj.Revolute(placed.at("end"), rj.ground.at((0.3, -0.2)))
    system = rj.assemble(rj.Scene([placed], [joint]))
    return system.constraint(0.0, system.q0)


def test_a_bent_beam_is_placed_by_where_its_end_is():
    assert_close(gap(np.array([0.05, 0.01])), np.zeros(2), IDENTITY)


@pytest.mark.instant
def test_names_do_not_make_programs():
    """Bodies with and without named points are one group."""
    bodies = [rj.RigidBody("a", 1.0, 1.0, points={"p": (0, 0)}), rj.RigidBody("b", 1.0, 1.0)]
    assert len(rj.assemble(rj.Scene(bodies)).bodies) == 1


@pytest.mark.instant
def test_unknown_points_name_the_nearest():
    body = rj.RigidBody("crank", 1.0, 1.0, points={"pin": (0.1, 0.0)})
    with pytest.raises(rj.SceneError, match="'crank': there is no point 'pim'. Did you mean 'pin'"):
        body.at("pim")
    with pytest.raises(rj.SceneError, match="ground: there is no point 'x'"):
        rj.ground.at("x")
    assert bits(rj.Ground({"p": (1.0, 2.0)}).at("p")) == bits(rj.ground.at((1.0, 2.0)))
