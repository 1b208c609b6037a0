"""The static structure of a system: names, and the kinds of its coordinates."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..common.identity_cache import IdentityCache
from ..scene.coordinate import Coordinate
from ..scene.points import NamedPoints

# So small that a counter adds nothing to what it counts. A trillionth of the inertia that turns
# with it is less than what tolerances leave of a motion.
COUNTER_INERTIA = 1e-12


@dataclasses.dataclass(frozen=True)
class Structure:
    """Names and kinds of coordinates and constraints; part of a compiled program's key.

    - `coordinates`: what they are; `constraints`: what messages call them.
    - `rigid`: which coordinates are those of rigid-body motion; all, where it is unknown.
    - `flexible`: whether parts may be much faster than the motion; true, where it is unknown.
    - `loops`: whether joints close loops, so that constraints may lose rank on the way; in a tree
      of joints none depends on the others. True, where it is unknown.
    - `ringing`: whether all flexible parts bend far without damping, so that a motion sets them
      vibrating, and nothing stops them.
    - `connected`: whether joints or effects link all bodies with each other, so that they have one
      balance of energy; true, where it is unknown.
    - `contacts`: whether effects may begin on the way, of which the start shows nothing.
    - `by_parts`: whether states give their slopes part by part, for implicit steps.
    - `frames`: at which coordinate the frame of each body begins: its position, then its angle or
      its quaternion, before its modes; none, where no bodies are known.
    - `quaternions`: at which coordinate the quaternion of each body in space begins.
    - `counters`: coordinates that count the turns of an angle, with `COUNTER_INERTIA` of the
      inertia that this angle feels; or that are the motion of a joint with an inertia of its own.
    - `states`: coordinates whose rates are first-order states of effects, with a unit inertia that
      is none of the mechanism; nothing depends on the coordinates themselves.
    - `slips`: constraints of velocities, A(q) v = 0, which no function of positions has.
    - `amplitudes`: coordinates that are amplitudes, where no frames are known, each with its number
      in the full system.
    - `joints`, `effects`: by which keys results name them, each key once, in the order in which the
      system holds them; none, where there are no such parts.
    """

    coordinates: tuple[Coordinate, ...]
    constraints: tuple[str, ...]
    rigid: tuple[bool, ...]
    flexible: bool
    loops: bool
    contacts: bool = False
    by_parts: bool = False
    frames: tuple[int, ...] = ()
    quaternions: tuple[int, ...] = ()
    counters: tuple[int, ...] = ()
    states: tuple[int, ...] = ()
    slips: tuple[int, ...] = ()
    amplitudes: tuple[tuple[int, int], ...] = ()
    joints: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    ringing: bool = False
    connected: bool = True

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels of the coordinates."""
        return tuple(coordinate.label for coordinate in self.coordinates)

    @classmethod
    def unnamed(cls, n: int, m: int) -> "Structure":
        """Return the structure of `n` coordinates and `m` constraints, nothing else being known."""
        coordinates = tuple(Coordinate("", f"q{i + 1}") for i in range(n))
        constraints = tuple(f"constraint {i + 1}" for i in range(m))
        return cls(coordinates, constraints, (True,) * n, flexible=True, loops=m > 0)

    @functools.cached_property
    def nameless(self) -> "Structure":
        """The same kinds of coordinates, without names."""
        unnamed = Structure.unnamed(len(self.coordinates), len(self.constraints))
        return dataclasses.replace(
            unnamed,
            rigid=self.rigid,
            flexible=self.flexible,
            ringing=self.ringing,
            loops=self.loops,
            contacts=self.contacts,
            connected=self.connected,
            by_parts=self.by_parts,
            frames=self.frames,
            quaternions=self.quaternions,
            counters=self.counters,
            states=self.states,
            slips=self.slips,
            amplitudes=self.amplitudes,
        )

    @functools.cached_property
    def positions(self) -> np.ndarray:
        """The numbers of the coordinates of the position of each body, (bodies, 2 or 3)."""
        return self._from_frames(0, 3 if self.quaternions else 2)

    @functools.cached_property
    def is_position(self) -> np.ndarray:
        """Whether each coordinate is one of the position of a body, (n,)."""
        mask = np.zeros(len(self.coordinates), bool)
        mask[self.positions] = True
        return mask

    @functools.cached_property
    def is_state(self) -> np.ndarray:
        """Whether the rate of each coordinate is a state of an effect, (n,)."""
        mask = np.zeros(len(self.coordinates), bool)
        mask[np.array(self.states, int)] = True
        return mask

    def without_states(self, v: Array) -> Array:
        """Velocities (…, n) with zeros for states; the same array where there are none."""
        return jnp.where(self.is_state, 0, v) if self.states else v

    def at_rest(self, q: Array) -> Array:
        """The velocities of a configuration at rest (n,): those of states, which are in their
        places in `q`, and else zeros.
        """
        return jnp.where(self.is_state, q, 0) if self.states else jnp.zeros_like(q)

    def with_states(self, q: Array, v: Array) -> Array:
        """Configurations (…, n) with the states of the velocities `v` in their places, as those of
        equilibria have them; the same array where there are none.
        """
        return jnp.where(self.is_state, v, q) if self.states else q

    @functools.cached_property
    def turns(self) -> np.ndarray:
        """The coordinates that are each body's angle or quaternion, by number, (bodies, 1 or 4)."""
        return self._from_frames(*((3, 7) if self.quaternions else (2, 3)))

    def _from_frames(self, first: int, end: int) -> np.ndarray:
        return np.array(self.frames, int)[:, None] + np.arange(first, end)

    def __hash__(self) -> int:
        return self._hash

    @functools.cached_property
    def _hash(self) -> int:
        # Every call of a compiled program asks for it.
        kinds = self.rigid, self.flexible, self.ringing, self.loops, self.contacts
        places = self.frames, self.quaternions, self.counters, self.states, self.slips
        known = kinds, self.connected, places
        return hash((self.coordinates, self.constraints, known, self.amplitudes))


_nameless = IdentityCache()


def without_names(system: Any) -> Any:
    """A system without the names of its coordinates and constraints, and without its named points,
    on which no number depends, so that systems that differ in these only share their compiled
    programs.
    """
    return _nameless.get(system) or _nameless.put(system, _anonymous(system))


def _anonymous(system: Any) -> Any:
    children, tree = jax.tree.flatten(system, is_leaf=lambda x: x is not system)
    copy = jax.tree.unflatten(tree, children)
    for field in dataclasses.fields(system):
        value = getattr(system, field.name)
        if isinstance(value, Structure):
            object.__setattr__(copy, field.name, value.nameless)
        elif isinstance(value, tuple) and any(isinstance(each, NamedPoints) for each in value):
            object.__setattr__(copy, field.name, ())
        elif isinstance(value, str):  # a summary
            object.__setattr__(copy, field.name, "")
        elif hasattr(value, "structure"):  # the system that a reduced one is made from
            object.__setattr__(copy, field.name, _anonymous(value))
    return copy
