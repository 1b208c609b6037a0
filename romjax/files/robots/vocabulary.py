"""The treatment of each element and attribute of MJCF and URDF: one table for readers and tests."""

from typing import NamedTuple

ALL = "*"
_PLACE = "pos quat axisangle euler xyaxes zaxis"
_MOTOR = (
    "armature class ctrllimited ctrlrange damping forcelimited forcerange gear joint jointinparent "
    "name tendon"
)
_MOTOR_IGNORED = "group interp lengthrange nsample user"
_MOTOR_REFUSED = "cranklength cranksite delay refsite site slidersite"


class Words(NamedTuple):
    """The attributes of an element by what becomes of them; "*" for all, with what it holds.

    - `taken`: the scene follows them. `ignored`: pictures, and numbers of MuJoCo's own methods,
      which change no motion here. `left_out`: they would change it, and a warning lists them.
    - `refused`: such a file is not read, unless the value says none; `remedy`: what to do then.
    """

    taken: str = ""
    ignored: str = ""
    left_out: str = ""
    refused: str = ""
    remedy: str = ""

    def kind(self, attribute: str) -> str | None:
        """Return the name of the list that has an attribute; None if it is in none."""
        kinds = ("taken", "ignored", "left_out", "refused")
        lists = {kind: getattr(self, kind).split() for kind in kinds}
        exact = next((kind for kind in kinds if attribute in lists[kind]), None)
        return exact or next((kind for kind in kinds if ALL in lists[kind]), None)


_OF_ITS_OWN = Words(
    refused=ALL, remedy="it has a law of its own; use <motor>, <position>, <velocity> or <general>"
)
_IGNORED = Words(ignored=ALL)
_TAKEN = Words(taken=ALL)


def _motor(more: str = "", ignored: str = "", refused: str = "") -> Words:
    return Words(
        f"{_MOTOR} {more}",
        f"{_MOTOR_IGNORED} {ignored}",
        refused=f"{_MOTOR_REFUSED} {refused}",
        remedy="drive a joint, or a tendon between two sites, without delay",
    )


