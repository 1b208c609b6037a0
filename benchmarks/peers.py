"""The chain in other codes: MuJoCo (minimal coordinates, RK4) and Exudyn (generalised alpha).

Both clock themselves, since building the model is not part of the work.
"""

import functools
import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from timing import Timed

import romjax as rj

# A function of the number of steps in one second: places of all bars (3 n) and steps.
Run = Callable[[float], Timed]


def missing() -> list[str]:
    """Names of the programs that are not installed."""
    return [name for name in ("MuJoCo", "Exudyn") if not importlib.util.find_spec(name.lower())]


def mujoco_chain(links: int, clock: Callable[[], float] = time.perf_counter) -> Run:
    """By minimal coordinates, with the classical Runge–Kutta method."""
    import mujoco

    bar = (
        '<body pos="{x} 0 0"><joint type="hinge" axis="0 -1 0"/>'
        '<inertial pos="0.5 0 0" mass="1" diaginertia="{j} {j} {j}"/>'
    )
    bars = "".join(bar.format(x=min(i, 1), j=1 / 12) for i in range(links))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 -9.81" integrator="RK4">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{bars}{'</body>' * links}</worldbody></mujoco>"
    )

    def places(data: Any) -> np.ndarray:
        angle = np.cumsum(data.qpos)
        along, up = np.cos(angle), np.sin(angle)
        own = [np.cumsum(along) - along / 2, np.cumsum(up) - up / 2, angle]
        return np.stack(own, axis=1).ravel()

    return _mujoco_run(model, lambda data: None, places, clock)


def is_hinged(scene: rj.Scene) -> bool:
    """Whether a chain in space is one of hinges along y, and not of ball joints."""
    return isinstance(scene.joints[0], rj.spatial.Revolute)


def mujoco_in_space(scene: rj.Scene, clock: Callable[[], float] = time.perf_counter) -> Run:
    """Equal bodies, each on a ball joint or a hinge along y on the one before, that spin as the
    first one; returns the positions of all centres of mass.
    """
    import mujoco

    first, hinges = scene.bodies[0], is_hinged(scene)
    arm = -np.asarray(scene.joints[0].a.point)
    moments = " ".join(f"{x}" for x in np.asarray(first.inertia))
    joint = '<joint type="hinge" axis="0 1 0"/>' if hinges else '<joint type="ball"/>'
    body = (
        f'<body pos="{{x}} 0 0">{joint}'
        f'<inertial pos="{arm[0]} {arm[1]} {arm[2]}" mass="{float(first.mass)}" '
        f'diaginertia="{moments}"/>'
    )
    count = len(scene.bodies)
    bodies = "".join(body.format(x=min(i, 1)) for i in range(count))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 -9.81" integrator="RK4">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{bodies}{'</body>' * count}</worldbody></mujoco>"
    )
    spin = np.asarray(first.angular_velocity)[1:2] if hinges else np.asarray(first.angular_velocity)

    def begin(data: Any) -> None:
        data.qvel[: len(spin)] = spin

    return _mujoco_run(model, begin, functools.partial(_centres, model), clock)


