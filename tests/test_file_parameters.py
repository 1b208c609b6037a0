"""Parameters of scene files: arguments of functions that Box, fit, grad and vmap take."""

import math

import jax
import jax.numpy as jnp
import pytest
from comparison import assert_close
from scene_files import assert_same
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj


def test_parameters_are_arguments(crank):
    """Of a function that Box, grad and vmap take."""
    make = rj.scene_file(crank)
    assert make.parameters == {"speed": 5.0, "length": 0.4}
    assert_same(make(**make.parameters), make())
    assert float(make(length=0.5).bodies[1].length) == 0.5
    box = rj.Box(make, length=(0.35, 0.5))
    assert_close(box.system(length=0.4).q0, rj.assemble(make()).q0, IDENTITY)

    def reach(parameters):
        return make(**parameters).bodies[2].position[0]

    slope = jax.jit(jax.grad(reach))(make.parameters)
    assert set(slope) == set(make.parameters)
    assert float(slope["speed"]) == 0.0
    steps = [reach({"speed": 5.0, "length": 0.4 + h}) for h in (-1e-6, 1e-6)]
    assert_close(slope["length"], (steps[1] - steps[0]) / 2e-6, DIFFERENCED)
    place = jax.jit(jax.vmap(lambda x: make(length=x).bodies[2].position))
    lanes = place(jnp.array([0.4, 0.5]))
    assert lanes.shape == (2, 2)


def test_parameters_stand_for_others_and_for_lists(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        'format = 1\n[parameters]\nx = 1\ny = "=x"\n"my point" = [1, 2]\n[bodies.a]\n'
        'type = "RigidBody"\nmass = "=y"\ninertia = 1\nposition = ["=x", 0]\nangle_deg = "=y"\n'
        'velocity = "=my point"\n'
    )
    make = rj.scene_file(path)
    assert list(make.parameters) == ["x", "my point"]
    body = make(x=3.0).bodies[0]
    wanted = rj.RigidBody("a", 3.0, 1.0, (3.0, 0.0), math.radians(3.0), velocity=(1.0, 2.0))
    assert_same(body, wanted)
    for given, words in (
        ({"z": 1.0}, "no parameter 'z'"),
        ({"x": [1.0]}, r"x has shape \(1,\)"),
        ({"x": math.nan}, "must be finite"),
    ):
        with pytest.raises(rj.InputError, match=words):
            make(**given)
    with pytest.raises(rj.SceneFileError, match=r"a\.toml:8: \[bodies\.a\] mass: .*positive"):
        make(x=-1.0)


@pytest.mark.slow
def test_fit_finds_a_parameter_by_its_name(tmp_path):
    path = tmp_path / "spring.toml"
    path.write_text(
        'format = 1\n[parameters]\nstiffness = 50.0\n[bodies.a]\ntype = "RigidBody"\nmass = 1\n'
        'inertia = 1\nposition = [0.1, 0]\n[effects.spring]\ntype = "Spring"\na = "a"\n'
        'b = "ground"\nstiffness = "=stiffness"\n'
    )
    make, ts = rj.scene_file(path), jnp.linspace(0.0, 1.0, 21)

    def predict(parameters):
        return rj.simulate(rj.assemble(make(**parameters)), ts, throw=False)["a.x"]

    found = rj.fit(predict, make.parameters, predict({"stiffness": 70.0}))
    assert_close(found.parameters["stiffness"], 70.0, DIFFERENCED, scale=70.0)
