"""The tables of `gpu.py`, of what its processes have found."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import record

Finding = dict[str, Any]

_HEAD = """\
One second of mechanisms on {device}: cart-pendulums by their
forces, planar chains of hinged bars and chains of hinges in space by their
gravity; r: in minimal coordinates of that rank. Tolerance 1e-6, or fixed steps;
Rodas5P for full cart-pendulums, else Dopri8; `rj.jit(jax.vmap(run))`, double
precision, two outputs, with the balance of energy. Least of up to 3 calls.

- steps: of the longest lane; ms: of all lanes, for each of these steps.
- starts: kernels that are started for each step, and waits: numbers that the
  host waits for on the way, both by the profiler, of the fewest lanes.
- error: the largest of a coordinate at the end [m, rad], against runs of the
  CPU with tolerance 1e-10, in up to 256 lanes; CPU: the largest difference to
  the CPU's run with the same settings.
- graphs: adaptive, with XLA's flag that makes a loop one graph of CUDA."""


def write(out: Path) -> str:
    """Write `gpu.txt` of all findings so far, and return it."""
    file = out / "gpu.jsonl"
    found = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    machines = list(dict.fromkeys(x["machine"] for x in found if "machine" in x))
    text = "\n\n".join([*machines, *_parts(found)]) + "\n"
    (out / "gpu.txt").write_text(text)
    return text


def _parts(found: list[Finding]) -> Iterator[str]:
    """The text and the tables of findings."""
    devices = sorted({x["device"] for x in found if "device" in x}) or ["no device"]
    yield _HEAD.format(device=", ".join(devices))
    own = {_key(x): x for x in found if "compiled" in x}
    if own:
        times = [x["compiled"] for x in own.values()]
        yield f"Built, all cases beside each other, in {min(times):.0f} to {max(times):.0f} s each:"
        yield record.table(_rows(found, own))
    cpus = [x for x in found if "cpu" in x]
    if cpus and own:
        yield "Mechanisms per second on one core of the CPU, and on the device / on that core:"
        yield record.table(_rates(cpus, own))
    sweeps = [
        [x["name"], f"{x['lanes']}", f"{x['sweep'] or 256}", f"{x['lanes'] / x['s']:.0f}"]
        for x in found
        if "sweep" in x
    ]
    if sweeps:
        yield "`rj.sweep`, by the lanes of a chunk:"
        yield record.table([["mechanism", "lanes", "chunk", "per second"], *sweeps])
    # What was left out by one run may have been measured by another.
    done = {*own, *((name, control, None) for name, control, _ in own)}
    done |= {(x["name"], "cpu", None) for x in cpus}
    done |= {(x["name"], "sweep", None) for x in found if "sweep" in x}
    left: dict[tuple[str, str, str], set[int]] = {}
    for x in found:
        if "left" in x and _key(x) not in done:
            counts = left.setdefault((x["name"], x["control"], x["left"]), set())
            counts |= {x["lanes"]} if "lanes" in x else set()
    if left:
        lines = []
        for (name, control, why), counts in sorted(left.items()):
            lanes = f", {', '.join(map(_count, sorted(counts)))} lanes" if counts else ""
            lines.append(f"{name}, {control}{lanes}: {why}")
        yield "Left out:\n" + "\n".join(lines)


def _key(found: Finding) -> tuple[Any, ...]:
    return found["name"], found["control"], found.get("lanes")


def _rows(found: list[Finding], own: dict[tuple[Any, ...], Finding]) -> list[list[str]]:
    """One row for each number of lanes of each case."""
    truths = {x["name"]: np.array(x["q"]) for x in found if "truth" in x}
    cpus = {(x["name"], x["control"]): np.array(x["q"]) for x in found if "cpu" in x}
    started = {(x["name"], x["control"]): x for x in found if "started" in x}
    head = "mechanism lanes per_second steps ms starts waits error CPU"
    rows = [head.replace("_", "\n").split(" ")]
    for name, control, lanes in sorted(own):
        x = own[name, control, lanes]
        states, alike = np.array(x["q"]), control.replace("graphs", "adaptive")
        # Once for each case, at its fewest lanes.
        counts = started.pop((name, control), {"started": (0, 0)})
        per_step = [f"{n / counts['steps']:.0f}" if n else "" for n in counts["started"]]
        row = [f"{name}, {control}", _count(lanes), f"{lanes / x['s']:.3g}"]
        if lanes / x["s"] >= 100:
            row[2] = f"{lanes / x['s']:.0f}"
        row += [f"{x['steps']}", record.short(1e3 * x["s"] / x["steps"]), *per_step]
        row += [_difference(states, other) for other in (truths.get(name), cpus.get((name, alike)))]
        rows.append(row)
    return rows


def _count(lanes: int) -> str:
    return f"{lanes:.0e}".replace("e+0", "e") if lanes > 1000 else f"{lanes}"


def _difference(states: np.ndarray, other: np.ndarray | None) -> str:
    if other is None:
        return "-"
    count = min(len(states), len(other))
    return f"{np.max(np.abs(states[:count] - other[:count])):.0e}"


def _rates(cpus: list[Finding], own: dict[tuple[Any, ...], Finding]) -> list[list[str]]:
    """Rates of a core, and by how much those of the device are larger, by its lanes."""
    counts = sorted({lanes for *_, lanes in own})
    rows = [["mechanism", "a core", *map(_count, counts)]]
    for cpu in sorted(cpus, key=_key):
        rate, cells = cpu["lanes"] / cpu["s"], []
        for count in counts:
            x = own.get((cpu["name"], cpu["control"], count))
            cells.append(record.short(count / x["s"] / rate) if x else "-")
        rows.append([f"{cpu['name']}, {cpu['control']}", f"{rate:.0f}", *cells])
    return rows
