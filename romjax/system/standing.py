"""Constraints that move with time, as they are while they stand still."""

import abc
from typing import TypeVar

import equinox as eqx

from ..common.arrays import Time

P = TypeVar("P", bound="AbstractConstrained")


class AbstractConstrained(eqx.Module):
    """A part of a system that has constraints, or a system whose constraints are one function."""

    @abc.abstractmethod
    def standing_at(self: P, t: Time) -> P:
        """The same whose constraints stand where they are at a time t [s]."""
