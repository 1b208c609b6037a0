"""What a simulation returns."""

import dataclasses
import enum
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..system.flags import WORDS
from ..system.flags import Flag as Doubt


class Status(enum.IntEnum):
    """How a simulation ended."""

    SUCCESS = 0
    MAX_STEPS = 1
    NOT_FINITE = 2
    INCONSISTENT_START = 3
    SOLVER_FAILED = 4
    PRECISION = 5
    JOINTS_PART = 6


REMEDIES = {
    Status.SUCCESS: "",
    Status.MAX_STEPS: "the solver used up max_steps; loosen rtol and atol, raise max_steps, "
    "or use a solver for stiff systems such as romjax.Rodas5P()",
    Status.NOT_FINITE: "the motion became infinite or NaN; the system is unstable, the mechanism "
    "passes a singular position, a beam with stiffening bends as far as it is long, or the step is "
    "too long",
    Status.INCONSISTENT_START: "the start violates the constraints; "
    "use q0, v0 = romjax.consistent(system, q0, v0)",
    Status.PRECISION: "single precision cannot solve for the joint forces of this mechanism: the "
    "masses that a joint connects differ by 1e4 or more, or two joints nearly repeat each other; "
    'call jax.config.update("jax_enable_x64", True) before making any array',
    Status.JOINTS_PART: "not all joints hold on the way; look at the trajectory's violation, take "
    "out joints that contradict each other, or tighten rtol",
    Status.SOLVER_FAILED: "the solver failed inside a step; try another solver",
}


class Trajectory(eqx.Module):
    """A simulated motion at the output times, in physical coordinates.

    - `t` (k,) [s]; `q`, `v` (k, n): coordinates and velocities, lifted if the system was reduced.
    - `multipliers` (k, m): Lagrange multipliers λ of M q̈ + C_qᵀ λ = Q.
    - `violation` (k,): largest |C| of the mechanism's own constraints.
    - `metric` (n, n): mass matrix at the start, the metric of errors and bases.
    - `stats`: numbers of steps (`num_steps`, `num_accepted_steps`, `num_rejected_steps`), the
      tolerances `rtol`, `atol` of the step size control, the stabilisation used, `alpha` and
      `beta`, and where the method or the stabilisation was chosen by it, the `fastest_frequency`
      [rad/s] of the system.
    - `status`: a number of `romjax.Status`; `success` says whether all went well.
    - `doubt`: a number of `romjax.Doubt`, of a reduced model's run; `doubts()` says it in words.
    - `labels`: names of the coordinates. `solver`: name of the method.
    """

    t: Float[Array, " k"]
    q: Float[Array, "k n"]
    v: Float[Array, "k n"]
    multipliers: Float[Array, "k m"]
    violation: Float[Array, " k"]
    metric: Float[Array, "n n"]
    stats: dict[str, Any]
    status: Int[Array, ""]
    labels: tuple[str, ...] = eqx.field(static=True)
    solver: str = eqx.field(static=True)
    doubt: Int[Array, ""] = eqx.field(default_factory=lambda: jnp.zeros((), int))

    @property
    def success(self) -> Bool[Array, ""]:
        """Whether the simulation reached its end with finite numbers."""
        return self.status == Status.SUCCESS

    @property
    def flagged(self) -> Bool[Array, ""]:
        """Whether something speaks against this run of a reduced model."""
        return self.doubt != Doubt.NONE

    def doubts(self) -> str:
        """What speaks against this run, in words; empty if nothing does."""
        found = Doubt(int(self.doubt))
        return "; ".join(WORDS[doubt] for doubt in WORDS if doubt in found)

    def every(self, stride: int) -> "Trajectory":
        """The same motion at every `stride`-th output time."""
        arrays = ("t", "q", "v", "multipliers", "violation")
        return dataclasses.replace(self, **{name: getattr(self, name)[::stride] for name in arrays})

    def noise(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """What the tolerances allow as errors of positions and velocities, in the energy norm.

        The step size control holds the errors of velocities below atol + rtol |v|. Those that point
        out of the motion's own directions oscillate with the fastest frequency ω of the system, and
        so leave 1/ω of it in the positions. Zero for a run in fixed steps: nothing is known of it.
        """
        if "rtol" not in self.stats:
            zero = jnp.zeros((), self.q.dtype)
            return zero, zero
        size = jnp.sqrt(jnp.mean(self.v**2, axis=0))
        allowed = self.stats["atol"] + self.stats["rtol"] * size
        # The control looks at the root mean square over all coordinates and velocities.
        count = 2 * self.q.shape[1]
        speed = jnp.sqrt(count * jnp.sum(jnp.diagonal(self.metric) * allowed**2))
        speed *= jnp.sqrt(self.t[-1] - self.t[0])
        turn = 2 * jnp.pi / (self.t[-1] - self.t[0])
        fastest = jnp.maximum(self.stats.get("fastest_frequency", 0.0), turn)
        return speed / fastest, speed

    def reason(self) -> str:
        """The status in words, with the remedy."""
        status = Status(int(self.status))
        return "success" if status is Status.SUCCESS else f"{status.name}: {REMEDIES[status]}"
