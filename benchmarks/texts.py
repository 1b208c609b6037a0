"""Records that exist as text alone, as JSON: `python benchmarks/texts.py NAME ...` reads NAME.txt.

Records that are measured from now on come with their JSON. The commit of one that is read here is
that which put its text into the repository, the parent of which it was measured at.
"""

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import record

DATE = re.compile(r"\d{4}-\d\d-\d\d, ")


def columns(header: str) -> list[int]:
    """Where the columns of a table begin: two spaces and more are between their names."""
    return [match.start() for match in re.finditer(r"(?:(?<=^)|(?<=  ))\S", header)]


def cells(line: str, starts: Sequence[int]) -> list[str]:
    """Of a line of a table whose columns are aligned on the left."""
    bounds = [*starts, None]
    return [line[a:b].strip() for a, b in pairwise(bounds)]


def paragraphs(text: str) -> list[str]:
    return [part for part in text.strip("\n").split("\n\n") if part.strip()]


def read(text: str) -> dict:
    """The heading, and tables with the paragraph above each; ratios from the last table."""
    heading, *rest = paragraphs(text)
    if not DATE.match(heading):
        raise ValueError(f"the record begins with {heading[:40]!r}, not with a date")
    found = {"made": heading[:10], "on": heading[12:], "tables": [], "ratios": {}}
    for above, part in pairwise(["", *rest]):
        header, *lines = part.splitlines()
        starts = columns(header)
        if header.split()[:2] == ["comparison", "ratio"]:
            found["ratios"] = ratios(lines, header)
        elif lines and len(starts) > 1 and re.search(r"[^:]$", header) and _is_table(lines, starts):
            rows = [cells(line, starts) for line in lines]
            found["tables"].append({"text": above, "columns": cells(header, starts), "rows": rows})
    return found


def _is_table(lines: Sequence[str], starts: Sequence[int]) -> bool:
    """Whether what is left of each column is a space everywhere, as in no prose."""
    return all(line[at - 1 : at] in (" ", "") for line in lines for at in starts[1:])


def ratios(lines: Sequence[str], header: str) -> dict:
    """Names may go on in the next line, of which the other columns are empty."""
    name = header.index("ratio")
    found, last = {}, ""
    for line in lines:
        words = line[name:].split()
        if line[:name].strip():
            *label, number, floor, _ = words
            last = " ".join(label)
            found[last] = {"value": _number(number), "floor": _number(floor)}
        else:
            entry = found.pop(last)
            last = f"{last} {' '.join(words)}"
            found[last] = entry
    return found


def _number(text: str) -> float | None:
    return None if text == "-" else float(text)


def commit(path: Path) -> str:
    command = ["git", "-C", str(path.parent), "log", "-1", "--format=%h", "--abbrev=12", "--"]
    return subprocess.run([*command, path.name], capture_output=True, text=True).stdout.strip()


def record_of(path: Path) -> dict:
    """As JSON has it, of a text."""
    made = read(path.read_text())
    return {"made": made.pop("made"), "commit": commit(path), **made}


def latest(folder: Path, name: str) -> dict:
    """What a comparison measured last; from text where that was before records came as JSON.

    Raises FileNotFoundError without a record.
    """
    path = folder / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else record_of(path.with_suffix(".txt"))


def main(names: Sequence[str], folder: Path = record.HERE) -> None:
    for name in names:
        made = record_of(folder / f"{name}.txt")
        (folder / f"{name}.json").write_text(record.written(made))


if __name__ == "__main__":
    main(sys.argv[1:])
