"""Batches on a GPU: mechanisms per second by the number of lanes, kernels of a step and errors.

Each case is a process of its own, on the GPU or on one core of the CPU beside it, so that all
compile at once; whoever measures is alone on the GPU, and begins when nobody compiles any more.
What is found goes to `gpu.jsonl` as it comes, and from there to `gpu.txt`, beside this file or in
`--out`: a run that is cut short keeps what it has. Where JAX finds no GPU, the CPU stands for it.

With `--budget 480` seconds, cases that no time is left for are named and left out.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import gpu_table
import record
from gpu_case import CASES, CONTROLS, note, ready

LANES = (10_000, 1, 100_000, 100, 1000, 1_000_000)  # in the order in which they are compiled
WHAT = (*CONTROLS, "sweep", "cpu")
# Of the budget: when no program is begun any more, when all wait to measure, and when all end.
SHARES = 0.5, 0.58, 0.95
CORES = 0.6  # of all, for processes on the GPU; the others measure the CPU
# XLA starts a loop as one graph of CUDA, and the host waits no more for each of its turns.
GRAPHS = (
    "--xla_gpu_enable_command_buffer=FUSION,CUBLAS,CUBLASLT,CUSTOM_CALL,DYNAMIC_SLICE_FUSION,"
    "WHILE,CONDITIONAL"
)


class Pool:
    """The processes of some cases, until the budget ends; at most `beside` are on the GPU."""

    def __init__(
        self, cases: Sequence[int], what: Sequence[str], out: Path, budget: float, beside: int
    ):
        self.out, self.beside, begun = out, beside, time.time()
        self.until, self.late, self.end = (begun + share * budget for share in SHARES)
        self.names = [str(mechanism) for mechanism in CASES]
        cores = sorted(os.sched_getaffinity(0))
        split = max(1, round(CORES * len(cores)))
        others = cores[split:] or cores
        kinds = list(CASES.values())
        waiting = [(case, one) for case in cases for one in kinds[case] if one in what]
        waiting[3:3] = [(case, "sweep") for case in cases[1:2] if "sweep" in what]
        # What waits, and where it runs: all of the GPU, and one for each core of the CPU.
        self.queues = {"gpu": waiting} | {f"cpu {core}": [] for core in others}
        self.cores = {"gpu": cores[:split]} | {f"cpu {core}": [core] for core in others}
        for i, case in enumerate(cases if "cpu" in what else ()):
            self.queues[f"cpu {others[i % len(others)]}"].append((case, "cpu"))
        self.running: dict[subprocess.Popen, tuple[str, int, str]] = {}

    def run(self, lanes: Sequence[int]) -> None:
        """All of them, and the table of what is found whenever one ends."""
        while (self.running or any(self.queues.values())) and time.time() < self.end:
            for queue, left in self.queues.items():
                most = self.beside if queue == "gpu" else 1
                while left and sum(name == queue for name, *_ in self.running.values()) < most:
                    case, what = left.pop(0)
                    process = self.started(case, what, lanes, self.cores[queue])
                    self.running[process] = queue, case, what
            time.sleep(0.2)
            for process, (queue, case, what) in list(self.running.items()):
                waits = queue == "gpu" and not ready(self.out, process.pid).exists()
                if process.poll() is None and waits and time.time() > self.late:
                    self.ended(process, "it compiled for too long")
                elif process.poll() is not None:
                    log = f"failed, see {self.log(case, what).name}" if process.returncode else ""
                    self.ended(process, log)
        for process in list(self.running):
            self.ended(process, "ended by the budget")
        for case, what in (one for left in self.queues.values() for one in left):
            note(self.out, name=self.names[case], control=what, left="no time to begin")

    def ended(self, process: subprocess.Popen, why: str) -> None:
        """No more of a process; `why` something of it is left out, if it is."""
        process.kill()
        process.wait()
        _, case, what = self.running.pop(process)
        ready(self.out, process.pid).unlink(missing_ok=True)
        if why:
            note(self.out, name=self.names[case], control=what, left=why)
        gpu_table.write(self.out)

    def log(self, case: int, what: str) -> Path:
        """Where a process writes its words."""
        return self.out / f"gpu-{case}-{what}.log"

    def started(
        self, case: int, what: str, lanes: Sequence[int], cores: Sequence[int]
    ) -> subprocess.Popen:
        """A process of a case on these cores."""
        variables = {**os.environ, "XLA_PYTHON_CLIENT_PREALLOCATE": "false", "ROMJAX_CACHE_DIR": ""}
        if what == "cpu":
            variables["JAX_PLATFORMS"] = "cpu"
        if what == "graphs":
            variables["XLA_FLAGS"] = f"{variables.get('XLA_FLAGS', '')} {GRAPHS}"
        script = Path(__file__).with_name("gpu_case.py")
        words = [sys.executable, script, case, what, "--out", self.out, "--until", self.until]
        with open(self.log(case, what), "w") as log:
            return subprocess.Popen(
                [str(word) for word in (*words, "--lanes", *lanes)],
                env=variables,
                stdout=log,
                stderr=log,
                preexec_fn=lambda: os.sched_setaffinity(0, cores),
            )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    number = {"type": int, "nargs": "+", "metavar": "N"}
    here = Path(__file__).parent
    parser.add_argument("--out", type=Path, default=here, metavar="DIR", help="(%(default)s)")
    parser.add_argument("--budget", type=float, default=480.0, metavar="S", help="(%(default)s s)")
    parser.add_argument("--lanes", **number, default=LANES, help="(%(default)s)")
    parser.add_argument("--cases", **number, default=range(len(CASES)), help="(all)")
    parser.add_argument("--what", nargs="+", choices=WHAT, default=WHAT, help="(all)")
    parser.add_argument("--keep", action="store_true", help="add to what gpu.jsonl holds")
    parser.add_argument("--beside", type=int, default=32, metavar="N", help="(%(default)s at once)")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    if not given.keep:
        (given.out / "gpu.jsonl").unlink(missing_ok=True)
    note(given.out, machine=record.machine())
    Pool(given.cases, given.what, given.out, given.budget, given.beside).run(given.lanes)
    (given.out / "gpu.lock").unlink(missing_ok=True)
    print(gpu_table.write(given.out))


if __name__ == "__main__":
    main()
