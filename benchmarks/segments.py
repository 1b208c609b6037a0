"""Hyper-reduction: what the number of segments costs, beams of 32, 128 and 512 hinged bars.

All take their snapshots from the run of 32 bars, whose angles are interpolated along the beam: the
full model of 512 bars would run for hours.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import record
from reduced_scenes import moved, segments
from timing import least

import romjax as rj
from romjax.compiling.program import program_often

COUNTS, RANK = (32, 128, 512), 4
TS = jnp.linspace(0.0, 1.0, 101)
# Of right-hand sides many, since a call hands over all arrays of the full system first.
STEPS, REPEATS, SLOW = 20_000, 10, 5.0
STATES, WIDER = 1000, 2.0  # random states, in a box wider than the training's
EXACT = {"solver": diffrax.Dopri8(), "rtol": 1e-8, "max_steps": 100_000}


class Snapshots(NamedTuple):
    """A motion to make a basis of."""

    t: Any
    q: Any
    v: Any
    metric: Any
    labels: tuple[str, ...] = ()


def interpolated(run: rj.Trajectory, system: rj.AbstractSystem) -> Snapshots:
    """The motion of a beam of as many bars as `system` has, by the angles of a run."""
    coarse, count = run.q.shape[1] // 3, system.n // 3
    size = 1 / count
    middles = [(np.arange(own) + 0.5) / own for own in (count, coarse)]

    def along(x: Any) -> np.ndarray:
        return np.stack([np.interp(*middles, row) for row in np.asarray(x)[:, 2::3]])

    angle, rate = along(run.q), along(run.v)
    q, v = np.zeros((len(angle), system.n)), np.zeros((len(angle), system.n))
    for part, (x, y) in enumerate(
        [(np.cos(angle), -np.sin(angle) * rate), (np.sin(angle), np.cos(angle) * rate)]
    ):
        for out, own in ((q, x), (v, y)):
            out[:, part::3] = size * (np.cumsum(own, axis=1) - own / 2)
    q[:, 2::3], v[:, 2::3] = angle, rate
    return Snapshots(np.asarray(run.t), q, v, np.asarray(system.mass(system.q0)))


@program_often
def evaluated(rom: Any) -> Any:
    """Many right-hand sides, one after the other, each at what the one before gave."""

    def once(carry: Any, _: None) -> Any:
        z, w = carry
        a, _multipliers = rom.acceleration(0.0, z, w)
        return (z + 1e-9 * w, w + 1e-9 * a), None

    return jax.lax.scan(once, (rom.q0, rom.v0), None, length=STEPS)[0]


def least_eigenvalue(rom: Any) -> float:
    """The least of the reduced mass matrices at random states."""
    lower, upper = rom.validity.box.lower, rom.validity.box.upper
    shares = np.random.default_rng(0).uniform(-1, 1, (STATES, rom.n))
    z = (lower + upper) / 2 + WIDER / 2 * (upper - lower) * shares
    return float(jnp.min(jnp.linalg.eigvalsh(jax.jit(jax.vmap(rom.mass))(z))))


def drift(run: rj.Trajectory) -> float:
    """The largest imbalance of energy of a run [J]."""
    return float(np.max(np.abs(np.asarray(run.imbalance))))


def measure() -> Iterator[record.Section]:
    """One table for all numbers of segments."""
    run = rj.simulate(rj.assemble(segments(COUNTS[0])), TS, **EXACT)
    made, calls = [], []
    for count in COUNTS:
        system = rj.assemble(segments(count))
        motion = interpolated(run, system)
        basis = rj.Minimal().basis(system, motion, rj.POD(RANK))
        exact, rom = (rj.reduce(system, basis, kind) for kind in ("minimal", "hyper"))
        made.append((system, exact, rom))
        calls += [
            lambda rom=rom: evaluated(rom),
            lambda rom=rom: rj.simulate(rom, TS, **EXACT),
            lambda exact=exact: rj.simulate(exact, TS, **EXACT),
        ]
    timed = least(calls, REPEATS, SLOW, "segments")
    head = ["segments", "bodies", "angles", "us/rhs", "ms", "exact ms", "trained", "turned"]
    rows, ratios, us = [[*head, "drift", "exact", "least M"]], {}, {}
    for number, (system, exact, rom) in enumerate(made):
        rhs, own, other = timed[3 * number : 3 * number + 3]
        count, us[count] = COUNTS[number], 1e6 * rhs.least / STEPS
        start = moved(system, 1.0, -0.52)
        turned = [rj.simulate(one.starting_at(*start), TS, **EXACT) for one in (exact, rom)]
        drifts, eigenvalue = (drift(own.result), drift(other.result)), least_eigenvalue(rom)
        rows.append(
            [
                f"{count}",
                f"{sum(map(len, rom.sample.bodies))}",
                f"{len(rom.sample.rotations.sampled)}",
                f"{us[count]:.2f}",
                f"{1e3 * own.least:.2f}",
                f"{1e3 * other.least:.1f}",
                f"{float(rj.compare(other.result, own.result).error):.1e}",
                f"{float(rj.compare(*turned).error):.1e}",
                *(f"{x:.1e}" for x in drifts),
                f"{eigenvalue:.2f}",
            ]
        )
        ratios[f"{count} segments: 2 x drift of exact / drift"] = 2 * drifts[1] / drifts[0]
        ratios[f"{count} segments: least eigenvalue of the mass"] = eigenvalue
        ratios[f"{count} segments: exact / sampled"] = other.least / own.least
    ratios["rhs: least / largest of 32, 128, 512 segments"] = min(us.values()) / max(us.values())
    yield record.Section(
        f"Beams of hinged bars, falling, in r = {RANK} coordinates; errors against the reduced\n"
        "model of all bodies, on the training and from a start that is turned and spins; drift of\n"
        "energy [J] of both; least eigenvalue of the mass in twice the box of the training:",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
