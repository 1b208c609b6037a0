"""The scene files to begin with, in the plane and in space."""

import os
from pathlib import Path

from ..common import writing
from ..common.errors import InputError

_HEAD = """\
# A scene: bodies, the joints between them and what acts on them, in SI units, angles in radians,
# or in degrees where the key ends with _deg. `romjax check FILE` says what it is,
# `romjax run FILE` simulates it, and `romjax schema` writes what editors complete keys from.
format = 1
"""

_PLANE = """\
title = "two bars on a hinge"
# consistent = true  # moves the start to where all joints hold, such as in a loop

[parameters]  # numbers with names: "=length" stands for one
length = 0.5

[bodies.crank]
type = "Beam"  # a bar with the points "start" and "end", along its x axis
mass = 1.0
length = 0.2
angle_deg = 60.0
place = { point = "start", at = "ground" }  # or its middle: position = [0.05, 0.09]

[bodies.rod]
type = "Beam"
mass = 0.5
length = "=length"
angle_deg = -20.0
place = { point = "start", at = "crank.end" }
# EI = 20.0  # bending stiffness, with a number of modes
# modes = 2
# damping = 0.01
# points = { load = [0.1, 0.0] }  # one more point: "rod.load"

[joints]  # type and two markers: "body.point", "body", or { body = …, point = […], angle_deg = … }
bearing = { type = "Revolute", a = "crank.start", b = "ground" }
pin = { type = "Revolute", a = "rod.start", b = "crank.end" }

[effects.gravity]
type = "Gravity"

# [effects.drive]
# type = "Torque"
# at = "crank"
# signal = { type = "Sine", amplitude = 1.0, frequency = 2.0 }
"""

_SPACE = """\
dimension = 3
title = "an arm on a column that turns"

[parameters]  # numbers with names: "=length" stands for one
length = 0.6

[bodies.column]
type = "spatial.RigidBody"
mass = 4.0
inertia = [0.06, 0.06, 0.02]  # about its own axes, through the centre of mass
position = [0.0, 0.0, 0.2]
extent = [0.1, 0.1, 0.4]  # of the box that pictures show
points = { top = [0.0, 0.0, 0.2] }

[bodies.arm]
type = "spatial.Beam"  # a bar with the points "start" and "end", along its x axis
mass = 1.5
length = "=length"
inertia = [0.001, 0.046, 0.046]
place = { point = "start", at = "column.top" }
# orientation = { axis = [0, 1, 0], angle_deg = -30 }
# EI = 200.0  # bending stiffness, with a number of modes in each plane
# bending = 2
# damping = 0.01

[joints]  # type and two markers; hinges turn about the z axes of both, which a rotation turns
yaw = { type = "Revolute", a = { body = "column", point = [0.0, 0.0, -0.2] }, b = "ground" }

[joints.shoulder]  # about y: the z axis turned about x
type = "Revolute"
a = { body = "arm", point = "start", rotation = { axis = [1, 0, 0], angle_deg = 90 } }
b = { body = "column", point = "top", rotation = { axis = [1, 0, 0], angle_deg = 90 } }

[effects.gravity]
type = "Gravity"
acceleration = [0.0, 0.0, -9.81]

# [effects.motor]  # turns the column, as its target says
# type = "Motor"
# a = { body = "column", point = [0.0, 0.0, -0.2] }
# b = "ground"
# target = { type = "Step", height = 1.0, start = 0.0, duration = 1.0 }
# proportional = 50.0
# derivative = 10.0
"""

_RUN = """
[run]
end = 2.0  # [s]
rate = 100.0  # outputs per second
"""


def write_start(path: Path, space: bool = False) -> None:
    """Write the file of a scene in the plane or in `space`; raises InputError if there is one
    already.
    """
    if os.path.lexists(path):
        raise InputError(f"{path} is there already; give another name.")
    writing.write(path, _HEAD + (_SPACE if space else _PLANE) + _RUN)
