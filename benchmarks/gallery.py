"""What reductions of every scene of the gallery pay: the best model of each against the full one,
on starts or speeds that it has not seen, or in a sentence why none pays. Writes `gallery.txt`
beside this file.
"""

import gc
import sys
import traceback
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import record

import romjax as rj
from romjax.gallery import EXAMPLES, Example
from romjax.trials.reductions import INTERRUPTED

TOL = 1e-3  # error of models that count, on unseen starts too
FAST = (2, 8)  # times as fast, of which the scenes are counted
HEADER = ["scene", "model", "steps", "of", "times", "trained", "unseen", "pays after"]


def studied(example: Example, budget: float) -> rj.Reductions:
    """The models of a scene, tried for a time [s]."""
    ts = np.linspace(0.0, example.end, round(example.end * example.rate) + 1)
    settings: dict[str, Any] = {"rtol": example.rtol, "solver": example.solver}
    return rj.reductions(example.make(), ts, tol=TOL, budget=budget, progress=True, **settings)


def row(name: str, found: rj.Reductions) -> list[str]:
    """The best model of a scene, or the nearest to one."""
    full, best = found.full, found.recommended
    if best is None:
        return [name, "-", "", f"{full.steps}"]
    times = f"{best.speed_up:.1f}"
    errors = [f"{best.trained:.1e}", f"{best.unseen:.1e}", f"{best.pays_after:.0f}"]
    return [name, best.name, f"{best.steps}", f"{full.steps}", times, *errors]


def measure(budget: float) -> Iterator[record.Section]:
    """A sentence and the models of each scene, then the table of the best."""
    yield record.Section(
        f"Models are tried for {budget:g} s of a processor a scene; the best is fast, and errs by\n"
        f"at most {TOL:g} on three starts or speeds that it was not trained with. Times are\n"
        "medians of runs in turns with the full model, each by the method that suits it."
    )
    rows, ratios, counts, going = [HEADER], {}, dict.fromkeys(FAST, 0), True
    failures = []
    for example in EXAMPLES:
        try:
            found = studied(example, budget)
        except KeyboardInterrupt:
            going = False
            break
        except Exception as error:  # the others are worth measuring
            traceback.print_exc()
            failures.append(f"{example.name}: {error}")
            continue
        going = INTERRUPTED not in found.skipped.values()
        if not going:
            break
        print(f"{example.name}\n{found.summary()}\n", file=sys.stderr, flush=True)
        yield record.Section(f"{example.name}, {example.end:g} s.\n\n{found.summary()}")
        rows.append(row(example.name, found))
        best = found.recommended
        if best is not None:
            ratios[f"{example.name}: full / best"] = best.speed_up
            for least in FAST:
                counts[least] += best.speed_up >= least
        jax.clear_caches()
        gc.collect()
    for least, count in counts.items():
        ratios[f"scenes with a model {least} times as fast"] = count
    yield record.Section(f"The best of each scene; errors of at most {TOL:g}:", rows, ratios)
    if not going:
        raise KeyboardInterrupt
    if failures:
        raise RuntimeError("; ".join(failures))


if __name__ == "__main__":
    budget = {"type": float, "default": 40.0, "metavar": "S"}
    record.main(measure, choices={"budget": {**budget, "help": "time for a scene (%(default)s)"}})
