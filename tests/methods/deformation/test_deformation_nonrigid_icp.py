"""Non-rigid ICP and its shared parts: welded meshes, springs, samples, nearest points."""

from __future__ import annotations

import numpy as np
import pytest
from registration_shapes import bar, cloud_of, far_from, joined, moved, stool, turn, with_accidents
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import BadInput, PointCloud, Run
from bench.methods.deformation.nonrigid_icp import NonrigidIcp
from bench.methods.deformation.registration.nearest import Matching
from bench.methods.deformation.registration.pulled import Pulled
from bench.methods.deformation.registration.samples import Samples, points_of
from bench.methods.deformation.registration.solving import Factors
from bench.methods.deformation.registration.springs import parts_of, springs_between
from bench.methods.deformation.registration.welded import LEAST, Welded

# -- welded meshes and springs -----------------------------------------------------------------------------------------


def test_welding_keeps_one_vertex_per_position_in_use():
    source = with_accidents()
    welded = Welded(source, 0.1, 0.1)
    assert len(welded.vertices) == 162 + 1  # the vertices of the ball, and the tip of the sliver
    assert len(welded.faces) == len(source.faces) - 1  # without the degenerate face
    assert welded.parts.max() == 0 and len(welded.springs) == 0
    assert welded.areas.sum() == pytest.approx(source.area)
    assert welded.masses.sum() == pytest.approx(source.area)


def test_all_vertices_follow_the_welded_ones():
    source, A, shift = with_accidents(), turn(30) @ np.diag([1.2, 0.9, 1]), np.array([0.1, 0.2, 0.3])
    welded = Welded(source, 0.1, 0.1)
    np.testing.assert_array_equal(welded.mesh(source, welded.vertices).vertices, source.vertices)
    output = welded.mesh(source, welded.vertices @ A.T + shift)
    np.testing.assert_array_equal(output.faces, source.faces)
    np.testing.assert_allclose(output.vertices[:-2], source.vertices[:-2] @ A.T + shift, atol=1e-12)
    # The two unused vertices move with the nearest one.
    x, z = (source.vertices[np.argmin(np.linalg.norm(source.vertices[:-2] - v, axis=1))] for v in source.vertices[-2:])
    np.testing.assert_allclose(output.vertices[-2] - source.vertices[-2], A @ x + shift - x, atol=1e-12)
    np.testing.assert_allclose(output.vertices[-1] - source.vertices[-1], A @ z + shift - z, atol=1e-12)


def test_the_stiffness_is_the_dirichlet_energy_and_constants_are_free():
    ball = icosphere(subdivisions=2)  # all angles are acute, so no weight is negative
    welded = Welded(ball, 0.1, 0.1)
    A = np.random.default_rng(0).normal(size=(3, 3))
    values = welded.vertices @ A.T
    # For a linear map A, the energy of a face is its area times |A P|^2, P the projection to its plane.
    energy = 0.0
    for face in welded.faces:
        a, b, c = welded.vertices[face]
        n = np.cross(b - a, c - a)
        area, n = np.linalg.norm(n) / 2, n / np.linalg.norm(n)
        energy += area * ((A @ (np.eye(3) - np.outer(n, n))) ** 2).sum()
    assert np.einsum("ni,ni->", values, welded.stiffness @ values) == pytest.approx(energy, rel=1e-10)
    assert np.abs(welded.stiffness @ np.ones(len(values))).max() < 1e-12


def test_weights_of_obtuse_angles_and_slivers_are_small_and_positive():
    rng = np.random.default_rng(0)
    V = np.column_stack([rng.random((40, 2)), np.zeros(40)])
    from scipy.spatial import Delaunay

    flat = Trimesh(V * (10, 1, 1), Delaunay(V[:, :2]).simplices, process=False)  # most angles are obtuse
    assert Welded(flat, 0.1, 0.1).weights.min() == LEAST
    ball = Welded(with_accidents(), 0.1, 0.1)
    assert ball.weights.min() >= LEAST and ball.weights.max() < 2


