"""Bodies in space from finite-element matrices: modes, invariants, ports."""

import jax
import jax.numpy as jnp
import meshes
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax import spatial
from romjax.linalg import quaternions

EDGES = (0.5, 0.1, 0.08)
# Condition of the eigenproblem: what rounding leaves of the frequency of a natural mode.
CONDITIONED = 1e-8
# Of a beam's mesh: eight linear elements of torsion and extension.
MESH = 1e-2


@pytest.fixture(scope="module")
def mesh():
    """K, M, nodes and rows of a brick whose frame is not in its centre of mass."""
    stiffness, mass, nodes, rows = meshes.brick(EDGES, (2, 1, 1), modulus=2e8, quadratic=True)
    return stiffness, mass, nodes + np.array([[0.1, -0.05, 0.02]]), rows


def faces(nodes):
    """The nodes of both ends along x."""
    along = nodes[:, 0]
    return {
        name: np.flatnonzero(abs(along - end) < 1e-9 * np.ptp(along))
        for name, end in (("start", along.min()), ("end", along.max()))
    }


def brick(mesh, ports=None, **settings):
    stiffness, mass, nodes, rows = mesh
    settings = {"modes": 4, "dofs": rows, **settings}
    ports = faces(nodes) if ports is None else ports
    return spatial.ModalBody.of_mesh("brick", stiffness, mass, nodes, ports, **settings)


def test_free_interface_modes_are_natural_modes(mesh):
    stiffness, mass, nodes, _ = mesh
    full = np.sqrt(scipy.linalg.eigh(stiffness.toarray(), mass.toarray())[0][6:12])
    ports = {"corner": np.argsort(nodes @ np.ones(3))[:3]}
    found = brick(mesh, ports, modes=4, interface="free").natural_frequencies()
    # A port holds its nodes together, so frequencies rise, here by a hundredth at most.
    assert np.all(found > full[:4] * (1 - CONDITIONED))
    assert_close(found, full[:4], 0.02, full[:4])


def test_invariants_against_the_sum_over_nodes(mesh):
    """½ ẋᵀ M ẋ of the places x of all nodes in the inertial frame, with the mesh in rigid pieces:
    then ports tell where nodes are.
    """
    stiffness, mass, nodes, rows = mesh
    order = np.argsort(nodes @ np.array([1.0, 0.1, 0.01]))
    pieces = np.array_split(order, 6)
    body = brick(mesh, {f"piece {i}": piece for i, piece in enumerate(pieces)}, modes=0)
    assert body.modes == 30

    def places(q):
        local = jnp.asarray(nodes)
        for piece, centre, shape in zip(pieces, body.points, body.shapes, strict=False):
            motion = shape @ q[7:]
            arm = nodes[piece] - centre[None]
            turn = jnp.cross(jnp.broadcast_to(motion[3:], arm.shape), arm)
            local = local.at[piece].add(motion[None, :3] + turn)
        turned = quaternions.rotate(jnp.broadcast_to(q[3:7], (len(nodes), 4)), local)
        return jnp.zeros(rows.size).at[rows].set(q[None, :3] + turned)

    @jax.jit
    def both(q, v):
        place, rate = jax.jvp(places, (q,), (v,))
        level = q.at[:7].set(jnp.array([0, 0, 0, 1.0, 0, 0, 0]))
        bent = places(level) - jnp.zeros(rows.size).at[rows].set(nodes)
        own = 0.5 * v @ body.mass_matrix(q) @ v, body.elastic_energy(q), body.first_moment(q)
        return place, rate, bent, *own

    q, v = jax.random.normal(jax.random.key(3), (2, body.size))
    v = v.at[3:7].add(-(q[3:7] @ v[3:7]) / quaternions.squared(q[3:7]) * q[3:7])
    place, rate, bent, kinetic, elastic, moment = (np.asarray(x) for x in both(q, v))
    wanted = 0.5 * rate @ (mass @ rate)
    assert_close(kinetic, wanted, 10 * IDENTITY, wanted)
    wanted = 0.5 * bent @ (stiffness @ bent)
    assert_close(elastic, wanted, CONDITIONED, wanted)
    sums = [np.sum((mass @ place)[rows[:, axis]]) for axis in range(3)]
    assert_close(moment, sums, 10 * IDENTITY, np.max(np.abs(sums)))


