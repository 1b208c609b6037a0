"""What size costs: chains of 4 to 128 rigid bars beside MuJoCo, flexible plates of a thousand to
a hundred thousand nodes. Writes `scaling.txt` beside this file.
"""

import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import peers
import record
import scipy.sparse as sp
from effects import STEPS, run
from timing import Timed, least
from tqdm import tqdm

import romjax as rj

BARS = (4, 8, 16, 32, 64, 128)
EULER = 2000  # right-hand sides of a run of a chain
DOPRI8 = 100  # steps of a run of a chain
REPEATS = 10
SLOW = 1.0  # [s] what takes longer is measured once
MESHES = ((64, 16), (200, 50), (632, 158))  # elements along and across: 10^3, 10^4, 10^5 nodes
MESH_REPEATS = 40


def stepped(bars: int) -> tuple[Callable[[], Any], float]:
    """A compiled run of a chain in fixed steps of Dopri8, and the time to compile [s]."""
    system = rj.assemble(rj.gallery.chain(bars))

    def motion(q0: Any) -> Any:
        return rj.simulate(
            system,
            jnp.array([0.0, 1.0]),
            q0=q0,
            solver=diffrax.Dopri8(),
            dt=1.0 / DOPRI8,
            stabilization=None,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        ).q

    start = time.perf_counter()
    program = jax.jit(motion).lower(system.q0).compile()
    return functools.partial(program, system.q0), time.perf_counter() - start


def chains() -> tuple[list[list[str]], dict[str, float]]:
    """The table of the chains and its ratios."""
    rows = [["bars", "equations", "rhs us", "step us", "build s", "build s", "MuJoCo us"]]
    calls, counts, compiled = {}, {}, {}
    for bars in tqdm(BARS, "chains", leave=False, disable=None):
        calls["rhs", bars], counts[bars], euler = run(rj.gallery.chain(bars), steps=EULER)
        calls["step", bars], dopri8 = stepped(bars)
        compiled[bars] = euler, dopri8
        if "MuJoCo" not in peers.missing():
            # 1000 steps in one second, of four right-hand sides each.
            calls["MuJoCo", bars] = functools.partial(peers.mujoco_chain(bars), 1000)
    timed: list[Timed] = least(list(calls.values()), REPEATS, SLOW, "chains")
    parts = {"rhs": EULER, "step": DOPRI8, "MuJoCo": 4000}
    us = {key: 1e6 * one.least / parts[key[0]] for key, one in zip(calls, timed, strict=True)}
    for bars in BARS:
        cells = (f"{us[kind, bars]:.2f}" if (kind, bars) in us else "-" for kind in parts)
        own, step, other = cells
        builds = (f"{x:.1f}" for x in compiled[bars])
        rows.append([f"{bars}", f"{counts[bars]}", own, step, *builds, other])
    ratios = {
        "right-hand side of 32 bars / of 128": us["rhs", 32] / us["rhs", 128],
        "step of 32 bars / of 128": us["step", 32] / us["step", 128],
        "program of 4 bars / of 128, to compile": compiled[4][1] / compiled[128][1],
    }
    for bars in (8, 32, 128):
        if ("MuJoCo", bars) in us:
            name = f"rhs of {bars} bars: MuJoCo / romjax"
            ratios[name] = us["MuJoCo", bars] / us["rhs", bars]
    return rows, ratios


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


def meshes() -> tuple[list[list[str]], dict[str, float]]:
    """The table of the meshes and its ratio."""
    scenes, reduced, sizes = [], [], []
    for counts in tqdm(MESHES, "meshes", leave=False, disable=None):
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
    timed = least([call for call, *_ in runs], MESH_REPEATS, name="meshes")
    times = [1e9 * one.least / STEPS for one in timed]
    rows = [["nodes", "modes", "equations", "rhs ns", "reduce s"]]
    for i, scene in enumerate(scenes):
        modes, count = scene.bodies[0].modes, runs[i][1]
        row = [f"{sizes[i]}", f"{modes}", f"{count}", f"{times[i]:.0f}", f"{reduced[i]:.1f}"]
        rows.append(row)
    return rows, {"10^3 nodes / 10^5": times[0] / times[-1]}


def measure() -> Iterator[record.Section]:
    """Chains, then meshes."""
    rows, ratios = chains()
    yield record.Section(
        "Chains of rigid bars: equations of the traced acceleration; time of a right-hand side\n"
        f"(rhs) in a compiled run of {EULER}, by semi-implicit Euler with Baumgarte's\n"
        f"stabilisation; of a step of Dopri8 in a simulation of {DOPRI8}\n"
        "steps; time to compile the one and the other (build); a fourth of an RK4 step of MuJoCo.\n"
        f"Least of {REPEATS} interleaved runs, or of one where it takes longer than {SLOW:g} s.",
        rows,
        ratios,
        peers.missing(),
    )
    rows, ratios = meshes()
    yield record.Section(
        "A rubber plate, hinged at one end, under gravity, by the nodes of its mesh, and the time\n"
        f"to reduce it to its modes. Least of {MESH_REPEATS} interleaved runs:",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
