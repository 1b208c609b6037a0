"""Check of which system a run is of."""

from ..common.checks import check_kind, check_one_run
from ..common.errors import InputError
from ..system.base import AbstractSystem, check_system
from .trajectory import Trajectory


def check_origin(owner: str, system: AbstractSystem, run: Trajectory) -> None:
    """Raise InputError, beginning with `owner`, unless `run` is one of this `system`."""
    check_system(owner, system)
    check_kind(owner, "the run", run, Trajectory, "what romjax.simulate(system, ts) returns")
    check_one_run(owner, run.t)
    labels = system.full.structure.labels
    if run.labels != labels:
        raise InputError(
            f"{owner}: the run has the coordinates {', '.join(run.labels)}, but the system "
            f"{', '.join(labels)}; give the system that was simulated."
        )
