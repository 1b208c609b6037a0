"""What each effect adds to the cart-pendulum, part by part, and what an absent one costs; then what
the nodes of a mesh cost. Writes `effects.txt` beside this file.
"""

import dataclasses
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.extend import core
from tabulate import tabulate
from timing import least
from tqdm import tqdm

import romjax as rj

REPEATS = 40
STEPS = 10_000  # right-hand sides of a run
STEP = 1e-4  # [s] short enough for the fastest vibration of the cart-pendulum, above 1 kHz
SPIN = 1.0  # [rad/s] of the pendulum about its hinge at the start
MESHES = ((64, 16), (200, 50), (632, 158))  # elements along and across
MOST = 1.2  # required: 10⁵ nodes take at most this many times what 10³ take


def parts() -> dict[str, rj.Scene]:
    """The cart-pendulum, with one part more in each scene than in the one before."""
    chapter = rj.gallery.cart_pendulum()
    # In motion from the start, so that each scene has something to solve for.
    cart = dataclasses.replace(chapter.bodies[0], velocity=(0.1, 0.1))
    pendulum = dataclasses.replace(
        chapter.bodies[1], velocity=(0.1 + 0.4 * SPIN, 0.1), angular_velocity=SPIN
    )
    centre, hinge, tip = cart.at(), pendulum.at((0.0, 0.4)), pendulum.at((0.0, -0.4))
    # Across the rail, at a slant: the cart hits it and slides along it.
    wall = rj.ground.at((-0.004, -0.004), angle=-0.25)
    contact = rj.Contact(centre, wall, rj.Line(), stiffness=1e4, dissipation=0.2)
    names = ("spring", "damper", "force")
    more: dict[str, Any] = dict(zip(names, chapter.effects, strict=True)) | {
        "gravity": rj.Gravity(),
        "torsion spring": rj.TorsionSpring(hinge, centre, 1e-3),
        "torsion damper": rj.TorsionDamper(hinge, centre, 1e-5),
        "bushing": rj.Bushing(tip, rj.ground.at((0.0, -0.8)), (0.1, 0.1, 1e-4)),
        "cubic spring": rj.Spring(centre, rj.ground.at(), 10.0, cubic=1e3),
        "motor": rj.Motor(hinge, centre, rj.Sine(0.2, 1.0), 1e-3, 1e-5),
        "torque": rj.Torque(tip, rj.Sine(1e-4, 2.0)),
        "contact": contact,
    }
    effects = list(more.values())
    rough = [*effects[:-1], dataclasses.replace(contact, friction=rj.Friction(0.3, creep=0.01))]
    bodies = [cart, pendulum]
    damped = [cart, dataclasses.replace(pendulum, damping=0.01)]
    stiffened = [cart, dataclasses.replace(damped[1], stiffening=True)]
    scenes = {
        name: (bodies, effects[:count]) for count, name in enumerate(("bodies and joints", *more))
    }
    scenes |= {
        "friction": (bodies, rough),
        "modal damping": (damped, rough),
        "stiffening": (stiffened, rough),
    }
    return {name: rj.Scene(own, chapter.joints, some) for name, (own, some) in scenes.items()}


def equations(program: core.Jaxpr) -> int:
    """Of a traced program and all that are nested in it."""
    nested = jax.tree.leaves(
        [equation.params for equation in program.eqns],
        is_leaf=lambda x: isinstance(x, core.Jaxpr | core.ClosedJaxpr),
    )
    inner = [getattr(x, "jaxpr", x) for x in nested if isinstance(x, core.Jaxpr | core.ClosedJaxpr)]
    return len(program.eqns) + sum(map(equations, inner))


def run(scene: rj.Scene, step: float = STEP) -> tuple[Callable[[], Any], int, float]:
    """A compiled run, the equations of its right-hand side and the time to compile it [s].

    Semi-implicit Euler: one right-hand side and two sums a step, so that hardly anything else is
    measured, and stable for vibrations. The numbers of the scene are arguments: nothing of them is
    known to the compiler.
    """
    system = rj.assemble(scene)
    numbers, rest = eqx.partition((system, rj.Baumgarte.critical(jnp.array(20.0))), eqx.is_array)

    def acceleration(numbers: Any, t: Any, q: Any, v: Any) -> Any:
        system, stabilization = eqx.combine(numbers, rest)
        return system.acceleration(t, q, v, stabilization)[0]

    def motion(numbers: Any, q: Any, v: Any) -> Any:
        def advance(i: Any, state: Any) -> Any:
            q, v = state
            v = v + step * acceleration(numbers, step * i, q, v)
            return q + step * v, v

        return jax.lax.fori_loop(0, STEPS, advance, (q, v))

    state = (system.q0, system.v0)
    count = equations(jax.make_jaxpr(acceleration)(numbers, 0.0, *state).jaxpr)
    start = time.perf_counter()
    program = jax.jit(motion).lower(numbers, *state).compile()
    taken = time.perf_counter() - start
    if not all(bool(jnp.all(jnp.isfinite(x))) for x in program(numbers, *state)):
        raise RuntimeError("the run has grown without bound; its times mean nothing")
    return lambda: program(numbers, *state), count, taken


