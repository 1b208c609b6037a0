"""Effects and options that a scene does not have are not in its program, counted on the jaxpr.

Each kind and option is traced once, into a table that all tests look at.
"""

import functools
from collections import Counter
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from programs import needs, primitives, primitives_in, reads

import romjax as rj
from romjax.scene.effect.base import displacement

CART = rj.RigidBody("cart", 1.0, 0.1)
ON_GROUND = rj.ground.at((0.1, 0.2), 0.3)
SMOOTH = rj.Friction(0.3)
CYLINDER = {
    "area": 1.0,
    "rod_area": 0.5,
    "retracted": 0.0,
    "stroke": 2.0,
    "supply": 9.0,
    "flow": 0.1,
    "dead_volume": 0.1,
}
STRIBECK = rj.Friction(0.3, static=0.4, stribeck=0.1)


def effect(kind, **options):
    """One of its kind, from the cart to the ground, with nothing that can be left out."""
    a, b = CART.at((0.1, 0.0)), ON_GROUND
    needed = {
        rj.Gravity: {},
        rj.Spring: {"a": a, "b": b, "stiffness": 1.0},
        rj.Damper: {"a": a, "b": b, "damping": 1.0},
        rj.TorsionSpring: {"a": a, "b": b, "stiffness": 1.0},
        rj.TorsionDamper: {"a": a, "b": b, "damping": 1.0},
        rj.Bushing: {"a": a, "b": b, "stiffness": [1.0, 1.0, 1.0]},
        rj.Force: {"at": a, "direction": (1.0, 1.0), "signal": rj.Constant(1.0)},
        rj.Torque: {"at": a, "signal": rj.Constant(1.0)},
        rj.Motor: {
            "a": a,
            "b": b,
            "target": rj.Constant(1.0),
            "proportional": 1.0,
            "derivative": 1.0,
        },
        rj.Contact: {"a": a, "b": b, "curve": rj.Line(), "stiffness": 1.0},
        rj.Drag: {"at": a, "coefficient": 0.5, "area": 0.1},
        rj.JointSpring: {"a": a, "b": b, "stiffness": 1.0},
        rj.JointDamper: {"a": a, "b": b, "damping": 1.0},
        rj.JointStop: {"a": a, "b": b, "upper": 1.0},
        rj.Rope: {"a": a, "b": b, "length": 1.0, "stiffness": 1.0},
        rj.Actuator: {"a": a, "b": b, "signal": rj.Constant(1.0)},
        rj.PID: {"a": a, "b": b, "target": rj.Constant(1.0)},
        rj.LowPass: {"a": a, "b": b, "signal": rj.Constant(1.0), "time_constant": 0.1},
        rj.HydraulicCylinder: {"a": a, "b": b, "signal": rj.Constant(1.0)} | CYLINDER,
    }
    return kind(**next(given for base, given in needed.items() if issubclass(kind, base)) | options)


EFFECTS = (
    rj.Gravity,
    rj.Spring,
    rj.Damper,
    rj.TorsionSpring,
    rj.TorsionDamper,
    rj.Bushing,
    rj.Force,
    rj.Torque,
    rj.Motor,
    rj.Contact,
    rj.Drag,
    rj.JointSpring,
    rj.JointDamper,
    rj.JointStop,
    rj.Rope,
    rj.Actuator,
    rj.PID,
    rj.LowPass,
    rj.HydraulicCylinder,
)
WITH_STATES = (rj.PID, rj.LowPass, rj.HydraulicCylinder)
DISSIPATIVE = (
    rj.Damper,
    rj.TorsionDamper,
    rj.Motor,
    rj.Drag,
    rj.JointDamper,
    rj.Actuator,
    *WITH_STATES,
)
WITH_ROOTS = (rj.Force, rj.Contact, rj.Drag, rj.Rope, rj.HydraulicCylinder)
every_effect = pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.__name__)


def rigid(*effects) -> rj.Scene:
    """The cart alone."""
    return rj.Scene([CART], [], effects)


class Traced(NamedTuple):
    """The program of a scene's forces."""

    counts: Counter[str]  # of its primitives
    reads_velocities: bool  # in any equation
    needs_velocities: bool  # for the result


def traced(scene: rj.Scene) -> Traced:
    system = rj.assemble(scene)
    program = jax.make_jaxpr(system.force)(0.0, system.q0, system.v0).jaxpr
    return Traced(Counter(primitives_in(program)), reads(program, 2), needs(program, 2))


@functools.cache
def of(kind) -> Traced:
    """Of an effect alone."""
    return traced(rigid(effect(kind)))


@functools.cache
def of_option(option) -> Traced:
    """With an option of the table below."""
    kind, _, taken, _ = OPTIONS[option]
    return traced(rigid(effect(kind, **taken)))


# Effects.


@pytest.mark.instant
def test_these_are_all_effects():
    """A new kind of effect belongs into the list."""
    kinds = {kind for kind in vars(rj).values() if isinstance(kind, type)}
    effects = {kind for kind in kinds if issubclass(kind, (rj.AbstractMarkerEffect, rj.Gravity))}
    assert {kind for kind in effects if not kind.__name__.startswith("Abstract")} == set(EFFECTS)


def test_a_scene_that_lost_its_effects_is_one_that_never_had_any():
    """No turning, no products: zeros."""
    scene = rigid(*(effect(kind) for kind in EFFECTS))
    found = traced(eqx.tree_at(lambda scene: scene.effects, scene, ())).counts
    assert found == traced(rigid()).counts
    assert found.total() <= 1, found
    for kind in EFFECTS:
        assert of(kind).counts.total() > found.total(), kind


