"""A user's lines, one for each part: type checkers accept them, and they run (test_types.py)."""

from typing import ClassVar, assert_type

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

import romjax as rj

BAR = {"density": 7850.0, "modulus": 2.1e11}


class Slot(rj.AbstractJoint):
    """A joint of one's own: a point that stays at a height [m] above a marker's x axis."""

    a: rj.Marker
    b: rj.Marker
    height: Float[Array, ""]
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    def residual(self, t: ArrayLike, a: rj.Pose, b: rj.Pose) -> Float[Array, "1"]:
        del t
        return (b.across(a.position) - self.height)[None]


# Numbers, tuples, lists and arrays of either library, by place and by keyword.
cart = rj.RigidBody("cart", 1, 0.01, (0.0, 0.0), 0.1, extent=[0.2, 0.1])
wheel = rj.RigidBody("wheel", mass=jnp.ones(()), inertia=np.float64(0.5), position=np.zeros(2))
bar = rj.Beam("bar", 1.0, 2.0, frequencies=[16.0, 44.0], damping=0.01, position=(0.0, -0.4))
flat = rj.Beam.of_section("flat", 1.0, rj.sections.Rectangle(0.01, 0.02), modes=2, **BAR)
inertia = rj.Inertia(2.0, 1.0, first_moment=(0.0, 0.0), shift=[[0.0], [0.1]])
plate = rj.ModalBody("plate", inertia, [4.0], [(0.0, 0.0)], np.zeros((1, 3, 1)), ports=["rim"])
slow = rj.CappedBody(bar, 40)
cable = rj.Rod("cable", 0.1, 2, 1e-3, 4, shapes="pinned-free", curvature=0.1, damping=[0.1] * 4)
blade = rj.Rod.of_section("blade", 1.0, rj.sections.Rectangle(0.01, 0.002), modes=3, **BAR)
whip = rj.spatial.Rod("whip", 0.1, 2, (1e-3, 2e-3), 1e-3, [1e-6] * 3, 4, EA=1e3, GA=[1e3, 1e3])
stiff = rj.ReducedBody(bar, jnp.eye(2)[:, :1])
profiles = (
    rj.sections.Rod(0.1),
    rj.sections.Tube(0.1, wall=0.01),
    rj.sections.Box(0.1, 0.1, 0.01),
    rj.sections.IProfile(width=0.1, height=0.2, flange=0.01, web=0.01),
    rj.sections.Section(0.01, I_y=1e-6, I_z=2e-6, J=3e-6),
)

