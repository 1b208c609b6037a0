"""Study of the model, method and tolerance that reach an accuracy in the least time."""

import time
from collections.abc import Sequence
from typing import Any

import diffrax
import jax.numpy as jnp
from tqdm import tqdm

from ...assembly.assemble import assemble
from ...basis.basis import AbstractDecomposition
from ...basis.decomposition.parse import as_decomposition
from ...basis.rank import Rank
from ...common.arrays import Vector
from ...common.errors import InputError
from ...integrate.rodas5p import Rodas5P
from ...integrate.settings import check_times
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from .result import Accuracy
from .run import run_study
from .settings import Settings


def accuracy(
    what: Scene | AbstractSystem,
    ts: Vector,
    *,
    formulations: Sequence[AbstractFormulation | str] = ("minimal", "galerkin"),
    bases: Sequence[AbstractDecomposition | str] = ("POD", "SOD"),
    ranks: Sequence[Rank] | None = None,
    caps: Sequence[float] | None = None,
    solvers: Sequence[diffrax.AbstractSolver[Any]] | None = None,
    tolerances: Sequence[float] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    steps: Sequence[float] = (),
    precisions: Sequence[str] = ("f64", "f32"),
    lanes: Sequence[int] = (1, 256),
    repeats: int = 7,
    budget: int | float | None = None,
    progress: bool = False,
) -> Accuracy:
    """Error against time of full, capped and reduced models, by method and tolerance.

    Errors are those of `Comparison.error` at the output times, against a reference of other
    equations (all minimal coordinates, not redundant ones with constraints) that is ten thousand
    times tighter or more; the full model at the same tolerance says how far that is off. Times are
    those of compiled runs, interleaved. Ctrl-C ends the study with what has been measured.

    **Arguments:**

    - `what`: a scene or a system, in double precision. `ts` (k,): output times [s].
    - `formulations`: of the reduced models. `bases`: decompositions. `ranks`: numbers of modes, or
      "drop"; all minimal coordinates or the drop point of the training run, and some less.
    - `caps`: of the modes of the full model [Hz], see `romjax.cap`; 2.5 and 5 times the lowest
      frequency of a body unless given, where there are modes above.
    - `solvers`: diffrax solvers; Rodas5P and Dopri8 unless given.
    - `tolerances`: of the step size control. `steps`: fixed steps [s] to try beside it.
    - `precisions`: "f64", and "f32" for single precision. `lanes`: how many runs at once, with
      tolerances that differ by up to a fifth. What is best of single runs in double precision is
      tried under the other conditions too.
    - `repeats`: how many times each is timed. `progress`: show a progress bar.
    - `budget`: time to spend [s]; the most promising are tried first, the others listed as skipped.

    Raises InputError or ReductionError for a name or a number that makes no sense, SimulationError
    if the training run fails: the full model at the tightest tolerance.
    """
    settings = Settings(
        [as_formulation(one) for one in formulations],
        [as_decomposition(one) for one in bases],
        ranks,
        caps,
        [Rodas5P(), diffrax.Dopri8()] if solvers is None else list(solvers),
        *(tolerances, steps, precisions, lanes, repeats, budget),
    )
    begin = time.perf_counter()
    system = _in_double_precision(assemble(what) if isinstance(what, Scene) else what)
    times = check_times("accuracy", ts, system.q0.dtype)
    layout = "{desc:48} {n_fmt} runs, {elapsed}"
    with tqdm(disable=None if progress else True, bar_format=layout, desc="full model") as bar:
        return run_study(system, times, settings, begin, bar)


def _in_double_precision(system: AbstractSystem) -> AbstractSystem:
    if system.q0.dtype != jnp.float64:
        raise InputError(
            "accuracy: the system is in single precision, which has no reference to measure errors "
            'against; call jax.config.update("jax_enable_x64", True) before making any array.'
        )
    return system
