"""Measurements of one model."""

from typing import NamedTuple


class ReductionRow(NamedTuple):
    """One model of a mechanism.

    - `name`: what tables call it; `formulation`, `rank`: how it was made, the rank the number of
      its coordinates; `runs`: how many it was trained with, 0 of what needs none.
    - `steps`: of the training run; `time` [s]: the median of runs that alternate with the others,
      on a CPU that of the processor, and `speed_up`, the median of how many times as fast as the
      full model it was.
    - `trained`: error on the runs it was made of; `unseen`: the largest on starts or speeds that it
      was not. Infinite where a run fails, NaN where none could be made.
    - `made`, `compiled` [s]: the time of the processor that it took, training runs included.
      `pays_after`: runs until both are paid for; infinite where it is not faster.
    - `remark`: what speaks against it, in words; `hidden`: of that what its errors hide, a body's
      position, angle or deflection that is wrong, as `Comparison.hidden` says it.
    """

    name: str
    formulation: str
    rank: int
    runs: int
    steps: int
    time: float
    speed_up: float
    trained: float
    unseen: float
    made: float
    compiled: float
    pays_after: float
    remark: str
    hidden: str = ""

    @property
    def error(self) -> float:
        """The larger one of both errors."""
        return max(x for x in (self.trained, self.unseen) if x == x)
