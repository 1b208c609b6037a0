"""Stress resultants of a beam in space: against all that acts, statics, the plane, closed forms."""

import numpy as np
import pytest
from comparison import assert_close
from motions import through
from tolerances import IDENTITY, SOLVED

import romjax as rj

# Slopes of a tenth, of which the third power differs, by a twelfth.
SECOND = 1e-4
LENGTH, MASS, POLAR = 0.9, 1.3, 0.02
ACROSS = MASS * LENGTH**2 / 12


def beam(thick=0.0, **options):
    """With stiffness in all ways; sections of `thick` about y, twice that about z."""
    stiffness = {"EI": (2.0, 3.0), "GJ": 1.5, "EA": 40.0}
    inertia = (POLAR, ACROSS + thick, ACROSS + 2 * thick)
    counts = {"bending": 2, "torsion": 1, "extension": 1}
    return rj.spatial.Beam("beam", MASS, LENGTH, inertia, **stiffness, **{**counts, **options})


@pytest.mark.parametrize("rotary", [False, True], ids=["slender", "rotary"])
def test_a_free_beam_pulls_at_nothing(rotary):
    """Beyond a cut at its start is all of it and all that acts on it, beyond one at its end
    nothing: in any motion, bent, twisted and stretched, by the accelerations of the system, which
    follow from energies.
    """
    body = beam(thick=0.02 * rotary, rotary=rotary)
    loads = [
        rj.Gravity((0.3, -9.0, 2.0)),
        rj.Force(body.at((0.2, 0.03, 0.0)), (1.0, 2.0, -1.0), rj.Constant(3.0)),
        rj.spatial.Torque(body.at((0.1, 0.0, 0.0)), (0.5, -1.0, 2.0), rj.Constant(0.7)),
    ]
    system = rj.assemble(rj.Scene([body], [], loads))
    rng = np.random.default_rng(3)
    q = np.asarray(system.q0) + 0.05 * rng.normal(size=system.n)
    v = rng.normal(size=system.n)
    found = rj.resultants(system, through(system, q=q, v=v), "beam", [-LENGTH / 2, LENGTH / 2])
    for ends in (found.axial[0], found.shear[0], found.moment[0]):
        assert_close(ends, 0.0, IDENTITY, 100.0)


def test_bending_in_a_plane_is_that_of_a_beam_in_the_plane():
    """In the plane of x and y, at one state, turned and in motion."""
    amplitudes, rates = [0.01, -0.004], [0.3, 0.2]
    motion = {"amplitudes": amplitudes, "rates": rates}
    flat = rj.Beam(
        "beam", MASS, LENGTH, EI=3.0, modes=2, angle=0.4, angular_velocity=2.0,
        **motion,
    )  # fmt: skip
    deep = beam(
        bending=(2, 0), torsion=0, extension=0, orientation=(np.cos(0.2), 0.0, 0.0, np.sin(0.2)),
        angular_velocity=(0.0, 0.0, 2.0), **motion,
    )  # fmt: skip
    cuts, found = [-0.3, 0.0, 0.25], []
    for body in (flat, deep):
        loads = [rj.Gravity((0.0, -9.0, 0.0)[: body.dimension])]
        system = rj.assemble(rj.Scene([body], [], loads))
        found.append(rj.resultants(system, through(system), "beam", cuts))
    plane, space = found
    # Sections turn by the slope in the plane and by twice the arctangent of half of it in space.
    assert_close(space.axial, plane.axial, SECOND, 10.0)
    assert_close(space.shear[..., 0], plane.shear, SECOND, 10.0)
    sizes = [np.hypot(x.axial, x.shear.reshape(1, 3, -1)[..., 0]) for x in (space, plane)]
    assert_close(*sizes, IDENTITY, 10.0)
    assert_close(space.moment[..., 2], plane.moment, IDENTITY, 1.0)
    for none in (space.shear[..., 1], space.moment[..., 0], space.moment[..., 1]):
        assert_close(none, 0.0, IDENTITY, 1.0)


