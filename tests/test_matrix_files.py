"""Meshes from files of Abaqus, CalculiX and Nastran: written here, read back, made a body."""

import sys

import meshes
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from tolerances import IDENTITY, SOLVED

import romjax as rj

# Numbers of the nodes in the programs: neither from 1 nor without gaps.
FIRST, STEP = 101, 10


def beam():
    """A beam of 6 elements: K, M, nodes, and the node and component of each row."""
    stiffness, mass, nodes = meshes.beam(6, 1.3, 0.7, 1e5, 3.0)
    numbers = FIRST + STEP * np.arange(len(nodes))
    dofs = np.stack([np.repeat(numbers, 3), np.tile([1, 2, 6], len(nodes))], axis=1)
    return stiffness, mass, nodes, dofs


def plate():
    """A plate whose rows are in the order of the mesh, not in that of the nodes."""
    stiffness, mass, nodes, rows = meshes.plate(0.5, 0.2, 2, 2, modulus=2e8)
    dofs = np.zeros((rows.size, 2), int)
    for component in range(2):
        dofs[rows[:, component], 0] = FIRST + STEP * np.arange(len(nodes))
        dofs[rows[:, component], 1] = component + 1
    return stiffness, mass, nodes, dofs


def entries(matrix, half):
    """Row, column and value of a triangle of a matrix, or of both."""
    chosen = {"lower": sp.tril, "upper": sp.triu, "whole": sp.coo_array}[half](sp.coo_array(matrix))
    found = sp.coo_array(chosen)
    return list(zip(found.row.tolist(), found.col.tolist(), found.data.tolist(), strict=True))


def write_deck(path, nodes, z=0.0):
    lines = ["*Heading", "** a comment", "*NODE, NSET=ALL"]
    lines += [f"{FIRST + STEP * i}, {x!r}, {y!r}, {z!r}" for i, (x, y) in enumerate(nodes.tolist())]
    path.write_text("\n".join([*lines, "*ELEMENT, TYPE=CPS4", "1, 2, 3, 4, 5", ""]))
    return path


def write_input(path, matrix, dofs, half):
    lines = ["** Assembled matrix", "*MATRIX"]
    for row, column, value in entries(matrix, half):
        (a, i), (b, j) = dofs[row], dofs[column]
        lines.append(f"{a},{i}, {b},{j}, {value:.17e}")
    path.write_text("\n".join([*lines, ""]))
    return path


def abaqus(folder, stiffness, mass, nodes, dofs, half):
    write_input(folder / "job_MASS2.mtx", mass, dofs, half)
    deck = write_deck(folder / "job.inp", nodes)
    return rj.load_mesh(write_input(folder / "job_STIF2.mtx", stiffness, dofs, half), nodes=deck)


def coordinates(folder, stiffness, mass, nodes, dofs, half, components=None):
    """Rows by rising number of node, then component."""
    order = np.lexsort((dofs[:, 1], dofs[:, 0]))
    paths = folder / "k.mtx", folder / "m.mtx"
    for path, matrix in zip(paths, (stiffness, mass), strict=True):
        rows = entries(sp.csc_array(matrix)[order][:, order], half)
        path.write_text("".join(f"{r + 1} {c + 1} {value:.17e}\n" for r, c, value in rows))
    components = components or sorted(set(dofs[:, 1].tolist()))
    return rj.load_mesh(*paths, write_deck(folder / "job.inp", nodes), components=components)


def calculix(folder, stiffness, mass, nodes, dofs, half):
    for ending, matrix in (("sti", stiffness), ("mas", mass)):
        lines = [f"{r + 1} {c + 1} {value:20.17e}" for r, c, value in entries(matrix, half)]
        (folder / f"job.{ending}").write_text("\n".join([*lines, ""]))
    (folder / "job.dof").write_text("".join(f"{node}.{direction}\n" for node, direction in dofs))
    return rj.load_mesh(folder / "job.sti", nodes=write_deck(folder / "job.inp", nodes))


