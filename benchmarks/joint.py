"""Joint coordinates: chains and closed loops beside all coordinates and MuJoCo at equal errors,
batches, the drift of energy, and digits far from the origin.

Each mechanism moves for a second. romjax is called as a user calls it, `rj.simulate` with nothing
set but the tolerance; errors are the largest of all coordinates of chains in the plane and of
loops, and of the positions of centres of mass of chains in space, and of an arm, against MuJoCo's
finest run. The times are those of the processor, least of interleaved second calls.
Writes `joint.txt` beside this file.
"""

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import peers
import record
import spatial
from equal_error import at_error
from timing import least
from tqdm import tqdm

import romjax as rj

REPEATS = 20  # calls of half a millisecond: few of them are undisturbed on a busy machine
RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
STEPS = (50, 100, 200, 400, 800, 1600)  # of MuJoCo
FINEST = 20_000
IN_SPACE = {8: (1e-6,), 32: (1e-6,)}  # links, and the errors at which they are compared
IN_PLANE = dict.fromkeys((8, 32, 128), (1e-5, 1e-7))
ARM, OF_ARM = Path(__file__).parent / "arm.xml", (2e-8,)  # seven hinges with dampers and rotors
LOOPS = (1e-6,)
CORNERS = np.array([[0, 0, 0], [0.2, 0, 1], [1.2, 0, 1], [1.4, 0, 0]])  # of the four-bar
LANES, LONG, FAR = 64, 100.0, 1e3  # of a batch; [s] of the drift; [m] from the origin


class Case(NamedTuple):
    """A mechanism, the errors at which it is compared, and MuJoCo's run of it, if any."""

    scene: rj.Scene
    errors: tuple[float, ...]
    other: peers.Run | None = None


def four_bar() -> rj.Scene:
    """Three bars on four parallel hinges in space, under inclined gravity."""
    r, y = rj.spatial, (0, 1, 0)
    bars, joints, end = [], [], rj.ground.at(CORNERS[0], axis=y)
    for i, (a, b) in enumerate(itertools.pairwise(CORNERS)):
        bars.append(r.RigidBody(f"bar{i}", 1.0, spatial.MOMENTS, position=(a + b) / 2))
        joints.append(r.Revolute(bars[-1].at((a - b) / 2, axis=y), end))
        end = bars[-1].at((b - a) / 2, axis=y)
    joints.append(r.Revolute(rj.ground.at(CORNERS[-1], axis=y), end))
    return rj.Scene(bars, joints, [rj.Gravity((3.0, 0, -9.81))])


def without_stops(scene: rj.Scene) -> rj.Scene:
    """A scene without the ranges of its joints, which MuJoCo has with a law of its own."""
    others = [effect for effect in scene.effects if not isinstance(effect, rj.JointStop)]
    return rj.Scene(scene.bodies, scene.joints, others)


def cases() -> Iterator[tuple[str, dict[str, Case]]]:
    """All mechanisms by name, with what they are together."""
    other, found = "MuJoCo" not in peers.missing(), dict[str, Case]()
    for n, errors in IN_SPACE.items():
        scene = spatial.chain(n, hinges=True)
        run = peers.mujoco_in_space(scene, time.process_time) if other else None
        found[f"{n} hinges in space"] = Case(scene, errors, run)
    run = peers.mujoco_of_file(ARM, time.process_time) if other else None
    if other:
        found["arm of 7 hinges"] = Case(
            without_stops(rj.load_scene(ARM, start="home")), OF_ARM, run
        )
    yield "chains of hinges and an arm in space", found
    yield (
        "closed loops in space",
        {
            "Bricard": Case(rj.gallery.bricard(), LOOPS),
            "four-bar in space": Case(four_bar(), LOOPS),
            "slider crank in space": Case(rj.gallery.spatial_slider_crank(), LOOPS),
        },
    )
    found = {}
    for n, errors in IN_PLANE.items():
        run = peers.mujoco_chain(n, time.process_time) if other else None
        found[f"{n} bars in the plane"] = Case(rj.gallery.chain(n), errors, run)
    yield "chains in the plane", found


def compared(name: str, case: Case) -> dict[str, list[tuple[float, float]]]:
    """Of each way, errors and times [s] at all of its settings."""
    full, ts = rj.assemble(case.scene), jnp.linspace(0.0, 1.0, 2)
    systems = {"joint": rj.reduce(full, formulation="joint"), "all": full}
    in_space = case.other is not None and bool(full.structure.quaternions)
    columns = np.arange(full.n)
    if in_space:
        columns = (np.array(full.structure.quaternions)[:, None] - np.array([3, 2, 1])).ravel()

    def run(system: Any, rtol: float, **options: Any) -> np.ndarray:
        # Rows by NumPy: to index an array of JAX is a program of its own.
        return np.asarray(rj.simulate(system, ts, rtol=rtol, **options).q)[-1, columns]

    if in_space and case.other is not None:
        truth = np.ravel(case.other(FINEST).result[0])
    else:
        fine = {"rtol": 1e-11, "solver": diffrax.Dopri8(), "max_steps": 10**5, "audit": False}
        truth = run(full, **fine)
    ways: list[tuple[str, Callable[[], Any]]] = [
        (kind, lambda system=system, rtol=rtol: run(system, rtol))
        for kind, system in systems.items()
        for rtol in RTOLS
    ]
    if case.other is not None:
        ways += [("MuJoCo", lambda n=n, run=case.other: run(n)) for n in STEPS]
    found: dict[str, list[tuple[float, float]]] = {}
    timed = least([call for _, call in ways], REPEATS, name=name, clock=time.process_time)
    for (kind, _), one in zip(ways, timed, strict=True):
        result = one.result[0] if isinstance(one.result, tuple) else one.result
        error = float(np.max(np.abs(np.ravel(result) - truth)))
        found.setdefault(kind, []).append((error, one.least))
    return found


