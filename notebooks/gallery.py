"""Draws the ready scenes on one sheet: `python notebooks/gallery.py` writes `gallery.png`.

Each is shown as its run with the default settings leaves it after a while, over its start and some
of its way there in grey.
"""

from pathlib import Path

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import romjax as rj
from romjax.assembly.outlines import outlines
from romjax.gallery import EXAMPLES, Example
from romjax.plot.mechanism import Picture, bounds, framed, projected, stage
from romjax.plot.palette import VIEW

COLUMNS = 4
# The share of its run at which a scene is shown, where that is not one half.
SHOWN = {"chain": 1.0, "double-pendulum": 0.1, "trebuchet": 0.8, "newtons-cradle": 0.2}
SHOWN |= {"robot-arm": 0.33, "bouncing-ball": 0.6, "segmented-beam": 0.35, "vehicle-axle": 0.15}
SHOWN |= {"jansen": 0.3, "connecting-rod": 0.2, "slider-crank": 0.08, "four-bar": 0.3}
SHOWN |= {"ball-chain": 1.0, "rotating-blade": 0.1, "squeezer": 0.4}


def draw(axes: Axes, example: Example) -> None:
    """One scene, with the number of its freedoms."""
    ts = np.linspace(0.0, example.end, round(example.end * example.rate) + 1)
    scene = example.make()
    run = rj.simulate(rj.assemble(scene), ts, solver=example.solver)
    last = round(SHOWN.get(example.name, 0.5) * (len(ts) - 1))
    frames = np.linspace(0, last, 4).astype(int)
    parts = projected(outlines(scene, ts[frames], np.asarray(run.q)[frames]))
    for k in range(len(frames) - 1):
        ghost = Picture(axes, parts, details=False, color="0.8", linewidth=0.8, zorder=1)
        ghost.show(k)
    Picture(axes, parts, color="black", linewidth=1.4).show(len(frames) - 1)
    stage(axes, framed(bounds(parts)), None if scene.dimension == 2 else VIEW)
    axes.set_title(f"{example.name}  ({example.freedoms})", fontsize=9)
    axes.tick_params(labelsize=6, length=2)
    axes.locator_params(nbins=4)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    rows = -(-len(EXAMPLES) // COLUMNS)
    figure = Figure(figsize=(10.0, 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, COLUMNS).ravel()
    for axes, example in zip(panels, EXAMPLES, strict=False):
        draw(axes, example)
    for axes in panels[len(EXAMPLES) :]:
        axes.set_axis_off()
    figure.supxlabel("x [m], y [m]; in brackets the degrees of freedom", fontsize=8)
    path = Path(__file__).with_suffix(".png")
    figure.savefig(path, dpi=100)
    with Image.open(path) as picture:
        picture.convert("L").quantize(16).save(path, optimize=True)  # all is grey
