"""A run from its dataset."""

import contextlib
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...common.errors import InputError
from ...common.partition import Partitioned
from ...integrate.derived import EagerQuantities
from ...integrate.error_bar import ErrorBar
from ...integrate.rodas5p import Rodas5P
from ...integrate.statistics import Statistics
from ...integrate.trajectory import Trajectory
from ...scene.coordinate import Coordinate
from ...system.stabilization import Baumgarte, Projection, Stabilization
from .scenes import system_of
from .variables import RECORDS


def trajectory_of(dataset: Any, solver: diffrax.AbstractSolver[Any]) -> Trajectory:
    """The run that `dataset_of` made the dataset of; raises KeyError for what it lacks."""

    def array(name: str) -> Array:
        return jnp.asarray(dataset[name].values)

    def optional(name: str) -> Any:
        return array(name) if name in dataset else None

    def record(field: str, **others: Any) -> Any:
        kind, prefix = RECORDS[field]
        first, *_ = kind.arrays()
        if prefix + first not in dataset:
            return None
        return kind(**{name: array(prefix + name) for name in kind.arrays()}, **others)

    statistics = Statistics(
        num_steps=array("num_steps"),
        num_accepted_steps=array("num_accepted_steps"),
        num_rejected_steps=array("num_rejected_steps"),
        # `simulate` holds both as arrays of NumPy.
        rtol=dataset["rtol"].values if "rtol" in dataset else None,
        atol=dataset["atol"].values if "atol" in dataset else None,
        fastest_frequency=optional("fastest_frequency"),
        stabilization=_stabilization(dataset),
    )
    system = system_of(dataset)
    lanes = dataset.sizes.get("lane")
    times = array("time")
    return Trajectory(
        t=times if lanes is None else jnp.broadcast_to(times, (lanes, len(times))),
        q=array("q"),
        v=array("v"),
        violation=array("violation"),
        derived=EagerQuantities(
            array("multipliers"),
            array("metric"),
            None if system is None else Partitioned.of(system),
        ),
        stats=statistics,
        status=array("status"),
        coordinates=_coordinates(dataset),
        solver_parts=Partitioned.of(solver),
        flags=array("flags"),
        balance=record("balance"),
        branching=record("branching"),
        imbalance=optional("imbalance"),
        states=record("states"),
        events=record("events", count=jnp.asarray(np.int64(dataset.sizes.get("occurrence", 0)))),
        bar=_bar(dataset),
    )


def _bar(dataset: Any) -> ErrorBar | None:
    if "estimate_by" not in dataset.attrs:
        return None
    grouped = "estimate_per_group" in dataset
    return ErrorBar(
        jnp.asarray(dataset["estimate"].values),
        str(dataset.attrs["estimate_by"]),
        jnp.asarray(dataset["estimate_per_group"].values) if grouped else (),
        tuple(map(str, dataset["group"].values)) if grouped else (),
        str(dataset.attrs.get("estimate_blind", "")),
    )


def _coordinates(dataset: Any) -> tuple[Coordinate, ...]:
    fields = [dataset[f"coordinate_{field}"].values for field in Coordinate._fields]
    return tuple(Coordinate(*map(str, words)) for words in zip(*fields, strict=True))


def _stabilization(dataset: Any) -> Stabilization:
    if "baumgarte_alpha" in dataset:
        return Baumgarte(
            *(jnp.asarray(dataset[f"baumgarte_{x}"].values) for x in ("alpha", "beta"))
        )
    if "projection_sweeps" in dataset:
        return Projection(int(dataset["projection_sweeps"]))
    return None


def solver_of(
    attributes: dict[str, Any], given: diffrax.AbstractSolver[Any] | None
) -> diffrax.AbstractSolver[Any]:
    """The method of a run: the one that was `given`, or that of its name as it comes.

    Raises InputError where its settings are not those of the run.
    """
    name, settings = str(attributes["solver"]), str(attributes["solver_settings"])
    kind = Rodas5P if name == "Rodas5P" else getattr(diffrax, name, None)
    if given is None and isinstance(kind, type) and issubclass(kind, diffrax.AbstractSolver):
        # Those without defaults are to be given.
        with contextlib.suppress(TypeError):
            given = kind()
    # `Trajectory.solver` is made in the same way.
    if given is None or " ".join(repr(Partitioned.of(given).combine()).split()) != settings:
        raise InputError(
            f"load: the run was made by {settings}, "
            f"not by {given!r}; give its method, romjax.load(path, solver=…), or open the file by "
            "xarray.open_dataset."
        )
    return given
