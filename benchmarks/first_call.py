"""How long the first answer takes, in a process of its own with nothing set and nothing cached:
assembly, tracing, compiling and running; the same in the next process, which finds the programs on
disk; and the second call. Writes `first_call.txt` beside this file.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import linkages
import peers
import record
from tqdm import tqdm

# What it must not exceed [s] on two quiet cores; ratios are of these to what is measured.
LIMITS = {
    "cart-pendulum": 3.5,
    "chain of 1": 2.0,
    "chain of 8": 2.0,
    "chain of 64": 2.0,
    "slider crank": 4.0,
    "cart-pendulum, galerkin": 2.5,
    "cart-pendulum, minimal": 2.5,
    "rod": 4.0,
    "spatial slider crank": 6.0,
    "flyball governor": 8.0,
    "spatial arm": 10.0,
    "spatial rod": 8.0,
    "hinges in space, joint": 3.0,
    "robot file": 6.0,
    "robot file, scene": 0.2,
}
FROM_DISK = 1.0  # [s] what each of them must not exceed in the next process
# Other programs and methods for the same, and derivatives, to compare with: not limited.
COMPARED = {
    "cart-pendulum, Kvaerno5": "cart-pendulum",
    "cart-pendulum, forward": "cart-pendulum",
    "cart-pendulum, reverse": "cart-pendulum",
    "chain of 8, Kvaerno5": "chain of 8",
    "chain of 8, forward": "chain of 8",
    "chain of 8, reverse": "chain of 8",
    "chain of 8, MuJoCo": "chain of 8",
    "chain of 8, Exudyn": "chain of 8",
}
SECONDS = 10  # calls after the first; the least counts
ROBOT = Path(__file__).parent / "arm.xml"  # of seven hinges with stops


def call(name: str) -> Callable[[], Any]:
    """What is timed; what must be there before is made here."""
    scene_name, _, what = name.partition(", ")
    if what in ("MuJoCo", "Exudyn"):
        chain = peers.mujoco_chain if what == "MuJoCo" else peers.exudyn_chain
        return lambda: chain(8)(1000).result
    import diffrax
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    import romjax as rj

    jax.config.update("jax_enable_x64", True)
    ts = jnp.linspace(0.0, 1.0, 301)

    if scene_name == "robot file":
        # Its reading is part of the answer, or all that is asked for.
        if what == "scene":
            return lambda: rj.load_scene(ROBOT)
        return lambda: rj.simulate(rj.assemble(rj.load_scene(ROBOT)), ts).q
    scene = made(scene_name)
    if what == "joint":
        return lambda: rj.simulate(rj.reduce(rj.assemble(scene), formulation="joint"), ts).q
    if what == "Kvaerno5":
        return lambda: rj.simulate(rj.assemble(scene), ts, solver=diffrax.Kvaerno5()).q
    if what in ("galerkin", "minimal"):
        full = rj.assemble(scene)
        basis = rj.pod(rj.simulate(full, ts, rtol=1e-8), rank=5 if what == "galerkin" else 3)
        return lambda: rj.simulate(rj.reduce(full, basis, what), ts).q
    if what in ("forward", "reverse"):
        adjoint = diffrax.ForwardMode() if what == "forward" else None

        def end(factor: Any) -> Any:
            heavier = [factor * body.mass for body in scene.bodies]
            other = eqx.tree_at(lambda scene: [body.mass for body in scene.bodies], scene, heavier)
            return jnp.sum(rj.simulate(rj.assemble(other), ts, adjoint=adjoint).q[-1])

        gradient = jax.jit({"forward": jax.jacfwd, "reverse": jax.grad}[what](end))
        return lambda: gradient(1.0)
    return lambda: rj.simulate(rj.assemble(scene), ts).q


def made(name: str) -> Any:
    """The scene of this name."""
    import romjax as rj

    if name.startswith("chain"):
        return rj.gallery.chain(int(name.split()[-1]))
    if name in ("cart-pendulum", "spatial slider crank", "flyball governor", "spatial arm"):
        return getattr(rj.gallery, name.replace("-", "_").replace(" ", "_"))()
    if name == "hinges in space":
        import spatial

        return spatial.chain(8, hinges=True)
    if name.endswith("rod"):
        return hanging(rj, name.startswith("spatial"))
    rigid = linkages.slider_crank((0.25, 0.433), (1.5, 0.0), 0.01)
    crank, rod, slider = rigid.bodies
    length = float(rod.extent[0])
    beam = rj.Beam(
        rod.name,
        mass=rod.mass,
        length=length,
        frequencies=[30.0, 120.0],
        position=rod.position,
        angle=rod.angle,
        velocity=rod.velocity,
        angular_velocity=rod.angular_velocity,
    )
    return rj.Scene([crank, beam, slider], rigid.joints, rigid.effects)


def hanging(rj: Any, in_space: bool) -> Any:
    """A rod that falls from the level, on a hinge in the plane or on a ball joint in space."""
    if in_space:
        r, sections = rj.spatial, (0.02, 0.01, 0.015)
        rod = r.Rod("rod", 0.7, 1.3, (2.0, 1.5), 1.0, sections, 7, position=(0.65, 0.0, 0.0))
        joint = r.Spherical(rod.at("start"), rj.ground.at((0.0, 0.0, 0.0)))
        return rj.Scene([rod], [joint], [rj.Gravity((0.0, 0.0, -9.81))])
    rod = rj.Rod("rod", 1.0, 1.0, 0.1, 4, rotary=1e-3, position=(0.5, 0.0))
    return rj.Scene([rod], [rj.Revolute(rod.at("start"), rj.ground.at())], [rj.Gravity()])


def clock(name: str) -> tuple[float, float]:
    """The first and the least of the other calls [s], of this process."""
    timed, taken = call(name), []
    for _ in range(1 + SECONDS):
        start = time.perf_counter()
        result = timed()
        getattr(result, "block_until_ready", lambda: None)()
        taken.append(time.perf_counter() - start)
    return taken[0], min(taken[1:])


def twice(name: str) -> tuple[float, float, float]:
    """The first calls of two processes one after the other, of which the second finds the programs
    of the first on disk, and the least of the other calls [s].
    """
    with tempfile.TemporaryDirectory() as folder:
        first, second = alone(name, folder)
        from_disk, _ = alone(name, folder)
    return first, from_disk, second


def alone(name: str, folder: str) -> tuple[float, float]:
    """What a fresh process takes that keeps compiled programs in this folder."""
    command = [sys.executable, Path(__file__), "--clock", name]
    # Nothing else set: neither flags nor a cache of JAX's.
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("XLA_", "JAX_"))}
    plain["ROMJAX_CACHE_DIR"] = folder
    done = subprocess.run(command, env=plain, capture_output=True, text=True, check=True)
    first, second = json.loads(done.stdout.splitlines()[-1])
    return first, second


def measure() -> Iterator[record.Section]:
    """The table of first and second calls."""
    missing = peers.missing()
    names = [*LIMITS, *COMPARED]
    names = [name for name in names if name.partition(", ")[2] not in missing]
    if "MuJoCo" in missing:  # whose parser reads robots
        names = [name for name in names if not name.startswith("robot")]
    bar = tqdm(names, "first calls", leave=False, disable=None)
    taken = {name: twice(name) for name in bar}
    rows = [["what", "first s", "limit s", "from disk s", "second ms"]]
    for name, (first, from_disk, second) in taken.items():
        limit = LIMITS.get(name, math.nan)
        times = [f"{first:.2f}", record.short(limit), f"{from_disk:.2f}", f"{1e3 * second:.2f}"]
        rows.append([name, *times])
    limited = [name for name in LIMITS if name in taken]
    ratios = {f"limit / first call of {name}": LIMITS[name] / taken[name][0] for name in limited}
    ratios |= {f"limit / {name} from disk": FROM_DISK / taken[name][1] for name in limited}
    for name, own in COMPARED.items():
        if name in taken:
            ratios[f"first call: {name} / own"] = taken[name][0] / taken[own][0]
    yield record.Section(
        "The first call in a fresh process with nothing set and no cache: assembly,\n"
        "tracing, compiling and 301 outputs of one second at the default tolerance; of a\n"
        "reduced model `reduce` too, not the run that its basis is made from; of a robot\n"
        "its file, which the row `scene` reads alone. The next\n"
        f"process finds programs on disk; {FROM_DISK:g} s is its limit. The second call is the\n"
        f"least of {SECONDS}, with its assembly.",
        rows,
        ratios,
        missing,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--clock")
    options, rest = parser.parse_known_args()
    if options.clock:
        print(json.dumps(clock(options.clock)))
    else:
        sys.argv[1:] = rest
        record.main(measure)
