"""What the ready scenes of the plane show, each a function of the system and its run."""

import math

import numpy as np
from comparison import assert_close
from zoo import GRAVITY

import romjax as rj
from romjax.gallery import find

# What each scene shows is right to a part in a thousand at the default tolerance: to that of the
# run, of crossings between outputs, and of small masses and amplitudes that a closed form leaves
# out.
SHOWN = 1e-3


def outputs(example, end=None):
    end = end or example.end
    return np.linspace(0.0, end, round(end * example.rate) + 1)


def crossings(t, x):
    """When x rises through zero, between outputs on straight lines."""
    (i,) = np.nonzero((x[:-1] < 0) & (x[1:] >= 0))
    return t[i] - x[i] * (t[i + 1] - t[i]) / (x[i + 1] - x[i])


def cart_pendulum(system, run):
    """The cart stays on the diagonal, upright."""
    assert_close(run["cart.x"], run["cart.y"], SHOWN * 1e-3)
    assert_close(run["cart.phi"], np.zeros_like(run.t), SHOWN * 1e-3)


def chain(system, run):
    """What falls is what moves, T = −Σ m g y, from no height and at rest."""
    q, v = (
        np.asarray(run.q).reshape(len(run.t), -1, 3),
        np.asarray(run.v).reshape(len(run.t), -1, 3),
    )
    kinetic = 0.5 * np.sum(v**2 * np.array([1, 1, 1 / 12]), axis=(1, 2))
    assert_close(kinetic, -GRAVITY * np.sum(q[:, :, 1], axis=1), SHOWN, scale=kinetic[-1])


def double_pendulum(system, run):
    """A start that differs by 1e-8 rad ends somewhere else."""
    scene = rj.gallery.double_pendulum(angle=2.2 + 1e-8)
    other = rj.simulate(rj.assemble(scene), run.t)
    apart = np.max(np.abs(np.asarray(run.q) - np.asarray(other.q)), axis=1)
    assert apart[0] < 1e-7
    assert np.max(apart) > 1e-2


def four_bar(system, run):
    """The rocker swings between its dead points, those of the crank in line with the coupler."""
    limits = [
        math.acos((0.45**2 + 0.4**2 - side**2) / (2 * 0.45 * 0.4))
        for side in (0.5 - 0.2, 0.5 + 0.2)
    ]
    swing = math.pi - np.asarray(run["rocker.phi"])
    assert_close(np.array([swing.min(), swing.max()]), np.array(limits), SHOWN)


def slider_crank(system, run):
    """The published digits: angles, slider, both sines, and the end of the rod."""
    wanted = [-0.33117349883, 0.16973733284, 1.893192900e-4, 2.37575125e-5, -8.36331328e-6]
    labels = ("rod.phi", "slider.x", "rod.q1", "rod.q2", "rod.q4")
    found = np.array([np.asarray(run[label])[-1] for label in labels])
    assert_close(found, np.array(wanted), SHOWN, scale=np.abs(wanted))


def bodies_of(name):
    return {body.name: body for body in find(name).make().bodies}


def squeezer(system, run):
    """The kite stays one, and all work of the torque is in the motion and in the spring."""
    bodies, bearing = bodies_of("squeezer"), rj.ground.at((-0.13, 0.02))
    left, right, head = (
        np.asarray(rj.measure(system, run, bodies[name].at("end"), bearing).position)
        for name in ("inner left", "inner right", "rod")
    )
    across = [x[:, 0] * head[:, 1] - x[:, 1] * head[:, 0] for x in (left, right)]
    assert_close(across[0], -across[1], SHOWN, scale=np.abs(across[0]))
    energy = np.asarray(rj.energy(system, run).total)
    turned = np.asarray(run["crank.phi"]) - run["crank.phi"][0]
    assert turned[-1] > 2 * math.pi
    assert_close(energy - energy[0], 0.06 * turned, SHOWN, scale=0.06 * turned[-1])


def jansen(system, run):
    """Half a turn of the crank the foot is within 3 % of its stride from the lowest level."""
    foot = bodies_of("jansen")["left shank"].at("foot")
    x, y = np.asarray(rj.measure(system, run, foot).position).T
    crank = np.asarray(run["crank.phi"])
    low = np.interp(np.linspace(0.0, 4 * math.pi, 720), crank, y) < y.min() + 0.03 * np.ptp(x)
    assert 0.5 < np.mean(low) < 0.55
    assert 0.6 < np.ptp(x) < 0.75


