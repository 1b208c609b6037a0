"""One case of `gpu.py` in a process of its own: on the GPU, on a core of the CPU, or as a sweep."""

import argparse
import contextlib
import fcntl
import functools
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from spatial import chain as chain_in_space

import romjax as rj

CHECKED = 256  # the most lanes that are compared with the CPU
CHUNKED, CHUNK = 16_384, 4096  # lanes of a sweep, and of its chunks
REPEATS, SLOW = 3, 0.4  # calls; what takes longer [s] is called once
# [s] What would take longer is left out; from so many lanes on, time grows with their number.
LONGEST, BUSY = 10.0, 10_000
RTOL, TIGHT = 1e-6, 1e-10
STEPS = {"cart": 200, "chain": 100, "hinges": 100}  # of a second in fixed steps
CONTROLS = ("adaptive", "fixed", "graphs")


class Mechanism(NamedTuple):
    """A kind (cart, chain or hinges) of a size, and the rank in minimal coordinates; 0: full."""

    kind: str
    size: int = 0
    rank: int = 0

    def __str__(self) -> str:
        name = self.kind + (f" {self.size}" if self.size else "")
        return name + (f", r = {self.rank}" if self.rank else "")

    def system(self, number: Any) -> rj.AbstractSystem:
        """With another force [N] or gravity [m/s²]."""
        if self.kind == "cart":
            return rj.assemble(rj.gallery.cart_pendulum(force=number))
        in_space, down = self.kind == "hinges", jnp.asarray(number)
        scene = chain_in_space(self.size, True) if in_space else rj.gallery.chain(self.size)
        gravity = rj.Gravity(jnp.stack([0.0 * down] * (1 + in_space) + [-down]))
        return rj.assemble(rj.Scene(scene.bodies, scene.joints, [gravity]))

    def solver(self) -> Any:
        """That which the mechanism suits."""
        return rj.Rodas5P() if self.kind == "cart" and not self.rank else diffrax.Dopri8()


# The most telling ones first, with the ways to control their steps.
CASES = {
    Mechanism("cart"): CONTROLS,
    Mechanism("cart", rank=3): CONTROLS,
    Mechanism("chain", 8): CONTROLS,
    Mechanism("hinges", 8): CONTROLS,
    Mechanism("chain", 32): ("adaptive",),
    Mechanism("hinges", 32): ("adaptive",),
    Mechanism("chain", 8, 8): ("adaptive",),
    Mechanism("chain", 1): ("adaptive",),
    Mechanism("hinges", 1): ("adaptive",),
}


def numbers(lanes: int) -> np.ndarray:
    """Forces or gravities of 5 to 15, of which those of fewer lanes are the first."""
    return 5.0 + 10.0 * np.mod(np.arange(lanes) * 0.6180339887498949, 1.0)


def lane(mechanism: Mechanism, control: str) -> Callable[[Any, Any], dict[str, jax.Array]]:
    """A function of the tolerance and of the number of one lane: what a second comes to.

    A reduced model is made on the CPU, of a run with the largest number.
    """
    ts, rom = jnp.array([0.0, 1.0]), None
    plain: dict[str, Any] = {"adjoint": diffrax.ForwardMode(), "throw": False, "max_steps": 20_000}
    if mechanism.rank:
        with jax.default_device(jax.devices("cpu")[0]):
            full = mechanism.system(15.0)
            whole = rj.simulate(full, jnp.linspace(0.0, 1.0, 101), rtol=TIGHT, **plain)
            basis = rj.Minimal().basis(full, whole, rj.POD(rank=mechanism.rank))
            rom = jax.tree.map(np.asarray, rj.reduce(mechanism.system(10.0), basis, "minimal"))

    def run(rtol: Any, number: Any) -> dict[str, jax.Array]:
        full = mechanism.system(number)
        dt = 1.0 / STEPS[mechanism.kind] if control == "fixed" else None
        found = rj.simulate(
            full if rom is None else rom.with_full(full),
            ts,
            solver=mechanism.solver(),
            rtol=rtol,
            dt=dt,
            **plain,
        )
        return {"q": found.q[-1], "steps": found.stats.num_steps, "flags": found.flags}

    return run


