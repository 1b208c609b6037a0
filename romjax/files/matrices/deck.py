"""Cards of an input deck of CalculiX, other than nodes, that decide on the rows of matrices."""

from pathlib import Path
from typing import NamedTuple

from .entries import text_of, wrong

_CURE = "give a REF NODE and a ROT NODE, as nodes of the deck"


class Deck(NamedTuple):
    """The `types` of all elements, and rigid bodies as pairs of the numbers of their reference node
    and of the node whose displacements are their rotations, None if CalculiX makes it.
    """

    path: Path
    types: frozenset[str]
    rigid: tuple[tuple[int, int | None], ...]

    @property
    def plane(self) -> bool:
        """Whether all elements are in plane stress or plane strain."""
        return bool(self.types) and all(kind[:3] in ("CPS", "CPE") for kind in self.types)


def deck_of(path: Path) -> Deck:
    """Read the keywords of a deck.

    Raises InputError, with the line, for elements whose rows in the matrices are not known.
    """
    types, rigid = set(), []
    for number, line in enumerate(text_of(path).splitlines(), 1):
        if not line.startswith("*") or line.startswith("**"):
            continue
        keyword, _, rest = (part.strip() for part in line.upper().partition(","))
        pairs = (option.partition("=") for option in rest.split(","))
        # Blanks within names, as in REF NODE, are none to CalculiX.
        options = {name.replace(" ", ""): value.strip() for name, _, value in pairs}
        if keyword == "*ELEMENT":
            types.add(options.get("TYPE", ""))
        elif keyword in ("*SHELL SECTION", "*BEAM SECTION") and _shifts(options):
            raise wrong(
                path, number, "the section is beside its nodes; move the nodes, without an OFFSET"
            )
        elif keyword == "*RIGID BODY":
            rigid.append(_rigid(path, number, options))
    return Deck(path, frozenset(types), tuple(rigid))


def _shifts(options: dict[str, str]) -> bool:
    return any(float(options.get(name) or 0) != 0 for name in ("OFFSET", "OFFSET1", "OFFSET2"))


def _rigid(path: Path, line: int, options: dict[str, str]) -> tuple[int, int | None]:
    if not options.get("REFNODE", "").isdigit():
        raise wrong(path, line, f"the rigid body has no reference node of the deck; {_CURE}")
    turning = options.get("ROTNODE")
    if turning is not None and not turning.isdigit():
        raise wrong(path, line, f"{turning!r} is no number of a node; {_CURE}")
    return int(options["REFNODE"]), None if turning is None else int(turning)
