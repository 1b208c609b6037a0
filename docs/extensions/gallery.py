"""The page of the ready scenes, each with a moving picture of its run."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import executed
import facts
import numpy as np
import records

import romjax as rj
from romjax.gallery import EXAMPLES, Example

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = Path(__file__).parents[1] / "reference" / "gallery.md"
PLOTTED = 2  # coordinates under the motion
MOVING = executed.FOLDER / "extra" / "gallery"
MOVING.mkdir(parents=True, exist_ok=True)

INTRODUCTION = """# Gallery

`rj.gallery` has {count} ready scenes, each a function, with a scene file beside it. The pictures
below are what `rj.animate(scene, run, outputs=2)` makes of a run: space plays and stops, the arrows
go from frame to frame, dragging moves the picture, and the wheel its size once the picture was
pressed. What holds of each is proved by a test of its run. Times, and what a reduction pays, are
from the record of {made}, which `python -m benchmarks gallery` measures; a first answer includes
all compiling.

{list}

Stories begin with a question of a designer and end with a decision:

- [Which move leaves this robot arm at rest?](../tutorials/notebooks/arm_at_rest.ipynb) A light link
  that vibrates, and a move that is quick all the same.
- [How thick must this crank pin be?](../tutorials/notebooks/crank_pin.ipynb) The force in a pin,
  and what a counterweight changes.
- [How fast may this press run?](../tutorials/notebooks/press.ipynb) A bending moment over
  speeds and masses, by a reduced model.
- [How long should this arm take?](../tutorials/notebooks/flexible_robot_arm.ipynb) Meshed links in
  space, reduced and in a batch.
"""
SCENE = """
## {example.name}

{title}. {freedom}; {example.end:g} s, sampled at {example.rate:g} Hz.

<iframe class="moving" src="../gallery/{example.name}.html" title="{example.title}" loading="lazy">
</iframe>

- **What holds.** {known.fact}
- **What you learn.** {known.learn} [Go on](../{known.page}).
- **What it takes.** {taken}
- **Files.** {{download}}`{example.name}.toml <../../romjax/gallery/files/{example.name}.toml>`, and
  [`rj.gallery.{function}`](api/romjax.gallery.{function}.md) with all of its numbers; from the
  shell:

```console
$ romjax run {example.name}
```
"""
TAKEN = "{0.first} s to the first answer, {0.again} ms for a run after it. {0.pays}"
UNKNOWN = "The record does not have this scene yet."


def keep(example: Example, scene: rj.Scene, run: rj.Trajectory) -> None:
    """Keep the moving picture of a run for the site."""
    rj.animate(scene, run, outputs=PLOTTED, title=example.title).save(
        MOVING / f"{example.name}.html"
    )


def _simulate(number: int) -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    example = EXAMPLES[number]
    ts = np.linspace(0.0, example.end, round(example.end * example.rate) + 1)
    scene = example.make()
    run = rj.simulate(rj.assemble(scene), ts, rtol=example.rtol, solver=example.solver)
    keep(example, scene, run)


def _text(example: Example, known: facts.Known, taken: facts.Taken | None) -> str:
    function = example.name.replace("-", "_")
    title = example.title[0].upper() + example.title[1:]
    freedom = {0: "Its drive prescribes the motion", 1: "One degree of freedom"}.get(
        example.freedoms, f"{example.freedoms} degrees of freedom"
    )
    words = UNKNOWN if taken is None else TAKEN.format(taken)
    return SCENE.format(
        example=example, function=function, title=title, freedom=freedom, known=known, taken=words
    )


def page() -> str:
    """The text of the page."""
    known, taken = facts.known(), facts.taken()
    made = records.record("gallery")["made"]
    links = ", ".join(f"[{one.name}](#{one.name})" for one in EXAMPLES)
    head = INTRODUCTION.format(count=len(EXAMPLES), made=made, list=links)
    return head + "".join(_text(one, known[one.name], taken.get(one.name)) for one in EXAMPLES)


def write(app: "Sphinx") -> None:
    """The page, and what its pictures lack."""
    missing = [i for i, x in enumerate(EXAMPLES) if not (MOVING / f"{x.name}.html").exists()]
    if missing:
        # Other processes, since Sphinx forks its own and JAX must not be forked.
        with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
            list(pool.map(_simulate, missing))
    text = page()
    if not PAGE.exists() or PAGE.read_text() != text:
        PAGE.write_text(text)


def setup(app: "Sphinx") -> dict[str, Any]:
    app.connect("builder-inited", write)
    # Beside the page's folder; copied as they are.
    app.config.html_extra_path = [str(MOVING.parent)]
    return {"parallel_read_safe": True, "parallel_write_safe": True}
