"""Equal parts are traced once, programs compiled once, and modules depend one way."""

import ast
import functools
import graphlib
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from programs import primitives

import romjax as rj

PACKAGE = Path(rj.__file__).parent
# Required: a chain eight times as long compiles to at most this many times the program.
LONGER = 1.5


class Watched(rj.AbstractSignal):
    """A constant that takes note of every time that it is traced."""

    value: jax.Array = eqx.field(converter=jnp.asarray)
    traced: ClassVar[list[int]] = []

    def __call__(self, t):
        del t
        self.traced.append(1)
        return self.value


# Grouping.


@pytest.mark.instant
def test_a_longer_chain_is_the_same_program():
    def count(links):
        system = rj.assemble(rj.gallery.chain(links))
        q, v = np.asarray(system.q0), np.asarray(system.v0)
        whole = primitives(lambda s, q, v: (s.force(0.0, q, v), s.constraint(0.0, q)), system, q, v)
        return len(whole), len(primitives(lambda s, q, v: s.acceleration(0.0, q, v), system, q, v))

    assert count(64) == count(8)


@eqx.filter_jit
def acceleration(system, t, q, v):
    return system.acceleration(t, q, v)


def test_a_longer_chain_compiles_to_as_much():
    """Lines of the compiled program, which the compiler's time follows."""

    def lines(links):
        system = rj.assemble(rj.gallery.chain(links))
        lowered = acceleration.lower(system, 0.0, system.q0, system.v0)
        return len(lowered.compile().compiled.as_text().splitlines())

    assert lines(64) <= LONGER * lines(8)


# Compiled once.


def sprung(mass=1.0, stiffness=5.0, load=1.0, point=-0.5, bodies=1):
    """A bar on a hinge with a spring and a watched force; more bodies float beside it."""
    bar = rj.RigidBody("bar", mass, 0.1, position=(-point, 0.0))
    others = [rj.RigidBody(f"other{i}", 1.0, 1.0) for i in range(bodies - 1)]
    return rj.Scene(
        bodies=[bar, *others],
        joints=[rj.Revolute(bar.at((point, 0.0)), rj.ground.at())],
        effects=[
            rj.Spring(bar.at((0.5, 0.0)), rj.ground.at((0.0, 1.0)), stiffness),
            rj.Force(bar.at(), (0.0, 1.0), Watched(load)),
        ],
    )


def traces(alpha=10.0, rtol=1e-6, end=0.1, **numbers):
    """How many times a run traces the watched force."""
    before = len(Watched.traced)
    rj.simulate(
        rj.assemble(sprung(**numbers)),
        jnp.linspace(0.0, end, 3),
        rtol=rtol,
        solver=diffrax.Tsit5(),
        stabilization=rj.Baumgarte(alpha, 25.0),
        audit=False,
    )
    return len(Watched.traced) - before


def test_new_numbers_compile_nothing():
    assert traces() > 0
    assert traces() == 0
    assert traces(mass=2.0) == 0
    assert traces(stiffness=7) == 0
    assert traces(load=3.0) == 0
    assert traces(point=-0.4) == 0
    assert traces(alpha=20.0) == 0
    assert traces(rtol=1e-8) == 0
    assert traces(end=0.2) == 0


@pytest.mark.slow
def test_a_new_body_compiles():
    # Of programs that the other tests do not run, whichever comes first.
    assert traces(bodies=2) > 0
    assert traces(bodies=3) > 0


@pytest.mark.instant
def test_the_name_of_a_body_is_no_number_but_no_program_either():
    """Bodies of equal structure are one group, whatever they are called."""
    system = rj.assemble(rj.gallery.chain(5))
    assert len(system.bodies) == 1
    assert len(system.joints) == 1


# The layout of the package.

