"""The inertia of a flexible body in space, by integrals that are taken once."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Vector, as_array
from ....linalg import quaternions
from ....linalg.dense import invert, multiply, multiply_transposed
from ...fields import Converted, number
from .check_invariants import check_invariants
from .frame_inverse import FrameInverse, spin_of
from .products import products, turned


class SpatialInertia(eqx.Module):
    """Inertia invariants in space: all that a mass matrix needs to know of the points of a body.

    A point X of the undeformed body is at x + A(p) u, u = X + S q_f − ½ q_fᵀ G q_f. With the
    velocity V of the frame and its angular velocity ω, both by the axes of the body, its kinetic
    energy is

        T = ½ m V·V + V·(ω × c) + V·c' q̇_f + ½ ωᵀ J ω + ωᵀ H q̇_f + ½ q̇_fᵀ M_ff q̇_f,

    where c, J and H are polynomials in q_f with the coefficients below, so the cost of a step does
    not depend on how many points there are (Shabana, "Dynamics of Multibody Systems", chapter 5).
    What is None is zero, and absent from the program. The length of p has a kinetic energy of its
    own, ½ μ (pᵀṗ / pᵀp)² with a constant μ, which no force acts on.

    **Arguments:**

    - `mass`: ∫ρ [kg].
    - `moment`: J of the undeformed body, ∫ρ (X·X I − X Xᵀ) (3, 3) [kg m²].
    - `modal`: M_ff = ∫ρ SᵀS; the identity unless given.
    - `first_moment`: c of the undeformed body, ∫ρ X (3,) [kg m], zero if the frame sits in the
      centre of mass.
    - `shift`: ∫ρ S (3, modes), the momentum of the modes (translational participation factors), and
      `swing`: ∫ρ X × S (3, modes), H of the undeformed body, their angular momentum (rotational
      participation factors): zero if the modes are orthogonal to rigid motion.
    - `stretch`: ∂J/∂q_f of the undeformed body (3, 3, modes), the first-order change of inertia.
    - `spread`: K of its second-order change q_fᵀ K q_f (3, 3, modes, modes).
    - `gyration`: ∂H/∂q_f, ∫ρ S_k × S_l (3, modes, modes), the index of q_f first: the gyroscopic
      coupling of the modes.
    - `foreshortening`: ∫ρ G (3, modes, modes), of the displacement of second order; its other
      terms are parts of `spread` and `gyration`.
    """

    mass: Converted[Float[Array, ""]] = number()
    moment: Converted[Float[Array, "3 3"], Vector] = number()
    modal: Converted[Float[Array, "modes modes"] | None, Vector] = number(default=None)
    first_moment: Converted[Float[Array, "3"] | None, Vector] = number(default=None)
    shift: Converted[Float[Array, "3 modes"] | None, Vector] = number(default=None)
    swing: Converted[Float[Array, "3 modes"] | None, Vector] = number(default=None)
    stretch: Converted[Float[Array, "3 3 modes"] | None, Vector] = number(default=None)
    spread: Converted[Float[Array, "3 3 modes modes"] | None, Vector] = number(default=None)
    gyration: Converted[Float[Array, "3 modes modes"] | None, Vector] = number(default=None)
    foreshortening: Converted[Float[Array, "3 modes modes"] | None, Vector] = number(default=None)

    @classmethod
    def of_points(cls, masses: Vector, positions: Vector, shapes: Vector) -> "SpatialInertia":
        """The inertia of point `masses` [kg] (points,) at `positions` [m] (points, 3), with their
        displacements per unit amplitude, `shapes` (points, 3, modes).
        """
        weights, arms, moved = (as_array(x) for x in (masses, positions, shapes))
        rows, modes = arms.size, moved.shape[2]
        unit = jnp.tile(jnp.eye(3, dtype=arms.dtype), (len(arms), 1))
        rigid = jnp.concatenate([unit, turned(arms).reshape(rows, 3)], axis=1)
        around = turned(moved).reshape(rows, 3, modes)
        each = jnp.repeat(weights, 3)[:, None]
        return cls(**products(lambda x: each * x, rigid, moved.reshape(rows, modes), around))

    def matrix(self, q: Float[Array, " size"]) -> Float[Array, "size size"]:
        """Mass matrix at the coordinates x, y, z, p, q_f."""
        p, bent = q[3:7], q[7:]
        square = quaternions.squared(p)
        onto = 2 * quaternions.body_matrix(p) / square  # ω = onto ṗ
        around = multiply_transposed(onto, self.spinning(bent))
        # Tᵀ J T in the rates of p, and an inertia along p, which has none by itself: M would be
        # singular.
        turning = multiply_transposed(onto, multiply(self.turning(bent), onto))
        turning += length_inertia(self.moment) / square**2 * p[:, None] * p[None]
        moving = self.mass * jnp.eye(3, dtype=q.dtype)
        modal = jnp.eye(len(bent), dtype=q.dtype) if self.modal is None else self.modal
        if self.centred:
            aside = jnp.zeros((3, 4 + len(bent)), q.dtype)
        else:
            arm = quaternions.skew(self.arm(bent))
            own = jnp.concatenate([-multiply(arm, onto), self.sliding(bent)], axis=1)
            aside = multiply(quaternions.matrix(p), own)
        return _symmetric(moving, aside, _symmetric(turning, around, modal))

    @property
    def inverts(self) -> bool:
        """Whether the inverse of the mass matrix is known in closed form."""
        return self.modal is None

    def inverse(self, q: Float[Array, " size"]) -> FrameInverse:
        """Inverse of the mass matrix at x, y, z, p, q_f, where M_ff is the identity."""
        p, bent = q[3:7], q[7:]
        own, beside = self.turning(bent), self.spinning(bent)
        turn = None
        if not self.centred:
            arm, slide = quaternions.skew(self.arm(bent)), self.sliding(bent)
            moving = self.mass * jnp.eye(3, dtype=q.dtype)
            own, beside = _symmetric(moving, -arm, own), jnp.concatenate([slide, beside])
            turn = quaternions.matrix(p)
        # With M_ff = 1, Schur's complement of the amplitudes is of the frame alone.
        core, length = invert(own - multiply(beside, beside.T)), length_inertia(self.moment)
        return FrameInverse(1 / self.mass, core, 1 / length, spin_of(p), turn, beside.T)

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"]:
        """−Ṁ v + ½ ∂(vᵀ M v)/∂q, by `quadratic`.

        The rates of ω = 2 G ṗ/s and of the length ρ = ln |p| are 2 G p̈/s − 2 r ω/s and
        pᵀp̈/s + ṗᵀṗ/s − 2 r²/s², r = pᵀṗ.
        """
        p, rate, bent, bending = q[3:7], v[3:7], q[7:], v[7:]
        s, r = quaternions.squared(p), jnp.sum(p * rate)
        onto = 2 * quaternions.body_matrix(p) / s
        omega, stretching = quaternions.apply(onto, rate), 2 * r / s
        moving, turning, modal = self.quadratic(omega, bent, bending)
        turning -= stretching * multiply(self.turning(bent), omega)
        modal -= stretching * multiply(omega, self.spinning(bent))
        force = -quaternions.apply_transposed(onto, turning)
        # The inertia along p acts where its length changes, by rounding and within iterations.
        force += length_inertia(self.moment) * (2 * r**2 / s - jnp.sum(rate**2)) / s**2 * p
        if self.centred:
            return jnp.concatenate([moving, force, -modal])
        moving -= stretching * quaternions.cross(omega, self.arm(bent))
        return jnp.concatenate([-quaternions.rotate(p, moving), force, -modal])

    def quadratic(
        self, omega: Float[Array, "3"], bent: Float[Array, " modes"], bending: Array
    ) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, " modes"]]:
        """Forces, torques and modal forces that a motion asks for while ω, by the axes of the body,
        and η = q̇_f do not change and the frame has no acceleration, all by the axes of the body: by
        the equations of Boltzmann and Hamel (Papastavridis, "Analytical Mechanics", 2002, chapter
        3), in which the velocity of the frame drops out.
        """
        tensor, spinning = self.turning(bent), self.spinning(bent)
        # Euler's ω × (J ω + h), h that of the moving amplitudes.
        turning = quaternions.cross(omega, multiply(tensor, omega) + multiply(spinning, bending))
        modal = jnp.zeros_like(bent)
        slope = self._turning_slope(bent)  # ∂J/∂q_f
        if slope is not None:
            along = jnp.sum(slope * omega[None, :, None], axis=1)
            # J̇ ω; and by Lagrange −½ ωᵀ ∂J/∂q_f ω on the amplitudes, the centrifugal force.
            turning += multiply(along, bending)
            modal -= 0.5 * multiply(omega, along)
        if self.gyration is not None:
            about = jnp.sum(self.gyration * omega[:, None, None], axis=0)
            # Coriolis forces between the modes.
            modal += multiply(bending, about) - multiply(about, bending)
            turning += _square(self.gyration, bending)
        if self.centred:
            return jnp.zeros_like(omega), turning, modal
        sliding = multiply(self.sliding(bent), bending)
        # Centripetal, and Coriolis' of the sliding centre of mass.
        moving = quaternions.cross(omega, quaternions.cross(omega, self.arm(bent)) + 2 * sliding)
        if self.foreshortening is not None:
            moving -= _square(self.foreshortening, bending)
        return moving, turning, modal

    @property
    def centred(self) -> bool:
        """Whether the frame stays in the centre of mass: then nothing couples with x, y, z."""
        return all(x is None for x in (self.first_moment, self.shift, self.foreshortening))

    def first_moment_at(self, q: Float[Array, " size"]) -> Float[Array, "3"]:
        """∫ρ r dV [kg m] at the coordinates x, y, z, p, q_f."""
        if self.centred:
            return self.mass * q[:3]
        return self.mass * q[:3] + quaternions.rotate(q[3:7], self.arm(q[7:]))

    def arm(self, bent: Float[Array, " modes"]) -> Float[Array, "3"]:
        """c: the first moment in the body frame [kg m]."""
        total = jnp.zeros(3, bent.dtype) if self.first_moment is None else self.first_moment
        if self.shift is not None:
            total = total + multiply(self.shift, bent)
        if self.foreshortening is not None:
            total = total - 0.5 * _square(self.foreshortening, bent)
        return total

    def turning(self, bent: Float[Array, " modes"]) -> Float[Array, "3 3"]:
        """J: the moment of inertia about the origin of the frame, by its axes [kg m²]."""
        total = self.moment
        if self.stretch is not None:
            total = total + _times(self.stretch, bent)
        return total if self.spread is None else total + _square(self.spread, bent)

    def _turning_slope(self, bent: Float[Array, " modes"]) -> Float[Array, "3 3 modes"] | None:
        """∂J/∂q_f; None where it is zero."""
        if self.spread is None:
            return self.stretch
        slope = 2 * _times(self.spread, bent)
        return slope if self.stretch is None else self.stretch + slope

    def in_span(self, basis: Float[Array, "modes k"]) -> "SpatialInertia":
        """The inertia of the motions q_f = Φ z, exactly: all terms are polynomials in q_f.

        `basis` Φ (modes, k): orthonormal where `modal` is the identity.
        """
        linear = "shift", "swing", "stretch"
        quadratic = "modal", "spread", "gyration", "foreshortening"
        changed = {name: x @ basis for name in linear if (x := getattr(self, name)) is not None}
        for name in quadratic:
            if (x := getattr(self, name)) is not None:
                changed[name] = jnp.swapaxes(jnp.swapaxes(x @ basis, -1, -2) @ basis, -1, -2)
        return dataclasses.replace(self, **changed)

    def check(self, owner: str, modes: int) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""
        check_invariants(owner, self, modes)

    def spinning(self, bent: Float[Array, " modes"]) -> Float[Array, "3 modes"]:
        """H: the angular momentum by the axes of the frame, per unit rate of the amplitudes."""
        total = jnp.zeros((3, len(bent)), bent.dtype) if self.swing is None else self.swing
        if self.gyration is None:
            return total
        return total + jnp.sum(self.gyration * bent[None, :, None], axis=1)

    def sliding(self, bent: Float[Array, " modes"]) -> Float[Array, "3 modes"]:
        """Derivative of the first moment by the amplitudes."""
        total = jnp.zeros((3, len(bent)), bent.dtype) if self.shift is None else self.shift
        return total if self.foreshortening is None else total - _times(self.foreshortening, bent)


def length_inertia(tensor: Float[Array, "3 3"]) -> Float[Array, ""]:
    """μ = ⁴⁄₃ tr J, which makes M_pp of a body with three equal moments j the matrix 4 j I / s."""
    return 4.0 / 3.0 * jnp.trace(tensor)


def _symmetric(a: Array, b: Array, c: Array) -> Float[Array, "size size"]:
    """[[a, b], [bᵀ, c]]."""
    return jnp.concatenate([jnp.concatenate([a, b], axis=1), jnp.concatenate([b.T, c], axis=1)])


def _times(x: Float[Array, "*axes modes"], bent: Float[Array, " modes"]) -> Float[Array, "*axes"]:
    """Σ_l x[…, l] q_l."""
    return jnp.sum(x * bent.reshape(*[1] * (x.ndim - 1), -1), axis=-1)


def _square(x: Float[Array, "*axes modes modes"], bent: Array) -> Float[Array, "*axes"]:
    """Σ_kl q_k x[…, k, l] q_l."""
    return _times(_times(x, bent), bent)
