"""Files of scenes and results: generic functions, which the folder of files defines for each class.

A run saves itself, and what files hold is known above it: the classes call these, the files
register what they do, and neither imports what imports it.
"""

import functools
import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from . import writing
from .errors import InputError
from .extras import extra

_PACKAGES = ("h5netcdf", "h5py")


@functools.singledispatch
def save(thing: Any, path: str | os.PathLike[str]) -> None:
    """Write a scene to a file; see `Scene.save`."""
    raise TypeError(f"No file holds a {type(thing).__name__}, for {os.fspath(path)}.")


@functools.singledispatch
def dataset_of(
    result: Any,
    scene: Any = None,
    extras: Mapping[str, Any] = MappingProxyType({}),
    error: bool = False,
) -> Any:
    """The dataset of xarray that `Trajectory.to_xarray` describes, with `extras` that were
    measured, by name; or that of a sweep, which is asked for alone.
    """
    del scene, extras, error
    raise TypeError(f"No dataset holds a {type(result).__name__}.")


def check_netcdf(verb: str) -> None:
    """Raise ImportError, with what to install, where netCDF files cannot be read or written."""
    for package in _PACKAGES:
        extra(verb, package, "files")


def write_dataset(dataset: Any, path: str | os.PathLike[str]) -> None:
    """Write a dataset of xarray to a netCDF file."""
    check_netcdf("save")
    for name, variable in dataset.variables.items():
        if np.iscomplexobj(variable):
            raise InputError(
                f"save: '{name}' is complex, but netCDF has real numbers only; save its real and "
                "its imaginary part."
            )
    # In memory, since HDF5 ends the process where the disk is full.
    writing.write(path, dataset.to_netcdf(None, engine="h5netcdf"))
