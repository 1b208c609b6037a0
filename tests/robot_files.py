"""Robot files that a generator writes, and the motion of robots by MuJoCo in terms of scenes."""

import numpy as np

import romjax as rj
from romjax.linalg import quaternions

GALLERY = rj.gallery.ROBOTS
ROBOTS = (
    *("arm.xml", "parallelogram_arm.xml", "leg.xml", "delta.xml", "stewart.xml"),
    *("gripper.urdf", "excavator.urdf"),
)

HEAD = (
    '<mujoco model="{name}"><compiler angle="radian" autolimits="true"/>'
    '<option gravity="0.3 -0.2 -9.81"><flag contact="disable"/></option>'
)


# Actuators with a state, each of a hinge that nothing else moves but a weight.
WITH_STATES = (
    '<general joint="h0" dyntype="filter" dynprm="0.05" gainprm="5" gear="2"/>',
    '<general joint="h1" dyntype="integrator" gainprm="4" actlimited="true" actrange="-1 0.4"/>',
    '<position joint="h2" kp="30" kv="2" timeconst="0.1"/>',
    '<intvelocity joint="h3" kp="30" kv="1" actrange="-2 2"/>',
    '<cylinder joint="h4" timeconst="0.08" area="2" bias="0.5 -1 -0.2"/>',
)


def with_states() -> str:
    """Five hinges with an actuator each, and where these begin."""
    bodies = "".join(
        f'<body name="b{i}" pos="{i} 0 0"><joint name="h{i}" axis="0 1 0" damping="0.3" limited='
        '"true" range="-170 170"/><geom size=".1" pos=".3 0 0" mass="1"/></body>'
        for i in range(len(WITH_STATES))
    )
    return (
        '<mujoco><option timestep="1e-4" integrator="RK4"><flag contact="disable"/></option>'
        f"<worldbody>{bodies}</worldbody><actuator>{''.join(WITH_STATES)}</actuator><keyframe>"
        '<key name="k" ctrl="0.1 2 0.5 1.5 0.5" act="0.3 -0.2 0 0.1 0.5"/></keyframe></mujoco>'
    )


def words(numbers) -> str:
    return " ".join(f"{x:.17g}" for x in np.atleast_1d(numbers))


def inertial(random) -> str:
    """The inertia of a cloud of points."""
    points, mass = 0.1 * random.normal(size=(6, 3)), random.uniform(0.5, 2.0)
    tensor = mass / 6 * sum(x @ x * np.eye(3) - np.outer(x, x) for x in points)
    six = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    centre = words(0.1 * random.normal(size=3))
    return f'<inertial pos="{centre}" mass="{mass:.17g}" fullinertia="{words(six)}"/>'


def frame(random) -> str:
    turn = random.normal(size=4)
    return f'pos="{words(0.3 * random.normal(size=3))}" quat="{words(turn / np.linalg.norm(turn))}"'


def axes(random) -> np.ndarray:
    return np.linalg.qr(random.normal(size=(3, 3)))[0].T


def joint(name: str, kind: str, axis, point, random, plain: bool = False) -> str:
    text = f'<joint name="{name}" type="{kind}" pos="{words(point)}"'
    if kind == "ball":
        return f'{text} damping="{random.uniform(0.1, 1)}" stiffness="{random.uniform(1, 3)}"/>'
    numbers = random.uniform(0.1, 1.0, 5)
    ref = "" if plain else f' ref="{numbers[0]}" springref="{numbers[1]}"'
    return (
        f'{text} axis="{words(axis)}"{ref} damping="{numbers[2]}" stiffness="{numbers[3]}" '
        f'armature="{numbers[4]}"/>'
    )


def joints(number: int, random) -> str:
    """The joints of a body: one, or several."""
    kind = random.choice(
        ["hinge"] * 4
        + ["slide"] * 2
        + ["ball", "two", "three", "planar", "cylinder", "slot", "cart", "moving ball"]
    )
    directions, point = axes(random), 0.1 * random.normal(size=3)

    def one(k: int, kind: str, axis: int, plain: bool = False) -> str:
        return joint(f"j{number}{'abcdef'[k]}", kind, directions[axis], point, random, plain)

    match kind:
        case "two":
            return one(0, "hinge", 0, True) + one(1, "hinge", 1, True)
        case "three":
            return "".join(one(k, "hinge", k, True) for k in range(3))
        case "planar":
            return one(0, "slide", 0) + one(1, "slide", 1) + one(2, "hinge", 2)
        case "cylinder":
            return one(0, "hinge", 0) + one(1, "slide", 0)
        case "slot":
            return one(0, "slide", 0) + one(1, "hinge", 1)
        case "cart":
            return one(0, "slide", 0) + one(1, "slide", 1)
        case "moving ball":
            return one(0, "slide", 0) + one(1, "ball", 1)
    return one(0, kind, 0)


