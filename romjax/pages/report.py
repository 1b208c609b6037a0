"""Report on the gain of reduction for a scene: one page, and the files that it is made of."""

import contextlib
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import plot
from ..basis.basis import Basis
from ..basis.decomposition.pod import POD
from ..basis.decomposition.sod import SOD
from ..basis.describe import describe
from ..common import writing
from ..common.beside import Begin
from ..common.errors import InputError
from ..gallery.catalogue import Example
from ..integrate.trajectory import Trajectory
from ..plot.motion.animate import animate
from ..plot.motion.animation import Animation
from ..plot.png import png
from ..scene.scene import Scene
from ..study.reduction import ReductionStudy
from ..trials.advice import WRONG
from ..trials.result import Reductions
from . import chapter, csv_table, document

# Models whose motions are shown over the full one.
_SHOWN = 3
# Coordinates that are plotted under the motion.
_PLOTTED = 2
_DPI = 100  # of figures


class Drawn(NamedTuple):
    """The pictures of a result without its study: figures by name, and the motion, with what waits
    for its GIF where another process makes it.
    """

    pictures: dict[str, bytes]
    moving: Animation | None
    filmed: Callable[[], bytes] | None


def draw(
    result: Reductions,
    scene: Scene,
    example: Example,
    animation: bool,
    begin: Begin | None = None,
) -> Drawn:
    """Draw a result, for which its study need not have ended; `begin`: begins the GIF in another
    process.
    """
    truth, approx = result.truth, best(result)
    moving = filmed = None
    if animation:
        runs = {"full": truth} | approx
        moving = animate(
            scene, *runs.values(), labels=list(runs), outputs=_PLOTTED, title=example.name
        )
        with contextlib.suppress(ChildProcessError):  # it will be made here
            filmed = None if begin is None else begin(_film, moving)
    figures = {
        **({"reductions": plot.reductions(result)} if result.rows else {}),
        "responses": plot.response(truth, *approx.values(), labels=["full", *approx]),
        **({"errors": plot.errors(truth, approx)} if approx else {}),
    }
    return Drawn(_pngs(figures), moving, filmed)


def write(
    result: Reductions,
    study: ReductionStudy | None,
    scene: Scene,
    example: Example,
    folder: Path,
    drawn: Drawn,
    of_study: Mapping[str, bytes] | None = None,
) -> list[Path]:
    """Write the page, figures, the animation and the trajectories into `folder`; returns the files,
    the page first.

    The page holds all that can be looked at. The figures and the GIF are for papers and slides.
    `of_study`: the pictures of the study's bases, where they are drawn already.
    """
    truth, approx, moving = result.truth, best(result), drawn.moving
    bases = _bases(result.truth) if study is None else study.bases
    pictures = {**drawn.pictures, **(of_bases(scene, bases) if of_study is None else of_study)}
    swinging = animate(scene, next(iter(bases.values()))) if moving and bases else None
    page = _page(result, study, example, bases, pictures, (moving, swinging))
    contents: dict[str, str | bytes] = {"report.html": page}
    contents |= {f"{name}.png": content for name, content in pictures.items()}
    for name, trajectory in {"full": truth, **approx}.items():
        words = name.replace("=", " ").replace(",", "").replace(" ", "_").lower()
        contents[f"trajectory_{words}.csv"] = _csv(trajectory, trajectory is truth)
    try:
        if moving is not None:
            contents["animation.gif"] = _film(moving) if drawn.filmed is None else drawn.filmed()
    finally:  # all else, should the other process have been ended
        with writing.together():
            for name, content in contents.items():
                writing.write(folder / name, content)
    return [folder / name for name in contents]


def _film(moving: Animation) -> bytes:
    """The content of a GIF, which another process hands to the one that writes all files."""
    with tempfile.TemporaryDirectory() as folder:
        return moving.save(Path(folder) / "film.gif", fps=20, progress=False).read_bytes()


def of_bases(scene: Scene, bases: Mapping[str, Basis]) -> dict[str, bytes]:
    """The pictures of some bases: their singular values, and their modes."""
    drawn = {"singular_values": plot.values(*bases.values())} if bases else {}
    for name, basis in bases.items():
        drawn[f"modes_{name.lower()}"] = plot.modes(scene, basis)
    return _pngs(drawn)


def _pngs(figures: Mapping[str, Any]) -> dict[str, bytes]:
    return {name: png(figure, _DPI) for name, figure in figures.items()}


def best(result: Reductions) -> dict[str, Trajectory]:
    """The motions of the best models that follow the full one, by their names."""
    pairs = zip(result.rows, result.runs, strict=True)
    good = [(row.name, run) for row, run in pairs if row.error <= WRONG and bool(run.success)]
    return dict(good[:_SHOWN])


def _bases(truth: Trajectory) -> dict[str, Basis]:
    """Return the bases of the motion by POD and SOD, as far as it has any."""
    bases = {}
    for decomposition in (POD(), SOD()):
        with contextlib.suppress(InputError):
            bases[decomposition.name] = decomposition(truth)
    return bases


def _page(
    result: Reductions,
    study: ReductionStudy | None,
    example: Example,
    bases: dict[str, Basis],
    pictures: dict[str, bytes],
    moving: tuple[Animation | None, Animation | None],
) -> str:
    """Return a page with the table, the moving mechanism and modes, and the figures."""
    system, (motion, modes) = result.system, moving
    body = [
        document.paragraph(
            f"{example.title[:1].upper()}{example.title[1:]}: {system.n} coordinates, "
            f"{system.m} constraints, "
            f"{float(result.truth.t[-1]):g} s."
        ),
        "" if motion is None else motion.embedded(),
        document.heading("What pays"),
        document.paragraph(result.advice),
        document.table(*result.cells(every=True)),
        document.bullets(result.notes(every=True)),
        *([] if study is None else chapter.parts(study, example)),
        document.heading("Bases"),
        *(document.paragraph(describe(basis)) for basis in bases.values()),
        "" if modes is None else modes.embedded(),
        document.heading("Figures"),
        *(document.picture(content, name) for name, content in pictures.items()),
    ]
    return document.document(example.name, *body)


def _csv(trajectory: Trajectory, with_multipliers: bool) -> str:
    """Time, coordinates and velocities as comma-separated columns with a header; and multipliers,
    which are a program for each model that takes longer to compile than all figures to draw.
    """
    labels = ["t", *trajectory.labels, *(f"d/dt {label}" for label in trajectory.labels)]
    columns: list[Any] = [np.asarray(trajectory.t)[:, None], trajectory.q, trajectory.v]
    if with_multipliers:
        labels += [f"lambda{i + 1}" for i in range(trajectory.multipliers.shape[1])]
        columns.append(trajectory.multipliers)
    return csv_table.text(labels, np.concatenate(columns, axis=1).tolist())
