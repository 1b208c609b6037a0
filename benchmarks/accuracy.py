"""Whether the study of accuracy and time can be relied upon: its recommendations in two studies, on
scenes that were not studied, the error of its reference; what reduced models save; and how long the
command takes. Writes `accuracy.txt` beside this file.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import record

import romjax as rj
from romjax.study.accuracy.result import Accuracy

TS = np.linspace(0.0, 1.0, 101)
ERRORS = (1e-3, 1e-5, 1e-7)
ALLOWED = 3  # on other scenes, times the error that was asked for
BUDGET, PATIENCE = 60, 90.0  # [s] of the command, and for it to end


def study() -> Accuracy:
    """Of the chapter's scene: single runs in double precision."""
    return rj.accuracy(
        rj.gallery.cart_pendulum(),
        TS,
        formulations=("minimal", "galerkin", "projected"),
        bases=("POD",),
        ranks=(5, 3),
        precisions=("f64",),
        lanes=(1,),
        repeats=20,
    )


def again(first: Accuracy, second: Accuracy) -> record.Section:
    """What two studies recommend; where they differ, the times of both."""
    rows = [["error", "model", "method", "rtol", "reached", "ms", "second study", "ms"]]
    ratios = {}
    for error in ERRORS:
        one, two = (found.recommend(error).row for found in (first, second))
        same = (one.model, one.solver, one.rtol) == (two.model, two.solver, two.rtol)
        least = [f"{1e3 * row.least:.2f}" for row in (one, two)]
        other = "the same" if same else f"{two.model}, {two.solver}, {two.rtol:.0e}"
        own = [one.model, one.solver, f"{one.rtol:.0e}", f"{one.error:.1e}", least[0]]
        rows.append([f"{error:g}", *own, other, least[1]])
        times = sorted((one.least, two.least))
        ratios[f"two studies at {error:g}: advice"] = 1.0 if same else times[0] / times[1]
    good = [row.error for row in first.rows if not row.failure]
    ratios["least error / error of the reference"] = min(good) / first.floor
    return record.Section(
        f"Two studies of the cart-pendulum.\nErrors against {first.reference},\n"
        f"which differ by {first.floor:.1e}. The ratio of the advice is 1 where it is the same,\n"
        "else the less of both times over the other.",
        rows,
        ratios,
    )


def held_out(found: Accuracy) -> record.Section:
    """The largest error of the recommended ways on scenes that were not studied."""
    changes = [{"force": 8.0}, {"force": 12.0}, {"f1": 17.0}, {"frequency": 9.0}]
    scenes = [rj.gallery.cart_pendulum(**change) for change in changes]
    pushed = eqx.tree_at(
        lambda scene: [body.velocity for body in scene.bodies],
        rj.gallery.cart_pendulum(),
        [jnp.full(2, 0.1)] * 2,  # [m/s] along the rail
    )
    names = [", ".join(f"{key}={x:g}" for key, x in change.items()) for change in changes]
    rows = [["scene", *(f"asked {error:g}" for error in ERRORS)]]
    worst = dict.fromkeys(ERRORS, 0.0)
    for name, scene in zip([*names, "pushed"], [*scenes, pushed], strict=True):
        system, cells = rj.assemble(scene), []
        truth = rj.simulate(system, TS, rtol=1e-10, solver=rj.Rodas5P())
        for error in ERRORS:
            run = found.recommend(error).simulate(system, TS)
            reached = float(rj.compare(truth, run).error)
            cells.append(f"{reached:.1e}{' flagged' if not run.is_valid else ''}")
            worst[error] = max(worst[error], reached)
        rows.append([name, *cells])
    ratios = {
        f"held out at {error:g}: {ALLOWED} x asked / error": ALLOWED * error / reached
        for error, reached in worst.items()
    }
    return record.Section("Recommended ways on scenes that were not studied:", rows, ratios)


def saved(found: Accuracy) -> record.Section:
    """What each reduced model saves at its least error, against the full one at the same error."""
    rows = [["model", "method", "rtol", "error", "ms", "full ms", "full / it"]]
    ratios = {}
    for name, model in found.models.items():
        own = [row for row in found.rows if row.model == name and not row.failure]
        if model.reduction is None or not own:
            continue
        # The last half of an error costs more than it is worth.
        least = min(row.error for row in own)
        row = min((row for row in own if row.error <= 1.5 * least), key=lambda row: row.least)
        full = found.cheapest_full(row)
        cells = [name, row.solver, f"{row.rtol:.0e}", f"{row.error:.1e}", f"{1e3 * row.least:.2f}"]
        cells += [f"{1e3 * full.least:.2f}", f"{full.least / row.least:.2f}"] if full else ["", ""]
        rows.append(cells)
        if full:
            ratios[f"full / {name}"] = full.least / row.least
    return record.Section("What reduced models save at their least error:", rows, ratios)


def command() -> record.Section:
    """The time of the command line, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["accuracy", "cart-pendulum", "--budget", f"{BUDGET}", "--out", folder]
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "romjax", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=True,
        )
        taken = time.perf_counter() - start
    return record.Section(
        f"romjax accuracy cart-pendulum --budget {BUDGET}: {taken:.0f} s, of {PATIENCE:g} s.",
        ratios={f"{PATIENCE:g} s / command with --budget {BUDGET}": PATIENCE / taken},
    )


def measure() -> Iterator[record.Section]:
    """The studies, one after the other, then the command."""
    first = study()
    yield again(first, study())
    yield held_out(first)
    yield saved(first)
    yield command()


if __name__ == "__main__":
    record.main(measure)