def vehicle_axle(system, run):
    """Bounce and hop have the roots of the closed form; the bumps leave nothing."""
    body, axle, spring, damper, tyre, of_tyre = 500.0, 80.0, 2 * 18e3, 2 * 1200.0, 2 * 180e3, 600.0
    mass, stiffness = np.diag([body, axle]), np.array([[spring, -spring], [-spring, spring + tyre]])
    damping = np.array([[damper, -damper], [-damper, damper + of_tyre]])
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    found = np.asarray(rj.modes(system).values)
    for root in np.linalg.eigvals(matrix):
        assert np.min(np.abs(found - root)) < SHOWN * abs(root)
    assert_close(np.asarray(run["body.y"])[[0, -1]], 0.9, 1e-2)


def trebuchet(system, run):
    """The stone leaves at 45° with most of what the counterweight has lost."""
    vx, vy = np.asarray(run["stone.x'"]), np.asarray(run["stone.y'"])
    (i,) = np.nonzero((vx > 0) & (vy > 0) & (vy <= vx))
    speed = np.hypot(vx, vy)[i[0]]
    height = np.asarray(run["counterweight.y"])
    fall = height[0] - np.min(height)
    assert 0.5 < speed**2 / GRAVITY / (2 * 100 * fall) < 1.0


def newtons_cradle(system, run):
    """The last ball leaves with the speed of the first, and comes as high; the others stay."""
    angles = np.stack([run[f"ball{i + 1}.phi"] for i in range(5)], axis=1)
    assert_close(np.max(angles[:, -1]), 0.5, 10 * SHOWN)
    away = np.argmax(angles[:, -1])
    assert np.max(np.abs(angles[away, :-1])) < 0.05


def bouncing_ball(system, run):
    """Each bounce costs μ times the change of the speed of falling, and no less comes than goes."""
    y, u, w = (np.asarray(run[label]) for label in ("ball.y", "ball.x'", "ball.y'"))
    flight = y > 0.03
    landing = np.sqrt(w**2 + 2 * GRAVITY * np.maximum(y - 0.03, 0.0))
    bounces = 0
    for before, after in _flights(flight):
        fell, rose = landing[before], landing[after]
        assert 0.7 < rose / fell < 1.0
        if u[after] > 0.05:
            assert_close(u[before] - u[after], 0.1 * (fell + rose), 2e-2, scale=fell + rose)
            bounces += 1
    assert bounces >= 2


def _flights(flight):
    """Outputs before and after each time on the floor, well in flight."""
    (lands,) = np.nonzero(flight[:-1] & ~flight[1:])
    (rises,) = np.nonzero(~flight[:-1] & flight[1:])
    return [(land, rise + 1) for land, rise in zip(lands, rises, strict=False)]


def robot_arm(system, run):
    """At the end each drive carries the weight of all that is beyond it."""
    bodies = bodies_of("robot-arm")
    forces = rj.effect_forces(system, run)
    drives = [key for key in forces if key.startswith("Motor")]
    x = np.array(
        [np.asarray(rj.measure(system, run, b.at()).position)[-1, 0] for b in bodies.values()]
    )
    weight = GRAVITY * np.array([2.0, 1.5, 1.0, 0.5])
    for i, key in enumerate(drives):
        hinge = rj.measure(system, run, bodies[f"link{i + 1}"].at("start")).position
        wanted = np.sum((weight * (x - np.asarray(hinge)[-1, 0]))[i:])
        assert_close(np.asarray(forces[key].torque)[-1], wanted, 2e-2, scale=abs(wanted))
    assert len(drives) == 3


def flywheel(system, run):
    """Torque times time is angular momentum; afterwards the rim swings as the spokes let it."""
    hub, rim, length = 15.0 * 0.1**2 / 2, 10.0 * 0.3**2, 0.2
    spokes = 4 * 0.01 * (length**2 / 12 + 0.2**2)
    free = np.asarray(run.t) > 0.22
    t = np.asarray(run.t)[free]
    hub_speed, rim_speed = (np.asarray(run[f"{x}.phi'"])[free] for x in ("hub", "rim"))
    momentum = hub * hub_speed + rim * rim_speed + spokes * rim_speed
    assert_close(momentum, 40.0 * 0.2, 5 * SHOWN, scale=8.0)
    stiffness = 4 * 3 * 5.0 * 0.3**2 / length**3
    times = crossings(t, hub_speed - rim_speed)
    wanted = 2 * math.pi / math.sqrt(stiffness * (1 / hub + 1 / rim))
    assert_close(np.mean(np.diff(times)), wanted, 10 * SHOWN, scale=wanted)


def rotating_blade(system, run):
    """The tabulated frequency at a speed of 5, in the plane of rotation."""
    times = crossings(np.asarray(run.t), np.asarray(run["blade.q1"]))
    wanted = math.sqrt(6.4495**2 - 5.0**2) * math.sqrt(2.048e4 / (10.0 * 8.0**3))
    assert_close(2 * math.pi / np.mean(np.diff(times)), wanted, 5 * SHOWN, scale=wanted)


