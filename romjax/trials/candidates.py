"""Candidates: the reductions that the structure of a mechanism makes worth trying."""

import dataclasses
import math
from collections.abc import Callable, Sequence

from ..basis.basis import AbstractDecomposition
from ..basis.decomposition.pod import POD
from ..reduction.formulation.base import AbstractFormulation
from ..reduction.formulation.galerkin import Galerkin
from ..reduction.formulation.minimal import Minimal
from ..reduction.hyper.formulation import HyperReduced
from ..reduction.joint.formulation import JointCoordinates
from ..reduction.local.formulation import Local
from ..reduction.tables.formulation import Tabulated
from .facts import Facts

# The share of the largest singular value down to which modes are kept: the least, at first, and
# the most.
_SHARES = (1e-10, 1e-3, 0.5)
# After a model that errs too much comes one whose expected error is this share of the limit; and
# the least and the largest fall of the error from one model to the next.
_AIM, _FALL = 0.3, (0.2, 3e-4)
# A model with less than this share of the allowed error has more modes than it needs.
_SPARE = 0.02
# The number of the first cap to try, by rising frequency; errors fall with this power of it.
_FIRST_CAP, _OF_CAPS = 2, -2.0
# `Tabulated.tol`: enough for the errors that are asked for, and faster to make than the default.
_TABLE = 1e-5
# With fewer hinged bodies, hyper-reduction saves nothing: all bodies are evaluated as fast.
_MANY_BODIES = 6
# With so few freedoms, each number of modes up to theirs is tried.
_FEW = 3


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """A reduction to try: a `formulation` and the `decomposition` of its basis, which says how many
    modes, None of one that needs no basis; or a `cap` [Hz] on the modes of bodies instead. `level`:
    where it is on the scale of its kind.
    """

    formulation: AbstractFormulation | None = None
    decomposition: AbstractDecomposition | None = None
    cap: float | None = None
    level: float = math.nan


@dataclasses.dataclass(frozen=True)
class Scale:
    """Candidates of a kind by their level, between the `least` and the `most`: errors grow with its
    power `order`, about.
    """

    make: Callable[[float], Candidate]
    least: float
    most: float
    order: float = 1.0

    def other(self, than: Candidate, factor: float) -> Candidate | None:
        """The candidate that should err by a factor as much as a given one; None where the scale
        ends.
        """
        level = min(max(than.level * factor ** (1 / self.order), self.least), self.most)
        return None if level == than.level else self.make(level)

    def between(self, one: Candidate, other: Candidate) -> Candidate:
        """Return the candidate half way from one to another."""
        return self.make(math.sqrt(one.level * other.level))


@dataclasses.dataclass(frozen=True)
class Family:
    """Candidates of one kind: one after the other, or the first and the `scale` of all.

    `trained`: whether a run is what the model knows, so that several may be better than one.
    `compiles`: whether each of its models needs a program of its own.
    """

    name: str
    candidates: tuple[Candidate, ...]
    trained: bool = True
    scale: Scale | None = None
    compiles: bool = True

    def finer(self, than: Candidate, excess: float) -> Candidate | None:
        """Return the next candidate after one that errs by `excess` times what is asked."""
        if self.scale is not None:
            least, most = _FALL
            return self.scale.other(than, min(max(_AIM / excess, most), least))
        later = self.candidates[self.candidates.index(than) + 1 :]
        return later[0] if later else None

    def coarser(self, than: Candidate, excess: float, wrong: Candidate | None) -> Candidate | None:
        """Return a coarser candidate that may do, next to one that errs `excess` times as asked.

        `wrong`: a coarser one that is known to be wrong, if there is any.
        """
        if self.scale is None:
            return None
        if wrong is not None:
            return self.scale.between(wrong, than)
        return self.scale.other(than, _AIM / excess) if excess < _SPARE else None


