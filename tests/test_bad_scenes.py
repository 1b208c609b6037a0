"""Parts and scenes that make no sense are refused, in words that name them and the remedy."""

import pytest
from test_bad_input import NAN, bar
from test_bad_input import _as_users_run as _as_users_run

import romjax as rj
from romjax import spatial


def driven(**numbers):
    return rj.Actuator(bar().at(), rj.ground.at(), rj.Constant(1.0), **numbers)


def swapped(kind, **numbers):
    """A section before the length."""
    section = rj.sections.Rectangle(0.01, 0.02)
    return lambda: kind.of_section("link", section, 0.4, density=1.0, modulus=1.0, **numbers)


SWAPPED = r"'link': section is of type float; give the length first, then one of romjax\.sections"
PARTS = {
    "section before the length of a beam": (swapped(rj.Beam, modes=2), SWAPPED),
    "of a rod": (swapped(rj.Rod, modes=2), SWAPPED),
    "of a beam in space": (swapped(spatial.Beam), SWAPPED),
    "of a rod in space": (swapped(spatial.Rod, shear_modulus=1.0, modes=2), SWAPPED),
    "zero mass": (
        lambda: bar(mass=0.0),
        r"body 'bar': mass is 0\.0, but it must be positive.*weld it to a neighbour.*lump",
    ),
    "zero mass in space": (
        lambda: spatial.RigidBody("cross", 0.0, (0.0, 0.0, 0.0)),
        r"body 'cross': mass is 0\.0.*weld it to a neighbour .*Universal.*lump",
    ),
    "negative mass": (lambda: bar(mass=-2.0), r"'bar': mass is -2\.0.*positive.*small inertia"),
    "negative inertia": (lambda: bar(inertia=-1.0), r"'bar': inertia is -1\.0"),
    "NaN mass": (lambda: bar(mass=NAN), r"'bar': mass is nan; every number must be finite"),
    "NaN position": (lambda: bar(position=(NAN, 0.0)), r"'bar': position .*finite"),
    "wrong shape of a position": (
        lambda: bar(position=(0.0, 0.0, 0.0)),
        r"'bar': position has shape \(3,\), but it must have shape \(2\)",
    ),
    "wrong shape of a mass": (
        lambda: bar(mass=[1.0, 2.0]),
        r"'bar': mass has shape \(2,\), but it must be a single number",
    ),
    "no name": (lambda: bar(""), "give it a non-empty name"),
    "the name of the ground": (lambda: bar("ground"), "'ground' is taken"),
    "beam with EI and frequencies": (
        lambda: rj.Beam("beam", 1.0, 1.0, EI=1.0, frequencies=[1.0]),
        "'beam': give either EI or frequencies, not both",
    ),
    "beam with EI, no count": (
        lambda: rj.Beam("beam", 1.0, 1.0, EI=1.0),
        "'beam': with EI, say how many modes",
    ),
    "beam with modes only": (
        lambda: rj.Beam("beam", 1.0, 1.0, modes=2),
        "'beam': 2 modes need EI or frequencies",
    ),
    "beam of two minds": (
        lambda: rj.Beam("beam", 1.0, 1.0, modes=2, frequencies=[1.0]),
        "'beam': modes=2, but 1 frequencies are given",
    ),
    "beam of no length": (lambda: rj.Beam("beam", 1.0, 0.0), r"'beam': length is 0\.0.*positive"),
    "beam along z": (lambda: rj.Beam("beam", 1.0, 1.0, axis="z"), "axis is 'z'.*one of x, y"),
    "beam on a wall": (
        lambda: rj.Beam("beam", 1.0, 1.0, shapes="clamped"),
        "shapes is 'clamped'.*static, free-free, clamped-free, pinned-free",
    ),
    "static shapes of given frequencies": (
        lambda: rj.Beam("beam", 1.0, 1.0, frequencies=[5.0], shapes="static"),
        "'beam': shapes is 'static', but frequencies.*give EI instead, or one of free-free",
    ),
    "rigid bar that stiffens": (
        lambda: rj.Beam("beam", 1.0, 1.0, stiffening=True),
        "stiffening is for beams with modes",
    ),
    "beam that drives": (
        lambda: rj.Beam("beam", 1.0, 1.0, EI=1.0, modes=1, damping=-0.1),
        "'beam': damping is .*must not be negative",
    ),
    "clamped beam of too little inertia": (
        lambda: rj.Beam("beam", 3.0, 1.5, EI=5.0, modes=3, inertia=0.3, shapes="clamped-free"),
        "'beam': inertia is 0.3, 0.2625 less than that of a thin bar",
    ),
    "tube of nothing but wall": (
        lambda: rj.sections.Tube(0.02, 0.011),
        "'Tube': its walls overlap by 0.002 m",
    ),
    "spring without stiffness": (
        lambda: rj.Spring(bar().at(), rj.ground.at(), None),
        "stiffness is None; give a number",
    ),
    "body of negative mass matrix": (
        lambda: rj.ModalBody(
            "rod",
            rj.Inertia(1.0, 1.0, shift=[[0.0], [2.0]]),
            stiffness=[1.0],
            points=[[0.0, 0.0]],
            shapes=[[[0.0], [1.0], [0.0]]],
        ),
        "'rod': its mass matrix is not positive definite.*eigenvalue of -",
    ),
    "hinge on one body": (
        lambda: rj.Revolute(bar().at(), bar().at((1.0, 0.0))),
        r"Revolute\(bar, bar\).*both markers are on 'bar'.*two bodies",
    ),
    "NaN marker": (
        lambda: rj.Revolute(bar().at((NAN, 0.0)), rj.ground.at()),
        r"Revolute\(bar, ground\).*marker on 'bar': point .*finite",
    ),
    "negative stiffness": (
        lambda: rj.Spring(bar().at(), rj.ground.at(), stiffness=-1.0),
        r"Spring\(bar, ground\).*stiffness is -1\.0.*not be negative",
    ),
    "negative damping": (
        lambda: rj.Damper(bar().at(), rj.ground.at(), damping=-1.0),
        r"Damper\(bar, ground\).*damping is -1\.0.*not be negative",
    ),
    "force without direction": (
        lambda: rj.Force(bar().at(), (0.0, 0.0), rj.Constant(1.0)),
        r"Force\(bar\).*direction is \[0\. 0\.\]; give a vector that is not zero",
    ),
    "force with a direction that vanishes": (
        lambda: rj.Force(bar().at(), (1e-300, 0.0), rj.Constant(1.0)),
        r"direction is .*1\.e-300.*whose square numbers can hold",
    ),
    "force without signal": (
        lambda: rj.Force(bar().at(), (1.0, 0.0), 10.0),
        r"signal is 10\.0; give a signal such as Constant\(10\.0\)",
    ),
    "table that goes back": (
        lambda: rj.Force(bar().at(), (1.0, 0.0), rj.Table([0.0, 2.0, 1.0], [0.0, 1.0, 2.0])),
        r"Table\.times must increase, but they are \[0\. 2\. 1\.\]",
    ),
    "table of two lengths": (
        lambda: rj.Force(bar().at(), (1.0, 0.0), rj.Table([0.0, 1.0], [0.0])),
        r"Table\.values has shape \(1,\), but it must have shape \(2\)",
    ),
    "gravity of four numbers": (
        lambda: rj.Gravity((0.0, 0.0, 0.0, -9.81)),
        r"'Gravity': acceleration has shape \(4,\)",
    ),
    "gravity of space in the plane": (
        lambda: rj.Scene(
            [rj.RigidBody("a", 1.0, 1.0)], [], [rj.Gravity((0.0, 0.0, -9.81))]
        ).check(),
        "effect 'Gravity' is in space, but body 'a' is in the plane",
    ),
    "no links": (lambda: rj.gallery.chain(0), "links is 0, but a chain needs at least one"),
    "unknown example": (
        lambda: rj.gallery.find("cart-pendulm"),
        "no scene 'cart-pendulm'; did you mean 'cart-pendulum'",
    ),
    "empty scene": (lambda: rj.assemble(rj.Scene([])), "has no bodies; add at least one"),
    "two of one name": (
        lambda: rj.assemble(rj.Scene([bar(), bar()])),
        "Two bodies are named 'bar'; every body needs its own name",
    ),
    "unknown body": (
        lambda: rj.assemble(
            rj.Scene([bar("rod")], [rj.Revolute(bar("crank").at(), rj.ground.at(), name="pin")])
        ),
        "'pin': its marker is on the body 'crank', which the scene does not have. It has: rod",
    ),
    "unknown body of a spring": (
        lambda: rj.assemble(
            rj.Scene([bar()], [], [rj.Spring(bar("x").at(), rj.ground.at(), stiffness=1.0)])
        ),
        "marker is on the body 'x'",
    ),
    "a distance below zero": (
        lambda: rj.PrescribedDistance(bar().at(), rj.ground.at(), rj.Constant(-1.0)),
        r"'PrescribedDistance\(bar, ground\)': its signal is -1 m, .*keep the distance positive",
    ),
    "a distance that begins at zero": (
        lambda: rj.assemble(
            rj.Scene([bar()], [rj.PrescribedDistance(bar().at(), rj.ground.at(), rj.Ramp(1.0))])
        ),
        r"'PrescribedDistance\(bar, ground\)': its markers are apart by 0 m.*by a Revolute",
    ),
    "limits in the wrong order": (
        lambda: driven(least=2.0, largest=1.0),
        r"Actuator\(bar, ground\)': least is 2 and largest 1; give a lower limit not above",
    ),
    "limits of a signal in the wrong order": (
        lambda: driven(least_signal=2.0, largest_signal=1.0),
        "least_signal is 2 and largest_signal 1",
    ),
    "a controller without room": (
        lambda: rj.PID(bar().at(), rj.ground.at(), rj.Constant(0.0), least=2.0, largest=1.0),
        r"PID\(bar, ground\)': least is 2 and largest 1",
    ),
    "an activation without room": (
        lambda: driven(activation=rj.Activation(0.1, 2.0, 1.0, 1.5)),
        r"Actuator\(bar, ground\)': Activation.least is 2 and Activation.largest 1",
    ),
    "an activation that begins beyond its limits": (
        lambda: driven(activation=rj.Activation(0.1, 0.5)),
        r"Activation.start is 0, beyond the limits 0.5 and inf; let it begin between",
    ),
    "an activation that is a number": (
        lambda: driven(activation=0.1),
        r"activation is of type float; give one, such as romjax.Activation\(time_constant=0.1\)",
    ),
    "a joint of bodies": (
        lambda: rj.Revolute(bar(), rj.ground.at(), name="pin"),
        r"Revolute 'pin': a is of type RigidBody; give a marker, such as body\.at\(point\)",
    ),
    "a joint to a pose": (
        lambda: rj.Revolute(bar().at(), rj.ground.pose()),
        "Revolute: b is of type Pose; give a marker",
    ),
    "a spring to the ground": (
        lambda: rj.Spring(bar().at(), rj.ground, stiffness=1.0),
        r"Spring: b is of type Ground; give a marker, .*ground\.at\(point\)",
    ),
    "placed on a marker": (
        lambda: bar().placed((0.0, 0.0), rj.ground.at()),
        r"'bar': the pose is of type Marker; give ground\.pose\(point\), or other\.pose",
    ),
    "placed on numbers": (
        lambda: bar().placed((0.0, 0.0), (1.0, 0.0)),
        "'bar': the pose is of type tuple",
    ),
    "an axis by its letter": (
        lambda: rj.ground.at((0.0, 0.0, 0.0), axis="z"),
        r"'ground': the axis is 'z'; give three numbers, such as \(0\.0, 0\.0, 1\.0\)",
    ),
    "an axis for an angle": (
        lambda: rj.ground.at((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        r"'ground': the angle has the shape \(3,\); .*axis=\(0\.0, 0\.0, 1\.0\)",
    ),
    "a point of the plane in space": (
        lambda: rj.Weld(spatial.RigidBody("top", 1.0, (1.0, 1.0, 1.0)).at(), rj.ground.at()),
        r"in 3 and 2 dimensions; give all points of a part x, y, z in space",
    ),
    "gravity of the plane in space": (
        lambda: rj.Scene(
            [spatial.RigidBody("top", 1.0, (1.0, 1.0, 1.0))], [], [rj.Gravity()]
        ).check(),
        r"effect 'Gravity' is in the plane, .*\. Its vector needs 3 numbers",
    ),
    "one body in place of a list": (
        lambda: rj.Scene(bar()),
        r"a list of parts is needed in place of one RigidBody; put it in brackets, as in \[part\]",
    ),
    "a body among the joints": (
        lambda: rj.assemble(rj.Scene([bar()], [bar("other")])),
        r"Scene\.joints holds .*no AbstractJoint",
    ),
    "too many joints": (
        lambda: rj.assemble(
            rj.Scene([bar()], [rj.Revolute(bar().at((x, 0)), rj.ground.at((x, 0))) for x in (0, 1)])
        ),
        "4 constraints on 3 coordinates leave no motion.*Take out",
    ),
}


# What only computing finds.
SLOW = ("too many joints", "body of negative mass matrix")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        pytest.param(*case, id=name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name, case in PARTS.items()
    ],
)
def test_scenes(make, words):
    with pytest.raises(rj.SceneError, match="(?s)" + words):
        make()
