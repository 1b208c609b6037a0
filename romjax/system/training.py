"""The motions that a reduced model was made of, remembered with it."""

from typing import Any, TypeVar

import equinox as eqx
import numpy as np

from ..basis.basis import Basis
from ..common.arrays import as_jax
from ..common.compat import is_traced
from ..common.identity_cache import IdentityCache
from .base import AbstractSystem

S = TypeVar("S", bound=AbstractSystem)


class Training:
    """A reduced model as it was made, the `motions` that it was made of, and its `errors` on them,
    None until somebody measures them.
    """

    def __init__(self, rom: Any, motions: tuple[Any, ...]) -> None:
        self.rom = rom
        self.motions = motions
        self.errors: tuple[Any, ...] | None = None


# By the `error` of its validity, an array that a model keeps with other numbers and starts, also
# where JAX traces these; whoever estimates that error replaces it.
_trainings = IdentityCache()


def remember_training(rom: S, basis: Basis) -> S:
    """The same model, remembered with the motions that it was made of where these are known."""
    error, motions = _error(rom), basis.snapshots.motions
    if error is not None and motions and basis.decomposition is not None:
        # What is remembered must not hold what it is remembered for.
        other = as_jax(np.array(error))
        same = eqx.tree_at(lambda model: model.validity.error, rom, other)
        _trainings.put(error, Training(same, motions))
    return rom


def training_of(system: AbstractSystem) -> Training | None:
    """Return the training of a model; None if it is not known, and for other systems."""
    error = _error(system)
    training: Training | None = None if error is None else _trainings.get(error)
    return training


def forget_training(rom: AbstractSystem) -> None:
    """Drop the known error of a model on its training, for callers that measure it anew."""
    error = _error(rom)
    if error is not None:
        _trainings.put(error, None)


def _error(system: AbstractSystem) -> Any:
    """The array that stands for a model; None of what has none of its own."""
    error = getattr(system.validity, "error", None)
    return None if error is None or is_traced(error) else error
