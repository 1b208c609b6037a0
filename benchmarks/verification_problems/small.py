"""Small motions about a rest or a steady rotation: natural frequencies, damping, stability."""

import numpy as np
import scipy.linalg
import scipy.optimize

import romjax as rj
from romjax import spatial

from .columns import trial
from .plane import bar, ends
from .problem import G, Problem, integrated, named

POLYNOMIAL, EIGEN = "roots of the characteristic polynomial", "SciPy's eigenvalues of {}"
MASS, INERTIA, ARM = 1.3, 0.11, 0.5
# Of the bar about its hinge.
ABOUT, STIFF = INERTIA + MASS * ARM**2, 2.0 + MASS * G * ARM


def pendulum(stiffness=2.0, damping=0.3, angle=-np.pi / 2) -> rj.Scene:
    """A bar on a hinge, with a torsion spring and a damper."""
    along = np.array([np.cos(angle), np.sin(angle)])
    one = rj.RigidBody("bar", MASS, INERTIA, position=ARM * along, angle=angle)
    hinge = rj.Revolute(one.at((-ARM, 0.0)), rj.ground.at())
    effects = [
        rj.Gravity(),
        rj.TorsionSpring(one.at(), rj.ground.at(), stiffness, angle),
        rj.TorsionDamper(one.at(), rj.ground.at(), damping),
    ]
    return rj.Scene([one], [hinge], effects)


def damped_again() -> list[float]:
    rate = [[0.0, 1.0], [-STIFF / ABOUT, -0.3 / ABOUT]]
    values = scipy.linalg.eigvals(rate)
    return [abs(values[0]), -values[0].real / abs(values[0])]


def upright() -> float:
    return np.sqrt(MASS * G * ARM / ABOUT)


def upright_again() -> np.ndarray:
    rate = MASS * G * ARM / ABOUT
    end = integrated(lambda _, y: [y[1], rate * y[0]], [1.0, 0.0], 0.0, 5.0)[-1, 0]
    return np.array([1, -1]) * np.arccosh(end) / 5.0


def two_bars(masses=(1.3, 0.7)) -> rj.Scene:
    """Two bars that hang from the origin, the first on two equal hinges."""
    places = [(0.0, 0.0), (0.0, -1.0), (0.0, -2.0)]
    links = [bar(f"bar{i}", places[i], places[i + 1], mass) for i, mass in enumerate(masses)]
    joints = [rj.Revolute(ends(links[0])[0], rj.ground.at())] * 2
    joints.append(rj.Revolute(ends(links[1])[0], ends(links[0])[1]))
    return rj.Scene(links, joints, [rj.Gravity()])


def two_bars_right(upper=1.3, lower=0.7) -> np.ndarray:
    """By Lagrange's equations in absolute angles."""
    mass = np.array([[upper / 3 + lower, lower / 2], [lower / 2, lower / 3]])
    stiffness = G * np.diag([upper / 2 + lower, lower / 2])
    # det(K − ω² M) = 0
    a, b = np.linalg.det(mass), np.linalg.det(stiffness)
    middle = stiffness[0, 0] * mass[1, 1] + stiffness[1, 1] * mass[0, 0]
    return np.sqrt(np.sort(np.roots([a, -middle, b])))


def two_bars_again(upper=1.3, lower=0.7) -> np.ndarray:
    mass = np.array([[upper / 3 + lower, lower / 2], [lower / 2, lower / 3]])
    return np.sqrt(scipy.linalg.eigvalsh(G * np.diag([upper / 2 + lower, lower / 2]), mass))


CLAMPED = np.array([1.8751040687119611664, 4.6940911329741745764])


def clamped_beam(modes=3) -> rj.Scene:
    """A beam of 1 m, 1 kg and 1 N m² whose own modes are those of a clamped one."""
    beam = rj.Beam(
        "beam", 1.0, 1.0, EI=1.0, modes=modes, shapes="clamped-free", position=(0.5, 0.0)
    )
    return rj.Scene([beam], [rj.Weld(beam.at("start"), rj.ground.at())])


def ritz(count: int) -> np.ndarray:
    _, matrix = trial(9)
    return np.sqrt(scipy.linalg.eigvalsh(matrix(2), matrix(0))[:count])


FREE = np.array([4.730040744862704026, 7.8532046240958375565, 10.995607838001670907])


def free_beam() -> rj.Scene:
    beam = rj.Beam("beam", 1.0, 1.0, EI=1.0, modes=4, shapes="free-free")
    return rj.Scene([beam])


def free_again() -> np.ndarray:
    """Cos x cosh x = 1, divided by cosh x."""
    return np.array(
        [
            scipy.optimize.brentq(
                lambda x: np.cos(x) - 1 / np.cosh(x), x - 0.5, x + 0.5, xtol=1e-15
            )
            for x in FREE
        ]
    )


PLATFORM, DEEP = 2.0e7, 12.0
TENSOR = np.diag([2.4e10, 2.0e10, 1.5e10])