def punch(large):
    """DMIG entries with GRID entries in front, in large or in free fields."""

    def grid(number, x, y):
        if not large:
            return [f"GRID,{number},,{x!r},{y!r},0."]
        return [f"GRID*   {number:16d}{'':16}{x:16.9e}{y:16.9e}", f"*       {0.0:16.9e}"]

    def column(name, head, rows):
        if not large:
            lines = [f"DMIG,{name},{head[0]},{head[1]},," + ",".join(rows[0])]
            return lines + ["," + ",".join(row) for row in rows[1:]]
        lines = [f"DMIG*   {name:16}{head[0]:16d}{head[1]:16d}"]
        return lines + ["*       " + "".join(f"{field:>16}" for field in row) for row in rows]

    def write(folder, stiffness, mass, nodes, dofs, half):
        lines = ["$TITLE = a comment", "$ and one with 1, 2"]
        for i, (x, y) in enumerate(nodes.tolist()):
            lines += grid(FIRST + STEP * i, x, y)
        for name, matrix in (("KAAX", stiffness), ("MAAX", mass)):
            lines.append(f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}")
            columns = {}
            for row, col, value in entries(matrix, half):
                text = f"{value:.9E}" if large else f"{value:.17E}".replace("E", "D")
                columns.setdefault(col, []).append([*map(str, dofs[row]), text])
            for col, rows in columns.items():
                lines += column(name, dofs[col], rows)
        (folder / "job.pch").write_text("\n".join([*lines, ""]))
        return rj.load_mesh(folder / "job.pch")

    return write


# A number in a large field has ten digits.
TEN = 1e-7
FORMATS = {
    "abaqus": (abaqus, IDENTITY),
    "coordinate": (coordinates, IDENTITY),
    "calculix": (calculix, IDENTITY),
    "punch-free": (punch(large=False), IDENTITY),
    "punch-large": (punch(large=True), TEN),
}


@pytest.mark.instant
@pytest.mark.parametrize("half", ["lower", "upper", "whole"])
@pytest.mark.parametrize("make", [beam, plate])
@pytest.mark.parametrize("form", FORMATS)
def test_a_mesh_is_what_was_written(form, make, half, tmp_path):
    write, tol = FORMATS[form]
    stiffness, mass, nodes, dofs = make()
    mesh = write(tmp_path, stiffness, mass, nodes, dofs, half)
    order = np.lexsort((dofs[:, 1], dofs[:, 0]))
    for found, wanted in ((mesh.stiffness, stiffness), (mesh.mass, mass)):
        whole = sp.csc_array(wanted)[order][:, order].toarray()
        assert np.allclose(found.toarray(), whole, rtol=0, atol=tol * np.max(np.abs(whole)))
    assert np.allclose(mesh.nodes, nodes, rtol=0, atol=tol)
    assert mesh.numbers.tolist() == (FIRST + STEP * np.arange(len(nodes))).tolist()
    assert mesh.at(FIRST + STEP, FIRST).tolist() == [1, 0]


@pytest.mark.parametrize("form", FORMATS)
def test_the_body_has_the_frequencies_of_the_mesh(form, tmp_path):
    write, tol = FORMATS[form]
    stiffness, mass, nodes, dofs = plate()
    mesh = write(tmp_path, stiffness, mass, nodes, dofs, "lower")
    rows = np.lexsort((dofs[:, 1], dofs[:, 0])).reshape(-1, 2)
    edges = {"left": nodes[:, 0] < -0.2, "right": nodes[:, 0] > 0.2}
    ports = {name: np.flatnonzero(edge) for name, edge in edges.items()}
    found = rj.ModalBody.of_mesh(
        "plate", mesh.stiffness, mesh.mass, mesh.nodes, ports, modes=4, dofs=mesh.dofs
    )
    wanted = rj.ModalBody.of_mesh("plate", stiffness, mass, nodes, ports, modes=4, dofs=rows)
    errors = found.natural_frequencies() / wanted.natural_frequencies() - 1
    assert np.max(np.abs(errors)) <= max(tol, SOLVED)


def in_space(coupled=0.0):
    """The beam with all six components of a shell, of which three move across its plane."""
    stiffness, mass, nodes, dofs = beam()
    n, count = len(dofs), 3 * len(nodes)
    across = np.stack([np.repeat(dofs[::3, 0], 3), np.tile([3, 4, 5], len(nodes))], axis=1)
    corner = sp.coo_array(([coupled], ([0], [0])), (n, count))
    k = sp.block_array([[stiffness, corner], [corner.T, sp.eye_array(count)]])
    m = sp.block_diag([mass, sp.eye_array(count)])
    return k, m, nodes, np.concatenate([dofs, across])