def test_modes_are_orthogonal_to_rigid_motion():
    body = brick(meshes.brick(EDGES, (2, 1, 1)))
    inertia = body.inertia
    assert inertia.centred
    assert inertia.swing is None
    assert inertia.inverts
    assert_close(inertia.mass, 7800 * np.prod(EDGES), 10 * IDENTITY, inertia.mass)
    y, x = EDGES[1] ** 2 + EDGES[2] ** 2, EDGES[0] ** 2
    wanted = inertia.mass / 12 * np.diag([y, x + EDGES[2] ** 2, x + EDGES[1] ** 2])
    assert_close(inertia.moment, wanted, 10 * IDENTITY, np.max(wanted))


def test_static_modes_represent_loads_at_ports(mesh):
    """A brick clamped at one face, a load or a torque at the other: as by all of the mesh."""
    stiffness, _, nodes, rows = mesh
    body = brick(mesh, modes=0)
    ends = faces(nodes)
    tie = np.zeros((rows.size, 6))
    arm = nodes[ends["end"]] - nodes[ends["end"]].mean(axis=0)
    for axis, unit in enumerate(np.eye(3)):
        tie[rows[ends["end"], axis], axis] = 1
        tie[rows[ends["end"]], 3 + axis] = np.cross(unit, arm)
    others = np.setdiff1d(
        np.arange(rows.size), np.concatenate([rows[e].ravel() for e in ends.values()])
    )
    basis = np.hstack([np.eye(rows.size)[:, others], tie])
    wanted = np.linalg.inv(basis.T @ (stiffness @ basis))[-6:, -6:]
    # The same by the modes and rigid motion, which hold the other port.
    (start, x0), (end, x1) = ((body.shapes[i], body.points[i]) for i in range(2))

    def moved(shape, point):
        rigid = np.eye(6)
        rigid[:3, 3:] = -np.asarray(quaternions.skew(point))
        return np.hstack([rigid, shape])

    free = scipy.linalg.null_space(moved(start, x0))
    energy = np.diag(np.concatenate([np.zeros(6), body.stiffness]))
    tip = moved(end, x1) @ free
    found = tip @ np.linalg.solve(free.T @ energy @ free, tip.T)
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert_close(found, wanted, CONDITIONED, scale)


def test_a_step_costs_the_same_for_any_mesh():
    """The program of a body has as many operations for a fine mesh as for a coarse one."""
    bodies = [brick(meshes.brick(EDGES, counts)) for counts in ((2, 1, 1), (6, 2, 2))]
    programs = [
        str(
            jax.make_jaxpr(lambda q, b=b: (b.mass_matrix(q), b.elastic_energy(q)))(jnp.ones(b.size))
        )
        for b in bodies
    ]
    assert len(programs[0].splitlines()) == len(programs[1].splitlines())
    assert [b.size for b in bodies] == [17, 17]


