"""Robot files with mistakes that no grammar finds: each is told with its line and a remedy."""

import pytest

import romjax as rj

pytest.importorskip("mujoco")

BALL = '<geom size=".1" mass="1"/>'
LINK = f'<body name="a"><joint name="h"/>{BALL}</body>'
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
MASS += "</inertial>"
TIP = '\n<body name="tip"><joint name="j" axis="1 0 0"/><site name="s"/></body></body>'
# What stands in <worldbody>, or a whole file.
MJCF = {
    "a file includes itself": ('<mujoco>\n<include file="robot.xml"/></mujoco>', ":2: .*20 deep"),
    "an include of no file": ('<mujoco>\n<include file="x.xml"/></mujoco>', ":2: .*no file '.*x"),
    "an include of nothing": ("<mujoco>\n<include/></mujoco>", ":2: <include>: there is no file"),
    "two of one name": (f"{LINK}\n{LINK}", ":2: repeated name 'a'"),
    "entities": ('<!DOCTYPE m [\n<!ENTITY a "aa">]>\n<mujoco/>', ":2: <!ENTITY a>: .*write out"),
    "entities of files": (
        '<!DOCTYPE m [\n<!ENTITY a SYSTEM "file:///x">]>\n<mujoco/>',
        ":2: <!ENTITY a>: .*<include>",
    ),
    "no number": (f'\n<body pos="nan 0 0"><joint/>{BALL}</body>', ":2: <body> pos='nan 0 0'"),
    "infinite": (f'<body>\n<joint damping="inf"/>{BALL}</body>', ":2: .*infinite; give a finite"),
    "a range upside down": (f'<body>\n<joint range="3 -3"/>{BALL}</body>', ":2: .*exchange them"),
    "no inertia": (
        '\n<body name="t"><joint/><inertial pos="0 0 0" mass="1" diaginertia="0 0 0"/></body>',
        ":2: mass and inertia .*give it an <inertial>, or take its joint",
    ),
    "a tip without mass": (LINK.removesuffix("</body>") + TIP, ":2: mass and .*'tip'.*take its"),
    "an inertia of no body": (
        '\n<body name="t"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 5"/></body>',
        r":2: inertia must satisfy A \+ B >= C",
    ),
    "words for numbers": (f'<body>\n<joint axis="a b c"/>{BALL}</body>', ":2: .*'axis'"),
    "no axis": (f'<body>\n<joint name="j" axis="0 0 0"/>{BALL}</body>', ":2: axis too small"),
    "a mesh of no file": (
        '<mujoco><asset>\n<mesh name="m" file="x.stl"/></asset><worldbody><body><joint/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        ":2: Error opening file 'x.stl'; give the file, or an <inertial>",
    ),
    "bodies without end": ("<body>" * 3000 + "</body>" * 3000, ":1: <body> stands in 400 others"),
}
BYTES = {
    "latin": ('<mujoco model="Ü"/>'.encode("latin-1"), ":1: .*save the file in UTF-8"),
    "utf-16": ("<mujoco/>".encode("utf-16"), ":1: the file is in UTF-16; save it in UTF-8"),
    "empty": (b"", ":1: this is no XML, no element found"),
}


def joint(name: str, parent: str, child: str, kind: str = "continuous", more: str = "") -> str:
    axis = '<axis xyz="0 0 1"/>' if kind != "fixed" else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{axis}{more}</joint>\n'


def links(names: str) -> str:
    """The first of them on line 2."""
    return "".join(f'<link name="{name}">{MASS}</link>\n' for name in names)


def mimic(name: str) -> str:
    return f'<mimic joint="{name}" multiplier="2"/>'


URDF = {
    "no joint": (links("ab"), r':3: .*"b">: nothing carries it, nor .a., .*one root; connect both'),
    "several roots": (links("abcd") + joint("j", "a", "b") + joint("k", "c", "d"), ':4: .*"c"'),
    "a ring of links": (
        links("xab") + joint("j", "a", "b") + joint("k", "b", "a"),
        r':5: <joint name="j">: the links carry each other in a ring \(b, a\); open it',
    ),
    "two parents": (
        links("ab") + joint("j", "a", "b") + joint("k", "a", "b"),
        ":5: .*'b' hangs on joint 'j' too, a loop.*<equality>",
    ),
    "an unknown type": (links("ab") + joint("j", "a", "b", "hinged"), ":4: .*'hinged', but there"),
    "an unknown child": (links("ab") + joint("j", "a", "x"), ":4: .*its child 'x' is no link"),
    "no parent": (
        links("ab") + '<joint name="j" type="fixed"><child link="b"/></joint>',
        ":4: .*it has no <parent link",
    ),
    "two links of one name": (links("aab") + joint("j", "a", "b"), ":3: .*line 2 has this name"),
    "limits upside down": (
        links("ab") + joint("j", "a", "b", "revolute", '<limit lower="1" upper="-1"/>'),
        ":4: .*lower limit 1 is above its upper one -1; exchange",
    ),
    "it mimics nobody": (
        links("ab") + joint("j", "a", "b", more=mimic("k")),
        ":4: .*mimics 'k', which is no joint",
    ),
    "it mimics itself": (links("ab") + joint("j", "a", "b", more=mimic("j")), r":4: .*ring \(j\)"),
    "they mimic each other": (
        links("abc")
        + joint("j", "a", "b", more=mimic("k"))
        + joint("k", "b", "c", more=mimic("j")),
        r":5: .*mimic each other in a ring \(j, k\); open it",
    ),
    "a floating branch": (links("ab") + joint("j", "a", "b", "floating"), ":3: free joint can"),
}


def refused(path, words):
    with pytest.raises(rj.SceneFileError, match=words) as error:
        rj.load_scene(path)
    assert all(line.startswith(str(path)) for line in str(error.value).splitlines())


@pytest.mark.instant
@pytest.mark.parametrize("case", MJCF)
def test_a_bad_robot_is_refused(case, tmp_path):
    text, words = MJCF[case]
    whole = text.startswith(("<mujoco", "<!DOCTYPE"))
    path = tmp_path / "robot.xml"
    path.write_text(text if whole else f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    refused(path, words)


@pytest.mark.instant
@pytest.mark.parametrize("case", BYTES)
def test_what_is_no_text_is_refused(case, tmp_path):
    data, words = BYTES[case]
    path = tmp_path / "robot.xml"
    path.write_bytes(data)
    refused(path, words)


@pytest.mark.instant
@pytest.mark.parametrize("case", URDF)
def test_a_bad_urdf_is_refused(case, tmp_path):
    text, words = URDF[case]
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">\n{text}</robot>')
    refused(path, words)


def test_a_mimic_of_a_mimic_is_two_gears(tmp_path):
    """A joint that follows one that follows another turns by the product of both."""
    chain = joint("j", "a", "b") + joint("k", "b", "c", more=mimic("j"))
    chain += joint("m", "c", "d", more=mimic("k"))
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">\n{links("abcd")}{chain}</robot>')
    gears = [x for x in rj.load_scene(path).joints if isinstance(x, rj.Coupling)]
    found = [(gear.a.body, gear.b.body, [float(x) for x in gear.coefficients]) for gear in gears]
    assert found == [("c", "b", [0.0, 2.0]), ("d", "c", [0.0, 2.0])]
