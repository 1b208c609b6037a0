"""The Princeton beam (Dowell and Traybar 1975): aluminium, on edge, with a load at its tip."""

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
from comparison import assert_close
from spatial_beams import marker

import romjax as rj
from romjax import spatial

# The Princeton beam (Dowell and Traybar 1975): aluminium, on edge, with a load at its tip.
PRINCETON = {"modulus": 71.7e9, "shear_modulus": 71.7e9 / 2.62, "density": 2700.0}


SPAN, EDGE = 0.508, rj.sections.Rectangle(3.175e-3, 12.7e-3)


def geometrically_exact(force):
    """Displacement of the tip and rotation about the axis of a clamped Kirchhoff rod, by shooting
    for its root moment: r' = d, R' = R κ̃, m' = −d × F, R diag(GJ, EI_y, EI_z) κ = m.
    """
    shear, modulus = PRINCETON["shear_modulus"], PRINCETON["modulus"]
    stiffness = np.array(
        [
            shear * EDGE.torsion_constant,
            modulus * EDGE.second_moment_y,
            modulus * EDGE.second_moment,
        ]
    )

    def slope(_, y):
        turn, moment = y[3:12].reshape(3, 3), y[12:]
        x, y, z = (turn.T @ moment) / stiffness
        curved = turn @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.concatenate([turn[:, 0], curved.ravel(), -np.cross(turn[:, 0], force)])

    def tip(root):
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), root])
        run = scipy.integrate.solve_ivp(slope, (0, SPAN), start, "DOP853", rtol=1e-11, atol=1e-13)
        return run.y[:, -1]

    lever = np.array([0.0, -force[2], force[1]]) * SPAN
    end = tip(scipy.optimize.fsolve(lambda root: tip(root)[12:], 0.97 * lever, xtol=1e-11))
    turn = end[3:12].reshape(3, 3)
    about = 2 * np.arctan2(turn[2, 1] - turn[1, 2], 1 + np.trace(turn))
    return np.array([end[0] - SPAN, end[1], end[2], about])


def princeton(count, force):
    """The same by so many beams that are welded end to end, in equilibrium."""
    size = SPAN / count
    bodies = [
        spatial.Beam.of_section(
            f"beam {k}",
            size,
            EDGE,
            **PRINCETON,
            bending=2,
            torsion=1,
            stiffening=True,
            position=((k + 0.5) * size, 0.0, 0.0),
        )
        for k in range(count)
    ]
    ends = [rj.ground.at((0.0, 0.0, 0.0)), *(body.at("end") for body in bodies)]
    joints = [spatial.Weld(b.at("start"), end) for b, end in zip(bodies, ends[:-1], strict=True)]
    load = rj.Force(bodies[-1].at("end"), force, rj.Constant(np.linalg.norm(force)))
    q = rj.equilibrium(rj.assemble(rj.Scene(bodies, joints, [load])))
    place, turn = marker(bodies[-1], q[-bodies[0].size :], (size / 2, 0.0, 0.0))
    return np.array([*(place - np.array([SPAN, 0, 0])), 2 * np.arctan2(turn[1], turn[0])])


POUND, ANGLES = 4.448222, np.arange(0, 91, 15)


@pytest.mark.slow
@pytest.mark.parametrize("pounds", [1, 2, 3])
def test_all_loads_and_angles(pounds):
    """Of the experiment, each in one call from the straight beam: 4 beams are within half a percent
    of the way of the tip.
    """
    for angle in np.radians(ANGLES):
        force = pounds * POUND * np.array([0.0, np.sin(angle), np.cos(angle)])
        exact = geometrically_exact(force)
        found = princeton(4, force)
        assert_close(found[:3], exact[:3], 0.005, np.max(np.abs(exact[:3])))
        assert_close(found[3], exact[3], 0.005, np.max(np.abs(exact)))


@pytest.mark.slow
def test_princeton_beam():
    """Two pounds at 45°: 4 and 8 beams converge to the geometrically exact rod at order 2, and 8
    are within a share of it that no measurement saw.
    """
    force = 2 * POUND * np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    exact = geometrically_exact(force)
    errors = [np.abs(princeton(count, force) - exact) for count in (4, 8)]
    orders = np.log2(errors[0] / errors[1])
    assert_close(orders, np.full(4, 2.0), 0.1)
    assert_close(errors[1], np.zeros(4), 0.005, np.abs(exact))
