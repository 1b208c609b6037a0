"""What each effect adds to the cart-pendulum, part by part, and what an absent one costs. Writes
`effects.txt` beside this file.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import record
from jax.extend import core
from timing import least
from tqdm import tqdm

import romjax as rj

REPEATS = 40
STEPS = 10_000  # right-hand sides of a run
STEP = 1e-4  # [s] short enough for the fastest vibration of the cart-pendulum, above 1 kHz
SPIN = 1.0  # [rad/s] of the pendulum about its hinge at the start


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


def run(
    scene: rj.Scene, step: float = STEP, steps: int = STEPS
) -> tuple[Callable[[], Any], int, float]:
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

        return jax.lax.fori_loop(0, steps, advance, (q, v))

    state = (system.q0, system.v0)
    count = equations(jax.make_jaxpr(acceleration)(numbers, 0.0, *state).jaxpr)
    start = time.perf_counter()
    program = jax.jit(motion).lower(numbers, *state).compile()
    taken = time.perf_counter() - start
    if not all(bool(jnp.all(jnp.isfinite(x))) for x in program(numbers, *state)):
        raise RuntimeError("the run has grown without bound; its times mean nothing")
    return lambda: program(numbers, *state), count, taken


def measure() -> Iterator[record.Section]:
    """The table of the parts, and a sentence on the chapter's scene with and without a detour."""
    scenes = parts()
    names = list(scenes)
    chapter = scenes["force"]
    detour = rj.Scene(chapter.bodies, chapter.joints, scenes["friction"].effects)
    scenes["back"] = eqx.tree_at(lambda scene: scene.effects, detour, chapter.effects)
    bar = tqdm(scenes.values(), "compiling", leave=False, disable=None)
    calls, counts, compiled = zip(*(run(scene) for scene in bar), strict=True)
    times = [1e9 * one.least / STEPS for one in least(calls, REPEATS)]
    rows = [["part added", "equations", "ns", "more", "compile s"]]
    for i, name in enumerate(names):
        more = f"{times[i] - times[i - 1]:+.0f}" if i else ""
        rows.append([name, f"{counts[i]}", f"{times[i]:.0f}", more, f"{compiled[i]:.1f}"])
    yield record.Section(
        "The cart-pendulum with effects added one by one: equations of the traced\n"
        f"acceleration, time of a right-hand side [ns] in a compiled run of {STEPS}\n"
        "(semi-implicit Euler, 1 s), what the part adds to it (negative where the\n"
        "compiler makes more of the larger program), time to compile.\n"
        f"Least of {REPEATS} interleaved runs.",
        rows,
    )
    own = names.index("force")
    yield record.Section(
        "The chapter's scene, which ends with the force, as it is and after all effects\n"
        f"of the table were added and taken out again: {counts[own]} and {counts[-1]} equations,\n"
        f"{times[own]:.0f} and {times[-1]:.0f} ns.",
        ratios={
            "without effects / added and taken out": times[own] / times[-1],
            "equations, without / added and taken out": counts[own] / counts[-1],
            "bodies and joints / with all effects": times[0] / times[names.index("friction")],
        },
    )


if __name__ == "__main__":
    record.main(measure)
