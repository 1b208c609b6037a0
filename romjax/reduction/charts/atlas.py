"""Several charts that together cover a motion, where no single one does."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ...common.errors import UnsuitedError
from ...system.base import AbstractSystem
from .chart import Chart
from .choose import WORST_CONDITION
from .survey import survey

# Cosines of the angle between a chart's directions and those of the motion: a chart covers the
# snapshots above the first, and Newton's method starts from those above the second.
_COVERED, _USABLE = 0.8, 0.3
# Snapshots at which charts are judged.
_SNAPSHOTS = 400


class Atlas(eqx.Module):
    """Charts in the null spaces of C_q at some snapshots, which together cover all of them.

    Local parametrisations by tangent spaces follow Potra and Rheinboldt, Mechanics of Structures
    and Machines 19 (1991), doi:10.1080/08905459108905135.

    - `charts`: all of one shape.
    - `domains` (charts, S): numbers of the snapshots from which Newton's method starts in each.
    - `seen` (P,): numbers of the snapshots that were looked at; `owners` (P,): the chart that suits
      each best.
    """

    charts: tuple[Chart, ...]
    domains: np.ndarray
    seen: np.ndarray
    owners: np.ndarray


def choose_atlas(system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]) -> Atlas:
    """Charts along a motion, each as late as it still covers what the one before does not.

    Raises UnsuitedError at a singular position.
    """
    seen = survey(system, t, q, _SNAPSHOTS)
    conditions = np.linalg.cond(seen.jacobians)
    if np.max(conditions) > WORST_CONDITION:
        when = float(t[seen.snapshots[np.argmax(conditions)]])
        raise UnsuitedError(
            "reduce: the mechanism passes a singular position, where no coordinates are "
            f"independent: the condition of its constraints is {np.max(conditions):.1e} at "
            f"t = {when:g} s."
        )
    null_spaces, count = seen.null_spaces, len(seen.null_spaces)
    # cosine[i, j]: how much of a motion at j the directions at i see.
    products = np.einsum("anf,bng->abfg", null_spaces, null_spaces)
    cosine = np.linalg.svd(products, compute_uv=False)[..., -1]
    # Negative where the directions have turned over since: then they were lost on the way.
    turned = np.where(np.linalg.det(products) < 0, -1.0, 1.0)
    orientation = np.cumprod(np.append(1.0, np.diagonal(turned, 1)))
    cosine *= turned * orientation * orientation[:, None]
    centres, covered = list[int](), 0
    while covered < count:
        # The last one that still covers the first that no other does.
        centre = int(_interval(cosine[covered], covered, _COVERED)[-1])
        covered = int(_interval(cosine[centre], centre, _COVERED)[-1]) + 1
        centres.append(centre)
    # Only what is connected along the motion: elsewhere, a chart may have a second branch.
    domains = [_interval(cosine[centre], centre, _USABLE) for centre in centres]
    fit = np.zeros((len(centres), count))
    for row, centre, domain in zip(fit, centres, domains, strict=True):
        row[domain] = cosine[centre, domain]
    charts = []
    for centre in centres:
        complete, _ = np.linalg.qr(null_spaces[centre], mode="complete")
        freedoms = null_spaces.shape[2]
        charts.append(seen.chart(null_spaces[centre], complete[:, freedoms:]))
    # All rows need one length: a domain that is shorter names its snapshots again.
    table = np.stack([np.resize(domain, max(map(len, domains))) for domain in domains])
    owners = np.argmax(fit, axis=0)
    return Atlas(tuple(charts), seen.snapshots[table], seen.snapshots, owners)


def _interval(cosine: np.ndarray, centre: int, least: float) -> np.ndarray:
    """The snapshots around `centre`, one after the other, whose cosine is no less."""
    outside = np.flatnonzero(cosine < least)
    after = np.searchsorted(outside, centre)
    first = outside[after - 1] + 1 if after else 0
    last = outside[after] if after < len(outside) else len(cosine)
    return np.arange(first, last)