def added() -> tuple[list[list[str]], str]:
    """The table of the parts, and a sentence on the chapter's scene with and without a detour."""
    scenes = parts()
    chapter = scenes["force"]
    detour = rj.Scene(chapter.bodies, chapter.joints, scenes["friction"].effects)
    scenes["back"] = eqx.tree_at(lambda scene: scene.effects, detour, chapter.effects)
    calls, counts, compiled = zip(*(run(scene) for scene in tqdm(scenes.values())), strict=True)
    times = [1e9 * x / STEPS for x in least(calls, REPEATS)]
    names = list(scenes)[:-1]
    rows = [["part added", "equations", "ns", "more", "compile s"]]
    for i, name in enumerate(names):
        more = f"{times[i] - times[i - 1]:+.0f}" if i else ""
        rows.append([name, f"{counts[i]}", f"{times[i]:.0f}", more, f"{compiled[i]:.1f}"])
    own = names.index("force")
    back = (
        "The chapter's scene, which ends with the force, as it is and after all effects\n"
        f"of the table were added and taken out again: {counts[own]} and {counts[-1]} equations,\n"
        f"{times[own]:.0f} and {times[-1]:.0f} ns."
    )
    return rows, back


def plate(nx: int, ny: int) -> tuple[sp.csc_array, sp.csc_array, np.ndarray, np.ndarray]:
    """K, M, nodes and their grid of a rubber plate of 1 m by 0.25 m by 0.01 m in plane stress.

    Bilinear rectangles: all have the same matrices, from 2 × 2 Gauss points.
    """
    modulus, poisson, density, thickness = 1e8, 0.3, 1000.0, 0.01
    sides = np.array([1.0 / nx, 0.25 / ny])
    law = modulus / (1 - poisson**2) * np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, 0]])
    law[2, 2] = modulus / (2 * (1 + poisson))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    k, m = np.zeros((8, 8)), np.zeros((8, 8))
    for point in signs / np.sqrt(3):
        both = 1 + signs * point
        shape, slope = both.prod(axis=1) / 4, signs * both[:, ::-1] / 2 / sides
        strain, value = np.zeros((3, 8)), np.zeros((2, 8))
        strain[0, ::2], strain[1, 1::2] = slope.T
        strain[2, ::2], strain[2, 1::2] = slope.T[::-1]
        value[0, ::2] = value[1, 1::2] = shape
        volume = thickness * sides.prod() / 4
        k += volume * strain.T @ law @ strain
        m += volume * density * value.T @ value
    grid = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    own = (2 * corners.reshape(-1, 4, 1) + np.arange(2)).reshape(-1, 8)
    place = (np.repeat(own, 8, axis=1).ravel(), np.tile(own, (1, 8)).ravel())
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1) for n in (nx, ny)), indexing="ij"), axis=2)
    nodes = nodes.reshape(-1, 2) * sides - np.array([0.5, 0.125])
    full = [sp.coo_array((np.tile(x.ravel(), len(own)), place)).tocsc() for x in (k, m)]
    return full[0], full[1], nodes, grid


def meshes() -> tuple[list[list[str]], float]:
    """The table of the meshes, and the time with most nodes over that with least."""
    scenes, reduced, sizes = [], [], []
    for counts in tqdm(MESHES):
        stiffness, mass, nodes, grid = plate(*counts)
        ports = {"left": grid[0], "right": grid[-1]}
        start = time.perf_counter()
        body = rj.ModalBody.of_mesh("plate", stiffness, mass, nodes, ports, modes=6)
        reduced.append(time.perf_counter() - start)
        sizes.append(len(nodes))
        hinge = rj.Revolute(body.at("left"), rj.ground.at((-0.5, 0.0)))
        scenes.append(rj.Scene([body], [hinge], [rj.Gravity()]))
    fastest = max(float(jnp.max(scene.bodies[0].natural_frequencies())) for scene in scenes)
    runs = [run(scene, 0.5 / fastest) for scene in scenes]
    times = [1e9 * x / STEPS for x in least([call for call, *_ in runs], REPEATS)]
    rows = [["nodes", "modes", "equations", "ns", "reduce s"]]
    for scene, size, (_, count, _), taken, spent in zip(
        scenes, sizes, runs, times, reduced, strict=True
    ):
        modes = scene.bodies[0].modes
        rows.append([f"{size}", f"{modes}", f"{count}", f"{taken:.0f}", f"{spent:.1f}"])
    return rows, times[-1] / times[0]


def table(rows: list[list[str]]) -> str:
    """Rows under their header."""
    return tabulate(rows, headers="firstrow", tablefmt="plain", disable_numparse=True)


def main() -> None:
    """Measure everything and write the tables."""
    rj.speed_up_xla()
    jax.config.update("jax_enable_x64", True)
    rows, back = added()
    sizes, ratio = meshes()
    text = (
        "The cart-pendulum with effects added one by one: equations of the traced\n"
        f"acceleration, time of a right-hand side [ns] in a compiled run of {STEPS}\n"
        "(semi-implicit Euler, 1 s), what the part adds to it (negative where the\n"
        "compiler makes more of the larger program), time to compile.\n"
        f"Least of {REPEATS} interleaved runs. "
        f"jax {jax.__version__}, {os.cpu_count()} cores, {platform.machine()}.\n\n"
        f"{table(rows)}\n\n{back}\n\n"
        "A rubber plate, hinged at one end, under gravity, by the nodes of its mesh, and\n"
        "the time to reduce it to its modes:\n\n"
        f"{table(sizes)}\n\nMost nodes over least: {ratio:.2f} of the time (at most {MOST}).\n"
    )
    Path(__file__).with_suffix(".txt").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