@every_effect
def test_absent_effects_are_never_asked(kind, monkeypatch):
    """None of all other kinds, in no part of the acceleration of a scene that has one."""

    def asked(*_):
        raise AssertionError("asked")

    absent = [other for other in EFFECTS if other is not kind]
    for other in absent:
        monkeypatch.setattr(other, "energy" if other is rj.Gravity else "wrenches", asked)
    system = rj.assemble(rigid(effect(kind)))
    primitives(system.acceleration, 0.0, system.q0, system.v0)
    with pytest.raises(AssertionError, match="asked"):
        traced(rigid(effect(absent[0])))


@every_effect
def test_velocities_are_traced_for_what_dissipates_only(kind):
    """Rigid bodies have no quadratic forces; nor is a velocity in any equation for nothing."""
    found = of(kind)
    assert found.needs_velocities == (kind in DISSIPATIVE)
    assert found.reads_velocities == (kind in DISSIPATIVE)


def test_effects_that_do_not_dissipate_have_no_velocities_together():
    found = traced(rigid(*(effect(kind) for kind in EFFECTS if kind not in DISSIPATIVE)))
    assert not found.needs_velocities
    assert not found.reads_velocities


# Options of effects.

# Another option that it wants, itself, and primitives that only it brings in.
OPTIONS = {
    "Spring.rest_length": (rj.Spring, None, {"rest_length": 0.1}, {"sqrt", "select_n"}),
    "Spring.cubic": (rj.Spring, None, {"cubic": 1.0}, set()),
    "Damper.along_line": (rj.Damper, None, {"along_line": True}, {"sqrt", "select_n"}),
    "Bushing.damping": (rj.Bushing, None, {"damping": [1.0, 1.0, 1.0]}, set()),
    "Force.frame": (rj.Force, None, {"frame": "body"}, {"stack"}),
    "Force.signal": (rj.Force, None, {"signal": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Torque.signal": (rj.Torque, None, {"signal": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Motor.target": (rj.Motor, None, {"target": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Contact.dissipation": (rj.Contact, None, {"dissipation": 0.5}, {"max"}),
    "Contact.friction": (rj.Contact, None, {"friction": SMOOTH}, {"tanh"}),
    "Friction.static": (rj.Contact, "Contact.friction", {"friction": STRIBECK}, {"exp"}),
}
# Options that let velocities in.
MOVING = ("Bushing.damping", "Contact.dissipation", "Contact.friction")


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_that_is_not_taken_is_not_traced(option):
    kind, wanted, _, telling = OPTIONS[option]
    without, full = of_option(wanted) if wanted else of(kind), of_option(option)
    assert without.counts < full.counts
    assert not telling & set(without.counts)
    assert telling <= set(full.counts)
    if option in MOVING:
        assert not without.needs_velocities
        assert full.needs_velocities


@pytest.mark.parametrize(("kind", "telling"), [(rj.Force, "sqrt"), (rj.Contact, "pow")])
def test_roots_and_powers_come_with_their_effects(kind, telling):
    assert telling in of(kind).counts
    for other in EFFECTS:
        assert other in WITH_ROOTS or telling not in of(other).counts


class OnlySpring(rj.Spring):
    """A spring for which options were never thought of, as are those that follow."""

    def energy(self, t, *poses):
        a, b = poses
        return 0.5 * self.stiffness * jnp.sum((a.position - b.position) ** 2)


class OnlyDamper(rj.Damper):
    def rayleigh(self, t, poses, twists):
        a, b = twists
        return 0.5 * self.damping * jnp.sum((a.velocity - b.velocity) ** 2)


class OnlyForce(rj.Force):
    def wrenches(self, t, poses, twists):
        force = self.signal(t) * self.direction / jnp.linalg.norm(self.direction)
        return (rj.Wrench(force, jnp.zeros_like(force[0])),)


class OnlyBushing(rj.Bushing):
    needs_twists: ClassVar[bool] = False

    def wrenches(self, t, poses, twists):
        def delta(a, b):
            return jnp.append(b.local(a.position), a.angle - b.angle)

        value, _, wrenches = displacement(delta, poses, twists)
        return wrenches(-self.stiffness * value)


class OnlyContact(rj.Contact):
    needs_twists: ClassVar[bool] = False

    def wrenches(self, t, poses, twists):
        place, _, wrenches = displacement(lambda a, b: b.local(a.position), poses, twists)
        gap, slope = jax.value_and_grad(self.curve)(place)
        squared = slope @ slope
        steepness = jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
        inside = gap < 0
        depth = jnp.where(inside, -gap / steepness, 1.0)
        push = self.stiffness * depth**1.5 * slope / steepness
        return wrenches(jnp.where(inside, push, 0))


class OnlyFriction(rj.Friction):
    def __call__(self, speed):
        return self.coefficient * jnp.tanh(speed / self.creep)


@pytest.mark.parametrize("kind", [OnlySpring, OnlyDamper, OnlyForce, OnlyBushing, OnlyContact])
def test_an_effect_without_options_costs_no_more_than_one_that_knows_none(kind):
    assert of(kind.__base__).counts <= traced(rigid(effect(kind))).counts


def test_friction_without_options_costs_no_more_than_one_that_knows_none():
    plain = of_option("Contact.friction")
    bare = traced(rigid(effect(rj.Contact, friction=OnlyFriction(SMOOTH.coefficient))))
    assert plain.counts <= bare.counts
