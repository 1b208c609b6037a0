"""Identification: parameters from measurements."""

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float
from tqdm import tqdm

from ...common.checks import check_kind
from ...compiling.xla import filter_jit
from ...integrate.adjoint import forward_mode
from ...integrate.doubt import telling
from .least_squares import Solution, inverse_square, least_squares

Vector = Float[Array, " p"]


@dataclasses.dataclass(frozen=True)
class Fit:
    """The result of `fit`.

    - `parameters`: a pytree like the start, with the best values.
    - `standard_errors`: the same with their standard errors; infinite for those that the
      measurements do not determine.
    - `covariance` (p, p): of the parameters in the order of `jax.tree.leaves`.
    - `residual`: root mean square of the residuals, in units of the noise if that was given.
    - `steps`: of the search; `success`: whether it has converged.
    """

    parameters: Any
    standard_errors: Any
    covariance: np.ndarray
    residual: float
    steps: int
    success: bool


def fit(
    predict: Callable[[Any], Any],
    start: Any,
    measured: ArrayLike,
    *,
    noise: ArrayLike | None = None,
    lower: Any = None,
    upper: Any = None,
    optimizer: optax.GradientTransformation | None = None,
    steps: int = 200,
    tol: float = 1e-8,
    progress: bool = False,
) -> Fit:
    """The parameters whose prediction is nearest to measurements, by least squares.

    **Arguments:**

    - `predict`: from parameters to an array of the shape of `measured`: a run of a full or a
      reduced model, seen by sensors. Simulate with `throw=False` in it, and without `adjoint`.
    - `start`: parameters to begin with, a pytree of floats such as `{"stiffness": 80.0}`.
    - `measured`: any shape; NaN where nothing was measured.
    - `noise`: standard deviation of the measurements, of any shape that broadcasts; estimated from
      the residuals unless given.
    - `lower`, `upper`: bounds, pytrees like `start` with None for no bound, or single numbers for
      all, never touched: the search goes on in logarithms of the distance from them.
    - `optimizer`: an optax method, such as `optax.adam(0.05)`; unless given the trust region of
      Branch, Coleman and Li (1999, doi:10.1137/S1064827595289108), which takes some ten steps.
    - `steps`, `tol`: most steps, and relative change of parameters and residual that ends them.
    - `progress`: show a progress bar.

    Warns of runs at the best parameters that failed or are doubtful, but for those in functions
    that `predict` calls and that are compiled already.
    Raises ValueError for measurements of which none is finite, a start outside the bounds, a
    prediction of another shape, or one that is not finite at the start.
    """
    check_kind("fit", "predict", predict, Callable, "a function from parameters to an array")
    origin, unravel = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), start))
    data = np.asarray(measured, float)
    spread = np.broadcast_to(1.0 if noise is None else np.asarray(noise, float), data.shape)
    present = np.isfinite(data)
    if not np.any(present):
        raise ValueError("fit: nothing was measured: no entry of measured is finite.")
    if not np.all(spread[present] > 0):
        raise ValueError("fit: the noise must be positive wherever something was measured.")
    misfit = _Misfit(
        predict,
        unravel,
        jnp.asarray(np.where(present, data, 0)),
        jnp.asarray(np.where(present, 1 / spread, 0)),
        _Bounds.of(origin, start, lower, upper),
    )
    begin, points = misfit.bounds.free(origin), _Points(misfit)
    size = float(np.sqrt(np.mean(points.at(begin).residuals ** 2)))
    if not np.isfinite(size):
        raise ValueError("fit: the prediction is not finite at the start; begin elsewhere.")
    # The search starts with a damping of one, so residuals are made of that size.
    result = _search(points, begin, size or 1.0, optimizer, steps, tol, progress)
    best = jnp.asarray(result.x, begin.dtype)
    # What the user has compiled was traced before, when nobody was asked how it went.
    last = eqx.tree_at(lambda m: m.predict, misfit, inspect.unwrap(predict))
    with forward_mode():
        _tell(last, best)
    jax.effects_barrier()
    residuals, jacobian, _ = points.at(best)
    freedom = max(1, int(np.sum(present)) - origin.size)
    variance = float(residuals @ residuals) / freedom if noise is None else 1.0
    covariance = variance * inverse_square(jacobian)
    return Fit(
        parameters=unravel(misfit.bounds.natural(best)),
        standard_errors=unravel(jnp.asarray(np.sqrt(np.diagonal(covariance)))),
        covariance=covariance,
        residual=float(np.sqrt(residuals @ residuals / max(1, np.sum(present)))),
        steps=result.steps,
        success=result.success,
    )


