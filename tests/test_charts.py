"""Motion in several charts: the solver changes them between steps, and nothing else changes."""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import SOLVED
from zoo import four_bar, run

import romjax as rj
from romjax.integrate.post_step import PostStepSolver
from romjax.integrate.term import ChartedMotionTerm, MotionTerm
from romjax.linalg.pattern import Pattern
from romjax.march.step_size import StepSizeControl
from romjax.march.tolerances import Tolerances
from romjax.reduction.charts.atlas import choose_atlas
from romjax.reduction.charts.choose import choose_chart
from romjax.system.state import FullState
from romjax.system.structure import Structure

GRAVITY = 9.81
# The motion leaves a chart here [rad]; the other one has then −1.14 rad, well inside.
LEFT = 2.0
# Rounding of the error estimate shifts each step by 1e-14 / ATOL of its length, and by more where
# the estimate passes zero.
ATOL = 1e-5


class Pendulum(rj.AbstractSystem):
    """A pendulum of length one in the angle q = ±(φ − centre): around the bottom, or mirrored and
    around the top.
    """

    q0: jax.Array
    v0: jax.Array
    centre: jax.Array
    sign: jax.Array
    charted: bool = eqx.field(static=True)
    structure: ClassVar[Structure] = Structure.unnamed(1, 0)
    validity: ClassVar[None] = None

    @property
    def full(self):
        return self

    @property
    def post_step(self):
        return TwoAngles() if self.charted else Nothing()

    def mass(self, q):
        return jnp.eye(1)

    def angle(self, q):
        return self.centre + self.sign * q

    def force(self, t, q, v):
        return -self.sign * GRAVITY * jnp.sin(self.angle(q))

    def constraint(self, t, q):
        return jnp.zeros(0)

    def state(self, t, q, v):
        blocks = (lambda: jnp.eye(1)[None], lambda: jnp.zeros((0, 0, 1)))
        return FullState(
            q,
            v,
            Pattern.dense(1, 0),
            *blocks,
            lambda: self.force(t, q, v),
            lambda q: (jnp.zeros(()), -GRAVITY * jnp.cos(self.angle(q[0]))),
            lambda: None,
        )


class Nothing(eqx.Module):
    """One chart, and steps that change nothing."""

    def start(self, system):
        return None

    def in_chart(self, system, chart):
        return system

    def after_step(self, system, chart, t, q, v):
        return None, q, v


class TwoAngles(eqx.Module):
    """Chart 0 is centred at φ = 0 and chart 1 at φ = π, where its angle is mirrored."""

    def start(self, system):
        return jnp.zeros(())

    def in_chart(self, system, chart):
        top = jax.lax.stop_gradient(chart) > 0.5
        centre, sign = jnp.where(top, jnp.pi, 0.0), jnp.where(top, -1.0, 1.0)
        return eqx.tree_at(lambda s: (s.centre, s.sign), system, (centre, sign))

    def after_step(self, system, chart, t, q, v):
        now = chart
        chart = jnp.where(jnp.abs(q[0]) > LEFT, 1 - now, now)
        other = self.in_chart(system, chart)
        turned = jnp.arctan2(*(f(system.angle(q) - other.centre) for f in (jnp.sin, jnp.cos)))
        return (
            chart,
            jnp.where(chart == now, q, other.sign * turned),
            jnp.where(chart == now, v, system.sign * other.sign * v),
        )


def pendulum(charted):
    """Fast enough to turn over again and again."""
    return Pendulum(jnp.array([0.3]), jnp.array([7.0]), jnp.zeros(()), jnp.ones(()), charted)


def every_step(system, solver, end=3.0):
    """Times and states after each step, with an absolute tolerance, which no chart scales."""
    tolerances = Tolerances.of(system.structure.is_position, 0.0, ATOL, False)
    term, state = MotionTerm(system, None), (system.q0, system.v0)
    if system.charted:
        term = ChartedMotionTerm(term, system.post_step)
        state = (*state, jnp.zeros(()))

    @jax.jit
    def run():
        return diffrax.diffeqsolve(
            term,
            PostStepSolver(solver, system.post_step),
            0.0,
            end,
            1e-3,
            state,
            saveat=diffrax.SaveAt(steps=True),
            stepsize_controller=StepSizeControl.of(tolerances, jnp.zeros(())),
            max_steps=1024,
        )

    solution = run()
    taken = np.isfinite(np.asarray(solution.ts))
    return jax.tree.map(lambda x: np.asarray(x)[taken], (solution.ts, *solution.ys))


