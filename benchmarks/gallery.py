"""What reductions of every scene of the gallery pay: the best model of each against the full one,
on starts or speeds that it has not seen, or in a sentence why none pays. Writes `gallery.txt`
beside this file.
"""

import gc
import json
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

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


class Scene(NamedTuple):
    """What is kept of a scene: all that is said of it, its row of the table, and how many times as
    fast its best model is, None where none pays.
    """

    name: str
    text: str
    row: list[str]
    times: float | None


def measured(example: Example, budget: float) -> Scene | None:
    """The models of a scene in words; None if they were interrupted."""
    found = studied(example, budget)
    if INTERRUPTED in found.skipped.values():
        return None
    # Scenes may be measured one by one, as the code goes on.
    text = f"{example.name}, {example.end:g} s, commit {record.commit()}.\n\n{found.summary()}"
    best = found.recommended
    times = None if best is None else best.speed_up
    return Scene(example.name, text, row(example.name, found), times)


def row(name: str, found: rj.Reductions) -> list[str]:
    """The best model of a scene, or the nearest to one."""
    full, best = found.full, found.recommended
    if best is None:
        return [name, "-", "", f"{full.steps}", "", "", "", ""]
    times = f"{best.speed_up:.1f}"
    errors = [f"{best.trained:.1e}", f"{best.unseen:.1e}", f"{best.pays_after:.0f}"]
    return [name, best.name, f"{best.steps}", f"{full.steps}", times, *errors]


def kept(resume: Path | None) -> dict[str, Scene]:
    """What a run before has measured, by the names of scenes."""
    if resume is None or not resume.exists():
        return {}
    scenes = [Scene(**json.loads(line)) for line in resume.read_text().splitlines()]
    return {scene.name: scene for scene in scenes}


def measure(budget: float, scenes: list[str], resume: Path | None) -> Iterator[record.Section]:
    """A sentence and the models of each scene, then the table of the best."""
    yield record.Section(
        f"Models are tried for {budget:g} s of a processor a scene; the best is fast, and errs by\n"
        f"at most {TOL:g} on three starts or speeds that it was not trained with. Times are\n"
        "medians of runs in turns with the full model, each by the method that suits it."
    )
    rows, ratios, counts, going = [HEADER], {}, dict.fromkeys(FAST, 0), True
    failures, before = [], kept(resume)
    for example in [one for one in EXAMPLES if not scenes or one.name in scenes]:
        try:
            scene = before.get(example.name) or measured(example, budget)
        except KeyboardInterrupt:
            scene = None
        except Exception as error:  # the others are worth measuring
            traceback.print_exc()
            failures.append(f"{example.name}: {error}")
            continue
        if scene is None:
            going = False
            break
        if resume is not None and example.name not in before:
            with resume.open("a") as file:
                file.write(json.dumps(scene._asdict()) + "\n")
        print(f"{scene.text}\n", file=sys.stderr, flush=True)
        yield record.Section(scene.text)
        rows.append(scene.row)
        if scene.times is not None:
            ratios[f"{scene.name}: full / best"] = scene.times
            for least in FAST:
                counts[least] += scene.times >= least
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
    choices = {
        "budget": {
            "type": float,
            "default": 40.0,
            "metavar": "S",
            "help": "time for a scene (%(default)s)",
        },
        "scenes": {"nargs": "*", "default": [], "metavar": "NAME", "help": "these only"},
        "resume": {
            "type": Path,
            "metavar": "FILE",
            "help": "file of JSON lines to which each scene is added as soon as it is measured; "
            "those that are in it are not measured again",
        },
    }
    # Flags for programs of one's own take a rod's to compile four times as long, for nothing here.
    record.main(measure, record.begin_as_users, choices)
