"""The result of a simulation."""

import dataclasses
import os
from typing import Any, SupportsIndex

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..assembly.conditioning import conditioning_warning
from ..assembly.disassemble import disassemble
from ..assembly.linear_bodies import linear_warnings
from ..assembly.locate import assembled
from ..common.arrays import Vector, as_number
from ..common.checks import check_one_run, unknown_name
from ..common.errors import InputError
from ..common.files import dataset_of, write_dataset
from ..common.partition import Partitioned
from ..common.pictures import inline, picture_of
from ..events.record import Events
from ..scene.coordinate import Coordinate, find, quaternions_of
from ..scene.scene import Scene
from ..system.base import AbstractSystem
from ..system.flags import WORDS, Flag
from ..system.training import describe_errors, training_of
from .allowed_errors import allowed_errors
from .dense import DenseOutput
from .derived import EagerQuantities, LazyQuantities
from .error_bar import ErrorBar, of_lanes
from .follow.branching import Branching
from .follow.energy_balance import EnergyBalance
from .outputs import strided
from .statistics import Statistics
from .status import Status
from .step_states import StepStates
from .summary import shown, summary


class Trajectory(eqx.Module):
    """A simulated motion at the output times, in physical coordinates.

    - `t` (k,) [s]; `q`, `v` (k, n): coordinates and velocities, lifted if the system was reduced.
      States of effects are in their places in both, so that a row of q is what `linearize` takes.
    - `violation` (k,): largest |C| of the mechanism's own constraints.
    - `multipliers` (k, m): Lagrange multipliers, and `metric` (n, n): mass matrix at the start, of
      quaternions with the mean moment of inertia; evaluated on demand, from what is `derived`.
    - `stats`: numbers of steps (`num_steps`, `num_accepted_steps`, `num_rejected_steps`), the
      tolerances `rtol`, `atol` of the step size control, the `stabilization` used, and where the
      method or the stabilization was chosen by it, the `fastest_frequency` [rad/s] of the system.
    - `status`: a number of `romjax.Status`; `success` says whether all went well,
      `Trajectory.summary` says it in words.
    - `flags`: a number of `romjax.Flag`, what speaks against it; `warnings()` says it in words.
    - `balance`: that of its energy, a `romjax.EnergyBalance`; None where nobody drew it up.
    - `imbalance` (k,): what of its energy was gained up to the step before each output, and not by
      work [J]; None where nobody drew up the balance.
    - `branching`: how it stayed on its branch, a `romjax.Branching`; None without closed loops.
    - `events`: what happened, a `romjax.Events`; None where no events were watched.
    - `dense`: the motion between the outputs, by which `at` goes; None without `dense=True`.
    - `states`: those at the ends of steps, of a mechanism with contacts, which may be shorter than
      the time from one output to the next; None where the outputs are enough.
    - `followed`: what each monitor has seen, in the order of `follow`; not saved with the run.
    - `bar`: the error of the reduced run that this one corrects; None but for `romjax.corrected`.
    - `coordinates`: what the columns of q are (`romjax.Coordinate`); `labels` and `descriptions`
      name them, shortly and in words. `run["cart.x"]` is one by its label, `run["cart.x'"]` its
      rate.
    - `solver_parts`: the method as a pytree. `solver` is the object that it stands for, and
      `solver_name` what messages and tables call it.
    """

    t: Float[Array, " k"]
    q: Float[Array, "k n"]
    v: Float[Array, "k n"]
    violation: Float[Array, " k"]
    derived: EagerQuantities | LazyQuantities
    stats: Statistics
    status: Int[Array, ""]
    coordinates: tuple[Coordinate, ...] = eqx.field(static=True)
    solver_parts: Partitioned
    flags: Int[Array, ""] = eqx.field(default_factory=lambda: jnp.zeros((), int))
    balance: EnergyBalance | None = None
    branching: Branching | None = None
    imbalance: Float[Array, " k"] | None = None
    events: Events | None = None
    dense: DenseOutput | None = None
    states: StepStates | None = None
    followed: tuple[PyTree, ...] = ()
    bar: ErrorBar | None = None

    def __getitem__(self, label: str) -> Float[Array, " k"]:
        """One coordinate by its `label`, such as "cart.x", or its rate by "cart.x'"; (k,), in the
        unit of the coordinate, per second for a rate. A state of an effect is "pid.integral".

        Raises InputError, with the closest labels, if no coordinate has that one.
        """
        column = find(label, self.labels) if isinstance(label, str) else None
        if column is None:
            raise unknown_name("Trajectory", "coordinate", label, self.labels)
        number, is_rate = column
        return (self.v if is_rate else self.q)[..., number]

    @property
    def multipliers(self) -> Float[Array, "*runs k m"]:
        """Lagrange multipliers λ of M q̈ + C_qᵀ λ = Q."""
        return self.derived.multipliers

    @property
    def metric(self) -> Float[Array, "*runs n n"]:
        """Mass matrix at the start, that of errors and bases; of quaternions 4 tr J / 3."""
        return self.derived.metric

    @property
    def system(self) -> AbstractSystem:
        """The system that moved, full or reduced; of a run that was loaded, the full one.

        Raises InputError where the run does not know it: it was made within a transformation of
        JAX, or saved without a scene.
        """
        if self.derived.parts is None:
            raise InputError(
                "Trajectory.system: the run does not know its system, since it was made within a "
                "transformation of JAX, or saved without its scene; use the one that you simulated"
                ", in pictures by romjax.animate(scene, run)."
            )
        system: AbstractSystem = self.derived.parts.combine()
        return system

    @property
    def scene(self) -> Scene:
        """The scene of the system that moved, with the numbers that it was simulated with.

        Raises InputError where the run does not know it, as `Trajectory.system`, or where it is no
        mechanism of bodies.
        """
        return disassemble(assembled("Trajectory.scene", self.system))

    @property
    def labels(self) -> tuple[str, ...]:
        """The coordinates as tables name them, such as "cart.x"."""
        return tuple(coordinate.label for coordinate in self.coordinates)

    @property
    def quaternions(self) -> tuple[int, ...]:
        """The numbers of the coordinates at which the quaternions of bodies in space begin."""
        return quaternions_of(self.coordinates)

    @property
    def descriptions(self) -> tuple[str, ...]:
        """The coordinates in words, such as "bending mode 1 of beam"; else their labels."""
        return tuple(coordinate.description or coordinate.label for coordinate in self.coordinates)

    @property
    def solver(self) -> diffrax.AbstractSolver[Any]:
        """The method, as it was given to `simulate` or chosen by it."""
        solver: diffrax.AbstractSolver[Any] = self.solver_parts.combine()
        return solver

    @property
    def solver_name(self) -> str:
        """The name of the method's class."""
        return type(self.solver).__name__

    @property
    def success(self) -> Bool[Array, "*runs"]:
        """Whether the simulation reached its end with finite numbers."""
        return self.status == Status.SUCCESS

    @property
    def is_valid(self) -> Bool[Array, "*runs"]:
        """Whether it reached its end and has no flag; only `warnings()` looks at the parts."""
        return self.success & (self.flags == Flag.NONE)

    def warnings(self) -> str:
        """Say in words what speaks against this run, as `each_warning`; "" if nothing does."""
        return "; ".join(self.each_warning())

    def each_warning(self) -> tuple[str, ...]:
        """What speaks against this run, each in words of its own; none if nothing does.

        That it failed, that its energy does not balance, what is wrong with a reduced motion, and
        of its parts, evaluated here, that beams without stiffening carry large axial loads, meshes
        bend far, or rounding in the forces of joints shows. Of several runs, those of each lane.
        """
        if self.status.ndim:
            return of_lanes(Trajectory.each_warning, self)
        flags = Flag(int(self.flags))
        words = {flag: WORDS[flag] for flag in WORDS if flag in flags}
        if Flag.ENERGY in flags and self.balance is not None:
            words[Flag.ENERGY] += f" ({self.balance.describe()})"
        if Flag.BRANCH in flags and self.branching is not None:
            words[Flag.BRANCH] += f" ({self.branching.describe()})"
        failure = [] if self.success else [self.summary()]
        parts = self.derived.parts
        if Flag.LEFT_OUT in flags:
            training = None if parts is None else training_of(self.system)
            span = float(self.t[-1] - self.t[0])
            words[Flag.LEFT_OUT] += f" ({describe_errors(training, span)})"
        others = [] if self.bar is None else [self.bar.hidden()]
        if parts is not None:
            system = parts.combine()
            states = system.full, self.t, self.q, self.v
            others += linear_warnings(*states)
            if system.m and self.stats.rtol is not None:
                others.append(conditioning_warning(*states, float(self.stats.rtol)))
        return (*failure, *words.values(), *filter(None, others))

    def summary(self) -> str:
        """The status in words, with the remedy; of success, its steps, how well constraints and
        energy hold, what its flags say, and of a corrected run the error that it tells.
        """
        return summary(self)

    def every(self, stride: SupportsIndex) -> "Trajectory":
        """The same motion at every `stride`-th output time, of each run of a batch.

        Raises InputError for a stride that is no whole number above zero.
        """
        kept = strided("Trajectory.every", stride, self.t.ndim)
        names = ("t", "q", "v", "violation", "imbalance")
        arrays = jax.tree.map(lambda x: x[kept], {name: getattr(self, name) for name in names})
        return dataclasses.replace(self, **arrays, derived=self.derived.every(kept))

    def at(self, times: Vector) -> "Trajectory":
        """The same motion at other `times` (k,) [s], by the dense output of a run that was
        simulated with `dense=True`; an imbalance is that at the output before.

        Raises InputError for a run without dense output, or times outside of it.
        """
        if self.dense is None:
            raise InputError(
                "Trajectory.at: the run has no dense output; simulate it with dense=True."
            )
        ts, outputs, derived = self.dense.at(times)
        imbalance = self.imbalance
        if imbalance is not None:
            imbalance = imbalance[jnp.searchsorted(self.t, ts, side="right") - 1]
        moved = dataclasses.replace(self, t=ts, q=outputs.q, v=outputs.v, derived=derived)
        return dataclasses.replace(moved, violation=outputs.violation, imbalance=imbalance)

    def to_xarray(self, scene: Scene | None = None, *, error: bool = False, **measured: Any) -> Any:
        """The run as an `xarray.Dataset` (extra `files`): dimensions `time`, `coordinate` and
        `constraint` with the names of what they count, units as attributes, and in words what the
        run was made with, how it went, and the scene.

        Numbers are the same to the bit. Dense output is left out. Runs of one batch get a dimension
        `lane`.

        **Arguments:**

        - `scene`: that was simulated; the run's own unless given.
        - `error`: with `q_error` and `v_error`, as `romjax.corrected` tells them of a reduced run.
        - `measured`: further quantities by name: what `measure`, `energy`, `joint_forces` and the
          like return, an array with an axis of outputs, or a pair of one and its unit.

        Raises ImportError without the extra; InputError for a measured array with no row for each
        output or a name of the dataset's own, and a scene with other coordinates than the run.
        """
        return dataset_of(self, scene, extras=measured, error=error)

    def save(
        self, path: str | os.PathLike[str], scene: Scene | None = None, **measured: Any
    ) -> None:
        """Write the run to a netCDF file, as `to_xarray` describes it; `romjax.load` reads it.

        **Arguments:**

        - `path`: of the file, such as "run.nc". `scene`, `measured`: as `to_xarray`.
        """
        write_dataset(self.to_xarray(scene, **measured), path)

    def noise(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Return the errors of positions and velocities that tolerances allow, in the energy norm.

        Steps hold errors of velocities below atol + rtol |v|; those out of the motion's directions
        oscillate with the fastest frequency ω: 1/ω of it in positions. Zero in fixed steps.
        """
        check_one_run("Trajectory.noise", self.t)
        stats = self.stats
        if stats.rtol is None or stats.atol is None:
            zero = jnp.zeros((), self.q.dtype)
            return zero, zero
        fastest: Any = stats.fastest_frequency
        fastest = as_number(0.0, self.q.dtype) if fastest is None else fastest
        return allowed_errors(self.t, self.v, self.metric, stats.rtol, stats.atol, fastest)

    def animate(self, *others: "Trajectory", **options: Any) -> Any:
        """The mechanism as it moves in this run, and in `others` over it: notebooks show it, and
        `.save` writes a page, a GIF or a film. The `options` are those of `romjax.animate`.

        Raises InputError as `Trajectory.system`; `romjax.animate` is told which it is.
        """
        return picture_of(self, *others, **options)

    __repr__ = shown

    def _repr_html_(self) -> str | None:
        """Return the moving picture of the run; None where that needs more than the run."""
        return inline(self.animate)
