"""Mean value coordinates, compiled and in torch: identities, two independent computations, finite differences."""

from itertools import combinations

import numpy as np
import pytest
import torch
import trimesh

from bench import generator
from bench.methods.cages.coordinates import mean_value_torch
from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
from bench.methods.cages.coordinates.mean_value_torch import coordinates_in_torch, in_chunks

OFFSETS = np.array([1e-2, 1e-4, 1e-6, 1e-8, 1e-9, 5e-10, 1e-10, 1e-12, 1e-15])


def prism(outline, triangles):
    """A prism of height 1 over a counter-clockwise outline; faces look outward."""
    n = len(outline)
    V = np.vstack([np.column_stack([outline, np.full(n, z)]) for z in (0.0, 1.0)])
    lids = [t[::-1] for t in triangles] + [[n + i for i in t] for t in triangles]
    walls = [t for i, j in zip(range(n), [*range(1, n), 0], strict=True) for t in ([i, j, n + j], [i, n + j, n + i])]
    return V, np.array(lids + walls)


def arrays(mesh, bumps=0.0):
    spread = 1 + bumps * generator(0, len(mesh.vertices)).uniform(-1, 1, (len(mesh.vertices), 1))
    return np.array(mesh.vertices) * spread, np.array(mesh.faces)


def two_boxes():
    V, F = arrays(trimesh.creation.box())
    return np.vstack([V, V + (1.5, 0.2, 0.1)]), np.vstack([F, F + len(V)])


CAGES = {
    "tetrahedron": (np.eye(4, 3)[[3, 0, 1, 2]], np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])),
    "box": arrays(trimesh.creation.box()),
    "L": prism([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]),
    "ball": arrays(trimesh.creation.icosphere(1), bumps=0.2),
    "ring": arrays(trimesh.creation.torus(1.0, 0.4, major_sections=7, minor_sections=5), bumps=0.02),
    "two boxes": two_boxes(),
}  # fmt: skip
cages = pytest.mark.parametrize("name", CAGES)


def compiled(x, V, F, **options):
    return mean_value_coordinates(torch.as_tensor(x), torch.as_tensor(V), F, **options).numpy()


def in_torch(x, V, F):
    return coordinates_in_torch(torch.as_tensor(x)[None], torch.as_tensor(V)[None], F)[0].numpy()


ways = pytest.mark.parametrize("way", [compiled, in_torch])


def around(V, count, seed=0):
    """Points inside and outside: in a box twice as long as that of the cage."""
    middle, half = (V.min(axis=0) + V.max(axis=0)) / 2, np.ptp(V, axis=0) / 2
    return generator(seed, "around").uniform(middle - 2 * half, middle + 2 * half, (count, 3))


def on_faces(V, F, seed=0):
    """One point on each face, and its coordinates."""
    inner = generator(seed, "faces").dirichlet((1, 1, 1), len(F))
    inner = 0.9 * inner + 0.1 / 3  # not at an edge
    w = np.zeros((len(F), len(V)))
    np.put_along_axis(w, F, inner, axis=1)
    return w @ V, w


def on_edges(V, F, seed=0):
    """One point on each edge, and its coordinates."""
    edges = np.unique(np.sort(np.vstack([F[:, list(k)] for k in combinations(range(3), 2)]), axis=1), axis=0)
    t = generator(seed, "edges").uniform(0.05, 0.95, len(edges))
    w = np.zeros((len(edges), len(V)))
    np.put_along_axis(w, edges, np.column_stack([t, 1 - t]), axis=1)
    return w @ V, w


def on_vertices(V, F):
    return V.copy(), np.eye(len(V))


PLACES = {"faces": on_faces, "edges": on_edges, "vertices": on_vertices}
places = pytest.mark.parametrize("place", PLACES)


def normals_of(V, F):
    n = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def off_planes(x, V, F, least=0.02):
    """The points that are not close to the plane of any face."""
    height = np.abs(np.einsum("pfi,fi->pf", x[:, None] - V[F[:, 0]], normals_of(V, F)))
    return x[height.min(axis=1) > least]


def inside(x, V, F):
    return np.abs(solid_angles(x, V, F).sum(axis=1)) > 2 * np.pi


