"""Bending modes of a uniform free-free Euler–Bernoulli beam, in closed form."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def free_free_roots(count: int) -> np.ndarray:
    """The first `count` positive roots βL of cos(βL) cosh(βL) = 1: 4.730041, 7.853205, …

    Newton on cos x − 1/cosh x, whose terms stay of order one, from the asymptote (k + ½) π.
    """
    roots = []
    for k in range(1, count + 1):
        x = (k + 0.5) * math.pi
        for _ in range(8):
            sech = 1 / math.cosh(x)
            x -= (math.cos(x) - sech) / (-math.sin(x) + sech * math.tanh(x))
        roots.append(x)
    return np.array(roots)


def free_free_shapes(
    s: Float[Array, ""], length: Float[Array, ""], count: int
) -> tuple[Float[Array, " modes"], Float[Array, " modes"]]:
    """Deflections and slopes of the modes at distance `s` [m] from the middle of the beam.

    Normalised to ∫w² ds = length, which makes every mode 2 at the end s = −length/2 and
    ±2 at the other. Written about the middle, where the modes are even or odd: the textbook
    form cosh − σ sinh cancels all digits from the tenth mode on.
    """
    root = free_free_roots(count)
    even = np.arange(1, count + 1) % 2 == 1
    beta, half = root / length, root / 2
    sign = jnp.where(even, 1.0, -1.0)
    # Even: cos(βs)/cos(βL/2) + cosh(βs)/cosh(βL/2); odd: the same with sine and hyperbolic sine.
    trig = jnp.where(even, jnp.cos(beta * s), jnp.sin(beta * s))
    dtrig = jnp.where(even, -jnp.sin(beta * s), jnp.cos(beta * s))
    hyp = jnp.where(even, jnp.cosh(beta * s), jnp.sinh(beta * s))
    dhyp = jnp.where(even, jnp.sinh(beta * s), jnp.cosh(beta * s))
    end_trig = np.where(even, np.cos(half), np.sin(half))
    end_hyp = np.where(even, np.cosh(half), np.sinh(half))
    deflection = sign * (trig / end_trig + hyp / end_hyp)
    slope = sign * beta * (dtrig / end_trig + dhyp / end_hyp)
    return deflection, slope
