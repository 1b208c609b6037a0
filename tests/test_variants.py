"""What judges models: the same mechanism from other starts, driven and loaded at other speeds."""

import dataclasses

import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY
from zoo import run

import romjax as rj
from romjax.system.schedule import Schedule
from romjax.trials import search
from romjax.trials.attempt import Settings, Truth
from romjax.trials.facts import Facts
from romjax.trials.pace import at_speed
from romjax.trials.progress import Progress
from romjax.trials.variants import TRAINING, UNSEEN, variants


class Late(rj.Ramp):
    """A kind of a user's own, with the fields of another one."""

    def __call__(self, t):
        return self.rate * t**2


class Cubed(rj.AbstractSignal):
    """A signal of a user's own."""

    def corners(self):
        return np.array([0.5])

    def __call__(self, t):
        return t**3


@pytest.mark.parametrize(
    "signal",
    [
        Cubed(),
        Late(2.0, 0.3),
        rj.Constant(2.0),
        rj.Ramp(2.0, 0.3),
        rj.Sine(0.5, frequency=2.0, phase=0.1),
        rj.Chirp(0.5, frequency=2.0, rate=3.0),
        rj.Step(1.0, start=0.2, duration=0.3),
        rj.Table([0.0, 0.4, 1.0], [0.0, 2.0, 1.0]),
        rj.Sum((rj.Ramp(2.0, 0.3), rj.Sine(0.5, frequency=2.0))),
    ],
    ids=lambda signal: type(signal).__name__,
)
def test_a_faster_drive_goes_through_the_same(signal):
    """f(s t) at the time t, and steps end at the same."""
    faster = at_speed(signal, 1.25)
    for t in (0.1, 0.3, 0.45):
        assert_close(faster(t), signal(1.25 * t), IDENTITY)
    assert_close(1.25 * faster.corners(), signal.corners(), IDENTITY)


# Systems that tests move anyway, at rest: with a tree of joints, and with a loop and a body that
# bends.
@pytest.mark.parametrize("make", [zoo.bars, zoo.four_bar])
def test_other_starts_suit_the_joints(make):
    """Bodies as they are, moved and turning; the starts differ, and modes rest."""
    scene, system = make(), zoo.system(make)
    motion = zoo.motion(make)
    starts = [next(variants(scene, system, motion, change)) for change in (*TRAINING, *UNSEEN)]
    assert len({tuple(np.round(np.asarray(one.v0), 9).tolist()) for one in starts}) == len(starts)
    for one in starts:
        again = run(one, motion.t[:2])
        assert bool(again.success)
        assert 1e-3 < float(np.max(np.abs(one.q0 - system.q0))) < 1.0


def test_a_moving_start_gets_another_speed():
    scene, system = zoo.slider_crank(), zoo.system(zoo.slider_crank)
    motion = zoo.motion(zoo.slider_crank)
    faster, later = variants(scene, system, motion, UNSEEN[2])
    assert_close(faster.v0, 1.1 * system.v0, IDENTITY)
    k = int(0.08 * len(motion.t))
    assert_close(later.q0, motion.q[k], IDENTITY)
    assert_close(later.v0, 1.1 * motion.v[k], IDENTITY)


def test_loads_in_time_get_another_speed():
    """And nothing else changes: what rests is not bent by a tilt of its start."""
    scene, motion = zoo.bars(), zoo.motion(zoo.bars)
    load = rj.Torque(scene.bodies[0].at(), rj.Step(3.0, start=0.1, duration=0.2))
    scene = rj.Scene(scene.bodies, scene.joints, [*scene.effects, load])
    system = rj.assemble(scene)
    slower = next(variants(scene, system, motion, UNSEEN[0]))
    assert_close(slower.q0, system.q0, IDENTITY)
    (signal,) = Schedule.of(slower).single or Schedule.of(slower).stacked
    assert_close(0.9 * np.ravel(signal.start + signal.duration), 0.3, IDENTITY)


def test_states_of_effects_are_no_speeds():
    """Loads at another speed begin with the same integral part of a controller."""
    scene = zoo.bars()
    control = rj.PID(
        scene.bodies[0].at(), rj.ground.at(), rj.Sine(0.1, 1.0), integral=1.0, start=2.0
    )
    scene = rj.Scene(scene.bodies, scene.joints, [*scene.effects, control])
    system = rj.assemble(scene)
    slower = next(variants(scene, system, zoo.motion(zoo.bars), UNSEEN[0]))
    (number,) = system.structure.states
    assert float(slower.v0[number]) == float(system.v0[number]) == 2.0


def test_what_moves_alike_or_fails_judges_nothing(monkeypatch):
    """The next start is taken then, and none after one that serves."""
    motion, seen = zoo.motion(zoo.bars), []
    runs = {"fails": None, "alike": motion, "other": dataclasses.replace(motion, q=1.1 * motion.q)}
    monkeypatch.setattr(search, "variants", lambda *_: iter([*runs, "not reached"]))

    def truth(name, *_, **limits):
        seen.append(name)
        return None if runs[name] is None else Truth(zoo.system(zoo.bars), runs[name], 0.1)

    monkeypatch.setattr(Truth, "of", truth)
    begun = search.Search(
        scene=zoo.bars(),
        system=zoo.system(zoo.bars),
        ts=motion.t,
        settings=Settings(1e-3, 1e-8, None),
        progress=Progress(False),
        full=motion,
        once=0.1,
        compiled=1.0,
        training=[truth("alike")],
        facts=Facts(bodies=3, modes=0, freedoms=1, loops=True),
    )
    judging = begun.truths(UNSEEN[:1])
    assert [one.run for one in judging] == [runs["other"]]
    assert seen == ["alike", *runs]