def test_springs_join_only_nearby_parts():
    source = stool()
    parts = parts_of(source.edges, len(source.vertices))
    springs = springs_between(source.vertices, parts, 0.15)
    joined_parts = {tuple(sorted(pair)) for pair in parts[springs].tolist()}
    assert joined_parts == {(0, 1), (0, 2)}  # the legs are joined to the board, not to each other
    lengths = np.linalg.norm(source.vertices[springs[:, 0]] - source.vertices[springs[:, 1]], axis=1)
    assert lengths.max() <= 0.15
    assert len(np.unique(springs, axis=0)) == len(springs)


def test_springs_depend_little_on_the_resolution():
    coarse, fine = (
        joined(bar((0, 0, 0), (1, 1, 0.1), rounds), bar((0, 0, 0.1), (1, 1, 0.2), rounds)) for rounds in (4, 5)
    )
    counts = [len(Welded(mesh, 0.2, 0.1).springs) for mesh in (coarse, fine)]
    assert len(fine.vertices) > 3.9 * len(coarse.vertices) and counts[1] < 1.5 * counts[0]


def test_parts_far_from_all_others_are_tied_to_the_largest():
    source = joined(
        bar((0, 0, 0), (1, 1, 1), 2), bar((5, 0, 0), (5.2, 0.2, 0.2), 1), bar((-4, 0, 0), (-3, 0.1, 0.1), 1)
    )
    parts = parts_of(source.edges, len(source.vertices))
    springs = springs_between(source.vertices, parts, 0.1)
    assert {tuple(sorted(pair)) for pair in parts[springs].tolist()} == {(0, 1), (0, 2)}
    assert np.bincount(parts[springs].max(axis=1)).tolist() == [0, 8, 8]
    near = source.vertices[springs[parts[springs].max(axis=1) == 1].max(axis=1)]
    assert near[:, 0].mean() < 5.1  # the side facing the largest part
    welded = Welded(source, 0.1, 0.1)
    assert connected_components(welded.stiffness)[0] == 1


def test_a_mesh_of_many_small_parts_is_connected():
    rng = np.random.default_rng(0)
    crumbs = [bar(corner, corner + 0.02, 0) for corner in rng.random((200, 3))]
    welded = Welded(joined(*crumbs), 0.05, 0.1)
    assert welded.parts.max() == 199 and connected_components(welded.stiffness)[0] == 1


# -- samples and nearest points ----------------------------------------------------------------------------------------


def test_samples_lie_evenly_on_their_faces_and_move_with_them():
    source = stool()
    V, F = np.array(source.vertices), np.array(source.faces)
    samples = Samples(V, F, 4000, np.random.default_rng(0))
    points = samples.matrix @ V
    corners = V[F[samples.faces]]
    np.testing.assert_allclose(np.einsum("si,si->s", samples.normals(V), points - corners[:, 0]), 0, atol=1e-12)
    for i in range(3):  # inside the triangle
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        assert (np.einsum("si,si->s", np.cross(b - a, points - a), samples.normals(V)) >= -1e-12).all()
    # The number of samples per part differs from its area share by at most one; random ones would differ by tens.
    shares = np.bincount(parts_of(source.edges, len(V))[F[samples.faces, 0]]) / 4000
    areas = np.bincount(parts_of(source.edges, len(V))[F[:, 0]], source.area_faces) / source.area
    np.testing.assert_allclose(shares, areas, atol=1.01 / 4000)
    A = turn(50)
    np.testing.assert_allclose(samples.matrix @ (V @ A.T + 1), points @ A.T + 1, atol=1e-12)
    np.testing.assert_allclose(samples.normals(V @ A.T), samples.normals(V) @ A.T, atol=1e-10)


def test_no_sample_lies_on_a_face_of_zero_area():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    samples = Samples(V, np.array([[0, 1, 3], [0, 1, 2], [1, 3, 0]]), 50, np.random.default_rng(0))
    assert (samples.faces == 1).all()


