"""Robots of MJCF and URDF: what comes in, what is refused, and that they move as MuJoCo's do."""

import re

import equinox as eqx
import numpy as np
import pytest
from robot_files import GALLERY, ROBOTS, with_states
from tolerances import IDENTITY, SOLVED
from zoo import run

import romjax as rj
from romjax import spatial as r
from romjax.files.robots.vocabulary import ALL, MJCF, key
from romjax.files.summary import describe_file

mujoco = pytest.importorskip("mujoco")


# The vocabulary.


def schema() -> dict[str, set[str]]:
    """The attributes of each element of MuJoCo's own schema, by its key in the vocabulary; without
    elements within those that one word is for.
    """
    found, parents, attributes = {}, [], set()
    for line in mujoco.mj_printSchema(0, 0).splitlines():
        begun = re.match(r"( *)(?:\(world\))?(\w+) \(", line)
        if begun:
            parents = [*parents[: len(begun[1]) // 3], begun[2]]
            keys = [key(tuple(parents[:i]), name) for i, name in enumerate(parents)]
            covered = any(x in MJCF and ALL in MJCF[x][1:] for x in keys[:-1])
            attributes = set() if covered else found.setdefault(keys[-1], set())
        attributes.update(line[30:].split() if begun else line.split())
    return found


@pytest.mark.instant
def test_every_element_and_attribute_has_a_word():
    """Those of a newer MuJoCo cannot pass unnoticed."""
    known = schema()
    assert len(known) > 60
    assert set(known) - set(MJCF) == set()
    assert [f"{k} {x}" for k, own in known.items() for x in own if not MJCF[k].kind(x)] == []


@pytest.mark.instant
def test_no_word_is_for_nothing():
    known = schema()
    resolved_before = {"body/frame", "body/replicate", "body/composite"}
    assert set(MJCF) - set(known) <= resolved_before
    stale = [
        f"{name} {x}"
        for name, words in MJCF.items()
        for kind in ("taken", "ignored", "left_out", "refused")
        for x in getattr(words, kind).split()
        if name in known and x != ALL and x not in known[name]
    ]
    assert stale == []


# Bad files.

BALL = '<geom size=".1" mass="1"/>'
LINK = f'<body name="a"><joint name="h"/>{BALL}</body>'
BAD = {
    "no XML": ("<mujoco>\n<worldbody>", ":2: this is no XML"),
    "another format": ("<sdf/>", ":1: <sdf> begins neither MJCF"),
    "unknown attribute": (f'{LINK}\n<body><joint foo="1"/>{BALL}</body>', ":2: .*foo"),
    "no mass": ('<body name="a">\n<joint/></body>', ":1: mass and inertia of moving bodies"),
    "nothing moves": (BALL, "no body can move"),
    "plugin": (f'{LINK}\n<body><plugin plugin="x"/></body>', ":2: <plugin>.*take it out"),
    "flexcomp": (f'{LINK}\n<flexcomp name="f"/>', ':2: <flexcomp name="f">.*flexible'),
    "mocap": (f'{LINK}\n<body name="m" mocap="true"/>', ":2: <body name=\"m\"> mocap='true'"),
    "buoyant": (f'{LINK}\n<body name="m" gravcomp="1">{BALL}</body>', ":2: .*gravcomp.*Force"),
    "yielding": (f'<body>\n<joint springyield="1"/>{BALL}</body>', ":2: <joint> springyield='1'"),
    "nonlinear spring": (
        f'<body>\n<joint name="h" stiffness="1 2"/>{BALL}</body>',
        ":2: joint 'h': its stiffness is a polynomial; give one number",
    ),
    "nonlinear damping": (
        f'<body>\n<joint name="h" damping="1 2"/>{BALL}</body>',
        ":2: joint 'h': its damping is a polynomial",
    ),
    "slide on a hinge": (
        f'<body><joint/>\n<joint name="s" type="slide" axis="1 0 0"/>{BALL}</body>',
        ":2: joint 's': it slides along an axis that turns; give the link",
    ),
    "oblique hinges": (
        f'<body><joint/>\n<joint name="s" axis="1 0 1"/>{BALL}</body>',
        ":2: joint 's': its axis is not at a right angle",
    ),
    "hinges apart": (
        f'<body><joint/>\n<joint name="s" axis="1 0 0" pos="0 1 0"/>{BALL}</body>',
        ":2: joint 's': it turns about another point",
    ),
    "hinges with ref": (
        f'<body><joint/>\n<joint name="s" axis="1 0 0" ref="1"/>{BALL}</body>',
        ":2: joint 's': one of several hinges",
    ),
    "a stop beyond a half turn": (
        f'<body>\n<joint name="h" ref="401" range="390 424"/>{BALL}</body>',
        ":2: joint 'h': it begins at 6.99877 rad, but angles count from between -π and π",
    ),
    "four joints": (
        f'<body><joint/><joint axis="1 0 0"/><joint axis="0 1 0"/>\n<joint name="s"/>{BALL}</body>',
        ":2: joint 's': its axis is not at a right angle",
    ),
    "range of a ball": (
        f'<body>\n<joint name="s" type="ball" range="10 30"/>{BALL}</body>',
        ":2: range.*",
    ),
    "armature of a ball": (
        f'<body>\n<joint name="s" type="ball" armature="1"/>{BALL}</body>',
        ":2: joint 's': it has armature in several directions",
    ),
    "name of the ground": (f'\n<body name="ground"><joint/>{BALL}</body>', ":2: body 'ground'"),
}
BAD_SECTIONS = {
    "muscle": ('<actuator>\n<muscle joint="h"/></actuator>', ":2: <muscle>.*use <motor>"),
    "delay": ('<actuator>\n<motor joint="h" delay="1"/></actuator>', ":2: <motor> delay='1'"),
    "muscle by its state": (
        '<actuator>\n<general name="f" joint="h" dyntype="muscle" dynprm="1 1"/></actuator>',
        ":2: actuator 'f': romjax has no such state; set dyntype to none, integrator, filter",
    ),
    "filter without a time": (
        '<actuator>\n<general name="f" joint="h" dyntype="filter" dynprm="0"/></actuator>',
        ":2: actuator 'f': its time constant is zero",
    ),
    "affine gain": (
        '<actuator>\n<general name="f" joint="h" gaintype="affine"/></actuator>',
        ":2: actuator 'f': its force is no linear law",
    ),
    "unknown joint": ('<actuator>\n<motor name="f" joint="x"/></actuator>', ":2: .*'x'"),
    "fixed tendon": (
        '<tendon>\n<fixed><joint joint="h" coef="1"/></fixed></tendon>',
        ":2: <fixed>.*couple joints by <equality>",
    ),
    "pulley": ('<tendon><spatial>\n<pulley divisor="2"/></spatial></tendon>', ":2: <pulley>"),
    "tendon equality": ('<equality>\n<tendon tendon1="x"/></equality>', ":2: <tendon>"),
    "no springs": ('<option>\n<flag spring="disable"/></option>', ":2: <flag> spring='disable'"),
    "fluid": ('\n<option density="1.2"/>', ":2: <option> density='1.2'.*romjax.Drag"),
    "extension": ("<extension>\n<plugin/></extension>", ":1: <extension>"),
}


def written(folder, text, name="robot.xml"):
    path = folder / name
    path.write_text(text)
    return path


def refused(folder, text, words):
    path = written(folder, text)
    with pytest.raises(rj.SceneFileError, match=words) as error:
        rj.load_scene(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.instant
@pytest.mark.parametrize("case", BAD)
def test_bad_bodies_are_refused(case, tmp_path):
    text, words = BAD[case]
    whole = text if text.startswith(("<mujoco", "<sdf")) else None
    refused(tmp_path, whole or f"<mujoco><worldbody>{text}</worldbody></mujoco>", words)


@pytest.mark.instant
@pytest.mark.parametrize("case", BAD_SECTIONS)
def test_bad_sections_are_refused(case, tmp_path):
    text, words = BAD_SECTIONS[case]
    refused(tmp_path, f"<mujoco><worldbody>{LINK}</worldbody>{text}</mujoco>", words)


@pytest.mark.instant
def test_starts_and_signals_that_are_not_there(tmp_path, crank):
    robot = written(tmp_path, f"<mujoco><worldbody>{LINK}</worldbody></mujoco>")
    with pytest.raises(rj.SceneError, match="keyframe 'home'"):
        rj.load_scene(robot, start="home")
    with pytest.raises(rj.SceneError, match="actuator or joint 'elbow'. There are: h"):
        rj.load_scene(robot, signals={"elbow": rj.Constant(1.0)})
    with pytest.raises(rj.InputError, match="start, signals and contacts are those of robot files"):
        rj.load_scene(crank, start="home")


@pytest.mark.instant
def test_includes_and_what_is_left_out(tmp_path):
    written(tmp_path, f"<mujoco>\n<worldbody>\n{LINK}</worldbody></mujoco>", "links.xml")
    text = '<mujoco><include file="links.xml"/>\n<contact><pair geom1="g" geom2="k"/></contact>'
    text += '<worldbody><geom name="g" type="plane" size="1 1 1"/><body pos="0 0 3"><joint/>'
    text += '<geom name="k" size="1"/></body></worldbody></mujoco>'
    with pytest.warns(UserWarning, match=r"robot.xml: contacts of 3 geoms; say contacts"):
        scene = rj.load_scene(written(tmp_path, text))
    assert [body.name for body in scene.bodies] == ["a", "body2"]


# Motion: of whole files in test_robot_motion.py.


def test_a_tendon_over_sites_is_a_rope(tmp_path):
    """It lifts a mass by what it is too long, as in MuJoCo; one that pushes is refused."""
    text = (
        '<mujoco><worldbody><site name="hook" pos="0 0 1"/><site name="pulley" pos="0.5 0 1.2"/>'
        f'<body pos="0.3 0 0"><joint type="slide" axis="0 0 1"/><site name="eye"/>{BALL}</body>'
        '</worldbody><tendon>\n<spatial name="r" stiffness="300" springlength="{low} 1.2">'
        '<site site="hook"/><site site="pulley"/><site site="eye"/></spatial></tendon></mujoco>'
    )
    path = written(tmp_path, text.replace("{low}", "0"))
    scene, model = rj.load_scene(path), mujoco.MjModel.from_xml_path(str(path))
    assert [type(effect).__name__ for effect in scene.effects] == ["Gravity", "Rope"]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    system = rj.assemble(scene)
    found, _ = eqx.filter_jit(lambda s: s.acceleration(0.0, s.q0, s.v0))(system)
    assert abs(float(found[2]) - data.qacc[0]) < IDENTITY * abs(data.qacc[0])
    refused(tmp_path, text.replace("{low}", "0.3"), ":2: tendon 'r': it runs over several sites")


@pytest.mark.instant
def test_the_ends_of_a_tendon_are_as_stiff_as_the_file_says(tmp_path):
    """For the inertia that a tendon moves, a quarter of the mass where it runs there and back; for
    the robot's mass where it is across the way of what it holds.
    """
    for along, mass in (("1 0 0", 0.5), ("0 0 1", 2.0)):
        text = (
            '<mujoco><worldbody><site name="a"/><site name="b" pos="0 3 0"/><body pos="1 0 0">'
            f'<joint type="slide" axis="{along}"/><geom size="0.1" mass="2"/><site name="c"/>'
            '</body></worldbody><tendon><spatial range="0 1.5" solreflimit="0.1 0.5">'
            '<site site="a"/><site site="c"/></spatial><spatial range="0 9" solreflimit="-30 -1">'
            '<site site="b"/><site site="a"/><site site="c"/><site site="a"/></spatial></tendon>'
            "</mujoco>"
        )
        line, rope = rj.load_scene(written(tmp_path, text)).effects[1:]
        assert isinstance(line, rj.JointStop)
        np.testing.assert_allclose(line.stiffness, 400 * 2.0, rtol=IDENTITY)
        np.testing.assert_allclose(rope.stiffness, 30 * mass, rtol=IDENTITY)


def test_actuators_filter_and_integrate(tmp_path):
    """Their states have the rates that they have in MuJoCo, and their hinges the accelerations."""
    path = written(tmp_path, with_states())
    scene, model = rj.load_scene(path, start="k"), mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    system = rj.assemble(scene)
    found, _ = eqx.filter_jit(lambda s: s.acceleration(0.0, s.q0, s.v0))(system)
    states = found[np.array(system.structure.states)]
    np.testing.assert_allclose(states, data.act_dot, rtol=IDENTITY)
    # At rest, not turned: p'' is half of the angular acceleration.
    turning = 2 * found[: 7 * model.nv].reshape(model.nv, 7)[:, 5]
    np.testing.assert_allclose(turning, data.qacc, rtol=IDENTITY)


def test_stops_of_ball_joints_go_in_and_out(tmp_path):
    text = f'<body><joint type="ball" range="0 30" damping="0.2"/>{BALL}</body>'
    first = rj.load_scene(written(tmp_path, f"<mujoco><worldbody>{text}</worldbody></mujoco>"))
    first.save(tmp_path / "again.xml")
    stops = [
        [(x.motion, x.lower, float(x.upper)) for x in scene.effects if isinstance(x, rj.JointStop)]
        for scene in (first, rj.load_scene(tmp_path / "again.xml"))
    ]
    assert stops == 2 * [[("turn", None, np.radians(30))]]


def test_open_ranges_go_in_and_out(tmp_path):
    """What MuJoCo writes as its largest number is no limit; a turn of more than π never stops."""
    bodies = [r.RigidBody(name, 1.0, (1.0, 1.0, 1.0)) for name in ("one", "two")]
    origin = rj.ground.at((0.0, 0.0, 0.0))
    joints = [r.Revolute(body.at(), origin, name=body.name) for body in bodies]
    ends = joints[0].a, joints[0].b
    limits = {"least": -2.0, "largest_signal": 0.5}
    activation = rj.Activation(0.1, least=0.5, start=0.5)
    effects = [
        rj.JointStop(*ends, upper=0.5),
        rj.JointStop(joints[1].a, joints[1].b, lower=-0.5),
        rj.Actuator(*ends, rj.Constant(0.0), activation=activation, name="m", **limits),
    ]
    rj.Scene(bodies, joints, effects).save(tmp_path / "again.xml")
    again = rj.load_scene(tmp_path / "again.xml").effects
    stops = [(x.lower, x.upper) for x in again if isinstance(x, rj.JointStop)]
    assert stops == [(None, 0.5), (-0.5, None)]
    (found,) = (x for x in again if isinstance(x, rj.Actuator))
    assert (found.least, found.largest, found.least_signal) == (-2.0, None, None)
    assert found.largest_signal == 0.5
    assert (found.activation.least, found.activation.largest) == (0.5, None)
    assert found.activation.start == 0.5
    # The force of an actuator beyond what its joint lets pass.
    link = LINK.replace('name="h"', 'name="h" actuatorfrcrange="-3 3"')
    strong = '<actuator><motor joint="h" forcerange="5 9"/></actuator>'
    text = f"<mujoco><worldbody>{link}</worldbody>{strong}</mujoco>"
    (motor,) = rj.load_scene(written(tmp_path, text)).effects[1:]
    assert (motor.least, motor.largest) == (3.0, 3.0)
    turn = f'<body><joint type="ball" range="0 200"/>{BALL}</body>'
    free = rj.load_scene(written(tmp_path, f"<mujoco><worldbody>{turn}</worldbody></mujoco>"))
    assert not any(isinstance(x, rj.JointStop) for x in free.effects)


def test_actuators_with_a_state_go_in_and_out(tmp_path):
    """Only what begins at zero can be written, since it is by keyframes that files say more."""
    path = written(tmp_path, with_states())
    first = rj.load_scene(path)
    first.save(tmp_path / "again.xml")
    kinds = [
        [effect.activation for effect in scene.effects if isinstance(effect, rj.Actuator)]
        for scene in (first, rj.load_scene(tmp_path / "again.xml"))
    ]
    assert len(kinds[0]) == 5
    assert eqx.tree_equal(*kinds)
    with pytest.raises(rj.SceneError, match="'actuator0' begins at 0.3"):
        rj.load_scene(path, start="k").save(tmp_path / "again.xml")


# What comes in.


@pytest.fixture(scope="module")
def arm():
    return rj.load_scene(GALLERY / "arm.xml", start="home")


@pytest.mark.instant
def test_links_that_are_fixed_are_one_body(arm):
    """The tool is a part of the flange, and its name a point of it; the base is ground."""
    names = ["shoulder", "upper_arm", "forearm", "wrist", "hand", "flange"]
    assert [body.name for body in arm.bodies] == names
    flange = arm.bodies[-1]
    points = {name: np.asarray(x) for name, x in flange.named_points().items()}
    assert points.keys() == {"origin", "tool", "tip"}
    np.testing.assert_allclose(points["tip"] - points["tool"], [0.11, 0, 0], atol=IDENTITY)
    np.testing.assert_allclose(points["tool"] - points["origin"], [0.01, 0, 0], atol=IDENTITY)
    # By the pictures of the file: a disc and a rod with round ends.
    disc = 2700 * np.pi * 0.03**2 * 0.02
    rod = 2700 * (np.pi * 0.01**2 * 0.1 + 4 / 3 * np.pi * 0.01**3)
    np.testing.assert_allclose(float(flange.mass), disc + rod, rtol=IDENTITY)


@pytest.mark.instant
def test_links_without_geoms_are_drawn_around_their_points():
    """Of an excavator as large as one, whatever its file has to draw."""
    boom = rj.load_scene(GALLERY / "excavator.urdf").bodies[1]
    along, across, up = np.ptp(np.asarray(boom.extent), axis=0)
    np.testing.assert_allclose([along, across, up], [5.7, 0.57, 0.85], rtol=IDENTITY)


@pytest.mark.instant
def test_keyframes_are_starts(arm):
    """Its hand is where two links and the turn of the wrist bring it."""
    tip = np.asarray(arm.bodies[-1].pose("origin").position)
    out = 0.4 * np.sin(0.5) + 0.43 * np.cos(0.9) + 0.06 * np.cos(1.5)
    up = 0.3 + 0.4 * np.cos(0.5) - 0.43 * np.sin(0.9) - 0.06 * np.sin(1.5)
    np.testing.assert_allclose(tip, [out, 0, up], atol=IDENTITY)
    servo = next(x for x in arm.effects if getattr(x, "name", "") == "lift")
    assert float(servo.signal.value) == 0.5


def test_a_keyframe_that_opens_a_loop_is_told(tmp_path):
    """Of a crank that is turned by 0.1 rad, where its rod, as long, hangs on a rocker."""
    bar = '<body name="{0}" pos="{1}"><joint axis="0 1 0"/><geom size=".1" pos="{2}" mass="1"/>'
    bodies = bar.format("crank", "0 0 0", "0 0 1") + bar.format("rod", "0 0 1", "1 0 0")
    bodies += "</body></body>" + bar.format("rocker", "1 0 0", "0 0 1") + "</body>"
    loop = '<equality><connect body1="rod" body2="rocker" anchor="1 0 0"/></equality>'
    keys = (
        '<keyframe><key name="open" qpos="0.1 0 0"/><key name="near" qpos="1e-5 0 0"/></keyframe>'
    )
    flag = '<option><flag contact="disable"/></option>'
    text = f"<mujoco>{flag}<worldbody>{bodies}</worldbody>{loop}{keys}</mujoco>"
    path = written(tmp_path, text)
    rj.load_scene(path, start="near")
    placed, words = rj.scene_file(path, start="open").placed(), "bodies have moved: rod: .* m, "
    with pytest.warns(UserWarning, match=words) as said:
        scene = rj.load_scene(path, start="open")
    for before, after in zip(placed.bodies, scene.bodies, strict=True):
        one, other = (np.asarray(body.start()[0])[:3] for body in (before, after))
        way = np.linalg.norm(other - one)
        assert f"{before.name}: {way:.3g} m" in str(said[0].message)


@pytest.mark.instant
def test_signals_drive_by_name():
    """An actuator of the file, and a joint of a file without actuators, with its largest effort."""
    sine = rj.Sine(0.2, 1.0)
    arm = rj.load_scene(GALLERY / "arm.xml", signals={"elbow": sine})
    servo = next(x for x in arm.effects if getattr(x, "name", "") == "elbow")
    assert servo.signal is sine
    assert [float(x) for x in (servo.gain, servo.proportional, servo.largest)] == [600, 600, 150]
    gripper = rj.load_scene(GALLERY / "gripper.urdf", signals={"drive": sine})
    assert [float(gripper.effects[-1].least), float(gripper.effects[-1].largest)] == [-5, 5]


@pytest.mark.slow
def test_joints_mimic_others():
    """Both fingers turn by the angle of the drive, and the tips keep their direction."""
    gripper = rj.load_scene(GALLERY / "gripper.urdf", signals={"drive": rj.Constant(0.01)})
    system = rj.assemble(gripper)
    assert system.n - system.m - len(system.structure.quaternions) == 1
    swung = run(system, np.linspace(0, 0.1, 3))
    turns = {
        body.name: rj.measure(system, swung, body.at()).rotation[-1] for body in gripper.bodies
    }
    angle = {name: np.arctan2(r[0, 2], r[0, 0]) for name, r in turns.items()}
    assert angle["left_finger"] > 0.05
    np.testing.assert_allclose(angle["right_finger"], -angle["left_finger"], atol=SOLVED)
    np.testing.assert_allclose([angle["left_tip"], angle["right_tip"]], 0, atol=SOLVED)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_are_kept_in_scene_files(name, tmp_path):
    scene = rj.load_scene(GALLERY / name)
    scene.save(tmp_path / "robot.toml")
    found = rj.load_scene(tmp_path / "robot.toml")
    assert eqx.tree_equal(found, scene)


@pytest.mark.slow
def test_a_check_says_what_is_left_out(tmp_path):
    """Of the smallest robot: a geom that may touch another one."""
    text = f'<mujoco><worldbody><geom size="1"/>{LINK}</worldbody></mujoco>'
    words = describe_file(rj.scene_file(written(tmp_path, text)))
    assert re.search(r"left out +.*robot.xml: contacts of 2 geoms; say contacts=True", words)
    assert re.search(r"start +all joints hold", words)


# Out again.


@pytest.mark.parametrize("name", ["arm.xml", "parallelogram_arm.xml"])
def test_scenes_are_written_as_mjcf(name, tmp_path):
    """MuJoCo has the same masses, positions, actuators and bias forces in both files."""
    rj.load_scene(GALLERY / name).save(tmp_path / "again.xml")
    models = [
        mujoco.MjModel.from_xml_path(str(x)) for x in (GALLERY / name, tmp_path / "again.xml")
    ]
    data = [mujoco.MjData(model) for model in models]
    for speed in (0.0, 0.7):
        found = []
        for model, own in zip(models, data, strict=True):
            joints = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i): i
                      for i in range(model.njnt)}  # fmt: skip
            order = [int(model.jnt_dofadr[joints[x]]) for x in sorted(joints)]
            for k, i in enumerate(order):
                own.qpos[i] = model.qpos0[i] + 0.1 * k
                own.qvel[i] = speed * (1 + k)
            own.ctrl[:] = 0.2
            mujoco.mj_forward(model, own)
            inertia = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, own, inertia)
            forces = own.qfrc_bias, own.qfrc_passive, own.qfrc_actuator
            found.append([inertia[np.ix_(order, order)], *(x[order] for x in forces)])
        for one, other in zip(*found, strict=True):
            np.testing.assert_allclose(other, one, rtol=0, atol=1e-11 * max(1, np.max(np.abs(one))))


