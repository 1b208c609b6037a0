"""Scene files with mistakes: all are said at once, with line, key, cause and remedy."""

import functools
import os
import random
import re
import time
from importlib.resources import files

import pytest
from groups import in_groups
from scene_files import CRANK, IMPOSSIBLE, MISTAKES, SPACE, TETHERED, WRONG_ROTATIONS
from test_bad_input import _as_users_run as _as_users_run

import romjax as rj
from romjax.cli import main

LONGEST = 10.0  # required: seconds that a file may take to be read, whatever is in it
GALLERY = files("romjax.gallery") / "files"
MUTATIONS = {"some": range(60), "many": range(2000)}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "scene.toml"


def refused(path):
    """What is said of a file, one mistake a line."""
    with pytest.raises(rj.SceneFileError) as error:
        rj.scene_file(path)
    lines = str(error.value).splitlines()
    assert lines
    assert all(line.startswith(str(path)) for line in lines)
    return lines


def test_the_file_without_mistakes(path):
    path.write_text(CRANK)
    assert rj.scene_file(path).title == "slider crank"
    assert len(MISTAKES) + len(IMPOSSIBLE) >= 60


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake(mistake, path):
    before, after, words = MISTAKES[mistake]
    assert before in CRANK
    path.write_text(CRANK.replace(before, after, 1))
    said = "\n".join(refused(path))
    assert [word for word in words if word not in said] == [], said


def test_a_typo_does_not_lead_to_other_ways_to_make_a_part(path):
    """Though what follows it does."""
    text = CRANK.replace('length = "=length"\nEI', 'lenght = "=length"\nE')
    path.write_text(text)
    (typo,) = [line for line in refused(path) if "no key 'lenght'" in line]
    (material,) = [line for line in refused(path) if "no key 'E'" in line]
    assert "mean 'length'" in typo
    assert "Beam.of_section" not in typo
    assert "Beam.of_section" in material


@pytest.mark.parametrize("mistake", WRONG_ROTATIONS)
def test_a_wrong_rotation(mistake, path):
    """In a file that turns nothing else."""
    before, after, words = WRONG_ROTATIONS[mistake]
    assert before in SPACE
    plain = {"a": '"top"', "b": '"ground"'}
    text = re.sub(
        r"hinge\.([ab]) = .*",
        lambda line: line[0] if before in line[0] else f"hinge.{line[1]} = {plain[line[1]]}",
        SPACE,
    )
    path.write_text(text.replace(before, after, 1))
    said = "\n".join(refused(path))
    assert [word for word in words if word not in said] == [], said


def test_bodies_in_space_that_are_placed_in_a_file_of_the_plane(path):
    """One line names the key that is left out, and not the poses that have another dimension."""
    text = SPACE.replace("dimension = 3\n", "").replace("orientation =", "# ")
    placed = 'place = { point = [0.0, 0.0, 0.1], at = "ground" }\n\n[joints]'
    path.write_text(text.replace("[joints]", placed))
    (line,) = refused(path)
    assert "dimension: The bodies have 3; write dimension = 3." in line


@pytest.mark.parametrize("mistake", IMPOSSIBLE)
def test_joints_that_cannot_hold(mistake, path, capsys):
    """Of two scenes that differ in numbers alone."""
    before, after, words = IMPOSSIBLE[mistake]
    assert before in TETHERED
    path.write_text(TETHERED.replace(before, after))
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert [word for word in words if word not in said] == [], said
    assert str(path) in said


@pytest.mark.instant
def test_all_mistakes_at_once(path):
    """Of keys, values, parts and references, in the order of their lines."""
    text = CRANK
    for mistake in ("unknown key", "text for a number"):
        before, after, _ = MISTAKES[mistake]
        text = text.replace(before, after, 1)
    text = text.replace('"slider" }', '"slidr" }', 1).replace('"=speed"', '"=sped"')
    text = text.replace("inertia = 0.01", "inertia = -1.0")
    path.write_text(text)
    said = refused(path)
    keys = [re.sub(r".*:(\d+: \[[\w.]+\] [\w.]*).*", r"\1", line) for line in said]
    assert keys == [
        "17: [bodies.crank] angular_velocity",
        "20: [bodies.rod] mass",
        "22: [bodies.rod] mas",
        "33: [bodies.slider] inertia",
        "39: [joints.wrist] b",
    ]


BYTES = {
    "latin": (CRANK.replace("slider crank", "Kurbeltrieb für Ü").encode("latin-1"), "not in UTF-8"),
    "utf-16": (CRANK.encode("utf-16"), "not in UTF-8"),
    "binary": (bytes(range(256)) * 40, "not in UTF-8"),
    "zeros": (bytes(1000), "no TOML"),
    "carriage returns": (CRANK.replace("\n", "\r").encode(), "no TOML"),
}


@pytest.mark.instant
@pytest.mark.parametrize("kind", BYTES)
def test_what_is_no_text(kind, path):
    data, words = BYTES[kind]
    path.write_bytes(data)
    assert words in refused(path)[0]


