"""What a run of one model costs in each way in which it leaves."""

import importlib.util
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from native_models import TS, cart, on_processor
from timing import least

import romjax as rj

RTOL = 1e-6
# Programs that only some ways need.
NEEDED = {"FMU, co-simulation by fmpy": "fmpy", "C, CVODES of CasADi": "casadi"}


def missing() -> list[str]:
    """Names of the programs that are not installed."""
    return [name for name in NEEDED.values() if not importlib.util.find_spec(name)]


def ways() -> tuple[list[list[str]], dict[str, float]]:
    """A second of the cart's minimal model of rank 3, with 101 outputs of x of the cart."""
    rom = cart(rj.Minimal(), 3)
    truth = np.asarray(rj.simulate(rom, TS, rtol=1e-10, audit=False)["cart.x"])
    model = rj.compile(rom)
    with tempfile.TemporaryDirectory() as folder:
        calls: dict[str, Callable[[], Any]] = {
            "simulate": lambda: rj.simulate(rom, TS, rtol=RTOL)["cart.x"],
            "simulate, audit=False": lambda: rj.simulate(rom, TS, rtol=RTOL, audit=False)["cart.x"],
            "compile": lambda: model.simulate(TS, rtol=RTOL)["cart.x"],
            "a program of XLA": _program(rom, Path(folder)),
        }
        if "fmpy" not in missing():
            calls["FMU, co-simulation by fmpy"] = _fmu(rom, Path(folder))
        if "casadi" not in missing():
            calls["C, CVODES of CasADi"] = _casadi(rom, Path(folder))
        timed = least([on_processor(call, 1) for call in calls.values()], 5, name="ways")
    size = np.max(np.abs(truth))
    lines = []
    for name, one in zip(calls, timed, strict=True):
        off = np.max(np.abs(np.asarray(one.result).ravel() - truth)) / size
        lines.append([name, f"{1e3 * one.least:.3f}", f"{off:.1e}"])
    return lines, {}


def _program(rom: rj.AbstractSystem, folder: Path) -> Callable[[], Any]:
    made = rj.export.stablehlo(rom, folder / "run", TS, rtol=RTOL)
    content = (folder / "run").read_bytes()
    del made
    call = jax.jit(jax.export.deserialize(bytearray(content)).call)
    return lambda: call(rom.q0, rom.v0)["q"][:, 0]


def _fmu(rom: rj.AbstractSystem, folder: Path) -> Callable[[], Any]:
    """Unpacked and instantiated once, as tools do."""
    import fmpy

    rj.export.fmu(rom, folder / "cart.fmu", outputs=["cart.x"], name="cart")
    unpacked = fmpy.extract(str(folder / "cart.fmu"))
    described = fmpy.read_model_description(unpacked)
    instance = fmpy.instantiate_fmu(unpacked, described, fmi_type="CoSimulation")

    def call() -> Any:
        instance.reset()
        run = fmpy.simulate_fmu(
            unpacked,
            fmi_type="CoSimulation",
            fmu_instance=instance,
            model_description=described,
            stop_time=TS[-1],
            output_interval=TS[1],
            output=["cart.x"],
            relative_tolerance=RTOL,
        )
        return run["cart.x"]

    return call


def _casadi(rom: rj.AbstractSystem, folder: Path) -> Callable[[], Any]:
    """The right-hand side and the outputs as external functions."""
    import casadi

    made = rj.export.c(rom, folder / "c", outputs=["cart.x"], name="cart")
    library = folder / "libcart.so"
    sources = [str(folder / "c" / name) for name in ("casadi.c", "cart.c")]
    compiler = shutil.which("cc") or "gcc"
    flags = ["-O2", "-std=c99", "-fPIC", "-shared"]
    subprocess.run([compiler, *flags, "-o", str(library), *sources, "-lm"], check=True)
    rates, measured = (
        casadi.external(f"cart_{name}", str(library)) for name in ("rates", "measured")
    )
    x, t = casadi.MX.sym("x", len(made.states)), casadi.MX.sym("t")
    none = casadi.MX(0, 1)
    problem = {"x": x, "t": t, "ode": rates(t, x, none, none)}
    given = {"reltol": RTOL, "abstol": RTOL * 1e-2}
    run = casadi.integrator("run", "cvodes", problem, TS[0], TS[1:], given)
    start = np.concatenate([rom.q0, rom.v0])
    seen = casadi.Function("seen", [x], [measured(0, x, none, none)]).map(len(TS))

    def call() -> Any:
        states = np.array(run(x0=start)["xf"])
        return np.array(seen(np.concatenate([start[:, None], states], axis=1)))

    return call