# Words are listed by section and element; what is in bodies stands under "body", wherever they are.
MJCF: dict[str, Words] = {
    "mujoco": Words("model"),
    "compiler": _TAKEN,
    "compiler/lengthrange": _IGNORED,
    "option": Words(
        "gravity o_friction o_margin o_solimp o_solref timestep",
        "actuatorgroupdisable ccd_iterations ccd_tolerance cone impratio integrator iterations "
        "jacobian ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance "
        "sdf_initpoints sdf_iterations sleep_tolerance solver tolerance wind",
        refused="density viscosity",
        remedy="take the fluid out, and add romjax.Drag to the scene",
    ),
    "option/flag": Words(
        "contact filterparent gravity override refsafe",
        "autoreset clampctrl diagexact energy eulerdamp fwdinv invdiscrete ipc island "
        "midphase multiccd nativeccd sensor sleep speculative warmstart",
        refused="actuation constraint damper equality frictionloss limit spring",
        remedy="take out the elements that are switched off",
    ),
    "size": _IGNORED,
    "statistic": _IGNORED,
    "visual": _IGNORED,
    "default": _TAKEN,
    "default/equality": Words("active", "solimp solref"),
    "default/tendon": _TAKEN,
    "extension": Words(refused=ALL, remedy="plugins are of MuJoCo alone; take them out"),
    "asset": _TAKEN,
    "asset/mesh": _TAKEN,
    "mesh/plugin": Words(refused=ALL, remedy="give the mesh as a file"),
    "asset/hfield": _IGNORED,
    "asset/skin": _IGNORED,
    "asset/texture": _IGNORED,
    "asset/material": _IGNORED,
    "asset/model": Words(refused=ALL, remedy="put all of it into one file, or use <include>"),
    "body": Words(
        f"{_PLACE} childclass name",
        "fuse simple sleep user",
        refused="gravcomp mocap",
        remedy="hold the body up by romjax.Force, or move it by a PrescribedAngle",
    ),
    "body/inertial": _TAKEN,
    "body/joint": Words(
        "actuatorfrclimited actuatorfrcrange armature axis class damping frictionloss limited name "
        "pos range ref solimplimit solreflimit springdamper springref stiffness type",
        "group margin solimpfriction solreffriction user",
        refused="actuatorgravcomp springyield",
        remedy="take it out",
    ),
    "body/freejoint": _TAKEN,
    "body/geom": Words(
        f"{_PLACE} class conaffinity condim contype density fitscale friction fromto mass mesh "
        "name priority shellinertia size solimp solmix solref type",
        "adhesion castshadow fluidcoef fluidshape gap group hfield margin material rgba surfacevel "
        "user",
    ),
    "geom/plugin": Words(refused=ALL, remedy="take it out"),
    "body/site": Words(f"{_PLACE} class fromto name", "group material mesh rgba size type user"),
    "body/camera": _IGNORED,
    "body/light": _IGNORED,
    "body/plugin": Words(refused=ALL, remedy="take it out; see scene.flexible for elastic links"),
    "body/attach": Words(refused=ALL, remedy="put all of it into one file, or use <include>"),
    "body/flexcomp": Words(refused=ALL, remedy="see scene.flexible for elastic links"),
    "body/composite": Words(refused=ALL, remedy="write its bodies one by one"),
    "deformable": _TAKEN,
    "deformable/flex": Words(refused=ALL, remedy="see scene.flexible for elastic links"),
    "deformable/skin": _IGNORED,
    "contact": _TAKEN,
    "contact/pair": Words(
        "class condim friction geom1 geom2 name solimp solref", "adhesion gap margin solreffriction"
    ),
    "contact/exclude": _TAKEN,
    "tendon": _TAKEN,
    "tendon/spatial": Words(
        "class damping frictionloss limited name range solimplimit solreflimit springlength "
        "stiffness",
        "group margin material rgba solimpfriction solreffriction user width",
        refused="actuatorfrclimited actuatorfrcrange armature springyield",
        remedy="take it out",
    ),
    "spatial/site": _TAKEN,
    "spatial/geom": Words(refused=ALL, remedy="lead the tendon from site to site"),
    "spatial/pulley": Words(refused=ALL, remedy="lead the tendon from site to site, in one branch"),
    "tendon/fixed": Words(refused=ALL, remedy='couple joints by <equality>, drive them by "joint"'),
    "equality": _TAKEN,
    "equality/connect": Words("active anchor body1 body2 class name site1 site2", "solimp solref"),
    "equality/weld": Words(
        "active anchor body1 body2 class name relpose site1 site2", "solimp solref torquescale"
    ),
    "equality/joint": Words("active class joint1 joint2 name polycoef", "solimp solref"),
    "equality/tendon": Words(refused=ALL, remedy="couple joints instead"),
    "equality/flex": Words(refused=ALL, remedy="take it out"),
    "equality/flexstrain": Words(refused=ALL, remedy="take it out"),
    "actuator": _TAKEN,
    "actuator/general": _motor(
        "actlimited actrange biasprm biastype dynprm dyntype gainprm gaintype inheritrange input",
        "actdim actearly",
        "body ffrange velrange",
    ),
    "actuator/motor": _motor(),
    "actuator/position": _motor("dampratio inheritrange kp kv timeconst"),
    "actuator/velocity": _motor("kv"),
    "actuator/intvelocity": _motor("actlimited actrange dampratio inheritrange kp kv"),
    "actuator/orientation": _OF_ITS_OWN,
    "actuator/pid": _OF_ITS_OWN,
    "actuator/damper": _OF_ITS_OWN,
    "actuator/cylinder": _motor("area bias diameter timeconst"),
    "actuator/muscle": _OF_ITS_OWN,
    "actuator/adhesion": _OF_ITS_OWN,
    "actuator/dcmotor": _OF_ITS_OWN,
    "actuator/plugin": _OF_ITS_OWN,
    "sensor": _IGNORED,
    "custom": _IGNORED,
    "keyframe": _TAKEN,
    "keyframe/key": Words("act ctrl name qpos qvel", "time", refused="mpos mquat plastic"),
    # What MuJoCo resolves before it has a schema.
    "body/frame": _TAKEN,
    "body/replicate": _TAKEN,
}

URDF: dict[str, Words] = {
    "robot": Words("name", "version"),
    "robot/mujoco": _TAKEN,
    "robot/material": _IGNORED,
    "robot/link": Words("name", "type"),
    "link/inertial": _TAKEN,
    "link/visual": _IGNORED,
    "link/collision": _TAKEN,
    "robot/joint": Words("name type"),
    "joint/origin": _TAKEN,
    "joint/parent": _TAKEN,
    "joint/child": _TAKEN,
    "joint/axis": _TAKEN,
    "joint/limit": Words("effort lower upper", left_out="velocity"),
    "joint/dynamics": Words("damping friction"),
    "joint/mimic": Words("joint multiplier offset"),
    "joint/calibration": _IGNORED,
    "joint/safety_controller": Words(left_out=ALL),
    "robot/transmission": Words(left_out=ALL),
    "robot/gazebo": Words(left_out=ALL),
    "robot/sensor": _IGNORED,
}

# Where bodies stand in MJCF besides <body>.
BODIES = ("worldbody", "body", "frame", "replicate")


def key(parents: tuple[str, ...], tag: str) -> str:
    """The key of an element within others, the outermost first."""
    if not parents:
        return tag
    if tag in ("body", "worldbody"):
        return "body"
    within = parents[-1]
    if within == "mujoco":
        return tag
    if within == "default":
        return _of_default(tag)
    return f"{'body' if within in BODIES else within}/{tag}"


def _of_default(tag: str) -> str:
    if tag == "default" or f"default/{tag}" in MJCF:
        return "default" if tag == "default" else f"default/{tag}"
    known = (f"{section}/{tag}" for section in ("body", "actuator", "asset", "contact"))
    return next((name for name in known if name in MJCF), f"default/{tag}")