def solid_angles(x, V, F):
    a, b, c = (V[F[:, k]] - x[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(u, axis=-1) for u in (a, b, c))
    rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return 2 * np.arctan2((a * np.cross(b, c)).sum(-1), rest)


# -- identities --------------------------------------------------------------------------------------------------------


@ways
@cages
def test_coordinates_sum_to_1_and_reproduce_the_query_inside_and_outside(name, way):
    V, F = CAGES[name]
    x = around(V, 300)
    assert 5 < inside(x, V, F).sum() < 100
    w = way(x, V, F)
    assert np.abs(w.sum(axis=1) - 1).max() < 1e-12
    assert np.abs(w @ V - x).max() < 1e-12


@ways
@places
@cages
def test_coordinates_interpolate_on_faces_edges_and_vertices(name, place, way):
    V, F = CAGES[name]
    x, expected = PLACES[place](V, F)
    assert np.abs(way(x, V, F) - expected).max() < 1e-12


@ways
@places
@cages
def test_coordinates_are_exact_and_continuous_near_faces_edges_and_vertices(name, place, way):
    V, F = CAGES[name]
    at, expected = PLACES[place](V, F)
    d = generator(1, "directions").normal(size=at.shape)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    for offset in OFFSETS:
        x = at + offset * d
        w = way(x, V, F)
        assert np.abs(w.sum(axis=1) - 1).max() < 1e-12
        assert np.abs(w @ V - x).max() < 2e-9, offset  # faces seen under a smaller angle are left out
        # The slope is unbounded at edges and vertices: it grows logarithmically, more slowly than this.
        assert np.abs(w - expected).max() < 10 * offset**0.8, offset


@places
@cages
def test_float32_coordinates_interpolate_to_rounding(name, place):
    V, F = CAGES[name]
    V = V.astype(np.float32)
    x, expected = PLACES[place](V.astype(np.float64), F)
    w = compiled(x.astype(np.float32), V, F)
    assert w.dtype == np.float32
    assert np.abs(w.astype(np.float64) @ V - x).max() < 1e-6
    assert np.abs(w - expected).max() < 1e-5
    # Computed in float64 and rounded once.
    assert np.array_equal(
        w, compiled(x.astype(np.float32).astype(np.float64), V.astype(np.float64), F).astype(np.float32)
    )


def test_points_of_a_grid_on_coplanar_faces():
    """Each query lies on one of several coplanar faces, near and far from their edges."""
    V, F = CAGES["L"]
    t = np.arange(41) / 20
    x, y = (a.ravel() for a in np.meshgrid(t, t))
    lid = np.column_stack([x, y, np.ones_like(x)])[(x <= 1) | (y <= 1)]
    wall = np.column_stack([x, np.zeros_like(x), y / 2])
    for points in (lid, wall):
        w = compiled(points, V, F)
        assert np.abs(w @ V - points).max() < 1e-12
        assert w.min() > -1e-12 and ((w > 1e-12).sum(axis=1) <= 3).all()


@cages
def test_a_similarity_of_query_and_cage_changes_nothing(name):
    V, F = CAGES[name]
    x = off_planes(around(V, 200), V, F)
    turn = trimesh.transformations.rotation_matrix(1.1, [1, 2, 3])[:3, :3]
    w = compiled(x, V, F)
    for scale in (1e-6, 0.3, 1e6):
        moved = (scale * a @ turn.T + scale * np.array([1, -2, 3]) for a in (x, V))
        assert np.abs(compiled(*moved, F) - w).max() < 1e-9
    mirrored = (a * (-1, 1, 1) for a in (x, V))
    assert np.abs(compiled(*mirrored, F[:, ::-1]) - w).max() < 1e-11


def test_an_affine_map_keeps_linear_precision_and_changes_the_coordinates():
    V, F = CAGES["ball"]
    x = around(V, 100)
    A = np.array([[1.0, 0.8, 0], [0, 2, 0.3], [0, 0, 0.5]])
    w, sheared = compiled(x, V, F), compiled(x @ A.T, V @ A.T, F)
    assert np.abs(w @ (V @ A.T) - x @ A.T).max() < 1e-11
    assert np.abs(sheared @ (V @ A.T) - x @ A.T).max() < 1e-11
    assert np.abs(sheared - w).max() > 0.01


@ways
@cages
def test_faces_may_look_inward(name, way):
    V, F = CAGES[name]
    x = np.vstack([around(V, 50), *(f(V, F)[0] for f in PLACES.values())])
    assert np.abs(way(x, V, F[:, ::-1]) - way(x, V, F)).max() < 1e-11


def test_coordinates_are_positive_in_a_convex_cage():
    for name in ("tetrahedron", "box"):
        V, F = CAGES[name]
        x = generator(0).dirichlet(np.ones(len(V)), 200) @ V
        assert compiled(x, V, F).min() > 0


def test_coordinates_are_equal_at_the_centre_of_a_regular_tetrahedron():
    V = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    F = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    assert np.abs(compiled(np.zeros((1, 3)), V, F) - 0.25).max() < 1e-15
    # In a tetrahedron, the only coordinates with linear precision are the barycentric ones.
    V, F = CAGES["tetrahedron"]
    x = around(V, 100)
    assert np.abs(compiled(x, V, F) - np.column_stack([1 - x.sum(axis=1), x])).max() < 1e-12


def test_vertices_without_faces_have_no_weight():
    V, F = CAGES["box"]
    x = around(V, 50)
    w = compiled(x, np.vstack([V, [[0.1, 0.2, 0.3]]]), F)
    assert not w[:, -1].any() and np.array_equal(w[:, :-1], compiled(x, V, F))


# -- independent computations ------------------------------------------------------------------------------------------


def by_rays(x, V, F, count):
    """The integral over directions of ``sum over hits of (+-) hat_j(hit) / distance``, normalised.

    A hit where the ray enters counts negatively. The directions form a spiral.
    """
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (1 + 5**0.5)
    d = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    w = np.zeros(len(V))
    for face in F:
        a, b, c = V[face]
        normal = np.cross(b - a, c - a)
        facing = d @ normal
        distance = ((a - x) @ normal) / facing
        hit = x + distance[:, None] * d
        inner = np.column_stack([np.cross(q - p, hit - p) @ normal for p, q in ((b, c), (c, a), (a, b))])
        inner /= normal @ normal
        counts = (distance > 0) & (inner >= 0).all(axis=1)
        w[face] += (inner[counts] / distance[counts, None] * np.sign(facing[counts, None])).sum(axis=0)
    return w / w.sum()


@pytest.mark.parametrize(
    ("name", "x"),
    [
        ("box", (0.1, -0.2, 0.15)),
        ("box", (0.9, 0.3, -0.2)),
        ("L", (0.3, 0.4, 0.6)),
        ("L", (1.6, 0.35, 0.45)),
        ("L", (1.45, 1.4, 0.5)),  # outside, between the arms
        ("two boxes", (0.95, 0.1, 0.1)),  # outside, between the boxes
    ],
)
def test_coordinates_match_the_integral_over_all_directions(name, x):
    V, F = CAGES[name]
    x = np.array(x)
    assert np.abs(by_rays(x, V, F, 20_000) - compiled(x[None], V, F)[0]).max() < 5e-3


def by_angles(x, V, F):
    """The formula of Ju, Schaefer and Warren (2005) for one query, face by face, in angles."""
    d = np.linalg.norm(V - x, axis=1)
    u = (V - x) / d[:, None]
    w = np.zeros(len(V))
    for face in F:
        p, before, after = u[face], [2, 0, 1], [1, 2, 0]
        chord = np.linalg.norm(p[after] - p[before], axis=1)
        theta = 2 * np.arcsin(chord / 2)
        half = theta.sum() / 2
        c = 2 * np.sin(half) * np.sin(half - theta) / (np.sin(theta[after]) * np.sin(theta[before])) - 1
        s = np.sign(np.linalg.det(p)) * np.sqrt(1 - c**2)
        w[face] += (theta - c[after] * theta[before] - c[before] * theta[after]) / (
            d[face] * np.sin(theta[after]) * s[before]
        )
    return w / w.sum()


@ways
@pytest.mark.parametrize("name", ["box", "L", "ball", "ring"])
def test_coordinates_match_the_formula_in_angles(name, way):
    V, F = CAGES[name]
    x = off_planes(around(V, 400), V, F)
    x = x[inside(x, V, F)][:20]
    assert len(x) > 4
    assert np.abs(way(x, V, F) - [by_angles(q, V, F) for q in x]).max() < 1e-10


# -- derivatives -------------------------------------------------------------------------------------------------------


def leaf(array):
    return torch.tensor(np.array(array), dtype=torch.float64, requires_grad=True)


def slopes(x, V, F, function=mean_value_coordinates, seed=0):
    """The derivatives of a random combination of all coordinates by queries and by cages."""
    x, v = leaf(x), leaf(V)
    w = function(x, v, F)
    (w * torch.from_numpy(generator(seed, "slopes").normal(size=w.shape))).sum().backward()
    return x.grad.numpy(), v.grad.numpy()


@pytest.mark.parametrize("function", [mean_value_coordinates, coordinates_in_torch])
@pytest.mark.parametrize("name", ["tetrahedron", "L"])
def test_derivatives_by_queries_and_cages_match_finite_differences(name, function):
    V, F = CAGES[name]
    x = off_planes(around(V, 200), V, F, least=0.05)
    x = np.stack([x[:2], x[2:4]])
    moved = V + 0.05 * generator(2).normal(size=(2, *V.shape))
    assert torch.autograd.gradcheck(lambda q, v: function(q, v, F), (leaf(x), leaf(moved)), atol=1e-6, fast_mode=True)


def test_derivatives_of_one_cage_for_many_and_of_many_for_the_same_queries():
    V, F = CAGES["box"]
    x = off_planes(around(V, 100), V, F, least=0.05)[:4].reshape(2, 2, 3)
    moved = V + 0.05 * generator(2).normal(size=(2, *V.shape))
    for q, v in ((x, V), (x[0], moved), (x[:1], moved), (x, V[None])):
        assert torch.autograd.gradcheck(
            lambda q, v: mean_value_coordinates(q, v, F), (leaf(q), leaf(v)), atol=1e-6, fast_mode=True
        )


@pytest.mark.parametrize("place", [None, *PLACES])
@cages
def test_derivatives_are_invariant_to_similarities(name, place):
    """Translating, scaling or rotating queries and cage together changes nothing, wherever the query lies."""
    V, F = CAGES[name]
    x = off_planes(around(V, 50), V, F) if place is None else PLACES[place](V, F)[0]
    for query in x[:12, None]:
        by_x, by_v = slopes(query, V, F)
        assert np.isfinite(by_x).all() and np.isfinite(by_v).all()
        size = 1 + np.abs(by_v).max()
        assert np.abs(by_x.sum(axis=0) + by_v.sum(axis=0)).max() < 1e-11 * size
        assert abs((query * by_x).sum() + (V * by_v).sum()) < 1e-10 * size
        assert np.abs(np.cross(query, by_x).sum(axis=0) + np.cross(V, by_v).sum(axis=0)).max() < 1e-10 * size


@pytest.mark.parametrize("function", [mean_value_coordinates, coordinates_in_torch])
@cages
def test_derivatives_along_faces_and_edges_are_those_of_the_barycentric_coordinates(name, function):
    V, F = CAGES[name]
    if function is coordinates_in_torch:
        function = lambda x, v, F: coordinates_in_torch(x[None], v[None], F)[0]  # noqa: E731
    goal = generator(0, "slopes").normal(size=(len(F), len(V)))
    x, _ = on_faces(V, F)
    by_x, by_v = slopes(x, V, F, function)
    for k, (i, j, l) in enumerate(F):  # noqa: E741
        for a, b in ((i, j), (j, l)):
            assert by_x[k] @ (V[b] - V[a]) == pytest.approx(goal[k, b] - goal[k, a], abs=1e-10)
    assert np.abs(by_x.sum(axis=0) + by_v.sum(axis=0)).max() < 1e-10
    x, w = on_edges(V, F)
    by_x, _ = slopes(x, V, F, function)
    goal = generator(0, "slopes").normal(size=w.shape)
    for k, row in enumerate(w):
        a, b = np.flatnonzero(row)
        assert by_x[k] @ (V[b] - V[a]) == pytest.approx(goal[k, b] - goal[k, a], abs=1e-10)
    assert not np.any(slopes(V, V, F, function))


@cages
def test_derivatives_are_finite_near_faces_edges_and_vertices(name):
    V, F = CAGES[name]
    for place in PLACES.values():
        at, _ = place(V, F)
        d = generator(3, "directions").normal(size=at.shape)
        for offset in OFFSETS[::2]:
            for by in slopes(at + offset * d, V, F):
                assert np.isfinite(by).all()


# -- how it is called --------------------------------------------------------------------------------------------------


def test_elements_of_a_batch_are_independent():
    V, F = CAGES["box"]
    x = around(V, 2 * 40).reshape(2, 40, 3)
    moved = V + 0.1 * generator(2).normal(size=(2, *V.shape))
    alone = np.stack([compiled(q, v, F) for q, v in zip(x, moved, strict=True)])
    assert np.array_equal(compiled(x, moved, F), alone)
    assert np.array_equal(compiled(x[0], moved, F), np.stack([compiled(x[0], v, F) for v in moved]))
    assert np.array_equal(compiled(x, V, F), np.stack([compiled(q, V, F) for q in x]))
    assert np.array_equal(compiled(x[0, 7:9], V, F), compiled(x[0], V, F)[7:9])
    assert compiled(x[0], V, torch.from_numpy(F)).shape == (40, 8) and compiled(x[:, :0], V, F).shape == (2, 0, 8)


def test_any_number_of_threads_gives_the_same_bits():
    V, F = CAGES["ball"]
    x = around(V, 777)
    results = []
    for threads in (1, 2, 3):
        q, v = leaf(x), leaf(V)
        w = mean_value_coordinates(q, v, F, threads=threads)
        w.square().sum().backward()
        results.append([w.detach().numpy().tobytes(), q.grad.numpy().tobytes(), v.grad.numpy().tobytes()])
    assert results[0] == results[1] == results[2]


def test_types_of_queries_and_cages_may_differ():
    V, F = CAGES["box"]
    x, v = torch.tensor(around(V, 5), dtype=torch.float32, requires_grad=True), leaf(V)
    w = mean_value_coordinates(x, v, F)
    w.square().sum().backward()
    assert (w.dtype, x.grad.dtype, v.grad.dtype) == (torch.float32, torch.float32, torch.float64)


@pytest.mark.parametrize(
    ("queries", "vertices", "faces", "says"),
    [
        ((5, 2), (8, 3), None, r"queries: expected shape \(n, 3\) or \(b, n, 3\), got \(5, 2\)"),
        ((3,), (8, 3), None, r"queries: expected shape"),
        ((5, 3), (8, 2), None, r"vertices: expected shape \(n, 3\) or \(b, n, 3\), got \(8, 2\)"),
        ((5, 3), (1, 1, 8, 3), None, r"vertices: expected shape"),
        ((2, 5, 3), (3, 8, 3), None, r"expected as many cages as sets of queries, got 3 and 2"),
        ((5, 3), (8, 3), np.zeros((4, 4), dtype=int), r"faces: expected shape \(f, 3\), got \(4, 4\)"),
        ((5, 3), (8, 3), np.zeros((0, 3), dtype=int), r"faces: expected shape \(f, 3\), got \(0, 3\)"),
        ((5, 3), (7, 3), None, r"faces: expected numbers from 0 to 6, got 0\.\.7"),
        ((5, 3), (8, 3), np.array([[0, 1, -1]]), r"faces: expected numbers from 0 to 7, got -1\.\.1"),
    ],
)
def test_invalid_arguments_are_named(queries, vertices, faces, says):
    faces = CAGES["box"][1] if faces is None else faces
    with pytest.raises(ValueError, match=says):
        mean_value_coordinates(torch.zeros(queries), torch.zeros(vertices), faces)


# -- in torch ----------------------------------------------------------------------------------------------------------


@cages
def test_torch_agrees_with_the_compiled_loops(name):
    V, F = CAGES[name]
    x = np.stack([off_planes(around(V, 400, seed), V, F)[:30] for seed in (0, 1)])
    moved = np.stack([V, V * (1.1, 0.9, 1.0)])
    theirs = mean_value_coordinates(torch.tensor(x), torch.tensor(moved), F)
    assert (coordinates_in_torch(torch.tensor(x), torch.tensor(moved), F) - theirs).abs().max() < 1e-11
    for ours, expected in zip(slopes(x, moved, F, coordinates_in_torch), slopes(x, moved, F), strict=True):
        assert np.abs(ours - expected).max() < 1e-8 * (1 + np.abs(expected).max())


@places
@cages
def test_torch_agrees_in_derivatives_on_faces_edges_and_vertices(name, place):
    V, F = CAGES[name]
    x, _ = PLACES[place](V, F)
    pairs = zip(slopes(x[None], V[None], F, coordinates_in_torch), slopes(x[None], V[None], F), strict=True)
    for ours, expected in pairs:
        assert np.isfinite(ours).all()
        assert np.abs(ours - expected).max() < 1e-10 * (1 + np.abs(expected).max())


def test_torch_computes_chunks_of_queries_and_of_the_batch(monkeypatch):
    V, F = CAGES["L"]
    x = around(V, 3 * 11).reshape(3, 11, 3)
    moved = V + 0.05 * generator(2).normal(size=(3, *V.shape))
    at_once = slopes(x, moved, F, coordinates_in_torch), coordinates_in_torch(leaf(x), leaf(moved), F).detach()
    size = 8 * (6 * 12 + 20 * 30 + 40 * 20)
    for most in (1, 4, 11, 23):  # queries
        monkeypatch.setattr(mean_value_torch, "CHUNK_BYTES", most * size)
        assert torch.allclose(coordinates_in_torch(leaf(x), leaf(moved), F), at_once[1], rtol=0, atol=1e-13)
        for ours, expected in zip(slopes(x, moved, F, coordinates_in_torch), at_once[0], strict=True):
            assert np.abs(ours - expected).max() < 1e-12 * (1 + np.abs(expected).max())
    only = torch.tensor(x, requires_grad=True)  # the cage requires no gradient
    coordinates_in_torch(only, torch.tensor(moved), F).square().sum().backward()
    assert only.grad.isfinite().all()


def test_no_chunk_is_larger_than_the_limit(monkeypatch):
    seen = []

    def double(x, y):
        seen.append(tuple(x.shape))
        return 2 * x + y[:, None]

    x, y = torch.rand(5, 7, 3), torch.rand(5, 3)
    for most in (1, 3, 7, 13, 14, 100):
        monkeypatch.setattr(mean_value_torch, "CHUNK_BYTES", most * 10)
        assert torch.equal(in_chunks(double, 10, x, y), 2 * x + y[:, None])
        assert max(b * p for b, p, _ in seen) <= most and sum(b * p for b, p, _ in seen) == 35
        seen.clear()
    assert in_chunks(double, 10, x[:, :0], y).shape == (5, 0, 3)


def test_a_chunk_saves_no_more_memory_than_estimated():
    """64 MB hold what autograd saves, and as much again during the backward pass."""
    for level in (0, 1, 2):
        V, F = arrays(trimesh.creation.icosphere(level))
        x, kept = leaf(around(V, 20)[None]), {}

        def keep(tensor, kept=kept):
            kept[tensor.untyped_storage().data_ptr()] = tensor
            return tensor

        with torch.autograd.graph.saved_tensors_hooks(keep, lambda tensor: tensor):
            w = coordinates_in_torch(x, leaf(V[None]), F)
        total = sum(tensor.untyped_storage().nbytes() for tensor in kept.values())
        edges = len(F) * 3 // 2
        assert total < 20 * 8 * (6 * len(V) + 20 * edges + 40 * len(F)), w.shape


def test_torch_in_float32_is_computed_in_float64():
    V, F = CAGES["box"]
    x = around(V, 20).astype(np.float32)
    w = in_torch(x, V.astype(np.float32), F)
    assert w.dtype == np.float32
    assert np.array_equal(w, in_torch(x.astype(np.float64), V, F).astype(np.float32))
