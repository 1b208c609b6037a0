"""What CalculiX expands to layers, and its rigid bodies, from files in its format written here."""

import meshes
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax import spatial

# Condition of the eigenproblem: what rounding leaves of the frequency of a natural mode, and of the
# places that rigid motions tell.
CONDITIONED = 1e-8


def write(folder, stiffness, mass, dofs, nodes, keywords):
    """A job of CalculiX: `dofs` (rows, 2) of a node and a direction, `nodes` by their numbers."""
    for ending, matrix in (("sti", stiffness), ("mas", mass)):
        lower = sp.coo_array(sp.tril(sp.coo_array(matrix)))
        rows = zip(lower.row, lower.col, lower.data, strict=True)
        text = "".join(f"{r + 1} {c + 1} {value:20.17e}\n" for r, c, value in rows)
        (folder / f"job.{ending}").write_text(text)
    (folder / "job.dof").write_text("".join(f"{node}.{way}\n" for node, way in dofs))
    places = [f"{n}, " + ", ".join(map(repr, map(float, x))) for n, x in nodes.items()]
    deck = ["*NODE, NSET=ALL", *places, *keywords, ""]
    (folder / "job.inp").write_text("\n".join(deck))
    return folder / "job.sti", folder / "job.inp"


def in_layers(edges, counts, across):
    """A block one element thick along some axes, with the nodes that stand for its layers: K and M
    by layers, dofs, places of the layers, places of the nodes by number.
    """
    stiffness, mass, places, rows = meshes.brick(edges, counts, modulus=2e9)
    means = places.copy()
    means[:, across] = 0.0
    kept, node = np.unique(np.round(means, 9), axis=0, return_inverse=True)
    order = np.lexsort((*places.T, node))
    number = 11 + 3 * node[order]
    found = rows[order].ravel()
    stiffness, mass = (sp.csc_array(x)[found][:, found] for x in (stiffness, mass))
    dofs = np.stack([np.repeat(number, 3), np.tile([1, 2, 3], len(order))], axis=1)
    nodes = {11 + 3 * i: place for i, place in enumerate(kept)}
    return stiffness, mass, dofs, places[order], nodes


CASES = {
    "shell": ((0.5, 0.2, 0.02), (4, 2, 1), [2], "*ELEMENT, TYPE=S4, ELSET=E"),
    "beam": ((0.5, 0.02, 0.03), (5, 1, 1), [1, 2], "*Element, type=B31, elset=E"),
}


@pytest.mark.parametrize("case", CASES)
def test_shells_and_beams_are_read_by_their_layers(case, tmp_path):
    """Layers are where K says: by its rigid motions, about nodes of which the deck has places."""
    edges, counts, across, keyword = CASES[case]
    k, m, dofs, places, nodes = in_layers(edges, counts, across)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    shift = np.array([[0.3, 0.1, -0.2]])
    block = sp.kron(sp.eye_array(len(places)), turn)
    k, m = (block @ x @ block.T for x in (k, m))
    nodes = {number: turn @ place + shift[0] for number, place in nodes.items()}
    paths = write(tmp_path, k, m, dofs, nodes, [keyword, "1, 11, 14, 17, 20"])
    mesh = rj.load_mesh(paths[0], nodes=paths[1], dimension=3)
    wanted = places @ turn.T + shift
    assert_close(mesh.nodes, wanted, CONDITIONED, 1.0)
    ends = [number for number, x in nodes.items() if (x - shift[0]) @ turn[:, 0] > 0.2499]
    chosen = mesh.at(*ends)
    assert np.all((mesh.nodes[chosen] - shift) @ turn[:, 0] > 0.2499)
    assert len(chosen) == (6 if case == "shell" else 4)
    body = spatial.ModalBody.of_mesh(
        "b",
        mesh.stiffness,
        mesh.mass,
        mesh.nodes,
        {"end": {"mean": chosen}},
        modes=4,
        dofs=mesh.dofs,
    )
    full = np.sqrt(scipy.linalg.eigvalsh(k.toarray(), m.toarray())[6:10])
    assert_close(body.natural_frequencies()[:4], full, CONDITIONED, full)


