"""What is static about a system: names, and which coordinates are of what kind."""

import dataclasses

from ..scene.coordinate import Coordinate


@dataclasses.dataclass(frozen=True)
class Structure:
    """Names and kinds of coordinates and constraints; part of a compiled program's key.

    - `coordinates`: what they are; `constraints`: what messages call them.
    - `rigid`: which coordinates are those of rigid-body motion; all, where it is unknown.
    - `flexible`: whether parts may be much faster than the motion; true, where it is unknown.
    """

    coordinates: tuple[Coordinate, ...]
    constraints: tuple[str, ...]
    rigid: tuple[bool, ...]
    flexible: bool

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels of the coordinates."""
        return tuple(coordinate.label for coordinate in self.coordinates)

    @classmethod
    def unnamed(cls, n: int, m: int) -> "Structure":
        """Of `n` coordinates and `m` constraints of which nothing else is known."""
        coordinates = tuple(Coordinate("", f"q{i + 1}") for i in range(n))
        return cls(coordinates, tuple(f"constraint {i + 1}" for i in range(m)), (True,) * n, True)
