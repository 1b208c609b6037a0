"""Compiled programs on disk, so that no structure is compiled twice on one machine.

The folder is one of romjax's own, in that of the user's caches or in the one that the environment
variable ROMJAX_CACHE_DIR names; an empty name turns the cache off. Nothing is lost with the folder.

Reading a program runs what the file says. So files count only if they are the user's, in a folder
of the user's, and nobody else can write to either.

A program is kept under the text that the compiler is given, whatever sources it was traced from. A
call has a key of its own, which spares tracing: it leads to that text as long as the sources stay.
After an edit of them, or in another version of romjax, a call is traced once more, and compiles
nothing if it leads to a known text.
"""

import contextlib
import dataclasses
import functools
import hashlib
import io
import math
import os
import pickle
import platform
import re
import stat
import sys
import types
import zlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from platformdirs import user_cache_path

from ..common import compat, writing
from . import sources

# What these packages define changes with their versions only.
_PACKAGES = ("jax", "jaxlib", "diffrax", "equinox", "lineax", "optimistix", "jaxtyping", "numpy")
_VERSIONED = frozenset(_PACKAGES) | sys.stdlib_module_names
# All programs together, in bytes: some hundred structures.
_LARGEST = 2**30
# The files of programs, and those that say which program a call leads to; no others are touched.
# And the libraries that models were compiled to by the user's own compiler, and what commands have
# measured.
_PROGRAM, _CALL, LIBRARY, RESULT = ".program", ".call", ".library", ".result"
_OWN = re.compile(r"[0-9a-f]{64}\.(program|call|library|result)")
# Counts the ways in which programs were written, of which this version reads the last.
_WRITING = b"2"
# Bytes since the folder was last looked through; more than any number at first.
_written = [math.inf]


def folder() -> Path | None:
    """Return the folder in which compiled programs are kept; None if they are not kept."""
    name = os.environ.get("ROMJAX_CACHE_DIR")
    if name is not None:
        # A folder of its own in there, since the user may keep other files beside.
        return Path(name) / "romjax-programs" if name else None
    try:
        caches = user_cache_path("romjax")
    except (RuntimeError, KeyError):  # of a user without a home
        return None
    return caches / "programs" if caches.is_absolute() else None


def key_of_call(function: Any, *rest: Any) -> str | None:
    """A key of a function of romjax and of what else its program depends on.

    None where something of the user's own is among that, whose source may change.
    """
    if not sources.knows(function.__module__) or "<locals>" in function.__qualname__:
        return None
    stream = io.BytesIO()
    describer = _Describer(stream)
    try:
        describer.dump((function.__module__, function.__qualname__, rest))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return None
    origin = sources.digest({function.__module__, *describer.modules})
    return _digest(origin.encode(), stream.getvalue())


def key_of_text(text: str, *options: Any) -> str | None:
    """A key of a program in the compiler's language; None if it calls this process."""
    calls = "callback" in text or "romjax_native" in text
    return None if calls else _digest(text.encode(), repr(options).encode())


def keeps(key: str | None) -> bool:
    """Whether there is a folder for the program of a key."""
    return _file(key) is not None


def load_call(key: str | None) -> Any:
    """The program of a call, by its key; None if it is not known which, or if that is gone."""
    content = (_read(_file(key, _CALL)) or b"").decode(errors="replace")
    return load(content) if re.fullmatch("[0-9a-f]{64}", content) else None


def load(text: str | None) -> Any:
    """The program of a text, by its key; None if there is none, or none that can be read."""
    content = _read(_file(text))
    if content is None:
        return None
    try:
        return compat.load_executable(*pickle.loads(zlib.decompress(content)))
    except Exception:  # a damaged pickle raises whatever its bytes happen to say
        return None


def store_call(key: str | None, text: str) -> None:
    """Keep which text a call leads to, by the keys of both."""
    file = _file(key, _CALL)
    if file is not None and keeps(text):
        _write(file, text.encode())


def store(text: str, compiled: Any) -> None:
    """Keep a program; without a folder that can be written to, nothing is kept."""
    file = _file(text)
    if file is None:
        return
    try:
        stream = io.BytesIO()
        _Writer(stream).dump(compat.dump_executable(compiled))
        content = zlib.compress(stream.getbuffer(), level=1)
    except (pickle.PicklingError, TypeError, AttributeError, ValueError, NotImplementedError):
        return  # results of a class of the user's own, say, that Python finds under no name
    _write(file, content)


def load_content(key: str | None, ending: str) -> bytes | None:
    """The bytes of a `LIBRARY` or a `RESULT`, by its key; None if there are none."""
    return _read(_file(key, ending))