def connecting_rod(system, run):
    """At the outer dead point, after one turn, the piston has the acceleration of a rigid rod."""
    t, v = np.asarray(run.t), np.asarray(run["piston.x'"])
    turn = 2 * math.pi / 200.0
    slope = np.polyfit(t[abs(t - turn) < 0.002] - turn, v[abs(t - turn) < 0.002], 3)[2]
    wanted = -0.045 * 200.0**2 * (1 + 0.045 / 0.15)
    assert_close(slope, wanted, 10 * SHOWN, scale=abs(wanted))


def segmented_beam(system, run):
    """The moment turns every hinge by the same angle, and the tip once."""
    angles = np.asarray(run.q)[-1, 2::3]
    assert_close(np.diff(angles), 2 * math.pi / (len(angles) - 1), 1e-2)
    assert_close(angles[-1], 2 * math.pi, 1e-2)


def uncoiling_strip(system, run):
    """The energy is that of bending a strip to a circle, 2 π² EI / L; and the end, which was turned
    by 2 π, is turned the other way when the strip has whipped through the straight.
    """
    (strip,) = rj.gallery.uncoiling_strip().bodies
    circle = 2 * math.pi**2 * float(strip.EI / strip.length)
    total = np.asarray(rj.energy(system, run).total)
    assert_close(total, np.full(len(total), circle), SHOWN * circle)
    end = np.asarray(rj.measure(system, run, strip.at("end")).angle)
    assert_close(end[0], 2 * math.pi, SHOWN)
    assert np.min(end) < -math.pi / 2


def blade_catapult(system, run):
    """What the blade holds is ½ EI θ² / L; the stone flies off with most of it."""
    blade, stone = rj.gallery.blade_catapult().bodies
    held = 0.5 * float(blade.EI) * (math.pi / 2) ** 2 / float(blade.length)
    strains = np.asarray(blade.elastic_energy(run.q[0, :6]))
    assert_close(strains, held, SHOWN, scale=held)
    t, height = np.asarray(run.t), np.asarray(run["stone.y"])
    speeds = np.stack([run["stone.x'"], run["stone.y'"]], axis=1)
    gained = 0.5 * np.sum(speeds**2, axis=1) + GRAVITY * (height - height[0])
    flies = t > 0.35
    assert_close(gained[flies], gained[-1], SHOWN, scale=gained[-1])
    assert 0.5 < float(stone.mass) * gained[-1] / held < 1.0


def swinging_cable(system, run):
    """All of the cable's fall is motion until it touches the wall, where it loses energy, and which
    none of it passes.
    """
    (cable,) = rj.gallery.swinging_cable().bodies
    places = [rj.measure(system, run, cable.at(f"p{i + 1}")).position[:, 0] for i in range(3)]
    before, beyond = np.cumsum(np.min(places, axis=0) < -0.1) == 0, -0.1 - np.min(places)
    assert 0.2 < np.mean(before) < 0.8
    total = np.asarray(rj.energy(system, run).total)
    fall = GRAVITY * float(cable.mass * cable.length)
    assert_close(total[before], np.zeros(np.sum(before)), SHOWN, scale=fall)
    assert np.max(np.diff(total)) < SHOWN * fall
    assert total[-1] < -0.1 * fall
    assert 0.0 < beyond < 0.025


def whip(system, run):
    """The end lags behind the hand by more than a right angle, overtakes it by as much, and is
    twice as fast as that of a rigid bar, 15/8 of the mean.
    """
    (lash,) = rj.gallery.whip().bodies
    end = rj.measure(system, run, lash.at("end"))
    ahead = np.asarray(end.angle) - np.asarray(run["lash.phi"])
    assert np.min(ahead) < -math.pi / 2
    assert np.max(ahead) > math.pi / 2
    hand = 15 / 8 * 3.0 / 0.6
    assert_close(np.max(np.asarray(run["lash.phi'"])), hand, 1e-2, scale=hand)
    speed = np.linalg.norm(np.asarray(end.velocity), axis=1)
    assert np.max(speed) > 2 * hand * float(lash.length)


IN_THE_PLANE = (
    cart_pendulum,
    chain,
    double_pendulum,
    four_bar,
    slider_crank,
    squeezer,
    jansen,
    vehicle_axle,
    trebuchet,
    newtons_cradle,
    bouncing_ball,
    robot_arm,
    flywheel,
    rotating_blade,
    connecting_rod,
    segmented_beam,
    uncoiling_strip,
    blade_catapult,
    swinging_cable,
    whip,
)
