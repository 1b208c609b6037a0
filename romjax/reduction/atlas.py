"""Minimal coordinates where no single choice of them holds: several charts, changed on the way."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import Time
from ..basis.snapshots import SnapshotSet
from ..errors import ReductionError
from ..system.base import AbstractSystem, Linearization
from ..system.stabilization import Baumgarte
from .base import AbstractReducedSystem
from .chart import WORST, Chart, linear_chart, survey
from .minimal import MinimalSystem
from .validity import Training

# A chart covers the snapshots at which its directions and those of the motion enclose an angle
# whose cosine is at least this; Newton's method starts from those above the second number; and a
# motion changes charts where its own cosine falls below the third.
_COVERED, _NEAR, _LEFT = 0.8, 0.3, 0.5
# How many snapshots are looked at.
_LOOKS = 400


class Atlas(eqx.Module):
    """Charts in the tangent spaces of some snapshots, which together cover all of them."""

    charts: tuple[Chart, ...]
    domains: np.ndarray  # (charts, S): snapshots from which Newton's method starts in each
    places: np.ndarray  # (P,): snapshots
    owners: np.ndarray  # (P,): the chart that suits each best


def choose_atlas(system: AbstractSystem, recording: SnapshotSet) -> Atlas:
    """Charts along a motion, each as late as it still covers what the one before does not."""
    found = survey(system, recording, _LOOKS)
    steepness = np.array([np.linalg.cond(rows) for rows in found.rows])
    if np.max(steepness) > WORST:
        place = float(recording.t[found.places[np.argmax(steepness)]])
        raise ReductionError(
            "reduce: the mechanism passes a singular position, where no coordinates are "
            f"independent: the condition of its constraints is {np.max(steepness):.1e} at "
            f't = {place:g} s; use formulation="galerkin".'
        )
    moves, count = np.stack(found.moves), len(found.moves)
    # cosine[i, j]: how much of a motion at j the directions at i see.
    cosine = np.linalg.svd(np.einsum("anf,bng->abfg", moves, moves), compute_uv=False)[..., -1]
    centres, covered = list[int](), 0
    while covered < count:
        # The last one that still covers the first that no other does.
        centre = int(_run(cosine[covered], covered, _COVERED)[-1])
        covered = int(_run(cosine[centre], centre, _COVERED)[-1]) + 1
        centres.append(centre)
    # Only what is connected along the motion: elsewhere, a chart may have a second branch.
    runs = [_run(cosine[centre], centre, _NEAR) for centre in centres]
    best = np.zeros((len(centres), count))
    for row, centre, run in zip(best, centres, runs, strict=True):
        row[run] = cosine[centre, run]
    charts = []
    for centre in centres:
        whole, _ = np.linalg.qr(moves[centre], mode="complete")
        free = moves[centre].shape[1]
        charts.append(linear_chart(found, moves[centre], whole[:, free:]))
    domains = np.stack([np.resize(run, max(map(len, runs))) for run in runs])
    return Atlas(tuple(charts), found.places[domains], found.places, np.argmax(best, axis=0))


def _run(cosine: np.ndarray, centre: int, least: float) -> np.ndarray:
    """The snapshots around `centre`, one after the other, whose cosine is no less."""
    outside = np.flatnonzero(cosine < least)
    place = np.searchsorted(outside, centre)
    first = outside[place - 1] + 1 if place else 0
    last = outside[place] if place < len(outside) else len(cosine)
    return np.arange(first, last)


class AtlasSystem(AbstractReducedSystem):
    """A `MinimalSystem` whose charts change with the configuration.

    Its state is that of the chart in use, followed by the chart's number, which no time derivative
    changes but `settle` does, between two steps. All freedoms are kept: of a subspace of them, two
    charts would hold two different motions.
    """

    full: AbstractSystem
    parts: Any  # the MinimalSystem of each chart, stacked, without the full one
    root: Float[Array, "n n"]  # R with Rᵀ R the metric
    seen: Float[Array, "P n"]  # R q of snapshots
    owners: Int[Array, " P"]
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    chart: Atlas
    training: Training  # its box is that of R q
    reason: str = eqx.field(static=True)

    settles: ClassVar[bool] = True

    @classmethod
    def of(
        cls, parts: list[MinimalSystem], atlas: Atlas, recording: SnapshotSet, reason: str
    ) -> "AtlasSystem":
        """From the system of each chart."""
        bare = [eqx.tree_at(lambda s: (s.full, s.training), part, (None, None)) for part in parts]
        stacked = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(y) for y in x]), *bare)
        root = jnp.linalg.cholesky(recording.metric).T
        seen = recording.q[atlas.places] @ root.T
        owners = jnp.asarray(atlas.owners)
        start = jnp.zeros(parts[0].n + 1, root.dtype)
        full = parts[0].full
        training = Training.of(seen, jnp.zeros(()))
        new = cls(full, stacked, root, seen, owners, start, start, atlas, training, reason)
        q0, v0 = new.reduced(recording.q[0], recording.v[0])
        return eqx.tree_at(lambda s: (s.q0, s.v0), new, (q0, v0))

    @property
    def m(self) -> int:
        return 0

    @property
    def degrees_of_freedom(self) -> int:
        return self.n - 1

    def constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " 0"]:
        return jnp.zeros(0, q.dtype)

    def _part(self, number: Int[Array, ""]) -> MinimalSystem:
        part = jax.tree.map(lambda x: x[number], self.parts)
        return eqx.tree_at(lambda s: s.full, part, self.full, is_leaf=lambda x: x is None)

    def _split(self, *vectors: Float[Array, " r"]) -> tuple[Any, ...]:
        """The system of the chart that the first one names, and all vectors in it."""
        number = jnp.round(jax.lax.stop_gradient(vectors[0][-1])).astype(int)
        return self._part(number), *(x[:-1] for x in vectors)

    def mass(self, q: Float[Array, " r"]) -> Float[Array, "r r"]:
        part, z = self._split(q)
        return jnp.pad(part.mass(z), (0, 1)).at[-1, -1].set(1)

    def force(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Float[Array, " r"]:
        part, z, w = self._split(q, v)
        return jnp.pad(part.force(t, z, w), (0, 1))

    def acceleration(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> tuple[Float[Array, " r"], Float[Array, " 0"]]:
        part, z, w = self._split(q, v)
        a, multipliers = part.acceleration(t, z, w)
        return jnp.pad(a, (0, 1)), multipliers

    def linearize(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> Linearization:
        part, z, w = self._split(q, v)
        return jax.tree.map(lambda x: jnp.pad(x, (0, 1)), part.linearize(t, z, w))

    def physical(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        part, z, w = self._split(q, v)
        return part.physical(t, z, w)

    def physical_acceleration(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"], a: Float[Array, " r"]
    ) -> Float[Array, " n"]:
        part, z, w, b = self._split(q, v, a)
        return part.physical_acceleration(t, z, w, b)

    def reduced(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        """In the chart of the nearest snapshot."""
        nearest = jnp.argmin(jnp.sum((self.seen - (self.root @ q)[None]) ** 2, axis=1))
        number = self.owners[nearest]
        z, w = self._part(number).reduced(q, v)
        return jnp.append(z, number.astype(z.dtype)), jnp.append(w, jnp.zeros((), w.dtype))

    def judge(
        self,
        ts: Float[Array, " k"],
        q: Float[Array, "k r"],
        v: Float[Array, "k r"],
        violation: Float[Array, " k"],
    ) -> Int[Array, ""]:
        places, _ = jax.vmap(self.physical)(ts, q, v)
        return self.training.judge(places @ self.root.T, violation, None)

    def settle(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        part, z, w = self._split(q, v)
        # In a chart's own directions, tangents are unit vectors; elsewhere longer by 1/cosine.
        stretch = jnp.linalg.norm(self.root @ part.tangent(t, z), axis=0)
        left = jnp.max(stretch) > 1 / _LEFT
        others = self.reduced(*part.physical(t, z, w))
        return jax.tree.map(lambda new, old: jnp.where(left, new, old), others, (q, v))
