"""Files on disk: all of one or nothing, whenever the process ends or the disk is full; and several
that belong together.
"""

import contextlib
import contextvars
import errno
import os
import secrets
import stat
import time
from collections.abc import Iterator
from pathlib import Path

# What a file is called until it is complete: hidden, and with its own suffix at the end, by which
# some writers choose the format.
_PREFIX, _PART = ".romjax-", ".part"
# Seconds after which nobody writes to such a file any more.
_FORGOTTEN = 86_400.0
# Complete files that wait for others, with where they go.
_waiting: contextvars.ContextVar[list[tuple[Path, Path]] | None] = contextvars.ContextVar(
    "waiting", default=None
)


def write(
    path: str | os.PathLike[str],
    content: str | bytes | memoryview,
    *,
    mode: int = 0o666,
    lasting: bool = True,
) -> None:
    """Write a file, texts as UTF-8; the other arguments and errors are those of `replacing`."""
    with replacing(path, mode=mode, lasting=lasting) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def together() -> Iterator[None]:
    """All files that are written in here take their places one right after the other, once the last
    is complete; none does if anything fails until then.

    A process that is killed leaves all old ones or all new ones, unless it is between two moves,
    which take a fraction of a millisecond.
    """
    files: list[tuple[Path, Path]] = []
    token = _waiting.set(files)
    try:
        yield
        for part, target in files:
            part.replace(target)
    finally:
        _waiting.reset(token)
        for part, _ in files:
            _forget(part)


@contextlib.contextmanager
def replacing(
    path: str | os.PathLike[str], *, mode: int = 0o666, lasting: bool = True
) -> Iterator[Path]:
    """A file to write to, which takes the place of the one at `path` once it is complete.

    If anything fails until then, it goes, and what was at `path` stays; within `together` it waits
    for the others. Of a link, the file that it leads to is replaced. A device or a pipe is written
    to as it is.

    **Arguments:**

    - `mode`: the permissions of a new file, less those that the user's mask takes; a file that is
      replaced hands on its own.
    - `lasting`: whether it is to survive a loss of power right after, which takes milliseconds.

    Raises OSError, which names the file, where it cannot be written.
    """
    given, target = Path(path), Path(os.path.realpath(path))
    if given.exists() and not given.is_file():
        yield given
        return
    part = target.with_name(f"{_PREFIX}{secrets.token_hex(8)}{_PART}{target.suffix}")
    try:
        _begin(part, target, mode)
        yield part
        if lasting:
            with part.open("rb+") as stream:
                os.fsync(stream.fileno())
        if (waiting := _waiting.get()) is None:
            part.replace(target)
        else:
            waiting.append((part, target))
    except OSError as error:
        if error.errno is None:  # of a library, in words of its own
            raise
        words = f"{error.strerror}; nothing was written, and a file that was there is as it was"
        raise OSError(error.errno, words, os.fspath(path)) from error
    finally:
        if not any(part == other for other, _ in _waiting.get() or []):
            _forget(part)


def _forget(part: Path) -> None:
    with contextlib.suppress(OSError):
        part.unlink(missing_ok=True)


def forget_parts(folder: Path) -> None:
    """Delete what processes that were killed long ago have left of their files in a folder."""
    for part in folder.glob(f"{_PREFIX}*{_PART}*"):
        with contextlib.suppress(OSError):
            if part.stat().st_mtime < time.time() - _FORGOTTEN:
                part.unlink()


def _begin(part: Path, target: Path, mode: int) -> None:
    """An empty file with the permissions of the one that it will replace."""
    os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
    if not target.exists():
        return
    if not os.access(target, os.W_OK):  # moving another file there would pass over it
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    before = target.stat()
    with contextlib.suppress(OSError):  # only some may give files away
        if hasattr(os, "chown"):
            os.chown(part, before.st_uid, before.st_gid)
    part.chmod(stat.S_IMODE(before.st_mode))