def test_windows_writes_files_too(path):
    """With its line ends and the mark that some of its editors put first."""
    path.write_bytes(("\ufeff" + CRANK.replace("\n", "\r\n")).encode())
    assert rj.scene_file(path).title == "slider crank"


@pytest.mark.instant
def test_points_that_are_none():
    with pytest.raises(rj.SceneError, match=r"point 'pin' has shape \(3,\)"):
        rj.RigidBody("crank", 1.0, 1.0, points={"pin": (0.1, 0.0, 0.0)})


@pytest.mark.instant
def test_what_is_no_file(tmp_path):
    assert "This is a folder" in refused(tmp_path)[0]
    assert "no such file" in refused(tmp_path / "none.toml")[0]
    os.mkfifo(tmp_path / "pipe")
    assert "no regular file" in refused(tmp_path / "pipe")[0]


@pytest.mark.instant
def test_a_hundred_megabytes(path):
    with path.open("wb") as file:
        file.truncate(100 * 2**20)
    begin = time.process_time()
    assert "The file has 100 MiB" in refused(path)[0]
    assert time.process_time() - begin < 1.0


@pytest.mark.instant
@pytest.mark.parametrize(
    "lines",
    [
        [f"key{i} = 1" for i in range(30_000)],
        ["[joints]", *(f"j{i} = {{ type = 'Revolute', a = 'x', b = 'y' }}" for i in range(20_000))],
        ["[parameters]", *(f"p{i} = '=p{i + 1}'" for i in range(20_000)), "p20000 = '=p0'"],
        ["[run]", f"end = [{'1.0, ' * 150_000}]"],
        ["[bodies.a]", "type = 'Beam'", "mass = 1", "length = 1", "EI = 1", "modes = 999999999"],
    ],
    ids=["keys", "joints", "parameters", "list", "modes"],
)
def test_many_mistakes_take_no_long_time(lines, path):
    path.write_text("\n".join(["format = 1", *lines]))
    begin = time.process_time()
    assert len(refused(path)) <= 51
    assert time.process_time() - begin < LONGEST


# Mutations.

TOKENS = [
    *(
        "-1",
        "0",
        "1e400",
        "nan",
        "inf",
        "true",
        "[]",
        "{}",
        "[1, 2, 3]",
        "1979-05-27",
        "1_0",
        "0x1F",
    ),
    *('"=length"', '"x"', '""', '"ground"', '"crank.end"', '"\\u0000"', "'''a'''", "[[[]]]"),
    *('{ type = "Sine" }', "99999999999999999999999999", "1e-300", '{ file = "a.npz" }'),
]


@functools.cache
def good_files():
    names = ("cart-pendulum", "squeezer", "vehicle-axle")
    return [CRANK, *((GALLERY / f"{name}.toml").read_text("utf-8") for name in names)]


def mutated(seed):
    """A good file with one to four changes to a line, a value, a word or a character."""
    lot = random.Random(seed)
    text = lot.choice(good_files())
    for _ in range(lot.choice([1, 1, 2, 4])):
        text = "\n".join(once_mutated(lot, text.split("\n"), re.findall(r"\w+", text)))
    return text


def once_mutated(lot, lines, words):
    """The lines with one of them left out, repeated, the last, or with something else in it."""
    i, kind = lot.randrange(len(lines)), lot.randrange(9)
    before, line, after = lines[:i], lines[i], lines[i + 1 :]
    at = lot.randrange(len(line) + 1)
    letter = chr(lot.choice([lot.randrange(32, 127), lot.randrange(1, 0x2FFF)]))
    if kind < 3:
        return [before + after, [*before, lot.choice(lines), line, *after], [*before, line]][kind]
    inside = [
        line[:at] + letter + line[at + 1 :],
        line[:at] + line[at + 1 :],
        changed(lot, line, r"=.*", ["= " + token for token in TOKENS]),
        changed(lot, line, r"-?\d+(\.\d+)?", TOKENS),
        changed(lot, line, r'"[^"]*"', TOKENS),
        changed(lot, line, r"\w+", words or ["x"]),
    ]
    return [*before, inside[kind - 3], *after]


def changed(lot, line, pattern, choices):
    return re.sub(pattern, lambda _: lot.choice(choices), line, count=1)


def read_all(seeds, path):
    """Every file is read, or refused in words, soon; how many were read."""
    read = 0
    for seed in seeds:
        path.write_text(mutated(seed), encoding="utf-8")
        begin = time.process_time()
        try:
            rj.scene_file(path)
            read += 1
        except rj.SceneFileError as error:
            lines = str(error).splitlines()
            assert all(line.startswith(str(path)) for line in lines), (seed, lines)
        assert time.process_time() - begin < LONGEST, seed
    return read


@pytest.mark.parametrize("count", in_groups(MUTATIONS, fast=["some"]))
def test_mutations_are_read_or_refused(count, path):
    seeds = MUTATIONS[count]
    read = read_all(seeds, path)
    assert 0.1 * len(seeds) < read < 0.9 * len(seeds)