@contextlib.contextmanager
def locked(out: Path, alone: bool) -> Iterator[None]:
    """With others that compile, or alone to measure."""
    with open(out / "gpu.lock", "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield


def ready(out: Path, process: int | None = None) -> Path:
    """A file that is there when a process, unless given this one, compiles no more."""
    return out / f"gpu-{process or os.getpid()}.ready"


def note(out: Path, **found: Any) -> None:
    """Keep a finding, whatever happens next."""
    with open(out / "gpu.jsonl", "a") as file:
        file.write(json.dumps(found) + "\n")


def reason(error: Exception) -> str:
    """Why a program could not be built or run."""
    words = str(error).partition("\n")[0]
    return "out of memory" if "RESOURCE_EXHAUSTED" in words else words[:60]


def is_known(out: Path, **key: str) -> bool:
    """Whether a run before has counted the kernels of a case."""
    found = map(json.loads, (out / "gpu.jsonl").read_text().splitlines())
    return any("started" in x and all(x[name] == y for name, y in key.items()) for x in found)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and the least time of some [s], after one that does not count."""
    taken = list[float]()
    while len(taken) <= REPEATS and (len(taken) < 2 or taken[-1] < SLOW):
        start = time.perf_counter()
        result = jax.block_until_ready(call())
        taken.append(time.perf_counter() - start)
    return result, min(taken[1:])


def seen(found: dict[str, jax.Array]) -> dict[str, Any]:
    """What is kept of a batch: states of the lanes that are compared, and steps of the longest."""
    steps = np.asarray(found["steps"])
    states = np.asarray(found["q"])[:CHECKED].tolist()
    return {"q": states, "steps": int(steps.max()), "flags": int(np.count_nonzero(found["flags"]))}


def started(call: Callable[[], Any]) -> tuple[int, int]:
    """Kernels that a call starts on a GPU, and numbers that the host waits for, by the profiler."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            jax.block_until_ready(call())
        names = [
            event.name
            for file in Path(folder).rglob("*.xplane.pb")
            for plane in jax.profiler.ProfileData.from_file(str(file)).planes
            if "GPU" in plane.name
            for line in plane.lines
            if line.name.startswith("Stream")
            for event in line.events
        ]
    copies = sum(name.startswith("Memcpy") for name in names)
    return len(names) - copies, sum(name.startswith("MemcpyD2H") for name in names)


def on_gpu(
    mechanism: Mechanism, control: str, out: Path, until: float, lanes: Sequence[int]
) -> None:
    """Compile and measure a case at all numbers of lanes that there is time for."""
    key, programs = {"name": str(mechanism), "control": control}, {}
    note(out, device=jax.devices()[0].device_kind)
    with locked(out, alone=False):
        batch, last = rj.jit(jax.vmap(lane(mechanism, control), (None, 0))), 0.0
        for count in lanes:
            if time.time() + 1.5 * last > until:
                note(out, **key, lanes=count, left="no time to compile")
                continue
            begun = time.perf_counter()
            try:
                program = batch.lower(RTOL, numbers(count)).compile()
            except jax.errors.JaxRuntimeError as error:
                note(out, **key, lanes=count, left=reason(error))
                continue
            last = time.perf_counter() - begun
            programs[count] = program, last
    ready(out).touch()
    before = before_s = 0.0
    fewest: Callable[[], Any] | None = None
    with locked(out, alone=True):
        for count, (program, compiled) in sorted(programs.items()):
            if before >= BUSY and before_s * 0.6 * count / before > LONGEST:
                note(out, **key, lanes=count, left="it would take too long")
                continue
            call = functools.partial(program, jnp.asarray(RTOL), jnp.asarray(numbers(count)))
            try:
                found, taken = timed(call)
            except jax.errors.JaxRuntimeError as error:
                note(out, **key, lanes=count, left=reason(error))
                continue
            note(out, **key, lanes=count, s=taken, compiled=compiled, **seen(found))
            before, before_s, fewest = count, taken, fewest or call
        if fewest and not is_known(out, **key):
            steps = int(np.max(fewest()["steps"]))
            note(out, **key, started=started(fewest), steps=steps)


def on_cpu(mechanism: Mechanism, controls: Sequence[str], out: Path, lanes: int) -> None:
    """Rates of one core, and what errors are taken against."""
    for control in [control for control in controls if control != "graphs"]:
        batch = rj.jit(jax.vmap(lane(mechanism, control), (None, 0)))
        given = jnp.asarray(numbers(lanes))
        found, taken = timed(lambda batch=batch, given=given: batch(RTOL, given))
        key = {"name": str(mechanism), "control": control, "lanes": lanes}
        note(out, cpu=True, **key, s=taken, **seen(found))
        if control == "adaptive":
            note(out, truth=True, name=str(mechanism), **seen(batch(TIGHT, given)))


def chunks(mechanism: Mechanism, out: Path, lanes: int) -> None:
    """`rj.sweep` of the lanes, by its own chunks, by larger ones, and by a single one."""
    run, given = functools.partial(lane(mechanism, "adaptive"), RTOL), numbers(lanes)

    def sweep(chunk: int | None, count: int) -> Any:
        return rj.sweep(run, given[:count], chunk=chunk).values

    sizes = (None, min(CHUNK, lanes), lanes)
    with locked(out, alone=False):
        for chunk in sizes:
            sweep(chunk, chunk or CHECKED)
    ready(out).touch()
    with locked(out, alone=True):
        for chunk in sizes:
            _, taken = timed(functools.partial(sweep, chunk, lanes))
            note(out, sweep=chunk or 0, name=str(mechanism), lanes=lanes, s=taken)


def main() -> None:
    """The process that `gpu.start` starts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=int)
    parser.add_argument("what", choices=(*CONTROLS, "cpu", "sweep"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--until", type=float, default=np.inf)
    parser.add_argument("--lanes", type=int, nargs="+", required=True)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mechanism, controls = list(CASES.items())[given.case]
    if given.what == "cpu":
        on_cpu(mechanism, controls, given.out, min(CHECKED, max(given.lanes)))
    elif given.what == "sweep":
        chunks(mechanism, given.out, min(CHUNKED, max(given.lanes)))
    else:
        on_gpu(mechanism, given.what, given.out, given.until, given.lanes)


if __name__ == "__main__":
    main()
