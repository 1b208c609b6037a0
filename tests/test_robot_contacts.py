"""Contacts of robot files: which geoms touch, and how, as MuJoCo has it."""

import jax
import numpy as np
import pytest
from robot_files import GALLERY, words
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj
from romjax import spatial as r

mujoco = pytest.importorskip("mujoco")

CAPSULE = 'type="capsule" size="0.05 0.2"'


def written(folder, bodies, more=""):
    path = folder / "robot.xml"
    text = f'<option cone="elliptic"/>{more}<worldbody>{bodies}</worldbody>'
    path.write_text(f"<mujoco>{text}</mujoco>")
    return path


def crowd(random) -> str:
    """Links of chains in one heap, with bits of all kinds, over a floor, and a sphere of it."""
    text = '<geom name="floor" type="plane" size="1 1 1" pos="0 0 1"/>'
    text += '<geom name="bump" size="0.6" conaffinity="3"/><body name="still"><geom size="0.5"/>'
    text += "</body>"
    for chain in range(3):
        for link in range(3):
            kind = random.choice(["sphere", "capsule"])
            bits = f'contype="{random.integers(4)}" conaffinity="{random.integers(4)}"'
            rubbing = f'friction="{random.uniform()}" priority="{random.integers(2)}"'
            yields = f'solref="{random.uniform(0.01, 0.05)} 1" solmix="{random.uniform()}"'
            text += f'<body name="b{chain}{link}" pos="{words(0.05 * random.normal(size=3))}">'
            text += (
                "<freejoint/>" if link == 0 else f'<joint axis="{words(random.normal(size=3))}"/>'
            )
            text += f'<geom name="g{chain}{link}" type="{kind}" size="0.5 0.1" {bits} {rubbing} '
            text += f'{yields} condim="{random.choice([1, 3])}"/><body><geom size="0.4"/></body>'
        text += "</body>" * 3
    return text


@pytest.mark.instant
def test_the_geoms_touch_that_touch_in_mujoco(tmp_path):
    """In a heap, of which all that may touch do: by their bits, those that the file names, not of a
    link and the one that carries it, and not of bodies that it excludes; with the same friction.
    """
    pairs = '<contact><exclude body1="b20" body2="b00"/><exclude body1="b01" body2="b12"/>'
    pairs += '<pair geom1="g00" geom2="floor" friction="0.7 0.7 0 0 0"/></contact>'
    path = written(tmp_path, crowd(np.random.default_rng(3)), pairs)
    with pytest.warns(UserWarning, match="contact of capsule and capsule: 'g") as said:
        scene = rj.load_scene(path, contacts=True)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    known = dict[tuple, set]()
    for contact in data.contact[: data.ncon]:
        kinds = [int(model.geom_type[i]) for i in contact.geom]
        if kinds == [3, 3]:
            continue
        links = (int(model.body_weldid[model.geom_bodyid[i]]) for i in contact.geom)
        bodies = tuple(sorted(model.body(i).name if i else "ground" for i in links))
        friction = contact.friction[0] if contact.dim > 1 else None
        known.setdefault(bodies, set()).add(friction)
    found = dict[tuple, set]()
    for effect in scene.effects[1:]:
        bodies = tuple(sorted((effect.a.body, effect.b.body)))
        friction = effect.friction and float(effect.friction.coefficient)
        found.setdefault(bodies, set()).add(friction)
    assert len(found) > 15
    assert found == known
    assert len(said) == 1


@pytest.mark.instant
def test_contacts_that_are_not_asked_for_are_listed(tmp_path):
    """As those of shapes that romjax does not let touch, and what changes a contact besides."""
    bodies = '<geom name="floor" type="plane" size="1 1 1"/>\n<body pos="0 0 3"><joint/>'
    bodies += '<geom name="k" type="box" size="1 1 1"/></body>\n<body pos="0 3 2"><freejoint/>'
    bodies += '<geom name="m" size="1" condim="4" margin="0.1"/></body>'
    path = written(tmp_path, bodies)
    with pytest.warns(UserWarning, match="contacts of 3 geoms; say contacts=True"):
        assert len(rj.load_scene(path).effects) == 1
    scene = rj.scene_file(path, contacts=True)
    assert [str(x).partition("robot.xml")[2] for x in scene.left_out] == [
        ":2: contact of plane and box: 'floor' and 'k'",
        ":3: margin of a contact: 'floor' and 'm'",
        ":3: friction of a contact against pivoting and rolling: 'floor' and 'm'",
        ":2: contact of sphere and box: 'm' and 'k'",
    ]
    assert len(scene().effects) == 2
    # A mesh of a link that has its inertia by numbers is not read, and may touch all the same.
    mesh = '<worldbody><body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    mesh += '<geom type="mesh" mesh="m"/></body></worldbody>'
    asset = '<asset><mesh name="m" file="m.stl"/></asset>'
    flag = '<option><flag contact="disable"/></option>'
    told = {
        (True, ""): ["contacts of 1 meshes"],
        (False, ""): ["contacts of 1 meshes; say contacts=True for those"],
        (True, flag): ['contacts, which <flag contact="disable"/> switches off'],
        (False, flag): [],
    }
    for (asked, more), lines in told.items():
        path.write_text(f"<mujoco>{more}{asset}{mesh}</mujoco>")
        said = rj.scene_file(path, contacts=asked).left_out
        assert [str(x).partition("robot.xml: ")[2][:47] for x in said] == [x[:47] for x in lines]
    off = rj.scene_file(GALLERY / "leg.xml", contacts=True).left_out
    assert [str(x).partition("leg.xml")[2][:12] for x in off] == [": contacts, "]