def tree(count: int, seed: int) -> str:
    """A random tree of bodies with all kinds of joints, links fixed to others, and motors."""
    random = np.random.default_rng(seed)
    held = [list[str]() for _ in range(count + 1)]
    parents = [0] + [int(random.integers(max(0, i - 4), i)) for i in range(1, count + 1)]
    text, driven = [""] * (count + 1), []
    for i in range(count, 0, -1):
        if parents[i] == 0 and random.random() < 0.3:
            own = f'<freejoint name="j{i}a"/>'
        elif parents[i] and random.random() < 0.15:
            own = ""
        else:
            own = joints(i, random)
        driven += [
            name.split('"')[1]
            for name in own.split("<joint ")[1:]
            if 'type="ball"' not in name and random.random() < 0.5
        ]
        site = f'<site name="s{i}" pos="{words(0.2 * random.normal(size=3))}"/>'
        inner = "".join(held[i])
        text[i] = f'<body name="b{i}" {frame(random)}>{own}{inertial(random)}{site}{inner}</body>\n'
        held[parents[i]].append(text[i])
    motors = "".join(
        f'<general name="m{k}" joint="{name}" gear="{random.uniform(-3, 3)}" biastype="affine" '
        f'gainprm="2" biasprm="0.1 -1 -0.2" armature="0.01" damping="0.02"/>'
        for k, name in enumerate(driven)
    )
    return (
        f"{HEAD.format(name=f'tree {count}')}<worldbody>{''.join(held[0])}</worldbody>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def loop(count: int, seed: int) -> str:
    """A random tree whose last bodies are connected to the ground and to its first one, with a
    joint that follows another.
    """
    random = np.random.default_rng(seed)
    text = tree(count, seed)
    names = [x.split('"')[0] for x in text.split('<joint name="')[1:]]
    scalar = [x for x in names if f'name="{x}" type="ball"' not in text]
    # Of two bodies each with a joint of its own.
    led, leading = scalar[0], next(x for x in scalar if x[:-1] != scalar[0][:-1])
    anchors = [words(0.2 * random.normal(size=3)) for _ in range(2)]
    return text.replace(
        "<actuator>",
        f'<equality><connect body1="b{count}" anchor="{anchors[0]}"/>'
        f'<joint joint1="{led}" joint2="{leading}" polycoef="0 0.7 0.1 0 0"/></equality><actuator>',
    )


def state(scene, model, data) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and velocities of the bodies of a scene in a state of MuJoCo's."""
    import mujoco

    q, v = [], []
    for body in scene.bodies:
        link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body.name)
        turn, speeds = np.array(data.xquat[link]), np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, link, speeds, 0)
        arm = quaternions.rotate(turn, np.asarray(body.com))
        q += [data.xpos[link] + arm, turn]
        v += [speeds[3:] + np.cross(speeds[:3], arm), quaternions.derivative(turn, speeds[:3])]
    return np.concatenate(q), np.concatenate(v)


def accelerations(scene, model, data) -> np.ndarray:
    """Accelerations of the centres of mass and angular accelerations (bodies, 6) by MuJoCo."""
    import mujoco

    mujoco.mj_rnePostConstraint(model, data)
    found = []
    for body in scene.bodies:
        link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body.name)
        kind, speeds, rates = mujoco.mjtObj.mjOBJ_XBODY, np.zeros(6), np.zeros(6)
        mujoco.mj_objectVelocity(model, data, kind, link, speeds, 0)
        mujoco.mj_objectAcceleration(model, data, kind, link, rates, 0)
        arm = quaternions.rotate(np.array(data.xquat[link]), np.asarray(body.com))
        spin, turning = speeds[:3], rates[:3]
        moving = rates[3:] + model.opt.gravity  # MuJoCo's is that of a sensor
        found.append(
            [*(moving + np.cross(turning, arm) + np.cross(spin, np.cross(spin, arm))), *turning]
        )
    return np.array(found)


def equality_rows(model, data) -> tuple[np.ndarray, np.ndarray]:
    """The Jacobian of the equality constraints at a state of MuJoCo's, and their violation."""
    import mujoco

    mujoco.mj_fwdPosition(model, data)
    rows = np.asarray(data.efc_type) == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return data.efc_J.reshape(-1, model.nv)[rows], np.asarray(data.efc_pos)[rows]


def hold(model, data, random, spread: float) -> None:
    """Put data into a random state in which the equality constraints hold."""
    import mujoco

    data.qpos[:] = model.qpos0
    mujoco.mj_integratePos(model, data.qpos, spread * random.normal(size=model.nv), 1.0)
    for _ in range(30):
        rows, violation = equality_rows(model, data)
        if not rows.size:
            break
        mujoco.mj_integratePos(model, data.qpos, -np.linalg.pinv(rows) @ violation, 1.0)
    rows, _ = equality_rows(model, data)
    speeds = random.normal(size=model.nv)
    data.qvel[:] = speeds - np.linalg.pinv(rows) @ (rows @ speeds) if rows.size else speeds
    mujoco.mj_forward(model, data)


def close_exactly(model, data) -> None:
    """Give data the accelerations with exact constraints, by Lagrange's multipliers on MuJoCo's
    mass matrix, forces and rows; the change of the rows is a central difference.
    """
    import mujoco

    mass, here, step = np.zeros((model.nv, model.nv)), np.array(data.qpos), 1e-6
    mujoco.mj_fullM(model, data, mass)
    force = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    rows, _ = equality_rows(model, data)
    ends = []
    for sign in (1, -1):
        data.qpos[:] = here
        mujoco.mj_integratePos(model, data.qpos, np.array(data.qvel), sign * step)
        ends.append(equality_rows(model, data)[0])
    data.qpos[:] = here
    mujoco.mj_forward(model, data)
    change = (ends[0] - ends[1]) / (2 * step) @ data.qvel
    inverse = np.linalg.inv(mass)
    multipliers = np.linalg.pinv(rows @ inverse @ rows.T) @ (rows @ inverse @ force + change)
    data.qacc[:] = inverse @ (force - rows.T @ multipliers)