def apart(found, wanted):
    """The largest angle between two motions, whatever turn they are in."""
    return np.max(np.abs((np.asarray(found) - np.asarray(wanted) + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize(
    "solver",
    [diffrax.Tsit5(), pytest.param(rj.Rodas5P(), marks=pytest.mark.exhaustive)],
    ids=["Tsit5", "Rodas5P"],
)
def test_the_same_steps_as_in_one_chart(solver):
    """The number of the chart has no part in the error of a step, and starts none anew."""
    t, q, v, chart = every_step(pendulum(True), solver)
    times, angle, rate = every_step(pendulum(False), solver)
    assert len(t) == len(times)
    assert np.max(np.abs(t - times)) <= SOLVED, np.max(np.abs(t - times))
    assert np.sum(np.abs(np.diff(chart))) >= 4
    assert set(chart) == {0.0, 1.0}
    # A step may end further out, but the state that it leaves is inside of its chart.
    assert np.max(np.abs(q)) <= LEFT
    sign = np.where(chart > 0.5, -1.0, 1.0)[:, None]
    error = apart(np.where(chart > 0.5, np.pi, 0.0)[:, None] + sign * q, angle)
    assert error <= SOLVED, error
    # Relative to the velocity, since the shift of the times is in it.
    error = np.max(np.abs(sign * v - rate)) / np.max(np.abs(rate))
    assert error <= SOLVED, error


@pytest.mark.slow
def test_sparse_snapshots_of_one_chart_are_on_one_branch():
    """Between two snapshots a direction can turn over, which only a denser motion shows."""
    system = rj.assemble(four_bar())
    motion = run(system, np.linspace(0.0, 5.0, 1001), rtol=1e-6)
    rows = jax.vmap(lambda q: system.state(0.0, q, 0 * q).jacobian())(motion.q)
    directions = np.linalg.svd(np.asarray(rows))[2][:, -1]
    flips = np.sign(np.sum(directions[1:] * directions[:-1], axis=1))
    directions *= np.cumprod(np.append(1.0, flips))[:, None]  # continuous in time
    sparse = motion.every(10)
    atlas = choose_atlas(system, sparse.t, sparse.q)
    for chart, domain in zip(atlas.charts, atlas.domains, strict=True):
        signs = np.sign(directions[::10][domain] @ chart.read.T)
        assert np.all(signs == signs[0]), f"snapshots {domain}"


@pytest.mark.slow
def test_snapshots_a_turn_apart_are_joined():
    """The crank of the squeezer turns by up to 6 rad from one snapshot to the next, in which the
    other bodies turn back twice: no sign tells whether a choice of coordinates holds in between.
    """
    system = rj.assemble(rj.gallery.squeezer())
    truth = run(system, np.linspace(0.0, 0.5, 51), rtol=1e-10)
    assert np.max(np.abs(np.diff(truth.q, axis=0))) > np.pi
    found = choose_chart(system, truth.t, truth.q)
    assert found.way is not None
    rom = rj.reduce(system, rj.pod(truth, rank=1), "minimal")
    assert rj.compare(truth, run(rom, truth.t, rtol=1e-9)).error <= 1e-6


@pytest.mark.exhaustive
def test_forward_and_reverse_mode_agree():
    """Through the changes of charts of a four-bar that goes all the way round, with respect to its
    start.
    """
    system = rj.assemble(four_bar())
    motion = rj.simulate(system, jnp.linspace(0.0, 2.0, 101), rtol=1e-8)
    rom = rj.reduce(system, rj.pod(motion), "minimal")

    def last(faster, adjoint):
        settings = {"v0": rom.v0 + faster, "dt": 0.02, "adjoint": adjoint, "throw": False}
        return rj.simulate(rom, motion.t, solver=diffrax.Tsit5(), **settings).v[-1, 0]

    at_rest = jnp.zeros(())
    forward = jax.jit(jax.jacfwd(lambda x: last(x, diffrax.ForwardMode())))(at_rest)
    reverse = jax.jit(jax.grad(lambda x: last(x, None)))(at_rest)
    assert abs(forward) > 1e-2
    assert abs(forward - reverse) <= SOLVED * abs(forward), (forward, reverse)


def test_other_terms_are_refused():
    """Those of which nobody knows what the coordinates are."""
    term = diffrax.ODETerm(lambda t, y, args: y)
    solver = PostStepSolver(diffrax.Tsit5(), Nothing())
    with pytest.raises(ValueError, match=r"ODETerm is no motion .*romjax\.simulate"):
        diffrax.diffeqsolve(term, solver, 0.0, 1.0, 0.1, jnp.ones(1))


def test_a_clamped_chain_is_in_closed_form():
    """The clamped bar does not turn: its angle enters the next joint as a constant."""
    system = rj.assemble(rj.gallery.segmented_beam(4, length=1.0))
    q = np.tile(np.asarray(system.q0), (5, 1))
    angle = np.linspace(0.0, 0.5, 5)  # of the last bar about its hinge
    q[:, -3:] = np.stack([0.75 + 0.125 * np.cos(angle), 0.125 * np.sin(angle), angle], axis=1)
    found = choose_chart(system, np.zeros(5), q)
    assert found.chart.affine
    assert len(found.chart.independent.T) == 3
    turns = np.flatnonzero(np.sum(found.chart.independent, axis=1))
    np.testing.assert_array_equal(turns, [5, 8, 11])
