"""Results on disk, as netCDF files."""

import os
from typing import Any

import diffrax
import jax
import numpy as np

from ...common.errors import InputError
from ...common.extras import extra
from ...common.files import check_netcdf, dataset_of
from ...integrate.trajectory import Trajectory
from ...study.sweeps.sweep import Sweep
from .dataset import VERSION, dataset_of_run
from .fitting import check_arrays, check_scene
from .restore import solver_of, trajectory_of
from .sweeps import dataset_of_sweep

# How runs and sweeps save themselves.
dataset_of.register(Trajectory, dataset_of_run)
dataset_of.register(Sweep, dataset_of_sweep)


def load(
    path: str | os.PathLike[str], solver: diffrax.AbstractSolver[Any] | None = None
) -> Trajectory:
    """The run in a netCDF file that `Trajectory.save` has written, the same to the bit (extra
    `files`), but for dense output, which is not saved.

    `Trajectory.scene` and `Trajectory.system` are those of the file's text, so that
    `simulate(run.system, run.t, rtol=run.stats.rtol)` repeats a run of a full system from its own
    start.

    **Arguments:**

    - `path`: of the file. Other programs read it too, as `xarray.open_dataset` does.
    - `solver`: the method of the run, where that is one of your own or has settings of its own: a
      file holds them in words only.

    Raises ImportError, with what to install, without the extra; InputError for a file that is not
    there, that holds something else, whose arrays do not fit each other or its scene, that a newer
    romjax has written, or that is in double precision where JAX is set to single, or for another
    `solver` than that of the run.
    """
    xarray = extra("load", "xarray", "files")
    check_netcdf("load")
    try:
        dataset = xarray.load_dataset(path)
    except FileNotFoundError as error:
        raise InputError(f"load: there is no file {path}.") from error
    except Exception as error:  # whatever a broken file makes a reader do
        raise InputError(
            f"load: {path} is no netCDF file, or a damaged one; give one that Trajectory.save has "
            "written."
        ) from error
    try:
        _check(dataset, path)
        check_arrays(dataset, path)
        run = trajectory_of(dataset, solver_of(dataset.attrs, solver))
    except KeyError as error:
        lacking = str(error.args[0]).partition(". ")[0]
        raise InputError(f"load: {path} is damaged ({lacking}); save the run again.") from error
    check_scene(run, dataset, path)
    return run


def _check(dataset: Any, path: str | os.PathLike[str]) -> None:
    """Raise InputError unless a dataset is one of a run that can be held."""
    kind = dataset.attrs.get("format", "")
    if kind != "romjax run":
        what = f"holds a {kind}" if str(kind).startswith("romjax") else "was not written by romjax"
        raise InputError(
            f"load: {path} {what}, but a run is asked for; open it by xarray.open_dataset."
        )
    version = dataset.attrs.get("format_version", 0)
    if not isinstance(version, int | np.integer) or version > VERSION:
        raise InputError(
            f"load: {path} is of version {version}, but this romjax knows versions up to "
            f"{VERSION}; install a newer romjax, or open it by xarray.open_dataset."
        )
    if dataset["q"].dtype == np.float64 and not jax.config.read("jax_enable_x64"):
        raise InputError(
            f'load: {path} is in double precision; call jax.config.update("jax_enable_x64", True) '
            "before making any array."
        )