@pytest.mark.instant
def test_what_moves_across_the_plane_is_left_out(tmp_path):
    k, m, nodes, dofs = in_space()
    mesh = abaqus(tmp_path, k, m, nodes, dofs, "lower")
    assert np.allclose(mesh.stiffness.toarray(), beam()[0].toarray(), rtol=IDENTITY)
    k, m, nodes, dofs = in_space(coupled=1e3)
    with pytest.raises(
        rj.InputError, match=r"x of node 101 is coupled to z of node 101.*plane x–y"
    ):
        abaqus(tmp_path, k, m, nodes, dofs, "lower")


@pytest.mark.instant
def test_supports_are_refused(tmp_path):
    stiffness, mass, nodes, dofs = beam()
    held = [sp.csc_array(matrix)[1:, 1:] for matrix in (stiffness, mass)]
    with pytest.raises(rj.InputError, match=r"node 101 has no row for x, .*take supports out"):
        abaqus(tmp_path, *held, nodes, dofs[1:], "lower")


@pytest.mark.instant
def test_rotations_without_stiffness_are_left_out(tmp_path):
    """As those of membranes, whose rows hold zeros."""
    stiffness, mass, nodes, dofs = plate()
    turns = np.stack([FIRST + STEP * np.arange(len(nodes)), np.full(len(nodes), 6)], axis=1)
    zero = sp.coo_array((np.zeros(len(nodes)), (range(len(nodes)),) * 2))
    padded = [sp.block_array([[matrix, None], [None, zero]]) for matrix in (stiffness, mass)]
    mesh = abaqus(tmp_path, *padded, nodes, np.concatenate([dofs, turns]), "whole")
    assert mesh.dofs.shape == (len(nodes), 2)


def write_broken(folder, change):
    """Files of Abaqus and CalculiX, and a punch file, of the beam, after a `change`."""
    stiffness, mass, nodes, dofs = beam()
    for write in (abaqus, calculix, punch(large=True)):
        write(folder, stiffness, mass, nodes, dofs, "lower")
    name, old, new = change
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("job_STIF2.mtx", "101,1, 101,1,", "101,1, 101,"), "line 3.*row of 5 numbers; write"),
        (("job_STIF2.mtx", "e+05", "e+05x"), "line 3.*row of 5 numbers"),
        (("job_STIF2.mtx", "101,1, 101,1,", "-7,1, 101,1,"), "line 3: node -7 is internal.*take"),
        (("job_STIF2.mtx", "101,1, 101,1,", "101,8, 101,1,"), "line 3: degree of freedom 8"),
        (("job_STIF2.mtx", "111,1, 101,1,", "101,1, 101,1,"), "line 4.*second time; write"),
        (("job_STIF2.mtx", "101,1, 101,1,", "101.5,1, 101,1,"), "line 3.*by fractions"),
        (("job_STIF2.mtx", "** Ass", "%%MatrixMarket"), "line 1.*of_mesh takes its name"),
        (("job.inp", "111,", "112,"), "STIF2.mtx: 1 nodes, such as 111, have no place"),
        (("job.inp", "111,", "101,"), "node 101 is there twice"),
        (("job.inp", "0.0, 0.0", "0.0, 0.1"), "between z = 0 and 0.1 m; mesh"),
        (("job.inp", "*NODE,", "*NODE, INPUT=b.inp,"), "line 3: the nodes are in another file"),
        (("job.inp", "101, ", "101, x"), "line 4.*no node; correct"),
        (("job.inp", "*NODE,", "*NSET,"), r"job.inp: has no nodes \(\*NODE"),
    ],
    ids=lambda value: "".join(value[1:]) if isinstance(value, tuple) else "",
)
def test_wrong_files_of_abaqus_are_refused(change, words, tmp_path):
    write_broken(tmp_path, change)
    with pytest.raises(rj.InputError, match=f"load_mesh.*{words}"):
        rj.load_mesh(tmp_path / "job_STIF2.mtx", nodes=tmp_path / "job.inp")


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("job.dof", "101.6", "101"), "job.dof, line 3: '101' is not node.direction; write"),
        (("job.sti", "1 1 ", "99 1 "), "job.sti, line 1: row or column 99, but.*has 21; take both"),
        (("job.mas", "1 1 ", "1 x "), "job.mas, line 1.*row of 3 numbers"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_wrong_files_of_calculix_are_refused(change, words, tmp_path):
    write_broken(tmp_path, change)
    with pytest.raises(rj.InputError, match=words):
        rj.load_mesh(tmp_path / "job.sti", nodes=tmp_path / "job.inp")


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("job.pch", "KAAX           0       6", "KAAX           0       9"), "line 17: form 9"),
        (("job.pch", "DMIG    KAAX  ", "DMIG    KBAX  "), "matrices KBAX, KAAX, MAAX; give names="),
        (("job.pch", "DMIG    KAAX  ", "$"), "line 18: no header DMIG,KAAX,0; add it"),
        (("job.pch", "E+05", "X+05"), "line 19.*in an entry DMIG is not a number; correct"),
        (
            (
                "job.pch",
                "GRID*                101                ",
                "GRID*                101" + 15 * " " + "1",
            ),
            "line 3: GRID 101 is in the coordinate system 1",
        ),
    ],
    ids=["rectangular", "two of one letter", "no header", "no number", "a system of its own"],
)
def test_wrong_punch_files_are_refused(change, words, tmp_path):
    write_broken(tmp_path, change)
    with pytest.raises(rj.InputError, match=f"job.pch.*{words}"):
        rj.load_mesh(tmp_path / "job.pch")


