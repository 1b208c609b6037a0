"""What reduces a mechanism that a formulation cannot take."""

from ...basis.basis import Basis
from ...common.errors import InputError, ReductionError
from ...system.base import AbstractSystem
from .base import AbstractFormulation


def tried_instead(system: AbstractSystem, basis: Basis, refused: AbstractFormulation) -> str:
    """Say in words which formulation makes a model of the system from this basis, by making it."""
    for kind in AbstractFormulation.__subclasses__():
        if not kind.is_general or isinstance(refused, kind):
            continue
        try:
            model = kind().reduce(system, basis)
        except (ReductionError, InputError):
            continue
        return f"formulation=romjax.{kind.__name__}() makes a model of {model.n} coordinates of it."
    return "No other formulation makes a model of it from this basis; simulate it as it is."
