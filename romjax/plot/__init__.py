"""Figures of motions, bases and mechanisms; the only importer of matplotlib."""

from .accuracy import accuracy as accuracy
from .animation import animate as animate
from .errors import errors as errors
from .modes import modes as modes
from .response import response as response
from .tuning import tuning as tuning
from .values import values as values
