"""Checks of what the strain shapes of a rod are made of."""

from collections.abc import Sequence
from typing import Any

from ...common.arrays import concrete
from ...common.errors import SceneError
from ..fields import check_mass, check_numbers
from .natural_strains import SHAPES


def check_what_shapes_need(rod: Any) -> None:
    """Raise a SceneError unless a rod has what its shapes depend on, which are made first."""
    owner = f"body '{rod.name}'"
    check_shapes(rod, SHAPES, 1 + (rod.EA is not None) + (rod.GA is not None))
    check_numbers(owner, rod, "length", "EI", "EA", "GA", sign="positive")
    check_numbers(owner, rod, "rotary", "retardation", sign="not negative")
    rotary = concrete(rod.rotary)
    if rod.GA is not None and rotary is not None and not rotary > 0:
        raise SceneError(
            f"{owner}: GA is given, but rotary is {rotary:g}; sections that turn against the axis "
            "need a rotary inertia, ρI, or leave GA out."
        )
    check_numbers(owner, rod, "curvature", shape=(None,))
    check_numbers(owner, rod, "damping", shape=(rod.modes,), sign="not negative")


def check_shapes(rod: Any, known: Sequence[str], kinds: int) -> None:
    """Raise a SceneError unless the shapes are `known`, and there are some, and no more than
    quadrature sees of so many `kinds` of strain; and for a mass that is none.
    """
    owner = f"body '{rod.name}'"
    if rod.shapes not in known:
        raise SceneError(
            f"{owner}: shapes is {rod.shapes!r}, but it must be one of {', '.join(known)}."
        )
    if rod.modes < 1:
        raise SceneError(
            f"{owner}: modes is {rod.modes}, but it must be positive; a rod that does not "
            "bend is a Beam without EI."
        )
    if rod.nodes is not None and rod.nodes * kinds < rod.modes:
        raise SceneError(
            f"{owner}: nodes is {rod.nodes}, too few for its {rod.modes} modes, of which "
            "some then have no mass; leave it out, or give more."
        )
    check_mass(owner, rod)