def platform_stiffness() -> np.ndarray:
    stiffness = np.diag([7.1e4, 7.3e4, 1.5e6, 6.3e9, 6.4e9, 1.2e8])
    stiffness[0, 4] = stiffness[4, 0] = -1.1e6
    stiffness[1, 3] = stiffness[3, 1] = 1.2e6
    return stiffness


def platform() -> rj.Scene:
    """A floating body held by a stiffness below its centre of mass, weight and lift."""
    body = spatial.RigidBody("platform", PLATFORM, TENSOR, position=(0.0, 0.0, DEEP))
    below = body.at((0.0, 0.0, -DEEP))
    effects = [
        spatial.Bushing(below, rj.ground.at((0.0, 0.0, 0.0)), platform_stiffness()),
        rj.Gravity((0.0, 0.0, -G)),
        rj.Force(below, (0.0, 0.0, 1.0), rj.Constant(PLATFORM * G)),
    ]
    return rj.Scene([body], [], effects)


def platform_right() -> np.ndarray:
    """The point below moves by u + θ × r; the couple of weight and lift overturns."""
    r = DEEP * np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 0]])  # x ↦ x × (0, 0, 12), transposed
    to_point = np.block([[np.eye(3), -r], [np.zeros((3, 3)), np.eye(3)]])
    stiffness = to_point.T @ platform_stiffness() @ to_point
    stiffness[3:5, 3:5] -= PLATFORM * G * DEEP * np.eye(2)
    mass = scipy.linalg.block_diag(PLATFORM * np.eye(3), TENSOR)
    return np.sqrt(scipy.linalg.eigvalsh(stiffness, mass))


def platform_again() -> np.ndarray:
    """In two planes, each surge with pitch by a quadratic equation; heave and yaw alone."""
    full = platform_stiffness()
    squares = [full[2, 2] / PLATFORM, full[5, 5] / TENSOR[2, 2]]
    for slide, turn, sign in ((0, 4, 1.0), (1, 3, -1.0)):
        k, c, t = full[slide, slide], full[slide, turn], full[turn, turn]
        # The point moves by x − sign h θ.
        couple = c - sign * DEEP * k
        about = t - 2 * sign * DEEP * c + DEEP**2 * k - PLATFORM * G * DEEP
        inertia = TENSOR[turn - 3, turn - 3]
        squares += list(
            np.roots([PLATFORM * inertia, -(k * inertia + about * PLATFORM), k * about - couple**2])
        )
    return np.sqrt(np.sort(squares))


def axle_again() -> list[float]:
    """Bounce and hop of the vehicle axle: quartic in s."""
    m, a, k, d, t, e = 500.0, 80.0, 2 * 18e3, 2 * 1200.0, 2 * 180e3, 600.0
    body, wheel = np.poly1d([m, d, k]), np.poly1d([a, d + e, k + t])
    roots = (body * wheel - np.poly1d([d, k]) ** 2).r
    return sorted({round(abs(x), 12) for x in roots})


def axle_right() -> np.ndarray:
    m, a, k, d, t, e = 500.0, 80.0, 2 * 18e3, 2 * 1200.0, 2 * 180e3, 600.0
    inverse = np.diag([1 / m, 1 / a])
    stiffness = np.array([[k, -k], [-k, k + t]])
    damping = np.array([[d, -d], [-d, d + e]])
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    return np.sort(np.abs(scipy.linalg.eigvals(matrix)))[::2]


def axle_found() -> np.ndarray:
    found = np.abs(np.asarray(rj.modes(rj.assemble(rj.gallery.vehicle_axle())).values))
    return np.array([found[np.argmin(np.abs(found - x))] for x in axle_right()])


def ziegler(load=1.0, damping=0.0) -> rj.Scene:
    """Two massless links of 1 m on torsion springs of 1 N m, masses of 2 and 1 kg at their ends,
    and a load along the second link that follows it.
    """
    first = rj.RigidBody("first", 2.0, 1e-9, position=(1.0, 0.0))
    second = rj.RigidBody("second", 1.0, 1e-9, position=(2.0, 0.0))
    joints = [
        rj.Revolute(first.at((-1.0, 0.0)), rj.ground.at()),
        rj.Revolute(second.at((-1.0, 0.0)), first.at()),
    ]
    pairs = [(first.at((-1.0, 0.0)), rj.ground.at()), (second.at((-1.0, 0.0)), first.at())]
    springs = [rj.TorsionSpring(*pair, stiffness=1.0) for pair in pairs]
    dampers = [rj.TorsionDamper(*pair, damping=damping) for pair in pairs] if damping else []
    follows = rj.Force(second.at(), (-1.0, 0.0), rj.Constant(load), frame="body")
    return rj.Scene([first, second], joints, [*springs, *dampers, follows])


def ziegler_gap(squares) -> float:
    """Of both ω²: positive while they are apart and real, negative where they are a pair."""
    a, b = squares
    return ((a - b) ** 2).real


