"""A squeezing mechanism of seven bodies."""

from ..common.arrays import Number
from ..scene.effect.spring import Spring
from ..scene.effect.torque import Torque
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Constant
from .linkage import Point, bar, meeting

SIDES = ("left", "right")


def squeezer(
    *,
    crank: float = 0.02,  # lengths [m]
    rod: float = 0.07,
    rocker: float = 0.05,
    inner: float = 0.05,  # arms of the jaws, from the head
    outer: float = 0.06,  # and from their bearing
    torque: Number = 0.06,  # on the crank [N m]
    stiffness: Number = 50.0,  # of the spring on the rocker [N/m]
    density: Number = 1.0,  # mass per length of all bars [kg/m]
) -> Scene:
    """A crank moves a head by a rod; two pairs of arms squeeze what is between them.

    Seven bodies in three loops and one freedom: a crank at the origin, a rod to the head E, which a
    rocker guides about B, and the arms E–G–A and E–H–A about a common bearing A. Topology of
    Andrews' squeezer (Schiehlen, "Multibody Systems Handbook", Springer 1990), dimensions of our
    own. Equal arms make the kite A, G, E, H: G and H stay mirror images about the line from A to E.
    A constant torque M does the work M θ on the crank, which is kinetic energy or in the spring.
    """
    pivot, bearing, anchor = (-0.04, 0.05), (-0.13, 0.02), (-0.02, -0.06)
    pin = (crank, 0.0)
    head = meeting(pin, pivot, rod, rocker)
    left, right = meeting(bearing, head, outer, inner), meeting(head, bearing, inner, outer)
    links: dict[str, tuple[Point, Point]] = {
        "crank": ((0.0, 0.0), pin),
        "rod": (pin, head),
        "rocker": (pivot, head),
        "inner left": (head, left),
        "outer left": (bearing, left),
        "inner right": (head, right),
        "outer right": (bearing, right),
    }
    bars = {name: bar(name, *points, density) for name, points in links.items()}
    head_ = bars["rod"].at("end")
    return Scene(
        bodies=list(bars.values()),
        joints=[
            Revolute(bars["crank"].at("start"), ground.at(), name="crank bearing"),
            Revolute(bars["rod"].at("start"), bars["crank"].at("end"), name="pin"),
            Revolute(bars["rocker"].at("start"), ground.at(pivot), name="rocker bearing"),
            Revolute(bars["rocker"].at("end"), head_, name="head"),
            *(Revolute(bars[f"inner {side}"].at("start"), head_) for side in SIDES),
            *(
                Revolute(bars[f"outer {side}"].at("end"), bars[f"inner {side}"].at("end"))
                for side in SIDES
            ),
            *(Revolute(bars[f"outer {side}"].at("start"), ground.at(bearing)) for side in SIDES),
        ],
        effects=[
            Torque(bars["crank"].at("start"), Constant(torque)),
            Spring(head_, ground.at(anchor), stiffness=stiffness, rest_length=0.05),
        ],
    )
