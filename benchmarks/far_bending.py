"""Rods that bend far: beside beams and elements between nodes, what reduced ones err by on motions
that they have not seen, and how right their derivatives are.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import bent_scenes
import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import native_models
import numpy as np
import record
from bent_scenes import CASES, MANY, Case
from timing import least

import romjax as rj

REPEATS, SLOW = 7, 0.5
RTOL, TIGHT = 1e-6, 1e-8
SETTINGS = {"solver": diffrax.Dopri8(), "audit": False, "max_steps": 200_000}
SPREAD = 3.0  # of the largest unseen error over that on the training
# The time at which derivatives are taken of the height of the tip [s], and differences by EI.
AT, SHARE = 0.6, 1e-3


class Path(NamedTuple):
    """A run, and where a point of a body was [m]."""

    run: rj.Trajectory
    places: np.ndarray

    @property
    def steps(self) -> int:
        """How many steps it took."""
        return int(self.run.stats.num_steps)


def path(system: Any, ts: np.ndarray, marker: rj.Marker, rtol: float) -> Path:
    """The run of a system, and the path of a marker."""
    run = rj.simulate(system, ts, rtol=rtol, **SETTINGS)
    return Path(run, np.asarray(rj.measure(system, run, marker).position))


def point(case: Case, scene: rj.Scene) -> rj.Marker:
    """Where errors of a case are measured."""
    (body,) = (body for body in scene.bodies if body.name == case.body)
    return body.at(case.point)


def off(one: np.ndarray, exact: np.ndarray) -> float:
    """The root of the mean square of an error over that of the path."""
    return float(np.linalg.norm(one - exact) / np.linalg.norm(exact))


def timed(systems: list[Any], ts: np.ndarray, name: str) -> list[float]:
    """The least times of runs [s] that take turns."""
    calls = [lambda one=one: rj.simulate(one, ts, rtol=RTOL, **SETTINGS) for one in systems]
    return [one.least for one in least(calls, REPEATS, SLOW, name, time.process_time)]


def beside_beams() -> record.Section:
    """A pendulum by a rod and by a beam of as many coordinates."""
    ts, shapes = np.linspace(0.0, 1.0, 101), {"modes": 4, "shapes": "pinned-free"}
    beam = rj.Beam("rod", 1.0, 1.0, EI=0.1, stiffening=True, **shapes)
    beam = beam.placed("start", bent_scenes.ORIGIN)
    hinge = rj.Revolute(beam.at("start"), rj.ground.at((0.0, 0.0)))
    scenes = [
        bent_scenes.pendulum(4, rotary=0.0),
        rj.Scene([beam], [hinge], [rj.Gravity()]),
        bent_scenes.pendulum(MANY, rotary=0.0),
    ]
    systems = [rj.assemble(scene) for scene in scenes]
    *paths, exact = (
        path(system, ts, scene.bodies[0].at("end"), rtol)
        for system, scene, rtol in zip(systems, scenes, (RTOL, RTOL, TIGHT), strict=True)
    )
    taken = timed(systems[:2], ts, "beams")
    errors = [off(one.places, exact.places) for one in paths]
    rows = [["model", "n", "steps", "error", "ms"]]
    for name, system, one, error, each in zip(
        ("rod", "beam, stiffening"), systems, paths, errors, taken, strict=False
    ):
        rows.append([name, system.n, one.steps, f"{error:.1e}", f"{1e3 * each:.2f}"])
    ratios = {
        "pendulum: error of beam / error of rod": errors[1] / errors[0],
        "pendulum: 4 x beam / rod": 4 * taken[1] / taken[0],
        "pendulum: 70 / steps": 70 / paths[0].steps,
    }
    words = "A pendulum whose tip turns by more than a radian against its hinge, four shapes each:"
    return record.Section(words, rows, ratios)


def beside_nodes() -> Iterator[record.Section]:
    """A pendulum and a four-bar by few shapes, and by elements between nodes."""
    soft = {"EI": 0.6, "torque": 0.8, "crank": 1.2}
    made = {
        "pendulum": (
            1.0,
            lambda modes: bent_scenes.pendulum(modes, angle=native_models.ANGLE),
            lambda: native_models.nodes(native_models.ANGLE, 64),
            (0, -1),
        ),
        "four-bar": (
            1.2,
            lambda modes: bent_scenes.four_bar(modes, **soft),
            lambda: bent_scenes.four_bar_of_nodes(32, **soft),
            (1, -2),
        ),
    }
    for name, (end, of_rod, of_nodes, (own, last)) in made.items():
        ts = np.linspace(0.0, end, 101)
        rods, nodes = [of_rod(modes) for modes in (4, MANY)], of_nodes()
        systems = [rj.assemble(scene) for scene in (*rods, nodes)]
        markers = [scene.bodies[own].at("end") for scene in rods] + [nodes.bodies[last].at()]
        few, exact, other = (
            path(*given)
            for given in zip(systems, [ts] * 3, markers, (RTOL, TIGHT, RTOL), strict=True)
        )
        taken = timed([systems[0], systems[2]], ts, name)
        rows = [["model", "n", "steps", "error", "ms"]]
        for words, system, one, each in zip(
            ("4 shapes", "nodes"), (systems[0], systems[2]), (few, other), taken, strict=True
        ):
            error = off(one.places, exact.places)
            rows.append([words, system.n, one.steps, f"{error:.1e}", f"{1e3 * each:.2f}"])
        ratios = {f"{name}: elements / 4 shapes": taken[1] / taken[0]}
        if name == "four-bar":
            ratios["four-bar: 100 / steps"] = 100 / few.steps
        count = len(nodes.bodies) - (3 if name == "four-bar" else 1)
        stiff = bent_scenes.STIFF if name == "four-bar" else native_models.STIFF
        text = f"A {name} by {count} elements between nodes, EA = GA = {stiff:g} N:"
        yield record.Section(text, rows, ratios)


def reduced(name: str) -> record.Section:
    """Natural modes, and POD of one motion, on that motion and on five others."""
    case = CASES[name]
    ts, every = np.linspace(0.0, case.end, 101), ({}, *case.others)
    scene = case.scene(case.many)
    full = [rj.assemble(case.scene(case.many, **numbers)) for numbers in every]
    exact = [path(system, ts, point(case, scene), TIGHT) for system in full]
    basis = rj.pod(exact[0].run)
    rows, ratios = [["shapes", "r", "trained", "unseen", "steps"]], {}
    for kind in ("natural", "POD"):
        for rank, most in case.ranks:
            models = _models(case, kind, rank, full, basis)
            paths = [path(model, ts, marker, RTOL) for model, marker in models]
            errors = [off(a.places, b.places) for a, b in zip(paths, exact, strict=True)]
            worst, steps = max(errors[1:]), max(one.steps for one in paths)
            rows.append([kind, rank, f"{errors[0]:.1e}", f"{worst:.1e}", steps])
            ratios[f"{name}: {most:g} / error of {kind} {rank}"] = most / max(errors)
            ratios[f"{name}: {SPREAD:g} x trained / unseen of {kind} {rank}"] = (
                SPREAD * errors[0] / worst
            )
    return record.Section(
        f"{name}, of {case.many} shapes; errors on the training and the largest of five other\n"
        "starts and loads:",
        rows,
        ratios,
    )


def _models(
    case: Case, kind: str, rank: int, full: list[Any], basis: Any
) -> Iterator[tuple[Any, rj.Marker]]:
    """The reduced model at each start and load, and where it is measured."""
    if kind == "natural":
        for numbers in ({}, *case.others):
            scene = case.scene(rank, **numbers)
            yield rj.assemble(scene), point(case, scene)
        return
    scene = case.scene(case.many)
    ranks = tuple(rank if body.name == case.body else 0 for body in scene.bodies)
    model = rj.reduce(full[0], basis, rj.Local(ranks=ranks))
    for system in full:
        yield model.with_full(system).starting_at(system.q0, system.v0), point(case, scene)


def derivatives() -> record.Section:
    """By the stiffness of a pendulum, of the height of its tip, full and reduced."""
    EI, ts = 0.1, np.linspace(0.0, AT, 31)
    full = bent_scenes.pendulum(MANY)
    trained = rj.simulate(rj.assemble(full), ts, rtol=TIGHT, **SETTINGS)
    model = rj.reduce(rj.assemble(full), rj.pod(trained), rj.Local(ranks=(6,)))

    few = bent_scenes.pendulum(6)
    made: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {
        f"natural {MANY}": (full, _stiffer),
        "natural 6": (few, _stiffer),
        "POD 6": ((full, model), lambda pair, EI: pair[1].with_full(_stiffer(pair[0], EI))),
    }
    rows, found = [["model", "height", "elasticity", "reverse - differences"]], {}
    for name, (parts, of) in made.items():
        height = _height(parts, of, ts, full.bodies[0].at("end"))
        values = eqx.filter(parts, eqx.is_inexact_array)
        both = rj.jit(jax.value_and_grad(height))
        value, slope = both(EI, values)
        # The program that differentiates, since another one would take as long to compile.
        apart = float(slope) / _differences(lambda x: both(x, values)[0], EI) - 1  # noqa: B023
        found[name] = EI / float(value) * float(slope), abs(apart)
        elasticity = f"{found[name][0]:.5f}"
        rows.append([name, f"{float(value):.6f}", elasticity, f"{apart:.1e}"])
    right = found[f"natural {MANY}"][0]
    ratios = {}
    for name in ("natural 6", "POD 6"):
        ratios[f"2e-3 / error of elasticity of {name}"] = 2e-3 / abs(found[name][0] - right)
        ratios[f"1e-6 / reverse - differences of {name}"] = 1e-6 / found[name][1]
    return record.Section(
        f"The height J of the pendulum's tip [m] after {AT:g} s, and EI/J dJ/dEI; the relative\n"
        "difference of reverse mode from differences of the same model:",
        rows,
        ratios,
    )


def _stiffer(scene: rj.Scene, EI: Any) -> Any:
    return rj.assemble(eqx.tree_at(lambda x: x.bodies[0].EI, scene, EI))


def _height(
    parts: Any, of: Callable[[Any, Any], Any], ts: np.ndarray, marker: rj.Marker
) -> Callable[[Any, Any], Any]:
    """The height by EI and by all other numbers, which are no constants of its program."""
    rest = eqx.filter(parts, eqx.is_inexact_array, inverse=True)

    def height(EI: Any, values: Any) -> Any:
        system = of(eqx.combine(values, rest), EI)
        run = rj.simulate(system, jnp.asarray(ts), rtol=1e-11, **SETTINGS)
        return rj.measure(system, run, marker).position[-1, 1]

    return height


def _differences(function: Callable[[Any], Any], at: float) -> float:
    """The derivative by differences of sixth order."""
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    size = SHARE * at
    pairs = {k: float(function(at + k * size)) - float(function(at - k * size)) for k in weights}
    return sum(weights[k] * pairs[k] for k in weights) / size


def measure() -> Iterator[record.Section]:
    """Beams, elements, reduction and derivatives."""
    yield record.Section(
        f"Dopri8, relative tolerance {RTOL:g}; errors of the path of one point, against rods of\n"
        f"more shapes at {TIGHT:g}, over its root mean square; least times of a processor of\n"
        f"{REPEATS} interleaved runs."
    )
    yield beside_beams()
    yield from beside_nodes()
    for name in CASES:
        yield reduced(name)
    yield derivatives()


if __name__ == "__main__":
    record.main(measure, setup=record.begin_as_users)
