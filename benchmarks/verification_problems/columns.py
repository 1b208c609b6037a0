"""Columns that give way, and polynomials to hold them to."""

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.special

import romjax as rj

from .far import cantilever
from .problem import Problem, named

COLUMN = 10  # amplitudes


def along(frame: str, size: float):
    """A load along the axis that compresses: dead, or one that follows the tip."""
    return lambda at: rj.Force(at, (-1.0, 0.0), rj.Constant(size), frame=frame)


def squares(load, gravity=0.0) -> np.ndarray:
    """ω² of a loaded cantilever, ascending, of the linear model about the straight rod."""
    model = rj.linearize(rj.assemble(cantilever(COLUMN, load, gravity)), {}, ())
    count = model.shapes.shape[1]
    # Of the inverse, whose largest eigenvalues are the accurate ones.
    return np.sort(1 / np.linalg.eigvals(-np.linalg.inv(model.A[count:, :count])).real)


def critical(flexibility, guess: float) -> float:
    """Where the largest flexibility 1/ω² changes its sign, through infinity."""
    near = guess * (1 - 1e-3), guess * (1 + 1e-3)
    return scipy.optimize.brentq(lambda x: 1 / flexibility(x), *near, xtol=1e-14, rtol=1e-14)


def softest(load, gravity=0.0) -> float:
    try:
        found = 1 / squares(load, gravity)
    except np.linalg.LinAlgError:  # of a load that is critical to the last digit
        return np.inf
    return found[np.argmax(np.abs(found))]


def trial(terms: int = 12):
    """Polynomials over a unit length that are clamped at zero, and the integral of a product."""
    legendre = [np.polynomial.legendre.leg2poly(row) for row in np.eye(terms)]
    square, turned = np.polynomial.Polynomial([0, 0, 1]), np.polynomial.Polynomial([-1, 2])
    functions = [square * np.polynomial.Polynomial(p)(turned) for p in legendre]

    def integral(product):
        whole = product.integ()
        return whole(1) - whole(0)

    def matrix(order, weight=1.0):
        slopes = [f.deriv(order) if order else f for f in functions]
        return np.array([[integral(weight * f * g) for f in slopes] for g in slopes])

    return functions, matrix


def buckling(weight=1.0) -> float:
    """The least P of ∫ w''² = P ∫ weight w'², by polynomials."""
    _, matrix = trial()
    return scipy.linalg.eigh(matrix(2), matrix(1, weight))[0][0]


def greenhill() -> float:
    j = scipy.optimize.brentq(lambda x: scipy.special.jv(-1 / 3, x), 1.0, 2.5, xtol=1e-15)
    return 9 / 4 * j**2


def beck(load: float, near) -> list[float]:
    """2 ω² + P² + 2 ω² cosh a cos b + P ω sinh a sin b = 0 in units of EI, L and m, with a² and
    −b² the roots x of x² + P x − ω².
    """

    def unbalanced(omega: float) -> float:
        root = np.sqrt(load**2 / 4 + omega**2)
        a, b = np.sqrt(root - load / 2), np.sqrt(root + load / 2)
        waves = 2 * omega**2 * np.cosh(a) * np.cos(b) + load * omega * np.sinh(a) * np.sin(b)
        return load**2 + 2 * omega**2 + waves

    within = [(x * (1 - 1e-3), x * (1 + 1e-3)) for x in near]
    return [scipy.optimize.brentq(unbalanced, *pair, xtol=1e-14) for pair in within]


def beck_again(load: float) -> np.ndarray:
    """By polynomials, with the work of the load's share across, −P w'(1), at the tip."""
    functions, matrix = trial(9)
    follows = np.array([[f.deriv()(1) * g(1) for f in functions] for g in functions])
    stiffness = matrix(2) - load * matrix(1) + load * follows
    return np.sqrt(np.sort(scipy.linalg.eigvals(stiffness, matrix(0)).real)[:2])


PROBLEMS = (
    Problem(
        "Euler's column",
        "The dead load under which a clamped column gives way, in EI/L²: π²/4.\n"
        "Found where the least natural frequency about the straight rod is zero.",
        "closed form (Euler)",
        lambda: named("P L²/EI", [np.pi**2 / 4]),
        ("closed form", "Ritz's method with polynomials"),
        lambda: [critical(lambda p: softest(along("world", p)), np.pi**2 / 4)],
        lambda: [buckling()],
        scene=lambda: cantilever(COLUMN, along("world", 1.0)),
    ),
    Problem(
        "Greenhill's column",
        "The weight under which a column gives way by itself, per length, in EI/L³:\n"
        "9/4 j² with the first zero j of the Bessel function of order −1/3.",
        "closed form (Greenhill)",
        lambda: named("m g L²/EI", [greenhill()]),
        ("Bessel's function", "Ritz's method with polynomials"),
        lambda: [critical(lambda g: softest(along("world", 0.0), g), greenhill())],
        lambda: [buckling(np.polynomial.Polynomial([1, -1]))],
        scene=lambda: cantilever(COLUMN, along("world", 0.0), 1.0),
    ),
    Problem(
        "Beck's column",
        "The frequencies of a clamped column under a load of 15 EI/L² that follows its tip,\n"
        "which has no potential; beyond 20.05 EI/L² it flutters.",
        "Beck 1952, doi:10.1007/BF02008828",
        lambda: named("first, second", beck(15.0, beck_again(15.0))),
        ("the published frequency equation", "Galerkin's method with polynomials"),
        lambda: np.sqrt(squares(along("body", 15.0))[:2]),
        lambda: beck_again(15.0),
        scene=lambda: cantilever(COLUMN, along("body", 15.0)),
    ),
)