def test_what_mjcf_cannot_hold_is_refused_by_name(tmp_path):
    with pytest.raises(rj.SceneError, match="'cart' is a RigidBody|'pendulum' is a Beam"):
        rj.gallery.cart_pendulum().save(tmp_path / "cart.xml")
    with pytest.raises(rj.SceneError, match="MJCF holds no Coupling such as 'equality0'"):
        rj.load_scene(GALLERY / "gripper.urdf").save(tmp_path / "gripper.xml")


@pytest.mark.instant
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_numbers_that_files_leave_open_follow_the_unit_of_length(unit, tmp_path):
    """How fast friction creeps along a slide and a tendon, and what stops take: of a robot in
    kilometres as of one in metres, wherever it stands, and on whatever. Angles have one unit. So
    does how far contacts yield that no weight loads.
    """
    free = 'contype="0" conaffinity="0"'
    terrain = f'<body><geom type="box" size="{50 / unit} {50 / unit} 1" {free}/></body>'
    floor = '<geom type="plane" size="1 1 1" solimp="0.9 0.9" priority="1" condim="1"/>'
    sphere, far = f'<geom size="{0.1 / unit}" mass="1"/>', 20.0 / unit
    numbers = f'frictionloss="1" range="{-0.2 / unit} {0.3 / unit}" limited="true"'
    path = tmp_path / "robot.xml"
    path.write_text(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{floor}{terrain}'
        f'<site name="c" pos="0 {far} 0"/>'
        f'<body pos="0 {far} 0"><joint type="slide" {numbers}/>{sphere}'
        f'<body pos="{0.4 / unit} 0 0"><joint axis="0 1 0" frictionloss="1"/>{sphere}'
        '<site name="d"/></body></body></worldbody><tendon>'
        f'<spatial {numbers}><site site="c"/><site site="d"/></spatial></tendon></mujoco>'
    )
    effects = rj.load_scene(path, contacts=True).effects
    creep = [e.friction.creep for e in effects if isinstance(e, rj.JointDamper)]
    taken = [e.dissipation for e in effects if isinstance(e, rj.JointStop)]
    np.testing.assert_allclose(creep, [4e-4 / unit, 1e-3, 4e-4 / unit])
    np.testing.assert_allclose(taken, np.full(2, 2.0 * unit / 0.4))
    # Forces k δ^1.5 are in units of a length. By MuJoCo's mean of three directions, of which one is
    # free, 2 kg count as 6.
    stiffness = [float(e.stiffness) for e in effects if isinstance(e, r.Contact)]
    depth, held = 4e-4 * 0.4, 0.9**2 / 0.1 / (0.02 * 0.9) ** 2
    np.testing.assert_allclose(stiffness, np.full(2, 6 * held / depth**0.5 * unit**0.5))
