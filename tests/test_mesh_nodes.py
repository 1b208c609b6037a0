"""Nodes that do not fit the matrices of a mesh are refused, and told apart from supports."""

import meshes
import numpy as np
import pytest
import scipy.sparse as sp

import romjax as rj
from romjax import spatial

pytestmark = pytest.mark.instant


def beam():
    return rj.ModalBody, *meshes.beam(6, 1.3, 0.7, 1e5, 3.0), None


def plate():
    return rj.ModalBody, *meshes.plate(0.5, 0.2, 4, 2)


def frame():
    """A beam in space whose nodes have rotations too."""
    made = meshes.beam_in_space(6, 1.3, 0.7, 1e4, (5.0, 3.0), 2.0, 1e-3)
    return spatial.ModalBody, *made, None


def brick():
    return spatial.ModalBody, *meshes.brick((0.5, 0.1, 0.08), (3, 1, 1))


def refused(words, kind, stiffness, mass, nodes, rows):
    with pytest.raises(rj.SceneError, match=f"body 'part': .*{words}"):
        kind.of_mesh("part", stiffness, mass, nodes, {"end": 0}, modes=1, dofs=rows)


def turned(nodes):
    """By a quarter about z."""
    return np.concatenate([-nodes[:, 1:2], nodes[:, :1], nodes[:, 2:]], axis=1)


def permuted(nodes):
    return np.random.default_rng(4).permutation(nodes)


def mirrored(nodes):
    return nodes * np.array([[-1.0, 1.0, 1.0]])[:, : nodes.shape[1]]


@pytest.mark.parametrize("make", [beam, plate, frame, brick])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (turned, r"nodes do not fit K. Turning them about .*strains.*no support.*With \("),
        (permuted, "nodes do not fit K. Turning them about .*strains.*order of the nodes"),
        (mirrored, r"nodes do not fit K.*strains.*With \((-x, y|x, -y)"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_nodes_that_do_not_fit_are_refused(make, change, words):
    kind, stiffness, mass, nodes, rows = make()
    refused(words, kind, stiffness, mass, change(nodes), rows)


@pytest.mark.parametrize("make", [beam, frame])
def test_nodes_in_other_units_are_refused(make):
    """Rotations have a length in the matrices: it says what the unit is."""
    kind, stiffness, mass, nodes, rows = make()
    for factor, words in ((1000.0, "0.001"), (0.001, "1000")):
        words = f"strains.*all places times {words} they"
        refused(words, kind, stiffness, mass, factor * nodes, rows)


@pytest.mark.parametrize("make", [plate, brick])
def test_nodes_in_other_units_make_materials_that_there_are_not(make):
    kind, stiffness, mass, nodes, rows = make()
    refused("sound would go.*millimetres", kind, stiffness, mass, 1000 * nodes, rows)


@pytest.mark.parametrize("make", [beam, brick])
def test_a_mesh_of_millimetres_and_tonnes_is_refused(make):
    """All in one system, whose frequencies are right: nothing but the material tells it."""
    kind, stiffness, mass, nodes, rows = make()
    length = np.ones(stiffness.shape[0])
    if rows is None:
        stiffness = 1e3 * stiffness
        length[2::3] = 1e3
    scale = sp.diags_array(length)
    stiffness, mass = (scale @ (matrix / 1e3) @ scale for matrix in (stiffness, mass))
    refused("sound would go.*tonnes", kind, stiffness, mass, 1e3 * nodes, rows)


def test_a_solid_denser_than_any_is_refused():
    kind, stiffness, mass, nodes, rows = brick()
    refused(r"7.8e\+12 kg/m³", kind, stiffness, mass, nodes / 1000, rows)


@pytest.mark.parametrize("make", [beam, plate, frame, brick])
def test_supports_are_told_from_wrong_nodes(make):
    """A spring to the ground, and a node that was taken out with its rows."""
    kind, stiffness, mass, nodes, rows = make()
    if rows is None:
        rows = np.arange(stiffness.shape[0]).reshape(len(nodes), -1)
    spring = sp.coo_array(([1e9], ([rows[3, 1]], [rows[3, 1]])), stiffness.shape)
    words = r"along y takes 1e\+09 N/m, most of it at node 3,.*supports"
    refused(words, kind, stiffness + spring, mass, nodes, rows)
    kept = np.setdiff1d(np.arange(stiffness.shape[0]), rows[0])
    held = [sp.csc_array(matrix)[kept][:, kept] for matrix in (stiffness, mass)]
    refused("Take the supports out of K", kind, *held, nodes[1:], np.searchsorted(kept, rows[1:]))


@pytest.mark.parametrize("make", [plate, brick])
def test_mass_is_one_in_all_directions(make):
    kind, stiffness, mass, nodes, rows = make()
    double = np.ones(rows.size)
    double[rows[:, 0]] = 2**0.5
    scale = sp.diags_array(double)
    words = "its mass is .* along x, .* along y.*one number in all directions"
    refused(words, kind, stiffness, scale @ mass @ scale, nodes, rows)


def test_a_mass_matrix_by_other_nodes_is_refused():
    """One kilogram on each axis, but at another node for each."""
    kind, stiffness, mass, nodes, rows = brick()
    more = np.zeros(rows.size)
    more[rows[np.arange(3), np.arange(3)]] = 1.0
    inertia = mass + sp.diags_array(more)
    refused("centre of mass depends on the axis", kind, stiffness, inertia, nodes, rows)


def test_too_few_digits_are_told():
    """A long plate, whose stiffness against bending is lost in single precision, and its rigid
    motions with it; places of five digits do.
    """
    stiffness, mass, nodes, rows = meshes.plate(1.0, 0.01, 300, 3)
    rounded = stiffness.astype(np.float32).astype(float)
    words = "Take the supports out of K.*K needs all its digits"
    refused(words, rj.ModalBody, rounded, mass, nodes, rows)
    places = np.round(nodes, 5)
    refused("'end' is one point", rj.ModalBody, stiffness, mass, places, rows)
