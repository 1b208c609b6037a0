"""Gradients of ready scenes by every parameter, three ways: full, reduced, in a batch."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from groups import in_groups
from jax.tree_util import tree_map_with_path
from test_minimal import DECIDED
from tolerances import DIFFERENCED

import romjax as rj

THROUGH = 1e-5  # required of a gradient through a basis
SCENES = {"cart": rj.gallery.cart_pendulum(f2=60.0), "chain": rj.gallery.chain(2)}
RANKS = {"cart": {"galerkin": 5, "minimal": 3}, "chain": {"galerkin": 4, "minimal": 2}}
TIMES = jnp.linspace(0.0, 0.1, 11)
# Fixed steps: a step size control makes the motion jump in its parameters by its tolerance, which
# a difference quotient would divide by its step.
FIXED = {"dt": 1e-3, "solver": diffrax.Dopri8(), "audit": False, "throw": False}


def trained(scene, kind):
    """A basis of the motion of a scene, and what of the reduced model no parameter changes."""
    system = rj.assemble(SCENES[scene])
    basis = rj.pod(rj.simulate(system, TIMES, **FIXED), rank=RANKS[scene][kind])
    rom = rj.reduce(system, basis, kind)
    return basis, DECIDED[kind](rom)


def last(run):
    """One number from all coordinates at the end."""
    return jnp.sum(run.q[-1] * jnp.cos(jnp.arange(run.q.shape[1]))) + jnp.sum(run.v[-1] ** 2)


CASES = [("cart", "full"), ("cart", "galerkin"), ("cart", "minimal"), ("chain", "full")]


@pytest.mark.parametrize(("scene", "kind"), in_groups(CASES, slow=[("chain", "full")]))
def test_every_parameter_of_a_scene(scene, kind):
    """Of the full model and of reduced ones of one basis, of two runs in one batch.

    The chain has two bodies of one kind, which are one group; all else of it the cart has too.
    """
    values, rest = eqx.partition(SCENES[scene], eqx.is_inexact_array)
    if scene == "cart":  # differences need to know how large an amplitude is
        values = eqx.tree_at(lambda s: s.bodies[1].amplitudes, values, jnp.array([1e-4, 1e-5]))
    basis, formulation = trained(scene, kind) if kind != "full" else (None, None)

    def end(factor, values):
        system = rj.assemble(eqx.combine(jax.tree.map(lambda x: factor * x, values), rest))
        if kind != "full":
            system = rj.reduce(system, basis, formulation)
        return last(rj.simulate(system, TIMES, **FIXED))

    def f(values):
        return jnp.sum(jax.vmap(end, (0, None))(jnp.array([1.0, 1.02]), values))

    found = rj.check_gradient(f, values)
    assert found.error <= DIFFERENCED, str(found)


def flexible_rotor() -> rj.Scene:
    """A motor turns a shaft in a bearing, which bends and twists under a disc out of balance."""
    r, along_x = rj.spatial, (1.0, 0.0, 0.0)
    shaft = r.Beam(
        "shaft",
        1.0,
        0.5,
        (2e-3, 0.03, 0.03),
        EI=(20.0, 25.0),
        GJ=30.0,
        bending=1,
        torsion=1,
        damping=0.02,
        position=(0.25, 0.0, 0.0),
        angular_velocity=(20.0, 0.0, 0.0),
        amplitudes=(1e-3, -2e-3, 1e-3),
        rates=(0.1, 0.2, 0.1),
    )
    disc = r.RigidBody(
        "disc", 2.0, (0.02, 0.012, 0.012), (0.5, 1e-3, 0.0), angular_velocity=(20.0, 0.0, 0.0)
    )
    bearing = shaft.at("start", axis=along_x), rj.ground.at((0.0, 0.0, 0.0), axis=along_x)
    joints = [r.Revolute(*bearing), r.Weld(disc.at((0.0, -1e-3, 0.0)), shaft.at("end"))]
    motor = rj.Motor(*bearing, rj.Ramp(0.1, 20.0), 5.0, 0.3)
    return rj.Scene([shaft, disc], joints, [rj.Gravity((0.0, 0.0, -9.81)), motor])


IN_SPACE = {"slider crank": rj.gallery.spatial_slider_crank, "flexible rotor": flexible_rotor}


@pytest.mark.exhaustive
@pytest.mark.parametrize("scene", IN_SPACE)
def test_every_parameter_of_a_scene_in_space(scene):
    values, rest = eqx.partition(IN_SPACE[scene](), eqx.is_inexact_array)

    def f(values):
        system = rj.assemble(eqx.combine(values, rest))
        # Differences of a longer run see its rounding, some ten units in the last place.
        return last(rj.simulate(system, TIMES[:3], **FIXED))

    found = rj.check_gradient(f, values)
    assert found.error <= DIFFERENCED, str(found)


THROUGH_BASES = [("cart", "galerkin"), ("chain", "minimal")]


@pytest.mark.parametrize(("scene", "kind"), in_groups(THROUGH_BASES, slow=[("chain", "minimal")]))
def test_every_parameter_through_the_basis(scene, kind):
    """Of a reduced run whose basis comes from the run of the same scene.

    Of parameters that leave the start on the constraints: a violation adds a direction of its own
    to the motion, which is among the leading ones at once.
    """
    names = ("mass", "inertia", "frequencies", "stiffness", "damping", "signal", "acceleration")

    def free(path, leaf):
        return eqx.is_inexact_array(leaf) and any(getattr(key, "name", "") in names for key in path)

    values, rest = eqx.partition(SCENES[scene], tree_map_with_path(free, SCENES[scene]))
    _, formulation = trained(scene, kind)

    def f(values):
        system = rj.assemble(eqx.combine(values, rest))
        basis = rj.pod(rj.simulate(system, TIMES, **FIXED), rank=RANKS[scene][kind])
        return last(rj.simulate(rj.reduce(system, basis, formulation), TIMES, **FIXED))

    found = rj.check_gradient(f, values)
    assert found.error <= THROUGH, str(found)
