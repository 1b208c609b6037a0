"""The inertia of a flexible body in a floating frame, by integrals that are taken once."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Vector, concrete
from ...common.errors import SceneError
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ..fields import Converted, check_numbers, number


class Inertia(eqx.Module):
    """Inertia invariants: all that a mass matrix needs to know of the points of a body.

    A point X of the undeformed body is at R + A(φ) (X + S q_f). With Ĩ = [[0, −1], [1, 0]], its
    kinetic energy ½ ∫ρ |ṙ|² dV is a polynomial in q_f with these coefficients, so the cost of a
    step does not depend on how many points there are (Shabana, "Dynamics of Multibody Systems",
    chapter 5). What is None is zero, and absent from the program.

    **Arguments:**

    - `mass`: ∫ρ [kg].
    - `moment`: ∫ρ X·X [kg m²]; None where only first moments are asked for.
    - `modal`: ∫ρ SᵀS; the identity unless given.
    - `first_moment`: ∫ρ X [kg m], zero if the frame sits in the centre of mass.
    - `shift`: ∫ρ S (2, modes), the momentum of the modes (translational participation factors), and
      `swing`: ∫ρ (ĨX)ᵀS (modes), their angular momentum (rotational participation factors): zero if
      the modes are orthogonal to rigid motion.
    - `stretch`: ∫ρ XᵀS (modes), half the change of the moment of inertia with the modes.
    - `gyration`: ∫ρ Sᵀ ĨS (modes, modes), the gyroscopic coupling of the modes, antisymmetric; zero
      if all points move along one line.
    - `foreshortening`: ∫ρ G (2, modes, modes), and `spin`: ∫ρ X·G (modes, modes), of a displacement
      −½ q_fᵀ G q_f of second order.
    """

    mass: Converted[Float[Array, ""]] = number()
    moment: Converted[Float[Array, ""] | None] = number()
    modal: Converted[Float[Array, "modes modes"] | None, Vector] = number(default=None)
    first_moment: Converted[Float[Array, "2"] | None, Vector] = number(default=None)
    shift: Converted[Float[Array, "2 modes"] | None, Vector] = number(default=None)
    swing: Converted[Float[Array, " modes"] | None, Vector] = number(default=None)
    stretch: Converted[Float[Array, " modes"] | None, Vector] = number(default=None)
    gyration: Converted[Float[Array, "modes modes"] | None, Vector] = number(default=None)
    foreshortening: Converted[Float[Array, "2 modes modes"] | None, Vector] = number(default=None)
    spin: Converted[Float[Array, "modes modes"] | None, Vector] = number(default=None)

    @property
    def diagonal(self) -> bool:
        """Whether no coordinate couples with another."""
        couplings = (self.modal, self.first_moment, self.shift, self.swing, self.gyration)
        return all(term is None for term in (*couplings, self.foreshortening))

    def matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        """Mass matrix at the coordinates x, y, φ, q_f; a diagonal one as its diagonal."""
        bent = q[3:]
        unit = jnp.ones_like(bent)
        turning = self._turning(bent)
        if self.diagonal:
            return jnp.concatenate([jnp.stack([self.mass, self.mass, turning]), unit])
        # A and dA/dφ, by which points have the velocities Ṙ + dA/dφ u φ̇ + A S q̇_f.
        c, s = jnp.cos(q[2]), jnp.sin(q[2])
        turn, across = jnp.array([[c, -s], [s, c]]), jnp.array([[-s, -c], [c, -s]])
        around = jnp.zeros_like(bent) if self.swing is None else self.swing
        if self.gyration is not None:
            around = around + multiply(self.gyration, bent)
        top = jnp.concatenate(
            [
                self.mass * jnp.eye(2, dtype=q.dtype),
                multiply(across, self._arm(bent))[:, None],
                multiply(turn, self._slide(bent)),
            ],
            axis=1,
        )
        modal = jnp.diag(unit) if self.modal is None else self.modal
        middle = jnp.concatenate([top[:, 2], turning[None], around])
        low = jnp.concatenate([top[:, 3:].T, around[:, None], modal], axis=1)
        return jnp.concatenate([top, middle[None], low])

    def first_moment_at(self, q: Float[Array, " size"]) -> Float[Array, "2"]:
        """∫ρ r dV [kg m] at the coordinates x, y, φ, q_f."""
        still = (self.first_moment, self.shift, self.foreshortening)
        if all(term is None for term in still):
            return self.mass * q[:2]
        c, s = jnp.cos(q[2]), jnp.sin(q[2])
        return self.mass * q[:2] + multiply(jnp.array([[c, -s], [s, c]]), self._arm(q[3:]))

    def in_span(self, basis: Float[Array, "modes k"]) -> "Inertia":
        """The inertia of the motions q_f = Φ z, exactly: all terms are polynomials in q_f.

        `basis` Φ (modes, k): orthonormal where `modal` is the identity.
        """
        linear = "shift", "swing", "stretch"
        quadratic = "modal", "gyration", "foreshortening", "spin"
        changed = {name: x @ basis for name in linear if (x := getattr(self, name)) is not None}
        for name in quadratic:
            if (x := getattr(self, name)) is not None:
                changed[name] = basis.T @ x @ basis
        return dataclasses.replace(self, **changed)

    def check(self, owner: str, modes: int) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""
        shapes: dict[str, tuple[int, ...]] = {
            "mass": (),
            "moment": (),
            "modal": (modes, modes),
            "first_moment": (2,),
            "shift": (2, modes),
            "swing": (modes,),
            "stretch": (modes,),
            "gyration": (modes, modes),
            "foreshortening": (2, modes, modes),
            "spin": (modes, modes),
        }
        for field, shape in shapes.items():
            check_numbers(owner, self, field, shape=shape, prefix="inertia.")
        matrix = concrete(_undeformed(self, modes))
        if matrix is not None:
            least = np.min(np.linalg.eigvalsh(np.diag(matrix) if matrix.ndim == 1 else matrix))
            if not least > 0:
                raise SceneError(
                    f"{owner}: its mass matrix is not positive definite, with an eigenvalue of "
                    f"{least:g}; check the signs of the invariants, and that modes are independent."
                )

    def _turning(self, bent: Float[Array, " modes"]) -> Float[Array, ""]:
        """Moment of inertia about the origin of the frame."""
        total = jnp.zeros((), bent.dtype) if self.moment is None else self.moment
        if bent.shape[0]:
            # ∫ρ |u|², which is q_fᵀ M_ff q_f.
            total = total + multiply(
                bent, bent if self.modal is None else multiply(self.modal, bent)
            )
        if self.stretch is not None:
            # 2 ∫ρ x·u.
            total = total + 2 * multiply(self.stretch, bent)
        if self.spin is not None:
            total = total - multiply(bent, multiply(self.spin, bent))
        return total

    def _arm(self, bent: Float[Array, " modes"]) -> Float[Array, "2"]:
        """First moment in the body frame."""
        total = jnp.zeros(2, bent.dtype) if self.first_moment is None else self.first_moment
        if self.shift is not None:
            total = total + multiply(self.shift, bent)
        if self.foreshortening is not None:
            total = total - 0.5 * multiply(self.foreshortening @ bent, bent)
        return total

    def _slide(self, bent: Float[Array, " modes"]) -> Float[Array, "2 modes"]:
        """Derivative of the first moment by the amplitudes."""
        total = jnp.zeros((2, bent.shape[0]), bent.dtype) if self.shift is None else self.shift
        return total if self.foreshortening is None else total - self.foreshortening @ bent


@program_once
def _undeformed(inertia: Inertia, modes: int) -> Float[Array, "size *size"]:
    """The mass matrix of the undeformed body: one program, where each operation would be one."""
    return inertia.matrix(jnp.zeros(3 + modes, inertia.mass.dtype))
