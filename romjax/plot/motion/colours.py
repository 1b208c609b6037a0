"""Stress resultants as colours of a moving picture."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ...assembly.outlines import MovingOutline
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene
from ..resultants import Quantity, along_bodies, at_cuts, largest, name_of
from .arrows import check_mechanism
from .frames import Model
from .outputs import held


class Colours(NamedTuple):
    """The meaning of colours: the `name` of a quantity with its unit, its `least` and its `largest`
    value on the scale.
    """

    name: str
    least: float
    largest: float


def with_resultants(
    model: Model,
    scene: Scene,
    run: Trajectory,
    chosen: Int[np.ndarray, " frames"],
    quantity: Quantity,
) -> tuple[Model, Colours]:
    """A model whose beams and rods have a stress resultant at their points, at the outputs `chosen`
    of its run; and what the colours stand for.

    Where a run has ended they stay, as its positions do. Raises InputError for a quantity that is
    not known, a run that does not know its mechanism, or one of a mechanism without beams and rods.
    """
    name = name_of("animate: resultant", quantity, scene.dimension)
    check_mechanism("resultants", run)
    values = along_bodies(run.system, run, scene, quantity)
    if not values:
        kinds = sorted({type(body).__name__ for body in scene.bodies})
        raise InputError(
            f"animate: resultant is '{quantity}', but only a Beam or a Rod has it, and the bodies "
            f"are of {', '.join(kinds)}; leave resultant out, or animate a run of the mechanism "
            "with its beams as they are."
        )
    shown = {body: held(f"{name} of {body}", rows[chosen]) for body, rows in values.items()}

    def coloured(outline: MovingOutline) -> MovingOutline:
        if outline.style != "body" or outline.part not in shown:
            return outline
        return outline._replace(points=at_cuts(outline.points), values=shown[outline.part])

    actual, undeformed = ([*map(coloured, side)] for side in (model.actual, model.undeformed))
    most = largest(shown)
    signed = any(np.min(x) < 0 for x in shown.values())
    colours = Colours(name, -most if signed else 0.0, most)
    return model._replace(actual=actual, undeformed=undeformed), colours
