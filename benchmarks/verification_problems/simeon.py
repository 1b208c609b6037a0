"""Simeon's slider crank with a flexible rod, as a CustomSystem, and its rod as a body.

B. Simeon, "Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs",
Mathematical Modelling of Systems 2 (1996); problem "crank" of the IVP test set. Coordinates: crank
angle, rod angle, slider, two lateral modes and two longitudinal nodes of the rod.
"""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj
from romjax.system.consistent import project

# From an extrapolation method of order 24, agreeing to 18 digits with a second run; printed to 17.
POSITIONS = [
    15.0,
    -0.33117349882562993,
    0.16973733284307214,
    1.8931928997009405e-4,
    2.3757512499866390e-5,
    -5.3238967707486072e-6,
    -8.3633132788077737e-6,
]
VELOCITIES = [
    150.0,
    60.253467551318349,
    -8.7531163267041626,
    -0.030055413998525571,
    -0.0055004318013328444,
    4.9741117946464800e-4,
    1.1055599936031179e-3,
]
# Derivatives of these by the logarithms of Young's modulus and of the slider's mass.
BY_MODULUS = [
    0.0,
    4.87291638088185e-05,
    4.49583497546238e-05,
    0.000591134371007687,
    -1.42986728648109e-05,
    1.9720289206738e-05,
    4.25153772342127e-05,
    0.0,
    0.13785529714106,
    0.13506623365308,
    1.5735027068608,
    0.0334516419900021,
    0.00872481312250201,
    0.128607733176743,
]
BY_SLIDER = [
    0.0,
    -1.0808510076492e-05,
    -9.97211399423533e-06,
    1.44338223317717e-06,
    -1.25078339526199e-06,
    -3.55847909634828e-06,
    -9.4302435610169e-06,
    0.0,
    -0.0334965745101256,
    -0.0326520423843886,
    0.00717726683921188,
    -0.012122934002545,
    -0.037511255684593,
    -0.0310731466485161,
]


M2, L1, L2, CRANK, J2 = 0.151104, 0.15, 0.30, 0.002727, 0.0045339259
DENSITY, SPEED, SIDE = 7870.0, 150.0, 0.008
PI = 3.1415927  # as printed: the exact one changes the seventh digit of the first mode
START = [0, 0, 0.450016933, 0, 0, 0.103339863e-4, 0.169327969e-4]
RATES = [
    0.15e3,
    -0.749957670e2,
    -0.268938672e-5,
    0.444896105,
    0.463434311e-2,
    -0.178591076e-5,
    -0.268938672e-5,
]


class Rod(NamedTuple):
    """Matrices and vectors of the rod, in the names of the paper."""

    MQ: jax.Array
    KQ: jax.Array
    BQ: jax.Array
    c1: jax.Array
    c2: jax.Array
    c12: jax.Array
    c21: jax.Array


def elements(modulus) -> Rod:
    """Two sines across the rod and two quadratic elements along it."""
    area = SIDE**2
    fm, fk, fb = DENSITY * area * L2, modulus * area / L2, area * L2
    h2 = (SIDE / L2) ** 2
    stiffness = [
        [PI**4 / 24 * h2, 0, 0, 0],
        [0, PI**4 * 2 / 3 * h2, 0, 0],
        [0, 0, 16 / 3, -8 / 3],
        [0, 0, -8 / 3, 7 / 3],
    ]
    half = np.zeros((4, 4))
    half[0, 2:] = -16 / PI**3, 8 / PI**3 - 1 / PI
    half[1, 3] = 0.5 / PI
    return Rod(
        jnp.array([[fm / 2, 0, 0, 0], [0, fm / 2, 0, 0], [0, 0, 8 * fm, fm], [0, 0, fm, 2 * fm]]),
        fk * jnp.array(stiffness),
        jnp.asarray(fb * (half - half.T)),
        fb * jnp.array([0, 0, 2 / 3, 1 / 6]),
        fb * jnp.array([2 / PI, 0, 0, 0]),
        L2 * fb * jnp.array([0, 0, 1 / 3, 1 / 6]),
        L2 * fb * jnp.array([1 / PI, -0.5 / PI, 0, 0]),
    )