BASE = {"common", "compiling"}
BELOW = {
    "compiling": set(),
    "linalg": set(),
    "scene": {"linalg"},
    "basis": set(),
    "system": {"linalg", "scene", "basis"},
    "assembly": {"linalg", "scene", "system"},
    "reduction": {"linalg", "scene", "basis", "system", "assembly"},
    "march": {"linalg"},
    "events": {"linalg", "system", "march"},
    "integrate": {"linalg", "scene", "basis", "system", "assembly", "reduction", "events"}
    | {"march"},
    "measure": {"linalg", "scene", "system", "assembly", "reduction", "integrate", "study"},
    "analysis": {"linalg", "scene", "system", "assembly", "measure"},
    "study": {"linalg", "scene", "basis", "system", "assembly", "reduction", "integrate"},
    "trials": {"linalg", "scene", "basis", "system", "assembly", "reduction", "integrate", "study"},
    "export": {"linalg", "scene", "system", "assembly", "reduction", "march", "integrate"}
    | {"measure", "analysis"},
    "files": {"scene", "spatial", "system", "assembly", "reduction", "integrate", "measure"}
    | {"study", "events"},
    "gallery": {"linalg", "scene", "spatial"},
    "spatial": {"scene"},
    "pages": {"scene", "basis", "integrate", "study", "trials", "gallery", "plot"},
    "plot": {"scene", "basis", "system", "assembly", "reduction", "integrate", "study"}
    | {"measure", "analysis", "trials"},
}


def modules():
    """Files of the package, each with the dotted path of its module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield path, parts


@functools.cache
def parsed(path):
    return ast.parse(path.read_text())


def imports(path, parts):
    """What a file imports: of romjax without its name, others with theirs."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split("."), False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            name = node.module.split(".") if node.module else []
            if node.level:
                base = list(parts[: len(parts) - node.level])
                yield from (([*base, *name, alias.name], True) for alias in node.names)
            else:
                yield name, False


@pytest.mark.instant
def test_each_folder_is_a_layer():
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert folders == (set(BELOW) - {"spatial"}) | {"common"}


@pytest.mark.instant
@pytest.mark.parametrize("layer", BELOW)
def test_imports_point_one_way(layer):
    for path, parts in modules():
        if parts[0] == layer:
            for name, own in imports(path, parts):
                allowed = BELOW[layer] | BASE | {layer}
                assert not own or name[0] in allowed, f"{path} imports {'.'.join(name)}"
                assert name[0] != "romjax", f"{path} imports its own package by name"


@pytest.mark.instant
def test_no_imports_go_in_a_circle():
    """Nor do those for types alone, nor what is named in a string, such as for a later import."""
    known, graph = {parts for _, parts in modules()}, {}
    for path, parts in modules():
        graph[parts] = set()
        for name, own in imports(path, parts):
            while own and name and tuple(name) not in known:
                name = name[:-1]
            graph[parts] |= {tuple(name)} if own and name else set()
        words = {node.value for node in ast.walk(parsed(path)) if isinstance(node, ast.Constant)}
        named = {tuple(word.split(".")) for word in words if isinstance(word, str) and "." in word}
        graph[parts] |= (named & known) - {parts}
    assert len(graph) > 500
    tuple(graphlib.TopologicalSorter(graph).static_order())


@pytest.mark.instant
def test_only_plot_imports_matplotlib():
    for path, parts in modules():
        if parts[0] != "plot":
            assert all(name[0] != "matplotlib" for name, _ in imports(path, parts)), path


@pytest.mark.instant
def test_every_public_name_is_exported_once():
    names = []
    for node in ast.parse((PACKAGE / "__init__.py").read_text()).body:
        words = ast.unparse(node)
        if isinstance(node, ast.Expr) or words.startswith("__version__ = "):
            continue
        assert isinstance(node, ast.ImportFrom), "romjax/__init__.py holds exports and no code"
        for alias in node.names:
            assert alias.asname == alias.name
            names.append(alias.name)
            if node.module:
                home = sys.modules[f"romjax.{node.module}"]
                assert getattr(rj, alias.name) is getattr(home, alias.name)
    assert len(names) == len(set(names))


# What takes long to load and few need: with the command line either, and with the package.
SLOW = {"matplotlib", "pandas", "scipy.spatial", "scipy.io", "scipy.stats"}
SLOWEST = {*SLOW, "tomlkit", "xarray"}


def test_importing_changes_no_setting_makes_no_array_and_loads_nothing_slow():
    """An array made at import would fix the precision before the user can choose it. A figure loads
    matplotlib when it is made.
    """
    words = (
        "import sys, jax, romjax\n"
        f"print(*{SLOWEST} & set(sys.modules), jax.config.jax_enable_x64, len(jax.live_arrays()))\n"
        "import romjax.cli\n"
        f"print(*{SLOW} & set(sys.modules))\n"
        "romjax.plot.values\n"
        "print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["False 0", "", "True"]
