"""Versions of the format of scene files, and the dimension of their scenes."""

from collections.abc import Mapping
from typing import Any

from .problems import Problems, shown

# The version that this release reads and writes, and the dimensions of its scenes.
FORMAT, DIMENSIONS = 1, (2, 3)


def check_version(tables: Mapping[str, Any], problems: Problems) -> None:
    """Note a file of another version or dimension: nothing else in it has a known meaning."""
    version, dimension = tables.get("format"), tables.get("dimension", 2)
    if "format" not in tables:
        problems.add(("format",), f"The key `format` is missing; add format = {FORMAT} at the top.")
    elif type(version) is not int or version < 1:
        problems.add(("format",), f"It is {shown(version)}; write format = {FORMAT}.")
    elif version > FORMAT:
        words = f"The file has format {version}, but this release of romjax reads up to {FORMAT}; "
        problems.add(("format",), words + "install a newer one.")
    if type(dimension) is not int or dimension not in DIMENSIONS:
        words = f"It is {shown(dimension)}; write dimension = 2 in the plane, 3 in space."
        problems.add(("dimension",), words)
