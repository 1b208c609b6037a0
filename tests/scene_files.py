"""Scene files for tests: a slider crank, what is written wrong in it, and what is read the same."""

import jax
import jax.numpy as jnp
import numpy as np

CRANK = """\
format = 1
title = "slider crank"
consistent = true

[parameters]
speed = 5.0
length = 0.4

[ground.points]
bearing = [0.0, 0.0]

[bodies.crank]
type = "Beam"
mass = 1.0
length = 0.2
angle_deg = 60
angular_velocity = "=speed"
place = { point = "start", at = "ground.bearing" }

[bodies.rod]
type = "Beam"
mass = 0.5
length = "=length"
EI = 100.0
modes = 1
angle_deg = -25.0
points = { middle = [0.0, 0.0] }
place = { point = "start", at = "crank.end" }

[bodies.slider]
type = "RigidBody"
mass = 1.0
inertia = 0.01
place = { point = [0.0, 0.0], at = "rod.end" }

[joints]
bearing = { type = "Revolute", a = "crank.start", b = "ground.bearing" }
pin = { type = "Revolute", a = "crank.end", b = "rod.start" }
wrist = { type = "Revolute", a = "rod.end", b = "slider" }
guide = { type = "Prismatic", a = "slider", b = "ground" }

[effects.gravity]
type = "Gravity"

[effects.load]
type = "Force"
at = { body = "rod", point = "middle", angle_deg = 90.0 }
direction = [1.0, 0.0]
signal = { type = "Sine", amplitude = 1.0, frequency = 2.0 }

[run]
end = 0.1
rate = 100.0
"""

SPACE = """\
format = 1
dimension = 3

[parameters]
tilt = 30.0

[bodies.top]
type = "spatial.RigidBody"
mass = 1.0
inertia = [0.1, 0.2, 0.3]
orientation = { axis = [0.0, 2.0, 0.0], angle_deg = "=tilt" }

[joints]
hinge.type = "spatial.Revolute"
hinge.a = { body = "top", rotation = { euler = "ZXZ", angles_deg = [10.0, 20.0, 30.0] } }
hinge.b = { body = "ground", rotation = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] }
"""

# Of rotations, as MISTAKES below.
WRONG_ROTATIONS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "no axis": ("axis = [0.0, 2.0, 0.0], ", "", (":11: [bodies.top] orientation.axis", "missing")),
    "an axis of zeros": ("2.0, 0.0]", "0.0, 0.0]", (":11:", "orientation.axis", "not all zero")),
    "no angle": (', angle_deg = "=tilt"', "", (":11:", "`angle` is missing", "`angle_deg`")),
    "both angles": ("angle_deg =", "angle = 1.0, angle_deg =", ("angle_deg", "one of both")),
    "convention": ('"ZXZ"', '"ZXx"', (":15: [joints.hinge] a.rotation.euler", "three letters")),
    "one axis twice": ('"ZXZ"', '"ZZX"', ("a.rotation.euler", "no two alike")),
    "no Euler angles": (", angles_deg = [10.0, 20.0, 30.0]", "", (":15:", "`angles` is missing")),
    "two Euler angles": ("[10.0, 20.0,", "[10.0,", ("a.rotation.angles_deg", "a list of 2")),
    "unknown key": ("axis =", "axes =", ("orientation.axes", "mean 'axis'")),
    "no matrix": ("-1.0, 0.0], [1.0", "-1.0, 0.0], [2.0", (":16:", "b", "not one")),
    "five numbers": ('{ axis = [0.0, 2.0, 0.0], angle_deg = "=tilt" }', "[1, 0, 0, 0, 0]",
                     (":11: [bodies.top] orientation", "a list of 5")),
}  # fmt: skip

