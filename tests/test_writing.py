"""Files are written whole or not at all, by whatever writes them."""

import ast
import contextlib
import csv
import errno
import functools
import io
import os
import re
import resource
from pathlib import Path

import numpy as np
import pytest
from groups import in_groups
from motions import motion
from zoo import bar

import romjax as rj
from romjax.common import writing
from romjax.common.files import write_dataset
from romjax.files.begin import write_start
from romjax.pages import csv_table, report

PACKAGE = Path(rj.__file__).parent
ROOM = 512  # bytes
GOOD = b"what was there before"
instant = pytest.mark.instant


@contextlib.contextmanager
def full_disk():
    """No file may become larger than some bytes, as the system itself sees to."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def dataset():
    import xarray  # here, since it takes long to import

    return xarray.Dataset({"x": ("time", np.random.default_rng(0).normal(size=5000))})


def plate(seed):
    """A scene whose arrays lie in a file of their own."""
    shapes = np.random.default_rng(seed).normal(size=(200, 3, 2))
    body = rj.ModalBody("plate", rj.Inertia(1.0, 1.0), [4.0, 9.0], shapes[:, 0], shapes)
    return rj.Scene([body, rj.RigidBody("other", 1.0, 1.0)])


def film():
    moving = rj.animate(bar(), motion(bar(), count=3))
    return lambda path: moving.save(path, progress=False)


def bars():
    return rj.Scene([rj.RigidBody(f"bar {number}", 1.0, 1.0) for number in range(20)])


# What each writes is made before the disk is full.
WRITERS = {
    "text.toml": lambda: lambda path: writing.write(path, 1000 * "text"),
    "scene.toml": lambda: bars().save,
    "table.csv": lambda: lambda path: csv_table.write(path, ["a"], [[x] for x in range(1000)]),
    "run.nc": lambda: functools.partial(write_dataset, dataset()),
}
COMPILING = {"plate.toml": lambda: plate(0).save, "moving.html": film, "moving.gif": film}


@instant
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_destroys_nothing(name, tmp_path):
    check_full_disk(WRITERS[name](), tmp_path / name)


# Of the two films the picture takes seconds to draw.
@pytest.mark.parametrize(
    "name", in_groups(COMPILING, fast=["plate.toml", "moving.html"], slow=["moving.gif"])
)
def test_a_full_disk_destroys_nothing_of_what_compiles(name, tmp_path):
    check_full_disk(COMPILING[name](), tmp_path / name)


def check_full_disk(write, path):
    elsewhere = path.parent / "elsewhere" / path.name
    elsewhere.parent.mkdir()
    write(elsewhere)
    assert elsewhere.stat().st_size > ROOM
    for before in (None, GOOD):
        if before:
            path.write_bytes(before)
        files = sorted(path.parent.iterdir())
        with full_disk(), pytest.raises(OSError, match="nothing was written"):
            write(path)
        assert sorted(path.parent.iterdir()) == files
        assert not before or path.read_bytes() == before
    write(path)
    names = [sorted(file.name for file in x.parent.iterdir()) for x in (path, elsewhere)]
    assert names[0] == sorted([*names[1], "elsewhere"])


@instant
def test_the_message_names_the_file_and_what_became_of_it(tmp_path):
    path = tmp_path / "scene.toml"
    with full_disk(), pytest.raises(OSError, match="nothing was written.*as it was.*scene.toml"):
        bars().save(path)
    with pytest.raises(FileNotFoundError, match="missing/scene.toml"):
        bars().save(tmp_path / "missing" / "scene.toml")


@instant
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_devices_and_pipes_are_written_to_as_they_are():
    with pytest.raises(OSError, match="No space left"):
        writing.write("/dev/full", "text")
    assert Path("/dev/full").is_char_device()
    writing.write("/dev/null", "text")
    assert Path("/dev/null").is_char_device()


@instant
def test_links_stay_links(tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "scene.toml", tmp_path / "link.toml"
    link.symlink_to(target)
    for text in ("one", "two"):  # where it leads to no file yet, and where to one
        writing.write(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
    assert sorted(tmp_path.rglob("*")) == sorted([link, target, target.parent])


@instant
def test_permissions_are_those_of_the_file_or_of_the_mask(tmp_path):
    path = tmp_path / "file"
    before = os.umask(0o027)
    try:
        writing.write(path, "new")
        assert path.stat().st_mode & 0o777 == 0o640
        path.chmod(0o604)
        writing.write(path, "newer")
        assert path.stat().st_mode & 0o777 == 0o604
    finally:
        os.umask(before)


@instant
def test_a_file_that_must_not_be_written_to_is_not_replaced(tmp_path, monkeypatch):
    """Though its folder would allow it; for root, all files may be written to."""
    path = tmp_path / "file"
    path.write_bytes(GOOD)
    monkeypatch.setattr(writing.os, "access", lambda *_: False)
    with pytest.raises(PermissionError, match="Permission denied"):
        writing.write(path, "new")
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [GOOD]


@instant
@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, OSError(errno.EIO, "broken")])
def test_whatever_ends_it_leaves_what_was_there(error, tmp_path):
    path = tmp_path / "file"
    path.write_bytes(GOOD)
    kind = error if isinstance(error, type) else type(error)
    with pytest.raises(kind), writing.replacing(path) as part:  # noqa: PT012
        part.write_text("half")
        raise error
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [GOOD]


@instant
@pytest.mark.parametrize("error", [None, KeyboardInterrupt, OSError(errno.ENOSPC, "full")])
def test_files_that_belong_together_come_together(error, tmp_path):
    """Or none of them, and nothing hidden stays."""
    names = ("page.html", "table.csv", "new.png")
    paths = [tmp_path / name for name in names]
    for path in paths[:2]:
        path.write_bytes(GOOD)
    expected = {path.name: GOOD for path in paths[:2]}
    with contextlib.suppress(KeyboardInterrupt, OSError), writing.together():
        for path in paths:
            writing.write(path, b"new")
        assert {path.name: path.read_bytes() for path in paths[:2]} == expected
        assert not paths[2].exists()
        if error is not None:
            raise error
    if error is None:
        expected = dict.fromkeys(names, b"new")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == expected


def write_together(files):
    with writing.together():
        for path, content in files.items():
            writing.write(path, content)


@instant
def test_a_full_disk_leaves_all_files_that_belong_together(tmp_path):
    """Also those that were complete when there was no more room."""
    first, second = tmp_path / "small.txt", tmp_path / "large.txt"
    first.write_bytes(GOOD)
    files = {first: "new", second: ROOM * "long"}
    with full_disk(), pytest.raises(OSError, match="nothing was written.*large"):
        write_together(files)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == {"small.txt": GOOD}


def test_arrays_of_a_scene_are_never_those_of_another(tmp_path, monkeypatch):
    """A process that ends between the two files leaves a text with the arrays that it means; those
    that no text asks for any more go.
    """
    path, copy = tmp_path / "plate.toml", tmp_path / "copy.toml"

    def scenes():
        return [np.asarray(rj.load_scene(file).bodies[0].shapes) for file in (path, copy)]

    plate(1).save(path)
    copy.write_bytes(path.read_bytes())
    before = scenes()
    changed = plate(2)
    with monkeypatch.context() as patched:
        patched.setattr(writing, "write", interrupt)
        with pytest.raises(KeyboardInterrupt):
            changed.save(path)
    np.testing.assert_array_equal(scenes(), before)
    plate(2).save(path)
    ours, theirs = scenes()
    assert not np.any(ours == theirs)
    np.testing.assert_array_equal(theirs, before[1])
    copy.unlink()
    plate(3).save(path)
    plate(4).save(path)
    assert len(list(tmp_path.glob("*.npz"))) == 2  # and those of the copy


def interrupt(*_):
    raise KeyboardInterrupt


@instant
def test_a_first_file_is_not_written_over(tmp_path):
    (tmp_path / "link.toml").symlink_to(tmp_path / "nowhere")
    for name in ("crank.toml", "link.toml"):
        with contextlib.suppress(rj.InputError):
            write_start(tmp_path / name)
        with pytest.raises(rj.InputError, match=f"{name} is there already"):
            write_start(tmp_path / name)
    assert not (tmp_path / "nowhere").exists()


@instant
def test_names_keep_their_columns_and_make_no_formulas(tmp_path):
    path = tmp_path / "table.csv"
    names = ["a,b", 'say "x"', "two\nlines", "=1+1", "+cmd", "-x", "@sum", "\t=1", "-1.5", "φ"]
    numbers = [0.1, -2.0, 3, float("nan"), float("inf"), 1e-300, -0.0, 1 / 3, 2.0, True]
    csv_table.write(path, names, [numbers])
    with path.open(encoding="utf-8", newline="") as file:
        header, row = csv.reader(file)
    kept = ["a,b", 'say "x"', "two\nlines", "'=1+1", "'+cmd", "'-x", "'@sum", "'\t=1", "-1.5", "φ"]
    assert header == kept
    assert row[-1] == "True"
    np.testing.assert_array_equal(np.array(row[:-1], float), numbers[:-1])
    assert len(path.read_bytes().split(b"\n")) == 4


def test_trajectories_have_a_column_for_each_name():
    run = motion(rj.Scene([rj.RigidBody("a,b", 1.0, 1.0), rj.RigidBody("=c", 1.0, 1.0)]), count=3)
    header, *rows = csv.reader(io.StringIO(report._csv(run, with_multipliers=True), newline=""))
    assert header[1:7] == ["a,b.x", "a,b.y", "a,b.phi", "'=c.x", "'=c.y", "'=c.phi"]
    found = np.array(rows, float)
    assert found.shape == (3, len(header))
    np.testing.assert_array_equal(found[:, :7], np.column_stack([run.t, run.q]))


# One way to write: what else opens a file to write to it.

WRITES = {"write_text", "write_bytes", "savefig", "to_netcdf", "to_csv", "savetxt", "savez"}
WRITES |= {"savez_compressed", "save_npz"}
# A file that is not complete yet, and what lies in memory.
PLACES = {"part", "content", "None"}


def writes(tree):
    """Calls that write to a file at the place where it shall be."""
    for call in [node for node in ast.walk(tree) if isinstance(node, ast.Call)]:
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        owner = ast.unparse(getattr(call.func, "value", call.func))
        place = ast.unparse(call.args[0]) if call.args else ""
        opens = name == "open" and re.search(r"'[wax]b?\+?'", ast.unparse(call))
        if (name in WRITES or opens) and not {owner, place} & PLACES:
            yield ast.unparse(call)


@instant
def test_everything_is_written_in_one_way():
    found = {
        path.relative_to(PACKAGE).as_posix(): list(writes(ast.parse(path.read_text())))
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    # Temporary files, which nobody else sees, and a claim, which one process alone may make.
    allowed = {
        "export/library.py": ["file.write_text(source)"],
        "files/results/scenes.py": ["file.write_text(str(text), encoding='utf-8')"],
        "study/sweeps/claims.py": ["file.open('x')"],
    }
    assert {name: calls for name, calls in found.items() if calls} == allowed


@instant
@pytest.mark.parametrize(
    "line", ["open(path, 'w')", "path.open('ab')", "path.write_text(x)", "figure.savefig(path)"]
)
def test_other_ways_are_seen(line):
    assert list(writes(ast.parse(line))) == [line]