def ziegler_found() -> list[float]:
    def gap(load):
        values = np.asarray(rj.modes(rj.assemble(ziegler(load))).values)
        squares = np.sort_complex(values**2)
        return ziegler_gap(squares[[0, -1]])

    return [scipy.optimize.brentq(gap, 2.0, 2.2, xtol=1e-12)]


def ziegler_again() -> list[float]:
    mass, spring = np.array([[3.0, 1.0], [1.0, 1.0]]), np.array([[2.0, -1.0], [-1.0, 1.0]])

    def gap(load):
        stiffness = spring - load * np.array([[1.0, -1.0], [0.0, 0.0]])
        return ziegler_gap(scipy.linalg.eigvals(stiffness, mass))

    return [scipy.optimize.brentq(gap, 2.0, 2.2, xtol=1e-14)]


PROBLEMS = (
    Problem(
        "damped pendulum",
        "A bar on a hinge with a torsion spring and a damper: J φ'' + d φ' + (k + m g l) φ = 0.\n"
        "Its frequency and damping ratio.",
        "closed form",
        lambda: named(
            "frequency [rad/s], damping ratio",
            [np.sqrt(STIFF / ABOUT), 0.3 / (2 * np.sqrt(STIFF * ABOUT))],
        ),
        ("closed form", EIGEN.format("the first-order equations")),
        lambda: (lambda m: [m.frequencies[0], m.damping[0]])(rj.modes(rj.assemble(pendulum()))),
        damped_again,
        scene=pendulum,
    ),
    Problem(
        "upright pendulum",
        "The same bar upright without spring and damper: both eigenvalues, ±√(m g l / J).",
        "closed form",
        lambda: named("grows [1/s], decays [1/s]", np.array([1, -1]) * upright()),
        ("closed form", "from φ'' = m g l / J φ in ten seconds by SciPy's DOP853"),
        lambda: np.asarray(rj.modes(rj.assemble(pendulum(0.0, 0.0, np.pi / 2))).values).real,
        upright_again,
        scene=lambda: pendulum(0.0, 0.0, np.pi / 2),
    ),
    Problem(
        "hanging bars",
        "Two uniform bars of 1 m, 1.3 and 0.7 kg, hang end to end; the upper hinge is made\n"
        "twice. Both natural frequencies.",
        "closed form (Lagrange, absolute angles)",
        lambda: named("first [rad/s], second [rad/s]", two_bars_right()),
        (POLYNOMIAL, EIGEN.format("both angles")),
        lambda: rj.modes(rj.assemble(two_bars())).frequencies,
        two_bars_again,
        scene=two_bars,
    ),
    Problem(
        "clamped beam",
        "The first two frequencies of a cantilever of 1 m, 1 kg and 1 N m², (βL)² with\n"
        "cos βL cosh βL = −1.",
        "closed form (Euler and Bernoulli)",
        lambda: named("first [rad/s], second [rad/s]", CLAMPED**2),
        ("roots in multiple precision", "Ritz's method with polynomials"),
        lambda: rj.modes(rj.assemble(clamped_beam())).frequencies[:2],
        lambda: ritz(2),
        scene=clamped_beam,
    ),
    Problem(
        "free beam",
        "The first three bending modes of a free beam: roots of cos βL cosh βL = 1.",
        "closed form (Euler and Bernoulli)",
        lambda: named("first, second, third", FREE),
        ("roots in multiple precision", "roots by Brent's method"),
        lambda: np.sqrt(np.asarray(rj.modes(rj.assemble(free_beam())).frequencies)[-4:-1]),
        free_again,
        scene=free_beam,
    ),
    Problem(
        "floating platform",
        "A body of 20 000 t in space on a full stiffness about a point 12 m below, with weight\n"
        "and lift, whose couple overturns. All six frequencies.",
        "closed form",
        lambda: named(
            "first [rad/s], second [rad/s], third [rad/s], "
            "fourth [rad/s], fifth [rad/s], sixth [rad/s]",
            platform_right(),
        ),
        (EIGEN.format("6 × 6 matrices"), "quadratic equations of each plane"),
        lambda: rj.modes(rj.assemble(platform())).frequencies,
        platform_again,
        scene=platform,
    ),
    Problem(
        "vehicle axle",
        "A quarter of a vehicle on spring, damper and tyre: the moduli of bounce and hop.",
        "closed form",
        lambda: named("bounce [rad/s], hop [rad/s]", axle_right()),
        (EIGEN.format("the first-order equations"), POLYNOMIAL),
        axle_found,
        axle_again,
        scene=rj.gallery.vehicle_axle,
    ),
    Problem(
        "Ziegler's links",
        "Two links on torsion springs with 2 kg and 1 kg under a load that follows the second:\n"
        "they flutter from P l / k = 7/2 − √2 on.",
        "closed form (Ziegler)",
        lambda: named("P l / k", [3.5 - np.sqrt(2.0)]),
        ("closed form", EIGEN.format("both angles, by Brent's method over the load")),
        ziegler_found,
        ziegler_again,
        scene=ziegler,
    ),
)
