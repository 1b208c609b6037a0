"""A reduced run with its error: the bar of every answer that it gives."""

import dataclasses
from typing import Any, Literal, TypeVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common import precision
from ...common.arrays import concrete, pick
from ...common.checks import check_kind, check_one_run, unknown_name
from ...common.compat import is_outermost
from ...common.errors import InputError, ReductionError
from ...common.identity_cache import IdentityCache
from ...compiling.program import program
from ...integrate.derived import EagerQuantities
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem, beginning_at, check_system
from ...system.reduced import AbstractReducedSystem, reduced_of
from ...system.start import Start
from ...system.structure import without_names
from .residual import by_residual
from .richer import Finer, finer_of, twice_capped
from .richer_run import simulated, told, told_by

# A run starts where a model starts that is as near as rounding allows.
_SAME = 1e-9

# Vibrations of capped modes carry joint forces, and a cap leaves their start out. So does any other
# cap, and so does the system without one from that start (measured: 0.00 to 0.15 of the error).
_BLIND = "joint forces: for these take by=full, the full system from its own start"

Physical = Float[Array, " n"]
State = tuple[Physical, Physical]
S = TypeVar("S", bound=AbstractSystem)


def corrected(
    rom: AbstractSystem,
    run: Trajectory,
    by: AbstractSystem | Literal["residual"] | None = None,
) -> Trajectory:
    """The run of a reduced model with its error: the same motion by a model that knows more.

    It is a run like any other, from the true start, so that what the basis cannot hold of that
    counts. `compare(corrected, run).error` is the error of the norm, J(corrected) − J(run) that of
    any quantity J: measure, joint forces, energies of both. `Trajectory.summary` says how large it
    is, and beyond 5 % that the run is not to be used, which `Flag.ESTIMATE` says as well.

    **Arguments:**

    - `rom`: the model that was simulated, reduced or capped; `run`: at least one motion of it,
      from the start of its full system or from another one.
    - `by`: a model of the same mechanism that knows more; unless given, one of a richer kind: local
      with the modes for each body that it takes to have more freedoms, and one to spare, beside a
      model of all coordinates, two more modes in each body beside a local one, twice the cap, else
      twice the rank and two more; beside it the next rank where it has no more freedoms, and the
      run that differs more is taken (where JAX traces, that of the next rank). The full system,
      where these are all modes, where the model has all freedoms, or where it is given. (Joint
      forces show vibrations that motions hardly do: hence the mode to spare. Twice the cap misses
      those that it caps as well, which the summary says: give the full system for its joint
      forces.)
      "residual": the error that is linear in the residual of the full equations, integrated with
      the run. It costs more than a full run, serves to judge the other estimates, and says nothing
      of chaotic motions, whose errors soon exceed 5 %.

    Works under `jit`, `vmap` and `grad`. Raises InputError for a full system, for a run of another
    one, for several runs at once, for runs with events, and with "residual" for mechanisms in space
    or with contacts, of which a richer model tells alone.
    """
    return corrected_with(rom, run, by)[0]


def corrected_with(
    rom: AbstractSystem,
    run: Trajectory,
    by: AbstractSystem | Literal["residual"] | None = None,
) -> tuple[Trajectory, AbstractSystem]:
    """Return what `corrected` returns, and the model that has moved so."""
    check_system("corrected", rom)
    check_kind("corrected", "the run", run, Trajectory, "what romjax.simulate(rom, ts) returns")
    _check(rom, run)
    reduced = reduced_of(rom)
    if reduced is None:
        return _by_cap(rom, run, by)
    q, v = true_start(reduced, run)
    if isinstance(by, str):
        if by != "residual":
            raise unknown_name("corrected", "estimate", by, ("residual",))
        other, full = by_residual(reduced, run, q, v)
        return told(run, other, "linear"), full
    given = _finer_alike(reduced) if by is None else _by_model(reduced, by)
    if not given:
        full = _started(rom.full, q, v, pick(run.t, 0))
        return told_by(full, run, "the full model"), full
    if concrete(run.q) is None or concrete(q) is None:
        # Where JAX traces, each model would be a part of the program: the closest one is enough.
        given = given[-1:]
    models = [_started(one.model, q, v, pick(run.t, 0)) for one in given]
    pairs = [
        (told_by(model, run, one.name), model) for one, model in zip(given, models, strict=True)
    ]
    # Two models may agree by accident: the larger of the errors that they tell is the cautious one.
    return pairs[0] if len(pairs) == 1 else max(pairs, key=lambda pair: _size(pair[0]))


def _by_model(rom: AbstractReducedSystem, by: AbstractSystem) -> list[Finer]:
    """The model that is to tell the errors; none where it is the full one."""
    remedy = 'a model of the same mechanism, reduced or full, or "residual"'
    check_kind("corrected", "by", by, AbstractSystem, remedy)
    if by.full.structure.labels != rom.full.structure.labels:
        raise InputError(
            f"corrected: by has the coordinates {', '.join(by.full.structure.labels)}, but the "
            f"model {', '.join(rom.full.structure.labels)}; give {remedy}."
        )
    other = reduced_of(by)
    if other is None:
        return []
    if type(other) is type(rom) and other.n - other.m <= rom.n - rom.m:
        raise InputError(
            f"corrected: by has {other.n - other.m} freedoms, and the model that it is to judge "
            f"{rom.n - rom.m} of the same kind; give one that knows more."
        )
    return [Finer(other.with_full(rom.full), _name(other))]