def _search(
    points: "_Points",
    begin: Vector,
    size: float,
    optimizer: optax.GradientTransformation | None,
    steps: int,
    tol: float,
    progress: bool,
) -> Solution:
    """The free numbers with the least residuals, which are of a `size` at the start."""
    with tqdm(disable=not progress, desc="fit", unit="step") as bar:
        if optimizer is None:

            def evaluate(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                point = points.at(free.astype(begin.dtype))
                bar.update()
                return point.residuals / size, point.jacobian * point.growth / size

            return least_squares(evaluate, np.asarray(begin), steps, tol)

        def step() -> None:
            bar.update()

        def show(**values: tuple[str, Array]) -> None:
            jax.debug.callback(step)

        common: Any = {"rtol": tol, "atol": tol, "verbose": show if progress else False}
        misfit = points.misfit
        scaled = eqx.tree_at(lambda m: m.weight, misfit, misfit.weight / size)
        method: Any = optimistix.BestSoFarMinimiser(optimistix.OptaxMinimiser(optimizer, **common))
        minimum = _minimise(scaled, method, begin, steps)
        jax.effects_barrier()
        success = bool(minimum.result == optimistix.RESULTS.successful)
        return Solution(np.asarray(minimum.value), int(minimum.stats["num_steps"]), success)


class _Bounds(eqx.Module):
    """Parameters x within bounds, and the free numbers that stand for them."""

    low: np.ndarray  # which have a lower bound
    high: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    size: np.ndarray  # of parameters without bounds

    @classmethod
    def of(cls, origin: Vector, start: Any, lower: Any, upper: Any) -> "_Bounds":
        sides = []
        for name, given, none in (("lower", lower, -np.inf), ("upper", upper, np.inf)):
            values = jax.tree.leaves(start)
            bounds = [none if given is None else given] * len(values)
            if given is not None and not jax.tree_util.all_leaves([given]):
                bounds, shape = jax.tree.flatten(given, is_leaf=lambda x: x is None)
                if str(shape) != str(jax.tree.structure(start)):
                    raise ValueError(f"fit: {name} must be a number or a pytree like the start.")
                bounds = [none if bound is None else bound for bound in bounds]
            pairs = zip(bounds, values, strict=True)
            parts = [np.broadcast_to(bound, np.shape(x)).ravel() for bound, x in pairs]
            sides.append(np.concatenate(parts).astype(float))
        x, (lowest, highest) = np.asarray(origin), sides
        outside = np.flatnonzero(~((lowest < x) & (x < highest)))
        if outside.size:
            i = int(outside[0])
            raise ValueError(
                f"fit: the start {x[i]:g} of parameter {i + 1} lies outside of its bounds "
                f"{lowest[i]:g} and {highest[i]:g}."
            )
        low, high = np.isfinite(lowest), np.isfinite(highest)
        lower, upper = np.where(low, lowest, 0), np.where(high, highest, 0)
        return cls(low, high, lower, upper, np.where(x != 0, np.abs(x), 1.0))

    def natural(self, free: Vector) -> Vector:
        low, high, lower, upper = self.low, self.high, self.lower, self.upper
        # Derivatives must be finite in branches that are not taken, too.
        grown = jnp.exp(jnp.where(low != high, free, 0))
        inside = lower + (upper - lower) * jax.nn.sigmoid(free)
        beyond = jnp.where(low, lower + grown, upper - grown)
        bounded = jnp.where(low & high, inside, beyond)
        return jnp.where(low | high, bounded, self.size * free)

    def free(self, natural: Vector) -> Vector:
        x, low, high, lower, upper = (
            np.asarray(natural),
            self.low,
            self.high,
            self.lower,
            self.upper,
        )
        with np.errstate(all="ignore"):
            inside = np.log((x - lower) / (upper - x))
            beyond = np.log(np.where(low, x - lower, upper - x))
            free = np.where(low & high, inside, np.where(low | high, beyond, x / self.size))
        return jnp.asarray(free)


class _Misfit(eqx.Module):
    """Weighted residuals as a function of the free numbers.

    A module, so that other data for the same `predict` recompile nothing.
    """

    predict: Callable[[Any], Any]  # a module's numbers are traced, a function is static
    unravel: Callable[[Any], Any] = eqx.field(static=True)
    target: Float[Array, "*shape"]
    weight: Float[Array, "*shape"]
    bounds: _Bounds

    def at(self, natural: Vector) -> Float[Array, " k"]:
        predicted, wanted = jnp.asarray(self.predict(self.unravel(natural))), self.target.shape
        if predicted.shape != wanted:
            raise ValueError(
                f"fit: predict returns the shape {predicted.shape}, but measured has {wanted}."
            )
        return jnp.ravel((predicted - self.target) * self.weight)

    def __call__(self, free: Vector, args: Any = None) -> Float[Array, " k"]:
        return self.at(self.bounds.natural(free))


class _Point(NamedTuple):
    """Residuals (k,), their derivatives by the parameters (k, p), and those of the parameters by
    the free numbers (p,).
    """

    residuals: Float[np.ndarray, " k"]
    jacobian: Float[np.ndarray, "k p"]
    growth: Float[np.ndarray, " p"]


class _Points:
    """The points of a search, of which the best one so far is held: the first is asked for again by
    the search, and its result after it.
    """

    def __init__(self, misfit: _Misfit) -> None:
        self.misfit = misfit
        self._held: tuple[bytes, _Point, float] | None = None

    def at(self, free: Any) -> _Point:
        """The point of some free numbers, of arrays of NumPy."""
        free = np.asarray(free)  # of JAX, making one takes as long as a small run
        key = free.tobytes()
        if self._held is not None and self._held[0] == key:
            return self._held[1]
        with forward_mode():
            point = _Point(*map(np.asarray, _linearize(self.misfit, free)))
        size = float(np.sum(point.residuals**2))
        if self._held is None or size <= self._held[2]:
            self._held = key, point, size
        return point


@filter_jit
def _linearize(misfit: _Misfit, free: Vector) -> tuple[Array, Array, Array]:
    """Return the arrays of a `_Point`."""
    natural, growth = jax.jvp(misfit.bounds.natural, (free,), (jnp.ones_like(free),))

    def twice(natural: Vector) -> tuple[Array, Array]:
        residuals = misfit.at(natural)
        return residuals, residuals

    jacobian, residuals = jax.jacfwd(twice, has_aux=True)(natural)
    return residuals, jacobian, growth


@filter_jit
def _tell(misfit: _Misfit, free: Vector) -> Float[Array, " k"]:
    with telling("fit, at the best parameters"):
        return misfit(free)


@filter_jit
def _minimise(misfit: _Misfit, method: Any, begin: Vector, steps: int) -> Any:
    def loss(free: Vector, _: None) -> Array:
        return jnp.mean(misfit(free) ** 2)

    return optimistix.minimise(loss, method, begin, max_steps=steps, throw=False)
