"""Reading of the tables of a file."""

import re
import tomllib
from typing import Any

from .problems import Problems

# [bytes] A file that takes a second to read; larger arrays belong in a file of arrays beside it.
LARGEST = 4 * 2**20
# Tables and lists within each other.
_DEEPEST = 24


def read_tables(problems: Problems) -> dict[str, Any]:
    """The tables of a file; what keeps it from being read is a mistake, and raised at once."""
    data = _bytes(problems)
    problems.raise_any()
    try:
        problems.text = data.decode("utf-8-sig")
        tables = tomllib.loads(problems.text)
        if _depth(tables) > _DEEPEST:
            problems.add((), f"Tables or lists are nested more than {_DEEPEST} deep.")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        problems.add(
            (), f"Line {line} is not in UTF-8 (byte {error.start}); save the file as UTF-8."
        )
    except RecursionError:
        problems.add((), f"Tables or lists are nested more than {_DEEPEST} deep.")
    except ValueError as error:  # also of integers that Python refuses for their length
        problems.add((), _syntax(str(error)))
    problems.raise_any()
    return tables


def _bytes(problems: Problems) -> bytes:
    path = problems.path
    try:
        if path.is_dir():
            problems.add((), "This is a folder; give a scene file, such as scene.toml in it.")
        elif not path.exists():
            problems.add((), "There is no such file; `romjax new FILE` writes one to begin with.")
        elif not path.is_file():
            problems.add((), "This is no regular file; give a scene file.")
        elif path.stat().st_size > LARGEST:
            problems.add(
                (),
                f"The file has {path.stat().st_size / 2**20:.0f} MiB, but a scene file has at most "
                f'{LARGEST // 2**20}; keep large arrays in a file of NumPy, {{ file = "….npz", '
                'array = "…" }.',
            )
        else:
            return path.read_bytes()
    except OSError as error:
        problems.add((), f"The file cannot be read: {error.strerror}.")
    except ValueError as error:  # a name with a null character
        problems.add((), f"The file cannot be read: {error}.")
    return b""


def _syntax(words: str) -> str:
    """Return the message of the reader of TOML, with a remedy for the most common mistakes."""
    at = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", words)
    cause = words[: at.start()] if at else words
    place = f"line {at[1]}, column {at[2]}: " if at and at[1] else "end of file: "
    remedies = {
        "Cannot declare": "Every table has its own name; rename or join the two.",
        "Cannot overwrite": "Every key stands once in its table; delete one.",
        "Invalid value": "Texts need quotes, numbers a digit before and after the point.",
        "Unclosed": "Close the bracket.",
        "Expected '='": "A key is followed by = and its value; names with other characters than "
        "letters, digits, - and _ need quotes.",
    }
    remedy = next((says for start, says in remedies.items() if cause.startswith(start)), "")
    return f"This is no TOML, {place}{cause}. {remedy}".rstrip()


def _depth(value: Any) -> int:
    """Return how deep tables and lists are nested."""
    deepest, level = 0, [value]
    while level:
        below: list[Any] = []
        for one in level:
            if isinstance(one, dict):
                below += one.values()
            elif isinstance(one, list):
                below += (item for item in one if isinstance(item, dict | list))
        deepest, level = deepest + 1, [x for x in below if isinstance(x, dict | list)]
    return deepest