def mujoco_of_file(path: Path, clock: Callable[[], float] = time.perf_counter) -> Run:
    """A robot from its first keyframe, without contacts, ranges and loops; returns the positions of
    all centres of mass.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

    def begin(data: Any) -> None:
        mujoco.mj_resetDataKeyframe(model, data, 0)

    return _mujoco_run(model, begin, functools.partial(_centres, model), clock)


def _centres(model: Any, data: Any) -> np.ndarray:
    """The positions of all centres of mass."""
    import mujoco

    mujoco.mj_kinematics(model, data)
    return np.array(data.xipos[1:])


def _mujoco_run(
    model: Any,
    begin: Callable[[Any], None],
    read: Callable[[Any], np.ndarray],
    clock: Callable[[], float],
) -> Run:
    """One second in so many steps, from where `begin` puts the data, and what is `read` of them."""
    import mujoco

    def run(steps: float) -> Timed:
        model.opt.timestep = 1.0 / steps
        data = mujoco.MjData(model)
        begin(data)
        start = clock()
        mujoco.mj_step(model, data, nstep=int(steps))
        taken = clock() - start
        return Timed((read(data), int(steps)), taken)

    return run


def exudyn_in_space(scene: rj.Scene) -> Run:
    """The bodies of a scene, each on a ball joint or a hinge along y on the one before, by Euler
    parameters; the time is that of the solver alone.
    """
    import exudyn
    from exudyn.itemInterface import (
        LoadMassProportional,
        MarkerBodyMass,
        MarkerBodyRigid,
        NodeRigidBodyEP,
        ObjectJointGeneric,
        ObjectJointSpherical,
        ObjectRigidBody,
    )

    joined = ObjectJointSpherical
    if is_hinged(scene):
        joined = functools.partial(ObjectJointGeneric, constrainedAxes=[1, 1, 1, 1, 0, 1])

    def build(system: Any, ground: Any) -> list[Any]:
        end = system.AddMarker(MarkerBodyRigid(bodyNumber=ground))
        nodes = []
        for bar, joint in zip(scene.bodies, scene.joints, strict=True):
            spin, velocity = np.asarray(bar.angular_velocity), np.asarray(bar.velocity)
            node = system.AddNode(
                NodeRigidBodyEP(
                    referenceCoordinates=[*np.asarray(bar.position), 1, 0, 0, 0],
                    initialVelocities=[*velocity, 0, *(spin / 2)],
                )
            )
            body = system.AddObject(
                ObjectRigidBody(
                    physicsMass=float(bar.mass),
                    physicsInertia=[*np.asarray(bar.inertia), 0, 0, 0],
                    nodeNumber=node,
                )
            )
            start = np.asarray(joint.a.point)
            left, right = (
                system.AddMarker(MarkerBodyRigid(bodyNumber=body, localPosition=list(point)))
                for point in (start, -start)
            )
            system.AddObject(joined(markerNumbers=[end, left]))
            whole = system.AddMarker(MarkerBodyMass(bodyNumber=body))
            system.AddLoad(LoadMassProportional(markerNumber=whole, loadVector=[0, 0, -9.81]))
            nodes.append(node)
            end = right
        return nodes

    def places(system: Any, nodes: list[Any]) -> np.ndarray:
        kind = exudyn.OutputVariableType.Position
        return np.array([system.GetNodeOutput(node, kind) for node in nodes])

    return _exudyn_run(build, places, len(scene.bodies))


def _exudyn_run(
    build: Callable[[Any, Any], list[Any]],
    places: Callable[[Any, list[Any]], np.ndarray],
    bodies: int,
) -> Run:
    """One second by the generalised-alpha method, with the solver that is faster for so many.

    `build(system, ground)` adds the bodies and returns their nodes; `places(system, nodes)` is the
    result.
    """
    import exudyn
    from exudyn.itemInterface import ObjectGround

    settings = exudyn.SimulationSettings()
    settings.timeIntegration.endTime = 1.0
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.timeIntegration.newton.absoluteTolerance = 1e-12
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.solution.file.write = False
    sparse = exudyn.LinearSolverType.EigenSparse
    settings.linearSolver.solverType = sparse if bodies > 4 else exudyn.LinearSolverType.EXUdense

    def run(steps: float) -> Timed:
        system = exudyn.SystemContainer().AddSystem()
        nodes = build(system, system.AddObject(ObjectGround(referencePosition=[0, 0, 0])))
        system.Assemble()
        settings.timeIntegration.numberOfSteps = int(steps)
        start = time.perf_counter()
        system.SolveDynamic(settings)
        taken = time.perf_counter() - start
        return Timed((places(system, nodes), int(steps)), taken)

    return run


def exudyn_chain(links: int) -> Run:
    """By redundant coordinates; the time is that of the solver alone."""
    import exudyn
    from exudyn.itemInterface import (
        LoadMassProportional,
        MarkerBodyMass,
        MarkerBodyPosition,
        NodeRigidBody2D,
        ObjectJointRevolute2D,
        ObjectRigidBody2D,
    )

    def build(system: Any, ground: Any) -> list[Any]:
        end = system.AddMarker(MarkerBodyPosition(bodyNumber=ground))
        nodes = []
        for i in range(links):
            node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[i + 0.5, 0, 0]))
            body = system.AddObject(
                ObjectRigidBody2D(physicsMass=1, physicsInertia=1 / 12, nodeNumber=node)
            )
            left, right = (
                system.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[x, 0, 0]))
                for x in (-0.5, 0.5)
            )
            system.AddObject(ObjectJointRevolute2D(markerNumbers=[end, left]))
            whole = system.AddMarker(MarkerBodyMass(bodyNumber=body))
            weight = LoadMassProportional(markerNumber=whole, loadVector=[0, -9.81, 0])
            system.AddLoad(weight)
            nodes.append(node)
            end = right
        return nodes

    def places(system: Any, nodes: list[Any]) -> np.ndarray:
        kind = exudyn.OutputVariableType.Coordinates
        found = np.array([system.GetNodeOutput(node, kind) for node in nodes])
        found[:, 0] += np.arange(links) + 0.5
        return found.ravel()

    return _exudyn_run(build, places, links)
