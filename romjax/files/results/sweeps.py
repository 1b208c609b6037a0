"""A sweep as a dataset of xarray: a dimension of lanes, and their parameters as coordinates."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...common.errors import InputError
from ...common.extras import extra
from ...integrate.trajectory import Trajectory
from ...study.sweeps.sweep import Sweep
from .dataset import origin
from .variables import Variable, meanings_of_flags, meanings_of_status, names_of, variables_of


def dataset_of_sweep(sweep: Sweep) -> Any:
    """The dataset that `Sweep.to_xarray` describes."""
    xarray = extra("Sweep.to_xarray", "xarray", "files")
    lanes = np.arange(len(sweep.status))
    names: dict[str, Variable] = {"lane": (("lane",), lanes, {"long_name": "one variant"})}
    for name, values in _leaves(sweep.parameters, "parameter"):
        names[name] = _variable(name, values, "parameter")
    variables, attributes = dict[str, Variable](), origin("sweep")
    leaves = list(_leaves(sweep.values, "value"))
    # A sweep holds arrays of NumPy.
    runs = [jax.tree.map(jnp.asarray, run) for _, run in leaves if isinstance(run, Trajectory)]
    if len(runs) > 1:
        raise InputError(
            f"Sweep.to_xarray: each lane holds {len(runs)} runs, whose dimensions would be mixed "
            "up; return one of them, or arrays."
        )
    for run in runs:
        variables |= variables_of(run)
        names |= names_of(run) | {"lane": names["lane"]}
        attributes["solver"] = run.solver_name
    for name, value in leaves:
        if not isinstance(value, Trajectory):
            key = f"value.{name}" if name in names or name in variables else name
            variables[key] = _variable(key, value, "what each lane returns")
    for name in ("by_full", "estimates"):  # of sweeps over a box
        if hasattr(sweep, name):
            variables[name] = _variable(name, getattr(sweep, name), name.replace("_", " "))
    words = {"long_name": "how each lane ended"} | meanings_of_status()
    variables["status"] = (("lane",), sweep.status, words)
    words = {"long_name": "what speaks against each lane, as a sum"} | meanings_of_flags()
    variables["flags"] = (("lane",), sweep.flags, words)
    failures = sweep.failures()
    said = np.array([failures.get(int(lane), "") for lane in lanes], object)
    variables["failure"] = (("lane",), said, {"long_name": "why it failed, and what helps"})
    return xarray.Dataset(variables, names, attributes)


def _leaves(tree: Any, alone: str) -> Iterator[tuple[str, Any]]:
    """The arrays and runs in a pytree by their paths; one that is `alone` is called so."""
    leaves = jax.tree.leaves_with_path(tree, is_leaf=lambda x: isinstance(x, Trajectory))
    for path, leaf in leaves:
        yield jax.tree_util.keystr(path, simple=True, separator=".") or alone, leaf


def _variable(name: str, values: Any, words: str) -> Variable:
    array = np.asarray(values)
    axes = tuple(f"{name}_{axis}" for axis in range(1, array.ndim))
    return ("lane", *axes), array, {"long_name": words}
