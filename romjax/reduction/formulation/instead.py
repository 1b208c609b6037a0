"""Remedies for mechanisms that a formulation cannot take."""

import numpy as np

from ...basis.basis import Basis
from ...common.arrays import pick
from ...common.errors import InputError, ReductionError
from ...system.base import AbstractSystem, check_reducible
from ...system.reduced import follows
from .base import AbstractFormulation

# Snapshots at which a model is tried.
_SNAPSHOTS = 50


def tried_instead(system: AbstractSystem, basis: Basis, refused: AbstractFormulation) -> str:
    """Say in words which formulation makes a model of the system from this basis, by making it and
    asking it for the configurations of the snapshots.
    """
    seen = basis.snapshots
    few = np.unique(np.linspace(0, len(seen.t) - 1, _SNAPSHOTS).astype(int))
    for kind in AbstractFormulation.__subclasses__():
        if not kind.is_general or isinstance(refused, kind):
            continue
        try:
            check_reducible(system, kind())
            model = kind().reduce(system, basis)
        except (ReductionError, InputError):
            continue
        if model.n and follows(model, pick(seen.t, few), pick(seen.q, few), pick(seen.v, few)):
            made = f"a model of {model.n} coordinates of it"
            return f"formulation=romjax.{kind.__name__}() makes {made}."
    return "No other formulation makes a model of it from this basis; simulate it as it is."
