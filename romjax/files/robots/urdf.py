"""Checks of a URDF file before it is read: its joints must make one tree of its links."""

import math
from collections.abc import Callable, Iterator, Mapping

from ...common.errors import SceneFileError
from .markup import Element

_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")


def check_urdf(root: Element) -> None:
    """Raise SceneFileError, with a line for each mistake in how links and joints are connected."""
    links, joints = ([x for x in root.children if x.tag == tag] for tag in ("link", "joint"))
    said = [*_repeated(links), *_repeated(joints)]
    for joint in joints:
        said += _of_joint(joint, {link.attributes.get("name") for link in links})
    # What follows from a joint to another one has a meaning where each is right.
    if not said:
        said = [*_of_tree(links, joints), *_of_mimics(joints)]
    if said:
        raise SceneFileError("\n".join(said))


def _repeated(elements: list[Element]) -> Iterator[str]:
    first = dict[str | None, Element]()
    for element in elements:
        name = element.attributes.get("name")
        if not name:
            yield f"{element.place}: <{element.tag}> has no name; give it one."
        elif name in first:
            yield (
                f"{element.place}: {element.called()}: line {first[name].line} has this name too; "
                "give one of them another name."
            )
        first.setdefault(name, element)


def _of_joint(joint: Element, links: set[str | None]) -> Iterator[str]:
    kind = joint.attributes.get("type")
    if kind not in _KINDS:
        yield (
            f"{joint.place}: {joint.called()}: its type is {kind!r}, but there are "
            f"{', '.join(_KINDS)}; give one of these."
        )
    for end in ("parent", "child"):
        name = _of(joint, end, "link")
        if name is None:
            yield f'{joint.place}: {joint.called()}: it has no <{end} link="…"/>; add it.'
        elif name not in links:
            yield (
                f"{joint.place}: {joint.called()}: its {end} '{name}' is no link of the file; give "
                "the name of one."
            )
    lower, upper = (_number(_of(joint, "limit", end) or "0") for end in ("lower", "upper"))
    if kind in _LIMITED and lower > upper:
        yield (
            f"{joint.place}: {joint.called()}: its lower limit {lower:g} is above its upper one "
            f"{upper:g}; exchange them."
        )


def _of_tree(links: list[Element], joints: list[Element]) -> Iterator[str]:
    """One link carries all others, and each is carried by one."""
    carried = dict[str | None, Element]()
    for joint in joints:
        child = _of(joint, "child", "link")
        if child in carried:
            yield (
                f"{joint.place}: {joint.called()}: the link '{child}' hangs on joint "
                f"'{carried[child].attributes['name']}' too, a loop, which URDF does not hold; "
                "write the robot as MJCF, with <equality>, or add the joint to the scene."
            )
        carried.setdefault(child, joint)
    roots = [link for link in links if link.attributes["name"] not in carried]
    for link in roots[1:]:
        yield (
            f"{link.place}: {link.called()}: nothing carries it, nor '{roots[0].attributes['name']}"
            "', but URDF has one root; connect both by a joint, which may be fixed."
        )
    above = {str(child): _of(joint, "parent", "link") for child, joint in carried.items()}
    yield from _rings(above, lambda name: carried[name], "the links carry each other in a ring")


def _of_mimics(joints: list[Element]) -> Iterator[str]:
    known = {joint.attributes["name"]: joint for joint in joints}
    leads = {name: _of(joint, "mimic", "joint") for name, joint in known.items()}
    for name, lead in leads.items():
        if any(child.tag == "mimic" for child in known[name].children) and lead not in known:
            yield (
                f"{known[name].place}: {known[name].called()}: it mimics '{lead}', which is no "
                "joint of the file; give the name of one."
            )
    following = {name: lead for name, lead in leads.items() if lead in known}
    yield from _rings(following, lambda name: known[name], "the joints mimic each other in a ring")


def _rings(
    before: Mapping[str, str | None],
    element: Callable[[str], Element],
    words: str,
) -> Iterator[str]:
    """One line for each ring of names of which each leads to the one before it."""
    done = set[str]()
    for name in before:
        way, here = list[str](), name
        while here in before and here not in done:
            done.add(here)
            way.append(here)
            here = before[here] or ""
        if here in way:
            ring = way[way.index(here) :]
            place = element(ring[0])
            yield f"{place.place}: {place.called()}: {words} ({', '.join(ring)}); open it."


def _of(joint: Element, tag: str, attribute: str) -> str | None:
    children = (child for child in joint.children if child.tag == tag)
    return next((child.attributes.get(attribute) for child in children), None)


def _number(text: str) -> float:
    """A number, or what is not comparable: MuJoCo's reader says so with the line."""
    try:
        return float(text)
    except ValueError:
        return math.nan
