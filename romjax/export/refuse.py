"""The error about a system that cannot be exported."""

from typing import NoReturn

from ..common.errors import InputError


def refuse(what: str, remedy: str) -> NoReturn:
    """Raise InputError for what C cannot be made of, with what helps."""
    raise InputError(f"export: {what}; {remedy}.")