def families(facts: Facts) -> list[Family]:
    """Return the kinds of models that are worth trying, the most promising first.

    Where bodies bend, their few slow shapes are all that a motion excites, whatever it is: caps,
    bases of amplitudes in joint coordinates, and local bases keep the joints as they are. A cap
    needs neither a training nor a program, so it comes first. One or two freedoms of rigid bodies
    in the plane are looked up. Trees of many hinged bodies with stiff springs are sampled. Minimal
    coordinates are for motions that stiffness confines, or for what is left when loops are closed;
    a subspace of all coordinates suits motions that turn little, and loops whose drives leave no
    other freedom, since they go the same way again. Where joint coordinates are known to be faster,
    they come first, but for such stiff trees: where bodies bend with few amplitudes, of rigid ones
    as the exact model.
    """
    local, hyper = _by_share("local", _local), _of_modes("hyper", HyperReduced())
    joint = _of_modes("joint", JointCoordinates())
    exact = Family("joint", (Candidate(JointCoordinates()),), trained=False)
    galerkin = _of_modes("galerkin", Galerkin())
    capped = _by_cap(facts.caps)
    minimal = _of_modes("minimal", Minimal())
    if ranks := _ranks(facts):
        minimal = Family("minimal", tuple(Candidate(Minimal(), POD(rank)) for rank in ranks))
    table = Family(
        "table", tuple(Candidate(Tabulated(_TABLE), POD(rank)) for rank in _table(facts))
    )
    chain = facts.jointed and not (facts.space or facts.loops or facts.drives)
    if facts.modes:
        order = [capped, local, joint, minimal, galerkin]
        if facts.jointed:
            order = [joint, capped, local, minimal, galerkin]
        elif facts.drives and facts.rigid == 0 and not facts.tree:
            order = [galerkin, capped, local, joint, minimal]
        order += [table] if facts.drives == 0 else []
    elif chain and facts.bodies >= _MANY_BODIES:
        order = [minimal, hyper, exact] if facts.stiff else [exact, hyper, minimal]
        order += [galerkin]
    else:
        order = [exact] if facts.jointed else []
        order += [minimal, table] if facts.drives or facts.rigid == 0 else [table, minimal]
        order += [galerkin]
    return [family for family in order if family.candidates]


def _by_share(name: str, make: Callable[[float], Candidate]) -> Family:
    """Return the models with the modes above a share of the largest singular value."""
    least, first, most = _SHARES
    return Family(name, (make(first),), scale=Scale(make, least, most))


def _of_modes(name: str, formulation: AbstractFormulation) -> Family:
    # The share decides how many modes a basis has.
    return _by_share(name, lambda share: Candidate(formulation, POD(tol=share), level=share))


def _local(share: float) -> Candidate:
    return Candidate(Local(tol=share), POD(), level=share)


def _capped(hertz: float) -> Candidate:
    return Candidate(cap=hertz, level=hertz)


def _by_cap(caps: Sequence[float]) -> Family:
    """Return the models with no mode above a frequency."""
    if not caps:
        return Family("capped", (), trained=False)
    first = _capped(caps[min(_FIRST_CAP, len(caps) - 1)])
    scale = Scale(_capped, caps[0], caps[-1], _OF_CAPS)
    return Family("capped", (first,), trained=False, scale=scale, compiles=False)


def _ranks(facts: Facts) -> list[int]:
    """Numbers of modes for minimal coordinates of few freedoms of rigid bodies: all, or less."""
    if facts.modes or facts.freedoms > _FEW:
        return []
    return list(range(max(1, facts.freedoms), max(0, facts.freedoms - 2), -1))


def _table(facts: Facts) -> Sequence[int]:
    """Ranks of tables: the freedoms of the frames, and as many modes of the bodies. Without freedom
    they would be the models in minimal coordinates.
    """
    if facts.space or not 0 <= facts.rigid <= 2 or not facts.freedoms:
        return []
    if not facts.modes:
        return [max(1, facts.rigid)]
    return sorted({facts.rigid + 1, facts.freedoms})