def lying(z: float, more: str = "") -> str:
    """A ball, and a capsule that lies, at a height over the floor; they pass through each other."""
    turn = 'quat="0.7071067811865476 0 0.7071067811865476 0"'
    alone = f'contype="2" conaffinity="1" {more}'
    return (
        '<geom name="floor" type="plane" size="1 1 1"/>'
        f'<body name="ball" pos="0 0 {z}"><freejoint/><geom size="0.1" {alone}/></body>'
        f'<body name="rod" pos="0 2 {z}" {turn}><freejoint/><geom {CAPSULE} {alone}/></body>'
    )


OVERRIDE = (
    '<flag override="enable"/></option><option o_solref="0.05 0.7" o_solimp="0.8 0.9 0.01" '
    'o_friction="0.4 {} 0 0 0" {}>'
)
# What a contact yields by, and the options of the file.
YIELDING = {
    "default": ("", ""),
    "without a step that is safe": ('solref="0.002 1"', ""),
    "stiffer than the step": ('solref="0.002 1"', '<flag refsafe="disable"/>'),
    "soft at first": ('solimp="0 0.95 0.001"', ""),
    "rigid": ('solimp="1 1"', ""),
    "softer and softer": ('solimp="0.95 0.9 0.001"', ""),
    "no width": ('solimp="0.9 0.95 0 0 0.5"', ""),
    "no middle": ('solimp="0.8 0.95 0.001 1 2"', ""),
    "no damping ratio": ('solref="0.02 0"', ""),
    "half of each form": ('solref="-9000 5"', ""),
    "by stiffness": ('solref="-9000 -50"', ""),
    "by the options": ('solref="0.1 1"', OVERRIDE.format("0.4", "")),
}


@pytest.mark.instant
@pytest.mark.parametrize("case", YIELDING)
def test_contacts_yield_as_mujoco_says(case, tmp_path):
    """At the depth at which Hertz's law carries the weight, that of MuJoCo does, r K d² / (1 − d),
    and the damping ratio is the same; numbers that MuJoCo cuts off are cut off.
    """
    numbers, option = YIELDING[case]
    geom = f'<geom size="0.1" {numbers} priority="1"/>'
    bodies = f'<geom type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/>{geom}</body>'
    path = tmp_path / "robot.xml"
    path.write_text(f"<mujoco><option>{option}</option><worldbody>{bodies}</worldbody></mujoco>")
    scene = rj.load_scene(path, contacts=True)
    contact, weight = scene.effects[1], 9.81
    depth = (float(scene.bodies[0].mass) * weight / float(contact.stiffness)) ** (2 / 3)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[2] = 0.1 - depth
    mujoco.set_mju_user_warning(lambda words: None)
    mujoco.mj_forward(model, data)
    mujoco.set_mju_user_warning(None)
    stiffness, damping, d, _ = data.efc_KBIP[0]
    np.testing.assert_allclose(depth * stiffness * d**2 / (1 - d), weight, rtol=SOLVED)
    expected = damping / np.sqrt(stiffness) * np.sqrt(1.5 / (weight * depth))
    np.testing.assert_allclose(contact.dissipation, expected, rtol=SOLVED)


