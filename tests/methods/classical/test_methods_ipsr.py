"""Reconstruction without normals: estimated normals are outward, even where a spanning tree fails."""

import functools

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.normals import estimate_normals
from bench.geometry.poisson_disk import eliminate
from bench.methods.classical.ipsr import Ipsr, settled, told_normals
from bench.methods.classical.unoriented import enclosed_volume
from bench.methods.classical.visibility import facing

BOX = trimesh.creation.box((1.0, 0.8, 0.6))


def comb():
    """Blades on a bar: walls of 0.1, or two to three spacings, with gaps of 0.35."""
    bar = trimesh.creation.box((2.0, 0.2, 0.6))
    blades = [
        trimesh.creation.box((0.1, 0.9, 0.6), trimesh.transformations.translation_matrix((x, 0.54, 0)))
        for x in np.linspace(-0.9, 0.9, 5)
    ]
    return trimesh.boolean.union([bar, *blades], engine="manifold")


def hollow():
    """A ball of radius 1 with a cavity of radius 0.5."""
    outer, inner = trimesh.creation.icosphere(4), trimesh.creation.icosphere(4, radius=0.5)
    inner.invert()
    return trimesh.util.concatenate([outer, inner])


SHAPES = {
    "box": lambda: BOX,
    "torus": lambda: trimesh.creation.torus(0.7, 0.25, 64, 32),
    "comb": comb,
    "hollow": hollow,
    "two balls": lambda: trimesh.util.concatenate(
        [trimesh.creation.icosphere(4), trimesh.creation.icosphere(3, radius=0.4).apply_translation((1.46, 0, 0))]
    ),
}


@functools.cache
def cloud_of(shape, sigma, count=2500):
    """Noisy points, and the outward normals of the shape at their exact positions."""
    mesh = SHAPES[shape]()
    rng = np.random.default_rng(3)
    points, normals = eliminate(*MeshSurface(mesh).sample(5 * count, rng), mesh, count)
    return mesh, points + sigma * rng.standard_normal(points.shape), normals


def reconstructed(points, **parameters):
    """The mesh, the estimated normals in the order of the points, and the number of rounds."""
    kept, rounds = {}, []
    run = Run(on_keep=kept.__setitem__, on_progress=lambda done, total: rounds.append(done))
    mesh = Ipsr(**{"depth": 6, **parameters}).reconstruct(PointCloud(points), run)
    oriented = kept["oriented"]
    return mesh, oriented.normals[cKDTree(oriented.points).query(points)[1]], rounds[-1]


def wrong_share(normals, truth):
    return (np.einsum("ni,ni->n", normals, truth) < 0).mean()


@pytest.mark.parametrize(
    "shape, sigma", [("torus", 0.0), *((shape, 0.005) for shape in ("comb", "hollow", "two balls"))]
)
def test_normals_are_outward_and_the_surface_is_near(shape, sigma):
    truth, points, normals = cloud_of(shape, sigma)
    mesh, found, rounds = reconstructed(points)
    assert rounds <= 12
    assert wrong_share(found, normals) < 0.01
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    samples = MeshSurface(mesh).sample(1500, np.random.default_rng(0))[0]
    # Cells of depth 6 are 1/29 of the radius wide; edges are rounded by a fraction of a cell.
    assert np.linalg.norm(MeshSurface(truth).closest(samples)[0] - samples, axis=1).mean() < 0.01
    assert mesh.volume == pytest.approx(truth.volume, rel=0.05)


def test_random_initial_normals_converge_and_depend_on_the_seed_alone():
    _, points, normals = cloud_of("torus", 0.0, 1500)
    _, found, _ = reconstructed(points, start="random", rounds=25, depth=5)
    assert wrong_share(found, normals) < 0.01
    short, again = (reconstructed(points, start="random", rounds=2, depth=5)[1] for _ in range(2))
    assert np.array_equal(short, again) and not np.array_equal(short, found)


def test_given_normals_are_ignored():
    _, points, normals = cloud_of("box", 0.0, 1000)
    without, wrong = (Ipsr(depth=5, rounds=2).reconstruct(PointCloud(points, n), Run()) for n in (None, -normals))
    assert np.array_equal(without.vertices, wrong.vertices) and np.array_equal(without.faces, wrong.faces)


def test_an_open_surface_has_normals_on_one_side():
    points = np.random.default_rng(0).standard_normal((1200, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 2] > 0.2]
    _, found, _ = reconstructed(points, depth=5)
    assert wrong_share(found, points) < 0.01


def test_it_stops_before_the_time_limit_and_reports_it():
    _, points, _ = cloud_of("box", 0.005, 1000)
    run = Run(seconds=1e-3)
    mesh = Ipsr(depth=5).reconstruct(PointCloud(points), run)
    assert len(mesh.faces) and "stopped after 1 of 12 rounds" in run.notes[0]


def test_a_point_gets_the_area_weighted_normals_of_nearby_faces():
    rng = np.random.default_rng(1)
    points, fallback = rng.standard_normal((40, 3)), np.tile([0.0, 0, 1], (40, 1))
    vertices, faces = rng.standard_normal((30, 3)), rng.permuted(np.tile(np.arange(30), (50, 1)), axis=1)[:, :3]
    told = told_normals(vertices, faces, cKDTree(points), 3, fallback)
    sums = np.zeros((40, 3))
    for a, b, c in vertices[faces]:
        for point in np.argsort(np.linalg.norm(points - (a + b + c) / 3, axis=1))[:3]:
            sums[point] += np.cross(b - a, c - a) / 2
    expected = [s / np.linalg.norm(s) if s.any() else f for s, f in zip(sums, fallback, strict=True)]
    assert np.allclose(told, expected)


def test_the_volume_of_a_mesh_does_not_depend_on_its_position():
    moved = BOX.copy().apply_translation((50, -20, 3))
    assert enclosed_volume(moved.vertices, moved.faces) == pytest.approx(BOX.volume)
    assert enclosed_volume(moved.vertices, moved.faces[:, ::-1]) == pytest.approx(-BOX.volume)


def test_normals_have_converged_when_hardly_any_changes():
    normals = np.tile([0.0, 0, 1], (5000, 1))
    turned = normals.copy()
    turned[:3] = [1, 0, 0]  # three of the five that changed most
    assert settled(normals, normals) and not settled(normals, turned)


@pytest.mark.parametrize("shape", SHAPES)
def test_visible_points_face_outward(shape):
    _, points, truth = cloud_of(shape, 0.005)
    normals = estimate_normals(points, 16)[0]
    signs = facing(points, normals)
    seen = signs != 0
    # Between blades, and where two balls nearly touch, less is visible.
    assert seen.mean() > 0.8
    assert wrong_share(signs[seen, None] * normals[seen], truth[seen]) < 0.03


def test_a_plane_encloses_nothing():
    points = np.random.default_rng(0).uniform(-1, 1, (1500, 3)) * [1, 1, 0]
    assert facing(points, np.tile([0.0, 0, 1], (1500, 1))) is None


@pytest.mark.parametrize(
    "wrong", [{"depth": 4}, {"rounds": 0}, {"k": 0}, {"scale": 0.5}, {"point_weight": -1.0}, {"samples_per_node": 0.0}]
)
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        Ipsr(**wrong)
