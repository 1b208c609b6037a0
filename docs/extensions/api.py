"""A page for each public name, and one that lists them by what they are for."""

import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import romjax

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = Path(__file__).parents[1] / "reference" / "api"

# Sections of the list, in its order, and the rooms of the package that they are about.
SECTIONS = {
    "Scenes and markers": ("scene", "assembly"),
    "Bodies": ("scene.body",),
    "Joints": ("scene.joint", "scene.curve"),
    "Springs, loads and contact": ("scene.effect", "scene.signal"),
    "Systems": ("system",),
    "Simulation": ("integrate",),
    "Events": ("events",),
    "Measurements": ("measure",),
    "Equilibrium, modes, linear models": ("analysis",),
    "Bases": ("basis",),
    "Reduced models": ("reduction", "local", "hyper", "tables"),
    "Studies": ("study", "trials"),
    "Files": ("files",),
    "Other programs": ("export",),
    "Moving pictures": ("plot",),
    "Errors": ("errors",),
    "Compiler": ("xla",),
}
OTHERS = "Others"

# Pages are not in the navigation, which every page repeats: the list leads to them.
PAGE = """---
orphan: true
---

# {title}

One of the names of the [API](index.md).

{block}"""


def names(module: ModuleType = romjax) -> dict[str, Any]:
    """The public names of a module of the package, and what they are."""
    listed = getattr(module, "__all__", None) or [x for x in dir(module) if not x.startswith("_")]
    parts = {name: getattr(module, name) for name in listed}
    return {name: part for name, part in parts.items() if _is_own(module, part)}


def _is_own(module: ModuleType, part: Any) -> bool:
    """Whether it is public by its module: exported by it if that only exports, else made there."""
    if inspect.ismodule(part):
        return module is romjax and part.__name__.startswith("romjax.") and part in MODULES
    home = getattr(part, "__module__", None) or type(part).__module__
    if hasattr(module, "__path__") or module is romjax.spatial:
        return str(home).startswith("romjax.")
    return home == module.__name__


def _modules() -> list[ModuleType]:
    """The modules that the package exports by a name of its `__init__.py`, as in `rj.plot`."""
    source = Path(romjax.__file__).read_text()
    modules = [part for part in vars(romjax).values() if inspect.ismodule(part)]
    short = {module: module.__name__.rpartition(".")[2] for module in modules}
    return [module for module, name in short.items() if f" import {name} as {name}\n" in source]


MODULES = _modules()


def section(part: Any) -> str:
    """The section of a name, by the longest room that it is in."""
    home = getattr(part, "__module__", None) or type(part).__module__
    rooms = {room: title for title, own in SECTIONS.items() for room in own}
    fitting = [room for room in rooms if f"{home}.".startswith(f"romjax.{room}.")]
    return rooms[max(fitting, key=len)] if fitting else OTHERS


def everything() -> dict[str, Any]:
    """All public names, as in `romjax.Beam` and `romjax.plot.response`, but for modules."""
    found = {}
    for module in (romjax, *MODULES):
        prefix = "romjax" if module is romjax else f"romjax.{module.__name__.rpartition('.')[2]}"
        own = {name: part for name, part in names(module).items() if not inspect.ismodule(part)}
        found |= {f"{prefix}.{name}": part for name, part in own.items()}
    return found


def page(name: str) -> str:
    """The page of a name; those that differ in capitals alone, as POD and pod do, share one."""
    return name.lower()


def _directive(name: str, part: Any, again: bool) -> Iterator[str]:
    kind = "class" if inspect.isclass(part) else "function" if callable(part) else "data"
    if inspect.isclass(part) and issubclass(part, BaseException):
        kind = "exception"
    yield f".. auto{kind}:: {name}"
    if again:
        yield "   :no-index:"
    if kind in ("class", "exception"):
        yield "   :members:"
        yield "   :show-inheritance:"
    if kind == "data":
        yield "   :no-value:"


def _first_sentence(part: Any) -> str:
    text = inspect.cleandoc((part if callable(part) else type(part)).__doc__ or "")
    return " ".join(text.split("\n\n")[0].split())


def pages() -> dict[str, str]:
    """The text of each page by its name."""
    texts: dict[str, str] = {}
    classes = set[type]()
    for name, part in everything().items():
        short = name.removeprefix("romjax.")
        # What is for the plane and for space has a name in `romjax.spatial` too; links lead to one.
        again = part in classes if inspect.isclass(part) else False
        classes |= {part} if inspect.isclass(part) else set()
        block = "\n".join(["```{eval-rst}", *_directive(name, part, again), "```", ""])
        old = texts.get(page(name))
        texts[page(name)] = f"{old}\n{block}" if old else PAGE.format(title=short, block=block)
    return texts


def _list() -> str:
    """The page that lists all of them."""
    by_section: dict[str, list[str]] = {title: [] for title in (*SECTIONS, OTHERS)}
    of_modules: dict[str, list[str]] = {}
    for name, part in everything().items():
        _, *module, short = name.split(".")
        shown = f"rj.{'.'.join([*module, short])}"
        line = f"[`{shown}`]({page(name)}.md)\n: {_first_sentence(part)}\n"
        if module:
            of_modules.setdefault(module[0], []).append(line)
        else:
            by_section[section(part)].append(line)
    blocks = [f"## {title}\n\n" + "\n".join(own) for title, own in by_section.items() if own]
    for module in MODULES:
        short = module.__name__.rpartition(".")[2]
        words = inspect.cleandoc(module.__doc__ or "")
        blocks.append(f"## rj.{short}\n\n{words}\n\n" + "\n".join(of_modules.get(short, [])))
    introduction = (FOLDER.parent / "api_introduction.md").read_text()
    return "\n".join([introduction, *blocks])


def write(app: "Sphinx") -> None:
    """All pages; those that did not change keep their time, so that Sphinx need not read them."""
    FOLDER.mkdir(exist_ok=True)
    texts = {"index": _list(), **pages()}
    for old in FOLDER.glob("*.md"):
        if old.stem not in texts:
            old.unlink()
    for name, text in texts.items():
        path = FOLDER / f"{name}.md"
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def setup(app: "Sphinx") -> dict[str, Any]:
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
