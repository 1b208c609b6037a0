"""Motions with impacts, which a reduced model repeats from one impact to the next."""

import dataclasses

import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import SOLVED

import romjax as rj
from romjax.events.record import Events
from romjax.integrate import repeated
from romjax.system.training import training_of


def test_a_model_of_all_freedoms_goes_on_after_each_impact():
    """With its own velocities, which are those of the full system then."""
    system = zoo.system(zoo.bars, angles=(-0.4, 0.1))
    wall = rj.Impact(_angle, restitution=0.7, level=-1.4)
    motion = zoo.run(system, np.linspace(0.0, 1.0, 51), events=[wall])
    assert int(motion.events.count) > 1
    rom = rj.reduce(system, rj.pod(motion), "minimal")
    count = repeated.undisturbed(motion)
    begun = zoo.run(rom, motion.t[:count])
    whole = repeated.after_impacts(rom, motion, begun, zoo.TIGHT, zoo.run)
    assert_close(whole, motion.q, SOLVED)
    # Rows that nobody repeats are those of the motion.
    assert np.all(np.any(whole[count:] != np.asarray(motion.q)[count:], axis=1))


def _angle(system, t, q, v):
    """Of the first bar."""
    del system, t, v
    return q[2]


def struck_arm(EI=30.0):
    """A rigid arm that strikes a wall, and a beam hinged to it, which the impact makes ring."""
    arm = rj.RigidBody("arm", 1.0, 0.02, position=(0.25, 0.0))
    beam = rj.Beam("beam", 0.4, 0.8, EI=EI, modes=4, damping=0.02, position=(0.9, 0.0))
    joints = [
        rj.Revolute(arm.at((-0.25, 0.0)), rj.ground.at()),
        rj.Revolute(beam.at("start"), arm.at((0.25, 0.0))),
    ]
    wall = rj.Impact(rj.quantity.Turn(arm.at(), rj.ground.at()), restitution=0.8, level=-1.87)
    return rj.assemble(rj.Scene([arm, beam], joints, [rj.Gravity()])), wall


@pytest.mark.slow
@pytest.mark.parametrize("rank", [2, 4])
def test_what_a_model_errs_by_after_an_impact_is_told_of(rank):
    """Before it the error of two modes is below 1e-5: they hold how the beam bends until then."""
    system, wall = struck_arm()
    ts = np.linspace(0.0, 0.9, 91)
    motion = rj.simulate(system, ts, events=[wall], rtol=1e-9)
    rom = rj.reduce(system, rj.pod(motion), rj.Local(ranks=(0, rank)))
    run = rj.simulate(rom, ts, events=[wall])
    places = np.ravel(system.structure.positions)
    q, other = np.asarray(motion.q)[:, places], np.asarray(run.q)[:, places]
    error = np.max(np.abs(other - q)) / np.max(np.abs(q - q[0]))
    (measured,) = training_of(rom).errors
    before = measured.error[repeated.undisturbed(motion) - 1]
    assert before < 1e-5
    assert (error > 1e-3) == (rank == 2)
    assert bool(run.flags & rj.Flag.LEFT_OUT) == (rank == 2)
    if rank == 2:
        assert 0.5 < measured.error[-1] / error < 2


def test_motions_are_undisturbed_until_an_impact_or_a_stop():
    """What is only looked for changes none."""
    motion = zoo.motion(zoo.five_bar)
    t = np.asarray(motion.t)
    struck = impacts(t[10], t[20] + 0.3 * (t[21] - t[20]), changed=[1])
    crossed = dataclasses.replace(struck, v_after=struck.v_before)
    held = np.minimum(t, t[30])
    counts = [
        repeated.undisturbed(dataclasses.replace(motion, events=happened, t=times))
        for happened, times in ((None, t), (crossed, t), (struck, t), (crossed, held))
    ]
    assert counts == [len(t), len(t), 21, 31]


def test_models_go_on_after_the_impacts_that_the_longest_motions_follow():
    """After none that another follows before the next output, nor after a stop."""
    motion = zoo.motion(zoo.five_bar)
    t = np.asarray(motion.t)
    step = t[1] - t[0]
    times = [t[10] + 0.1 * step, t[10] + 0.2 * step, *(t[20:80:2] + 0.5 * step)]
    struck = dataclasses.replace(
        motion, events=impacts(*times, changed=range(len(times))), t=np.minimum(t, t[90])
    )
    pieces = repeated._longest(struck)
    assert len(pieces) == repeated._IMPACTS
    assert [(rows.start, rows.stop) for _, rows in pieces[:3]] == [(79, 91), (11, 21), (21, 23)]
    assert_close(pieces[1][0].time, times[1], 0.0)


def impacts(*times, changed):
    """A record of events at these times, of which some are impacts."""
    count = len(times)
    none = np.zeros((count, 12))
    after = none.copy()
    after[list(changed), 4] = 1.0
    each = {"happened": np.ones((count, 1), bool), "impulse": np.zeros((count, 1)), "q": none}
    lasting = np.array(False)
    return Events(
        np.array(count), np.array(times), **each, v_before=none, v_after=after, lasting=lasting
    )
