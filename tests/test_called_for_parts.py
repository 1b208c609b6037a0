"""Options of bodies and joints that a scene does not have are not in its program."""

import functools
from collections import Counter
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from groups import in_groups
from mechanisms import Moving
from programs import force, mass, primitives, uses_time

import romjax as rj
from romjax.linalg.dense import multiply
from romjax.system import dynamics

CART = rj.RigidBody("cart", 1.0, 0.1)
ON_GROUND = rj.ground.at((0.1, 0.2), 0.3)


# Options of bodies.


def sprung(body, end) -> rj.Scene:
    """A body under gravity, with a spring at one end, so that its shapes count."""
    return rj.Scene([body], [], [rj.Gravity(), rj.Spring(body.at(end), ON_GROUND, 1.0)])


def beam(kind=rj.Beam, **options) -> rj.Scene:
    return sprung(kind("beam", 1.0, 1.0, **options), (0.5, 0.0))


def modal(kind=rj.ModalBody, damping=None, **terms) -> rj.Scene:
    """A body of two modes with the given terms of its inertia."""
    shapes = np.ones((1, 3, 2))
    inertia = rj.Inertia(1.0, 1.0, **terms)
    body = kind("body", inertia, [1.0, 2.0], [[0.5, 0.0]], shapes, damping=damping)
    return sprung(body, (0.5, 0.0))


BENDING = {"EI": 1.0, "modes": 2}
BODIES = {
    "Beam.modes": (beam, {}, BENDING),
    "Beam.damping": (beam, BENDING, BENDING | {"damping": 0.1}),
    "Beam.stiffening": (beam, BENDING, BENDING | {"stiffening": True}),
    "Beam.shapes clamped": (beam, BENDING, BENDING | {"shapes": "clamped-free"}),
    "Beam.shapes pinned": (beam, BENDING, BENDING | {"shapes": "pinned-free"}),
    "ModalBody.damping": (modal, {}, {"damping": [0.1, 0.2]}),
}
# Numbers do not count: what is given as zero is traced all the same.
TERMS = {
    "modal": np.eye(2),
    "first_moment": np.zeros(2),
    "shift": np.zeros((2, 2)),
    "swing": np.zeros(2),
    "stretch": np.zeros(2),
    "gyration": np.zeros((2, 2)),
    "foreshortening": np.zeros((2, 2, 2)),
    "spin": np.zeros((2, 2)),
}


class Counts(NamedTuple):
    """Equations of the mass matrix and of the force, and the products among them."""

    mass: int
    force: int
    products_of_mass: int
    products_of_force: int


def count(scene) -> Counts:
    found = mass(scene), force(scene)
    products = (sum(name in ("mul", "dot_general") for name in names) for names in found)
    return Counts(*map(len, found), *products)


@functools.cache
def counts(*terms) -> Counts:
    """Of a body with these terms of inertia, traced once for all tests."""
    return count(modal(**{term: TERMS[term] for term in terms}))


@functools.cache
def counts_of_beam(**options) -> Counts:
    return count(beam(**options))


@pytest.mark.parametrize("option", BODIES)
def test_an_option_of_a_body_that_is_not_taken_is_not_traced(option):
    make, left, taken = BODIES[option]
    if make is beam:
        without, full = counts_of_beam(**left), counts_of_beam(**taken)
    else:
        without, full = counts(), count(make(**taken))
    assert without.mass <= full.mass
    assert without.force < full.force


@pytest.mark.instant
def test_these_are_all_terms_of_inertia():
    given = rj.Inertia(1.0, 1.0)
    assert {name for name, value in vars(given).items() if value is None} == set(TERMS)


@pytest.mark.parametrize("term", TERMS)
def test_a_term_of_inertia_that_is_none_is_not_traced(term):
    plain, one = counts(), counts(term)
    assert plain.mass < one.mass
    assert plain.force < one.force


@pytest.mark.parametrize("term", in_groups(TERMS, fast=["swing", "foreshortening"]))
def test_nor_is_the_only_one_that_is_missing(term):
    """In a full matrix its place is held by a constant. Centre and swing alone are put there as
    they are; all the others are multiplied.
    """
    fewer, more = (x[2:] for x in (counts(*(t for t in TERMS if t != term)), counts(*TERMS)))
    if term in ("first_moment", "swing"):
        assert fewer == more
    else:
        assert fewer[0] < more[0]
        assert fewer[1] < more[1]


class OnlyBeam(rj.Beam):
    """A beam of static modes that knows neither damping nor stiffening nor other shapes."""

    damped: ClassVar[bool] = False
    foreshortens: ClassVar[bool] = False

    def mass_matrix(self, q):
        turning = self.mass * self.length**2 / 12 + multiply(q[3:], q[3:])
        return jnp.concatenate([jnp.stack([self.mass, self.mass, turning]), jnp.ones_like(q[3:])])

    def first_moment(self, q):
        return self.mass * q[:2]


class OnlyModalBody(rj.ModalBody):
    damped: ClassVar[bool] = False

    def mass_matrix(self, q):
        mass, turning = self.inertia.mass, self.inertia.moment + multiply(q[3:], q[3:])
        return jnp.concatenate([jnp.stack([mass, mass, turning]), jnp.ones_like(q[3:])])

    def first_moment(self, q):
        return self.inertia.mass * q[:2]


