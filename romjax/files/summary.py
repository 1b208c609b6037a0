"""Descriptions of scenes in words, without running them."""

from collections import Counter

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tabulate import tabulate

from ..assembly.assemble import assemble
from ..assembly.assembled import AssembledSystem
from ..common.errors import InputError
from ..compiling.program import program_once
from ..integrate.default import default_method, start_frequencies
from ..reduction.joint.formulation import faster_size
from ..scene.scene import Scene
from ..system.base import AbstractSystem
from ..system.dynamics import jacobian
from ..system.structure import without_names
from .scene_file import SceneFile
from .settings import Settings, solver_of
from .starts import start_rows

# A row of C_q with less than this share beyond those before it repeats them.
_REPEATED = 1e-8


def describe_file(file: SceneFile) -> str:
    """Bodies, joints, freedoms, effects, the fastest frequency, and the method with its reason.

    Where the joints hold only elsewhere than the file places its bodies: what moves, and by how
    much, with a warning if that is far.

    Raises SceneFileError for joints that contradict each other or lock the mechanism.
    """
    placed = file.placed()
    scene = file.closed(placed)
    try:
        system = assemble(scene)
    except InputError as error:
        raise file.wrong(error) from error
    q, v = system.q0, system.v0
    rows = [
        ["bodies", _counted([type(body).__name__ for body in scene.bodies])],
        *[["", f"{body.name}: {body.size} coordinates"] for body in scene.bodies],
        ["coordinates", str(system.n)],
        ["constraints", f"{system.m}, {_counted([type(j).__name__ for j in scene.joints])}"],
        ["freedoms", _freedoms(scene, system, q)],
        ["redundant", ", ".join(redundant_joints(scene, system, q)) or "no joint"],
        ["effects", _counted([type(effect).__name__ for effect in scene.effects])],
        *start_rows(placed, scene, file.consistent),
        *_speed(system, file.settings, q, v),
        *_in_joint_coordinates(system),
        *[["left out" if i == 0 else "", words] for i, words in enumerate(file.left_out)],
    ]
    table = tabulate(rows, tablefmt="plain", disable_numparse=True)
    return f"{file.path}: {file.title}\n{table}"


def _counted(kinds: list[str]) -> str:
    counts = Counter(kinds)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "none"


def _freedoms(scene: Scene, system: AbstractSystem, q: Array) -> str:
    rank = system.m - sum(_repeats(scene, system, q).values())
    modes = sum(body.modes for body in scene.bodies)
    words = f", {modes} of them modes" if modes else ""
    # The length of a quaternion is no freedom, and neither is a state of an effect.
    others = len(system.structure.quaternions) + len(system.structure.states)
    return f"{system.n - others - rank}{words}"


def redundant_joints(scene: Scene, system: AbstractSystem, q: Array) -> list[str]:
    """The joints that repeat, at the coordinates q, what those before them hold already."""
    return [
        f"{joint} ({count} of its constraints)"
        for joint, count in _repeats(scene, system, q).items()
        if count
    ]


def _repeats(scene: Scene, system: AbstractSystem, q: Array) -> dict[str, int]:
    """How many constraints of each joint are combinations of earlier ones: Gram and Schmidt's way,
    on rows in the metric of M⁻¹, which no choice of units changes.
    """
    if not system.m:
        return {}
    mass, jacobian = (np.asarray(x, float) for x in _matrices(without_names(system), q))
    # C_q M⁻¹ C_qᵀ = R Rᵀ for R = C_q L⁻ᵀ: independent accelerations are independent rows.
    half: np.ndarray = np.linalg.inv(np.linalg.cholesky(mass))
    rows = jacobian @ half.T
    basis, counts, row = np.zeros((0, system.n)), Counter[str](), 0
    for joint in scene.joints:
        for _ in range(joint.rows):
            # A row of zeros stays one, and counts as repeated.
            own = rows[row] / max(float(np.linalg.norm(rows[row])), 1e-300)
            left = own
            for _ in range(2):  # the second takes out what rounding leaves
                left = left - basis.T @ (basis @ left)
            size = float(np.linalg.norm(left))
            counts[joint.label()] += size <= _REPEATED
            if size > _REPEATED:
                basis = np.vstack([basis, left / size])
            row += 1
    return counts


@program_once
def _matrices(
    system: AbstractSystem, q: Float[Array, " n"]
) -> tuple[Float[Array, "n n"], Float[Array, "m n"]]:
    """The mass matrix and the constraint Jacobian."""
    return system.mass(q), jacobian(system, 0.0, q)


def _in_joint_coordinates(system: AssembledSystem) -> list[list[str]]:
    """The size of the exact model of fewer coordinates, where it is known to be faster."""
    size = faster_size(system)
    if size is None:
        return []
    words = f'formulation="joint", exact: {size[0]} coordinates, {size[1]} constraints'
    return [["faster", words]]


def _speed(system: AbstractSystem, settings: Settings, q: Array, v: Array) -> list[list[str]]:
    """The fastest frequency, the method and the reason for it."""
    ts = jnp.linspace(0.0, settings.end, max(2, round(settings.end * settings.rate) + 1))
    start = start_frequencies(system, np.zeros(1), q, v)
    fastest = float(start.fastest)
    chosen, reason = default_method(system, ts, None, start)
    if given := solver_of(settings.solver):
        chosen, reason = given, "[run] says so"
    return [
        ["fastest", f"{fastest:.4g} rad/s ({fastest / (2 * np.pi):.4g} Hz)"],
        ["method", f"{type(chosen).__name__}, since {reason}"],
    ]
