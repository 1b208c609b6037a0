"""What the parts may know of each other, and how long they may be: read from the code itself."""

import ast
import importlib
import inspect
import pkgutil
import sys
import types
from collections.abc import Hashable
from pathlib import Path

import jax
import numpy as np
import pytest
import zoo
from documents import FILES, PACKAGE, TREES

import romjax as rj
from romjax.study.fits.fit import Fit
from romjax.study.sweeps.sweep import Sweep
from romjax.system.base import AbstractSystem

# Required: the largest sizes, in lines, and in members and calls.
FILE, FUNCTION, REDUCTION = 300, 60, 1100
MEMBERS, CALLS, WALK = 12, 20, 16
# The rooms of `reduction/` that are for one kind of model each.
ROOMS = {"charts", "hyper", "joint", "local", "tables"}
# Names of formulations and decompositions, which only the parser of names may compare with.
NAMES = {
    "galerkin",
    "hyper",
    "joint",
    "local",
    "minimal",
    "projected",
    "table",
    "POD",
    "SOD",
    "given",
}
PARSER = "reduction/formulation/parse.py"


def within(*folders: str) -> dict[str, ast.Module]:
    return {name: tree for name, tree in TREES.items() if name.split("/")[0] in folders}


def classes() -> list[type]:
    """All classes that the modules of the package define."""
    found = []
    for module in pkgutil.walk_packages(rj.__path__, "romjax."):
        members = vars(importlib.import_module(module.name)).values()
        found += [x for x in members if inspect.isclass(x) and x.__module__ == module.name]
    return found


def descendants(cls: type) -> list[type]:
    """The subclasses of a class that the package defines, and theirs."""
    direct = [sub for sub in cls.__subclasses__() if sub.__module__.startswith("romjax.")]
    return direct + [sub for parent in direct for sub in descendants(parent)]


# Nobody asks which kind of system, formulation or decomposition it holds.


def asked_kinds(call: ast.Call) -> list[str]:
    """The names of classes that an `isinstance` or `issubclass` asks for."""
    if not (isinstance(call.func, ast.Name) and call.func.id in ("isinstance", "issubclass")):
        return []
    nodes = list(ast.walk(call.args[1]))
    names = [node.id for node in nodes if isinstance(node, ast.Name)]
    return names + [node.attr for node in nodes if isinstance(node, ast.Attribute)]


# What systems are called where somebody holds one.
SYSTEMS = {"by", "full", "mechanism", "model", "nominal", "rom", "system"}
# Where it is asked all the same, and why.
ASKING = {
    "assembly/assembled.py": "a system of one's own has no bodies: all others ask here",
    "system/reduced.py": "a reduced system stands for another: all others ask here",
    "system/base.py": "type checkers do not know which fields a system has",
    "plot/motion/animate.py": "users may give anything there",
    "study/errors/richer.py": "the ranks of a local model, whose formulation is known",
}


def asked_of_systems(call: ast.Call) -> bool:
    """Whether a call asks for the kind of a system, or for what only some kinds have."""
    if any(kind.endswith("System") for kind in asked_kinds(call)):
        return True
    name = call.func.id if isinstance(call.func, ast.Name) else ""
    if name not in ("cast", "hasattr") and not (name == "getattr" and len(call.args) == 3):
        return False
    about = call.args[1 if name == "cast" else 0]
    last = about.id if isinstance(about, ast.Name) else getattr(about, "attr", "")
    return last in SYSTEMS


@pytest.mark.instant
def test_only_reduction_asks_which_kind_a_system_is():
    """Nor does any by the attributes that only some kinds have, or by a type that it claims."""
    asked = {
        name: f"line {call.lineno}: {ast.unparse(call)}"
        for name, tree in TREES.items()
        if not name.startswith("reduction/")
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and asked_of_systems(call)
    }
    assert {name: words for name, words in asked.items() if name not in ASKING} == {}
    assert set(ASKING) <= set(asked)


