"""Traced programs, and what is in them."""

import re

import jax
import jax.numpy as jnp
from jax.extend import core

import romjax as rj
from romjax.compiling.program import program_once


def kept(function):
    """A function of pytrees, compiled for the arrays in them. As long as the sources stay, the next
    run of the tests reads it from disk without tracing.

    Numbers are to be given as arrays; and of a function within another one nobody knows what it
    holds besides its arguments, so that it is traced.
    """
    return program_once(function)


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


def primitives_in(traced) -> list[str]:
    """The primitives of a traced program, in all that are nested in it."""
    return [e.primitive.name for program in programs(traced) for e in program.eqns]


def primitives(function, *arguments) -> list[str]:
    """The primitives of a function, in all nested programs."""
    return primitives_in(jax.make_jaxpr(function)(*arguments).jaxpr)


def force(scene) -> list[str]:
    system = rj.assemble(scene)
    return primitives(system.force, 0.0, system.q0, system.v0)


def mass(scene) -> list[str]:
    system = rj.assemble(scene)
    return primitives(system.mass, system.q0)


def reads(traced, place) -> bool:
    """Whether any equation of a traced program reads its argument at a place."""
    used = {id(x) for program in programs(traced) for e in program.eqns for x in e.invars}
    return id(traced.invars[place]) in used


def needs(traced, place) -> bool:
    """Whether the argument at a place has any effect on what a traced program computes."""
    needed = {id(x) for x in traced.outvars}
    for equation in reversed(traced.eqns):
        if any(id(x) in needed for x in equation.outvars):
            needed |= {id(x) for x in equation.invars}
    return id(traced.invars[place]) in needed


def touches(function, system, place) -> bool:
    """Whether any equation of a function of t, q, v reads the argument at a place."""
    return reads(jax.make_jaxpr(function)(0.0, system.q0, system.v0).jaxpr, place)


def uses(function, system, place) -> bool:
    """Whether the argument at a place has any effect on what a function of t, q, v computes."""
    return needs(jax.make_jaxpr(function)(0.0, system.q0, system.v0).jaxpr, place)


def uses_time(function, system) -> bool:
    return uses(function, system, 0)


def uses_velocities(scene) -> bool:
    system = rj.assemble(scene)
    return uses(system.force, system, 2)


# Programs, and operations of JAX outside of them, that this process has compiled.
_compiled = [0, 0]


def listen() -> None:
    """Count from now on what is compiled."""
    jax.monitoring.register_event_duration_secs_listener(_count)


def _count(event, seconds, fun_name="", **_):
    if event.endswith("backend_compile_duration"):
        name = re.sub(r"^jit[(_]_?|\)$", "", fun_name)
        _compiled[hasattr(jax.lax, name) or hasattr(jnp, name)] += 1


def compiled() -> tuple[int, int]:
    """How many programs and operations have been."""
    programs, operations = _compiled
    return programs, operations


def compilations(action) -> int:
    """How many of both XLA compiles in an action."""
    before = sum(compiled())
    action()
    return sum(compiled()) - before
