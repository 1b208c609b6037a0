"""Outlines of parts that the package does not know."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from outlined import ENDS, ends, scene_of, signs, some
from tolerances import IDENTITY

import romjax as rj
from romjax import plot
from romjax.assembly.outlines import outlines


class Belt(rj.AbstractJoint):
    """Without an outline of its own."""

    a: rj.Marker
    b: rj.Marker
    name: str = eqx.field(static=True, default="belt")
    rows = 1

    def residual(self, t, a, b):
        return (a.position[0] - 0.25 * b.angle)[None]


class Lamp(rj.AbstractMarkerEffect):
    """With an outline of its own: two short rays from its marker."""

    at: rj.Marker
    needs_twists = False

    def wrenches(self, t, poses, twists):
        (pose,) = poses
        return (rj.Wrench(0 * pose.position, 0 * pose.angle),)

    def outline(self, t, poses, size):
        (pose,) = poses
        rays = [jnp.stack([size, side * size]) for side in (-1, 1)]
        tips = [pose.position + pose.turned(ray) for ray in rays]
        return (rj.Outline(jnp.stack([tips[0], pose.position, tips[1]]), "load"),)

    def check(self):
        pass


class Wind(rj.AbstractField):
    """A field with a sign, though it has neither marker nor number."""

    def energy(self, body, q):
        return -q[0]

    def outline(self, t, poses, size):
        del poses
        return (rj.Outline(jnp.stack([jnp.zeros(2), jnp.stack([size, 0 * size])]), "load"),)

    def check(self):
        pass


def test_parts_of_ones_own_are_drawn():
    belt, lamp = Belt(*ENDS), Lamp(ENDS[0])
    scene = scene_of(belt, lamp, Wind())
    q = some(scene)
    line, dots, rays, wind = signs(scene, q)
    a, b = ends(scene, belt, q)
    for drawn in (line, dots):
        np.testing.assert_allclose(drawn.points, np.stack([a, b], axis=1), atol=IDENTITY)
    assert (line.part, line.style, dots.style) == ("belt", "link", "point")
    np.testing.assert_allclose(rays.points[:, 1], a, atol=IDENTITY)
    assert wind.points.shape == (3, 2, 2)


def test_parts_of_ones_own_are_in_the_figures(tmp_path):
    """The same points, as lines of a matplotlib figure."""
    belt = Belt(*ENDS)
    scene = scene_of(belt, Lamp(ENDS[0]))
    q = np.asarray(rj.assemble(scene).q0)
    basis = rj.Basis.from_modes(np.eye(len(q))[:, :1], q)
    drawn = [line.get_xydata() for line in plot.modes(scene, basis).axes[0].lines]
    wanted = np.concatenate(ends(scene, belt, q[None]))
    lines = [x for x in drawn if len(x) == 3 and np.all(np.isnan(x[2]))]
    assert any(np.allclose(x[:2], wanted, rtol=0, atol=IDENTITY) for x in lines)


def test_equal_parts_are_traced_once():
    """Outlines of a longer chain take the same program, with longer arrays."""
    traced = []

    class Hinge(rj.AbstractJoint):
        a: rj.Marker
        b: rj.Marker
        name: str = eqx.field(static=True, default="")
        rows = 2

        def residual(self, t, a, b):
            return a.position - b.position

        def outline(self, t, poses, size):
            traced.append(1)
            return super().outline(t, poses, size)

    chain = rj.gallery.chain(6)
    scene = rj.Scene(chain.bodies, [Hinge(j.a, j.b, name=str(j.a.body)) for j in chain.joints])
    q = some(scene, 5)
    outlines(scene, 0.0, q)
    assert len(traced) == 1
    outlines(scene, np.linspace(0, 1, 3), q[:3])
    assert len(traced) == 1
