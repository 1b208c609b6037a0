"""A wing nut in free flight."""

import numpy as np

from ..common.arrays import Number, Vector
from ..scene.body.spatial.rigid import RigidBody
from ..scene.scene import Scene
from .digits import decimal, drawn


def wing_nut(
    *,
    mass: Number = 1.0,  # [kg]
    moments: Vector = (1.0, 2.0, 3.0),  # principal ones [kg m²]
    rates: Vector = (0.001, 5.0, 0.02),  # about the principal axes at the start [rad/s]
) -> Scene:
    """A free body that spins about the axis of its middle moment of inertia, and flips again and
    again (Dzhanibekov).

    By Euler's equations the rates are Jacobi's elliptic functions of time (Landau and Lifshitz,
    "Mechanics", section 37): they return after the period 4 K(k²) / τ with, for moments A < B < C,
    the energy T and the angular momentum L,

        τ² = (C − B) (L² − 2 T A) / (A B C),   k² = (B − A) (2 T C − L²) / ((C − B) (L² − 2 T A)),

    where L² > 2 T B; else A and C change places. Here it is 8.811 s.
    """
    nut = RigidBody("nut", mass, moments, angular_velocity=rates, extent=_nut())
    return decimal(Scene(bodies=[nut]))


def _nut() -> np.ndarray:
    """A sleeve along the axis of the spin, y, with a wing to both sides."""
    angle = np.linspace(0.0, 2 * np.pi, 25)
    ring = drawn(0.25 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1))
    wing = np.array([(0.25, 0.0), (0.7, 0.25), (1.0, 0.6), (0.95, 0.8), (0.7, 0.75), (0.25, 0.4)])
    wing = np.pad(wing, ((0, 0), (0, 1)))
    top, left = np.array([0.0, 0.4, 0.0]), np.array([-1.0, 1.0, 1.0])
    half = [ring[:13], left * wing, (ring + top)[12:0:-1], wing[::-1]]
    return np.concatenate([*half, ring[::-1][:13], left * wing, (ring + top)[12:], wing[:1]])