def test_a_mesh_with_rotations():
    """Shells and frames: a beam along x by Hermite elements in two planes, and rods."""
    length, mass, polar = 1.3, 0.7, 1e-3
    stiffness, inertia, nodes = meshes.beam_in_space(8, length, mass, 1e4, (5.0, 3.0), 2.0, polar)
    ports = {"start": 0, "end": 8}
    body = spatial.ModalBody.of_mesh("beam", stiffness, inertia, nodes, ports, modes=8)
    thin = mass * length**2 / 12
    like = spatial.Beam(
        "beam", mass, length, (polar, thin, thin), EI=(5.0, 3.0), bending=6, GJ=2.0, torsion=3
    )
    found, wanted = (np.sort(b.natural_frequencies())[:4] for b in (body, like))
    assert_close(found, wanted, MESH, wanted)
    assert_close(body.inertia.moment, np.diag([polar, thin, thin]), 10 * IDENTITY, thin)
    # Bending turns the ends: displacements along z with rotations about −y.
    shapes = np.abs(like.mode_shapes(jnp.array([length / 2, 0.0, 0.0])))
    lowest = np.argsort(like.natural_frequencies())[:4]
    assert_close(np.abs(body.shapes[1][:, :4]), shapes[:, lowest], MESH, np.max(shapes))


def written(path, matrix, numbers, components):
    """A matrix as Abaqus writes it, with the number and the component of each row."""
    lower = sp.coo_array(sp.tril(sp.coo_array(matrix)))
    rows = zip(lower.row, lower.col, lower.data, strict=True)
    path.write_text(
        "*MATRIX\n"
        + "".join(
            f"{numbers[i]},{components[i]}, {numbers[j]},{components[j]}, {x:.17e}\n"
            for i, j, x in rows
        )
    )
    return path


def test_a_solid_from_files(tmp_path):
    stiffness, mass, nodes, rows = meshes.brick(EDGES, (2, 1, 1))
    numbers, components = np.zeros((2, rows.size), int)
    for component in range(3):
        numbers[rows[:, component]] = 10 * np.arange(1, len(nodes) + 1)
        components[rows[:, component]] = component + 1
    places = {10 * i: node for i, node in enumerate(nodes, 1)}
    files = [
        written(tmp_path / f"job_{name}1.mtx", x, numbers, components)
        for name, x in (("STIF", stiffness), ("MASS", mass))
    ]
    loaded = rj.load_mesh(*files, places, dimension=3)
    found = brick(loaded[:4]).natural_frequencies()
    wanted = brick((stiffness, mass, nodes, rows)).natural_frequencies()
    assert_close(found, wanted, CONDITIONED, wanted)
    with pytest.raises(rj.InputError, match="dimension is 4"):
        rj.load_mesh(*files, places, dimension=4)
    with pytest.raises(rj.InputError, match="plane"):
        rj.load_mesh(*files, places)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"ports": {"tip": [0]}},
            "'tip' is on one line of a mesh without rotations.*three or more",
        ),
        ({"ports": {"tip": 999}}, "'tip'.*999"),
        ({"ports": {}}, "it has no ports"),
        ({"dofs": np.zeros((5, 2))}, r"Give dofs, \(nodes, 3\) or \(nodes, 6\)"),
        ({"interface": "loose"}, "'loose'.*fixed, free"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_bad_meshes_are_refused(mesh, change, words):
    with pytest.raises(rj.SceneError, match=words):
        brick(mesh, **change)


@pytest.mark.instant
def test_supports_and_flat_nodes_are_refused(mesh):
    stiffness, mass, nodes, rows = mesh
    with pytest.raises(rj.SceneError, match="six rigid motions.*supports"):
        brick((stiffness + sp.eye_array(rows.size) * 1e6, mass, nodes, rows))
    with pytest.raises(rj.SceneError, match=r"nodes must be finite and \(nodes, 3\)"):
        brick((stiffness, mass, nodes[:, :2], rows), ports={"tip": 0})


def test_the_outline_runs_along_the_edges():
    """Of a brick: its twelve edges, each twice."""
    body = brick(meshes.brick(EDGES, (3, 2, 2)))
    outline = np.asarray(body.outline())
    steps = np.abs(np.diff(outline, axis=0))
    assert len(steps) == 24
    assert np.all(np.sum(steps > 1e-9, axis=1) == 1)
    assert_close(np.max(np.abs(outline), axis=0), np.array(EDGES) / 2, IDENTITY)
