"""The page of what every verb gives on every structure, from the table that the tests go through.

`tests/test_every_verb.py` asserts each cell: a right value, or a refusal with the words that stand
in `REFUSED`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = Path(__file__).parents[1] / "reference" / "verbs.md"

# What is moved, and in which words.
STRUCTURES = {
    "bar": "a bar on a hinge",
    "bars": "an open chain of two bars",
    "four-bar": "a closed loop",
    "pinned twice": "a closed loop, one of its hinges made twice",
    "parallelogram": "a loop that passes a singular position, one of its bars made twice",
    "driven": "a loop whose drive prescribes all of its motion",
    "driven arm": "a driven bar on which another one hangs",
    "cart": "a cart on a spring, and a flexible pendulum",
    "slider crank": "a rigid slider crank",
    "bending rod": "the slider crank, its rod flexible",
    "five-bar": "a closed loop with two freedoms, on springs",
    "falling beams": "an open chain of flexible beams",
    "contact": "a bar that falls onto a floor",
    "friction": "a puck that is thrown along a floor",
    "impact": "a bar that hits a floor, as an event",
    "top": "a spinning top, in space",
    "ball joints": "an open chain of ball joints, in space",
    "loop in space": "a closed loop, in space",
    "beam in space": "a flexible beam on a hinge, in space",
    "driven beam": "a flexible beam that is turned, in space",
    "rolling ball": "a ball that is thrown along a floor and rolls, in space",
    "impact in space": "a bar on a ball joint that hits a floor, as an event, in space",
}

# What is asked, and what it is compared with.
VERBS = {
    "simulate": ("`rj.simulate` at the defaults", "a run at a tight tolerance"),
    "sweep": ("`rj.sweep`, which is `jax.vmap` and `jax.jit`", "the same run, without a flag"),
    "gradient": ("`jax.jvp` of accelerations and forces of joints", "differences of them"),
    "events": ("`rj.Crossing`", "when a run at a tight tolerance passes the level"),
    "equilibrium": ("`rj.equilibrium`", "accelerations there, which are zero"),
    "modes": ("`rj.modes`", "the eigenvalues of the linear model"),
    "linearize": ("`rj.linearize`", "the states that it names, all finite"),
    "galerkin": ('`rj.reduce(…, "galerkin")`', "the full run"),
    "minimal": ('`rj.reduce(…, "minimal")`', "the full run"),
    "local": ('`rj.reduce(…, "local")`', "the full run"),
    "measure": ("`rj.measure`", "differences of what was measured"),
    "joint forces": ("`rj.joint_forces`", "one finite force for each joint"),
    "energy": ("`rj.energy`", "the work of all forces"),
    "animate": ("`rj.animate`", "what is measured at a marker"),
    "results": ("`Trajectory.save` and `rj.load`", "the same numbers to the bit"),
    "file": ("`Scene.save` and `rj.load_scene`", "the same run"),
    "check": ("`romjax check`", "the number of modes"),
}

FLEXIBLE = ("cart", "bending rod", "falling beams", "beam in space", "driven beam")
REFUSED = {
    # Level, where weight has no stiffness, and balls turn about any axis.
    ("equilibrium", "ball joints"): "no equilibrium",
    **{("local", name): "no body that deforms" for name in STRUCTURES if name not in FLEXIBLE},
}
# Subspaces that miss more of the motion than a run does, by the tolerance of their rank.
COARSE = {("galerkin", "five-bar"), ("galerkin", "beam in space"), ("minimal", "top")}

INTRODUCTION = """# What works on what

Every verb on every kind of mechanism. A tick is a value that a test compares with a right one;
words are those of the error by which romjax refuses what it cannot do; ≈ is a reduced model whose
error is larger than that of the run.
"""


def _cell(verb: str, name: str) -> str:
    if words := REFUSED.get((verb, name)):
        return f"“{words}”"
    return "≈" if (verb, name) in COARSE else "✓"


def text() -> str:
    """The page."""
    blocks = [INTRODUCTION, "| verb | does | beside |", "|---|---|---|"]
    blocks += [f"| {verb} | {does} | {right} |" for verb, (does, right) in VERBS.items()]
    blocks += ["", f"| mechanism | {' | '.join(VERBS)} |", "|---" * (len(VERBS) + 1) + "|"]
    for name, words in STRUCTURES.items():
        cells = " | ".join(_cell(verb, name) for verb in VERBS)
        blocks.append(f"| **{name}**: {words} | {cells} |")
    return "\n".join([*blocks, ""])


def write(app: "Sphinx") -> None:
    """The page, unless it is there."""
    if not PAGE.exists() or PAGE.read_text() != text():
        PAGE.write_text(text())


def setup(app: "Sphinx") -> dict[str, Any]:
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
