"""The twists that joints know of themselves: those that follow from their poses."""

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj
from romjax.reduction.joint.free import Free
from romjax.reduction.joint.screws import coordinate_rates, screws_of
from romjax.reduction.joint.spanning import has_own_screws

r = rj.spatial
FLAT = rj.RigidBody("a", 1.0, 1.0).at(), rj.ground.at()
SPACE = r.RigidBody("a", 1.0, (1.0, 1.0, 1.0)).at(), rj.ground.at((0, 0, 0))
JOINTS = [
    rj.Revolute(*FLAT),
    rj.Prismatic(*FLAT, value=0.3),
    rj.Weld(*FLAT, value=0.2),
    rj.FixedAngle(*FLAT, value=0.3),
    rj.PointOnLine(*FLAT),
    r.Revolute(*SPACE),
    r.Spherical(*SPACE),
    r.Universal(*SPACE),
    r.Cylindrical(*SPACE),
    r.Prismatic(*SPACE),
    r.Planar(*SPACE),
    r.Weld(*SPACE),
    r.ConstantVelocity(*SPACE),
    r.PointOnPlane(*SPACE),
    rj.PointOnLine(*SPACE),
    r.Screw(*SPACE, pitch=0.3, offset=0.1),
    Free(3),
    Free(7),
]


def test_closed_forms_are_the_derivatives_of_poses():
    lot = np.random.default_rng(0)
    each = [lot.normal(size=(1, len(joint.freedoms))) for joint in JOINTS]

    @jax.jit
    def both(each):
        found = []
        for joint, z in zip(JOINTS, each, strict=True):
            change = coordinate_rates if joint.turns_freely else lambda _, u: u
            u = jnp.ones((1, z.shape[1] - joint.turns_freely))
            derived = screws_of(jax.vmap(joint.place), z, u, change)
            found.append((jax.vmap(joint.screws)(z), derived.columns))
        return found

    for own, derived in both(each):
        np.testing.assert_allclose(own, derived, atol=1e-14)


def test_a_place_of_ones_own_does_not_inherit_the_twists():
    class Bent(rj.Revolute):
        def place(self, z):
            return super().place(z**3)

    assert has_own_screws(rj.Revolute(*FLAT))
    assert not has_own_screws(Bent(*FLAT))