# What replaces what, and what the message says, with the line and the key where one is to blame.
MISTAKES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    # The file.
    "nothing": (CRANK, "", ("`format` is missing; add format = 1",)),
    "newer version": ("format = 1", "format = 2", (":1: format:", "install a newer one")),
    "no version": ("format = 1", "", ("`format` is missing",)),
    "version as text": ("format = 1", 'format = "1"', ("the text '1'; write format = 1",)),
    "space": ("format = 1", "format = 1\ndimension = 3", (":2: dimension", "write dimension = 2")),
    "bodies of the plane in space": (
        "format = 1",
        "format = 1\ndimension = 3\n[bodies.box]\ntype = 'RigidBody'\nmass = 1\ninertia = [1, 1]",
        (":3: [bodies.box]", "dimension = 3", 'write type = "spatial.RigidBody"'),
    ),
    "four dimensions": ("format = 1", "format = 1\ndimension = 4", ("write dimension = 2",)),
    "open bracket": ("[bodies.rod]", "[bodies.rod", ("no TOML, line 20", "Expected ']'")),
    "no quotes": ('type = "Gravity"', "type = Gravity", ("no TOML, line 43", "Texts need quotes")),
    "no equals sign": ("mass = 0.5", "mass 0.5", ("no TOML, line 22", "followed by =")),
    "the same table": ("[bodies.slider]", "[bodies.rod]", ("no TOML, line 30", "its own name")),
    "the same key": ("modes = 1", "modes = 1\nmodes = 2", ("no TOML", "stands once")),
    "half a file": (CRANK[700:], "", ("no TOML",)),
    "deep lists": ("end = 0.1", f"end = {'[' * 30}{']' * 30}", ("nested more than 24",)),
    "very deep lists": ("end = 0.1", f"end = {'[' * 5000}{']' * 5000}", ("nested more than",)),
    "endless digits": ("end = 0.1", f"end = {'9' * 5000}", ("no TOML",)),
    # Keys.
    "unknown table": ("[effects.load]", "[efects.load]", (":45: efects", "'effects'")),
    "unknown key": (
        "mass = 0.5",
        "mas = 0.5",
        (":22: [bodies.rod] mas:", "mean 'mass'", "missing"),
    ),
    "upper case": ("inertia = 0.01", "Inertia = 0.01", ("[bodies.slider] Inertia", "'inertia'")),
    "key of another type": ("inertia = 0.01", "inertia = 0.01\nmodes = 2", ("no key 'modes'",)),
    "material of a beam": (
        "EI = 100.0",
        "E = 2e11",
        ("no key 'E'", 'The type "Beam.of_section" has section, density, modulus.'),
    ),
    "unknown key in a table": ('point = "middle"', 'pont = "middle"', ("at.pont", "'point'")),
    "unknown key of a signal": ("frequency", "frequenz", ("signal.frequenz", "'frequency'")),
    "unknown key of the run": ("rate = 100.0", "rtal = 1e-6", (":53: [run] rtal", "'rtol'")),
    "missing key": ("inertia = 0.01\n", "", (":30: [bodies.slider] inertia", "missing; add it")),
    "missing type": ('type = "RigidBody"\n', "", (":30: [bodies.slider]", "RigidBody")),
    "unknown type": ('"RigidBody"', '"RigidBoddy"', ("[bodies.slider]", "mean 'RigidBody'")),
    "type of a joint": ('"RigidBody"', '"Revolute"', ("no type 'Revolute'", "Beam")),
    "abstract type": ('"RigidBody"', '"AbstractBody"', ("no type 'AbstractBody'",)),
    "unknown signal": ('"Sine"', '"Sinus"', ("[effects.load] signal", "mean 'Sine'")),
    "a body as a number": ("[joints]", "[joints]\nold = 3", (":37: [joints.old]", "a table")),
    "bodies as a list": ("[bodies.crank]", "[[bodies]]", ("bodies", "a table is needed")),
    "body in body": ("[bodies.slider]", "[bodies.rod.slider]", ("no key 'slider'",)),
    # Values.
    "text for a number": (
        "mass = 0.5",
        'mass = "0.5"',
        (":22: [bodies.rod] mass", "without quotes"),
    ),
    "words for a number": ("mass = 0.5", 'mass = "heavy"', ('A parameter is "=name"',)),
    "truth for a number": ("mass = 0.5", "mass = true", ("It is true, but a number",)),
    "date for a number": ("mass = 0.5", "mass = 1979-05-27", ("It is 1979-05-27",)),
    "list for a number": ("mass = 0.5", "mass = [0.5]", ("a list of 1, but a number",)),
    "number for a list": (
        "direction = [1.0, 0.0]",
        "direction = 1.0",
        ("a list of 2 or 3 numbers",),
    ),
    "three coordinates": (
        "[1.0, 0.0]",
        "[1.0, 0.0, 0.0]",
        ("[effects.load] direction", "(3,)", "(2)"),
    ),
    "infinite": ("mass = 0.5", "mass = inf", ("It is inf, but every number must be finite",)),
    "not a number": ("mass = 0.5", "mass = nan", ("every number must be finite",)),
    "overflow": ("mass = 0.5", f"mass = 1{'0' * 400}", ("every number must be finite",)),
    "fraction of a mode": ("modes = 1", "modes = 1.5", ("[bodies.rod] modes", "a whole number")),
    "unknown method": ("rate = 100.0", 'solver = "Euler"', ("[run] solver", "'Rodas5P'")),
    "radians and degrees": ("angle_deg = 60", "angle_deg = 60\nangle = 1", ("one of both",)),
    "degrees of a length": ("length = 0.2", "length_deg = 0.2", ("no key 'length_deg'",)),
    # What makes no sense.
    "negative mass": ("mass = 0.5", "mass = -0.5", (":22: [bodies.rod] mass", "must be positive")),
    "no direction": ("[1.0, 0.0]", "[0.0, 0.0]", ("[effects.load] direction", "not zero")),
    "modes without stiffness": ("EI = 100.0\n", "", ("[bodies.rod] modes", "need EI")),
    "no time": ("end = 0.1", "end = -0.1", (":52: [run] end", "positive")),
    "a body named ground": ("[bodies.slider]", "[bodies.ground]", ("'ground' is taken",)),
    "point with a taken name": ("middle =", "end =", (":20: [bodies.rod]", "another name")),
    # What refers to something else.
    "unknown body": ('"slider" }', '"slidr" }', (":39: [joints.wrist] b", "'slider'")),
    "unknown point": (
        '"crank.end", b',
        '"crank.tip", b',
        ("[joints.pin] a", "'tip'", "start, end"),
    ),
    "unknown ground point": ('ground.bearing" }\n\n', 'ground.berring" }\n\n', ("'bearing'",)),
    "joint with itself": ('b = "rod.start"', 'b = "crank.start"', ("Both markers are on 'crank'",)),
    "formula": ('"=speed"', '"=2*speed"', ("no parameter '2*speed'", "There are no formulas")),
    "unknown parameter": ('"=speed"', '"=sped"', ("[bodies.crank] angular_velocity", "'speed'")),
    "cyclic parameters": ("speed = 5.0", 'speed = "=v"\nv = "=speed"', ("speed = v = speed",)),
    "parameter of a parameter": (
        "speed = 5.0",
        'speed = "=v"',
        ("[parameters] speed", "no parameter"),
    ),
    "parameter as text": ("speed = 5.0", 'speed = "fast"', ("[parameters] speed", "a number")),
    "placed by itself": ('at = "crank.end"', 'at = "rod.end"', ("placed by each other: rod, rod",)),
    "placed in a circle": ('"ground.bearing" }\n\n', '"slider" }\n\n', ("placed by each other",)),
    "placed twice": ("inertia = 0.01", "inertia = 0.01\nposition = [0, 0]", ("one of both",)),
    "missing array": ("[1.0, 0.0]", '{ file = "none.npz", array = "d" }', ("There is no file",)),
}

