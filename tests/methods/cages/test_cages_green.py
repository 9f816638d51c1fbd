"""Green coordinates: identities, quadrature of the defining integrals, and deformations by them."""

import numpy as np
import pytest
import torch
import trimesh

from bench import generator
from bench.geometry.closest import TriangleTree
from bench.methods.cages.coordinates import mean_value_torch
from bench.methods.cages.coordinates.green import deformed_by_green, green_coordinates
from bench.methods.cages.coordinates.mean_value import mean_value_coordinates


def corner_room():
    """An L of height 1, not convex, with several faces in one plane."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    V = np.vstack([np.column_stack([outline, np.full(6, z)]) for z in (0.0, 1.0)])
    lid = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    i, j = np.arange(6), np.roll(np.arange(6), -1)
    walls = np.vstack([np.column_stack([i, j, j + 6]), np.column_stack([i, j + 6, i + 6])])
    return V, np.vstack([lid[:, ::-1], lid + 6, walls])


def bumpy_ball():
    ball = trimesh.creation.icosphere(1)
    return ball.vertices * generator(0).uniform(0.8, 1.2, (42, 1)), np.array(ball.faces)


def ring():
    mesh = trimesh.creation.torus(1.0, 0.4, major_sections=7, minor_sections=5)
    return np.array(mesh.vertices), np.array(mesh.faces)


CAGES = {"L": corner_room(), "ball": bumpy_ball(), "ring": ring()}
PYRAMID = np.eye(4, 3)[[3, 0, 1, 2]], np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
cages = pytest.mark.parametrize("name", CAGES)


def normals_of(V, F):
    n = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def points(V, F, count, is_inside, seed=0):
    """Random points on one side, not too close to the cage."""
    x = generator(seed, "points").uniform(V.min(axis=0) - 1, V.max(axis=0) + 1, (100 * count, 3))
    a, b, c = (V[F[:, k]] - x[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(u, axis=-1) for u in (a, b, c))
    rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    x = x[(np.arctan2((a * np.cross(b, c)).sum(-1), rest).sum(axis=1) > np.pi) == is_inside]
    far = TriangleTree(V, F).closest(x[: 5 * count]).distance > 0.05
    x = x[: 5 * count][far][:count]
    assert len(x) == count
    return x


def on_faces(V, F):
    """A point on each face."""
    inner = 0.8 * generator(0, "faces").dirichlet((1, 1, 1), len(F)) + 0.2 / 3
    return np.einsum("fk,fki->fi", inner, V[F])


def on_edges(V, F):
    t = generator(0, "edges").uniform(0.1, 0.9, (len(F), 1))
    return t * V[F[:, 0]] + (1 - t) * V[F[:, 1]]


PLACES = {"faces": on_faces, "edges": on_edges, "vertices": lambda V, F: V.copy()}
places = pytest.mark.parametrize("place", PLACES)


def leaf(array):
    return torch.tensor(np.array(array), dtype=torch.float64, requires_grad=True)


def green(x, V, F):
    return [t.numpy() for t in green_coordinates(torch.as_tensor(x), torch.as_tensor(V), F)]


def moved(x, V, F, new):
    return deformed_by_green(torch.as_tensor(x), torch.as_tensor(V), F, torch.as_tensor(new)).numpy()


TURN = trimesh.transformations.rotation_matrix(1.1, [1, 2, 3])[:3, :3]


# -- identities --------------------------------------------------------------------------------------------------------


@cages
def test_inside_coordinates_sum_to_1_and_reproduce_the_query(name):
    V, F = CAGES[name]
    x = points(V, F, 40, True)
    phi, psi = green(x, V, F)
    assert phi.shape == (40, len(V)) and psi.shape == (40, len(F)) and psi.min() > 0
    assert np.abs(phi.sum(axis=1) - 1).max() < 1e-13
    assert np.abs(phi @ V + psi @ normals_of(V, F) - x).max() < 1e-13


@cages
def test_outside_coordinates_sum_to_0_and_reproduce_the_origin(name):
    V, F = CAGES[name]
    phi, psi = green(points(V, F, 40, False), V, F)
    assert np.abs(phi.sum(axis=1)).max() < 1e-13 and psi.min() > 0
    assert np.abs(phi @ V + psi @ normals_of(V, F)).max() < 1e-12


@places
@cages
def test_on_the_cage_coordinates_are_the_limits_from_inside(name, place):
    V, F = CAGES[name]
    x = PLACES[place](V, F)
    phi, psi = green(x, V, F)
    assert np.abs(phi.sum(axis=1) - 1).max() < 1e-13
    assert np.abs(phi @ V + psi @ normals_of(V, F) - x).max() < 1e-13
    around = {"faces": F, "edges": F[:, :2], "vertices": np.arange(len(V))[:, None]}[place]
    touched = np.array(  # which faces each of the points lies on
        [np.isin(F, corners).sum(axis=1) == len(corners) for corners in around]
    )
    inward = -(touched @ normals_of(V, F))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    for offset in (1e-4, 1e-7, 1e-10):
        near = green(x + offset * inward, V, F)
        inside = np.abs(near[0].sum(axis=1) - 1) < 0.1
        assert inside.mean() > 0.9
        for ours, theirs in zip((phi, psi), near, strict=True):
            # At edges the slope grows logarithmically.
            assert np.abs(ours - theirs)[inside].max() < 10 * offset * (1 - np.log(offset)), offset


@cages
def test_coordinates_are_accurate_close_to_the_cage(name):
    V, F = CAGES[name]
    x, normals = on_faces(V, F), normals_of(V, F)
    for offset in 10.0 ** -np.arange(3, 15):
        phi, psi = green(x - offset * normals, V, F)
        assert np.abs(phi.sum(axis=1) - 1).max() < 1e-12
        assert np.abs(phi @ V + psi @ normals - (x - offset * normals)).max() < 1e-12


def test_a_similarity_of_query_and_cage_only_scales_psi():
    V, F = CAGES["L"]
    x = points(V, F, 20, True)
    phi, psi = green(x, V, F)
    for scale in (1e-3, 0.4, 1e3):
        other = green(*(scale * a @ TURN.T + scale * np.array([1, -2, 3]) for a in (x, V)), F)
        assert np.abs(other[0] - phi).max() < 1e-12
        assert np.abs(other[1] / scale - psi).max() < 1e-12


@cages
def test_coordinates_are_harmonic_inside(name):
    V, F = CAGES[name]
    x, h = points(V, F, 10, True), 1e-3
    star = x[:, None] + h * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    for found in green(star.reshape(-1, 3), V, F):
        found = found.reshape(10, 7, -1)
        curved = np.abs(found[:, 1:] - found[:, :1]).max()
        assert np.abs(found[:, 1:].sum(axis=1) - 6 * found[:, 0]).max() < 1e-3 * curved


# -- the integrals -----------------------------------------------------------------------------------------------------


def quadrature(x, V, F, rounds=5):
    """The defining integrals, by the midpoints of 4^k triangles of each face, extrapolated."""
    found = []
    for k in (rounds - 1, rounds):
        phi, psi = np.zeros((len(x), len(V))), np.zeros((len(x), len(F)))
        for f, face in enumerate(F):
            inner = np.eye(3)[None]
            for _ in range(k):
                a, b, c = inner[:, 0], inner[:, 1], inner[:, 2]
                ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
                inner = np.concatenate(
                    [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
                )
            hat = inner.mean(axis=1)
            y = hat @ V[face]
            normal = np.cross(V[face[1]] - V[face[0]], V[face[2]] - V[face[0]])
            part = np.linalg.norm(normal) / 2 / len(y)
            r = y - x[:, None]
            d = np.linalg.norm(r, axis=-1)
            psi[:, f] = part * (1 / d).sum(axis=1) / (4 * np.pi)
            slope = part * (r @ (normal / np.linalg.norm(normal))) / d**3 / (4 * np.pi)
            phi[:, face] += slope @ hat
        found.append((phi, psi))
    return [(4 * fine - coarse) / 3 for coarse, fine in zip(*found, strict=True)]  # the error falls quadratically


@pytest.mark.parametrize("is_inside", [True, False])
@pytest.mark.parametrize("name", ["L", "ball"])
def test_coordinates_are_the_integrals_over_the_faces(name, is_inside):
    V, F = CAGES[name]
    x = points(V, F, 5, is_inside)
    for ours, theirs in zip(green(x, V, F), quadrature(x, V, F), strict=True):
        assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()


def test_closed_forms_over_the_middle_of_a_square():
    """A box seen from its centre: a sixth of the full solid angle per side, and the potential of a square."""
    mesh = trimesh.creation.box((2, 2, 2))
    V, F = np.array(mesh.vertices), np.array(mesh.faces)
    phi, psi = green(np.zeros((1, 3)), V, F)
    of_square = 8 * np.arcsinh(np.sqrt(0.5)) - 2 * np.pi / 3  # of side 2, from a height of 1 above its centre
    of_side = np.abs(normals_of(V, F) - (0, 0, 1)).max(axis=1) < 1e-12
    assert psi[0, of_side].sum() == pytest.approx(of_square / (4 * np.pi), abs=1e-14)
    assert phi[0].sum() == pytest.approx(1, abs=1e-14)
    assert np.abs(phi @ V).max() + np.abs(psi @ normals_of(V, F)).max() < 1e-14


# -- derivatives -------------------------------------------------------------------------------------------------------


def slopes(x, V, F):
    x, v = leaf(x), leaf(V)
    both = torch.cat(green_coordinates(x, v, F), dim=-1)
    (both * torch.from_numpy(generator(0, "slopes").normal(size=both.shape))).sum().backward()
    return x.grad.numpy(), v.grad.numpy()


def test_derivatives_by_queries_and_cages_match_finite_differences():
    V, F = PYRAMID
    x = np.array([[[0.2, 0.3, 0.2]], [[0.1, 0.1, 0.6]]])
    new = V + 0.05 * generator(2).normal(size=(2, *V.shape))
    assert torch.autograd.gradcheck(lambda q, v: green_coordinates(q, v, F), (leaf(x), leaf(new)), fast_mode=True)
    assert torch.autograd.gradcheck(
        lambda q, v, w: deformed_by_green(q, v, F, w), (leaf(x[0]), leaf(V), leaf(new[0])), fast_mode=True
    )


@cages
def test_derivatives_on_faces_are_those_just_inside(name):
    V, F = CAGES[name]
    x = on_faces(V, F)
    on, near = slopes(x, V, F)[0], slopes(x - 1e-8 * normals_of(V, F), V, F)[0]
    assert np.abs(on - near).max() < 1e-4 * np.abs(near).max()


@places
@cages
def test_derivatives_are_finite_on_the_cage(name, place):
    V, F = CAGES[name]
    for by in slopes(PLACES[place](V, F), V, F):
        assert np.isfinite(by).all()


# -- deformation -------------------------------------------------------------------------------------------------------


@cages
def test_a_similarity_of_the_cage_is_reproduced(name):
    V, F = CAGES[name]
    x = np.vstack([points(V, F, 20, True), *(place(V, F) for place in PLACES.values())])
    assert np.abs(moved(x, V, F, V) - x).max() < 1e-13
    for scale in (0.3, 1.0, 2.5):
        new, expected = (scale * a @ TURN.T + np.array([1, -2, 3]) for a in (V, x))
        assert np.abs(moved(x, V, F, new) - expected).max() < 1e-12


def anisotropy(function, x, h=1e-5):
    """The largest over the smallest stretch of a map at each of some points."""
    J = np.stack([(function(x + h * d) - function(x - h * d)) / (2 * h) for d in np.eye(3)], axis=-1)
    stretch = np.linalg.svd(J, compute_uv=False)
    return stretch[:, 0] / stretch[:, 2]


@pytest.mark.parametrize("bend", ["stretch", "twist"])
def test_details_are_sheared_less_than_by_mean_value_coordinates(bend):
    box = trimesh.creation.box((1, 1, 3)).subdivide()
    V, F = np.array(box.vertices), np.array(box.faces)
    x = generator(0).uniform((-0.3, -0.3, -1.2), (0.3, 0.3, 1.2), (50, 3))
    if bend == "stretch":
        new = V * (1, 1, 3)
    else:
        c, s = np.cos(V[:, 2]), np.sin(V[:, 2])
        new = np.column_stack([c * V[:, 0] - s * V[:, 1], s * V[:, 0] + c * V[:, 1], V[:, 2]])
    by_green = anisotropy(lambda x: moved(x, V, F, new), x)
    v, w = torch.tensor(V), torch.tensor(new)
    by_mean_values = anisotropy(lambda x: (mean_value_coordinates(torch.tensor(x), v, F) @ w).numpy(), x)
    assert by_green.max() < by_mean_values.max() and by_green.mean() < by_mean_values.mean()
    if bend == "stretch":
        assert np.abs(by_mean_values - 3).max() < 1e-6  # linear precision


def test_the_stretch_of_a_face_is_the_rms_of_its_two_singular_values():
    V, F = PYRAMID
    x, new = np.array([[0.2, 0.2, 0.3]]), V * (2, 1, 1)
    phi, psi = green(x, V, F)
    stretches = []
    for face in F:
        u, v = V[face[1:]] - V[face[0]]
        plane = np.linalg.qr(np.column_stack([u, v]))[0]
        pair = np.linalg.svd((plane * np.array([[2], [1], [1]])), compute_uv=False)
        stretches.append(np.sqrt((pair**2).mean()))
    assert stretches[0] == pytest.approx(np.sqrt(2.5))
    expected = phi @ new + (psi * stretches) @ normals_of(new, F)
    assert np.abs(moved(x, V, F, new) - expected).max() < 1e-13


def test_faces_of_zero_area_are_accepted():
    V, F = CAGES["ball"]
    x = points(V, F, 5, True)
    i, j, k = F[0]
    middle = (V[i] + V[j]) / 2  # a new vertex on an edge that the other face does not split, and a sliver between
    sliver = np.vstack([F[1:], [[i, 42, k], [42, j, k], [i, j, 42]]])
    phi, psi = green(x, np.vstack([V, middle]), sliver)
    assert np.abs(phi.sum(axis=1) - 1).max() < 1e-12 and np.abs(psi[:, -1]).max() < 1e-12
    for by in slopes(x, np.vstack([V, middle]), sliver):
        assert np.isfinite(by).all()
    new = leaf(np.zeros_like(V))
    out = deformed_by_green(leaf(x), leaf(V), F, new)
    out.sum().backward()
    assert not out.detach().any() and new.grad.isfinite().all()


# -- how it is called --------------------------------------------------------------------------------------------------


def test_elements_of_a_batch_are_independent():
    V, F = CAGES["L"]
    x = points(V, F, 8, True).reshape(2, 4, 3)
    two = V + 0.05 * generator(2).normal(size=(2, *V.shape))
    for q, v in ((x, two), (x[0], two), (x, V)):
        found = green(q, v, F)
        for b in range(2):
            alone = green(q if q.ndim == 2 else q[b], v if v.ndim == 2 else v[b], F)
            assert all(np.abs(ours[b] - theirs).max() < 1e-15 for ours, theirs in zip(found, alone, strict=True))
    assert moved(x, V, F, V).shape == moved(x[0], V, F, two).shape == (2, 4, 3)
    assert [t.shape for t in green(x[:, :0], V, torch.from_numpy(F))] == [(2, 0, 12), (2, 0, 20)]


def test_chunks_of_queries_and_of_the_batch_change_nothing(monkeypatch):
    V, F = CAGES["L"]
    x = points(V, F, 3 * 7, True).reshape(3, 7, 3)
    at_once = green(x, V, F), slopes(x, V, F)
    for most in (1, 3, 15):  # queries
        monkeypatch.setattr(mean_value_torch, "CHUNK_BYTES", most * 8 * (12 * 12 + 110 * 20))
        for ours, theirs in zip((*green(x, V, F), *slopes(x, V, F)), (*at_once[0], *at_once[1]), strict=True):
            assert np.abs(ours - theirs).max() < 1e-13 * (1 + np.abs(theirs).max())


def test_float32_is_computed_in_float64():
    V, F = CAGES["L"]
    x, V = points(V, F, 5, True).astype(np.float32), V.astype(np.float32)
    double = x.astype(np.float64), V.astype(np.float64)
    for ours, theirs in zip(green(x, V, F), green(*double, F), strict=True):
        assert ours.dtype == np.float32 and np.array_equal(ours, theirs.astype(np.float32))
    ours, theirs = moved(x, V, F, 2 * V), moved(*double, F, 2 * double[1])
    assert ours.dtype == np.float32 and np.array_equal(ours, theirs.astype(np.float32))


@pytest.mark.parametrize(
    ("queries", "vertices", "faces", "says"),
    [
        ((5, 2), (12, 3), None, r"queries: expected shape \(n, 3\) or \(b, n, 3\), got \(5, 2\)"),
        ((5, 3), (12, 2), None, r"vertices: expected shape \(n, 3\) or \(b, n, 3\), got \(12, 2\)"),
        ((2, 5, 3), (3, 12, 3), None, r"expected as many cages as sets of queries, got 3 and 2"),
        ((5, 3), (12, 3), np.zeros((4, 4), dtype=int), r"faces: expected shape \(f, 3\), got \(4, 4\)"),
        ((5, 3), (7, 3), None, r"faces: expected numbers from 0 to 6, got 0\.\.11"),
        ((5, 3), (12, 3), np.array([[0, 1, -1]]), r"faces: expected numbers from 0 to 11, got -1\.\.1"),
        ((5, 3), (12, 3), None, r"faces: expected to be counter-clockwise as seen from outside, got .* volume 0"),
    ],
)
def test_invalid_arguments_are_named(queries, vertices, faces, says):
    faces = CAGES["L"][1] if faces is None else faces
    with pytest.raises(ValueError, match=says):
        green_coordinates(torch.zeros(queries), torch.zeros(vertices), faces)


def test_inward_faces_and_another_number_of_new_vertices_are_refused():
    V, F = CAGES["L"]
    with pytest.raises(ValueError, match="counter-clockwise as seen from outside, got a cage of volume -3"):
        green(V, V, F[:, ::-1])
    with pytest.raises(ValueError, match=r"new_vertices: expected shape \(12, 3\), or several, got \(11, 3\)"):
        moved(V, V, F, V[1:])
