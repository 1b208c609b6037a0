"""Compiled programs on disk, so that no structure is compiled twice on one machine.

The folder is that of the user's caches, or the one that the environment variable ROMJAX_CACHE_DIR
names; an empty name turns the cache off. Nothing is lost with the folder.
"""

import dataclasses
import functools
import hashlib
import io
import os
import pickle
import platform
import sys
import tempfile
import types
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from platformdirs import user_cache_path

from . import compat

# What these packages define changes with their versions only.
_PACKAGES = ("jax", "jaxlib", "diffrax", "equinox", "lineax", "optimistix", "jaxtyping", "numpy")
_VERSIONED = frozenset({"romjax", *_PACKAGES}) | sys.stdlib_module_names
# All programs together, in bytes: some hundred structures.
_LARGEST = 2**30


def folder() -> Path | None:
    """Where compiled programs are kept; None if nowhere."""
    name = os.environ.get("ROMJAX_CACHE_DIR")
    if name is None:
        return user_cache_path("romjax") / "programs"
    return Path(name) if name else None


def key_of_call(function: Any, *rest: Any) -> str | None:
    """A key of a function of romjax and of what else its program depends on.

    None where something of the user's own is among that, whose source may change.
    """
    if function.__module__.partition(".")[0] != "romjax" or "<locals>" in function.__qualname__:
        return None
    stream = io.BytesIO()
    try:
        _Describer(stream).dump((function.__module__, function.__qualname__, rest))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return None
    return _digest(stream.getvalue())


def key_of_text(text: str, *options: Any) -> str | None:
    """A key of a program in the compiler's language; None if it calls back into this process."""
    return None if "callback" in text else _digest(text.encode(), repr(options).encode())


def keeps(key: str | None) -> bool:
    """Whether there is a folder for the program of a key."""
    return _file(key) is not None


def load(key: str | None) -> Any:
    """The program of a key; None if there is none, or none that can be read."""
    file = _file(key)
    if file is None or not file.is_file():
        return None
    try:
        program = pickle.loads(zlib.decompress(file.read_bytes()))
        os.utime(file)
        return compat.load_executable(*program)
    except (OSError, zlib.error, jax.errors.JaxRuntimeError):
        return None


def store(key: str | None, compiled: Any) -> None:
    """Keep a program; without a folder that can be written to, nothing is kept."""
    file = _file(key)
    if file is None:
        return
    try:
        content = zlib.compress(pickle.dumps(compat.dump_executable(compiled)), level=1)
    except (pickle.PicklingError, TypeError, AttributeError, ValueError, NotImplementedError):
        return  # results of a class of the user's own, say, that Python finds under no name
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as temporary:
            temporary.write(content)
        os.replace(temporary.name, file)
        _forget_oldest(file.parent)
    except OSError:
        return


def _file(key: str | None) -> Path | None:
    here = folder()
    # What is compiled for one of several devices is bound to it.
    return None if key is None or here is None or jax.local_device_count() > 1 else here / key


def _forget_oldest(here: Path) -> None:
    """Delete the programs that were not used for the longest time, if there are too many."""
    files = sorted(((f.stat().st_mtime, f.stat().st_size, f) for f in here.iterdir()), reverse=True)
    total = 0
    for _, size, file in files:
        total += size
        if total > _LARGEST:
            file.unlink(missing_ok=True)


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256(_machine())
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


@functools.cache
def _machine() -> bytes:
    """What decides on a compiled program beside itself: sources, versions, flags, processor."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
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


class _Describer(pickle.Pickler):
    """Writes objects out by their contents, and functions and classes by their names.

    Refuses those that are not of known packages: their contents may change under the same name.
    """

    def __init__(self, stream: io.BytesIO):
        super().__init__(stream, protocol=5)
        self.fast = True  # which equal objects are one object is no difference

    def reducer_override(self, obj: Any) -> Any:
        """How to write an object out that is none of Python's basic types."""
        if isinstance(obj, jax.tree_util.PyTreeDef):
            return tuple, ((obj.node_data(), tuple(obj.children())),)
        named = isinstance(obj, type | types.FunctionType | types.BuiltinFunctionType)
        module = (obj if named else type(obj)).__module__ or ""
        if module.partition(".")[0] not in _VERSIONED:
            raise pickle.PicklingError(f"{obj!r} is of {module}")
        if dataclasses.is_dataclass(obj) and not named:
            # The fields only: what properties remember comes and goes.
            values = tuple(getattr(obj, field.name) for field in dataclasses.fields(obj))
            return tuple, ((type(obj), values),)
        return NotImplemented
