"""Of how many unseen runs the bar covers the error, where the model of a box says 95 %.

`ReducedBox.factor` is the factor on estimates that covers 19 of 19 held-out runs, and so 19 of 20
others, as order statistics have it. Here a model is validated again and again, each time by
held-out runs of its own, as `romjax.reduce_over` draws them by a seed, and tried on runs that are
drawn after that. Writes `coverage.txt` beside this file.
"""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import numpy as np
import record
from reduced_scenes import segments
from tqdm import tqdm

import romjax as rj
from romjax.study.boxes.estimate import run_with_error_estimate
from romjax.study.boxes.reduced_box import covering
from romjax.study.errors.richer import finer_of

COUNT, RANK, RANGES = 6, 2, {"mass": (0.5, 2.0), "EI": (0.5, 2.0)}
BOXES, HELD_OUT, UNSEEN, CANDIDATES = 200, 19, 50, 8
RTOL, TRUTH = 1e-7, 1e-9
TS = np.linspace(0.0, 0.5, 26)
LEAST, MOST = 0.93, 0.99
# Runs at once.
LANES = 1380


class Judging(eqx.Module):
    """From parameters to the error of a reduced run, and what it is estimated to be."""

    box: rj.Box = eqx.field(static=True)
    rom: Any
    finer: tuple[Any, ...]

    def __call__(self, point: dict[str, Any]) -> tuple[Any, Any]:
        system = self.box.system_anywhere(point)
        truth = rj.simulate(system, TS, rtol=TRUTH, throw=False, audit=False)
        _, run, told = run_with_error_estimate(self.rom, self.finer, system, TS, RTOL)
        return rj.compare(truth, run).error, told


def chain(mass: float, EI: float) -> rj.Scene:
    """Few bars, whose programs are small."""
    return segments(COUNT, mass, EI)


def judged(box: rj.Box, rank: int, points: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Errors and estimates of all points, by the model of the run in the middle."""
    training = rj.simulate(box.system(), TS, rtol=TRUTH, audit=False)
    rom = rj.reduce(training.system, rj.pod(training, rank=rank), "minimal")
    one = Judging(box, rom, tuple(x.model for x in finer_of(rom)))
    run = eqx.filter_jit(lambda one, here: jax.vmap(one)(here))
    count, found = len(points["mass"]), []
    for first in tqdm(range(0, count, LANES), disable=None):
        # The last ones twice, for the same program.
        here = np.minimum(np.arange(first, first + LANES), count - 1)
        found.append(run(one, {name: x[here] for name, x in points.items()}))
    errors, told = (np.concatenate(x)[:count] for x in zip(*found, strict=True))
    return errors, told


def measure(boxes: int = BOXES) -> Iterator[record.Section]:
    """One table."""
    box, lots = rj.Box(chain, **RANGES), []
    for seed in range(boxes):
        held = {k: x[-HELD_OUT:] for k, x in box.sample(CANDIDATES + HELD_OUT, seed).items()}
        lot = np.random.default_rng(seed)
        lots.append({k: [*held[k], *lot.uniform(*ends, UNSEEN)] for k, ends in RANGES.items()})
    points = {name: np.concatenate([one[name] for one in lots]) for name in RANGES}
    errors, told = (x.reshape(boxes, -1) for x in judged(box, RANK, points))
    pairs = list(zip(errors, told, strict=True))
    known = [covering(error[:HELD_OUT], guess[:HELD_OUT]) for error, guess in pairs]
    factors, stated = (np.array(x) for x in zip(*known, strict=True))
    bars = factors[:, None] * told[:, HELD_OUT:]
    covered = np.mean(errors[:, HELD_OUT:] <= bars, axis=1)
    whole = float(np.mean(covered))
    yield record.Section(
        f"{COUNT} bars over their mass and their springs, minimal r = {RANK}: a model that is\n"
        f"validated anew by {HELD_OUT} held-out runs, and {UNSEEN} unseen runs each time:\n"
        "the share of these that is stated to err by less than the bar, and that does; the\n"
        "share that 19 of 20 times exceed; factors; and the median of bars over errors:",
        [
            ["boxes", "error", "stated", "covered", "19 of 20 times", "factor", "bar / error"],
            [
                str(boxes),
                f"{np.min(errors):.0e} to {np.max(errors):.0e}",
                f"{np.mean(stated):.1%}",
                f"{whole:.1%}",
                f"{np.quantile(covered, 0.05):.0%}",
                f"{np.min(factors):.4f} to {np.max(factors):.4f}",
                f"{np.median(bars / errors[:, HELD_OUT:]):.4f}",
            ],
        ],
        {f"covered / {LEAST:.0%}": whole / LEAST, f"{MOST:.0%} / covered": MOST / whole},
    )


CHOICES = {"boxes": {"type": int, "default": BOXES, "metavar": "COUNT"}}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
