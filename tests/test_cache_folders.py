"""The folder of compiled programs: whose files are touched and read, and what goes without it."""

import errno
import os
import pickle
import zlib
from pathlib import Path

import pytest

from romjax.common import compat
from romjax.compiling import program_cache

pytestmark = pytest.mark.instant

KEY = "0123456789abcdef" * 4
POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners are those of POSIX")
ROOT = pytest.mark.skipif(getattr(os, "geteuid", int)() != 0, reason="gives files away")


@pytest.fixture
def given(tmp_path, monkeypatch):
    """A folder that the user names, with files that may look like anything."""
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path / "mine"))
    (tmp_path / "mine").mkdir()
    return tmp_path / "mine"


@pytest.fixture
def kept(given):
    """A file of a program in there."""
    program_cache._write(program_cache._file(KEY), b"program")
    return program_cache._file(KEY)


def test_files_of_the_user_are_left_alone(given, monkeypatch):
    """In the folder that is named, and in romjax's own if some lie there; oldest first as they
    are.
    """
    own = program_cache.folder()
    own.mkdir(mode=0o700)
    theirs = [given / "thesis.tex", given / KEY, given / f"{KEY}.program", own / "thesis.tex"]
    theirs += [own / KEY, own / f"{KEY[:-1]}.program", own / f"{KEY}.program.bak"]
    for file in theirs:
        file.write_bytes(bytes(1000))
        os.utime(file, (1.0, 1.0))
    (own / "notes.call").mkdir()
    monkeypatch.setattr(program_cache, "_LARGEST", 1000)
    keys = [f"{number:064x}" for number in range(4)]
    for number, key in enumerate(keys):
        program_cache._write(program_cache._file(key), bytes(400))
        os.utime(program_cache._file(key), (number + 10.0, number + 10.0))
    program_cache._forget_oldest(own)
    assert all(file.read_bytes() == bytes(1000) for file in theirs)
    assert (own / "notes.call").is_dir()
    assert [program_cache._file(key).exists() for key in keys] == [False, False, True, True]


def test_what_killed_processes_left_goes(given, kept):
    old, new = (kept.parent / f".romjax-{name}.part.program" for name in ("old", "new"))
    for file in (old, new):
        file.write_bytes(b"half")
    os.utime(old, (1.0, 1.0))
    program_cache._forget_oldest(kept.parent)
    assert sorted(kept.parent.iterdir()) == [new, kept]


@POSIX
def test_only_the_user_can_write_to_what_is_read(kept):
    """Of whatever mask the process has."""
    assert kept.stat().st_mode & 0o777 == 0o600
    assert kept.parent.stat().st_mode & 0o777 == 0o700
    assert program_cache._read(kept) == b"program"
    for place, safe in ((kept, 0o600), (kept.parent, 0o700)):
        for others in (0o020, 0o002):
            place.chmod(safe | others)
            assert program_cache._read(program_cache._file(KEY)) is None
            place.chmod(safe)
    assert program_cache._read(program_cache._file(KEY)) == b"program"


@POSIX
@ROOT
@pytest.mark.parametrize("foreign", ["file", "folder"])
def test_what_belongs_to_another_is_not_read(kept, foreign):
    os.chown(kept if foreign == "file" else kept.parent, 54321, -1)
    assert program_cache._read(program_cache._file(KEY)) is None
    assert program_cache.keeps(KEY) == (foreign == "file")


@POSIX
def test_no_foreign_pickle_is_run(given, kept, monkeypatch):
    """A file that does something when it is read, as anyone could leave in a shared folder."""
    ran = given / "ran"
    kept.write_bytes(zlib.compress(pickle.dumps(Touch(str(ran)))))
    monkeypatch.setattr(compat, "load_executable", lambda *parts: parts)
    kept.chmod(0o666)
    assert program_cache.load(KEY) is None
    assert not ran.exists()
    kept.chmod(0o600)
    program_cache.load(KEY)
    assert ran.exists()


class Touch:
    """What makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


@POSIX
@pytest.mark.parametrize("make", ["mkdir", "mkfifo", "symlink"])
def test_what_is_no_file_is_no_program(kept, make):
    kept.unlink()
    getattr(os, make)(*([__file__] if make == "symlink" else []), kept)
    assert program_cache.load(KEY) is None


@pytest.mark.parametrize("content", [b"", b"no pickle", b"crom\njax\n.", b"\x80\x05Kc."])
def test_what_does_not_unpickle_is_no_program(kept, content):
    kept.write_bytes(zlib.compress(content))
    assert program_cache.load(KEY) is None


def test_a_full_disk_keeps_nothing(given, kept, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    program_cache._write(program_cache._file("f" * 64), b"program")
    program_cache._write(kept, b"other")
    assert list(kept.parent.iterdir()) == [kept]
    assert kept.read_bytes() == b"program"


def without_home(monkeypatch, answer):
    def path(*_):
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.delenv("ROMJAX_CACHE_DIR")
    monkeypatch.setattr(program_cache, "user_cache_path", path)


@pytest.mark.parametrize("answer", [RuntimeError("no home"), KeyError(1), Path("~/x")])
def test_without_a_home_there_is_no_folder(given, monkeypatch, answer):
    without_home(monkeypatch, answer)
    assert program_cache.folder() is None
    assert not program_cache.keeps(KEY)
    assert program_cache.load(KEY) is None
    program_cache.store(KEY, None)
