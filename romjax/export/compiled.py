"""Systems compiled to native code: runs without JAX, many times as fast where they are small."""

from typing import Any, NamedTuple

import diffrax
import numpy as np

from ..common import compat, precision
from ..common.arrays import Vector, as_jax, as_number
from ..common.checks import check_finite
from ..integrate.default import default_method, default_stabilization, start_frequencies
from ..integrate.derived import LazyQuantities
from ..integrate.doubt import warn_of_doubt
from ..integrate.failures import raise_failure
from ..integrate.left_out import flag_left_out
from ..integrate.partition import Partitioned
from ..integrate.rodas5p import Rodas5P
from ..integrate.settings import check_numbers, check_times
from ..integrate.statistics import Statistics
from ..integrate.trajectory import Trajectory
from ..system.base import AbstractSystem, check_system
from ..system.consistent import check_start_shapes
from ..system.stabilization import Baumgarte
from ..system.start import Start
from ..system.structure import without_names
from .loops import check_runs
from .native import Asked, NativeRuns, Told
from .refuse import refuse


class _Choice(NamedTuple):
    """What a run is made with where nothing else is asked for."""

    solver: diffrax.AbstractSolver[Any]
    stabilization: Baumgarte | None
    fastest: Any
    terms: tuple[float, float]  # α and β

    @classmethod
    def of(cls, solver: Any, stabilization: Baumgarte | None, fastest: Any = None) -> "_Choice":
        terms = 0.0, 0.0
        if stabilization is not None:
            terms = float(stabilization.alpha), float(stabilization.beta)
        return cls(solver, stabilization, fastest, terms)


