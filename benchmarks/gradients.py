"""What gradients cost: time of reverse mode by a whole scene and of forward mode by two of its
numbers, in runs, and memory by the number of steps. Writes `gradients.txt` beside this file.
"""

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from tabulate import tabulate
from timing import least
from tqdm import tqdm

import romjax as rj

REPEATS = 7
RTOL = 1e-6
STEPS = (1_000, 10_000, 100_000)

# Scene, two of its numbers, method, end of the simulated time [s].
CASES = {
    "cart-pendulum": (
        rj.gallery.cart_pendulum,
        lambda scene: (scene.effects[0].stiffness, scene.bodies[0].mass),
        rj.Rodas5P(),
        1.0,
    ),
    "chain of 2": (
        lambda: rj.gallery.chain(2),
        lambda scene: (scene.bodies[0].mass, scene.bodies[1].inertia),
        diffrax.Dopri8(),
        1.0,
    ),
    "chain of 8": (
        lambda: rj.gallery.chain(8),
        lambda scene: (scene.bodies[0].mass, scene.bodies[7].inertia),
        diffrax.Dopri8(),
        1.0,
    ),
}


def end(scene: rj.Scene, solver: diffrax.AbstractSolver, ts: Any, **settings: Any) -> jax.Array:
    """A number of the last state."""
    run = rj.simulate(rj.assemble(scene), ts, solver=solver, throw=False, **settings)
    return jnp.sum(run.q[-1]) + jnp.sum(run.v[-1])


def compiled(function: Callable, *arguments: Any) -> tuple[Callable[[], Any], float]:
    """A call of the compiled function, and the time to compile [s]."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return lambda: program(*arguments), time.perf_counter() - start


def costs(name: str) -> list[str]:
    """The row of a scene: milliseconds of the run, and gradients in units of it."""
    make, two, solver, span = CASES[name]
    values, rest = eqx.partition(make(), eqx.is_inexact_array)
    ts = jnp.linspace(0.0, span, 11)

    def value(values: Any) -> jax.Array:
        return end(eqx.combine(values, rest), solver, ts, rtol=RTOL)

    def by_two(numbers: Any, values: Any) -> jax.Array:
        return value(eqx.tree_at(two, values, numbers))

    with rj.forward_mode():
        run, build = compiled(value, values)
        forward, build_forward = compiled(jax.jacfwd(by_two), two(values), values)
    reverse, build_reverse = compiled(jax.grad(value), values)
    base, *others = least((run, reverse, forward), REPEATS)
    return [
        name,
        type(solver).__name__,
        f"{1e3 * base:.2f}",
        *(f"{taken / base:.1f}" for taken in others),
        *(f"{taken:.0f}" for taken in (build, build_reverse, build_forward)),
    ]


def memory(steps: int) -> list[str]:
    """Temporary memory of a run in fixed steps of a pendulum, and of its gradient [kB]."""
    values, rest = eqx.partition(rj.gallery.chain(1), eqx.is_inexact_array)
    ts = jnp.array([0.0, 1.0])
    settings = {"dt": 1.0 / steps, "max_steps": steps + 10}

    def value(values: Any) -> jax.Array:
        return end(eqx.combine(values, rest), diffrax.Tsit5(), ts, **settings)

    row = [f"{steps}"]
    for function in (value, jax.grad(value)):
        analysis = jax.jit(function).lower(values).compile().memory_analysis()
        row.append(f"{analysis.temp_size_in_bytes / 1e3:.0f}")
    return row


def main() -> None:
    """Measure all scenes and write the tables."""
    rj.speed_up_xla()
    jax.config.update("jax_enable_x64", True)
    header = ["scene", "method", "run ms", "reverse", "forward", "compile s", "reverse", "forward"]
    first = tabulate(
        [header, *(costs(name) for name in tqdm(CASES))],
        headers="firstrow",
        tablefmt="plain",
        disable_numparse=True,
    )
    second = tabulate(
        [["steps", "run", "gradient"], *(memory(steps) for steps in tqdm(STEPS))],
        headers="firstrow",
        tablefmt="plain",
        disable_numparse=True,
    )
    text = (
        "Gradients of one number of the last state: by the whole scene in reverse mode, by two\n"
        f"numbers in forward mode, in times of the run; then times to compile. rtol {RTOL:g}, "
        f"least of\n{REPEATS} interleaved runs. jax {jax.__version__}, {os.cpu_count()} cores, "
        f"{platform.machine()}.\n\n{first}\n\n"
        f"Temporary memory of a pendulum in fixed steps [kB]:\n\n{second}\n"
    )
    Path(__file__).with_suffix(".txt").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