def test_the_points_of_a_target():
    rng, ball = np.random.default_rng(0), icosphere(subdivisions=1)
    cloud = cloud_of(ball, 100)
    assert points_of(cloud, 100, rng) is cloud
    some = points_of(cloud, 30, rng)
    rows = cKDTree(cloud.points).query(some.points)
    assert rows[0].max() == 0 and len(np.unique(rows[1])) == 30
    np.testing.assert_array_equal(some.normals, cloud.normals[rows[1]])
    assert len(points_of(ball, 70, rng)) == 70 and points_of(ball, 70, rng).normals is not None
    with pytest.raises(BadInput, match="target: has 0 points"):
        points_of(PointCloud(np.empty((0, 3))), 10, rng)
    with pytest.raises(BadInput, match="source: has 3 vertices but no faces"):
        Welded(Trimesh(np.eye(3), process=False), 0.1, 0.1)


@pytest.mark.parametrize(("scale", "sliding", "with_normals"), [(0.3, 0.7, True), (0.0, 0.7, True), (0.3, 0.7, False)])
def test_goals_match_a_plain_loop(scale, sliding, with_normals):
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(30, 3)), rng.normal(size=(50, 3))
    n, m = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (rng.normal(size=p.shape), rng.normal(size=q.shape)))
    target = PointCloud(q, m if with_normals else None)
    goals, weights = Matching(scale, 1.5, sliding).goals(p, n, target)
    apart = ((p[:, None] - q) ** 2).sum(-1)
    if with_normals:
        apart = apart + scale**2 * ((n[:, None] - m) ** 2).sum(-1)
    pairs = [[(i, apart[i].argmin()) for i in range(30)], [(apart[:, j].argmin(), j) for j in range(50)]]
    expected, sums = np.zeros((30, 3)), np.zeros(30)
    for members, weight in zip(pairs, (1 / 30, 1 / 50), strict=True):
        median = np.median([np.linalg.norm(p[i] - q[j]) for i, j in members])
        for i, j in members:
            if np.linalg.norm(p[i] - q[j]) > 1.5 * median or (with_normals and scale and n[i] @ m[j] <= 0):
                continue
            goal = q[j]
            if with_normals:
                on_plane = p[i] + m[j] * (m[j] @ (q[j] - p[i]))
                goal = sliding * on_plane + (1 - sliding) * q[j]
            expected[i] += weight * goal
            sums[i] += weight
    np.testing.assert_allclose(weights, sums, atol=1e-14)
    kept = sums > 0
    assert kept.sum() > 0
    np.testing.assert_allclose(goals[kept], expected[kept] / sums[kept, None], atol=1e-12)
    np.testing.assert_array_equal(goals[~kept], p[~kept])


def test_an_inside_out_mesh_is_detected():
    source = stool()
    cloud = cloud_of(moved(source, np.diag([1.1, 0.9, 1])))
    for faces, sign in ((source.faces, 1), (source.faces[:, ::-1], -1)):
        samples = Samples(source.vertices, np.array(faces), 1000, np.random.default_rng(0))
        points, normals = samples.matrix @ source.vertices, samples.normals(source.vertices)
        assert Matching(0.1, 4, 0.5).sign(points, normals, cloud) == sign
        assert Matching(0.1, 4, 0.5).sign(points, normals, PointCloud(cloud.points)) == 1


def test_a_round_pulls_to_the_goals_and_keeps_the_shape():
    source = stool()
    welded = Welded(source, 0.1, 0.1)
    samples = Samples(welded.vertices, welded.faces, 500, np.random.default_rng(0))
    shift, matching = np.array([1, -2, 1]) * 1e-5, Matching(0.1, 4, 0.0)
    pulled = Pulled(welded, samples, PointCloud(samples.matrix @ welded.vertices + shift), matching)
    matrix, right = pulled.round(welded.vertices)
    found = Factors(matrix + 10.0 * welded.stiffness).solve(right + 10.0 * (welded.stiffness @ welded.vertices))
    np.testing.assert_allclose(found - welded.vertices, np.broadcast_to(shift, found.shape), atol=1e-9)
    np.testing.assert_allclose(Factors(matrix).solve(matrix @ found), found, atol=1e-5)


# -- the method --------------------------------------------------------------------------------------------------------

QUICK = {"samples": 2000, "rounds": 12}