def test_a_beam_without_modes_is_a_rigid_bar():
    """Turning about z, under a force and a torque at a point: by the accelerations of a thin bar
    and of sections that turn about it.
    """
    body = beam(bending=0, torsion=0, extension=0, angular_velocity=(0.0, 0.0, 3.0))
    place, force, twist = 0.2, np.array([1.0, 2.0, -1.5]), 0.7
    at = body.at((place, 0.0, 0.0))
    loads = [
        rj.Force(at, force, rj.Constant(np.linalg.norm(force))),
        rj.spatial.Torque(at, (1.0, 0.0, 0.0), rj.Constant(twist)),
    ]
    system = rj.assemble(rj.Scene([body], [], loads))
    cuts = np.array([-0.3, 0.0, 0.25])
    found = rj.resultants(system, through(system), "beam", cuts)
    # Across, of the point at x: F / m + x · (place F) / I.
    rest, end, before = LENGTH / 2 - cuts, LENGTH / 2, cuts < place
    share = rest / LENGTH
    turning = MASS / (2 * LENGTH) * 3.0**2 * (end**2 - cuts**2)
    assert_close(found.axial[0], force[0] * (before - share) + turning, IDENTITY, 10.0)
    slope = MASS * place / (ACROSS * LENGTH)
    across = before - share - slope * (end**2 - cuts**2) / 2
    arm = before * (place - cuts) - share * rest / 2
    arm -= slope * ((end**3 - cuts**3) / 3 - cuts * (end**2 - cuts**2) / 2)
    assert_close(found.shear[0], across[:, None] * force[1:], IDENTITY, 10.0)
    assert_close(found.moment[0, :, 0], twist * (before - share), IDENTITY)
    assert_close(found.moment[0, :, 1:], arm[:, None] * [-force[2], force[1]], IDENTITY)


def test_torsion_of_a_natural_mode():
    """The first mode of a free beam twists by cos π ξ, and its torque is GJ θ′: that of
    twelve polynomials converges to it.
    """
    body = beam(bending=0, torsion=12, extension=0, amplitudes=[0.003, *np.zeros(11)])
    system = rj.assemble(rj.Scene([body]))
    cuts = np.array([-0.3, -0.1, 0.2])
    found = rj.resultants(system, through(system), "beam", cuts)
    twist = np.asarray(body.mode_shapes((-LENGTH / 2, 0.0, 0.0)))[3, 0] * 0.003
    slope = -twist * np.pi / LENGTH * np.sin(np.pi * (cuts / LENGTH + 0.5))
    assert_close(found.moment[0, :, 0], 1.5 * slope, SOLVED, 1.5 * twist)


@pytest.mark.slow
def test_a_clamped_beam_carries_its_loads():
    """Force and torque at its end, by the axes of the section, where they bend and twist it."""
    inertia, counts = (1e-3, 0.054, 0.054), {"bending": 2, "torsion": 1}
    body = rj.spatial.Beam("beam", 1.0, 0.8, inertia, EI=50.0, GJ=30.0, **counts)
    push, twist = np.array([0.2, 0.3, -0.4]), np.array([0.25, -0.1, 0.15])
    loads = [
        rj.Force(body.at("end"), push, rj.Constant(np.linalg.norm(push))),
        rj.spatial.Torque(body.at("end"), twist, rj.Constant(np.linalg.norm(twist))),
    ]
    wall = rj.spatial.Weld(body.at("start"), rj.ground.at(body.pose("start").position))
    system = rj.assemble(rj.Scene([body], [wall], loads))
    q = rj.equilibrium(system)
    rest, cuts = body.started(q, np.zeros_like(q)), np.array([-0.4, -0.1, 0.3])
    found = rj.resultants(system, through(system, q=q, v=np.zeros_like(q)), "beam", cuts)
    end = np.asarray(rest.pose("end").position)
    for i, s in enumerate(cuts):
        pose = rest.pose((s, 0.0, 0.0))
        inside = np.asarray(pose.rotation).T
        force, arm = inside @ push, end - np.asarray(pose.position)
        assert_close(found.axial[0, i], force[0], SOLVED)
        assert_close(found.shear[0, i], force[1:], SOLVED)
        assert_close(found.moment[0, i], inside @ (twist + np.cross(arm, push)), SOLVED)
