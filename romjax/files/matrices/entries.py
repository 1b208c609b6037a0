"""The entries of a matrix in a file, by nodes and components, and what is wrong with a file."""

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...common.errors import InputError

# More than the largest number of a component: a degree of freedom as one number.
_CODES = 8
# What a component is; the numbers are the same in Abaqus, CalculiX and Nastran.
COMPONENTS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")


class Entries(NamedTuple):
    """Entries of a symmetric matrix, of one triangle or of both.

    - `rows`, `columns`: their degrees of freedom, (k, 2) of a node and a component from 1 to 6, or
      zero of a modal coordinate, where there are `modal` ones.
    - `values` (k,); `lines` (k,): where in the file `path` they are, zero where it has no lines.
    """

    path: Path
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    lines: np.ndarray
    modal: bool = False

    def codes(self) -> tuple[np.ndarray, np.ndarray]:
        """The degrees of freedom as one number each; raises InputError for those that are none."""
        for degrees in (self.rows, self.columns):
            least = 0 if self.modal else 1
            internal, other = degrees[:, 0] < 1, (degrees[:, 1] < least) | (degrees[:, 1] > 6)
            if np.any(internal):
                raise self.wrong(
                    internal,
                    f"node {degrees[np.argmax(internal), 0]} is internal, such as one of a "
                    "Lagrange multiplier; take contacts, connectors and couplings out of the model",
                )
            if np.any(other):
                raise self.wrong(
                    other,
                    f"degree of freedom {degrees[np.argmax(other), 1]} of node "
                    f"{degrees[np.argmax(other), 0]} is no displacement or rotation, 1 to 6; take "
                    "scalar points, pressures and temperatures out of the model",
                )
        return code(self.rows), code(self.columns)

    def matrix(self, known: np.ndarray) -> sp.csc_array:
        """The whole matrix over the degrees of freedom `known`, sorted codes.

        Raises InputError for an entry that is there twice.
        """
        r, c = (np.searchsorted(known, codes) for codes in self.codes())
        size = len(known)
        pairs = r * size + c
        order = np.argsort(pairs, kind="stable")
        again = np.zeros(len(pairs), bool)
        again[order[1:]] = pairs[order[1:]] == pairs[order[:-1]]
        if np.any(again):
            raise self.wrong(again, "the entry is there for the second time; write the file again")
        # Files hold the lower, the upper or both triangles.
        single = (r != c) & ~np.isin(c * size + r, pairs)
        down, along = np.append(r, c[single]), np.append(c, r[single])
        return sp.csc_array(
            (np.append(self.values, self.values[single]), (down, along)), (size,) * 2
        )

    def wrong(self, where: np.ndarray, words: str) -> InputError:
        """Return an error about the first of the entries that a mask selects."""
        return wrong(self.path, int(self.lines[np.argmax(where)]), words)


def code(degrees: np.ndarray) -> np.ndarray:
    """Degrees of freedom (k, 2) as one number each, sorted by node, then component."""
    codes: np.ndarray = degrees[:, 0].astype(np.int64) * _CODES + degrees[:, 1].astype(np.int64)
    return codes


def decode(codes: np.ndarray) -> np.ndarray:
    """The node and the component of each code, (k, 2)."""
    return np.stack([codes // _CODES, codes % _CODES], axis=1)


def wrong(path: Path, line: int, words: str) -> InputError:
    """The error about a file: where, the cause, and after a semicolon the cure."""
    return InputError(f"load_mesh: {path}{f', line {line}' if line else ''}: {words}.")


def existing(path: Path, cure: str) -> Path:
    """The path of a file; raises InputError if there is none."""
    if not path.is_file():
        raise wrong(path, 0, f"there is no such file; {cure}")
    return path


def text_of(path: Path) -> str:
    """The text of a file; raises InputError for a binary one."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise wrong(path, 0, "is no text; write the matrix in a text format") from error


def table(path: Path, columns: int, delimiter: str | None, comment: str) -> np.ndarray:
    """All rows of numbers in a file, (k, columns); raises InputError with the line of a bad one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files without rows
        try:
            numbers = np.loadtxt(path, delimiter=delimiter, comments=comment, ndmin=2)
        except ValueError:
            numbers = np.empty((0, 0))
    if numbers.shape[1] == columns and np.all(np.isfinite(numbers)):
        return numbers
    for line, row in data_lines(path, comment):
        fields = row.split(delimiter)
        try:
            good = len(fields) == columns and all(np.isfinite(float(x)) for x in fields)
        except ValueError:
            good = False
        if not good:
            raise wrong(
                path, line, f"{row.strip()!r} is not a row of {columns} numbers; write it again"
            )
    raise wrong(path, 0, "has no entries; give a matrix that is not empty")


def data_lines(path: Path, comment: str) -> list[tuple[int, str]]:
    """The lines that hold data, with their numbers."""
    lines = enumerate(text_of(path).splitlines(), 1)
    return [
        (i, line) for i, line in lines if line.strip() and not line.lstrip().startswith(comment)
    ]


def whole(path: Path, numbers: np.ndarray, comment: str) -> np.ndarray:
    """Columns of numbers of nodes and rows as integers; raises InputError for a fraction."""
    rounded = np.rint(numbers)
    fraction = np.any(rounded != numbers, axis=1)
    if np.any(fraction):
        line, row = data_lines(path, comment)[int(np.argmax(fraction))]
        raise wrong(path, line, f"{row.strip()!r} numbers nodes by fractions; write it again")
    integers: np.ndarray = rounded.astype(np.int64)
    return integers
