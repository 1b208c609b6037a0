"""Linear models of a mechanism, for control."""

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Complex, Float

from ..assembly.counting import counters_at_zero
from ..assembly.linear_bodies import warn_of_linear_bodies
from ..assembly.locate import locate
from ..assembly.standing import standing
from ..common.arrays import Vector, as_array, concrete
from ..common.checks import as_time, check_finite, check_kind, check_shape
from ..common.errors import InputError
from ..compiling.program import program_once
from ..measure.quantity import AbstractQuantity, Coordinate
from ..scene.coordinate import INTEGRAL
from ..scene.effect.base import AbstractMarkerEffect
from ..scene.signal import Constant, is_signal, signals_of
from ..system.base import AbstractSystem, check_system, refusing_accelerations
from .independent import independent_constraints
from .tangent import refuse_clocks, refuse_slips, tangent_of

# What acts: an effect of unit strength, or generalized forces of physical coordinates.
Input = AbstractMarkerEffect | Callable[..., Array]
# What is measured: a label of a coordinate, a quantity, or a function of (t, q, v).
Output = str | AbstractQuantity | Callable[..., Array]
# The share of a rate that sums of others leave by rounding.
_SUM = 1e-8


class LinearModel(eqx.Module):
    """ẋ = A x + B u, y = C x + D u: deviations from a state, in minimal coordinates.

    - `A` (s, s), `B` (s, inputs), `C` (outputs, s), `D` (outputs, inputs).
    - `states`, `inputs`, `outputs`: their names. States are coordinates ζ of the tangent space and
      their rates, then the first-order states of effects, such as "pid.integral", but for those
      that only follow others; `shapes` (n, d): what each ζ is in the system's coordinates.
    """

    A: Float[Array, "s s"]
    B: Float[Array, "s inputs"]
    C: Float[Array, "outputs s"]
    D: Float[Array, "outputs inputs"]
    shapes: Float[Array, "n d"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def frequency_response(self, omega: Vector) -> Complex[Array, "k outputs inputs"]:
        """C (iω − A)⁻¹ B + D at the angular frequencies `omega` (k,) [rad/s]."""
        unit = jnp.eye(len(self.A))

        def at(omega: Array) -> Array:
            states: Array = jnp.linalg.solve(1j * omega * unit - self.A, self.B + 0j)
            return self.C @ states + self.D

        response: Complex[Array, "k outputs inputs"] = jax.vmap(at)(as_array(omega))
        return response


def linearize(
    system: AbstractSystem,
    inputs: Mapping[str, Input],
    outputs: Mapping[str, Output] | Sequence[str],
    *,
    at: Vector | None = None,
    v: Vector | None = None,
    t: ArrayLike = 0.0,
) -> LinearModel:
    """The linear model of a mechanism about a state, on the tangent space of its constraints.

    **Arguments:**

    - `system`: full, reduced or a `CustomSystem`.
    - `inputs`: by name, effects as they act with unit strength, such as
      `{"push": rj.Force(cart.at(), (1, 0), rj.Constant(1.0))}`, or functions (t, q, v) of physical
      coordinates that return generalized forces (n,). Of an effect with a signal it is what the
      signal changes, such as the gain of a servo, whose feedback is a part of the scene. Of an
      angle that counts full turns in space, no turn is counted.
    - `outputs`: labels of physical coordinates, "cart.x", and of their rates, "cart.x'"; or by
      name, such labels, quantities of `romjax.quantity`, or functions (t, q, v) of physical
      coordinates that return a number. None of these knows the inputs, so that D is zero, and
      `system.acceleration` is refused in them: about a state at rest, an acceleration has the rows
      C A and C B of its rate, "cart.x'".
    - `at`, `v` (n,): the state, that of the system at rest at its start unless given, such as
      `equilibrium(system)`. Unless `v` is given, such as `v=system.v0` at the start, drives stand
      where they are at time `t` [s].

    A state of an effect whose rate is a sum of other rates would be an uncontrollable zero of A,
    for which no regulator exists. It is left out and follows the others as it does from the state
    on: the integral part of a controller without integral gain does not change, and pressures
    behind a shut valve are a spring. While JAX traces, it is unknown which these are, and all are
    states.

    Differentiable and batchable. Raises InputError for a wrong shape or an unknown name, for a
    state that the joints contradict, for an input whose signal changes with time, for accelerations
    as outputs beside inputs, and for controllers with a clock, whose laws no equation of motion
    has.
    """
    check_system("linearize", system)
    refuse_clocks("linearize", system)
    q = system.q0 if at is None else as_array(at)
    check_shape("linearize", "at", q, (system.n,))
    check_finite("linearize", "at", q)
    time = as_time("linearize", t, q.dtype)
    if v is None:
        system = standing(system, time)
    velocity = system.structure.at_rest(q) if v is None else as_array(v)
    check_shape("linearize", "v", velocity, (system.n,))
    check_finite("linearize", "v", velocity)
    refuse_slips("linearize", system, v is not None)
    named = outputs if isinstance(outputs, Mapping) else {label: label for label in outputs}
    kinds, remedy = (AbstractMarkerEffect, Callable), "an effect or a function of t, q, v"
    for name, what in inputs.items():
        check_kind("linearize", f"input {name!r}", what, kinds, remedy)
    independent, q = independent_constraints("linearize", system, time, q, velocity)
    a, b, c, d, shapes = _matrices(
        system, time, q, velocity, independent, tuple(inputs.values()), tuple(named.values())
    )
    warn_of_linear_bodies("linearize", system, time, q, velocity)
    names = [f"z{i + 1}" for i in range(shapes.shape[1])]
    known = [system.structure.coordinates[i] for i in system.structure.states]
    own = [f"{each.owner}.{each.name.removeprefix(INTEGRAL)}" for each in known]
    states = (*names, *(f"{name}'" for name in names), *own)
    rates, pushed = concrete(a), concrete(b)
    if own and rates is not None and pushed is not None:
        kept, follow = _independent_states(rates, pushed, len(own))
        if len(kept) < len(states):
            a, b, c = jnp.asarray(rates[kept] @ follow), jnp.asarray(pushed[kept]), c @ follow
            states = tuple(states[i] for i in kept)
    return LinearModel(a, b, c, d, shapes, states, tuple(inputs), tuple(named))


def _independent_states(a: np.ndarray, b: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The numbers r of the states (k,) without those that only follow others, which may be among
    the last `count`, the states of effects, and T (s, k) of how all follow them, x = T x_r.

    As ζ̇ = η, a rate ṡ = Σ c ṡ_k + w η is a change s = Σ c s_k + w ζ.
    """
    first = len(a) - count
    own, half = a[first:], first // 2
    by_speed = own[:, half:first]
    rates = np.concatenate([own[:, :half], own[:, first:], b[first:]], axis=1)
    # Of one size in each column and row, since a pressure and an angle differ by any factor.
    scaled = rates / _sizes(rates, 0)
    lengths = _sizes(scaled, 1)
    scaled = scaled / lengths
    chosen, follow = list[int](), np.eye(len(a), dtype=a.dtype)
    for i in range(count):
        weights = np.linalg.lstsq(scaled[chosen].T, scaled[i], rcond=None)[0]
        if np.max(np.abs(scaled[i] - weights @ scaled[chosen])) > _SUM:
            chosen.append(i)
            continue
        sums = lengths[i] * weights / lengths[chosen, 0]
        follow[first + i] = 0.0
        follow[first + i, first + np.array(chosen, int)] = sums
        follow[first + i, :half] = by_speed[i] - sums @ by_speed[chosen]
    kept = np.r_[:first, first + np.array(chosen, int)]
    return kept, follow[:, kept]


def _sizes(x: np.ndarray, axis: int) -> np.ndarray:
    largest = np.max(np.abs(x), axis=axis, keepdims=True, initial=0.0)
    return np.where(largest > 0, largest, 1.0)


@program_once
def _matrices(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    independent: int,
    inputs: tuple[Input, ...],
    outputs: tuple[Output, ...],
) -> tuple[Array, Array, Array, Array, Array]:
    """A, B, C, D, and the basis of the tangent space."""
    tangent = tangent_of(system, t, q, v, independent)
    basis, d = tangent.basis, tangent.basis.shape[1]

    def measured(q: Array, v: Array) -> Array:
        state = system.state(t, q, v)
        values = values_of("linearize", system.full, outputs, t, state.q, state.v, bool(inputs))
        return jnp.stack(values) if values else jnp.zeros(0, q.dtype)

    by_q, by_v = jax.jacfwd(measured, argnums=(0, 1))(q, v)
    c = jnp.concatenate([by_q @ basis + by_v @ tangent.correction, by_v @ basis], axis=1)

    state = system.state(t, q, v)
    onto = jax.jacfwd(lambda q: system.state(t, q, v).q)(q)
    forces = [force_of("linearize", system, what, t, state.q, state.v) for what in inputs]
    physical = jnp.stack(forces, axis=1) if forces else jnp.zeros((len(onto), 0), q.dtype)
    pushed = state.kkt().solve(onto.T @ physical, jnp.zeros((system.m, len(forces)), q.dtype))[0]
    b = jnp.concatenate([jnp.zeros((d, len(forces)), q.dtype), tangent.dual @ pushed])
    # Nothing depends on the integrals of states, which are the last of the directions.
    count = len(system.structure.states)
    kept = np.r_[: d - count, d : 2 * d]
    direct = jnp.zeros((len(outputs), len(forces)), q.dtype)
    return tangent.matrix[kept][:, kept], b[kept], c[:, kept], direct, basis[:, : d - count]


def values_of(
    owner: str,
    full: AbstractSystem,
    outputs: Iterable[Output],
    t: Array,
    q: Array,
    v: Array,
    pushed: bool,
) -> list[Array]:
    """The values of outputs at a physical state of the full system, which inputs push or not.

    Raises InputError, beginning with `owner`, for accelerations of one that is `pushed`.
    """
    with refusing_accelerations(owner) if pushed else contextlib.nullcontext():
        return [_value_of(full, what, t, q, v) for what in outputs]


def _value_of(full: AbstractSystem, what: Output, t: Array, q: Array, v: Array) -> Array:
    if isinstance(what, str):
        what = Coordinate(what)
    if isinstance(what, AbstractQuantity):
        return what.value(full, t, q, v)
    return jnp.asarray(what(t, q, v))


def force_of(
    owner: str, system: AbstractSystem, what: Input, t: Array, q: Array, v: Array
) -> Array:
    """The generalized force (n,) of an input on the physical coordinates; `owner`: whose input it
    is, as messages begin.

    Raises InputError for another shape, for an effect with states, and for a signal that changes.
    """
    if not isinstance(what, AbstractMarkerEffect):
        given = jnp.asarray(what(t, q, v))
        check_shape(owner, "a force of inputs", given, q.shape)
        return given
    if what.states:
        raise InputError(
            f"{owner}: input {what.label()} has states of its own; put it into the scene, and "
            "give the effect that it drives as an input."
        )
    without = _without_signals(owner, what)
    located: Any = locate(f"{owner}: input {what.label()}", system, what.markers)
    count, motion = len(what.markers), located.motion(q, v)
    each, twists = [
        [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(count)] for stacked in motion
    ]
    counters = counters_at_zero(what, q.dtype)
    sides, rates = (*each, *counters[0]), (*twists, *counters[1])

    def wrenches(what: AbstractMarkerEffect) -> Any:
        every = what.wrenches(t, sides, rates if what.needs_twists else ())
        return jax.tree.map(lambda *x: jnp.stack(x), *every[:count])

    acting = wrenches(what)
    if without is not None:
        # The feedback of a servo acts whatever is asked of it, and is no part of the input.
        acting = jax.tree.map(jnp.subtract, acting, wrenches(without))
    force: Array = located.pull_back(q, acting)
    return force


def _without_signals(owner: str, what: AbstractMarkerEffect) -> AbstractMarkerEffect | None:
    """The effect whose signals are zero; None of one that has none.

    Raises InputError for signals that change with time, whose strength is not one number.
    """
    signals = signals_of(what)
    if not signals:
        return None
    for signal in signals:
        if not signal.is_constant:
            raise InputError(
                f"{owner}: input {what.label()} follows a {type(signal).__name__}, but an input "
                "is the effect at unit strength, whatever it does in the scene; give "
                "romjax.Constant(1.0) as its signal."
            )
    zero: AbstractMarkerEffect = jax.tree.map(
        lambda x: Constant(0 * x(jnp.zeros(()))) if is_signal(x) else x, what, is_leaf=is_signal
    )
    return zero