@pytest.mark.instant
def test_what_is_not_there_is_refused(tmp_path):
    write_broken(tmp_path, ("job.inp", "101", "101"))
    deck, path = tmp_path / "job.inp", tmp_path / "job_STIF2.mtx"
    with pytest.raises(rj.InputError, match="no places of nodes; give nodes="):
        rj.load_mesh(path)
    with pytest.raises(rj.InputError, match=r"other_MASS\.mtx: there is no such file"):
        rj.load_mesh(path, tmp_path / "other_MASS.mtx", deck)
    with pytest.raises(rj.InputError, match=r"job.txt is no .mtx, .sti"):
        rj.load_mesh(tmp_path / "job.txt", nodes=deck)
    with pytest.raises(rj.InputError, match="there is no node 5"):
        rj.load_mesh(path, nodes=deck).at(5)
    with pytest.raises(rj.InputError, match="no NONE or MAAX; it has the matrices KAAX, MAAX"):
        rj.load_mesh(tmp_path / "job.pch", names=("none", "MAAX"))
    with pytest.raises(rj.SceneError, match=r"body 'rod'.*no Matrix Market.*romjax.load_mesh"):
        rj.ModalBody.of_mesh("rod", path, path, [[0.0, 0.0]], {"end": 0}, modes=1)


@pytest.mark.instant
def test_rows_without_names_need_components(tmp_path):
    stiffness, mass, nodes, dofs = beam()
    coordinates(tmp_path, stiffness, mass, nodes, dofs, "lower")
    paths = tmp_path / "k.mtx", tmp_path / "m.mtx", tmp_path / "job.inp"
    with pytest.raises(
        rj.InputError, match=r"21 rows for 7 nodes; give the components.*\(1, 2, 6\)"
    ):
        rj.load_mesh(*paths)


@pytest.mark.instant
def test_output4(tmp_path):
    """Rows of six components for each node, most of them empty."""
    op4 = pytest.importorskip("pyNastran.op4.op4")
    stiffness, mass, nodes, dofs = beam()
    rows = (dofs[:, 0] - FIRST) // STEP * 6 + dofs[:, 1] - 1
    matrices = {}
    for name, matrix in (("KGG", stiffness), ("MGG", mass)):
        matrices[name] = (6, np.zeros((6 * len(nodes), 6 * len(nodes))))
        matrices[name][1][np.ix_(rows, rows)] = matrix.toarray()
    path = tmp_path / "job.op4"
    op4.OP4(debug=None).write_op4(str(path), matrices, is_binary=False)
    mesh = rj.load_mesh(path, nodes=write_deck(tmp_path / "job.inp", nodes))
    assert np.allclose(mesh.stiffness.toarray(), stiffness.toarray(), rtol=IDENTITY)
    path.write_text("nothing")
    with pytest.raises(rj.InputError, match="no OUTPUT4 file"):
        rj.load_mesh(path, nodes=tmp_path / "job.inp")


