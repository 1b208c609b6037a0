"""Motions in minimal coordinates: Lagrange's equations of one's own, integrated by SciPy."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp

from .kind import Numbers, times

RTOL, ATOL = 1e-11, 1e-13
GRAVITY = 9.81


def planar_energy(p: Numbers, x: Any, rate: Any) -> Any:
    """½ Σ m |ẋ|² + J φ̇² of bodies with places x (bodies, 3)."""
    del x
    weights = jnp.stack([p["masses"], p["masses"], p["inertias"]], axis=1)
    return 0.5 * jnp.sum(weights * rate**2)


def weight(p: Numbers, t: Any, s: Any, x: Any) -> Any:
    """The potential of gravity along the second axis."""
    del t, s
    return GRAVITY * jnp.sum(p["masses"] * x[:, 1])


def nothing(p: Numbers, t: Any, s: Any, rate: Any) -> Any:
    del p, t, rate
    return jnp.zeros_like(s)


class Minimal:
    """A mechanism in coordinates s without constraints: M s̈ = ∂L/∂s − d/dt (∂T/∂ṡ) at s̈ = 0 + Q.

    `positions` (p, t, s): where bodies are, (bodies, columns). `kinetic` (p, x, ẋ), `potential`
    (p, t, s, x): energies of these. `force` (p, t, s, ṡ): Q on the coordinates. The numbers "s" and
    "ds" are the start, "end" the time; steps end at `breaks` (p). `slip` (p, s, ṡ): velocities that
    are zero, linear in ṡ.
    """

    def __init__(
        self,
        positions: Callable[..., Any],
        kinetic: Callable[..., Any] = planar_energy,
        potential: Callable[..., Any] = weight,
        force: Callable[..., Any] = nothing,
        columns: Sequence[int] = (0, 1),
        breaks: Callable[[Numbers], Any] = lambda p: (),
        slip: Callable[..., Any] | None = None,
    ):
        self.breaks, self._columns, self._rates = breaks, list(columns), None

        def velocity(p: Numbers, t: Any, s: Any, ds: Any) -> Any:
            return jax.jvp(lambda t, s: positions(p, t, s), (t, s), (1.0, ds))

        def energy(p: Numbers, t: Any, s: Any, ds: Any) -> Any:
            return kinetic(p, *velocity(p, t, s, ds))

        def acceleration(p: Numbers, t: Any, s: Any, ds: Any) -> Any:
            momentum = jax.grad(energy, 3)
            mass = jax.jacfwd(momentum, 3)(p, t, s, ds)
            drift = jax.jvp(lambda t, s: momentum(p, t, s, ds), (t, s), (1.0, ds))[1]

            def lagrangian(s: Any) -> Any:
                return energy(p, t, s, ds) - potential(p, t, s, positions(p, t, s))

            pull = jax.grad(lagrangian)(s) + force(p, t, s, ds)
            if slip is None:
                return jnp.linalg.solve(mass, pull - drift)
            # A(s) ṡ = 0 with multipliers: A s̈ = −Ȧ ṡ.
            rows = jax.jacfwd(slip, 2)(p, s, ds)
            count = len(rows)
            bent = jax.jvp(lambda s: slip(p, s, ds), (s,), (ds,))[1]
            whole = jnp.block([[mass, rows.T], [rows, jnp.zeros((count, count))]])
            return jnp.linalg.solve(whole, jnp.concatenate([pull - drift, -bent]))[: len(s)]

        self._acceleration = acceleration
        self._velocity = jax.jit(velocity)
        self._seen = jax.jit(
            lambda p, ts, s: jax.vmap(lambda t, s: positions(p, t, s))(ts, s)[..., self._columns]
        )

    def start(self, p: Numbers) -> Numbers:
        """The same numbers with "x" and "v" of all bodies at the start."""
        x, v = self._velocity(p, 0.0, p["s"], p["ds"])
        return {**p, "x": np.asarray(x), "v": np.asarray(v)}

    def _rate(self, p: Numbers) -> Callable[[float, np.ndarray], np.ndarray]:
        """The right-hand side; time, state and numbers are one array, since SciPy calls often."""
        flat, restore = ravel_pytree(p)
        if self._rates is None:
            d = len(p["s"])

            def rate(z: Any) -> Any:
                t, s, ds = z[0], z[1 : 1 + d], z[1 + d : 1 + 2 * d]
                a = self._acceleration(restore(z[1 + 2 * d :]), t, s, ds)
                return jnp.concatenate([ds, a])

            self._rates = jax.jit(rate)
        flat = np.asarray(flat)
        return lambda t, y: np.asarray(self._rates(np.concatenate([[t], y, flat])))

    def motion(self, p: Numbers, nudge: float = 0.0) -> np.ndarray:
        """Positions of all bodies at the output times, (k, c)."""
        p = {name: value for name, value in p.items() if name not in ("x", "v")}
        ts, d = times(p["end"]), len(p["s"])
        y0 = np.concatenate([p["s"], p["ds"]]).astype(float)
        y = integrated(self._rate(p), ts, y0, self.breaks(p))
        if nudge:
            reach = np.max(np.abs(y[:, :d] - y0[:d]))
            y0[:d] += nudge * reach / np.sqrt(d)
            y = integrated(self._rate(p), ts, y0, self.breaks(p))
        return np.asarray(self._seen(p, ts, y[:, :d])).reshape(len(ts), -1)


def integrated(
    rate: Callable[[float, np.ndarray], np.ndarray],
    ts: np.ndarray,
    y0: np.ndarray,
    breaks: Sequence[float] = (),
    method: str = "DOP853",
) -> np.ndarray:
    """States (k, n) at the times `ts`, by SciPy; steps end at `breaks`."""
    inner = [float(b) for b in np.ravel(breaks) if ts[0] < b < ts[-1]]
    ends = np.unique([ts[0], *inner, ts[-1]])
    rows, y = [y0[None]], y0
    for a, b in itertools.pairwise(ends):
        at = ts[(ts > a) & (ts <= b)]
        found = solve_ivp(
            rate, (a, b), y, method, np.unique([*at, b]), rtol=RTOL, atol=ATOL * scale(y0)
        )
        assert found.success, found.message
        y = found.y[:, -1]
        rows.append(found.y.T[: len(at)])
    return np.concatenate(rows)


def scale(y: np.ndarray) -> float:
    """Of absolute tolerances: a tiny motion has tiny ones."""
    return min(1.0, float(np.max(np.abs(y), initial=0.0)) or 1.0)
