"""Generalized coordinates, as pictures and reports name them."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

# What begins the name of a coordinate whose rate is a state of an effect.
INTEGRAL = "∫"


class Coordinate(NamedTuple):
    r"""A generalized coordinate in words and signs.

    **Arguments:**

    - `owner`: the body that it belongs to; empty for coordinates of one's own systems.
    - `name`: short, such as "phi".
    - `unit`: in SI units, with powers such as "kg^1/2 m"; empty where it is unknown. Of what
      carries a state, that of the state.
    - `symbol`: in TeX's mathematics, such as "\varphi"; the name in plain type if it is empty.
    - `description`: in words, such as "bending mode 1 of beam"; the label if it is empty.
    """

    owner: str
    name: str
    unit: str = ""
    symbol: str = ""
    description: str = ""

    @property
    def label(self) -> str:
        """The label of the coordinate in tables, such as "cart.x"."""
        return f"{self.owner}.{self.name}" if self.owner else self.name


def frame_size(dimension: int) -> int:
    """How many coordinates a body's frame has in the plane and in space."""
    return 3 if dimension == 2 else 7


def frame_coordinates(owner: str, dimension: int) -> tuple[Coordinate, ...]:
    """Return the coordinates of a body's frame: its position, then an angle or a quaternion."""
    axes = "xy" if dimension == 2 else "xyz"
    position = [Coordinate(owner, x, "m", x, f"position {x} of {owner}") for x in axes]
    if dimension == 2:
        turn = [Coordinate(owner, "phi", "rad", r"\varphi", f"angle of {owner}")]
    else:
        turn = [
            Coordinate(owner, f"p{k}", "", f"p_{k}", f"quaternion component {k} of {owner}")
            for k in range(4)
        ]
    return (*position, *turn)


def quaternions_of(coordinates: Sequence[Coordinate]) -> tuple[int, ...]:
    """Return the numbers of the coordinates at which quaternions of bodies in space begin."""
    starts = range(len(coordinates) - 3)
    return tuple(
        i
        for i in starts
        if tuple(coordinates[i : i + 4]) == frame_coordinates(coordinates[i].owner, 3)[3:]
    )


@functools.lru_cache(maxsize=64)
def groups_of(coordinates: tuple[Coordinate, ...]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The groups of coordinates of one kind and one owner, in words such as "deflection of beam",
    and of each coordinate the number of its group: a body's position, its angle or quaternion, and
    its modes. Others are groups of their own, by their labels; states of effects, whose integrals
    mean nothing, are in none, -1.
    """
    kinds = dict[Coordinate, str]()
    for owner in {coordinate.owner for coordinate in coordinates}:
        for dimension in (2, 3):
            frame = frame_coordinates(owner, dimension)
            if owner and set(frame) <= set(coordinates):
                kinds |= dict.fromkeys(frame, "angle") | dict.fromkeys(
                    frame[:dimension], "position"
                )
    bodies = {coordinate.owner for coordinate in kinds}
    names = dict[str, int]()
    numbers = []
    for coordinate in coordinates:
        if coordinate.name.startswith(INTEGRAL):
            numbers.append(-1)
            continue
        name = coordinate.label
        if coordinate.owner in bodies:
            name = f"{kinds.get(coordinate, 'deflection')} of {coordinate.owner}"
        numbers.append(names.setdefault(name, len(names)))
    return tuple(names), tuple(numbers)


def find(label: str, labels: Sequence[str]) -> tuple[int, bool] | None:
    """The number of the coordinate of a `label`, and whether that stands for its rate: "cart.x'",
    or a state of an effect, "pid.integral". None where there is no such coordinate.
    """
    if label in labels:
        return labels.index(label), False
    if label.endswith("'") and label[:-1] in labels:
        return labels.index(label[:-1]), True
    owner, _, state = label.rpartition(".")
    carried = f"{owner}.{INTEGRAL}{state}"
    return (labels.index(carried), True) if carried in labels else None
