"""What `romjax run` has measured, on disk: the same question is answered without measuring again.

The files lie among the compiled programs, under the same rules.
"""

import datetime
import pickle
import zlib
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, NamedTuple

from .compiling import program_cache
from .study.reduction import ReductionStudy
from .trials.reductions import INTERRUPTED
from .trials.result import Reductions


class Measured(NamedTuple):
    """The result of the trials; the chapter's study with the pictures of its bases, by name, where
    it is asked for; and the day, as text.
    """

    result: Reductions
    of_chapter: tuple[ReductionStudy, dict[str, bytes]] | None
    day: str


def key_of(verb: Callable[..., Any], *asked: Any) -> str | None:
    """A key of what is asked of a verb of the command line, and of all that its answer depends on:
    numbers and structure of the scene, sources, versions, processor.

    None where a part of the user's own is among that, whose source may change.
    """
    return program_cache.key_of_call(verb, version("matplotlib"), *asked)


def load(key: str | None) -> Measured | None:
    """What was measured under a key; None if nothing was, or nothing that can be read."""
    content = program_cache.load_content(key, program_cache.RESULT)
    if content is None:
        return None
    try:
        measured = pickle.loads(zlib.decompress(content))
    except Exception:  # a damaged pickle raises whatever its bytes happen to say
        return None
    return measured if isinstance(measured, Measured) else None


def store(
    key: str | None,
    result: Reductions,
    of_chapter: tuple[ReductionStudy, dict[str, bytes]] | None,
) -> None:
    """Keep what was measured today, unless Ctrl-C has ended that."""
    if key is None or INTERRUPTED in result.skipped.values():
        return
    measured = Measured(result, of_chapter, str(datetime.date.today()))
    try:
        content = zlib.compress(pickle.dumps(measured), level=1)
    except Exception:  # what was measured goes on to the page, whatever keeps it from the disk
        return
    program_cache.store_content(key, content, program_cache.RESULT)
