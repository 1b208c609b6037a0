"""The inertia invariants of a uniform beam in space."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Numbers, namespace
from ..free_modes import quadrature
from .beam_modes import Counts, foreshortening, motion
from .inertia import SpatialInertia


def beam_inertia(
    mass: Float[Array, ""],
    length: Float[Array, ""],
    moments: Float[Array, "3"],
    counts: Counts,
    *,
    foreshortens: bool,
    rotary: bool,
) -> SpatialInertia:
    """The invariants of a beam whose frame is in its middle, x along it.

    The points of the axis carry the mass, the sections its polar inertia, and those about their
    own diameters as well if the beam is `rotary`. `moments` are those of the undeformed beam.
    """
    modes = sum(counts)
    if not modes:
        return SpatialInertia(mass, jnp.diag(moments))
    # NumPy will do: the integrals of polynomials are numbers of the scene, once and for all.
    nodes, weights = quadrature(max(counts))
    both = [motion(counts, xi, np) for xi in nodes]
    moved, turned = (np.stack(x) for x in zip(*both, strict=True))
    across = np.diag([0.0, 1.0, 1.0])  # what mass along x has of moments of inertia
    terms: dict[str, Any] = {}
    if modes > counts.torsion:
        terms["spread"] = _of_axis(weights, moved)
    if sum(counts[:2]):
        terms["gyration"] = np.einsum("i,abc,ibk,icl->akl", weights, _cross(), moved, moved)
    if counts.extension:
        # J grows by 2 ∫ρ x u; the displacements u are all that is along x.
        stretched = 2 * np.einsum("i,i,ik->k", weights, nodes - 0.5, moved[:, 0])
        terms["stretch"] = jnp.sqrt(mass) * length * (across[:, :, None] * stretched[None, None])
    if foreshortens:
        # Of a series in Legendre polynomials of 2ξ − 1 the mean is the first coefficient, and the
        # integral times ξ − ½ a sixth of the second.
        mean, lever = foreshortening(counts)[:2] * np.array([1, 1 / 6])[:, None, None]
        terms["spread"] -= across[:, :, None, None] * lever[None, None]
        terms["foreshortening"] = np.stack([mean, 0 * mean, 0 * mean]) / length
    if rotary:
        # The axis alone makes M_ff the identity, but for torsion, which is of the sections.
        terms["modal"] = np.diag(np.repeat([1.0, 1.0, 0.0, 1.0], counts))
        # What the sections have beyond a thin rod of the same mass.
        own = moments - mass * length**2 / 12 * np.array([0.0, 1.0, 1.0])
        # Modal mass one gives bending slopes the unit 1 / (√m L), and twists that of their own
        # inertia.
        scale = rotations(mass, length, moments, counts)
        for name, term in _of_sections(own, scale, weights, turned).items():
            terms[name] = terms.get(name, 0) + term
    return SpatialInertia(mass, jnp.diag(moments), **terms)


def rotations(
    mass: Float[Numbers, ""],
    length: Float[Numbers, ""],
    moments: Float[Numbers, "3"],
    counts: Counts,
) -> Float[Numbers, " modes"]:
    """Rotations per unit amplitude: what those of `motion` are multiplied by."""
    xp = namespace(moments)
    each = xp.stack([1 / (xp.sqrt(mass) * length), 1 / xp.sqrt(moments[0])])
    kinds = np.repeat([0, 0, 1, 0], counts)
    scales: Array = each[kinds]
    return scales


def _of_axis(weights: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """D(∫S_a S_b) (3, 3, modes, modes)."""
    # A mass at u has the inertia |u|² I − u uᵀ, here with the fields S in the place of u; of it
    # only the symmetric part, in axes and in modes, has an energy.
    product = np.einsum("i,iak,ibl->abkl", weights, moved, moved)
    product = (product + product.transpose(1, 0, 2, 3)) / 2
    product = (product + product.transpose(0, 1, 3, 2)) / 2
    total: np.ndarray = np.einsum("ab,cckl->abkl", np.eye(3), product) - product
    return total


def _of_sections(
    own: Float[Array, "3"], scale: Float[Array, " modes"], weights: np.ndarray, turned: np.ndarray
) -> dict[str, Array]:
    """Return the inertia of sections with principal moments j, turned by R = exp θ̃, θ = Σ θ_k q_k.

    To the second order, their inertia is R j Rᵀ = j + θ̃j − jθ̃ + ½(θ̃²j + jθ̃²) − θ̃jθ̃, and their
    angular momentum R j Rᵀ (I + ½θ̃) θ̇ = (j + θ̃j − ½jθ̃) θ̇.
    """
    tilde = np.einsum("abc,ibk->kiac", _cross(), turned)  # θ̃_k at each node
    units = [np.diag(unit) for unit in np.eye(3)]

    def each(form: Any) -> Array:
        """Σ j_a times the integral of a `form` of the unit matrix of axis a."""
        integrals = [np.tensordot(weights, form(unit), axes=(0, 0)) for unit in units]
        return jnp.tensordot(own, np.stack(integrals), axes=1)

    linear = each(lambda j: np.einsum("kiab,bc->iack", tilde, j))

    def square(j: np.ndarray) -> np.ndarray:
        outer = 0.5 * np.einsum("kiab,libc,cd->iadkl", tilde, tilde, j)
        total = outer + outer.transpose(0, 2, 1, 3, 4)
        total -= np.einsum("kiab,bc,licd->iadkl", tilde, j, tilde)
        half: np.ndarray = (total + total.transpose(0, 1, 2, 4, 3)) / 2
        return half

    pairs = scale[:, None] * scale[None]
    return {
        "modal": pairs * each(lambda j: np.einsum("iak,ab,ibl->ikl", turned, j, turned)),
        "swing": scale[None] * each(lambda j: np.einsum("ab,ibk->iak", j, turned)),
        "stretch": scale[None, None] * (linear + jnp.swapaxes(linear, 0, 1)),
        "spread": pairs[None, None] * each(square),
        "gyration": pairs[None]
        * each(
            lambda j: (
                np.einsum("kiab,bc,icl->iakl", tilde, j, turned)
                - 0.5 * np.einsum("ab,kibc,icl->iakl", j, tilde, turned)
            )
        ),
    }


def _cross() -> np.ndarray:
    """ε_abc, by which (x × y)_a = ε_abc x_b y_c."""
    unit = np.eye(3)
    return np.cross(unit[:, None], unit[None]).transpose(2, 0, 1)
