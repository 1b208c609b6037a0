"""Only what the scene calls for is traced, and it is traced once."""

import ast
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jax.extend import core

import romjax as rj

PACKAGE = Path(rj.__file__).parent
# Required: a chain eight times as long compiles to at most this many times the program.
LONGER = 1.5


def programs(jaxpr):
    """A traced program and all that are nested in it."""
    yield jaxpr
    for equation in jaxpr.eqns:
        for value in jax.tree.leaves(
            equation.params,
            is_leaf=lambda x: isinstance(x, (core.Jaxpr, core.ClosedJaxpr)),
        ):
            if isinstance(value, core.ClosedJaxpr):
                yield from programs(value.jaxpr)
            elif isinstance(value, core.Jaxpr):
                yield from programs(value)


def primitives(function, *arguments) -> list[str]:
    """The primitives of a function, in all nested programs."""
    traced = jax.make_jaxpr(function)(*arguments).jaxpr
    return [e.primitive.name for program in programs(traced) for e in program.eqns]


def force(scene) -> list[str]:
    system = rj.assemble(scene)
    return primitives(system.force, 0.0, system.q0, system.v0)


def uses_time(function, system) -> bool:
    """Whether the first argument, t, has any effect on what a function computes."""
    traced = jax.make_jaxpr(function)(0.0, system.q0, system.v0).jaxpr
    needed = {id(x) for x in traced.outvars}
    for equation in reversed(traced.eqns):
        if any(id(x) in needed for x in equation.outvars):
            needed |= {id(x) for x in equation.invars}
    return id(traced.invars[0]) in needed


class Moving(rj.AbstractJoint):
    """A hinge whose place on `b` runs along x at a given speed [m/s]."""

    a: rj.Marker
    b: rj.Marker
    speed: jax.Array = eqx.field(converter=jnp.asarray)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2

    def residual(self, t, a, b):
        return a.position - b.position - jnp.stack([self.speed * t, jnp.zeros_like(t)])


class Watched(rj.AbstractSignal):
    """A constant that takes note of every time that it is traced."""

    value: jax.Array = eqx.field(converter=jnp.asarray)
    traced: ClassVar[list[int]] = []

    def __call__(self, t):
        del t
        self.traced.append(1)
        return self.value


# Only what the scene calls for.


@pytest.mark.parametrize("place", [0, 1, 2], ids=["spring", "damper", "force"])
def test_an_effect_taken_out_leaves_no_trace(place):
    scene = rj.gallery.cart_pendulum()
    fewer = [effect for i, effect in enumerate(scene.effects) if i != place]
    assert len(force(rj.Scene(scene.bodies, scene.joints, fewer))) < len(force(scene))


def test_gravity_is_traced_where_it_is():
    scene = rj.gallery.chain(3)
    assert len(force(rj.Scene(scene.bodies, scene.joints))) < len(force(scene))


def test_rigid_bodies_without_effects_have_no_force():
    """No turning, no products, no modes: zeros."""
    found = force(rj.Scene(rj.gallery.chain(3).bodies, rj.gallery.chain(3).joints))
    assert len(found) <= 1, found


