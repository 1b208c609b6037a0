"""Sources of C as libraries of this process, compiled by the user's own compiler."""

import ctypes
import functools
import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

from ..common.errors import InputError
from ..compiling import program_cache

# Contraction of products and sums into one operation, which is off, would change last digits.
FLAGS = ("-O2", "-std=c99", "-fPIC", "-ffp-contract=off")


@functools.cache
def compiler() -> tuple[str, ...]:
    """The command of the C compiler: that of the variable CC, or the first one that is there.

    Raises InputError, with the remedy, where there is none.
    """
    asked = shlex.split(os.environ.get("CC", ""))
    for command in (asked, ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return tuple(command)
    raise InputError(
        "compile: there is no C compiler here; install one (Debian: apt install gcc; macOS: "
        "xcode-select --install), or name yours by the environment variable CC. Everything else of "
        "romjax works without one."
    )


def load(source: str, flags: tuple[str, ...] = FLAGS) -> ctypes.CDLL:
    """The library of a source; raises InputError as `compiled`."""
    return _opened(compiled(source, flags))


def compiled(source: str, flags: tuple[str, ...] = FLAGS) -> bytes:
    """The bytes of a library, compiled where it is not kept among the programs of the user.

    Raises InputError where there is no compiler, or with the words of one that fails.
    """
    command = compiler()
    key = program_cache.key_of_text(source, command, _version(command), flags)
    content = program_cache.load_content(key, program_cache.LIBRARY)
    if content is None:
        content = _compiled(source, (*command, *flags))
        program_cache.store_content(key, content, program_cache.LIBRARY)
    return content


@functools.cache
def _version(command: tuple[str, ...]) -> str:
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return done.stdout


def _compiled(source: str, command: tuple[str, ...]) -> bytes:
    """The bytes of a shared library."""
    with tempfile.TemporaryDirectory(prefix="romjax-") as folder:
        file, library = Path(folder, "model.c"), Path(folder, "model.so")
        file.write_text(source)
        arguments = [*command, "-shared", "-o", str(library), str(file), "-lm"]
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line][:3]
            raise InputError(
                f"compile: {shlex.join(command)} has failed: {' '.join(lines) or done.stderr[:300]}"
            )
        return library.read_bytes()


def _opened(content: bytes) -> ctypes.CDLL:
    """The library that some bytes are; from a folder of its own, which nobody else writes to."""
    with tempfile.TemporaryDirectory(prefix="romjax-", ignore_cleanup_errors=True) as folder:
        file = Path(folder, "model.so")
        file.write_bytes(content)
        return ctypes.CDLL(str(file))
