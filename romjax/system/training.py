"""The motions that a reduced model was made of, remembered with it."""

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..basis.basis import Basis
from ..basis.snapshots import SnapshotSet
from ..common.arrays import as_jax
from ..common.compat import is_traced
from ..common.identity_cache import IdentityCache
from .base import AbstractSystem

S = TypeVar("S", bound=AbstractSystem)


class Recipe(NamedTuple):
    """The ingredients of other models that tell how wrong a reduced one is: the `formulation` and
    the `snapshots` of that one.
    """

    formulation: Any
    snapshots: SnapshotSet


class Training:
    """A reduced model as it was made, the `motions` that it was made of, and its `errors` on them,
    None until somebody measures them. `has_fewer_freedoms`: than the mechanism, None until somebody
    counts them. By the `recipe`, which is None where JAX traces, others keep the models that they
    make of it.
    """

    def __init__(self, rom: Any, motions: tuple[Any, ...], recipe: Recipe | None) -> None:
        self.rom = rom
        self.motions = motions
        self.errors: tuple[Any, ...] | None = None if motions else ()
        self.has_fewer_freedoms: bool | None = None
        self.recipe = recipe
        self.finer: dict[int, tuple[Any, ...]] = {}


# Trainings are looked up by the `error` of a validity, an array that a model keeps with other
# numbers and starts, also where JAX traces these; whoever estimates that error replaces it.
_trainings = IdentityCache()


def remember_training(rom: S, basis: Basis, formulation: Any) -> S:
    """The same model, remembered with the motions that it was made of where these are known."""
    error, motions = training_error(rom), basis.snapshots.motions
    if error is not None and basis.decomposition is not None:
        # What is remembered must not hold what it is remembered for.
        other = as_jax(np.array(error))
        same = eqx.tree_at(lambda model: model.validity.error, rom, other)
        _trainings.put(error, Training(same, motions, _recipe(formulation, basis.snapshots)))
    return rom


def _recipe(formulation: Any, snapshots: SnapshotSet) -> Recipe | None:
    """The recipe of models of the same snapshots; None where JAX traces these."""
    if any(is_traced(x) for x in jax.tree.leaves(snapshots)):
        return None
    # Motions are known as long as the weights of their snapshots are.
    weights = as_jax(np.array(snapshots.weights))
    return Recipe(formulation, dataclasses.replace(snapshots, weights=weights))


def training_of(system: AbstractSystem) -> Training | None:
    """Return the training of a model; None if it is not known, and for other systems."""
    error = training_error(system)
    training: Training | None = None if error is None else _trainings.get(error)
    return training


def describe_errors(training: Training | None, span: float) -> str:
    """Say how much a model errs on the motions that it was made of, in a time `span` [s]."""
    if training is None or not training.errors:
        return "more modes help"
    error = max(one.after(np.asarray(span)) for one in training.errors)
    much = f"{error:.1e} of the longest way of a body" if np.isfinite(error) else "it fails there"
    hidden = next((one.hidden for one in training.errors if one.hidden), "")
    much += f", and {hidden}" if hidden else ""
    return f"{much}; take more modes, as romjax.reduce_to finds them for a tolerance"


def forget_training(rom: AbstractSystem) -> None:
    """Drop what is known of a model by its training, for callers that measure it anew."""
    training = training_of(rom)
    if training is not None:
        training.motions, training.errors, training.has_fewer_freedoms = (), (), False


def with_error(rom: S, error: float, errors: Iterable[Any] = ()) -> S:
    """The model with an error that somebody has estimated, in place of that on its training, and
    with those of its runs on the motions of that.
    """
    training, estimate = training_of(rom), jnp.asarray(error)
    if training is not None:
        other = Training(training.rom, (), training.recipe)
        other.errors, other.finer = tuple(errors), training.finer
        _trainings.put(estimate, other)
    same: S = eqx.tree_at(lambda model: model.validity.error, rom, estimate)
    return same


def training_error(system: AbstractSystem) -> Any:
    """The array that stands for a model; None of what has none of its own."""
    error = getattr(system.validity, "error", None)
    return None if error is None or is_traced(error) else error
