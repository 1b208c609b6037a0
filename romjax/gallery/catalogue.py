"""The ready scenes by name, each with the run that shows it best."""

import dataclasses
import difflib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import diffrax

from ..common.errors import SceneError
from ..scene.scene import Scene
from .ball_chain import ball_chain
from .blade_catapult import blade_catapult
from .bouncing_ball import bouncing_ball
from .bricard import bricard
from .cart_pendulum import cart_pendulum
from .chain import chain
from .connecting_rod import connecting_rod
from .double_pendulum import double_pendulum
from .flexible_link import flexible_link
from .flyball_governor import flyball_governor
from .flywheel import flywheel
from .four_bar import four_bar
from .helicopter_rotor import helicopter_rotor
from .jansen import jansen
from .newtons_cradle import newtons_cradle
from .robot_arm import robot_arm
from .rotating_blade import rotating_blade
from .rotor import rotor
from .satellite import satellite
from .segmented_beam import segmented_beam
from .slider_crank import slider_crank
from .spatial_arm import spatial_arm
from .spatial_slider_crank import spatial_slider_crank
from .spinning_top import spinning_top
from .squeezer import squeezer
from .swinging_cable import swinging_cable
from .trebuchet import trebuchet
from .uncoiling_strip import uncoiling_strip
from .vehicle_axle import vehicle_axle
from .whip import whip
from .wing_nut import wing_nut

# Where the robots' files are, MJCF and URDF.
ROBOTS = Path(__file__).parent / "robots"


@dataclasses.dataclass(frozen=True)
class Example:
    """A scene and how to run it: for `end` [s], sampled at `rate` [Hz].

    `freedoms`: how many its joints leave, of rigid and elastic motion; None where nobody counted.
    `pod_rank`, `sod_rank`: numbers of modes, None for the drop point. What a publication says of
    the scene, if one does: `published_savings`, the share of time that its reduced models save, by
    the name of their decomposition; `published_ranks`, the numerical ranks of its generalised SVD
    at `rate` and at three times that. `rtol`: tolerance; `solver`: None for the default.
    """

    name: str
    title: str
    make: Callable[[], Scene]
    end: float = 1.0
    rate: float = 100.0
    freedoms: int | None = None
    pod_rank: int | None = None
    sod_rank: int | None = None
    published_savings: Mapping[str, float] = dataclasses.field(default_factory=dict)
    published_ranks: tuple[int, ...] = ()
    rtol: float = 1e-8
    solver: diffrax.AbstractSolver[Any] | None = None


EXAMPLES = (
    Example(
        "cart-pendulum",
        "the chapter's cart with a flexible pendulum",
        cart_pendulum,
        freedoms=4,
        pod_rank=6,
        sod_rank=5,
        published_savings={"POD": 0.12, "SOD": 0.30},  # section 39.4.2, by six and by five modes
        published_ranks=(5, 6),
    ),
    Example("chain", "eight hinged bars, falling from the level", chain, freedoms=8),
    Example(
        "double-pendulum", "two bars from high up: chaos", double_pendulum, 10.0, 50.0, freedoms=2
    ),
    Example(
        "four-bar", "driven crank, coupler, rocker with dead points", four_bar, 3.0, freedoms=0
    ),
    Example(
        "slider-crank",
        "Simeon's slider crank with a flexible rod",
        slider_crank,
        0.1,
        2000.0,
        freedoms=4,
    ),
    Example(
        "squeezer", "seven bodies in three loops, driven by a torque", squeezer, 0.5, freedoms=1
    ),
    Example(
        "jansen", "walking linkage of thirteen bodies on one crank", jansen, 4.0, 50.0, freedoms=0
    ),
    Example(
        "vehicle-axle", "axle, springs and tyres on a bumpy road", vehicle_axle, 2.5, freedoms=5
    ),
    Example("trebuchet", "a counterweight and a sling throw a stone", trebuchet, 1.2, freedoms=4),
    Example(
        "newtons-cradle", "five balls pass momentum on by contact", newtons_cradle, 2.0, freedoms=5
    ),
    Example(
        "bouncing-ball",
        "a floor that returns less and brakes",
        bouncing_ball,
        1.5,
        500.0,
        freedoms=3,
    ),
    Example("robot-arm", "three flexible links on drives lift a load", robot_arm, 3.0, freedoms=9),
    Example(
        "flywheel", "a rim on flexible spokes, set in motion", flywheel, 0.4, 500.0, freedoms=12
    ),
    Example("rotating-blade", "a beam that its rotation stiffens", rotating_blade, 2.0, freedoms=3),
    Example(
        "connecting-rod",
        "crank drive with a rod of finite elements",
        connecting_rod,
        0.04,
        3000.0,
        freedoms=5,
    ),
    Example(
        "segmented-beam",
        "32 hinged segments, rolled up to a ring",
        segmented_beam,
        3.0,
        50.0,
        freedoms=31,
    ),
    Example(
        "uncoiling-strip",
        "a ring of spring steel is released, and whips",
        uncoiling_strip,
        freedoms=6,
    ),
    Example(
        "blade-catapult",
        "a bent blade of spring steel throws a stone",
        blade_catapult,
        0.5,
        200.0,
        freedoms=6,
    ),
    Example(
        "swinging-cable",
        "a cable swings down and whips against a wall",
        swinging_cable,
        freedoms=6,
    ),
    Example("whip", "a lash overtakes the hand that stops", whip, 1.5, freedoms=5),
    Example(
        "spinning-top", "a heavy top nods as it precesses", spinning_top, 1.0, 200.0, freedoms=3
    ),
    Example("wing-nut", "a free body flips over and over", wing_nut, 10.0, 20.0, freedoms=6),
    Example(
        "spatial-slider-crank",
        "Haug's slider crank on four kinds of joints",
        spatial_slider_crank,
        freedoms=1,
    ),
    Example("bricard", "six hinges that could not move by count", bricard, 2.0, freedoms=1),
    Example(
        "flyball-governor", "balls on a shaft lift a slider", flyball_governor, 4.0, freedoms=4
    ),
    Example("ball-chain", "eight bars on ball joints spin and fall", ball_chain, freedoms=24),
    Example("rotor", "out of balance in soft bearings, it whirls", rotor, 0.5, 2000.0, freedoms=6),
    Example(
        "spatial-arm",
        "flexible links turn and lift a load",
        spatial_arm,
        3.0,
        freedoms=13,
    ),
    Example(
        "helicopter-rotor", "blades that rotation stiffens flap", helicopter_rotor, 6.0, freedoms=19
    ),
    Example(
        "flexible-link",
        "a link that bends far is swung and falls",
        flexible_link,
        freedoms=5,
    ),
    Example("satellite", "thrusters turn soft panels", satellite, 20.0, 20.0, freedoms=16),
)


def find(name: str) -> Example:
    """The example of that name; raises SceneError with the nearest match."""
    names = [example.name for example in EXAMPLES]
    if name in names:
        return EXAMPLES[names.index(name)]
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f"did you mean '{matches[0]}'? " if matches else ""
    raise SceneError(f"There is no scene '{name}'; {hint}The scenes are: {', '.join(names)}.")