# What only the joints know together, which `romjax check` says: geometry and contradictions.
TETHERED = """\
format = 1

[bodies.bar]
type = "RigidBody"
mass = 1.0
inertia = 0.1

[bodies.puck]
type = "RigidBody"
mass = 1.0
inertia = 0.1

[joints.hinge]
type = "Revolute"
a = { body = "bar", point = [-0.5, 0.0] }
b = { body = "ground", point = [-0.5, 0.0] }

[joints.one]
type = "Distance"
a = "bar"
b = { body = "ground", point = [0.0, 1.0] }
length = 1.0

[joints.two]
type = "Distance"
a = "bar"
b = { body = "ground", point = [0.0, 1.0] }
length = 1.0
"""
IMPOSSIBLE: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "out of reach": ("[0.0, 1.0]", "[0.0, 9.0]", ("still violated", "cannot all hold")),
    "two lengths": (
        "length = 1.0\n\n[joints.two]",
        "length = 0.8\n\n[joints.two]",
        (":18: [joints.one]", "cannot all hold"),
    ),
}


def bits(scene):
    leaves, structure = jax.tree.flatten(scene)
    return structure, [(np.asarray(x).tobytes(), np.shape(x), jnp.result_type(x)) for x in leaves]


def assert_same(scene, other):
    """The same parts with the same numbers, to the bit: then the same system, too."""
    assert bits(scene) == bits(other)
