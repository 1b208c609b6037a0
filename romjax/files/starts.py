"""How the start of a scene differs from the one at which all joints hold, in words."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..assembly.assemble import assemble
from ..common import precision
from ..common.compat import is_traced
from ..compiling.program import program_once
from ..scene.scene import Scene
from ..system.base import AbstractSystem
from ..system.start import Start, length_of

# A body that moves by more, as a share of the mechanism's length, or turns by more [degrees], may
# be where nobody meant it to be.
_FAR, _TURNED = 0.1, 10.0
# Motions of less are not told, as shares of the same.
_NONE = 1e-8
# Files of robots do not say that bodies may move, so that larger motions are told.
_MUCH = 0.01
# So many bodies are told of, those that move most.
_MOST = 6


def start_rows(placed: Scene, closed: Scene, closes: bool) -> list[list[str]]:
    """The rows about the start of a scene as it is `placed` and as it is `closed`; `closes` says
    whether it will be.

    A body that moves by more than a tenth of the mechanism's length (the rule of
    `romjax/system/start.py`), or turns by more than 10 degrees, is warned of.
    """
    holds, length = (np.asarray(x) for x in _look(assemble(placed)))
    if holds:
        return [["start", "all joints hold"]]
    words = "all joints hold, once bodies have moved" if closes else "joints do not hold yet"
    rows = [["start", words if closes else f"{words}; add consistent = true at the top"]]
    every, moved = _moves(placed, closed, float(length), _NONE)
    rows += [["moved" if closes else "to move", move.words()] for move in moved[:_MOST]]
    if len(moved) > _MOST:
        rows.append(["", f"and {len(moved) - _MOST} bodies less than these"])
    if following := [m.name for m in every if m.follows]:
        rows.append(["speeds", f"of {', '.join(following)} follow"])
    if far := [m.name for m in moved if m.share > 1]:
        rows.append(["warning", f"{', '.join(far)}: further than {_FAR:.0%} of {length:.3g} m, or"])
        rows.append(["", f"{_TURNED:g} degrees; see that this is the start that you mean"])
    return rows


def moves(placed: Scene, closed: Scene, length: float) -> str:
    """Say what moves where a scene that is `placed` is `closed`, and by how much; "" for
    less than a thousandth of a `length` [m] and a tenth of a degree, and while JAX traces.
    """
    if any(is_traced(x) for body in closed.bodies for x in body.start()):
        return ""
    _, moved = _moves(placed, closed, length, _MUCH)
    told = [move.words() for move in moved[:_MOST]]
    more = len(moved) - len(told)
    return "; ".join(told) + (f"; and {more} bodies less than these" if more else "")


def _moves(
    placed: Scene, closed: Scene, length: float, least: float
) -> tuple[list["_Move"], list["_Move"]]:
    """The changes of all bodies, and those of more than a share, the largest first."""
    pairs = zip(placed.bodies, closed.bodies, strict=True)
    every = [_Move.of(*pair, length) for pair in pairs]
    return every, sorted((m for m in every if m.share > least), key=lambda m: -m.share)


class _Move(NamedTuple):
    """A change that closing a scene makes to one body; `share`: of one that counts as far."""

    name: str
    distance: float  # [m]
    turn: float  # [degrees]
    bends: float
    unit: str  # of that
    share: float
    follows: bool

    @classmethod
    def of(cls, before: Any, after: Any, length: float) -> "_Move":
        starts: Any = [[np.asarray(x) for x in body.start()] for body in (before, after)]
        (q, v), (p, w) = starts
        d, frame = before.dimension, before.frame_size
        distance = float(np.linalg.norm(p[:d] - q[:d]))
        if d == 2:
            turn = abs(float(p[2] - q[2]))
        else:
            # A quaternion and its opposite are one turn.
            one, other = (x[3:7] / np.linalg.norm(x[3:7]) for x in (q, p))
            apart = min(float(np.linalg.norm(one - sign * other)) for sign in (1, -1))
            # Unit quaternions that a turn φ takes from one to the other are 2 sin ¼φ apart.
            turn = 4 * float(np.arcsin(min(1.0, apart / 2)))
        turn = float(np.degrees(turn))
        share = max(distance / (_FAR * length), turn / _TURNED)
        bends = float(np.max(np.abs(p[frame:] - q[frame:]), initial=0.0))
        follows = bool(np.any((v == 0) & (w != 0)))
        return cls(before.name, distance, turn, bends, before.mode_unit, share, follows)

    def words(self) -> str:
        bent = f", modes by {self.bends:.2g} {self.unit}" if self.bends else ""
        return f"{self.name}: {self.distance:.3g} m, {self.turn:.3g} degrees{bent}"


@program_once
def _look(system: AbstractSystem) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Whether the joints hold at the start, and the mechanism's length [m]."""
    time = jnp.zeros((), system.q0.dtype)
    tolerance = precision.of(system.q0.dtype).start_tolerance
    start = Start.of(system, time, system.q0, system.v0, tolerance)
    return start.closed & start.fits, length_of(system, time, system.q0)
