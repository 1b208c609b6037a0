"""Many variants of one computation, in chunks, over all devices, stored on disk as they come."""

import dataclasses
import functools
import math
import operator
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from tqdm import tqdm

from ...common.files import dataset_of, write_dataset
from ...compiling.program import Program
from ...compiling.xla import tracing_with_options
from ...integrate.doubt import TOLD
from ...integrate.status import REMEDIES, Status
from ...integrate.trajectory import Trajectory
from ...system.flags import WORDS
from .chunks import Chunks

# Lanes of a chunk on one device. The arrays of some hundred small mechanisms still fit into a
# core's cache; fewer leave it idle, more gain nothing. Others take for a step of ten thousand what
# they take for one, and some gigabytes.
_LANES, _LANES_ELSEWHERE = 256, 16_384
_ARRAYS = (jax.Array, np.ndarray)


@dataclasses.dataclass(frozen=True)
class Sweep:
    """The result of `sweep`.

    - `values`: what the function returns, each array with a leading axis of lanes; NaN in lanes
      that failed.
    - `status` (lanes,): numbers of `romjax.Status`. `flags` (lanes,): sums of `romjax.Flag`, of
      what speaks against the runs.
    - `parameters`: those of all lanes, as they were given.
    """

    values: Any
    status: np.ndarray
    flags: np.ndarray
    parameters: Any

    @property
    def success(self) -> np.ndarray:
        """Whether each lane ended without anything that a run by itself would warn of, (lanes,)."""
        success: np.ndarray = (self.status == Status.SUCCESS) & (self.flags & TOLD == 0)
        return success

    @property
    def is_valid(self) -> np.ndarray:
        """Whether each lane ended and nothing speaks against it, (lanes,).

        A reduced model among them has to stay where it was trained.
        """
        valid: np.ndarray = (self.status == Status.SUCCESS) & (self.flags == 0)
        return valid

    def failures(self) -> dict[int, str]:
        """The lanes without success, with the reason and, of those that did not end, the remedy."""
        return {int(i): self._reason(int(i)) for i in np.flatnonzero(~self.success)}

    def _reason(self, lane: int) -> str:
        status = Status(self.status[lane])
        if status != Status.SUCCESS:
            return REMEDIES[status]
        return "; ".join(words for flag, words in WORDS.items() if flag & self.flags[lane])

    def to_xarray(self) -> Any:
        """The sweep as an `xarray.Dataset` (extra `files`): a dimension `lane` with the parameters
        as coordinates, what each lane returned by its path in the pytree, the parts of a run among
        it as `Trajectory.to_xarray` has them, and why lanes failed.

        Raises InputError where lanes hold several runs.
        """
        return dataset_of(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to a netCDF file, as `to_xarray` has it; `xarray.open_dataset` reads it.

        **Arguments:**

        - `path`: of the file, such as "sweep.nc".
        """
        write_dataset(self.to_xarray(), path)


def sweep(
    function: Callable[[Any], Any],
    parameters: Any,
    *,
    chunk: int | None = None,
    path: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Sweep:
    """`function` at many parameters at once.

    The lanes are computed in chunks of one compiled program, each split over all devices of this
    process, whose lanes do not wait for each other. Any number of processes that call it with the
    same arguments and one `path`, on one machine or on several that see that folder, share the
    chunks: each claims the next one that is free, they may start when they like, what one that
    ends too early has claimed is claimed anew, and all return the results of all.

    **Arguments:**

    - `function`: from the parameters of one lane to a pytree of arrays. A Trajectory in it, or keys
      `status` and `flags`, say whether the lane failed and what speaks against it; without any, it
      failed if a number is NaN, as are outputs that a run has not got to. Infinite ones are
      results, as the times of events that have not come. Simulate with `throw=False` in it.
    - `parameters`: a pytree of arrays with a leading axis of lanes.
    - `chunk`: lanes of a chunk; 256 for each device unless given, 16 384 on a GPU.
    - `path`: a folder for the results of each chunk. A sweep that was interrupted, at any moment,
      goes on where it was; what is damaged, or of other lanes, is computed again. Parameters, the
      arrays of a `function` that is a pytree (`jax.tree_util.Partial`, a module of Equinox) and the
      form of the results are compared with what is there; what `function` does is not.
    - `progress`: show a progress bar.

    Raises ValueError for parameters without a common number of lanes, or a folder that holds
    another sweep.
    """
    parameters = jax.tree.map(np.asarray, parameters)
    arrays = jax.tree.leaves(parameters)
    counts = {x.shape[:1] for x in arrays}
    if len(counts) != 1 or counts in ({()}, {(0,)}):
        shapes = ", ".join(str(x.shape) for x in arrays) or "none"
        raise ValueError(
            f"sweep: the parameters must have one leading axis of lanes, but their shapes are "
            f"{shapes}."
        )
    ((lanes,),) = counts
    devices = jax.local_devices()
    if chunk is not None and chunk < 1:
        raise ValueError(f"sweep: chunk={chunk}, but a chunk has at least one lane.")
    chunk = chunk or _chunk(devices, lanes)
    # The most devices that divide a chunk into equal parts are used.
    used = tuple(devices[: math.gcd(chunk, len(devices))])
    if path is None and jax.process_count() > 1:
        raise ValueError("sweep: several processes need a `path` to exchange their results.")
    own = [min(chunk, lanes - first) for first in range(0, lanes, chunk)]

    def lanes_of(number: int) -> Any:
        # The last chunk is filled up with its last lane, for the same program.
        here = np.minimum(np.arange(number * chunk, (number + 1) * chunk), lanes - 1)
        return jax.tree.map(lambda x: x[here], parameters)

    def form() -> Any:
        # Tracing takes as long as compiling, and only where nothing is left to compute it is done
        # for the form alone.
        if Chunks.are_there(path, len(own)):
            return _form(function, parameters)
        return _run.compiled(function, used, lanes_of(0)).out_info

    # Results of other numbers in the function are other results: the store is told them.
    held = [np.asarray(x) for x in jax.tree.leaves(function) if isinstance(x, _ARRAYS)]
    given = (parameters, held) if held else parameters
    store, tree = Chunks.open(path, given, lanes, chunk, form)

    def compute(number: int) -> list[np.ndarray]:
        nonlocal tree
        results = _run(function, used, lanes_of(number))
        arrays, tree = jax.tree.flatten(results)
        return [np.asarray(x)[: own[number]] for x in arrays]

    with tqdm(total=lanes, disable=not progress, desc="sweep", unit=" lanes") as bar:
        leaves = store.complete(len(own), compute, lambda number: bar.update(own[number]))
    values, outcome = jax.tree.unflatten(tree, leaves)
    return Sweep(values, outcome.status, outcome.flags, parameters)


def _form(function: Callable[[Any], Any], parameters: Any) -> Any:
    """The shapes and types of what one lane returns, with its outcome."""
    first = jax.tree.map(lambda x: jnp.asarray(x[:1]), parameters)
    with tracing_with_options():
        return jax.eval_shape(jax.vmap(lambda p: _with_outcome(function(p))), first)


def _chunk(devices: Sequence[jax.Device], lanes: int) -> int:
    """Lanes of a chunk, a whole number for each device."""
    own = _LANES if devices[0].platform == "cpu" else _LANES_ELSEWHERE
    return len(devices) * -(-min(own * len(devices), lanes) // len(devices))


def _chunk_of_lanes(
    function: Callable[[Any], Any], devices: tuple[jax.Device, ...], chunk: Any
) -> Any:
    """A chunk of lanes, split over devices; a loop on one device ends without the others."""
    lanes = PartitionSpec("lanes")

    def one(parameters: Any) -> tuple[Any, _Outcome]:
        values, outcome = _with_outcome(function(parameters))
        ended = outcome.status == Status.SUCCESS

        def hide(x: jax.Array) -> jax.Array:
            # No number of a lane that failed is passed on as if it were one.
            return jnp.where(ended, x, jnp.nan) if _is_float(x) else x

        return jax.tree.map(hide, values), outcome

    if len(devices) == 1:
        return jax.vmap(one)(chunk)
    mesh = Mesh(np.array(devices), ("lanes",))
    return jax.shard_map(
        jax.vmap(one), mesh=mesh, in_specs=lanes, out_specs=lanes, check_vma=False
    )(chunk)


_run = Program(_chunk_of_lanes)


class _Outcome(NamedTuple):
    """The status and the flags of a lane."""

    status: jax.Array
    flags: jax.Array


def _with_outcome(result: Any) -> tuple[Any, _Outcome]:
    """Return a function's result as arrays, and the outcome of the runs in it."""
    result = jax.tree.map(jnp.asarray, result)
    nodes = jax.tree.leaves(result, is_leaf=lambda x: isinstance(x, Trajectory))
    runs: list[Any] = [node for node in nodes if isinstance(node, Trajectory)]
    statuses, flags = [run.status for run in runs], [run.flags for run in runs]
    if isinstance(result, dict):
        statuses += [result["status"]] if "status" in result else []
        flags += [result["flags"]] if "flags" in result else []
    if statuses:
        status = jnp.max(jnp.stack(statuses))  # success is zero
    else:
        floats = filter(_is_float, jax.tree.leaves(result))
        unknown = jnp.any(jnp.array([jnp.any(jnp.isnan(x)) for x in floats]))
        status = jnp.where(unknown, Status.NOT_FINITE, Status.SUCCESS)
    together = functools.reduce(operator.or_, flags, jnp.zeros((), int))
    return result, _Outcome(status, together)


def _is_float(x: jax.Array) -> bool:
    return jnp.issubdtype(x.dtype, jnp.inexact)
