"""Effects and options that a scene does not have are not in its program, counted on the jaxpr."""

from collections import Counter
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from programs import force, primitives, touches, uses_velocities

import romjax as rj
from romjax.scene.effect.base import displacement

ON_GROUND = rj.ground.at((0.1, 0.2), 0.3)
SMOOTH = rj.Friction(0.3)
STRIBECK = rj.Friction(0.3, static=0.4, stribeck=0.1)


def effect(kind, **options):
    """One of its kind, from the cart to the ground, with nothing that can be left out."""
    a, b = rj.gallery.cart_pendulum().bodies[0].at((0.1, 0.0)), ON_GROUND
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
)
DISSIPATIVE = (rj.Damper, rj.TorsionDamper, rj.Motor, rj.Drag)
WITH_ROOTS = (rj.Force, rj.Contact, rj.Drag)
every_effect = pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.__name__)


def rigid(*effects) -> rj.Scene:
    """The chapter's cart alone."""
    return rj.Scene(rj.gallery.cart_pendulum().bodies[:1], [], effects)


# Effects.


def test_these_are_all_effects():
    """A new kind of effect belongs into the list."""
    kinds = {kind for kind in vars(rj).values() if isinstance(kind, type)}
    effects = {kind for kind in kinds if issubclass(kind, (rj.AbstractMarkerEffect, rj.Gravity))}
    assert {kind for kind in effects if not kind.__name__.startswith("Abstract")} == set(EFFECTS)


@pytest.mark.parametrize("place", [0, 1, 2], ids=["spring", "damper", "force"])
def test_an_effect_taken_out_leaves_no_trace(place):
    scene = rj.gallery.cart_pendulum()
    fewer = [effect for i, effect in enumerate(scene.effects) if i != place]
    assert len(force(rj.Scene(scene.bodies, scene.joints, fewer))) < len(force(scene))


@every_effect
def test_a_scene_that_lost_an_effect_is_one_that_never_had_it(kind):
    plain = rigid()
    more = rigid(effect(kind))
    fewer = eqx.tree_at(lambda scene: scene.effects, more, ())
    assert Counter(force(fewer)) == Counter(force(plain))
    assert len(force(more)) > len(force(plain))


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
        force(rigid(effect(kind), effect(absent[0])))


def test_gravity_is_traced_where_it_is():
    scene = rj.gallery.chain(3)
    assert len(force(rj.Scene(scene.bodies, scene.joints))) < len(force(scene))


def test_rigid_bodies_without_effects_have_no_force():
    """No turning, no products, no modes: zeros."""
    found = force(rj.Scene(rj.gallery.chain(3).bodies, rj.gallery.chain(3).joints))
    assert len(found) <= 1, found


def test_velocities_are_traced_for_dampers_only():
    """Not in any equation, be its result needed or not."""
    scene = rj.gallery.cart_pendulum()
    system = rj.assemble(rj.Scene(scene.bodies[:1], [], [scene.effects[0]]))
    assert not touches(system.force, system, 2)


@every_effect
def test_rigid_bodies_have_no_forces_of_velocity(kind):
    """Neither their own, quadratic ones, nor those of effects that do not dissipate."""
    free_of_it = [effect(other) for other in EFFECTS if other not in DISSIPATIVE]
    for scene in (rigid(effect(kind)), rigid(*free_of_it, effect(kind))):
        system = rj.assemble(scene)
        assert uses_velocities(scene) == (kind in DISSIPATIVE)
        assert touches(system.force, system, 2) == (kind in DISSIPATIVE)


# Options of effects.

# Without and with; primitives that only it brings in.
OPTIONS = {
    "Spring.rest_length": (rj.Spring, {}, {"rest_length": 0.1}, {"sqrt", "select_n"}),
    "Spring.cubic": (rj.Spring, {}, {"cubic": 1.0}, set()),
    "Damper.along_line": (rj.Damper, {}, {"along_line": True}, {"sqrt", "select_n"}),
    "Bushing.damping": (rj.Bushing, {}, {"damping": [1.0, 1.0, 1.0]}, set()),
    "Force.frame": (rj.Force, {}, {"frame": "body"}, {"stack"}),
    "Force.signal": (rj.Force, {}, {"signal": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Torque.signal": (rj.Torque, {}, {"signal": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Motor.target": (rj.Motor, {}, {"target": rj.Step(1.0, 0.1, 0.1)}, {"min", "max"}),
    "Contact.dissipation": (rj.Contact, {}, {"dissipation": 0.5}, {"max"}),
    "Contact.friction": (rj.Contact, {}, {"friction": SMOOTH}, {"tanh"}),
    "Friction.static": (rj.Contact, {"friction": SMOOTH}, {"friction": STRIBECK}, {"exp"}),
}
# Options that let velocities in.
MOVING = ("Bushing.damping", "Contact.dissipation", "Contact.friction")


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_that_is_not_taken_is_not_traced(option):
    kind, left, taken, telling = OPTIONS[option]
    without, full = rigid(effect(kind, **left)), rigid(effect(kind, **taken))
    assert Counter(force(without)) < Counter(force(full))
    assert not telling & set(force(without))
    assert telling <= set(force(full))
    if option in MOVING:
        assert not uses_velocities(without)
        assert uses_velocities(full)


@pytest.mark.parametrize(("kind", "telling"), [(rj.Force, "sqrt"), (rj.Contact, "pow")])
def test_roots_and_powers_come_with_their_effects(kind, telling):
    others = [effect(other) for other in EFFECTS if other not in WITH_ROOTS]
    assert telling not in force(rigid(*others))
    assert telling in force(rigid(*others, effect(kind)))


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
    plain, bare = force(rigid(effect(kind.__base__))), force(rigid(effect(kind)))
    assert Counter(plain) <= Counter(bare)


def test_friction_without_options_costs_no_more_than_one_that_knows_none():
    plain, bare = (
        force(rigid(effect(rj.Contact, friction=law)))
        for law in (SMOOTH, OnlyFriction(SMOOTH.coefficient))
    )
    assert Counter(plain) <= Counter(bare)
