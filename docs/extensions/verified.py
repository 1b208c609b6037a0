"""The page of the problems that romjax is held to, by the record of their digits."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import records

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = Path(__file__).parents[1] / "reference" / "verification.md"

INTRODUCTION = """# Verification

{count} problems with right values, each held by two independent ways that are not romjax's: closed
forms, published digits, other programs, other coordinates, many digits. The digits that romjax
meets are those of the worst value, and each problem has a floor of them.
`python -m benchmarks verification` computes all of them again and fails where one falls below. This
is its record of {made}, at the commit {commit}, on {on}.

Digits that are few are explained by the problem: a published value of four digits, or a model that
is coarser than the problem on purpose, such as eight welded beams for a rod. The first time
includes all compiling, and the second one is that of the same call again.
"""
SUMMARY = """
## {theme}

| problem | digits | two ways agree to | first call [s] | again [s] |
|---|---:|---:|---:|---:|
"""
PROBLEM = """
### {title}

{picture}{statement}

- **Source:** {source}.
- **Right by:** {first}; {second}{agree}.
- **Met:** {digits} digits, in {once} s with compiling and {again} s without.

| value | right | romjax |
|---|---:|---:|
"""


def number(x: float | None, form: str) -> str:
    return "–" if x is None or x != x else format(x, form)


def title_of(name: str) -> str:
    return name[0].upper() + name[1:]


def anchor(name: str) -> str:
    """Of a heading, as MyST makes it."""
    return re.sub(r"[^\w -]", "", name.lower()).replace(" ", "-")


def _problem(problem: Any, one: dict[str, Any]) -> str:
    agree = one["agree"]
    agree = "" if agree is None or agree != agree else f"; they agree to {agree:.1f} digits"
    drawn = one.get("picture")
    text = PROBLEM.format(
        title=title_of(problem.name),
        picture=f"```{{raw}} html\n{drawn}\n```\n\n" if drawn else "",
        statement=" ".join(problem.statement.split()),
        source=problem.source,
        first=problem.ways[0],
        second=problem.ways[1],
        agree=agree,
        digits=number(one["digits"], ".1f"),
        once=number(one["first"], ".2g"),
        again=number(one["second"], ".2g"),
    )
    rows = zip(one["right"].items(), one["found"], strict=True)
    lines = [f"| {label} | {right:.12g} | {found:.12g} |" for (label, right), found in rows]
    return text + "\n".join(lines) + "\n"


def text() -> str:
    """The page."""
    from verification import THEMES

    measured = records.record("verification")
    data = measured["data"]
    known = {theme: [p for p in problems if p.name in data] for theme, problems in THEMES.items()}
    count = sum(map(len, known.values()))
    about = {key: " ".join(measured[key].split()).rstrip(".") for key in ("made", "commit", "on")}
    blocks = [INTRODUCTION.format(count=count, **about)]
    for theme, problems in known.items():
        blocks.append(SUMMARY.format(theme=theme))
        for problem in problems:
            one = data[problem.name]
            cells = [number(one[key], ".1f") for key in ("digits", "agree")]
            cells += [number(one[key], ".2g") for key in ("first", "second")]
            link = f"[{problem.name}](#{anchor(problem.name)})"
            blocks.append(f"| {link} | {' | '.join(cells)} |\n")
        blocks += [_problem(problem, data[problem.name]) for problem in problems]
    return "".join(blocks)


def write(app: "Sphinx") -> None:
    """The page, unless it is there."""
    made = text()
    if not PAGE.exists() or PAGE.read_text() != made:
        PAGE.write_text(made)


def setup(app: "Sphinx") -> dict[str, Any]:
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