def per_lane(system: rj.AbstractSystem) -> float:
    """The time of the single runs of all lanes, one by one, over that of their batch."""
    ts = jnp.linspace(0.0, 1.0, 2)

    def end(share: jax.Array) -> jax.Array:
        return rj.simulate(system, ts, v0=system.v0 + share, rtol=1e-6).q[-1]

    together, alone = rj.jit(jax.vmap(end)), rj.jit(end)
    shares = 0.01 * jnp.arange(LANES)
    # Lanes that move faster take more steps, so that no single one stands for them.
    each = list(shares)
    calls = [lambda: together(shares), lambda: [alone(share) for share in each]]
    lanes, singles = least(calls, REPEATS, clock=time.process_time)
    return singles.least / lanes.least


def drift(system: rj.AbstractSystem) -> float:
    """The largest change of energy over a long run, as a share of the largest kinetic energy."""
    ts = np.linspace(0.0, LONG, 201)
    run = rj.simulate(system, ts, rtol=1e-9, stabilization=None, max_steps=10**6)
    energies = rj.energy(system, run)
    total = np.asarray(energies.total)
    return float(np.max(np.abs(total - total[0])) / np.max(np.asarray(energies.kinetic)))


def lost_far_away() -> tuple[float, float]:
    """The relative errors of accelerations of a chain far from the origin, in joint coordinates and
    in all.
    """
    errors, near = [], spatial.chain(8, hinges=True)
    shift = np.array([FAR, -FAR, FAR])
    bodies = [
        rj.spatial.RigidBody(f"bar{i}", 1.0, spatial.MOMENTS, position=shift + place)
        for i, place in enumerate(np.arange(8)[:, None] * [1.0, 0, 0] + [0.5, 0, 0])
    ]
    ends = [rj.ground.at(shift, axis=(0, 1, 0))]
    ends += [body.at((0.5, 0, 0), axis=(0, 1, 0)) for body in bodies]
    joints = [
        rj.spatial.Revolute(body.at((-0.5, 0, 0), axis=(0, 1, 0)), end)
        for body, end in zip(bodies, ends, strict=False)
    ]
    systems = [rj.assemble(near), rj.assemble(rj.Scene(bodies, joints, near.effects))]
    models = [rj.reduce(system, formulation="joint") for system in systems]
    z, w = (np.random.default_rng(k).normal(size=models[0].n) for k in range(2))
    for in_joints in (True, False):
        found = []
        for model in models:
            q, v = model.reconstruct(0.0, z, w)
            a = rj.jit(model.acceleration)(0.0, z, w) if in_joints else None
            if a is None:
                a = rj.jit(model.full.acceleration)(0.0, q, v)
            found.append(np.asarray(a[0]))
        errors.append(np.max(np.abs(found[1] - found[0])) / np.max(np.abs(found[0])))
    return float(errors[0]), float(errors[1])


def at_equal_errors(what: str, mechanisms: dict[str, Case]) -> record.Section:
    """The table of some mechanisms."""
    rows = [["mechanism", "error", "joint ms", "all ms", "MuJoCo ms"]]
    ratios: dict[str, float] = {}
    for name, case in tqdm(mechanisms.items(), "joint", leave=False, disable=None):
        found = compared(name, case)
        for error in case.errors:
            times = {kind: at_error(points, error) for kind, points in found.items()}
            cells = [times.get(kind) for kind in ("joint", "all", "MuJoCo")]
            rows.append([name, f"{error:.0e}", *(f"{1e3 * x:.2f}" if x else "-" for x in cells)])
            for kind in ("all", "MuJoCo"):
                if (own := times.get("joint")) and (given := times.get(kind)):
                    ratios[f"{name} at {error:.0e}: {kind} / joint"] = given / own
    text = (
        f"One second of {what} by joint coordinates and by all coordinates,\n"
        "`rj.simulate` with a tolerance and nothing else set, and by MuJoCo's RK4: times of the\n"
        f"processor at equal errors [m, rad]. Least of {REPEATS} interleaved calls; a dash: no\n"
        "run is that good."
    )
    return record.Section(text, rows, ratios, peers.missing())


def measure() -> Iterator[record.Section]:
    """Tables of times, and one of what else is asked."""
    for what, mechanisms in cases():
        yield at_equal_errors(what, mechanisms)
    chain = rj.reduce(rj.assemble(spatial.chain(8, hinges=True)), formulation="joint")
    top = rj.reduce(rj.assemble(spatial.chain(1)), formulation="joint")
    lanes, energy, (joint, everything) = per_lane(chain), drift(top), lost_far_away()
    yield record.Section(
        f"A chain of 8 hinges in {LANES} lanes of a batch; the energy of a bar on a ball joint\n"
        f"over {LONG:g} s at rtol = 1e-9 as a share of its kinetic energy; and how accelerations\n"
        f"of 8 hinges change {FAR:g} lengths from the origin.",
        [
            ["quantity", "joint", "all"],
            ["single run / lane", f"{lanes:.2f}", "-"],
            ["drift of energy", f"{energy:.1e}", "-"],
            ["far from the origin", f"{joint:.1e}", f"{everything:.1e}"],
        ],
        {
            "8 hinges: single run / lane of 64": lanes,
            "1e-9 / drift of energy in 100 s": 1e-9 / energy,
        },
    )


if __name__ == "__main__":
    record.main(measure)
