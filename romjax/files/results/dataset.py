"""A run as a dataset of xarray, which says what it is without romjax."""

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...common.errors import InputError
from ...common.extras import extra
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene
from ...study.errors.corrected import corrected
from ...system.base import AbstractSystem
from ...system.reduced import reduced_of
from .fitting import dimensions_of
from .measured import measured
from .scenes import scene_words
from .variables import names_of, variables_of

# The version of the layout: what reads it refuses newer ones.
VERSION = 1


def dataset_of_run(
    run: Trajectory, scene: Scene | None, extras: Mapping[str, Any], error: bool = False
) -> Any:
    """The dataset that `Trajectory.to_xarray` describes."""
    xarray = extra("Trajectory.to_xarray", "xarray", "files")
    variables, names = variables_of(run), names_of(run)
    taken = _own_names()
    for name, value in extras.items():
        for quantity in measured(name, value, len(run.t)):
            words = {"long_name": f"{quantity.name}, measured"}
            words |= {"units": quantity.unit} if quantity.unit else {}
            if quantity.name in taken:
                raise InputError(
                    f"Trajectory.to_xarray: '{quantity.name}' is what files of runs call something "
                    f"of their own; give the measured quantity another name."
                )
            variables[quantity.name] = (("time", *quantity.axes), quantity.values, words)
            if quantity.axes == ("axis",):
                axes = np.array([*"xyz"][: quantity.values.shape[1]], object)
                names["axis"] = (("axis",), axes, {"long_name": "axis"})
    attributes = attributes_of(run, scene) | origin("run")
    if error:
        # The estimated error is the distance to the corrected run, in each coordinate.
        richer = corrected(run.system, run)
        attributes["error_words"] = richer.summary()
        for name in ("q", "v"):
            dimensions, values, words = variables[name]
            words = {**words, "long_name": f"{words['long_name']}, estimated error"}
            apart = np.abs(np.asarray(getattr(richer, name)) - values)
            variables[f"{name}_error"] = (dimensions, apart, words)
    return xarray.Dataset(variables, names, attributes)


def _own_names() -> set[str]:
    """The names of variables and of dimensions that a run has, or could have had."""
    own = dimensions_of()
    axes = {axis for shapes in own.values() for shape in shapes for axis in shape}
    return {*own, *axes, "q_error", "v_error", "axis", "lane"}


def origin(kind: str) -> dict[str, Any]:
    """Return the attributes that tell the kind of a result, its versions and its date."""
    versions = {
        f"{package}_version": importlib.metadata.version(package)
        for package in ("romjax", "jax", "jaxlib", "diffrax", "numpy")
    }
    now = datetime.datetime.now(datetime.UTC)
    return {
        "format": f"romjax {kind}",
        "format_version": VERSION,
        "created": now.isoformat(timespec="seconds"),
        "python_version": platform.python_version(),
        **versions,
    }


def attributes_of(run: Trajectory, scene: Scene | None) -> dict[str, Any]:
    """Return the attributes of a dataset: how a run was made and how it went, in words."""
    system = None if run.derived.parts is None else run.system
    held = run.stats.stabilization
    words = {
        "solver": run.solver_name,
        "solver_settings": " ".join(repr(run.solver).split()),
        "stabilization": "none" if held is None else type(held).__name__,
        "warnings": run.warnings() or "none",
        "model": _kind(system),
        **scene_words(run, scene),
    }
    if run.bar is not None:
        words |= {"estimate_by": run.bar.by, "estimate_blind": run.bar.blind}
    if run.t.ndim == 1:
        words["status_words"] = run.summary()
        words["balance_words"] = "" if run.balance is None else run.balance.describe()
    return {name: text for name, text in words.items() if text}


def _kind(system: AbstractSystem | None) -> str:
    rom = None if system is None else reduced_of(system)
    return "full" if rom is None else f"reduced: {rom.summary or type(rom).__name__}"