def _finer_alike(rom: AbstractReducedSystem) -> list[Finer]:
    """The models that tell the errors of a reduced one, of its own mechanism."""
    finer: list[Finer] | None = _alike.get(rom)
    if finer is None:
        finer = [Finer(x.model.with_full(rom.full), x.name) for x in finer_of(rom, spare=1)]
        if is_outermost():
            _alike.put(rom, finer)
    return finer


# Judges are looked up by the reduced model: another mechanism is assembled in 40 ms.
_alike = IdentityCache()


def _started(model: S, q: Physical, v: Physical, t: Float[Array, ""]) -> S:
    """A model that starts at (q, v, t): the one last asked for, if that starts there, since what is
    known of a start, frequencies and metric, takes as long as a reduced run.
    """
    numbers = [concrete(x) for x in (q, v, t)]
    if not is_outermost() or any(x is None for x in numbers):
        return _from(model, q, v, t)
    key = tuple([np.asarray(x).tobytes() for x in numbers])
    found: S
    at, found = _latest.get(model) or (None, model)
    if at != key:
        found = _from(model, q, v, t)
        _latest.put(model, (key, found))
    return found


def _from(model: S, q: Physical, v: Physical, t: Float[Array, ""]) -> S:
    """A reduced or full model from the start that is nearest to (q, v)."""
    own = reduced_of(model)
    return beginning_at(model, q, v) if own is None else cast(S, own.starting_at(q, v, t))


_latest = IdentityCache()  # by a model, its last start and the model that begins there


@program
def _own_or_true(
    model: AbstractReducedSystem,
    t: Float[Array | np.ndarray, ""],
    start: tuple[Array, Array],
    own: State,
    true: State,
) -> State:
    """The true start where a model that starts as near to it as it can starts like a run."""
    q, v = _true_if_alike(model.reconstruct(t, *start), own, true)
    if model.full.m == 0:
        return q, v
    # Where a run begins later, drives have left the place where the full system starts.
    limits = precision.of(q.dtype)
    begun = Start.of(model.full, jnp.asarray(t), *true, limits.start_tolerance)
    holds = begun.closed & begun.fits
    return jnp.where(holds, q, own[0]), jnp.where(holds, v, own[1])


def _true_if_alike(start: State, own: State, true: State) -> State:
    """The true start where a run's own one is that which its model has for it, else the own one."""
    # Relative for large motions, absolute for small ones.
    sizes = [1 + jnp.max(jnp.abs(x)) for x in own]
    apart = [jnp.max(jnp.abs(x - y)) / size for x, y, size in zip(start, own, sizes, strict=True)]
    same = jnp.maximum(*apart) <= _SAME
    q, v = (jnp.where(same, x, y) for x, y in zip(true, own, strict=True))
    return q, v


def _check(rom: AbstractSystem, run: Trajectory) -> None:
    check_one_run("corrected", run.t)
    if run.labels != rom.full.structure.labels:
        raise InputError(
            f"corrected: the run has the coordinates {', '.join(run.labels)}, but the system "
            f"{', '.join(rom.full.structure.labels)}; give the model that was simulated."
        )
    if run.events is not None:
        raise InputError(
            "corrected: the run has events, of which it knows the times alone; simulate a richer "
            "model with them, and compare."
        )


def _by_cap(
    system: AbstractSystem, run: Trajectory, by: AbstractSystem | str | None
) -> tuple[Trajectory, AbstractSystem]:
    capped = twice_capped(system)
    if capped is None:
        raise InputError(
            "corrected: the system is a full one, which leaves nothing out; give the reduced or "
            "capped model that was simulated. Of errors of its steps a smaller rtol tells."
        )
    if by is not None:
        full = _without_cap(system, run, by)
        return told_by(full, run, "the full model"), full
    model, metric = beginning_at(capped[0], pick(run.q, 0), pick(run.v, 0)), capped[1]
    other = simulated(model, run)
    # Capped modes weigh more than those that errors are measured by.
    derived = EagerQuantities(other.multipliers, metric, other.derived.parts)
    other = dataclasses.replace(other, derived=derived)
    return told(run, other, "twice the cap", _BLIND), model


def _without_cap(system: AbstractSystem, run: Trajectory, by: Any) -> AbstractSystem:
    """The full system that is to tell the errors of a capped one, at the start of its run."""
    remedy = "the full system without the cap, with the same coordinates"
    check_kind("corrected", "by", by, AbstractSystem, f"{remedy}, beside a capped one")
    full: AbstractSystem = by
    if reduced_of(full) is not None or full.structure.labels != system.structure.labels:
        raise InputError(
            f"corrected: by is a {type(by).__name__} of {full.n} coordinates, but what was "
            f"simulated has a cap, and {system.n}; give {remedy}, or none."
        )
    # Slower modes have other velocities at the start.
    own = pick(run.q, 0), pick(run.v, 0)
    return beginning_at(full, *_true_if_alike((system.q0, system.v0), own, (full.q0, full.v0)))


def _name(model: AbstractReducedSystem) -> str:
    return model.summary.split(";")[0].split(",")[0] or type(model).__name__


def true_start(rom: AbstractReducedSystem, run: Trajectory) -> tuple[Physical, Physical]:
    """The start (q, v) that a run stands for: that of the full system if the model starts as near
    to it as it can, else that of the run itself.
    """
    full, t, own = rom.full, pick(run.t, 0), (pick(run.q, 0), pick(run.v, 0))
    try:
        nearest = _started(rom, full.q0, full.v0, t)
    except ReductionError:
        return own
    nearest, true = without_names(nearest), (full.q0, full.v0)
    return _own_or_true(nearest, t, (nearest.q0, nearest.v0), own, true)


def _size(run: Trajectory) -> tuple[bool, float]:
    assert run.bar is not None
    return bool(run.success), float(run.bar.error)
