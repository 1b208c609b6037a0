"""The scene file to begin with."""

import os
from pathlib import Path

from ..common import writing
from ..common.errors import InputError

_START = """\
# A scene: bodies, the joints between them and what acts on them, in SI units, angles in radians,
# or in degrees where the key ends with _deg. `romjax check FILE` says what it is,
# `romjax run FILE` simulates it, and `romjax schema` writes what editors complete keys from.
format = 1
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

[run]
end = 2.0  # [s]
rate = 100.0  # outputs per second
"""


def write_start(path: Path) -> None:
    """Write the file; raises InputError if there is one already."""
    if os.path.lexists(path):
        raise InputError(f"{path} is there already; give another name.")
    writing.write(path, _START)
