"""Systems compiled to native code: runs without JAX, many times as fast where they are small."""

from collections.abc import Callable, Mapping
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from ..common import compat, precision
from ..common.arrays import Vector, as_jax
from ..common.checks import check_finite, check_shape, unknown_name
from ..common.compat import is_traced
from ..common.partition import Partitioned
from ..integrate.derived import LazyQuantities
from ..integrate.doubt import warn_of_doubt
from ..integrate.failures import raise_failure
from ..integrate.left_out import flag_left_out
from ..integrate.settings import check_numbers, check_times
from ..integrate.statistics import Statistics
from ..integrate.trajectory import Trajectory
from ..system.base import AbstractSystem
from ..system.consistent import check_start_shapes
from ..system.start import Start
from ..system.structure import without_names
from .choices import Choice, Choices
from .inside import Inside, threads
from .leaving import Model, model_of
from .loops import check_runs
from .native import Asked, NativeRuns, Told
from .refuse import refuse


class CompiledModel:
    """A system compiled to native code; made by `romjax.compile` of the `model` that leaves.

    `system`: the one that was compiled, with the numbers of its `parameters`. `operations`: how
    many of them each function in C has.
    """

    system: AbstractSystem
    parameters: Mapping[str, float]
    operations: dict[str, int]

    def __init__(self, model: Model) -> None:
        self.system, self.parameters = model.nominal, model.parameters
        self._model = model
        self._native = NativeRuns(
            model if model.parameters else model._replace(nominal=without_names(model.nominal))
        )
        self.operations = self._native.operations
        self._choices = Choices(model.nominal, self._native.beginning)
        self._inside: dict[bool, Inside] = {}
        self._coordinates = model.nominal.full.structure.coordinates

    def __repr__(self) -> str:
        return f"CompiledModel({self.system.n} coordinates)"

    def simulate(
        self,
        ts: Vector,
        *,
        q0: Vector | None = None,
        v0: Vector | None = None,
        parameters: Mapping[str, ArrayLike] | None = None,
        solver: diffrax.AbstractSolver[Any] | None = None,
        rtol: float = 1e-6,
        atol: float | None = None,
        dt: float | None = None,
        stabilization: Any = "default",
        max_steps: int | None = 100_000,
        throw: bool = True,
    ) -> Trajectory:
        """The motion at the times `ts`, by the steps that `romjax.simulate` takes.

        The arguments are those of `romjax.simulate`. Methods are `diffrax.Dopri8()` and
        `Rodas5P()`. The balance of energy is not drawn up, and no run is repeated: it is
        `simulate(…, audit=False)`. Status, `violation` and `flags` are reported alike.

        Within `jax.jit` and `jax.vmap` it is a part of the program, whose lanes share the
        processors that this process may use; in forward mode there are derivatives by the start and
        the parameters, of steps whose lengths are held. Method and stabilization are then
        those that suit the start and the parameters that the model was compiled with.

        **Keyword arguments:**

        - `q0`, `v0`: start; that of the system unless given, which follows its parameters.
        - `parameters`: other numbers of those that it was compiled with, by name.
        - `solver`, `rtol`, `atol`, `dt`, `max_steps`, `throw`: as `simulate` has them.
        - `stabilization`: `Baumgarte(alpha, beta)` or None; the default of `simulate` unless given.

        Raises InputError for another method, for `Projection()`, an unknown parameter, tolerances
        or, without a method and a stabilization, times that JAX traces, and in reverse mode;
        ValueError and SimulationError as `simulate`.
        """
        given = rtol, rtol if atol is None else atol, dt
        times = self._times(ts, given, max_steps)
        is_inside = parameters is not None or not compat.is_outermost()
        own = (None, None) if is_inside else (q0, v0)
        choice = self._choices.of(times, *own, dt, solver, stabilization)
        asked = Asked(*given, max_steps, atol is None, choice.terms, choice.stiff)
        start = self._start(q0, v0)
        system = self.system
        if is_inside:
            p = self._stacked(parameters or {})
            system = self._model.system(p)
            told = self._run_inside(system, times, (q0 is None, v0 is None), start, p, asked)
        else:
            told = self._native.run(times, None if start is None else np.concatenate(start), asked)
        run = self._trajectory(system, times, told, choice, asked)
        run = flag_left_out(system, run, np.asarray(rtol), _repeat)
        if throw and not (not is_traced(told.status) and told.status == 0):
            run = raise_failure(system, run, _constraints(system, times, told))
        warn_of_doubt(system, run)
        return run

    def _times(self, ts: Vector, numbers: Any, max_steps: int | None) -> Any:
        """The times as an array of NumPy, or of JAX where it traces them."""
        rtol, atol, dt = numbers
        if any(is_traced(x) for x in numbers):
            refuse("JAX traces the tolerances or the step of a compiled run", "give numbers")
        check_numbers(max_steps, 0, rtol=rtol, atol=atol, dt=dt)
        if is_traced(ts):
            return jnp.asarray(ts, float)
        times = np.ascontiguousarray(ts, float)
        # In NumPy's way, which takes a tenth of the time; what is wrong is told in the usual words.
        if times.ndim != 1 or not (
            len(times) > 1 and (times[1:] > times[:-1]).all() and times[-1] < np.inf
        ):
            times = np.ascontiguousarray(check_times("simulate", ts, self.system.q0.dtype), float)
        return times

    def _start(self, q0: Any, v0: Any) -> tuple[Any, Any] | None:
        """The start that is given, filled up from the own one; None where none is."""
        if q0 is None and v0 is None:
            return None
        q, v = check_start_shapes(self.system, q0, v0)
        check_finite("simulate", "q0", q)
        check_finite("simulate", "v0", v)
        return q, v

    def _stacked(self, parameters: Mapping[str, ArrayLike]) -> Array:
        """All parameters in order, those of the model where there are no others."""
        for name in parameters:
            if name not in self.parameters:
                raise unknown_name("compile", "parameter", name, tuple(self.parameters))
        values = {**self.parameters, **parameters}
        each = [jnp.asarray(value, float) for value in values.values()]
        for name, value in zip(values, each, strict=True):
            check_shape("simulate", f"parameter {name}", value, ())
        return jnp.stack(each) if each else jnp.zeros(0)

    def _run_inside(
        self,
        system: AbstractSystem,
        ts: Any,
        own: tuple[bool, bool],
        start: tuple[Any, Any] | None,
        p: Array,
        asked: Asked,
    ) -> Told:
        """A run that is a part of a program of JAX."""
        if asked.stiff not in self._inside:
            self._inside[asked.stiff] = Inside(self._native, asked.stiff)
        numbers, counts = asked.numbers(own[0] + 2 * own[1])
        x0 = jnp.zeros(2 * system.n) if start is None else jnp.concatenate(start)
        given = jnp.concatenate([jnp.asarray(asked.terms), p])
        rows = self._inside[asked.stiff].run(
            x0, given, jnp.asarray(ts), jnp.asarray(numbers), jnp.asarray([*counts, threads()])
        )
        steps, accepted, status, flags = (rows.told[i] for i in range(4))
        q, v, x, violation, _ = rows
        flags |= self._native.judged(system, ts, q, v, x, violation, asked)
        return Told(steps, accepted, status, flags, q, v, x, violation)

    def _trajectory(
        self, system: AbstractSystem, ts: Any, told: Told, choice: Choice, asked: Asked
    ) -> Trajectory:
        """Return the rows of a run as a trajectory."""
        n, controlled = told.x.shape[1] // 2, asked.dt is None
        atol: Any = np.asarray(asked.atol)
        if asked.follow:
            size, inside = abs(told.v).max(), is_traced(told.v)
            size = jnp.minimum(size, 1.0) if inside else min(size, 1.0)
            atol = asked.rtol * size  # which is no more than asked.atol
        parts = Partitioned.of(system)
        demand = compat.make_module(
            LazyQuantities,
            parts=parts,
            t=ts,
            q=told.x[:, :n],
            v=told.x[:, n:],
            chart=None,
            stabilization=choice.stabilization,
        )
        statistics = compat.make_module(
            Statistics,
            num_steps=told.steps,
            num_accepted_steps=told.accepted,
            num_rejected_steps=told.steps - told.accepted,
            rtol=np.asarray(asked.rtol) if controlled else None,
            atol=atol if controlled else None,
            fastest_frequency=choice.fastest,
            stabilization=choice.stabilization,
        )
        return compat.make_module(
            Trajectory,
            t=ts,
            q=told.q,
            v=told.v,
            violation=told.violation,
            derived=demand,
            stats=statistics,
            status=told.status,
            flags=told.flags,
            balance=None,
            branching=None,
            imbalance=None,
            events=None,
            dense=None,
            states=None,
            followed=(),
            coordinates=self._coordinates,
            solver_parts=Partitioned.of(choice.solver),
        )