def store_content(key: str | None, content: bytes, ending: str) -> None:
    """Keep the bytes of a `LIBRARY` or a `RESULT`, by its key."""
    file = _file(key, ending)
    if file is not None:
        _write(file, content)


def _read(file: Path | None) -> bytes | None:
    """Return the contents of a file of the user's, and mark it as used; None if there is none."""
    if file is None:
        return None
    try:
        # What is opened is what is asked about, whoever puts another file there meanwhile.
        with open(file, "rb", opener=_without_links) as stream:
            if not _is_safe(os.fstat(stream.fileno()), stat.S_ISREG):
                return None
            content = stream.read()
        with contextlib.suppress(OSError):  # of a folder that one can only read from
            os.utime(file)
    except OSError:
        return None
    return content


def _without_links(path: str, flags: int) -> int:
    # Nor does a pipe of that name make the process wait.
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _is_safe(status: os.stat_result, kind: Callable[[int], bool]) -> bool:
    """Whether a file or folder is the user's, and nobody else can write to it."""
    if not hasattr(os, "geteuid"):  # Windows, where others cannot write to a user's folders
        return kind(status.st_mode)
    others = stat.S_IWGRP | stat.S_IWOTH
    return kind(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & others


def _write(file: Path, content: bytes) -> None:
    """Keep a file, all of it or nothing, and others as far as there is room."""
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        writing.write(file, content, mode=0o600, lasting=False)
        _written[0] += len(content)
        if _written[0] > _LARGEST / 64:  # looking after each would take longer than some programs
            _written[0] = 0
            _forget_oldest(file.parent)
    except OSError:
        return


def _file(key: str | None, ending: str = _PROGRAM) -> Path | None:
    here = folder()
    # What is compiled for one of several devices is bound to it.
    if key is None or here is None or jax.local_device_count() > 1:
        return None
    try:
        safe = _is_safe(here.stat(), stat.S_ISDIR)
    except FileNotFoundError:
        safe = True  # it will be made
    except OSError:
        safe = False
    return here / (key + ending) if safe else None


def _forget_oldest(here: Path) -> None:
    """Delete the programs that were not used for the longest time, if there are too many."""
    writing.forget_parts(here)
    own = [file for file in here.iterdir() if _OWN.fullmatch(file.name) and file.is_file()]
    files = sorted(
        ((file.stat().st_mtime, file.stat().st_size, file) for file in own), reverse=True
    )
    total = 0
    for _, size, file in files:
        total += size
        if total > _LARGEST:
            file.unlink(missing_ok=True)


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256(_machine() + _WRITING)
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


@functools.cache
def _machine() -> bytes:
    """Return a digest of what compiled programs depend on: versions, flags and processor."""
    digest = hashlib.sha256()
    versions = [f"{name} {version(name)}" for name in _PACKAGES]
    flags, device = os.environ.get("XLA_FLAGS", ""), jax.local_devices()[0]
    for part in (platform.python_version(), *versions, flags, device.id, *_processor()):
        digest.update(repr(part).encode())
    return digest.digest()


def _processor() -> list[str]:
    """The processor, with its instruction sets where the system lists them."""
    general = [platform.machine(), platform.processor(), platform.system()]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return general
    names = ("model name", "flags", "CPU part", "Features")
    return general + sorted({line for line in lines if line.startswith(names)})


class _Writer(pickle.Pickler):
    """Writes programs with the structures of their results."""

    def reducer_override(self, obj: Any) -> Any:
        """Say how to write an object that is none of Python's basic types."""
        return compat.name_of_missing(obj) or NotImplemented


class _Describer(pickle.Pickler):
    """Writes objects out by their contents, and functions and classes by their names.

    Refuses those that are not of known packages: their contents may change under the same name.
    """

    def __init__(self, stream: io.BytesIO):
        super().__init__(stream, protocol=5)
        self.fast = True  # which equal objects are one object is no difference
        self.modules = set[str]()  # of known sources, whose classes and functions are written

    def reducer_override(self, obj: Any) -> Any:
        """Say how to write an object that is none of Python's basic types."""
        if isinstance(obj, jax.tree_util.PyTreeDef):
            return tuple, ((obj.node_data(), tuple(obj.children())),)
        named = isinstance(obj, type | types.FunctionType | types.BuiltinFunctionType)
        module = (obj if named else type(obj)).__module__ or ""
        if sources.knows(module):
            self.modules.add(module)
        elif module.partition(".")[0] not in _VERSIONED:
            raise pickle.PicklingError(f"{obj!r} is of {module}")
        if dataclasses.is_dataclass(obj) and not named:
            # The fields only: what properties remember comes and goes.
            values = tuple(getattr(obj, field.name) for field in dataclasses.fields(obj))
            return tuple, ((type(obj), values),)
        return NotImplemented