@pytest.mark.instant
def test_output4_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyNastran", None)
    monkeypatch.setitem(sys.modules, "pyNastran.op4.op4", None)
    with pytest.raises(
        ImportError, match=r"pyNastran: pip install 'romjax\[nastran\]'; or write DMIG"
    ):
        rj.load_mesh(tmp_path / "job.op4", nodes=[[0.0, 0.0]])


def reduced_beam():
    """The beam by its ends and three modes between them: K, M, nodes and dofs, of which those of
    the modes are scalar points.
    """
    stiffness, mass, nodes, dofs = beam()
    k, m = stiffness.toarray(), mass.toarray()
    ends = np.array([0, 1, 2, len(k) - 3, len(k) - 2, len(k) - 1])
    inner = np.setdiff1d(np.arange(len(k)), ends)
    block = np.ix_(inner, inner)
    basis = np.zeros((len(k), 9))
    basis[ends, np.arange(6)] = 1
    basis[inner, :6] = -np.linalg.solve(k[block], k[np.ix_(inner, ends)])
    basis[inner, 6:] = scipy.linalg.eigh(k[block], m[block])[1][:, :3]
    modal = np.stack([9001 + np.arange(3), np.zeros(3, int)], axis=1)
    k, m = (
        np.where(abs(x) > 1e-12 * np.max(abs(x)), x, 0)
        for x in (basis.T @ k @ basis, basis.T @ m @ basis)
    )
    return k, m, nodes, np.concatenate([dofs[ends], modal])


@pytest.mark.parametrize("form", ["punch", "coordinate"])
def test_reduced_bodies_from_two_files(form, tmp_path):
    """Scalar points of Nastran, or rows after those of the nodes, are modal coordinates."""
    k, m, nodes, dofs = reduced_beam()
    if form == "punch":
        punch(large=False)(tmp_path, k, m, nodes, dofs, "lower")
        text = (tmp_path / "job.pch").read_text()
        cut = text.index("DMIG    MAAX")
        (tmp_path / "k.pch").write_text(text[:cut])
        (tmp_path / "m.pch").write_text(text[cut:])
        mesh = rj.load_mesh(tmp_path / "k.pch", tmp_path / "m.pch")
        again = tmp_path / "again.pch"
        again.write_text(text)
        with pytest.raises(rj.InputError, match="KAAX is in .*too; give one"):
            rj.load_mesh(tmp_path / "k.pch", again)
    else:
        mesh = coordinates(tmp_path, k, m, nodes[[0, -1]], dofs, "lower", components=(1, 2, 6))
    assert mesh.dofs.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert np.allclose(mesh.nodes, nodes[[0, -1]], rtol=0, atol=IDENTITY)
    assert mesh.stiffness.shape == (9, 9)
    ports = {"start": 0, "end": 1}
    with pytest.warns(UserWarning, match="reduced already"):
        found = rj.ModalBody.of_mesh("b", *mesh[:3], ports, modes=3, dofs=mesh.dofs)
    stiffness, mass, nodes, _ = beam()
    ports = {"start": 0, "end": 6}
    wanted = rj.ModalBody.of_mesh("b", stiffness, mass, nodes, ports, modes=3)
    errors = found.natural_frequencies() / wanted.natural_frequencies() - 1
    assert np.max(np.abs(errors)) <= SOLVED


@pytest.mark.instant
def test_nodes_with_and_without_rotations(tmp_path):
    """A node with displacements only, among those of a beam."""
    stiffness, mass, nodes, dofs = beam()
    kept = np.flatnonzero((dofs[:, 0] != FIRST + 2 * STEP) | (dofs[:, 1] != 6))
    k, m = (sp.csc_array(x)[kept][:, kept] for x in (stiffness, mass))
    mesh = abaqus(tmp_path, k, m, nodes, dofs[kept], "lower")
    assert mesh.dofs[1:4].tolist() == [[3, 4, 5], [6, 7, -1], [8, 9, 10]]