def compared(tree: ast.Module) -> list[ast.Compare | ast.pattern]:
    """Comparisons with a name, by operators or by a pattern of `match`."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Compare | ast.pattern)]
    return [
        node
        for node in nodes
        if any(x.value in NAMES for x in ast.walk(node) if isinstance(x, ast.Constant))
    ]


@pytest.mark.instant
def test_only_the_parser_of_names_compares_with_them():
    found = [
        f"{name}:{node.lineno}: {ast.unparse(node)}"
        for name, tree in TREES.items()
        if name != PARSER
        for node in compared(tree)
    ]
    assert found == []


@pytest.mark.instant
@pytest.mark.parametrize(
    "line",
    [
        'kind == "galerkin"',
        'if kind in ("POD", "SOD"): pass',
        'match kind:\n    case "minimal": pass',
    ],
)
def test_comparisons_are_recognised(line):
    assert len(compared(ast.parse(line))) >= 1


# Abstract or final.


@pytest.mark.instant
def test_a_system_is_little_to_know():
    """Fields, properties and methods; of these, subclasses define those that are abstract."""
    fields = {name for name in AbstractSystem.__annotations__ if not name.startswith("_")}
    members = fields | {name for name in dir(AbstractSystem) if not name.startswith("_")}
    assert len(members) <= MEMBERS, f"{len(members)} members: {sorted(members)}"
    concrete = members - fields - AbstractSystem.__abstractmethods__
    assert {"n", "m", "acceleration"} <= concrete
    kinds = descendants(AbstractSystem)
    assert len(kinds) >= 4
    overridden = [(kind.__name__, name) for kind in kinds for name in concrete & set(vars(kind))]
    assert overridden == []


# What others derive from though it stands by itself: an error that is caught for all of its kind,
# and results that are those of another study with more fields.
EXTENDED = {rj.InputError, rj.SceneError, rj.ReductionError, Fit, Sweep}


@pytest.mark.instant
def test_classes_are_abstract_or_final():
    """None derives from a class of the package that can be instantiated."""
    wrong = [
        f"{cls.__module__}.{cls.__name__} derives from {base.__name__}"
        for cls in classes()
        for base in cls.__mro__[1:]
        if base.__module__.startswith("romjax.")
        if not (base.__name__.startswith("Abstract") or base in EXTENDED)
    ]
    assert wrong == []


# Types.


def functions() -> list[types.FunctionType]:
    """All functions that the modules of the package define, methods too."""
    found = []
    for module in pkgutil.walk_packages(rj.__path__, "romjax."):
        members = list(vars(importlib.import_module(module.name)).values())
        owned = [x for x in members if getattr(x, "__module__", "") == module.name]
        owned += [x for cls in filter(inspect.isclass, owned) for x in vars(cls).values()]
        plain = [getattr(x, "__func__", getattr(x, "fget", x)) for x in owned]
        found += [x for x in plain if inspect.isfunction(x) and x.__module__ == module.name]
    return found


@pytest.mark.instant
def test_types_can_be_checked():
    """By beartype, which reads those of each function alone when its module is imported; what it
    cannot read there, such as `Self`, would be seen only where the shapes of arrays are checked.
    """
    import beartype  # here, since it takes long to import
    import beartype.roar

    kinds, unreadable = {}, []
    for function in functions():
        for name, kind in function.__annotations__.items():
            if isinstance(kind, Hashable):  # not the arguments of a ParamSpec
                kinds.setdefault(kind, (function, name))
    for kind, (function, name) in kinds.items():

        def returns():
            pass

        returns.__annotations__["return"] = kind
        try:
            beartype.beartype(returns)
        except beartype.roar.BeartypeDecorHintException as error:
            unreadable.append(f"{function.__module__}.{function.__qualname__}, {name}: {error}")
    assert unreadable == []


# Sizes.


@pytest.mark.instant
def test_files_are_short():
    lengths = {name: len(path.read_text().splitlines()) for name, path in FILES.items()}
    assert {name: length for name, length in lengths.items() if length > FILE} == {}


@pytest.mark.instant
def test_reduction_is_short():
    """What all reduced systems share; each of the rooms below is for one kind of model."""
    shared = [name for name in within("reduction") if name.split("/")[1] not in ROOMS]
    lengths = [len(FILES[name].read_text().splitlines()) for name in shared]
    assert sum(lengths) <= REDUCTION, f"{sum(lengths)} lines"


def code_lines(function: ast.FunctionDef) -> int:
    """Lines of a function without its docstring, which may be as long as its arguments need."""
    assert function.end_lineno is not None
    first = function.body[0]
    words = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    docstring = first.end_lineno - first.lineno + 1 if words else 0
    return function.end_lineno - function.lineno + 1 - docstring


@pytest.mark.instant
def test_functions_are_short():
    long = {
        f"{name}:{node.lineno}: {node.name}": code_lines(node)
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and code_lines(node) > FUNCTION
    }
    assert long == {}


# The walk of a basis to a reduced system.


@pytest.fixture(scope="module")
def swinging():
    """Two hinged bars, and a basis of what they do."""
    return zoo.system(zoo.bars), rj.pod(zoo.motion(zoo.bars, 0.2, 21), rank=2)


@pytest.mark.parametrize("formulation", ["galerkin", "minimal"])
def test_the_walk_of_a_basis_is_short(swinging, formulation):
    """Functions that a reader of `reduce` passes: those of basis/ and reduction/, and those
    that ask which constraints a subspace keeps. They are called between its first line and
    its return; each counts once, however often a loop calls it.

    Left out is what JAX calls (functions under jit and vmap, while they are traced), what only
    evaluates the system (its mass matrix, say), and comprehensions, which are no functions.
    """
    of_jax, passed = str(Path(jax.__file__).parent) + "/", []
    folders = (
        *(str(PACKAGE / folder) + "/" for folder in ("basis", "reduction")),
        str(PACKAGE / "system" / "reduced_constraints.py"),
    )

    def note(frame, event, _):
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(folders) or code.co_name[0] == "<":
            return
        caller = frame.f_back
        while caller is not None and caller.f_code is not here:
            if caller.f_code.co_filename.startswith(of_jax):
                return
            caller = caller.f_back
        passed.append(code.co_qualname)

    here = sys._getframe().f_code
    sys.setprofile(note)
    try:
        rj.reduce(*swinging, formulation)
    finally:
        sys.setprofile(None)
    different = list(dict.fromkeys(passed))
    assert different[:2] == ["reduce", "as_formulation"]
    assert len(different) <= CALLS, f"{len(different)} functions: {', '.join(different)}"


def test_the_walk_of_output_times_is_short():
    """Functions that a reader passes who follows `ts` from `simulate` to the compiled program."""
    system, ts, passed = zoo.system(zoo.bars), jax.device_put(np.linspace(0.0, 0.2, 21)), []

    def note(frame, event, _):
        code, given = frame.f_code, frame.f_locals
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if event == "call" and code.co_filename.startswith(str(PACKAGE) + "/"):
            passed.extend(code.co_qualname for name in names if given.get(name) is ts)

    sys.setprofile(note)
    try:
        zoo.run(system, ts)
    finally:
        sys.setprofile(None)
    different = list(dict.fromkeys(passed))
    assert different[0] == "simulate"
    assert "_run" in different
    assert len(different) <= WALK, f"{len(different)} functions: {', '.join(different)}"