class CompiledModel:
    """A system compiled to native code, with its numbers; made by `romjax.compile`.

    `system`: the one that was compiled. `operations`: how many of them each function in C has.
    """

    system: AbstractSystem
    operations: dict[str, int]

    def __init__(self, system: AbstractSystem) -> None:
        check_system("compile", system)
        check_runs(system)
        self.system = system
        self._bare = without_names(system)
        self._native = NativeRuns(self._bare)
        self.operations = self._native.operations
        self._choices: dict[Any, _Choice] = {}
        self._x0 = np.concatenate([np.asarray(system.q0), np.asarray(system.v0)])

    def __repr__(self) -> str:
        return f"CompiledModel({self.system.n} coordinates)"

    def simulate(
        self,
        ts: Vector,
        *,
        q0: Vector | None = None,
        v0: Vector | None = None,
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
        `simulate(…, audit=False)`. Status, `violation` and `flags` are reported alike; arrays are
        those of NumPy.

        **Keyword arguments:**

        - `q0`, `v0`: start; that of the system unless given.
        - `solver`, `rtol`, `atol`, `dt`, `max_steps`, `throw`: as `simulate` has them.
        - `stabilization`: `Baumgarte(alpha, beta)` or None; the default of `simulate` unless given.

        Raises InputError for another method, for `Projection()`, and where JAX traces; ValueError
        and SimulationError as `simulate`.
        """
        given = rtol, rtol if atol is None else atol, dt
        times, x0 = self._checked(ts, q0, v0, given, max_steps)
        choice = self._choice(times, q0, v0, dt, solver, stabilization)
        stiff = isinstance(choice.solver, Rodas5P)
        asked = Asked(*given, max_steps, atol is None, choice.terms, stiff)
        told = self._native.run(times, x0, asked)
        run = self._trajectory(times, told, choice, asked)
        run = flag_left_out(self.system, run, np.asarray(rtol), _repeat)
        if throw and told.status:
            tolerance = precision.of(np.float64).start_tolerance
            start = as_jax(x0[: self.system.n]), as_jax(x0[self.system.n :])
            constraints = Start.of(self.system, as_jax(times[0]), *start, tolerance)
            raise_failure(self.system, run, constraints)
        warn_of_doubt(self.system, run)
        return run

    def _checked(
        self, ts: Vector, q0: Any, v0: Any, numbers: Any, max_steps: int | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The times and the start as arrays of NumPy."""
        if not compat.is_outermost():
            refuse(
                "a compiled model runs outside of JAX, and JAX traces this call",
                "call it outside of jit, vmap and grad, or use romjax.simulate within",
            )
        rtol, atol, dt = numbers
        check_numbers(max_steps, 0, rtol=rtol, atol=atol, dt=dt)
        times = np.ascontiguousarray(ts, float)
        # In NumPy's way, which takes a tenth of the time; what is wrong is told in the usual words.
        if times.ndim != 1 or not (
            len(times) > 1 and np.all(np.diff(times) > 0) and times[-1] < np.inf
        ):
            times = np.ascontiguousarray(check_times(ts, self.system.q0.dtype), float)
        if q0 is None and v0 is None:
            return times, self._x0
        q, v = check_start_shapes(self.system, q0, v0)
        check_finite("simulate", "q0", q)
        check_finite("simulate", "v0", v)
        return times, np.concatenate([np.asarray(q, float), np.asarray(v, float)])

    def _choice(
        self,
        ts: np.ndarray,
        q0: Any,
        v0: Any,
        dt: float | None,
        solver: diffrax.AbstractSolver[Any] | None,
        stabilization: Any,
    ) -> _Choice:
        """The method and the stabilization; those of the own start are remembered."""
        if solver is not None and not isinstance(solver, diffrax.Dopri8 | Rodas5P):
            refuse(
                f"compiled loops are those of diffrax.Dopri8 and romjax.Rodas5P, and not of "
                f"{type(solver).__name__}",
                "take one of them, or leave it to romjax.simulate",
            )
        if not (stabilization in ("default", None) or isinstance(stabilization, Baumgarte)):
            refuse(
                f"compiled loops hold constraints by romjax.Baumgarte, and not by "
                f"{type(stabilization).__name__}",
                "take Baumgarte(alpha, beta) or None, or leave it to romjax.simulate",
            )
        given = stabilization == "default"
        if solver is not None and not given:
            return _Choice.of(solver, stabilization)
        key = (ts[0], ts[-1], len(ts), dt, solver is None or isinstance(solver, Rodas5P), given)
        own = q0 is None and v0 is None and (solver is None)
        if own and given and key in self._choices:
            return self._choices[key]
        q, v = check_start_shapes(self.system, q0, v0)
        found = start_frequencies(self._bare, ts, q, v)
        step = None if dt is None else as_number(dt, ts.dtype)
        method = solver or default_method(self.system, as_jax(ts), step, found).solver
        held = stabilization
        if given:
            held = default_stabilization(self._bare, as_jax(ts), step, found)
        choice = _Choice.of(method, held, found.fastest)
        if own and given:
            self._choices[key] = choice
        return choice

    def _trajectory(self, ts: np.ndarray, told: Told, choice: _Choice, asked: Asked) -> Trajectory:
        """What the rows of a run are."""
        n, controlled, atol = self.system.n, asked.dt is None, asked.atol
        if asked.follow:
            atol = min(asked.rtol * min(float(np.max(np.abs(told.v))), 1.0), atol)
        parts = Partitioned.of(self.system)
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
            num_steps=np.asarray(told.steps),
            num_accepted_steps=np.asarray(told.accepted),
            num_rejected_steps=np.asarray(told.steps - told.accepted),
            rtol=np.asarray(asked.rtol) if controlled else None,
            atol=np.asarray(atol) if controlled else None,
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
            status=np.asarray(told.status),
            flags=np.asarray(told.flags),
            balance=None,
            branching=None,
            imbalance=None,
            events=None,
            dense=None,
            states=None,
            followed=(),
            coordinates=self.system.full.structure.coordinates,
            solver_parts=Partitioned.of(choice.solver),
        )


def _repeat(rom: AbstractSystem, ts: Vector, rtol: float) -> Trajectory:
    """A motion that a reduced model was made of, by the same means."""
    return CompiledModel(rom).simulate(ts, rtol=rtol, throw=False)


def compile(system: AbstractSystem) -> CompiledModel:
    """A system compiled to native code by the C compiler of this machine.

    For many runs of a small system: with up to some ten coordinates, reduced models above all, a
    run takes a tenth of the time of `simulate`, as long as its structure and its numbers stay.
    What `simulate` does beyond stepping is refused in words: contacts, events, projection,
    charts; and there are no derivatives. Nor is there an audit, so that a run that passes a
    singular position may end on another branch and not say so: look at one by `simulate` first.
    `benchmarks/native.txt` has the times.

    **Arguments:**

    - `system`: full or reduced, with the numbers that it has; other numbers need another model.

    ```python
    model = rj.compile(rom)
    run = model.simulate(ts)
    ```

    Its library goes to the folder of compiled programs. Raises InputError for what C cannot be
    made of, for more than 25 000 operations, and where there is no C compiler.
    """
    return CompiledModel(system)
