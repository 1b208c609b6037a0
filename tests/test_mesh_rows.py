"""Meshes whose nodes have rotations or none, and bodies that are reduced already."""

import meshes
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax import spatial
from romjax.scene.body.modes import bending_roots

LENGTH, MASS, POLAR = 1.3, 0.7, 1e-3
EI, GJ = (5.0, 3.0), 2.0
# Condition of the eigenproblem: what rounding leaves of the frequency of a natural mode.
CONDITIONED = 1e-8
# Of the second frequency of a cantilever by eight cubic elements: (β₂ L / 8)⁴ / 1440 for an order
# of 4, and what twenty modes leave of it.
MESH = 2e-4


def frame(elements=8):
    return meshes.beam_in_space(elements, LENGTH, MASS, 1e4, EI, GJ, POLAR)


@pytest.mark.slow
def test_a_cantilever_of_nodes_with_six_rows():
    """Welded at one end it bends about both axes as by Euler and Bernoulli."""
    stiffness, mass, nodes = frame()
    beam = spatial.ModalBody.of_mesh(
        "beam", stiffness, mass, nodes, {"start": 0, "end": 8}, modes=20
    )
    start = rj.ground.at(tuple(nodes[0]))
    system = rj.assemble(rj.Scene([beam], [spatial.Weld(beam.at("start"), start)]))
    found = np.asarray(rj.modes(system).frequencies)[:4]
    roots = bending_roots("clamped-free", 2) ** 2
    wanted = np.sort([root * (e / (MASS * LENGTH**3)) ** 0.5 for root in roots for e in EI])
    assert_close(found, wanted, MESH, wanted)


