"""The models of the comparison of native code, and how they are clocked."""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from timing import Timed

import romjax as rj

TS = np.linspace(0.0, 1.0, 101)
CALLS = 10
ANGLE = 0.5  # [rad] of the rod at its start


def cart(formulation: Any, rank: int) -> rj.AbstractSystem:
    """A model of the cart with a flexible pendulum."""
    system = rj.assemble(rj.gallery.cart_pendulum())
    truth = rj.simulate(system, TS, rtol=1e-8, audit=False)
    return rj.reduce(system, rj.pod(truth, rank=rank), formulation)


MODELS: dict[str, Callable[[], rj.AbstractSystem]] = {
    "cart, minimal r = 3": lambda: cart(rj.Minimal(), 3),
    "cart, galerkin r = 5": lambda: cart(rj.Galerkin(), 5),
    "cart, full": lambda: rj.assemble(rj.gallery.cart_pendulum()),
    "chain of 1": lambda: rj.assemble(rj.gallery.chain(1)),
    "chain of 8": lambda: rj.assemble(rj.gallery.chain(8)),
    "chain of 64": lambda: rj.assemble(rj.gallery.chain(64)),
    "spinning top": lambda: rj.assemble(rj.gallery.spinning_top()),
    "spatial slider crank": lambda: rj.assemble(rj.gallery.spatial_slider_crank()),
}
SMALL = [name for name in MODELS if name != "chain of 64"]  # up to n = 24


def on_processor(call: Callable[[], Any], calls: int = CALLS) -> Callable[[], Timed]:
    """So many calls that clock themselves by the time of the processor."""

    def clocked() -> Timed:
        start = time.process_time()
        for _ in range(calls):
            result = jax.block_until_ready(call())
        return Timed(result, (time.process_time() - start) / calls)

    return clocked


def error(run: rj.Trajectory, reference: rj.Trajectory) -> float:
    """The largest error of positions and velocities, relative to the largest of them."""
    one, other = (np.concatenate([np.asarray(x.q), np.asarray(x.v)]) for x in (run, reference))
    return float(np.max(np.abs(one - other)) / np.max(np.abs(other)))


def loops_of(model: rj.CompiledModel, ts: np.ndarray) -> Callable[[], Any]:
    """The call of a run in C, as `simulate` of the model makes it, without what it makes of it."""
    native, asked = model._native, []
    run = native.run
    native.run = lambda *given: [asked.append(given), run(*given)][1]
    model.simulate(ts)
    native.run = run
    return lambda: run(*asked[0])


# A rod, as one body and by elements between nodes.

EI, ROTARY, STIFF = 0.1, 1e-3, 1e4  # [N m²], [kg m] and, of the elements, EA = GA [N]


class Element(rj.AbstractPotential):
    """An element of constant strain between two nodes, which are rigid bodies.

    Of the displacement u of the second one as the first sees it, on SE(2), the energy is
    ½ L (EA ε² + GA γ² + EI κ²) with strains of log u; Sonneville, Cardona, Brüls,
    doi:10.1016/j.cma.2013.10.008.
    """

    a: rj.Marker
    b: rj.Marker
    length: Float[Array, ""]
    stiffness: Float[Array, "3"]
    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def energy(self, t: Array, *poses: Any) -> Array:
        del t
        a, b = poses
        turn = b.angle - a.angle
        along, across = a.local(b.position)
        half = 0.5 * turn
        safe = jnp.where(jnp.abs(half) < 1e-4, 1.0, half)
        cot = jnp.where(jnp.abs(half) < 1e-4, 1 - half**2 / 3, safe / jnp.tan(safe))
        log = jnp.stack([cot * along + half * across, cot * across - half * along, turn])
        strain = log / self.length - jnp.array([1.0, 0.0, 0.0])
        return 0.5 * self.length * jnp.sum(self.stiffness * strain**2)

    def check(self) -> None:
        """Nothing to check: only this comparison makes them."""


def rod(angle: float, modes: int) -> rj.Scene:
    """One body on a hinge."""
    one = rj.Rod("rod", 1.0, 1.0, EI, modes, shapes="pinned-free", rotary=ROTARY, angle=angle)
    one = one.placed("start", rj.ground.pose((0.0, 0.0)))
    hinge = rj.Revolute(one.at("start"), rj.ground.at(), name="hinge")
    return rj.Scene([one], [hinge], [rj.Gravity((0.0, -9.81))])


def nodes(angle: float, count: int) -> rj.Scene:
    """As many elements, of which the masses are at their ends."""
    length, along = 1.0 / count, np.array([np.cos(angle), np.sin(angle)])
    bodies = []
    for i in range(count + 1):
        share = length if 0 < i < count else 0.5 * length
        place = i * length * along
        bodies.append(rj.RigidBody(f"n{i}", share, ROTARY * share, position=place, angle=angle))
    stiffness = jnp.array([STIFF, STIFF, EI])
    elements = [
        Element(
            a=bodies[i].at(), b=bodies[i + 1].at(), length=jnp.array(length), stiffness=stiffness
        )
        for i in range(count)
    ]
    hinge = rj.Revolute(bodies[0].at(), rj.ground.at(), name="hinge")
    return rj.Scene(bodies, [hinge], [rj.Gravity((0.0, -9.81)), *elements])


def tip_of_rod(scene: rj.Scene, run: rj.Trajectory) -> np.ndarray:
    """Where the free end is at all times [m]."""
    end = scene.bodies[0].at("end")
    return np.asarray(rj.measure(rj.assemble(scene), run, end).position)


def tip_of_nodes(run: rj.Trajectory) -> np.ndarray:
    """The position of the last node [m]."""
    return np.asarray(run.q)[:, -3:-1]


# First runs, each in a process of its own.


def first_runs(name: str, is_native: bool) -> float:
    """What a fresh process and the compiler take until a run is there [s]."""
    command = [sys.executable, Path(__file__), name, *(["native"] if is_native else [])]
    # Nothing else set: neither flags nor a cache.
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("XLA_", "JAX_"))}
    plain["ROMJAX_CACHE_DIR"] = ""
    done = subprocess.run(command, env=plain, capture_output=True, text=True, check=True)
    taken: float = json.loads(done.stdout.splitlines()[-1])
    return taken


def _spent() -> float:
    """The time of the processor that this process and those that it waited for took [s]."""
    each = [resource.getrusage(x) for x in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(x.ru_utime + x.ru_stime for x in each)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    named, native_too = sys.argv[1], len(sys.argv) > 2
    reduced = "r =" in named
    made = MODELS[named]() if reduced else None  # its training is not counted
    begun = _spent()
    made = made or MODELS[named]()
    rj.compile(made).simulate(TS) if native_too else rj.simulate(made, TS, audit=False)
    print(json.dumps(_spent() - begun))
