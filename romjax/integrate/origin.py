"""Check of which system a run is of."""

from ..common.checks import check_kind, check_one_run
from ..common.errors import InputError
from ..system.base import AbstractSystem, check_system
from .signature import differs
from .trajectory import Trajectory


def check_origin(owner: str, system: AbstractSystem, run: Trajectory) -> None:
    """Raise InputError, beginning with `owner`, unless `run` is one of this `system`: of its
    coordinates, and as far as the run and JAX let one see, of its numbers.
    """
    check_system(owner, system)
    check_kind(owner, "the run", run, Trajectory, "what romjax.simulate(system, ts) returns")
    check_one_run(owner, run.t)
    labels = system.full.structure.labels
    if run.labels != labels:
        raise InputError(
            f"{owner}: the run has the coordinates {', '.join(run.labels)}, but the system "
            f"{', '.join(labels)}; give the system that was simulated."
        )
    made_with = run.derived.signature
    if made_with is not None and differs(system.full, made_with):
        raise InputError(
            f"{owner}: the run is of a system with these coordinates but with other numbers, of "
            "its bodies, joints or effects; give the system that was simulated, of a lane the one "
            "that its function has simulated."
        )