frame = rj.Ground({"pivot": (0.0, 1.0)})
here, there = cart.at((0.1, 0.0), angle=np.pi / 4), rj.ground.at([0, 1])
signals = [
    rj.Constant(1.0),
    rj.Sine(10.0, 2.0, phase=np.pi),
    rj.Ramp(1.0),
    rj.Table([0.0, 1.0], values=(0.0, 2.0)),
    rj.Chirp(1.0, 2.0, 3.0),
    rj.Step(1.0, start=0.0, duration=1),
]
joints = [
    rj.Revolute(cart.at(), bar.at((0.0, 0.4)), name="hinge"),
    rj.Prismatic(wheel.at(), there, 0.1),
    rj.Weld(flat.at(), there, value=0.1),
    rj.FixedAngle(here, there),
    rj.KnifeEdge(here, there),
    rj.PointOnLine(here, there),
    rj.RollingWheel(here, there, rj.Line(), 0.1),
    rj.PointOnCurve(here, there, rj.Circle(2, hollow=True)),
    rj.Distance(here, there, 1.0, "link"),
    rj.Gear(here, there, -2, offset=jnp.array(0.1)),
    rj.Coupling(here, bar.at(), there, there, (0.0, 2.0)),
    rj.PrescribedAngle(here, there, rj.Sum((rj.Sine(1.0, 2.0), rj.Constant(1.0)))),
    rj.PrescribedTravel(here, there, signal=rj.Ramp(1.0)),
    rj.PrescribedDistance(here, there, rj.Constant(1.0), "stroke"),
    Slot(here, there, jnp.array(0.1), name="slot"),
]
spring = rj.Spring(here, there, stiffness=100.0)
effects = (
    rj.Gravity(),
    rj.Gravity([0.0, -1.62]),
    spring,
    rj.Spring(here, there, 100.0, rest_length=0.3, cubic=None),
    rj.Damper(here, there, damping=0.1, along_line=True),
    rj.TorsionSpring(here, there, 1.0, rest_angle=0.1),
    rj.TorsionDamper(here, there, 0.1),
    rj.Drag(here, coefficient=0.5, area=0.1),
    rj.Bushing(here, there, (1.0, 1.0, 0.1), damping=[0.1, 0.1, 0.0]),
    rj.Force(here, (1.0, 1.0), rj.Sine(10.0, frequency=2.0), frame="body"),
    rj.Torque(here, signal=rj.Constant(2.0)),
    rj.Actuator(here, there, rj.Ramp(1.0), gear=10, largest=3.0, name="elbow"),
    rj.Actuator(here, there, rj.Ramp(1.0), activation=rj.Activation(0.1, largest=2)),
    rj.JointDamper(here, there, 0.1, rj.Friction(0.2), "travel"),
    rj.JointSpring(here, there, stiffness=10.0, rest=1),
    rj.JointStop(here, there, upper=2.0, stiffness=1e3),
    rj.Rope(here, there, 2.0, 1e4, via=[bar.at(), there], dissipation=0.1, name="hoist"),
    rj.PID(here, there, rj.Ramp(1.0), 10.0, integral=2, largest=3.0, name="elbow control"),
    rj.LowPass(here, there, rj.Constant(1.0), time_constant=0.1, motion="travel"),
    rj.HydraulicCylinder(
        here,
        there,
        rj.Step(1.0, 0.1, 0.2),
        area=2e-3,
        rod_area=1e-3,
        retracted=0.5,
        stroke=0.4,
        supply=2e7,
        flow=1e-7,
        dead_volume=1e-5,
    ),
    rj.Sampled(0.01, lambda t, state, measured: (measured, state), ["cart.x"], ["push"], [0.0]),
    rj.Torque(here, rj.Held("push")),
    rj.Motor(here, there, rj.Ramp(1.0), proportional=10.0, derivative=1),
    rj.Contact(here, there, rj.Line(), 1e5, friction=rj.Friction(0.3, static=0.4, stribeck=0.1)),
    rj.Contact(here, there, rj.Polynomial([0.0, 1.0]), stiffness=1e5, dissipation=0.1),
)
outline = rj.Outline(jnp.zeros((2, 2)), "link", endless=True)
scene = rj.Scene(bodies=[cart, wheel, bar], joints=joints[:1], effects=effects[:3])

# Stabilisations, decompositions and reduced systems.
stabilizations = (
    rj.Baumgarte(alpha=10.0, beta=25.0),
    rj.Baumgarte([1.0, 2.0], np.ones(2)),
    rj.Baumgarte.critical(5.0),
)
decompositions = (rj.POD(tol=1e-4), rj.POD(3, method="gram"), rj.SOD("drop", offset=[0.0, 1.0]))
system = rj.assemble(rj.Scene(bodies=[cart, bar], joints=joints[:1]))
basis = rj.Basis.from_modes(np.eye(system.n), system.q0, np.eye(system.n))
rom = rj.reduce(system, basis, rj.Galerkin())
rj.reduce(system, basis).with_full(system)
rj.reduce(system, basis, "minimal").restrict(system.q0, system.v0)

# What a field holds is an array, whatever it was given as.
assert_type(spring.stiffness, jax.Array)
assert_type(spring.rest_length, jax.Array | None)
assert_type(rom, rj.ReducedSystem)
assert_type(stabilizations[0].alpha, jax.Array)
assert_type(decompositions[0].tol, jax.Array | None)
assert_type(cart.position, jax.Array)
assert_type(inertia.shift, jax.Array | None)
assert_type(scene.bodies, tuple[rj.AbstractBody, ...])
assert_type(scene.joints, tuple[rj.AbstractJoint, ...])