@pytest.mark.parametrize(
    ("make", "kind", "given"), [(beam, OnlyBeam, BENDING), (modal, OnlyModalBody, {})]
)
def test_a_body_without_options_costs_no_more_than_one_that_knows_none(make, kind, given):
    plain, bare = make(**given), make(kind, **given)
    assert Counter(mass(plain)) <= Counter(mass(bare))
    assert Counter(force(plain)) <= Counter(force(bare))


def test_rigid_bodies_have_no_modal_code():
    """A beam without modes costs what a rigid body costs, with modes more."""
    bar = force(rj.Scene([rj.RigidBody("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    stiff = force(rj.Scene([rj.Beam("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    elastic = force(rj.Scene([rj.Beam("bar", 1.0, 1.0, EI=1.0, modes=1)], [], [rj.Gravity()]))
    assert len(stiff) == len(bar) < len(elastic)


# Constraints.


def joined(*joints) -> rj.AbstractSystem:
    """A cart with other joints."""
    return rj.assemble(rj.Scene([CART], joints))


def joint(kind, *numbers):
    return kind(CART.at(), rj.ground.at(), *numbers)


STILL = {
    "Revolute": (rj.Revolute,),
    "Prismatic": (rj.Prismatic,),
    "FixedAngle": (rj.FixedAngle,),
    "PointOnLine": (rj.PointOnLine,),
    "PointOnCurve": (rj.PointOnCurve, rj.Circle(1.0)),
    "Distance": (rj.Distance, 1.0),
    "Gear": (rj.Gear, 2.0),
    "PrescribedAngle": (rj.PrescribedAngle, rj.Constant(0.0)),
    "PrescribedTravel": (rj.PrescribedTravel, rj.Constant(0.0)),
    "PrescribedDistance": (rj.PrescribedDistance, rj.Constant(1.0)),
}


def along(system):
    """The constraints and their rates along a motion, as a function of t, q and v."""
    return functools.partial(dynamics.constraint_state, system)


@pytest.mark.instant
@pytest.mark.parametrize("kind", STILL)
def test_joints_that_stand_still_have_no_time(kind):
    """Nor have their derivatives C_t, C_qt and C_tt."""
    system = joined(joint(*STILL[kind]))
    assert not uses_time(along(system), system)


def test_welded_bodies_have_no_time():
    """A weld to the ground would leave no motion: it joins two bars that fall. Nor has their
    acceleration any.
    """
    bars = zoo.bars().bodies
    weld = rj.Weld(bars[0].at((0.5, 0.0)), bars[1].at((-0.5, 0.0)))
    system = rj.assemble(rj.Scene(bars, [weld]))
    assert not uses_time(along(system), system)
    assert not uses_time(system.acceleration, system)


@functools.cache
def still(kind) -> Counter[str]:
    """What is in the constraint of a prescribed motion that stands still."""
    system = joined(joint(kind, rj.Constant(1.0)))
    return Counter(primitives(along(system), 0.0, system.q0, system.v0))


@pytest.mark.instant
@pytest.mark.parametrize("kind", [rj.PrescribedAngle, rj.PrescribedTravel, rj.PrescribedDistance])
@pytest.mark.parametrize("signal", [rj.Ramp(1.0, 0.0), rj.Sine(1.0, 1.0)], ids=["ramp", "sine"])
def test_prescribed_motions_bring_time_in(kind, signal):
    """Beyond a joint that stands still: the signal and its two derivatives."""
    moving = joined(joint(kind, signal))
    assert uses_time(along(moving), moving)
    few, many = still(kind), Counter(primitives(along(moving), 0.0, moving.q0, moving.v0))
    assert few < many
    assert (many["sin"] > few["sin"]) == isinstance(signal, rj.Sine)


@pytest.mark.instant
def test_a_prescribed_angle_that_stands_still_is_a_fixed_one():
    system = joined(joint(rj.FixedAngle))
    fixed = Counter(primitives(along(system), 0.0, system.q0, system.v0))
    assert fixed == still(rj.PrescribedAngle)


def test_time_is_traced_for_moving_joints_only():
    """A constraint that ignores t leaves no C_t; one that does not, does."""
    bars = zoo.bars()
    still = rj.assemble(bars)
    assert not uses_time(along(still), still)
    moving = Moving(bars.bodies[0].at((-0.5, 0.0)), rj.ground.at(), 1.0)
    driven = rj.assemble(rj.Scene(bars.bodies, [moving, bars.joints[1]], bars.effects))
    assert uses_time(along(driven), driven)
    rate = jax.jit(along(driven))(0.0, driven.q0, driven.v0).rate
    assert np.isclose(rate[0], -1.0)
    few = primitives(along(still), 0.0, still.q0, still.v0)
    assert len(few) < len(primitives(along(driven), 0.0, driven.q0, driven.v0))


def test_no_constraints_no_multipliers():
    system = rj.assemble(rj.Scene([rj.RigidBody("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    found = jax.eval_shape(system.acceleration, 0.0, system.q0, system.v0)
    assert found[1].shape == (0,)
    found = primitives(system.acceleration, 0.0, system.q0, system.v0)
    assert "cholesky" not in found
    assert "triangular_solve" not in found


def test_constraints_that_are_left_to_drift_have_no_stabilization():
    system = rj.assemble(rj.gallery.cart_pendulum())
    state = (0.0, system.q0, system.v0)
    gamma = functools.partial(dynamics.gamma, system)
    drifting = Counter(primitives(gamma, *state))
    held = Counter(primitives(gamma, *state, rj.Baumgarte(1.0, 1.0)))
    assert drifting < held
