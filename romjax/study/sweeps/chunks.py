"""The chunks of a sweep that are done, in memory and in a folder."""

import hashlib
import io
import json
import math
import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ...common import writing
from .claims import Claims

# [s] Between two looks at the chunks of other processes.
_SHORTEST, _LONGEST = 0.01, 0.5


class Chunks:
    """The chunks that are done: in memory, and in a folder with one file for each.

    - `identity`: what tells the sweep from others, a part of the checksum of each file.
    """

    def __init__(self, folder: Path | None, identity: str = ""):
        self.folder, self.identity = folder, identity
        self.claims = None if folder is None else Claims(folder)
        self.done: dict[int, list[np.ndarray]] = {}
        # [s] That the last chunk has taken here.
        self.latest = 0.0

    @classmethod
    def open(
        cls, path: Any, parameters: Any, lanes: int, chunk: int, form: Callable[[], Any]
    ) -> tuple["Chunks", Any]:
        """The chunks of a sweep, and the structure of its results, None without a folder.

        `form`: the shapes of the results of some lanes, asked for where all else fits.
        """
        if path is None:
            return cls(None), None
        folder = Path(path)
        folder.mkdir(parents=True, exist_ok=True)
        wanted = {
            "lanes": lanes,
            "chunk": chunk,
            "parameters": _digest(str(jax.tree.structure(parameters)), jax.tree.leaves(parameters)),
        }
        file = folder / "sweep.json"
        if file.exists():
            _refuse_others(folder, wanted, _identity(file))
        shapes, tree = jax.tree.flatten(form())
        results = [str(tree), *(f"{x.dtype}{list(x.shape[1:])}" for x in shapes)]
        identity = wanted | {"results": results}
        # What other processes have begun meanwhile is there now.
        if file.exists():
            _refuse_others(folder, identity, _identity(file))
        else:
            writing.write(file, json.dumps(identity, indent=1))
        writing.forget_parts(folder)
        return cls(folder, json.dumps(identity)), tree

    @staticmethod
    def are_there(path: Any, count: int) -> bool:
        """Whether a folder has files of so many chunks."""
        return all((Path(path) / _name(number)).exists() for number in range(count))

    def _file(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / _name(number)

    def has(self, number: int) -> bool:
        if number not in self.done and self.folder is not None:
            leaves = self._read(number)
            if leaves is not None:
                self.done[number] = leaves
        return number in self.done

    def put(self, number: int, leaves: list[np.ndarray]) -> None:
        self.done[number] = leaves
        if self.folder is not None:
            content = io.BytesIO()
            np.savez(content, *leaves, checksum=self._checksum(number, leaves))
            writing.write(self._file(number), content.getbuffer())

    def complete(
        self, count: int, compute: Callable[[int], list[np.ndarray]], tell: Callable[[int], Any]
    ) -> list[np.ndarray]:
        """The arrays of all chunks, one after the other.

        This process computes those that no other one has claimed, and waits for the others. Once it
        has waited for as long as one takes here, their processes may have been stopped, and it
        computes theirs: better twice than idle. Before it has computed one it cannot know how long
        that is, and takes those that nobody renews.
        `tell` is called with the number of each chunk that is there.
        """
        missing, pause, waited, idle = list(range(count)), _SHORTEST, 0.0, False
        while missing:
            waiting = []
            for number in missing:
                if self._made(number, compute, idle):
                    tell(number)
                else:
                    waiting.append(number)
            idle, patience = len(waiting) == len(missing), self.latest or math.inf
            if idle and waited >= patience:
                # Others who are idle take another one, most likely.
                number = secrets.choice(waiting)
                self._compute(number, compute)
                tell(number)
                waiting.remove(number)
            elif not idle:
                pause = _SHORTEST
            missing = waiting
            if missing:
                began = time.monotonic()
                time.sleep(min(pause, max(patience - waited, _SHORTEST)))
                waited += time.monotonic() - began
                pause = min(2 * pause, _LONGEST)
        if self.claims is not None:
            self.claims.clear()
        parts = [self.done[number] for number in range(count)]
        return [np.concatenate(x) for x in zip(*parts, strict=True)]

    def _made(self, number: int, compute: Callable[[int], list[np.ndarray]], idle: bool) -> bool:
        """Whether a chunk is there, computed here if nobody else works on it."""
        if self.has(number):
            return True
        held = nullcontext(True) if self.claims is None else self.claims.held(number, idle)
        with held as own:
            # Another process may have put it there just before it gave up its claim.
            if own and not self.has(number):
                self._compute(number, compute)
        return own

    def _compute(self, number: int, compute: Callable[[int], list[np.ndarray]]) -> None:
        began = time.monotonic()
        self.put(number, compute(number))
        self.latest = time.monotonic() - began

    def _checksum(self, number: int, leaves: Sequence[np.ndarray]) -> str:
        return _digest(f"{self.identity} {number}", leaves)

    def _read(self, number: int) -> list[np.ndarray] | None:
        """The arrays of a file; None unless they are those of this chunk."""
        try:
            # Opened here, since NumPy leaves open what is no archive.
            with self._file(number).open("rb") as stream, np.load(stream) as stored:
                leaves = [stored[f"arr_{i}"] for i in range(len(stored.files) - 1)]
                is_own = str(stored["checksum"]) == self._checksum(number, leaves)
        except Exception:  # there is none, or a damaged one, which raises whatever its bytes say
            return None
        return leaves if is_own else None


def _name(number: int) -> str:
    return f"chunk-{number:06d}.npz"


def _refuse_others(folder: Path, wanted: dict[str, Any], stored: dict[str, Any]) -> None:
    """Raise ValueError where a folder holds another sweep than the wanted one."""
    other = [key for key, value in wanted.items() if stored.get(key) != value]
    if other:
        raise ValueError(
            f"sweep: {folder} holds another sweep, which differs in its {other[0]}; "
            "choose another folder, or remove this one."
        )


def _identity(file: Path) -> dict[str, Any]:
    """Read what identifies the sweep in a folder; raise ValueError where nothing does."""
    try:
        stored = json.loads(file.read_bytes())
    except ValueError:
        stored = None
    if not isinstance(stored, dict):
        raise ValueError(
            f"sweep: {file} does not say which sweep is in its folder; remove the file, and "
            "chunks that are whole and of this sweep are used, or choose another folder."
        )
    return stored


def _digest(words: str, arrays: Sequence[np.ndarray]) -> str:
    digest = hashlib.sha256(words.encode())
    for x in arrays:
        digest.update(f"{x.dtype}{x.shape}".encode() + np.ascontiguousarray(x).tobytes())
    return digest.hexdigest()
