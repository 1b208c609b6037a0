"""A hydraulic cylinder behind a valve."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time, concatenate
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists, Wrenches
from ..motion import moved
from ..signal import AbstractSignal, signal_field
from .base import check_markers, displacement
from .state_effect import AbstractStateEffect


class HydraulicCylinder(AbstractStateEffect):
    """A double-acting cylinder between two points, driven by a four-way valve.

    With the distance ℓ of the points and the stroke x = ℓ − retracted, the pressures of both
    chambers follow the oil that flows in and what the piston displaces,

        (V + A x) p' = β (q − A x' − q_L),  (V + B (stroke − x)) p̂' = β (q̂ + B x' + q_L),

    with q_L = leakage (p − p̂), and the cylinder pushes its ends apart by f = p A − p̂ B − d x'
    (Merritt, Hydraulic Control Systems, 1967, chapters 3 and 6, of constant bulk modulus β). The
    valve, open by u in −1 … 1, lets in q = k u g(supply − p) and q̂ = k u g(tank − p̂) as
    q = k u g of what drives the flow: extending (u > 0) joins chamber A to the supply and chamber B
    to the return, retracting the other way. g(Δ) = Δ / (Δ² + δ²)^¼ is the root of a sharp-edged
    orifice, but for pressures Δ below δ, where flow is laminar.

    **Arguments:**

    - `a`, `b`: the eyes of the rod and of the cylinder.
    - `signal`: the opening u of the valve over time.
    - `area`, `rod_area`: A and B [m²], of the piston and of its side with the rod.
    - `retracted`, `stroke`: the distance of the eyes at x = 0, and the largest x [m].
    - `supply`, `tank`: pressures [Pa]. `flow`: k [m³/s/Pa^½].
    - `bulk`: β [Pa]. `dead_volume`: V [m³], of both sides at their shortest.
    - `leakage` [m³/s/Pa]; `damping`: d [N s/m]; `transition`: δ [Pa].
    - `pressure_a`, `pressure_b`: p and p̂ at the start [Pa], the states, `run["name.pressure_a"]`.
    - `name`: of the cylinder.

    Runs that leave 0 ≤ x ≤ stroke are flagged: stops are another part, such as `JointStop`. Raises
    SceneError for sizes that are not positive.
    """

    a: Marker
    b: Marker
    signal: AbstractSignal = signal_field()
    area: Converted[Float[Array, ""]] = number()
    rod_area: Converted[Float[Array, ""]] = number()
    retracted: Converted[Float[Array, ""]] = number()
    stroke: Converted[Float[Array, ""]] = number()
    supply: Converted[Float[Array, ""]] = number()
    flow: Converted[Float[Array, ""]] = number()
    dead_volume: Converted[Float[Array, ""]] = number()
    # The return and both chambers begin at one bar, about the pressure of the air.
    tank: Converted[Float[Array, ""]] = number(default=1e5)
    bulk: Converted[Float[Array, ""]] = number(default=1.6e9)
    leakage: Converted[Float[Array, ""]] = number(default=0.0)
    damping: Converted[Float[Array, ""]] = number(default=0.0)
    transition: Converted[Float[Array, ""]] = number(default=1e4)
    pressure_a: Converted[Float[Array, ""]] = number(default=1e5)
    pressure_b: Converted[Float[Array, ""]] = number(default=1e5)
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    at_points: ClassVar[tuple[int, ...]] = (0, 1)
    states: ClassVar[tuple[str, ...]] = ("pressure_a", "pressure_b")
    units: ClassVar[tuple[str, ...]] = ("Pa", "Pa")
    limited: ClassVar[bool] = True

    def initial(self) -> Float[Array, " k"]:
        return concatenate([self.pressure_a, self.pressure_b])

    def rates(
        self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists
    ) -> Float[Array, " k"]:
        length, rate, _ = displacement(lambda *p: moved("distance", *p), poses, twists)
        out, speed, opening = length - self.retracted, rate(), self.signal(t)
        one, other = states
        # A four-way valve: a positive opening joins the pump with chamber a and chamber b with the
        # tank, a negative one crosses them.
        extending, retracting = jnp.maximum(opening, 0), jnp.minimum(opening, 0)
        into_a = extending * self._root(self.supply - one)
        into_a += retracting * self._root(one - self.tank)
        into_b = extending * self._root(self.tank - other)
        into_b += retracting * self._root(other - self.supply)
        # Laminar, past the piston.
        leak = self.leakage * (one - other)
        # Oil that flows in, less what the moving piston makes room for; by the volume it
        # compresses.
        rate_a = self.flow * into_a - self.area * speed - leak
        rate_b = self.flow * into_b + self.rod_area * speed + leak
        volume_a = self.dead_volume + self.area * out
        volume_b = self.dead_volume + self.rod_area * (self.stroke - out)
        return self.bulk * jnp.stack([rate_a / volume_a, rate_b / volume_b])

    def driven(self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists) -> Wrenches:
        del t
        _, rate, wrenches = displacement(lambda *p: moved("distance", *p), poses, twists)
        pushed = self.area * states[0] - self.rod_area * states[1]
        return wrenches(pushed - self.damping * rate())

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """Return x (stroke − x), as a share: negative beyond the ends."""
        out = moved("distance", *poses) - self.retracted
        return out * (self.stroke - out) / self.stroke**2

    def _root(self, difference: Float[Array, ""]) -> Float[Array, ""]:
        """Return g of a difference of pressures."""
        # The square root of turbulent flow, with a finite slope at zero: Δp / (Δp² + Δp₀²)^¼.
        return difference / (difference**2 + self.transition**2) ** 0.25

    def check(self) -> None:
        owner = check_markers(self)
        self.signal.check(owner)
        sizes = ("area", "rod_area", "stroke", "dead_volume", "bulk", "transition")
        check_numbers(owner, self, *sizes, sign="positive")
        check_numbers(owner, self, "flow", "leakage", "damping", sign="not negative")
        check_numbers(owner, self, "retracted", "supply", "tank", "pressure_a", "pressure_b")