def rod() -> rj.ModalBody:
    """The rod as a body, with its frame at the crank: the paper's vectors are its invariants."""
    own = elements(0.20e12)
    ends = np.zeros((2, 3, 4))
    ends[:, 2, :2] = PI / L2 * np.array([[1, 2], [-1, 2]])
    ends[1, 0, 3] = 1.0
    return rj.ModalBody(
        "rod",
        rj.Inertia(
            M2,
            J2,
            modal=own.MQ,
            first_moment=(M2 * L2 / 2, 0.0),
            shift=DENSITY * jnp.stack([own.c1, own.c2]),
            swing=DENSITY * own.c21,
            stretch=DENSITY * own.c12,
            gyration=DENSITY * own.BQ.T,
        ),
        own.KQ,
        [(0.0, 0.0), (L2, 0.0)],
        ends,
        ports=("crank", "slider"),
        position=(L1, 0.0),
        velocity=(0.0, L1 * SPEED),
        angular_velocity=RATES[1],
        amplitudes=START[3:],
        rates=RATES[3:],
    )


def slider_crank(modulus=0.20e12, slider=0.075552) -> rj.CustomSystem:
    """The system, with Young's modulus [Pa] and the mass of the slider [kg]."""
    MQ, KQ, BQ, c1, c2, c12, c21 = elements(modulus)
    J1, R = CRANK, DENSITY

    def mass(r):
        s, c = jnp.sin(r[0] - r[1]), jnp.cos(r[0] - r[1])
        q = r[3:]
        m12 = L1 * L2 * M2 * c / 2 + R * L1 * (s * c2 @ q + c * c1 @ q)
        m22 = J2 + q @ MQ @ q + 2 * R * c12 @ q
        r1, r2 = R * L1 * (-s * c1 + c * c2), R * c21 + R * q @ BQ
        rigid = jnp.array([[J1 + M2 * L1**2, 0, 0], [0, 0, 0], [0, 0, slider]])
        rigid = rigid.at[1, 1].set(m22).at[0, 1].set(m12).at[1, 0].set(m12)
        coupled = jnp.stack([r1, r2, jnp.zeros(4)])
        return jnp.block([[rigid, coupled], [coupled.T, MQ]])

    def force(t, r, w):
        s, c = jnp.sin(r[0] - r[1]), jnp.cos(r[0] - r[1])
        q, d, v1, v2 = r[3:], w[3:], w[0], w[1]
        f1 = (
            -L1 * L2 * M2 * v2**2 * s / 2
            + R * L1 * v2**2 * (-s * c1 @ q + c * c2 @ q)
            - 2 * R * L1 * v2 * (c * c1 @ d + s * c2 @ d)
        )
        f2 = (
            L1 * L2 * M2 * v1**2 * s / 2
            + R * L1 * v1**2 * (s * c1 @ q - c * c2 @ q)
            - 2 * R * v2 * c12 @ d
            - 2 * v2 * d @ MQ @ q
            - R * d @ BQ @ d
        )
        fq = (
            v2**2 * MQ @ q
            + R * (v2**2 * c12 + L1 * v1**2 * (c * c1 + s * c2) + 2 * v2 * BQ @ d)
            - KQ @ q
        )
        return jnp.concatenate([jnp.stack([f1, f2, 0.0]), fq])

    def con(t, r):
        return jnp.stack(
            [
                L1 * jnp.sin(r[0]) + (L2 + r[6]) * jnp.sin(r[1]),
                r[2] - L1 * jnp.cos(r[0]) - (L2 + r[6]) * jnp.cos(r[1]),
                r[0] - SPEED * t,
            ]
        )

    return rj.CustomSystem(mass, force, con, q0=START, v0=RATES)


@eqx.filter_jit
def projected(system: rj.AbstractSystem) -> tuple[jax.Array, jax.Array]:
    """The start with velocities that agree with the constraints, and positions as they are."""
    return project(system, jnp.asarray(0.0), system.q0, system.v0, 0)


@eqx.filter_jit
def run(system: rj.AbstractSystem) -> rj.Trajectory:
    """From the published start to 0.1 s.

    The start has nine digits. Its velocities are projected, its positions are not, as in the index
    two of the reference; unstabilised, so that what is left of C stays.
    """
    q, v = projected(system)
    return rj.simulate(
        system,
        jnp.array([0.0, 0.1]),
        q0=q,
        v0=v,
        solver=diffrax.Dopri8(),
        rtol=1e-12,
        atol=1e-15,
        stabilization=None,
        throw=False,
    )
