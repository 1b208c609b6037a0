"""What is measured along a run is measured with the numbers that the run was made with."""

import equinox as eqx
import jax
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import SOLVED

import romjax as rj
from romjax.integrate.derived import EagerQuantities
from romjax.integrate.signature import differs, signature
from romjax.system.structure import without_names

TIP = zoo.bars().bodies[1].at((0.5, 0.0))
VERBS = {
    "measure": lambda system, run: rj.measure(system, run, TIP),
    "part_energies": rj.part_energies,
    "joint_forces": rj.joint_forces,
}
HEAVIER = 1.5


def as_lane(run):
    """A run as one of a batch, which does not know its system."""
    numbers = jax.jit(signature)(without_names(run.system))
    derived = EagerQuantities(np.zeros((len(run.t), 4)), np.eye(6), None, numbers)
    return eqx.tree_at(lambda run: run.derived, run, derived)


@pytest.mark.parametrize("alone", [True, False], ids=["alone", "lane"])
@pytest.mark.parametrize("verb", VERBS)
def test_runs_of_other_numbers_are_refused(verb, alone):
    """Of a run, and of a lane that a program made; of another start nothing is said."""
    run = zoo.motion(zoo.bars)
    known = run if alone else as_lane(run)
    VERBS[verb](zoo.system(zoo.bars, spins=(0.3, -0.2)), known)
    with pytest.raises(rj.InputError, match=f"{verb}: the run is of a system.*other numbers"):
        VERBS[verb](zoo.system(zoo.bars, masses=(1.0, HEAVIER)), known)


def test_names_and_rounding_do_not_count():
    """Of points with names, and of products of inertia that large ones leave of each other."""
    bar = rj.RigidBody("bar", mass=1.0, inertia=1.0, points={"tip": (0.5, 0.1)})
    named = rj.assemble(rj.Scene([bar], [], []))
    assert not differs(named, signature(without_names(named)))
    stiff = zoo.oscillator((1e4, 1e-4))
    noise = eqx.tree_at(lambda system: system.force_.stiffness, stiff, np.array([1e8, 1.1e-8]))
    assert not differs(noise, signature(stiff))


@pytest.mark.parametrize("make", [zoo.bending_four_bar, zoo.loop_in_space, zoo.beam_in_space])
def test_every_number_but_of_the_start_counts(make):
    system = without_names(zoo.system(make))
    leaves, tree = jax.tree_util.tree_flatten_with_path(system)
    numbers, known = [leaf for _, leaf in leaves], signature(system)
    starts = 0
    for i, (path, leaf) in enumerate(leaves):
        for at in np.ndindex(leaf.shape):
            changed = np.array(leaf)
            changed[at] = changed[at] * (1 + 1e-5) + 1e-12
            if abs(changed[at]) < 1e-9:  # one that was zero
                continue
            other = jax.tree.unflatten(tree, [*numbers[:i], changed, *numbers[i + 1 :]])
            is_start = any(jax.tree_util.keystr(path).endswith(name) for name in STARTS)
            assert differs(other, known) is not is_start, jax.tree_util.keystr(path)
            starts += is_start
    assert starts > 0


# Of the whole system, and of its bodies, with the sizes that pictures give them.
STARTS = [".q0", ".v0", "bodies.position", "bodies.angle", "bodies.orientation"]
STARTS += [f"bodies.{x}" for x in ("velocity", "angular_velocity", "amplitudes", "rates", "extent")]


def made_of(mass):
    system = rj.assemble(zoo.bars((1.0, mass)))
    return zoo.run(system, np.linspace(0.0, 0.3, 4), throw=False)


@pytest.mark.slow
def test_lanes_are_measured_with_their_own_system():
    masses = np.array([1.0, HEAVIER])
    lanes = rj.jit(jax.vmap(made_of))(masses)
    for i, mass in enumerate(masses):
        lane = jax.tree.map(lambda x, i=i: x[i], lanes)
        own, other = (zoo.system(zoo.bars, masses=(1.0, x)) for x in (mass, masses[1 - i]))
        wanted = rj.measure(own, made_of(mass), TIP).acceleration
        assert_close(rj.measure(own, lane, TIP).acceleration, wanted, SOLVED)
        for verb, of in VERBS.items():
            with pytest.raises(rj.InputError, match=f"{verb}: the run is of a system"):
                of(other, lane)
