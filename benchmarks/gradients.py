"""What gradients cost by `rj.jit`: time of reverse mode by a whole scene and of forward mode by two
of its numbers, in runs, and memory by the number of steps. Writes `gradients.txt` beside this file.
"""

import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import record
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


def compiled(
    function: Callable, *arguments: Any, jit: Callable = rj.jit
) -> tuple[Callable[[], Any], float]:
    """A call of the compiled function, and the time to compile [s]."""
    start = time.perf_counter()
    program = jit(function).lower(*arguments).compile()
    return lambda: program(*arguments), time.perf_counter() - start


def costs(name: str) -> tuple[list[str], dict[str, float]]:
    """The row of a scene, milliseconds of the run and gradients in units of it; and the ratios."""
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
    with warnings.catch_warnings(category=UserWarning, action="ignore"):
        plain, _ = compiled(jax.grad(value), values, jit=jax.jit)
    calls = run, reverse, forward, plain
    base, back, ahead, slow = (one.least for one in least(calls, REPEATS, name=name))
    row = [
        name,
        type(solver).__name__,
        f"{1e3 * base:.2f}",
        *(f"{taken / base:.1f}" for taken in (back, ahead)),
        *(f"{taken:.0f}" for taken in (build, build_reverse, build_forward)),
    ]
    return row, {
        f"{name}: run / reverse": base / back,
        f"{name}: run / forward": base / ahead,
        f"{name}: reverse, jax.jit / rj.jit": slow / back,
        f"{name}: run / reverse, to compile": build / build_reverse,
    }


def memory(steps: int) -> tuple[float, float]:
    """Temporary memory of a run in fixed steps of a pendulum, and of its gradient [kB]."""
    values, rest = eqx.partition(rj.gallery.chain(1), eqx.is_inexact_array)
    ts = jnp.array([0.0, 1.0])
    settings = {"dt": 1.0 / steps, "max_steps": steps + 10}

    def value(values: Any) -> jax.Array:
        return end(eqx.combine(values, rest), diffrax.Tsit5(), ts, **settings)

    sizes = (
        rj.jit(function).lower(values).compile().memory_analysis().temp_size_in_bytes / 1e3
        for function in (value, jax.grad(value))
    )
    return next(sizes), next(sizes)


def measure() -> Iterator[record.Section]:
    """Times of all scenes, then memory."""
    rows = [["scene", "method", "run ms", "reverse", "forward", "compile s", "reverse", "forward"]]
    ratios: dict[str, float] = {}
    for name in CASES:
        row, more = costs(name)
        rows.append(row)
        ratios |= more
    yield record.Section(
        "Gradients of one number of the last state: by the whole scene in reverse mode, by two\n"
        f"numbers in forward mode, in times of the run; then times to compile. rtol {RTOL:g}, "
        f"least of\n{REPEATS} interleaved runs.",
        rows,
        ratios,
    )
    sizes = [memory(steps) for steps in tqdm(STEPS, "memory", leave=False, disable=None)]
    rows = [[f"{n}", *(f"{x:.0f}" for x in both)] for n, both in zip(STEPS, sizes, strict=True)]
    yield record.Section(
        "Temporary memory of a pendulum in fixed steps [kB]:",
        [["steps", "run", "gradient"], *rows],
        {"memory of a gradient, 10^3 / 10^5 steps": sizes[0][1] / sizes[-1][1]},
    )


if __name__ == "__main__":
    record.main(measure, setup=record.begin_as_users)
