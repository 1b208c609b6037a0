"""Bodies of equal structure: stacked, and mapped over once."""

import functools
import operator
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..linalg.dense import multiply
from ..linalg.indexing import Index
from ..linalg.inverse_mass import AbstractBodyInverse
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractField
from ..system.dynamics import quadratic_velocity_force
from ..system.schedule import AbstractStack


class BodyGroup(AbstractStack):
    """Bodies of equal structure; `weights` multiply the Lagrangian of each, and what follows."""

    bodies: AbstractBody  # stacked
    coordinates: Index = eqx.field(static=True)  # (count, size)
    weights: Float[Array, " count"] | None = None  # None: all are one

    @property
    def kind(self) -> type:
        return type(self.bodies)

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "count size *size"]:
        """Mass matrices, or their diagonals where the bodies give these."""
        masses: Float[Array, "count size *size"]
        masses = jax.vmap(lambda body, q: body.mass_matrix(q))(
            self.bodies, self.coordinates.take(q)
        )
        return self.weighted(masses)

    def inverse_mass(self, q: Float[Array, " n"]) -> AbstractBodyInverse | None:
        """Inverses of the mass matrices; None where bodies know none."""
        if not self.bodies.inverts_mass or self.weights is not None:
            return None
        inverses: AbstractBodyInverse = jax.vmap(lambda body, q: body.inverse_mass(q))(
            self.bodies, self.coordinates.take(q)
        )
        return inverses

    def force(
        self,
        fields: tuple[AbstractField, ...],
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        quadratic: bool = True,
    ) -> Float[Array, "count size"] | None:
        """Elastic, damping, field and `quadratic` velocity forces; None where there are none."""
        if (total := self._total(fields, quadratic)) is None:
            return None
        own = [self.coordinates.take(x) for x in (q, v)[: 1 + self._moving]]
        return self.weighted(jax.vmap(total)(self.bodies, *own))

    def acts(self, fields: tuple[AbstractField, ...], quadratic: bool) -> bool:
        """Whether there is a `force` of these."""
        return self._total(fields, quadratic) is not None

    def slopes(
        self,
        fields: tuple[AbstractField, ...],
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        a: Float[Array, " n"],
    ) -> tuple[Float[Array, "count size size"] | None, Float[Array, "count size size"] | None]:
        """∂/∂q and ∂/∂v of M a − Q of each, with the `force` for Q; None where it is zero."""
        total, constant = self._total(fields), self.bodies.constant_mass
        if total is None and constant:
            return None, None

        def residual(body: AbstractBody, a: Array, q: Array, *v: Array) -> Array:
            force = jnp.zeros_like(q) if total is None else -total(body, q, *v)
            if constant:
                return force
            mass = body.mass_matrix(q)
            return force + (mass * a if mass.ndim == 1 else multiply(mass, a))

        own = [self.coordinates.take(x) for x in (a, q, v)[: 2 + self._moving]]
        by_state = jax.jacfwd(residual, argnums=tuple(range(2, len(own) + 1)))
        slopes = [self.weighted(x) for x in jax.vmap(by_state)(self.bodies, *own)]
        return slopes[0], slopes[1] if self._moving else None

    @property
    def _moving(self) -> bool:
        """Whether forces of the bodies depend on velocities."""
        return self.bodies.damped or not self.bodies.constant_mass

    def _total(
        self, fields: tuple[AbstractField, ...], quadratic: bool = True
    ) -> Callable[..., Array] | None:
        """The `force` of one body as a function of it, q and, if it is moving, v."""
        still: list[Callable[..., Float[Array, " size"]]] = [
            lambda body, q, field=field: field.force(body, q) for field in fields
        ]
        moving: list[Callable[..., Float[Array, " size"]]] = []
        if self.bodies.modes:
            still.append(lambda body, q: -jax.grad(body.elastic_energy)(q))
        if self.bodies.damped:
            moving.append(lambda body, q, v: body.damping_force(v))
        if quadratic and not self.bodies.constant_mass:
            moving.append(_quadratic_velocity_force)
        if not still and not moving:
            return None

        def total(body: AbstractBody, q: Array, *v: Array) -> Array:
            terms = [term(body, q) for term in still] + [term(body, q, *v) for term in moving]
            return functools.reduce(operator.add, terms)

        return total

    def kinetic_energy(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, " count"]:
        """The kinetic energy of each."""
        mass, own = self.mass(q), self.coordinates.take(v)
        momentum = mass * own if mass.ndim == 2 else jax.vmap(multiply)(mass, own)
        return 0.5 * jnp.sum(own * momentum, axis=1)

    def elastic_energy(self, q: Float[Array, " n"]) -> Float[Array, " count"] | None:
        """The strain energy of each; None of bodies that do not deform."""
        if not self.bodies.modes:
            return None
        own = self.coordinates.take(q)
        each: Array = jax.vmap(lambda body, q: body.elastic_energy(q))(self.bodies, own)
        return self.weighted(each)

    def field_energy(
        self, fields: tuple[AbstractField, ...], q: Float[Array, " n"]
    ) -> Float[Array, " count"] | None:
        """The energy of each in all fields; None without fields."""
        if not fields:
            return None
        own = self.coordinates.take(q)
        each = [jax.vmap(field.energy)(self.bodies, own) for field in fields]
        return self.weighted(functools.reduce(operator.add, each))

    def damping_power(self, v: Float[Array, " n"]) -> Float[Array, " count"] | None:
        """The power of the own damping of each; None where there is none."""
        if not self.bodies.damped:
            return None
        own = self.coordinates.take(v)
        damping = jax.vmap(lambda body, v: body.damping_force(v))(self.bodies, own)
        return self.weighted(jnp.sum(own * damping, axis=1))

    def weighted(self, x: Float[Array, "count *k"]) -> Float[Array, "count *k"]:
        """Terms of the Lagrangian of each body, times its weight."""
        if self.weights is None:
            return x
        return x * self.weights.reshape(self.weights.shape + (1,) * (x.ndim - 1))


def _quadratic_velocity_force(
    body: AbstractBody, q: Float[Array, " size"], v: Float[Array, " size"]
) -> Float[Array, " size"]:
    """Return the force that the body defines, or else that from its mass matrix by autodiff."""
    own = body.quadratic_velocity_force(q, v)
    force: Array = quadratic_velocity_force(body.mass_matrix)(q, v) if own is None else own
    return force
