"""Parameters of scene files: arguments of functions that Box, fit, grad and vmap take."""

import math

import jax
import numpy as np
import pytest
from comparison import assert_close
from scene_files import assert_same
from tolerances import IDENTITY

import romjax as rj


def test_parameters_are_arguments(crank):
    """Of a function that Box, grad and vmap take."""
    make = rj.scene_file(crank)
    assert make.parameters == {"speed": 5.0, "length": 0.4}
    assert_same(make(**make.parameters), make())
    assert float(make(length=0.5).bodies[1].length) == 0.5
    box = rj.Box(make, length=(0.35, 0.5))
    assert_close(box.system(length=0.4).q0, rj.assemble(make()).q0, IDENTITY)

    @jax.vmap
    def positions(length):
        return make(length=length).bodies[2].position

    # Within a transformation the loop is closed, too.
    assert jax.eval_shape(positions, np.ones(3)).shape == (3, 2)


def test_slopes_by_parameters(crank):
    """Of the place of the slider, by the speed and by the length of the rod, in a batch."""
    text = crank.read_text()
    assert "consistent = true" in text
    crank.write_text(text.replace("consistent = true", ""))
    make = rj.scene_file(crank)

    @jax.jit
    @jax.vmap
    def reach(length):
        parameters = {"speed": 5.0, "length": length}
        return jax.value_and_grad(lambda x: make(**x).bodies[2].position[0])(parameters)

    lengths = np.array([0.4, 0.5])
    places, slopes = reach(lengths)
    rod = math.radians(-25.0)
    assert set(slopes) == set(make.parameters)
    assert_close(places, 0.2 * math.cos(math.radians(60.0)) + lengths * math.cos(rod), IDENTITY)
    assert_close(slopes["length"], np.full(2, math.cos(rod)), IDENTITY)
    assert_close(slopes["speed"], np.zeros(2), 0.0)


@pytest.mark.instant
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