def in_plane_stress():
    """A plate of one layer of which both sides move alike in the plane: K, M, dofs and nodes."""
    k, m, dofs, _, nodes = in_layers((0.5, 0.2, 0.02), (4, 2, 1), [2])
    tie, kept = np.zeros((len(dofs), len(dofs) // 2)), []
    for index, number in enumerate(nodes):
        below, above = np.flatnonzero(dofs[:, 0] == number).reshape(2, 3)
        for way in range(3):
            sign = -1.0 if way == 2 else 1.0
            tie[below[way], 3 * index + way], tie[above[way], 3 * index + way] = sign, 1.0
            kept.append((number, way + 1))
    return tie.T @ k @ tie, tie.T @ m @ tie, np.array(kept), nodes


def test_plane_stress_keeps_changes_of_thickness(tmp_path):
    k, m, dofs, nodes = in_plane_stress()
    paths = write(tmp_path, k, m, dofs, nodes, ["*ELEMENT, TYPE=CPS4", "1, 11, 14, 17, 20"])
    mesh = rj.load_mesh(paths[0], nodes=paths[1])
    edge = np.flatnonzero(mesh.nodes[:, 0] > 0.2499)
    body = rj.ModalBody.of_mesh(
        "b", mesh.stiffness, mesh.mass, mesh.nodes, {"end": {"mean": edge}}, modes=4, dofs=mesh.dofs
    )
    full = np.sqrt(scipy.linalg.eigvalsh(k, m)[3:7])
    assert_close(body.natural_frequencies()[:4], full, CONDITIONED, full)
    assert_close(body.inertia.mass, 7800 * 0.5 * 0.2 * 0.02, IDENTITY, 10.0)
    with pytest.raises(rj.InputError, match="plane stress or strain; give dimension=2"):
        rj.load_mesh(paths[0], nodes=paths[1], dimension=3)
    with pytest.raises(rj.InputError, match="coupled to z.*give the input deck as nodes"):
        rj.load_mesh(paths[0], nodes=nodes)


@pytest.mark.instant
def test_shells_in_the_plane_are_refused_with_the_cure(tmp_path):
    edges, counts, across, keyword = CASES["shell"]
    k, m, dofs, _, nodes = in_layers(edges, counts, across)
    paths = write(tmp_path, k, m, dofs, nodes, [keyword, "1, 11, 14, 17, 20"])
    with pytest.raises(rj.InputError, match="come again.*CPS or CPE.*dimension=3"):
        rj.load_mesh(paths[0], nodes=paths[1])
    with pytest.raises(rj.InputError, match="come again.*give the input deck as nodes"):
        rj.load_mesh(paths[0], nodes=nodes)


@pytest.mark.instant
def test_layers_that_are_held_are_refused(tmp_path):
    edges, counts, across, keyword = CASES["shell"]
    k, m, dofs, _, nodes = in_layers(edges, counts, across)
    k, m, dofs = k[1:, 1:], m[1:, 1:], dofs[1:]
    paths = write(tmp_path, k, m, dofs, nodes, [keyword])
    with pytest.raises(rj.InputError, match="layers of node 11 do not have three.*supports"):
        rj.load_mesh(paths[0], nodes=paths[1], dimension=3)
    spring = np.zeros(k.shape[0])
    spring[:2] = 1e9
    k, m, dofs, _, nodes = in_layers(edges, counts, across)
    held = k + sp.diags_array(np.append(spring, 0.0))
    paths = write(tmp_path, held, m, dofs, nodes, [keyword])
    with pytest.raises(rj.InputError, match="rigid motions in K do not fit.*supports"):
        rj.load_mesh(paths[0], nodes=paths[1], dimension=3)
    paths = write(tmp_path, k, m, dofs, nodes, ["*SHELL SECTION, ELSET=E, OFFSET=0.5", "0.02"])
    with pytest.raises(rj.InputError, match="beside its nodes; move the nodes"):
        rj.load_mesh(paths[0], nodes=paths[1], dimension=3)


def with_rigid_end():
    """A block whose end is a rigid body about node 900, turned by node 901: K, M, dofs, nodes, and
    the mesh that it was made of.
    """
    stiffness, mass, places, rows = meshes.brick((0.5, 0.1, 0.08), (3, 1, 1), modulus=2e8)
    end = np.flatnonzero(places[:, 0] > 0.2499)
    free = np.setdiff1d(np.arange(len(places)), end)
    centre = np.array([0.3, 0.02, 0.0])
    tie = np.zeros((rows.size, 3 * len(free) + 6))
    tie[rows[free].ravel(), np.arange(3 * len(free))] = 1
    for way, unit in enumerate(np.eye(3)):
        tie[rows[end, way], 3 * len(free) + way] = 1
        tie[rows[end], 3 * len(free) + 3 + way] = np.cross(unit, places[end] - centre[None])
    dofs = [(1 + i, way) for i in free for way in (1, 2, 3)]
    dofs += [(number, way) for number in (900, 901) for way in (1, 2, 3)]
    nodes = {1 + i: place for i, place in enumerate(places)}
    nodes |= {900: centre, 901: np.array([9.0, 9.0, 9.0])}
    whole = stiffness, mass, places, rows, end
    return tie.T @ stiffness @ tie, tie.T @ mass @ tie, dofs, nodes, whole


@pytest.mark.parametrize("named", [True, False])
def test_rigid_bodies_turn_by_their_nodes(named, tmp_path):
    """The displacements of a ROT NODE are rotations, also of one that CalculiX makes."""
    k, m, dofs, nodes, (stiffness, mass, places, rows, end) = with_rigid_end()
    turning = ", ROT NODE=901" if named else ""
    if not named:
        del nodes[901]
    keyword = f"*RIGID BODY, NSET=END, REF NODE=900{turning}"
    paths = write(tmp_path, k, m, dofs, nodes, ["*ELEMENT, TYPE=C3D8", "1, 1, 2", keyword])
    mesh = rj.load_mesh(paths[0], nodes=paths[1], dimension=3)
    assert mesh.dofs.shape == (len(places) - len(end) + 1, 6)
    assert np.all(mesh.dofs[:-1, 3:] == -1)
    ports = {"end": mesh.at(900)}
    body = spatial.ModalBody.of_mesh(
        "b", mesh.stiffness, mesh.mass, mesh.nodes, ports, modes=3, dofs=mesh.dofs
    )
    wanted = spatial.ModalBody.of_mesh(
        "b", stiffness, mass, places, {"end": end}, modes=3, dofs=rows
    )
    found, wanted = (x.natural_frequencies() for x in (body, wanted))
    assert_close(found, wanted, CONDITIONED, wanted)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("keyword", "words"),
    [
        ("** nothing", "1 nodes, such as 901, have no place, and 0 rigid bodies.*ROT NODE"),
        ("*RIGID BODY, NSET=END", "line .*no reference node of the deck; give a REF NODE"),
        ("*RIGID BODY, NSET=END, REF NODE=900, ROT NODE=x", "'X' is no number of a node; give"),
    ],
)
def test_nodes_that_nobody_names_are_refused(keyword, words, tmp_path):
    k, m, dofs, nodes, _ = with_rigid_end()
    del nodes[901]
    paths = write(tmp_path, k, m, dofs, nodes, [keyword])
    with pytest.raises(rj.InputError, match=words):
        rj.load_mesh(paths[0], nodes=paths[1], dimension=3)


@pytest.mark.instant
def test_a_rotating_node_that_is_read_as_a_place_is_refused(tmp_path):
    """Without the deck nothing says what it is, but it does not move with the body."""
    k, m, dofs, nodes, _ = with_rigid_end()
    paths = write(tmp_path, k, m, dofs, nodes, [])
    mesh = rj.load_mesh(paths[0], nodes=nodes, dimension=3)
    with pytest.raises(rj.SceneError, match="N/m, most of it at node 12.*dofs must say"):
        spatial.ModalBody.of_mesh(
            "b", mesh.stiffness, mesh.mass, mesh.nodes, {"end": 12}, modes=1, dofs=mesh.dofs
        )
