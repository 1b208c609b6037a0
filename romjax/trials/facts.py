"""Facts about a mechanism that decide which reductions are worth trying."""

import dataclasses
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..assembly.assembled import AssembledSystem
from ..compiling.program import program_once
from ..integrate.default import default_method, start_frequencies
from ..integrate.rodas5p import Rodas5P
from ..integrate.trajectory import Trajectory
from ..reduction.joint.formulation import faster_size, size_in_joint_coordinates
from ..scene.joint.prescribed import AbstractPrescribed
from ..scene.scene import Scene
from ..study.accuracy.models import default_caps
from ..study.compare import compare
from ..system import unit_length
from ..system.structure import without_names

# Caps in units of the lowest frequency of a body: one program runs them all. Below it too, where
# dampers between bodies act on what modes leave over of their inertia, which a cap adds to.
_CAPS = tuple(1.4**i for i in range(-6, 24))
# A run of fewer steps follows the motion alone, some swings of it, and nothing that is stiff.
_FEW_STEPS = 400


@dataclasses.dataclass(frozen=True)
class Facts:
    """The structure of a mechanism.

    - `bodies`, `modes`: how many there are, the modes of all flexible bodies together.
    - `freedoms`: of rigid and elastic motion, as the joints leave them at the start.
    - `space`, `loops`, `contacts`: whether bodies move in space, joints close loops, points touch.
    - `drives`: how many motions are prescribed. `tree`: whether joints close no loop, drives apart;
      `jointed`: whether joint coordinates are known to be faster.
    - `caps` [Hz]: of the modes, from below the lowest of their frequencies to the highest.
    - `explicit`: whether an explicit method is fast enough for the full model; `steps`: that its
      run takes; `rests`: whether nothing moves in it. These are known once it has run.
    """

    bodies: int
    modes: int
    freedoms: int
    space: bool = False
    loops: bool = False
    contacts: bool = False
    drives: int = 0
    tree: bool = False
    jointed: bool = False
    caps: tuple[float, ...] = ()
    explicit: bool = True
    steps: int = 0
    rests: bool = False

    @classmethod
    def of(cls, scene: Scene, system: AssembledSystem) -> "Facts":
        """Collect the facts of a scene and its system, before any run."""
        structure, driven = system.structure, drives(scene)
        size = size_in_joint_coordinates(system)
        cut = np.inf if size is None else size[1]
        return cls(
            bodies=len(scene.bodies),
            modes=sum(body.modes for body in scene.bodies),
            freedoms=freedoms(system),
            space=bool(structure.quaternions),
            loops=structure.loops,
            contacts=structure.contacts,
            drives=len(driven),
            tree=bool(cut <= sum(scene.joints[i].rows for i in driven)),
            jointed=faster_size(system) is not None,
            caps=tuple(default_caps(system, _CAPS)),
        )

    def after(self, run: Trajectory) -> "Facts":
        """The facts with those of a run of the full model."""
        return dataclasses.replace(
            self,
            explicit=not isinstance(run.solver, Rodas5P),
            steps=int(run.stats.num_steps),
            rests=not np.any(np.asarray(compare(run, run).moving)),
        )

    def describe(self) -> str:
        """The structure in a few words."""
        words = [f"{self.freedoms} freedom{'s' * (self.freedoms != 1)}"]
        modes = f"{self.modes} mode{'s' * (self.modes != 1)} of flexible bodies"
        words += [modes] * (self.modes > 0)
        words += [f"{self.drives} drive{'s' * (self.drives != 1)}"] * (self.drives > 0)
        # A drive beside its joint closes no loop to speak of.
        words += ["closed loops"] * (self.loops and not self.tree) + ["contacts"] * self.contacts
        return ", ".join(words)

    @property
    def quick(self) -> bool:
        """Whether bodies are rigid, and so few steps follow the motion that nothing is stiff."""
        return not self.modes and self.explicit and self.steps < _FEW_STEPS

    @property
    def stiff(self) -> bool:
        """Whether rigid bodies take many steps, so that something between them is stiff."""
        return not (self.modes or self.quick)

    @property
    def rigid(self) -> int:
        """The freedoms of the bodies' frames."""
        return self.freedoms - self.modes


def beginning(
    system: AssembledSystem,
    ts: Float[Array, " k"],
    solver: diffrax.AbstractSolver[Any] | None,
) -> str:
    """The fastest frequency at the start and the method of the full model, in words, before it has
    run.
    """
    start = start_frequencies(without_names(system), ts, system.q0, system.v0)
    words = f"fastest {float(start.fastest) / (2 * np.pi):.3g} Hz at its start"
    if solver is not None:
        return f"{words}; {type(solver).__name__} was asked for"
    method = default_method(system, ts, None, start)
    return f"{words}; {type(method.solver).__name__}, since {method.reason}"


def drives(scene: Scene) -> list[int]:
    """The numbers of the joints that prescribe a motion."""
    return [i for i, joint in enumerate(scene.joints) if isinstance(joint, AbstractPrescribed)]


def freedoms(system: AssembledSystem) -> int:
    """How many freedoms the joints leave at the start, those that repeat others not counted."""
    rows = np.asarray(joined(without_names(system), system.q0).rows)
    rank = int(np.linalg.matrix_rank(rows)) if len(rows) else 0
    return system.n - len(system.structure.states) - rank


class Joined(NamedTuple):
    """The constraints C of a configuration with their derivatives, lengths of quaternions included,
    and the potential energy [J].
    """

    violation: Float[Array, " M"]
    rows: Float[Array, "M n"]
    stored: Float[Array, ""]


@program_once
def joined(system: AssembledSystem, q: Float[Array, " n"]) -> Joined:
    """Return the constraints, their Jacobian and the potential energy at the start `q`."""
    time = jnp.zeros((), q.dtype)
    elastic, other = system.stored(time, q)
    rows = unit_length.jacobian(system, time, q)
    return Joined(unit_length.extended(system, time, q), rows, elastic + other)
