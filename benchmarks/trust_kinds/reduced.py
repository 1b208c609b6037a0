"""Reduced models off their training: other loads, other frequencies, longer runs.

The mechanism has four freedoms: models with fewer modes leave motion out, and are counted like all.

The truth is a run of the full model at rtol = 1e-10, by another method than its training.
"""

import functools
from typing import Any

import diffrax
import numpy as np

import romjax as rj

from .kind import Kind, Numbers, places, times
from .planar import log

END = 1.0  # [s]
TRAINED = {"force": 10.0, "frequency": 10.0, "f1": 16.0}
TIGHT: dict[str, Any] = {"rtol": 1e-10, "audit": False}


def full(p: Numbers) -> rj.AbstractSystem:
    """The chapter's cart-pendulum with other numbers, pushed at the start."""
    scene = rj.gallery.cart_pendulum(**{name: p[name] for name in TRAINED}, f2=200.0)
    return rj.assemble(scene)


@functools.cache
def trained(kind: str, rank: int, decomposition: str) -> Any:
    """One reduced model for all scenes, from one run."""
    system = full({name: np.asarray(x) for name, x in TRAINED.items()})
    run = rj.simulate(system, times(END), solver=rj.Rodas5P(), **TIGHT)
    basis = getattr(rj, decomposition)(run, rank=rank)
    return rj.reduce(system, basis, kind)


def draw(chance: np.random.Generator) -> Numbers:
    """From what was trained with to three times as much, or a third."""
    off = chance.choice([0.0, 0.1, 1.0])
    factors = np.exp(off * chance.uniform(-1.1, 1.1, 3))
    found = {name: x * f for (name, x), f in zip(TRAINED.items(), factors, strict=True)}
    found["end"] = END * (1.0 if chance.random() < 0.5 else log(chance, 0.3, 3.0))
    return {name: np.asarray(x) for name, x in found.items()}


def truth(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    system = full({**p, "force": p["force"] * (1 + nudge)})
    run = rj.simulate(system, times(p["end"]), solver=diffrax.Dopri8(), **TIGHT)
    return np.asarray(places(system, run))


def off_training(kind: str, rank: int, decomposition: str) -> Kind:
    """Motions of one reduced model."""

    def drawn(chance: np.random.Generator) -> Numbers:
        # Trained here, since within a sweep JAX traces.
        trained(kind, rank, decomposition)
        return draw(chance)

    def moved(p: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
        system = full(p)
        model = trained(kind, rank, decomposition).with_full(system)
        run = rj.simulate(model, times(p["end"]), **settings)
        return places(system, run), run

    return Kind(drawn, moved, truth)


KINDS = {
    f"{kind} {rank}, {decomposition.upper()}": off_training(kind, rank, decomposition)
    for kind, rank, decomposition in (
        ("galerkin", 5, "pod"),
        ("galerkin", 5, "sod"),
        ("galerkin", 3, "sod"),
        ("minimal", 3, "pod"),
        ("minimal", 2, "pod"),
        ("local", 4, "pod"),
    )
}
