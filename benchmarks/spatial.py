"""Three dimensions beside MuJoCo and Exudyn: chains of ball joints and of hinges and a heavy top at
equal errors, and what a right-hand side of a flexible rotor costs.

Each mechanism moves for one second; errors are the largest of the positions of all centres of mass
at the end, against MuJoCo's finest run, and for the top against its published position. romjax is
called as a user calls it, `rj.simulate` with nothing set but the tolerance, and as `jax.jit` of it
without stabilisation; MuJoCo by its RK4 in minimal coordinates, Exudyn by its generalised-alpha
method. Least of interleaved second calls.
Writes `spatial.txt` beside this file.
"""

from collections.abc import Callable, Iterator

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import peers
import record
from effects import STEPS as EULER
from effects import run
from equal_error import at_error
from timing import Timed, least
from tqdm import tqdm

import romjax as rj

REPEATS = 9
SPIN = np.array([2.0, 0.0, 1.0])  # [rad/s] of the straight chain
MOMENTS = (0.02, 0.08, 0.09)  # [kg m²] of a bar
CHAINS = {1: 1e-6, 8: 1e-6, 32: 4e-7}  # bars, and the error at which they are compared
HINGED = {8: 1e-6, 32: 1e-6}
RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
STEPS = (50, 100, 200, 400, 800, 1600)  # of MuJoCo
FINEST = 20_000
EXUDYN_STEPS, EXUDYN_TOP = (1000, 4000, 8000), (16_000, 64_000)
SLOW = 1.0  # what takes longer is measured once [s]
# Bruls, Cardona, Arnold 2012: the position at 1 s, and what it is compared at.
TOP = np.array([0.17334396409838604, 0.6400885920705688, -0.7484907911335813])
TOP_STEPS, TOP_ERROR = (1000, 2000, 4000, 8000), 1e-6
MODES, MASSES = 12, 40  # of the rotor
LIMIT = 6.0  # [us] for its right-hand side on a hinge


def chain(bars: int, hinges: bool = False) -> rj.Scene:
    """Bars of 1 m and 1 kg along x, on ball joints, spinning as one about the first, or on hinges
    along y, at rest.
    """
    r, turning, axis = rj.spatial, SPIN * (not hinges), (0, 1, 0)
    bodies = [
        r.RigidBody(
            f"bar{i}",
            1.0,
            MOMENTS,
            position=(i + 0.5, 0, 0),
            velocity=np.cross(turning, [i + 0.5, 0, 0]),
            angular_velocity=turning,
        )
        for i in range(bars)
    ]
    ends = [rj.ground.at((0, 0, 0), axis=axis)]
    ends += [body.at((0.5, 0, 0), axis=axis) for body in bodies]
    starts = [body.at((-0.5, 0, 0), axis=axis) for body in bodies]
    joint = r.Revolute if hinges else r.Spherical
    joints = [joint(start, end) for start, end in zip(starts, ends, strict=False)]
    return rj.Scene(bodies, joints, [rj.Gravity((0, 0, -9.81))])


def top() -> rj.Scene:
    """The heavy top on a ball joint, at 150 rad/s."""
    r = rj.spatial
    body = r.RigidBody(
        "top",
        15.0,
        (0.234375, 0.46875, 0.234375),
        position=(0, 1, 0),
        velocity=(4.61538, 0, 0),
        angular_velocity=(0, 150, -4.61538),
    )
    pivot = r.Spherical(body.at((0, -1, 0)), rj.ground.at((0, 0, 0)))
    return rj.Scene([body], [pivot], [rj.Gravity((0, 0, -9.81))])


def rotor(hinged: bool) -> rj.Scene:
    """A shaft of point masses with elastic modes from 20 to 200 Hz, orthogonal to rigid motion."""
    random, r = np.random.default_rng(3), rj.spatial
    masses, points = random.uniform(0.5, 1.5, MASSES), random.normal(size=(MASSES, 3))
    points = (points - masses @ points / masses.sum()) * [0.1, 0.1, 0.5]
    around = [np.cross(axis, points) for axis in np.eye(3)]
    rigid = np.stack([*np.broadcast_to(np.eye(3)[:, None], (3, MASSES, 3)), *around], axis=2)
    root = np.sqrt(np.repeat(masses, 3))[:, None]
    across = np.concatenate([rigid.reshape(-1, 6), random.normal(size=(3 * MASSES, MODES))], 1)
    shapes = (np.linalg.qr(root * across)[0][:, 6:] / root).reshape(MASSES, 3, MODES)
    all_ = r.SpatialInertia.of_points(masses, points, shapes)
    # The others are zero, and the modal mass the identity.
    parts = {"stretch": all_.stretch, "spread": all_.spread, "gyration": all_.gyration}
    inertia = r.SpatialInertia(all_.mass, all_.moment, **parts)
    turned = np.concatenate([shapes[:1], random.normal(size=(1, 3, MODES))], axis=1)
    stiffness = (2 * np.pi * np.linspace(20, 200, MODES)) ** 2
    body = r.ModalBody(
        "rotor",
        inertia,
        stiffness,
        points[:1],
        turned,
        damping=0.01 * np.sqrt(stiffness),
        ports=("bearing",),
        position=-points[0],
    )
    joints = [r.Revolute(rj.ground.at((0, 0, 0)), body.at("bearing"))] if hinged else []
    return rj.Scene([body], joints, [rj.Gravity((0, 0, -9.81))])


