"""The ready scenes by name, each with the run that shows it best."""

import dataclasses
import difflib
from collections.abc import Callable, Mapping
from typing import Any

import diffrax

from ..errors import SceneError
from ..scene.scene import Scene
from .cart_pendulum import cart_pendulum
from .chain import chain


@dataclasses.dataclass(frozen=True)
class Example:
    """A scene and how to run it: for `end` [s], sampled at `rate` [Hz].

    `pod_rank`, `sod_rank`: numbers of modes, None for the drop point. What a publication says of
    the scene, if one does: `published_savings`, the share of time that its reduced models save, by
    the name of their decomposition; `published_ranks`, the numerical ranks of its generalised SVD
    at `rate` and at three times that. `rtol`: tolerance; `solver`: None for the default.
    """

    name: str
    title: str
    make: Callable[[], Scene]
    end: float = 1.0
    rate: float = 100.0
    pod_rank: int | None = None
    sod_rank: int | None = None
    published_savings: Mapping[str, float] = dataclasses.field(default_factory=dict)
    published_ranks: tuple[int, ...] = ()
    rtol: float = 1e-8
    solver: diffrax.AbstractSolver[Any] | None = None


EXAMPLES = (
    Example(
        "cart-pendulum",
        "cart on a diagonal rail with a flexible pendulum: the chapter's example",
        cart_pendulum,
        pod_rank=6,
        sod_rank=5,
        published_savings={"POD": 0.12, "SOD": 0.30},  # section 39.4.2, by six and by five modes
        published_ranks=(5, 6),
    ),
    Example("chain", "eight bars hinged end to end, falling from the horizontal", chain),
)


def find(name: str) -> Example:
    """The example of that name; raises SceneError with the nearest match."""
    names = [example.name for example in EXAMPLES]
    if name in names:
        return EXAMPLES[names.index(name)]
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f"did you mean '{matches[0]}'? " if matches else ""
    raise SceneError(f"There is no scene '{name}'; {hint}The scenes are: {', '.join(names)}.")
