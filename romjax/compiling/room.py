"""Room for compiled programs in a process.

Each function of a program is a piece of mapped memory, hundreds for a mechanism. Linux allows a
process vm.max_map_count of them, 65530 unless set otherwise, and where it gets no more, LLVM
cannot compile: a process that simulates dozens of different mechanisms would end there.
"""

import dataclasses
import gc
import weakref
from pathlib import Path
from typing import Protocol, runtime_checkable

_PIECES, _ALLOWED = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
# The share of what is allowed from which on programs are forgotten: the largest program takes a
# tenth, and other libraries map memory too.
_SHARE, _LARGEST = 0.6, 0.1
# Programs after which the pieces are counted again at the latest, since JAX compiles others.
_MOST = 4


@runtime_checkable
class Forgets(Protocol):
    """A cache of compiled programs that can be cleared."""

    def forget(self) -> None:
        """Forget them."""


@dataclasses.dataclass
class Count:
    """The next count of the pieces.

    The system writes out all of them then, which for some ten thousand takes longer than a small
    program.

    - `fitting`: programs that fit before, though each were the largest, with a fifth left for other
      libraries.
    """

    fitting: int = 0


_next = Count()
_remembering = weakref.WeakSet[Forgets]()


def add(programs: Forgets) -> None:
    """Let these programs be forgotten where there is no room for others."""
    _remembering.add(programs)


def make_room() -> None:
    """Forget all programs if the memory that they are mapped to is nearly all that is allowed."""
    if _next.fitting > 0:
        _next.fitting -= 1
        return
    share = fills()
    if share > _SHARE:
        forget_all()
        share = fills()
    # A fifth is left to other libraries.
    _next.fitting = min(int((0.8 - share) / _LARGEST), _MOST) - 1


def fills() -> float:
    """The share of the pieces of mapped memory that are in use; zero where none is known."""
    try:
        with _PIECES.open("rb") as pieces:
            return sum(1 for _ in pieces) / int(_ALLOWED.read_text())
    except (OSError, ValueError):  # another system
        return 0.0


def forget_all() -> None:
    """Forget all compiled programs of romjax; they are compiled again, or read from disk, when they
    are called.
    """
    for programs in list(_remembering):
        programs.forget()
    gc.collect()