def test_rigid_bodies_have_no_modal_code():
    """A beam without modes costs what a rigid body costs, with modes more."""
    rigid = force(rj.Scene([rj.RigidBody("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    stiff = force(rj.Scene([rj.Beam("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    elastic = force(rj.Scene([rj.Beam("bar", 1.0, 1.0, EI=1.0, modes=1)], [], [rj.Gravity()]))
    assert len(stiff) == len(rigid) < len(elastic)


def test_velocities_are_traced_for_dampers_only():
    scene = rj.gallery.cart_pendulum()
    system = rj.assemble(rj.Scene(scene.bodies[:1], [], [scene.effects[0]]))
    found = jax.make_jaxpr(system.force)(0.0, system.q0, system.v0).jaxpr
    used = {id(x) for program in programs(found) for e in program.eqns for x in e.invars}
    assert id(found.invars[2]) not in used


def test_time_is_traced_for_moving_joints_only():
    """A constraint that ignores t leaves no C_t; one that does not, does."""
    bars = rj.gallery.chain(2)
    still = rj.assemble(bars)
    assert not uses_time(still.constraint_state, still)
    moving = Moving(bars.bodies[0].at((-0.5, 0.0)), rj.ground.at(), 1.0)
    driven = rj.assemble(rj.Scene(bars.bodies, [moving, bars.joints[1]], bars.effects))
    assert uses_time(driven.constraint_state, driven)
    assert jnp.allclose(driven.constraint_state(0.0, driven.q0, driven.v0).rate[0], -1.0)
    few = primitives(still.constraint_state, 0.0, still.q0, still.v0)
    assert len(few) < len(primitives(driven.constraint_state, 0.0, driven.q0, driven.v0))


def test_no_constraints_no_multipliers():
    system = rj.assemble(rj.Scene([rj.RigidBody("bar", 1.0, 1.0)], [], [rj.Gravity()]))
    found = jax.eval_shape(system.acceleration, 0.0, system.q0, system.v0)
    assert found[1].shape == (0,)
    found = primitives(system.acceleration, 0.0, system.q0, system.v0)
    assert "cholesky" not in found
    assert "triangular_solve" not in found


# Grouping.


@pytest.mark.parametrize("what", ["force", "constraint", "acceleration"])
def test_a_longer_chain_is_the_same_program(what):
    def count(links):
        system = rj.assemble(rj.gallery.chain(links))
        start = (system.q0,) if what == "constraint" else (system.q0, system.v0)
        return len(primitives(getattr(system, what), 0.0, *start))

    assert count(64) == count(8)


def test_a_longer_chain_compiles_to_as_much():
    """Lines of the compiled program, which the compiler's time follows."""

    def lines(links):
        system = rj.assemble(rj.gallery.chain(links))
        lowered = jax.jit(lambda t, q, v: system.acceleration(t, q, v)).lower(
            0.0, system.q0, system.v0
        )
        return len(lowered.compile().as_text().splitlines())

    assert lines(64) <= LONGER * lines(8)


# Compiled once.


def sprung(mass=1.0, stiffness=5.0, load=1.0, point=-0.5, bodies=1):
    """A bar on a hinge with a spring and a watched force; more bodies float beside it."""
    bar = rj.RigidBody("bar", mass, 0.1, position=(-point, 0.0))
    others = [rj.RigidBody(f"other{i}", 1.0, 1.0) for i in range(bodies - 1)]
    return rj.Scene(
        bodies=[bar, *others],
        joints=[rj.Revolute(bar.at((point, 0.0)), rj.ground.at())],
        effects=[
            rj.Spring(bar.at((0.5, 0.0)), rj.ground.at((0.0, 1.0)), stiffness),
            rj.Force(bar.at(), (0.0, 1.0), Watched(load)),
        ],
    )


def test_new_numbers_compile_nothing():
    """And a new body does."""

    def traces(alpha=10.0, rtol=1e-6, end=0.1, **numbers):
        before = len(Watched.traced)
        rj.simulate(
            rj.assemble(sprung(**numbers)),
            jnp.linspace(0.0, end, 3),
            rtol=rtol,
            solver=diffrax.Tsit5(),
            stabilization=rj.Baumgarte(alpha, 25.0),
        )
        return len(Watched.traced) - before

    assert traces() > 0
    assert traces() == 0
    assert traces(mass=2.0) == 0
    assert traces(stiffness=7) == 0
    assert traces(load=3.0) == 0
    assert traces(point=-0.4) == 0
    assert traces(alpha=20.0) == 0
    assert traces(rtol=1e-8) == 0
    assert traces(end=0.2) == 0
    assert traces(bodies=2) > 0


def test_the_name_of_a_body_is_no_number_but_no_program_either():
    """Bodies of equal structure are one group, whatever they are called."""
    system = rj.assemble(rj.gallery.chain(5))
    assert len(system.bodies) == 1
    assert len(system.joints) == 1


# The layout of the package.

BELOW = {
    "scene": {"scene"},
    "basis": {"basis"},
    "system": {"scene", "basis", "system"},
    "integrate": {"scene", "basis", "system", "integrate"},
    "study": {"scene", "basis", "system", "integrate", "study"},
    "gallery": {"scene", "gallery"},
    "plot": {"scene", "basis", "system", "integrate", "study", "plot"},
}


def modules():
    """Files of the package, each with the dotted path of its module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield path, parts


def imports(path, parts):
    """The modules that a file imports: of romjax without its name, others with theirs."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split("."), False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            name = node.module.split(".") if node.module else []
            if node.level:
                base = list(parts[: len(parts) - node.level])
                yield from ((base + (name or [alias.name]), True) for alias in node.names)
            else:
                yield name, False


@pytest.mark.parametrize("layer", BELOW)
def test_imports_point_one_way(layer):
    for path, parts in modules():
        if parts[0] == layer:
            for name, own in imports(path, parts):
                assert not own or name[0] in BELOW[layer], f"{path} imports {'.'.join(name)}"
                assert name[0] != "romjax", f"{path} imports its own package by name"


def test_only_plot_imports_matplotlib():
    for path, parts in modules():
        if parts[0] != "plot":
            assert all(name[0] != "matplotlib" for name, _ in imports(path, parts)), path


def test_every_public_name_is_exported_once():
    names = []
    for node in ast.parse((PACKAGE / "__init__.py").read_text()).body:
        if isinstance(node, ast.Expr):
            continue  # the docstring
        assert isinstance(node, ast.ImportFrom), "romjax/__init__.py holds exports and no code"
        for alias in node.names:
            assert alias.asname == alias.name
            names.append(alias.name)
            if node.module:
                home = sys.modules[f"romjax.{node.module}"]
                assert getattr(rj, alias.name) is getattr(home, alias.name)
    assert len(names) == len(set(names))


def test_importing_changes_no_setting_and_makes_no_array():
    """An array made at import would fix the precision before the user can choose it."""
    words = "import jax, romjax; print(jax.config.jax_enable_x64, len(jax.live_arrays()))"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "0"]
