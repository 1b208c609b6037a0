"""Parser of the command line: verbs and their options."""

import argparse
from pathlib import Path
from typing import Any

from . import __version__


def parser() -> argparse.ArgumentParser:
    """The parser of the command line; each verb is in `verb`, by name."""
    made = argparse.ArgumentParser(
        prog="romjax",
        description="Differentiable reduced-order simulation of flexible multibody systems.",
    )
    made.add_argument("--version", action="version", version=f"romjax {__version__}")
    verbs = made.add_subparsers(dest="verb", required=True, metavar="VERB")
    verbs.add_parser("scenes", help="list the ready scenes")
    _add_run(verbs)
    _add_accuracy(verbs)
    _add_tune(verbs)
    _add_files(verbs)
    return made


def _add_run(verbs: Any) -> None:
    """The verb that simulates a scene and tries its reductions."""
    run = verbs.add_parser(
        "run",
        help="simulate a scene, try what reductions pay, recommend one",
        description="Simulate a scene, try the reductions that its structure suggests, judge them "
        "on starts that they have not seen, print the table with the recommended one first, and "
        "write a page, report.html, with the moving mechanism and all figures; beside it figures "
        "(PNG), an animation (GIF) and the trajectories (CSV). Ctrl-C ends the trials. The same "
        "command shows the same table again, with the day on which it was measured.",
    )
    _add_scene(run)
    run.add_argument("--rate", type=float, metavar="HZ", help="sample rate (that of the scene)")
    run.add_argument("--rtol", type=float, help="tolerance of all runs (that of the scene)")
    run.add_argument(
        "--pod-rank", type=int, metavar="R", help="modes of POD, in the chapter's table"
    )
    run.add_argument(
        "--sod-rank", type=int, metavar="R", help="modes of SOD, in the chapter's table"
    )
    run.add_argument(
        "--budget",
        type=float,
        default=40.0,
        metavar="S",
        help="time of a processor to try models in (40)",
    )
    run.add_argument(
        "--all", action="store_true", help="show all models, and POD and SOD as in the chapter"
    )
    run.add_argument(
        "--again", action="store_true", help="measure anew what the same command has measured"
    )
    run.add_argument("--no-animation", action="store_true", help="leave out the animation")


def _add_accuracy(verbs: Any) -> None:
    """The verb that measures what accuracy costs."""
    costs = verbs.add_parser(
        "accuracy",
        help="what accuracy costs in time: models, methods and tolerances of a scene",
        description="Measure error and time of the full and of reduced models of a scene by "
        "several methods and tolerances, alone and 256 at once, in double and in single precision, "
        "recommend the cheapest for each error, and write a table (CSV), a figure (PNG) and a page "
        "(HTML). Ctrl-C ends it with what has been measured.",
    )
    _add_scene(costs)
    costs.add_argument(
        "--budget", type=float, default=120.0, metavar="S", help="time to spend (120)"
    )
    costs.add_argument("--rate", type=float, metavar="HZ", help="outputs (those of the scene)")


def _add_tune(verbs: Any) -> None:
    """The verb that searches Baumgarte's parameters."""
    tune = verbs.add_parser(
        "tune",
        help="find Baumgarte's parameters for a scene by gradient",
        description="Find the parameters of Baumgarte's stabilisation that keep the constraints of "
        "a scene best, and write a figure of the search.",
    )
    _add_scene(tune)
    tune.add_argument("--rtol", type=float, default=1e-6, help="tolerance of the runs (1e-6)")
    tune.add_argument("--dt", type=float, metavar="S", help="a fixed step instead")
    tune.add_argument("--steps", type=int, default=300, help="most steps of the search (300)")


def _add_files(verbs: Any) -> None:
    """The verbs for scene files."""
    new = verbs.add_parser("new", help="write a scene file to begin with")
    new.add_argument("--space", action="store_true", help="in three dimensions")
    check = verbs.add_parser(
        "check",
        help="say what a scene file is, without running it",
        description="Print the bodies, joints, freedoms and effects of a scene file, the joints "
        "that repeat others, the fastest frequency, and the method that a run would take and why; "
        "or all its mistakes, with their lines.",
    )
    for verb in (new, check):
        verb.add_argument("file", type=Path, metavar="FILE", help="such as crank.toml")
    verbs.add_parser(
        "schema", help="print the JSON schema of scene files, from which editors complete keys"
    )


def _add_scene(verb: argparse.ArgumentParser) -> None:
    """Add the arguments of every verb that simulates."""
    verb.add_argument(
        "scene", help="a ready scene, a scene file, or a Python file that defines `scene`"
    )
    verb.add_argument("--out", type=Path, metavar="DIR", help="folder to write to (romjax-NAME)")
    verb.add_argument("--end", type=float, metavar="S", help="simulated time (that of the scene)")