@pytest.mark.instant
def test_options_that_override_contacts(tmp_path):
    """Their friction is taken, in place of that of geoms and pairs; what has no counterpart here is
    listed, and what they replace is not.
    """
    bodies = '<geom name="f" type="plane" size="1 1 1"/>\n<body pos="0 0 1"><freejoint/>'
    bodies += '<geom name="b" size="0.1"/><geom name="c" size="0.1" margin="1"/></body>'
    pair = '<contact><pair geom1="f" geom2="b" friction="1 0.5 0 0 0"/></contact>'
    two = ["margin of a contact", "friction that differs by direction"]
    for across, margin, left_out in (("0.3", 'o_margin="0.01"', two), ("0.4", "", [])):
        option = f"<option>{OVERRIDE.format(across, margin)}</option>"
        scene = rj.scene_file(written(tmp_path, bodies, option + pair), contacts=True)
        words = [f":2: {what}: 'f' and 'b' and 1 more" for what in left_out]
        assert [str(x).partition("robot.xml")[2] for x in scene.left_out] == words
        assert [float(x.friction.coefficient) for x in scene().effects[1:]] == [0.4, 0.4]


@pytest.mark.instant
def test_contacts_that_hold_nothing(tmp_path):
    """One without stiffness is refused, with its line; one of two geoms that no joint moves against
    each other acts on nothing, in MuJoCo neither. Terrain does not count as a part of the robot.
    """
    ball = '<body pos="0 0 1"><freejoint/><geom name="b" size="0.1" {}/><geom name="c" size="0.2"/>'
    bodies = f'<geom name="f" type="plane" size="1 1 1"/>\n{ball}</body>'
    soft = bodies.format('solref="0 0" priority="1"')
    with pytest.raises(rj.SceneFileError, match=r":2: geom 'b': solref is \[0. 0.\].*no zeros"):
        rj.load_scene(written(tmp_path, soft), contacts=True)
    terrain = '<geom name="s" size="9 9 9" type="box" pos="0 0 -9" contype="0" conaffinity="0"/>'
    pairs = '<pair geom1="b" geom2="c"/><pair geom1="s" geom2="f"/>'
    scenes = []
    for still, more in (("", ""), (f"{terrain}<body>{terrain.replace('s', 't', 1)}</body>", pairs)):
        text = bodies.format("").replace("\n", f"{still}\n")
        scenes.append(
            rj.scene_file(written(tmp_path, text, f"<contact>{more}</contact>"), contacts=True)
        )
    assert scenes[0].left_out == ()
    assert [str(x).partition("robot.xml")[2] for x in scenes[1].left_out] == [
        ":1: contact of what cannot move against each other: 'f' and 's' and 1 more"
    ]
    assert len(scenes[0]().effects) == len(scenes[1]().effects)


@pytest.mark.slow
def test_what_falls_comes_to_rest_as_in_mujoco(tmp_path):
    """A ball to the digits of both; a rod, of which each end carries half of the weight, within
    12 % of how deep it lies, since one law is Hertz's and the other is not.
    """
    path = written(tmp_path, lying(0.15))
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 5000)
    system = rj.assemble(rj.load_scene(path, contacts=True))
    run = rj.simulate(system, np.linspace(0.0, 2.0, 3), rtol=1e-8, audit=False)
    assert abs(run["ball.z"][-1] - data.qpos[2]) < SOLVED
    depth = 0.05 - data.qpos[9]
    assert 1e-4 < depth < 1e-3
    assert abs(run["rod.z"][-1] - data.qpos[9]) < 0.12 * depth


@pytest.mark.slow
def test_what_has_no_damping_bounces_back(tmp_path):
    """With all of its energy; its depth at the turn is that of Hertz's law, m g h = ⅖ k δ^(5/2)."""
    path = written(tmp_path, lying(0.3, 'solref="-9000 0"'))
    scene = rj.load_scene(path, contacts=True)
    mass, stiffness = (float(x) for x in (scene.bodies[0].mass, scene.effects[1].stiffness))
    touching = np.sqrt(2 * 0.2 / 9.81) + np.linspace(0.0, 0.04, 2001)
    times = np.concatenate([[0.0], touching])
    run = rj.simulate(rj.assemble(scene), times, rtol=TIGHT, audit=False)
    height, speed = np.asarray(run["ball.z"]), np.asarray(run["ball.z'"])
    depth = 0.1 - height.min()
    np.testing.assert_allclose(
        0.4 * stiffness * depth**2.5, mass * 9.81 * (0.2 + depth), rtol=DIFFERENCED
    )
    assert height[-1] > 0.1
    assert abs(height[-1] + 0.5 * speed[-1] ** 2 / 9.81 - 0.3) < SOLVED


def test_the_distance_of_a_capsule():
    """Beside it, over an end, oblique to that, and inside."""
    points = np.array([[0.3, 0.4, 0.2], [0.0, 0.0, -1.0], [0.4, 0.0, 0.6], [0.03, 0.04, 0.1]])
    found = jax.vmap(r.Capsule(0.1, 0.6))(points)
    np.testing.assert_allclose(found, [0.4, 0.6, 0.4, -0.05], atol=IDENTITY)