def with_mast(stiffness, mass, nodes, width):
    """A beam and a heavy point beside it on three bars, whose node has displacements only: K, M,
    nodes and rows.
    """
    d, count = nodes.shape[1], stiffness.shape[0]
    rows = np.full((len(nodes) + 1, width), -1)
    rows[:-1] = np.arange(count).reshape(-1, width)
    rows[-1, :d] = count + np.arange(d)
    tip = np.array([0.1, 0.4, 0.3][:d])
    places = np.concatenate([nodes, tip[None]])
    k = sp.block_diag([stiffness, sp.csc_array((d, d))]).toarray()
    m = sp.block_diag([mass, 0.2 * np.eye(d)]).toarray()
    for node in (0, 4, len(nodes) - 1):
        along = (tip - nodes[node]) / np.linalg.norm(tip - nodes[node])
        pull = np.zeros(count + d)
        pull[rows[-1, :d]], pull[rows[node, :d]] = along, -along
        k += 2e3 * np.outer(pull, pull)
    if d == 3:  # bars in one plane leave the point free across it
        away = np.zeros(count + d)
        arm = tip - nodes[4]
        across = np.cross(arm, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        away[rows[-1, :3]], away[rows[4, :3]] = across, -across
        away[rows[4, 3:]] = -np.cross(arm, across)
        k += 50.0 * np.outer(away, away)
    return k, m, places, rows


@pytest.mark.parametrize("dimension", [2, 3])
def test_nodes_with_and_without_rotations_in_one_mesh(dimension):
    """Frequencies are those of the matrices, inertia that of a beam and a point."""
    if dimension == 2:
        made, kind = meshes.beam(8, LENGTH, MASS, 1e4, 3.0), rj.ModalBody
    else:
        made, kind = frame(), spatial.ModalBody
    k, m, places, rows = with_mast(*made, 3 * dimension - 3)
    rigid = 3 * dimension - 3
    wanted = np.sqrt(scipy.linalg.eigvalsh(k, m)[rigid : rigid + 4])
    ports = {"start": 0, "tip": {"point": len(places) - 1}}
    body = kind.of_mesh("mast", k, m, places, ports, modes=5, interface="free", dofs=rows)
    assert body.unturned == ("tip",)
    assert_close(body.natural_frequencies()[:4], wanted, CONDITIONED, wanted)
    tip = places[-1]
    assert_close(body.inertia.mass, MASS + 0.2, IDENTITY, MASS)
    assert_close(body.inertia.first_moment, 0.2 * tip, IDENTITY, 0.1)
    thin = MASS * LENGTH**2 / 12
    if dimension == 2:
        wanted = thin + 0.2 * tip @ tip
    else:
        point = 0.2 * (tip @ tip * np.eye(3) - np.outer(tip, tip))
        wanted = np.diag([POLAR, thin, thin]) + point
    assert_close(body.inertia.moment, wanted, 10 * IDENTITY, thin)


def test_invariants_do_not_ask_for_rotations_that_are_not_there():
    """They are those of the same mesh whose point has rotations, with hardly an inertia."""
    k, m, places, rows = with_mast(*frame(), 6)
    count = len(k)
    padded = np.zeros((2, count + 3, count + 3))
    padded[0, :count, :count], padded[1, :count, :count] = k, m
    for axis in range(3):  # a spring against turning from the beam
        turn = np.zeros(count + 3)
        turn[count + axis], turn[rows[4, 3 + axis]] = 1.0, -1.0
        padded[0] += np.outer(turn, turn)
        padded[1, count + axis, count + axis] = 1e-14
    full = rows.copy()
    full[-1, 3:] = count + np.arange(3)
    bodies = [
        spatial.ModalBody.of_mesh(
            "b", *matrices, places, {"a": 0}, modes=4, interface="free", dofs=own
        )
        for *matrices, own in ((k, m, rows), (*padded, full))
    ]
    for field in ("stretch", "spread", "gyration"):
        found, wanted = (np.asarray(getattr(body.inertia, field)) for body in bodies)
        assert_close(found, wanted, CONDITIONED, np.max(np.abs(wanted)))


def reduced(stiffness, mass, rows, boundary, modes):
    """K and M of a mesh by the displacements of some nodes and modes held there; the rows of these
    nodes, after those of the modes.
    """
    k, m = (sp.csc_array(x).toarray() for x in (stiffness, mass))
    kept = rows[boundary].ravel()
    inner = np.setdiff1d(np.arange(len(k)), kept)
    basis = np.zeros((len(k), modes + len(kept)))
    block = np.ix_(inner, inner)
    basis[inner, :modes] = scipy.linalg.eigh(k[block], m[block])[1][:, :modes]
    basis[kept, modes + np.arange(len(kept))] = 1
    basis[inner, modes:] = -np.linalg.solve(k[block], k[np.ix_(inner, kept)])
    own = modes + np.arange(len(kept)).reshape(len(boundary), -1)
    return basis.T @ k @ basis, basis.T @ m @ basis, own


def plate():
    return rj.ModalBody, *meshes.plate(0.5, 0.1, 6, 2, modulus=2e8)


def brick():
    return spatial.ModalBody, *meshes.brick((0.5, 0.06, 0.05), (6, 1, 1), modulus=2e8)


def ends(nodes):
    return [np.flatnonzero(abs(nodes[:, 0] - x) < 1e-9) for x in (-0.25, 0.25)]


@pytest.mark.parametrize("make", [plate, brick])
def test_a_reduced_body_is_the_mesh_that_it_was(make):
    """By Craig and Bampton, of the nodes of its ports: frequencies, shapes there, and inertia."""
    kind, stiffness, mass, nodes, rows = make()
    start, end = ends(nodes)
    ports = {"start": start, "end": end}
    whole = kind.of_mesh("part", stiffness, mass, nodes, ports, modes=4, dofs=rows)
    boundary = np.concatenate([start, end])
    k, m, own = reduced(stiffness, mass, rows, boundary, 4)
    ports = {"start": np.arange(len(start)), "end": len(start) + np.arange(len(end))}
    with pytest.warns(UserWarning, match=r"'part': it is reduced already.* rad/s changes"):
        part = kind.of_mesh("part", k, m, nodes[boundary], ports, modes=4, dofs=own)
    assert part.modes == whole.modes
    found, wanted = (np.asarray(body.natural_frequencies()) for body in (part, whole))
    assert_close(found, wanted, CONDITIONED, wanted)
    found, wanted = (np.abs(body.shapes[:2]) for body in (part, whole))
    # Modes of one frequency, about two axes that are alike, are any of their pairs.
    assert_close(found, wanted, 1e-5, np.max(wanted, axis=(0, 2), keepdims=True))
    for field in ("mass", "moment"):
        found, wanted = (np.asarray(getattr(b.inertia, field)) for b in (part, whole))
        assert_close(found, wanted, CONDITIONED, np.max(wanted))


def test_up_to_which_speed_a_reduced_body_may_turn():
    """Both ends of a beam, which are all that it has, move by 2 / √m across it in its first mode:
    turned along it they move all of it, which has four times the mass of the mode.
    """
    stiffness, mass, nodes = meshes.beam(8, LENGTH, MASS, 1e4, 3.0)
    k, m, own = reduced(stiffness, mass, np.arange(27).reshape(9, 3), [0, 8], 6)
    with pytest.warns(UserWarning, match="turning faster than") as told:
        rj.ModalBody.of_mesh("b", k, m, nodes[[0, 8]], {"a": 0}, modes=6, dofs=own)
    limit = float(str(told[0].message).split("faster than about ")[1].split()[0])
    lowest = bending_roots("free-free", 1)[0] ** 2 * (3.0 / (MASS * LENGTH**3)) ** 0.5
    # It is told by two digits.
    assert_close(limit, lowest * (2e-2 / 3) ** 0.5, 0.05, limit)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda rows: np.where(rows == 5, -1, rows),
            "node 0 has the rows .*all its rotations or none",
        ),
        (lambda rows: np.where(rows == 1, -1, rows), "node 0 has the rows .*all its displacements"),
        (lambda rows: np.where(rows == 7, 6, rows), "Give dofs"),
        (lambda rows: rows + 1, "Give dofs"),
        (lambda rows: rows[:, :3], "a turn|Turning"),
        (lambda rows: rows[:-1], r"9 nodes and matrices of 54 rows.*Give dofs"),
    ],
)
def test_rows_that_do_not_fit_are_refused(change, words):
    stiffness, mass, nodes = frame()
    rows = change(np.arange(54).reshape(9, 6))
    with pytest.raises(rj.SceneError, match=words):
        spatial.ModalBody.of_mesh("b", stiffness, mass, nodes, {"a": 0}, modes=1, dofs=rows)


@pytest.mark.instant
def test_nodes_without_their_rows_are_no_modal_coordinates():
    """They move with the body."""
    stiffness, mass, nodes = frame()
    rows = np.arange(54).reshape(9, 6)
    with pytest.raises(rj.SceneError, match="along .* takes .*dofs must say"):
        spatial.ModalBody.of_mesh(
            "b", stiffness, mass, nodes[:-1], {"a": 0}, modes=1, dofs=rows[:-1]
        )