@pytest.mark.parametrize("kind", ["cloud", "bare", "mesh"])
def test_an_affine_motion_is_reached(kind):
    source = icosphere(subdivisions=3)
    wanted = moved(source, turn(10) @ np.diag([1.15, 0.8, 1.0]), (0.05, 0, 0.1))
    target = wanted if kind == "mesh" else cloud_of(wanted, 3000, kind == "cloud")
    output = NonrigidIcp(**QUICK, smooth_end=0.05, smooth_last=0).deform(source, target, Run(seed=0))
    np.testing.assert_array_equal(output.faces, source.faces)
    before, after = far_from(source, wanted), far_from(output, wanted)
    assert before > 0.08 and after < 0.006


def test_parts_move_together_and_duplicates_stay_together():
    source = stool()
    wanted = moved(source, np.diag([1.2, 1.0, 0.9]), (0.0, 0.05, 0.0))
    output = NonrigidIcp(**QUICK).deform(source, cloud_of(wanted, 3000), Run(seed=0))
    assert far_from(output, wanted) < 0.2 * far_from(source, wanted)
    torn = with_accidents()
    mended = NonrigidIcp(**QUICK).deform(torn, cloud_of(moved(icosphere(2), np.diag([1.2, 1, 0.8]))), Run(seed=0))
    np.testing.assert_array_equal(mended.vertices[:162][np.unique(torn.faces[torn.faces < 162])],
                                  mended.vertices[162:324][np.unique(torn.faces[torn.faces < 162])])  # fmt: skip


def test_a_part_without_a_counterpart_moves_along():
    source = joined(bar((-0.5, -0.5, 0), (0.5, 0.5, 0.2), 4), bar((-0.1, -0.1, 0.2), (0.1, 0.1, 0.7), 2))
    board = joined(bar((-0.5, -0.5, 0.15), (0.5, 0.5, 0.35), 4))
    output = NonrigidIcp(**QUICK).deform(source, cloud_of(board), Run(seed=0))
    shift = output.vertices - source.vertices
    post = np.arange(len(source.vertices)) >= len(bar((0, 0, 0), (1, 1, 1), 4)[0])
    assert np.abs(shift[~post, 2].mean() - 0.15) < 0.02
    assert shift[post, 2].mean() > 0.09 and np.ptp(output.vertices[post, 2]) > 0.35  # neither left behind nor collapsed


def test_very_smooth_offsets_are_a_translation():
    source = icosphere(subdivisions=2)
    output = NonrigidIcp(rounds=2, samples=1000, smooth=1e3, smooth_end=1e3, smooth_last=0).deform(
        source, cloud_of(moved(source, np.diag([1.2, 1, 1]), (0.1, 0, 0))), Run(seed=0)
    )
    shift = output.vertices - source.vertices
    assert np.ptp(shift, axis=0).max() < 1e-4 and 0.03 < shift[:, 0].mean() < 0.12


def test_an_inside_out_source_gives_the_same_surface():
    source = stool()
    cloud = cloud_of(moved(source, np.diag([1.15, 1.0, 0.9])))
    turned = Trimesh(source.vertices, source.faces[:, ::-1], process=False)
    output = NonrigidIcp(**QUICK).deform(turned, cloud, Run(seed=0))
    assert far_from(output, moved(source, np.diag([1.15, 1.0, 0.9]))) < 0.02


def test_runs_are_repeatable_and_stop_at_the_time_limit():
    source, cloud = icosphere(subdivisions=2), cloud_of(moved(icosphere(2), np.diag([1.2, 1, 0.9])), 500)
    method = NonrigidIcp(rounds=3, samples=300)
    first, again, other = (method.deform(source, cloud, Run(seed=seed)).vertices for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0
    run = Run(seconds=0)
    np.testing.assert_allclose(method.deform(source, cloud, run).vertices, source.vertices, atol=1e-12)
    assert run.notes == ["the time limit ended the rounds after 0 of 3"]
    seen = []
    method.deform(source, cloud, Run(on_progress=lambda done, total: seen.append((done, total))))
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize(
    ("name", "value"),
    [("rounds", 0), ("smooth", 0), ("smooth_end", -1), ("smooth_last", -1), ("samples", 1), ("reach", 0), ("joint", 0),
     ("normal_scale", -1), ("trim", 0.5), ("sliding", 2), ("smooth", float("nan"))],
)  # fmt: skip
def test_parameters_are_checked(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        NonrigidIcp(**{name: value})