def rotors() -> tuple[list[list[str]], dict[str, float]]:
    """The table of the rotor and its ratio."""
    runs = [run(rotor(hinged), 1e-5) for hinged in (False, True)]
    timed: list[Timed] = least([call for call, *_ in runs], REPEATS, name="rotor")
    us = [1e6 * one.least / EULER for one in timed]
    rows = [["rotor", "modes", "equations", "rhs us"]]
    for name, (_, count, _), one in zip(("free", "hinged"), runs, us, strict=True):
        rows.append([name, f"{MODES}", f"{count}", f"{one:.2f}"])
    return rows, {f"{LIMIT:g} us / right-hand side of a hinged rotor": LIMIT / us[1]}


def romjax_runs(scene: rj.Scene) -> dict[str, Callable[[float], np.ndarray]]:
    """Positions at the end as functions of the tolerance, as users call it and bare."""
    system, ts = rj.assemble(scene), jnp.array([0.0, 1.0])
    columns = np.array(system.structure.quaternions)[:, None] - np.array([3, 2, 1])

    @jax.jit
    def bare(q0: jax.Array, rtol: jax.Array) -> jax.Array:
        return rj.simulate(
            system,
            ts,
            q0=q0,
            rtol=rtol,
            solver=diffrax.Dopri8(),
            stabilization=None,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        ).q[-1]

    return {
        "simulate": lambda rtol: np.asarray(rj.simulate(system, ts, rtol=rtol).q[-1])[columns],
        "bare": lambda rtol: np.asarray(bare(system.q0, jnp.asarray(rtol)))[columns],
    }


def rows_of(
    scene: rj.Scene,
    others: dict[str, tuple[peers.Run, tuple[int, ...]]],
    truth: np.ndarray,
    name: str,
) -> dict[str, list[tuple[float, float]]]:
    """Of each method, errors and times [s] at all of its settings."""
    runs = [(kind, run, rtol) for kind, run in romjax_runs(scene).items() for rtol in RTOLS]
    calls = [lambda run=run, rtol=rtol: run(rtol) for _, run, rtol in runs]
    kinds = [kind for kind, *_ in runs]
    for kind, (other, steps) in others.items():
        calls += [lambda run=other, count=count: run(count) for count in steps]
        kinds += [kind] * len(steps)
    found: dict[str, list[tuple[float, float]]] = {}
    for kind, one in zip(kinds, least(calls, REPEATS, SLOW, name), strict=True):
        result = one.result[0] if isinstance(one.result, tuple) else one.result
        error = float(np.max(np.abs(np.asarray(result).reshape(truth.shape) - truth)))
        found.setdefault(kind, []).append((error, one.least))
    return found


def measure() -> Iterator[record.Section]:
    """A table of times at equal error, and its ratios."""
    missing = peers.missing()
    names = ["simulate", "bare", "MuJoCo", "Exudyn"]
    rows = [["mechanism", "error", *(f"{name} ms" for name in names)]]
    ratios: dict[str, float] = {}
    cases = {f"chain of {n}": (chain(n), error) for n, error in CHAINS.items()}
    cases |= {f"{n} hinges": (chain(n, True), error) for n, error in HINGED.items()}
    cases["heavy top"] = (top(), TOP_ERROR)
    for name, (scene, error) in tqdm(cases.items(), "spatial", leave=False, disable=None):
        published = name == "heavy top"
        others = dict[str, tuple[peers.Run, tuple[int, ...]]]()
        if "MuJoCo" not in missing:
            others["MuJoCo"] = peers.mujoco_in_space(scene), TOP_STEPS if published else STEPS
        if "Exudyn" not in missing:
            steps = EXUDYN_TOP if published else EXUDYN_STEPS
            others["Exudyn"] = peers.exudyn_in_space(scene), steps
        truth = TOP[None]
        if not published and "MuJoCo" in others:
            fine: Timed = others["MuJoCo"][0](FINEST)
            truth = fine.result[0]
        elif not published:
            truth = romjax_runs(scene)["bare"](1e-12)
        found = rows_of(scene, others, truth, name)
        times = {kind: at_error(points, error) for kind, points in found.items()}
        cells = [f"{1e3 * times[kind]:.2f}" if times.get(kind) else "-" for kind in names]
        rows.append([name, f"{error:.0e}", *cells])
        for kind in ("simulate", "bare"):
            for other in others:
                if times.get(other) and times.get(kind):
                    ratio = times[other] / times[kind]
                    ratios[f"{name} at {error:.0e}: {other} / {kind}"] = ratio
    yield record.Section(
        "One second of chains of ball joints, of chains of hinges and of the heavy top: times at\n"
        "an error of the positions [m]: `rj.simulate` with a tolerance and nothing else set, the\n"
        "same under `jax.jit` without stabilisation, MuJoCo's RK4 and Exudyn's generalised-alpha\n"
        f"method. Least of {REPEATS} interleaved calls; a dash: no run is that good.",
        rows,
        ratios,
        missing,
    )
    rows, ratios = rotors()
    yield record.Section(
        f"A rotor with {MODES} modes, free and on a hinge: time of a right-hand side in a\n"
        f"compiled run of {EULER} steps. Least of {REPEATS} interleaved runs.",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
