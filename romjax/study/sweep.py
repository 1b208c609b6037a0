"""Many variants of one computation, in chunks, over all devices, stored on disk as they come."""

import dataclasses
import hashlib
import io
import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, PartitionSpec
from tqdm import tqdm

from .. import writing
from ..extras import above
from ..integrate.status import REMEDIES, Status
from ..integrate.trajectory import Trajectory
from ..program import program

# Lanes of a chunk on one device. The arrays of some hundred small mechanisms still fit into a
# core's cache; fewer leave it idle, more gain nothing.
_LANES = 256


@dataclasses.dataclass(frozen=True)
class Sweep:
    """The result of `sweep`.

    - `values`: what the function returns, each array with a leading axis of lanes; NaN in lanes
      that failed.
    - `status` (lanes,): numbers of `romjax.Status`.
    - `parameters`: those of all lanes, as they were given.
    """

    values: Any
    status: np.ndarray
    parameters: Any

    @property
    def success(self) -> np.ndarray:
        """Which lanes went well, (lanes,)."""
        success: np.ndarray = self.status == Status.SUCCESS
        return success

    def failures(self) -> dict[int, str]:
        """The lanes that failed, with the reason and the remedy."""
        return {int(i): REMEDIES[Status(self.status[i])] for i in np.flatnonzero(~self.success)}

    def to_xarray(self) -> Any:
        """The sweep as an `xarray.Dataset` (extra `files`): a dimension `lane` with the parameters
        as coordinates, what each lane returned by its path in the pytree, the parts of a run among
        it as `Trajectory.to_xarray` has them, and why lanes failed.

        Raises InputError where lanes hold several runs.
        """
        return above("files.results.sweeps", "dataset_of")(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to a netCDF file, as `to_xarray` has it; `xarray.open_dataset` reads it.

        **Arguments:**

        - `path`: of the file, such as "sweep.nc".
        """
        above("files.results.store", "write")(self.to_xarray(), path)


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
    process, whose lanes do not wait for each other. With `jax.distributed`, each process computes
    its share of the chunks; all need the same `path`, and all return the results of all.

    **Arguments:**

    - `function`: from the parameters of one lane to a pytree of arrays. A Trajectory in it, or a
      key `status`, says whether the lane failed; without any, it failed if a number is not finite.
      Simulate with `throw=False` in it.
    - `parameters`: a pytree of arrays with a leading axis of lanes.
    - `chunk`: lanes of a chunk; 256 for each device unless given.
    - `path`: a folder for the results of each chunk. A sweep that was interrupted, at any moment,
      goes on where it was; what is damaged, or of other lanes, is computed again. Parameters and
      the form of the results are compared with what is there; what `function` does is not.
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
    # A whole number of lanes for each device.
    chunk = chunk or len(devices) * -(-min(_LANES * len(devices), lanes) // len(devices))
    used = tuple(devices[: math.gcd(chunk, len(devices))])
    first = jax.tree.map(lambda x: jnp.asarray(x[:1]), parameters)
    shapes = jax.eval_shape(jax.vmap(lambda p: _with_status(function(p))), first)
    if path is None and jax.process_count() > 1:
        raise ValueError("sweep: several processes need a `path` to exchange their results.")
    store = _Store.open(path, parameters, lanes, chunk, shapes)
    count = -(-lanes // chunk)
    with tqdm(total=lanes, disable=not progress, desc="sweep", unit=" lanes") as bar:
        for number in range(count):
            # The last chunk is filled up with its last lane, for the same program.
            here = np.minimum(np.arange(number * chunk, (number + 1) * chunk), lanes - 1)
            own = min(chunk, lanes - number * chunk)
            if not store.has(number) and number % jax.process_count() == jax.process_index():
                results = _run(
                    function, used, jax.tree.map(lambda x, here=here: x[here], parameters)
                )
                store.put(number, [np.asarray(x)[:own] for x in jax.tree.leaves(results)])
            bar.update(own)
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices("sweep")
    leaves = store.collect(count)
    values, status = jax.tree.unflatten(jax.tree.structure(shapes), leaves)
    return Sweep(values, status, parameters)


@program
def _run(function: Callable[[Any], Any], devices: tuple[jax.Device, ...], chunk: Any) -> Any:
    """A chunk of lanes, split over devices; a loop on one device ends without the others."""
    lanes = PartitionSpec("lanes")

    def one(parameters: Any) -> tuple[Any, jax.Array]:
        values, status = _with_status(function(parameters))

        def hide(x: jax.Array) -> jax.Array:
            return jnp.where(status == Status.SUCCESS, x, jnp.nan) if _is_float(x) else x

        return jax.tree.map(hide, values), status

    if len(devices) == 1:
        return jax.vmap(one)(chunk)
    mesh = Mesh(np.array(devices), ("lanes",))
    return jax.shard_map(
        jax.vmap(one), mesh=mesh, in_specs=lanes, out_specs=lanes, check_vma=False
    )(chunk)


def _with_status(result: Any) -> tuple[Any, jax.Array]:
    """What a function returns as arrays, and its status."""
    result = jax.tree.map(jnp.asarray, result)
    nodes = jax.tree.leaves(result, is_leaf=lambda x: isinstance(x, Trajectory))
    statuses = [node.status for node in nodes if isinstance(node, Trajectory)]
    if isinstance(result, dict) and "status" in result:
        statuses.append(result["status"])
    if statuses:
        status = jnp.max(jnp.stack(statuses))  # success is zero
    else:
        floats = filter(_is_float, jax.tree.leaves(result))
        finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(x)) for x in floats]))
        status = jnp.where(finite, Status.SUCCESS, Status.NOT_FINITE)
    return result, status


def _is_float(x: jax.Array) -> bool:
    return jnp.issubdtype(x.dtype, jnp.inexact)


class _Store:
    """The chunks that are done: in memory, and in a folder with one file for each.

    - `identity`: what tells the sweep from others, a part of the checksum of each file.
    """

    def __init__(self, folder: Path | None, identity: str = ""):
        self.folder, self.identity = folder, identity
        self.done: dict[int, list[np.ndarray]] = {}

    @classmethod
    def open(cls, path: Any, parameters: Any, lanes: int, chunk: int, shapes: Any) -> "_Store":
        if path is None:
            return cls(None)
        folder = Path(path)
        folder.mkdir(parents=True, exist_ok=True)
        results = [str(jax.tree.structure(shapes))]
        results += [f"{x.dtype}{list(x.shape[1:])}" for x in jax.tree.leaves(shapes)]
        wanted = {
            "lanes": lanes,
            "chunk": chunk,
            "parameters": _digest(str(jax.tree.structure(parameters)), jax.tree.leaves(parameters)),
            "results": results,
        }
        file = folder / "sweep.json"
        if file.exists():
            stored = _identity(file)
            other = [key for key, value in wanted.items() if stored.get(key) != value]
            if other:
                raise ValueError(
                    f"sweep: {folder} holds another sweep, which differs in its {other[0]}; "
                    "choose another folder, or remove this one."
                )
        else:
            writing.write(file, json.dumps(wanted, indent=1))
        writing.forget_parts(folder)
        return cls(folder, json.dumps(wanted))

    def _file(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"chunk-{number:06d}.npz"

    def has(self, number: int) -> bool:
        if number not in self.done and self.folder is not None:
            leaves = self._read(number)
            if leaves is not None:
                self.done[number] = leaves
        return number in self.done

    def put(self, number: int, leaves: list[np.ndarray]) -> None:
        self.done[number] = leaves
        if self.folder is not None:
            content = io.BytesIO()
            np.savez(content, *leaves, checksum=self._checksum(number, leaves))
            writing.write(self._file(number), content.getbuffer())

    def collect(self, count: int) -> list[np.ndarray]:
        """The arrays of all chunks, one after the other."""
        for number in range(count):  # also those of other processes
            if not self.has(number):
                raise OSError(
                    f"sweep: {self._file(number)} is damaged or missing, though another process "
                    "has computed it; start all processes again, which computes it anew."
                )
        parts = [self.done[number] for number in range(count)]
        return [np.concatenate(x) for x in zip(*parts, strict=True)]

    def _checksum(self, number: int, leaves: Sequence[np.ndarray]) -> str:
        return _digest(f"{self.identity} {number}", leaves)

    def _read(self, number: int) -> list[np.ndarray] | None:
        """The arrays of a file; None unless they are those of this chunk."""
        try:
            # Opened here, since NumPy leaves open what is no archive.
            with self._file(number).open("rb") as stream, np.load(stream) as stored:
                leaves = [stored[f"arr_{i}"] for i in range(len(stored.files) - 1)]
                is_own = str(stored["checksum"]) == self._checksum(number, leaves)
        except Exception:  # there is none, or a damaged one, which raises whatever its bytes say
            return None
        return leaves if is_own else None


def _identity(file: Path) -> dict[str, Any]:
    """What tells the sweep in a folder from others; raises ValueError where nothing does."""
    try:
        stored = json.loads(file.read_bytes())
    except ValueError:
        stored = None
    if not isinstance(stored, dict):
        raise ValueError(
            f"sweep: {file} does not say which sweep is in its folder; remove the file, and "
            "chunks that are whole and of this sweep are used, or choose another folder."
        )
    return stored


def _digest(words: str, arrays: Sequence[np.ndarray]) -> str:
    digest = hashlib.sha256(words.encode())
    for x in arrays:
        digest.update(f"{x.dtype}{x.shape}".encode() + np.ascontiguousarray(x).tobytes())
    return digest.hexdigest()