def _constraints(system: AbstractSystem, ts: Any, told: Told) -> Any:
    """The constraints at the start of one run, for what is said of it; None where JAX traces it."""
    if is_traced(told.status):
        return None
    q, v = told.x[0, : system.n], told.x[0, system.n :]
    if not np.all(np.isfinite(q)):
        q, v = system.q0, system.v0
    tolerance = precision.of(np.float64).start_tolerance
    return Start.of(system, as_jax(ts[0]), as_jax(q), as_jax(v), tolerance)


def _repeat(
    rom: AbstractSystem,
    ts: Vector,
    rtol: float,
    q0: Vector | None = None,
    v0: Vector | None = None,
) -> Trajectory:
    """A motion that a reduced model was made of, by the same means."""
    return compile(rom).simulate(ts, rtol=rtol, q0=q0, v0=v0, throw=False)


def compile(
    system: AbstractSystem | Callable[..., AbstractSystem],
    parameters: Mapping[str, float] | None = None,
) -> CompiledModel:
    """A system compiled to native code by the C compiler of this machine.

    For many runs of a small system: with up to some ten coordinates, reduced models above all, a
    run takes a tenth of the time of `simulate`, as long as its structure stays.
    What `simulate` does beyond stepping is refused in words: contacts, events, projection,
    charts. Nor is there an audit, so that a run that passes a singular position may end on another
    branch and not say so: look at one by `simulate` first. `benchmarks/native.txt` has the times.

    **Arguments:**

    - `system`: full or reduced, with the numbers that it has; or a function of the `parameters` by
      name that makes one, always of the same structure.
    - `parameters`: those numbers of it that runs may change, with the ones that they have
      otherwise.

    ```python
    model = rj.compile(rom)
    run = model.simulate(ts)
    ```

    Within programs of JAX, `simulate` of the model has derivatives in forward mode, and lanes of
    `jax.vmap` share the processors; so `fit`, `sweep` and `log_likelihood` take runs of it. Its
    libraries go to the folder of compiled programs. Raises InputError for what C cannot be made of,
    for more than 25 000 operations, and where there is no C compiler.
    """
    model = model_of("compile", system, {}, None, parameters or {}, None, "model")
    check_runs(model.nominal)
    return CompiledModel(model)
