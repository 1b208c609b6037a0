"""A system with the inputs, outputs and parameters that leave with it."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..analysis.linearization import Input, Output, force_of, values_of
from ..assembly.assembled import controllers_of
from ..common.checks import check_kind
from ..common.errors import InputError
from ..integrate.default import default_stabilization, start_frequencies
from ..measure.quantity import AbstractQuantity
from ..scene.effect.base import AbstractMarkerEffect
from ..system.base import AbstractSystem, check_system
from ..system.dynamics import Linearization, linearize, solve_with
from ..system.frequencies import Frequencies
from ..system.reduced import reduced_of
from ..system.stabilization import Baumgarte
from ..system.structure import without_names
from .refuse import refuse

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Where nothing is known of the runs to come, they are of one second and a hundred outputs.
TIMES = np.linspace(0.0, 1.0, 101)


class Model(NamedTuple):
    """The functions of (t, x, u, p) that leave: time, state (q, v), inputs and parameters.

    `verb`: the call by which they leave, as messages begin.
    """

    make: Callable[..., AbstractSystem]
    nominal: AbstractSystem
    inputs: Mapping[str, Input]
    outputs: Mapping[str, Output]
    parameters: Mapping[str, float]
    stabilization: Baumgarte | None
    verb: str

    def system(self, p: Array) -> AbstractSystem:
        """The system of some parameters."""
        if not self.parameters:
            return self.nominal
        return self.make(**{name: p[i] for i, name in enumerate(self.parameters)})

    def at(self, x: Array, p: Array) -> tuple[AbstractSystem, Array, Array]:
        """The system of some parameters, with q and v of a state."""
        n = self.nominal.n
        return self.system(p), x[:n], x[n:]

    def applied(self, system: AbstractSystem, u: Array) -> Callable[..., Array] | None:
        """The generalized force of the inputs as a function of (t, q, v); None without any."""
        if not self.inputs:
            return None

        def force(t: Array, q: Array, v: Array) -> Array:
            state = system.state(t, q, v)
            each = [
                force_of(self.verb, system, what, t, state.q, state.v)
                for what in self.inputs.values()
            ]
            total: Array = jnp.sum(u[:, None] * jnp.stack(each), axis=0)
            if system.full is not system:
                total = jax.vjp(lambda q: system.state(t, q, v).q, q)[1](total)[0]
            return total

        return force

    def rates(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The rates of the state, (v, a)."""
        system, q, v = self.at(x, p)
        held, applied = self.stabilization, self.applied(system, u)
        return jnp.concatenate([v, solve_with(system, t, q, v, held, applied).acceleration])

    def linear(self, t: Array, x: Array, u: Array, p: Array) -> Linearization:
        """The acceleration and its derivatives."""
        system, q, v = self.at(x, p)
        return linearize(system, t, q, v, self.stabilization, self.applied(system, u))

    def measured(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The outputs."""
        del u
        system, q, v = self.at(x, p)
        state = system.state(t, q, v)
        given = self.verb, system.full, self.outputs.values(), t, state.q, state.v
        values = values_of(*given, bool(self.inputs))
        return jnp.stack([jnp.reshape(x, ()) for x in values]) if values else x[:0]

    def lifted(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The physical coordinates and their rates."""
        del u
        system, q, v = self.at(x, p)
        state = system.state(t, q, v)
        return jnp.concatenate([state.q, state.v])

    @property
    def time(self) -> float:
        """When the start of the nominal system holds [s]: at zero, unless a reduced model has been
        given another time.
        """
        rom = reduced_of(self.nominal)
        return 0.0 if rom is None else float(rom.time)

    def start(self) -> np.ndarray:
        """The state at the start of the nominal system."""
        return np.concatenate([np.asarray(self.nominal.q0), np.asarray(self.nominal.v0)])


def frequencies_of(system: AbstractSystem) -> Frequencies:
    """The frequencies at the start of runs of which nothing is known."""
    return start_frequencies(without_names(system), TIMES, system.q0, system.v0)


def model_of(
    verb: str,
    system: Any,
    inputs: Mapping[str, Input],
    outputs: Mapping[str, Output] | Sequence[str] | None,
    parameters: Mapping[str, float],
    stabilization: Any,
    name: str,
) -> Model:
    """The model of a `verb`; raise InputError for wrong arguments."""
    if not _NAME.fullmatch(name):
        raise InputError(f"{verb}: name={name!r}; give letters, digits and _, a letter first.")
    for key, value in parameters.items():
        if np.ndim(value) or not np.isfinite(value):
            raise InputError(f"{verb}: parameter {key}={value}; give a finite number.")
    makes = callable(system)
    if parameters and not makes:
        refuse(
            f"parameters {', '.join(parameters)} of a system whose numbers are frozen",
            "give a function of these parameters that makes the system",
        )
    nominal = system(**parameters) if makes else system
    check_system(verb, nominal)
    if controllers_of(nominal):
        refuse(
            "sampled controllers act between the steps, which equations of motion know nothing of",
            "export the scene without them, with what they drive as inputs",
        )
    acting, measured = (AbstractMarkerEffect, Callable), (str, AbstractQuantity, Callable)
    for key, force in inputs.items():
        check_kind(verb, f"input {key!r}", force, acting, "an effect or a function of t, q, v")
    if outputs is None:
        outputs = [coordinate.label for coordinate in nominal.full.structure.coordinates]
    named = outputs if isinstance(outputs, Mapping) else {label: label for label in outputs}
    if not named:
        raise InputError(f"{verb}: outputs are empty; leave them out for all coordinates.")
    for key, what in named.items():
        remedy = "a label, a quantity or a function"
        check_kind(verb, f"output {key!r}", what, measured, remedy)
    if stabilization == "default":
        frequencies = frequencies_of(nominal)
        stabilization = default_stabilization(
            without_names(nominal), jnp.asarray(TIMES), None, frequencies
        )
    if not isinstance(stabilization, Baumgarte | None):
        refuse(
            f"{type(stabilization).__name__} is a change of the state between steps",
            "take romjax.Baumgarte(alpha, beta) or None",
        )
    return Model(system, nominal, inputs, named, parameters, stabilization, verb)
