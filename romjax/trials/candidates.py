"""Which reductions are worth trying for a mechanism, by its structure."""

import dataclasses
from collections.abc import Sequence

from ..basis.decomposition.base import AbstractDecomposition
from ..basis.decomposition.pod import POD
from ..reduction.formulation.base import AbstractFormulation
from ..reduction.formulation.galerkin import Galerkin
from ..reduction.formulation.minimal import Minimal
from ..reduction.hyper.formulation import HyperReduced
from ..reduction.local.formulation import Local
from ..reduction.tables.formulation import Tabulated
from .facts import Facts

# Shares of the largest singular value down to which modes are kept, coarse to fine.
_SHARES = (1e-3, 1e-4, 1e-5)
# How well tables hold the constraints between their nodes: as models have to, in less time.
_TABLE = 1e-5
# Fewer hinged bodies are as fast one by one as sampled.
_MANY_BODIES = 6
# Freedoms of which each is worth a try of its own as a number of modes.
_FEW = 3


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A reduction to try: a `formulation` and the `decomposition` of its basis, which says how many
    modes; or a `cap` [Hz] on the modes of bodies instead.
    """

    formulation: AbstractFormulation | None = None
    decomposition: AbstractDecomposition | None = None
    cap: float | None = None


@dataclasses.dataclass(frozen=True)
class Family:
    """Candidates of one kind, the coarsest first.

    `trained`: whether a run is what the model knows, so that several may be better than one.
    """

    name: str
    candidates: tuple[Candidate, ...]
    trained: bool = True


def families(facts: Facts) -> list[Family]:
    """What is worth trying, the most promising kind first.

    Where bodies bend, their few slow shapes are all that a motion excites, whatever it is: local
    bases and caps keep the joints as they are. One or two freedoms of rigid bodies in the plane are
    looked up. Trees of many hinged bodies are sampled. Minimal coordinates are for motions that
    stiffness confines, or for what is left when loops are closed; a subspace of all coordinates
    suits motions that turn little, and driven ones, which go the same way again.
    """
    local = Family("local", tuple(Candidate(Local(tol=share), POD()) for share in _SHARES))
    capped = Family("capped", tuple(Candidate(cap=hertz) for hertz in facts.caps), trained=False)
    minimal = Family("minimal", tuple(Candidate(Minimal(), one) for one in _ranks(facts)))
    galerkin = Family("galerkin", tuple(Candidate(Galerkin(), POD(tol=share)) for share in _SHARES))
    table = Family(
        "table", tuple(Candidate(Tabulated(_TABLE), POD(rank)) for rank in _table(facts))
    )
    hyper = Family(
        "hyper", tuple(Candidate(HyperReduced(), POD(tol=share)) for share in _SHARES[:2])
    )
    chain = not (facts.modes or facts.space or facts.loops or facts.drives)
    if facts.modes:
        order = [local, capped, minimal, galerkin]
        if facts.drives:
            order = [galerkin, local, capped, minimal]
        order += [table] if facts.drives == 0 else []
    elif facts.drives or facts.rigid == 0:
        order = [minimal, table, galerkin]
    elif chain and facts.bodies >= _MANY_BODIES:
        order = [hyper, minimal, galerkin]
    else:
        order = [table, minimal, galerkin]
    return [family for family in order if family.candidates]


def _ranks(facts: Facts) -> list[AbstractDecomposition]:
    """Numbers of modes for minimal coordinates: all of few freedoms, or what the motion shows."""
    if facts.modes:
        return [POD(tol=share) for share in _SHARES]
    if facts.freedoms <= _FEW:
        return [POD(rank) for rank in range(max(1, facts.freedoms), max(0, facts.freedoms - 2), -1)]
    return [*(POD(tol=share) for share in _SHARES[:2]), POD(facts.freedoms)]


def _table(facts: Facts) -> Sequence[int]:
    """Ranks of tables: the freedoms of the frames, and as many modes of the bodies."""
    if facts.space or not 0 <= facts.rigid <= 2:
        return []
    if not facts.modes:
        return [max(1, facts.rigid)]
    return sorted({facts.rigid + 1, facts.freedoms})
