"""Formulations by name."""

from ...common.errors import ReductionError
from .base import AbstractFormulation


def as_formulation(formulation: AbstractFormulation | str) -> AbstractFormulation:
    """The formulation itself, or the one of that name; raises ReductionError if there is none."""
    if isinstance(formulation, AbstractFormulation):
        return formulation
    kinds = {kind.name: kind for kind in AbstractFormulation.__subclasses__()}
    if formulation not in kinds:
        names = ", ".join(f'"{name}"' for name in sorted(kinds))
        raise ReductionError(
            f"reduce: formulation={formulation!r}; it must be one of {names}, or an object such as "
            "romjax.Galerkin()."
        )
    return kinds[formulation]()
