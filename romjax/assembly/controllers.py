"""Controllers with a clock, among the parts of a system."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.errors import SceneError
from ..scene.effect.sampled import Labelled, Sampled
from ..scene.scene import Scene
from ..scene.signal import Held
from ..system.dynamics import solve

T = TypeVar("T")


class Controller(eqx.Module):
    """A controller of a scene, and the `columns` of its numbers among the velocities."""

    sampled: Sampled
    columns: tuple[int, ...] = eqx.field(static=True)

    def held(self, v: Float[Array, " n"]) -> dict[str, Array]:
        """The values of its signals, by their names."""
        own = self.columns[len(self.sampled.state) :]
        return {name: v[i] for name, i in zip(self.sampled.sets, own, strict=True)}

    def ticked(
        self, system: Any, t: Array, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The positions and velocities of a full or reduced system after a tick, if t is one."""
        # A model of fewer coordinates has the same states, elsewhere.
        places = dict(zip(system.full.structure.states, system.structure.states, strict=True))
        columns = jnp.array([places[column] for column in self.columns])

        def tick(q: Array, v: Array) -> tuple[Array, Array]:
            # The step ends at a constant time. A tick moves with its period, so that it has the
            # derivatives of a state on the way there, and the state after it those of the way back.
            late = self.sampled.tick_near(t) - t
            late -= jax.lax.stop_gradient(late)
            now, q, v = _carried(system, t, q, v, late)
            measured = [jnp.asarray(what(system, now, q, v)) for what in self.sampled.measured]
            values = jnp.stack(measured) if measured else jnp.zeros(0, v.dtype)
            after = v.at[columns].set(self.sampled.ticked(now, v[columns], values))
            return _carried(system, now, q, after, -late)[1:]

        is_tick = self.sampled.is_tick(t)
        state: tuple[Array, Array] = jax.lax.cond(is_tick, tick, lambda *state: state, q, v)
        return state


def _carried(
    system: Any, t: Array, q: Float[Array, " n"], v: Float[Array, " n"], zero: Array
) -> tuple[Array, Float[Array, " n"], Float[Array, " n"]]:
    """Time, positions and velocities as they are, with the first and second derivatives of the
    motion after the time `zero`, by the midpoint rule.
    """

    def rate(a: Array, share: Array) -> tuple[Array, Array]:
        part = share * zero
        a = solve(system, t + part, q + part * v, v + part * a, None).acceleration
        return a, a

    # A loop, so that the acceleration is compiled once.
    _, (a, middle) = jax.lax.scan(rate, jnp.zeros_like(v), jnp.array([0.0, 0.5], v.dtype))
    return t + zero, q + zero * v + 0.5 * zero**2 * a, v + zero * middle


def told(controllers: Sequence[Controller], parts: T, v: Float[Array, " n"]) -> T:
    """The parts with the values that held signals have now."""
    values = {name: value for each in controllers for name, value in each.held(v).items()}

    def put(x: Any) -> Any:
        if not isinstance(x, Held):
            return x
        return dataclasses.replace(x, value=jnp.broadcast_to(values[x.output], x.value.shape))

    parts = jax.tree.map(put, parts, is_leaf=_is_held)
    return parts


def check_held(scene: Scene) -> None:
    """Raise SceneError for held signals that nobody sets, or that two controllers do, and for
    joints that follow one: a motion that is held jumps.
    """
    names = [name for e in scene.effects if isinstance(e, Sampled) for name in e.sets]
    parts: list[Any] = [*scene.joints, *scene.effects]
    for part in parts:
        for signal in filter(_is_held, jax.tree.leaves(part, is_leaf=_is_held)):
            if part in scene.joints:
                raise SceneError(
                    f"'{part.label()}': a joint cannot follow Held('{signal.output}'), which jumps "
                    "at each tick; drive it by an effect, such as an Actuator."
                )
            if names.count(signal.output) != 1:
                raise SceneError(
                    f"'{part.label()}': {names.count(signal.output)} controllers set the signal "
                    f"'{signal.output}'; signals that are set: {', '.join(names) or 'none'}."
                )


def check_measured(controllers: Sequence[Controller], labels: tuple[str, ...]) -> None:
    """Raise SceneError for a controller that measures what none of the `labels` of the coordinates
    says.
    """
    for controller in controllers:
        for what in controller.sampled.measured:
            if isinstance(what, Labelled):
                what.place(labels)


def _is_held(x: Any) -> bool:
    return isinstance(x, Held)
