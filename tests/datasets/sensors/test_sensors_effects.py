"""Effects: each degrades a cloud by the declared amount, against closed forms, and changes nothing else."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.special import erfc

from bench import BadInput, PointCloud, Shape, generator
from bench.datasets.bumps import Bumps
from bench.datasets.common.rotations import random_rotation
from bench.datasets.sensors.density_gradient import DensityGradient
from bench.datasets.sensors.gaussian import Gaussian
from bench.datasets.sensors.half_space import HalfSpace
from bench.datasets.sensors.holes import Holes
from bench.datasets.sensors.laplace import Laplace
from bench.datasets.sensors.normal_noise import NormalNoise
from bench.datasets.sensors.normals_flip import NormalsFlip
from bench.datasets.sensors.normals_noise import NormalsNoise
from bench.datasets.sensors.normals_none import NormalsNone
from bench.datasets.sensors.normals_pca import NormalsPca
from bench.datasets.sensors.outliers_box import OutliersBox
from bench.datasets.sensors.outliers_clustered import OutliersClustered
from bench.datasets.sensors.outliers_ray import OutliersRay
from bench.datasets.sensors.poisson_disk import PoissonDisk
from bench.datasets.sensors.random_dropout import RandomDropout
from bench.datasets.sensors.uniform import Uniform
from bench.datasets.sensors.uniform_noise import UniformNoise
from bench.datasets.sensors.view_subset import ViewSubset
from bench.datasets.sensors.views import fibonacci_sphere, look_at, rotation_about, turntable
from bench.datasets.sensors.voxel_thinned import VoxelThinned

BALL = Shape("ball", trimesh.creation.icosphere(5)).framed()[0]
BOX = Shape("box", trimesh.creation.box((1, 2, 3))).framed()[0]
BUMPS = next(Bumps(subdivisions=4).shapes("test")).framed()[0]
DIAGONAL = np.linalg.norm(np.ptp(BOX.mesh.vertices, axis=0))
N = 20_000
CLEAN = {shape.id: PointCloud(*shape.surface.sample(N, generator("clean"))) for shape in (BALL, BOX, BUMPS)}


def spoil(effect, shape: Shape = BOX, seed: int = 0, cloud: PointCloud | None = None) -> PointCloud:
    return effect.spoil(cloud or CLEAN[shape.id], shape, generator(seed, "effect"))


def moves(effect, shape: Shape = BOX) -> np.ndarray:
    """The displacement of each point; the normals must not have changed."""
    spoiled = spoil(effect, shape)
    assert np.array_equal(spoiled.normals, CLEAN[shape.id].normals)
    return spoiled.points - CLEAN[shape.id].points


def excess_kurtosis(x: np.ndarray) -> float:
    return float((x**4).mean() / (x**2).mean() ** 2 - 3)


# -- sources -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", [Uniform, PoissonDisk, DensityGradient])
@pytest.mark.parametrize("count", [1, 2, 333])
def test_sources_have_exact_counts_and_lie_on_the_surface(source, count):
    for shape in (BOX, BUMPS):
        cloud = source(count=count).sense(shape, generator(0))
        assert cloud.points.shape == cloud.normals.shape == (count, 3)
        assert np.abs(cloud.points - shape.surface.closest(cloud.points)[0]).max() < 1e-9


@pytest.mark.parametrize("profile", ["linear", "exponential"])
def test_the_density_falls_by_the_ratio(profile):
    """On the wall of a cylinder the height has the requested density: compare with its distribution function."""
    wall = trimesh.creation.cylinder(radius=1e-3, height=2, sections=64)
    shape = Shape("needle", wall).framed()[0]
    cloud = DensityGradient(count=N, ratio=8, profile=profile, direction=(0, 0, 2)).sense(shape, generator(0))
    s = np.sort((cloud.points[:, 2] - wall.bounds[0, 2]) / 2)
    a = 1 - 1 / 8
    expected = (s - a * s**2 / 2) / (1 - a / 2) if profile == "linear" else (1 - 8.0**-s) / (1 - 1 / 8)
    assert np.abs(expected - (np.arange(N) + 0.5) / N).max() < 1.63 / np.sqrt(N)  # Kolmogorov-Smirnov, 1 %


def test_a_ratio_of_one_is_uniform():
    heights = DensityGradient(count=N, ratio=1, direction=(0, 0, 1)).sense(BALL, generator(0)).points[:, 2]
    assert heights.std() == pytest.approx(1 / np.sqrt(3), rel=0.02)  # Archimedes


def test_voxels_hold_one_point_each():
    cloud = VoxelThinned(voxel=0.2).sense(BALL, generator(3))
    rng = generator(3)
    drawn, _ = BALL.surface.sample(100_000, rng)  # the same draws, then the offset of the grid
    corner = BALL.mesh.vertices.min(axis=0) - 0.2 * (1 + rng.random(3))
    cells = np.floor((cloud.points - corner) / 0.2).astype(int)
    assert len(np.unique(cells, axis=0)) == len(cloud)
    dense = np.floor((drawn - corner) / 0.2).astype(int)
    assert len(np.unique(dense, axis=0)) == len(cloud)  # and no voxel lost its only point


# -- noise -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "sigma", "kurtosis"),
    [
        (Gaussian(sigma=0.02), 0.02, 0.0),
        (UniformNoise(amplitude=0.03), 0.03 / np.sqrt(3), -1.2),
        (Laplace(sigma=0.02), 0.02, 3.0),
        (Gaussian(sigma=0.01, unit="diagonal"), 0.01 * DIAGONAL, 0.0),
        (UniformNoise(amplitude=0.01, unit="diagonal"), 0.01 * DIAGONAL / np.sqrt(3), -1.2),
        (Laplace(sigma=0.01, unit="diagonal"), 0.01 * DIAGONAL, 3.0),
    ],
)
def test_noise_per_axis_has_its_moments(effect, sigma, kurtosis):
    moved = moves(effect)
    assert moved.std(axis=0) == pytest.approx([sigma] * 3, rel=0.03)
    assert np.abs(moved.mean(axis=0)).max() < 4 * sigma / np.sqrt(N)
    assert excess_kurtosis(moved.ravel()) == pytest.approx(kurtosis, abs=0.3)
    assert np.abs(np.corrcoef(moved.T) - np.eye(3)).max() < 4 / np.sqrt(N)


def test_uniform_noise_is_bounded():
    assert 0.0299 < np.abs(moves(UniformNoise(amplitude=0.03))).max() <= 0.03


@pytest.mark.parametrize("shape", [BALL, BUMPS], ids=lambda s: s.id)
def test_normal_noise_moves_points_only_along_the_normal(shape):
    moved = moves(NormalNoise(sigma=0.02), shape)
    height = np.einsum("ni,ni->n", moved, shape.surface.closest(CLEAN[shape.id].points)[1])
    assert height.std() == pytest.approx(0.02, rel=0.03)
    assert np.linalg.norm(moved, axis=1) == pytest.approx(np.abs(height), abs=1e-12)


@pytest.mark.parametrize("effect", [Gaussian, Laplace, NormalNoise])
def test_no_noise_moves_nothing(effect):
    assert not moves(effect(sigma=0.0)).any()


# -- outliers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("outliers", [OutliersBox, OutliersRay, OutliersClustered])
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5])
def test_outliers_have_the_requested_number(outliers, fraction):
    cloud = spoil(outliers(fraction=fraction))
    assert len(cloud) == N
    changed = (cloud.points != CLEAN["box"].points).any(axis=1)
    assert changed.sum() == round(fraction * N)
    assert np.array_equal(cloud.normals[~changed], CLEAN["box"].normals[~changed])


def test_box_outliers_fill_the_inflated_box():
    cloud = spoil(OutliersBox(fraction=0.5, inflation=0.2))
    outside = cloud.points[(cloud.points != CLEAN["box"].points).any(axis=1)]
    half = 0.6 * np.ptp(BOX.mesh.vertices, axis=0)
    assert (np.abs(outside) <= half).all()
    assert outside.std(axis=0) == pytest.approx(half / np.sqrt(3), rel=0.02)


def test_ray_outliers_stay_on_their_rays():
    effect = OutliersRay(fraction=0.3, reach=0.4, views=5, distance=3)
    moved = moves(effect, BALL)
    changed = moved.any(axis=1)
    lengths = np.linalg.norm(moved[changed], axis=1)
    assert lengths.max() <= 0.4
    assert lengths.mean() == pytest.approx(0.2, rel=0.03)  # uniform
    # All lines through the old and the new position of a point meet in five viewpoints, at distance 3.
    rng = generator(0, "effect")
    rng.permutation(N)
    viewpoints = 3 * fibonacci_sphere(5) @ random_rotation(rng).T
    rays = CLEAN["ball"].points[changed][:, None] - viewpoints
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    along = np.abs(np.einsum("nvi,ni->nv", rays, moved[changed] / lengths[:, None]))
    assert np.abs(along.max(axis=1) - 1).max() < 1e-9
    assert set(along.argmax(axis=1)) == set(range(5))


def test_clusters_have_a_dense_core_and_heavy_tails():
    cloud = spoil(OutliersClustered(fraction=0.9, clusters=1, size=0.01))
    outside = cloud.points[(cloud.points != CLEAN["box"].points).any(axis=1)]
    off = np.abs(outside - np.median(outside, axis=0)) / 0.01
    for x in (0.5, 1, 3, 6):  # Student's t with two degrees of freedom, except where w is cut off
        w = 0.01 + (np.arange(20_000) + 0.5) / 1000
        expected = (np.exp(0.01 - w) * erfc(x * np.sqrt(w / 2))).sum() / 1000
        assert (off > x).mean() == pytest.approx(expected, rel=0.07)
        assert expected == pytest.approx(1 - x / np.sqrt(2 + x**2), abs=0.01)
    assert off.max() < 10 * 6


# -- missing data ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "radius"), [(1, 0.3), (4, 0.5), (0, 0.5), (3, 0.0)])
def test_holes_are_empty_balls_around_points_of_the_surface(count, radius):
    cloud = spoil(Holes(count=count, radius=radius), BALL)
    centers, _ = BALL.surface.sample(count, generator(0, "effect")) if count else (np.empty((0, 3)), None)
    clean = CLEAN["ball"].points
    inside = (np.linalg.norm(clean[:, None] - centers, axis=2) < radius).any(axis=1)
    assert np.array_equal(cloud.points, clean[~inside])


def test_one_hole_removes_its_share_of_a_ball():
    """A cap of chord r on the unit sphere has the area pi r^2, of 4 pi."""
    cloud = spoil(Holes(count=1, radius=0.6), BALL)
    assert 1 - len(cloud) / N == pytest.approx(0.6**2 / 4, rel=0.08)


@pytest.mark.parametrize("keep", [1e-9, 0.25, 0.5, 1.0])
def test_half_space_keeps_the_far_side(keep):
    cloud = spoil(HalfSpace(keep=keep, direction=(0, 0, 2)))
    assert len(cloud) == max(1, round(keep * N))
    heights = CLEAN["box"].points[:, 2]
    assert cloud.points[:, 2].min() >= np.sort(heights)[N - len(cloud)]


def test_half_space_in_a_random_direction_depends_on_the_seed():
    first, again, other = (spoil(HalfSpace(), seed=seed).points for seed in (0, 0, 1))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_dropout_keeps_an_exact_number_in_order():
    cloud = spoil(RandomDropout(fraction=0.3))
    assert len(cloud) == round(0.7 * N)
    rows = {tuple(p): i for i, p in enumerate(CLEAN["box"].points)}
    order = [rows[tuple(p)] for p in cloud.points]
    assert order == sorted(order)


def test_one_view_of_a_ball_shows_half_of_it():
    effect = ViewSubset(views=1)
    (direction,) = effect.directions(generator(0, "effect"))
    seen = spoil(effect, BALL).points @ direction
    assert seen.min() > -0.03  # a facet's width
    assert len(seen) / N == pytest.approx(0.5, abs=0.02)


def test_noise_does_not_cause_occlusion():
    noisy = spoil(Gaussian(sigma=0.01), BALL)
    direction = ViewSubset(views=1).directions(generator(0, "effect"))[0]
    seen = spoil(ViewSubset(views=1), BALL, cloud=noisy)
    assert len(seen) == pytest.approx((noisy.points @ direction > 0).sum(), rel=0.01)


def test_nearer_surfaces_occlude_farther_ones():
    """Seen from above, a plate occludes the one below it, and its own lower side."""
    plates = [
        trimesh.creation.box((width, width, 0.02), trimesh.transformations.translation_matrix((0, 0, z)))
        for width, z in ((1.9, 0), (2, 1))
    ]
    shape = Shape("plates", trimesh.util.concatenate(plates)).framed()[0]
    cloud = PointCloud(*shape.surface.sample(5000, generator(0)))
    seen = spoil(ViewSubset(views=1, lowest=90, highest=90), shape, cloud=cloud)
    assert seen.points[:, 2].min() > 0.3
    assert seen.normals[:, 2].min() > -0.5


def test_elevations_are_within_their_bounds():
    directions = ViewSubset(views=1000, lowest=20, highest=40).directions(generator(0))
    elevation = np.degrees(np.arcsin(directions[:, 2]))
    assert 20 <= elevation.min() < 21 and 39 < elevation.max() <= 40
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-12


def test_an_effect_that_removes_all_points_is_refused():
    few = PointCloud(BALL.mesh.vertices[:5])
    with pytest.raises(BadInput, match="sensor holes: removes all 5 points of ball"):
        spoil(Holes(count=1, radius=2.5), BALL, cloud=few)
    with pytest.raises(BadInput, match="sensor random_dropout: removes all 5"):
        spoil(RandomDropout(fraction=0.99), BALL, cloud=few)


# -- normals -----------------------------------------------------------------------------------------------------------


def test_flipped_normals_have_the_requested_number():
    cloud = spoil(NormalsFlip(fraction=0.3))
    same = np.einsum("ni,ni->n", cloud.normals, CLEAN["box"].normals)
    assert np.abs(np.abs(same) - 1).max() < 1e-12
    assert (same < 0).sum() == round(0.3 * N)
    assert np.array_equal(spoil(NormalsFlip(fraction=1)).normals, -CLEAN["box"].normals)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 40.0])
def test_the_tilt_of_normals_has_a_rayleigh_distribution(degrees):
    cloud = spoil(NormalsNoise(degrees=degrees), BALL)
    assert np.abs(np.linalg.norm(cloud.normals, axis=1) - 1).max() < 1e-9
    before = CLEAN["ball"].normals
    sine = np.linalg.norm(np.cross(cloud.normals, before), axis=1)
    tilt = np.degrees(np.arctan2(sine, np.einsum("ni,ni->n", cloud.normals, before)))
    assert tilt.mean() == pytest.approx(degrees * np.sqrt(np.pi / 2), rel=0.03, abs=1e-6)
    assert np.array_equal(cloud.points, CLEAN["ball"].points)


def test_noise_of_normals_equals_gaussian_noise_of_their_coordinates():
    tilted = spoil(NormalsNoise(degrees=np.degrees(0.05)), BALL).normals
    noisy = CLEAN["ball"].normals + 0.05 * generator(1).normal(size=(N, 3))
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    angle = [np.arccos(np.clip((n * CLEAN["ball"].normals).sum(axis=1), -1, 1)) for n in (tilted, noisy)]
    assert np.quantile(angle[0], [0.1, 0.5, 0.9]) == pytest.approx(np.quantile(angle[1], [0.1, 0.5, 0.9]), rel=0.04)


@pytest.mark.parametrize("orientation", ["tree", "exact"])
def test_estimated_normals_are_near_the_true_ones(orientation):
    cloud = PointCloud(*BUMPS.surface.sample(4000, generator(0)))
    estimated = spoil(NormalsPca(orientation=orientation), BUMPS, cloud=PointCloud(cloud.points))
    assert np.degrees(np.arccos(np.clip((estimated.normals * cloud.normals).sum(axis=1), -1, 1))).mean() < 7
    assert np.array_equal(estimated.points, cloud.points)


@pytest.mark.parametrize("k", [15, 32])
def test_a_fixed_number_of_neighbours_includes_the_point_itself(k):
    """As in the clouds released with DSS, whose normals have the signs of the true ones."""
    points, truth = BUMPS.surface.sample(300, generator(0))
    estimated = spoil(NormalsPca(orientation="exact", k=k), BUMPS, cloud=PointCloud(points)).normals
    for point, normal, true in zip(points, estimated, truth, strict=True):
        nearest = points[np.argsort(np.linalg.norm(points - point, axis=1))[:k]]
        axis = np.linalg.svd(nearest - nearest.mean(axis=0))[2][2]
        assert normal @ axis * np.sign(true @ axis) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("k", [-1, 1, 2])
def test_a_plane_needs_three_points(k):
    with pytest.raises(ValueError, match="k: expected 0, or at least 3"):
        NormalsPca(k=k)


def test_normals_can_be_removed_and_missing_ones_are_refused():
    bare = spoil(NormalsNone())
    assert bare.normals is None and np.array_equal(bare.points, CLEAN["box"].points)
    for effect in (NormalsFlip(), NormalsNoise()):
        with pytest.raises(BadInput, match="the cloud has no normals"):
            spoil(effect, cloud=bare)


# -- poses of scanners -------------------------------------------------------------------------------------------------


def test_rotations_are_rotations():
    rng = generator(0)
    for matrix in (random_rotation(rng), rotation_about(np.array([0.6, 0, 0.8]), 0.3)):
        assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1)
    assert np.trace(rotation_about(np.array([0.6, 0, 0.8]), 0.3)) == pytest.approx(1 + 2 * np.cos(0.3))


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 2, 3)])
def test_poses_face_their_target(direction):
    pose = look_at(np.array(direction, float), np.zeros(3))
    assert pose.axes @ pose.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(pose.axes) == pytest.approx(1)  # right x down = forward
    assert pose.axes[2] == pytest.approx(-pose.center / np.linalg.norm(pose.center))
    assert pose.axes[1][2] <= 1e-12  # down is not up


def test_viewpoints_are_evenly_spread():
    ring = turntable(4, 30, 10)
    assert ring[:, 2] == pytest.approx([0.5] * 4)
    assert np.einsum("ni,ni->n", ring, np.roll(ring, 1, axis=0)) == pytest.approx([0.25] * 4)
    sphere = fibonacci_sphere(200)
    assert np.abs(sphere.mean(axis=0)).max() < 0.01
    nearest = np.sort(sphere @ sphere.T, axis=1)[:, -2]
    assert np.arccos(nearest).min() > 0.7 * np.sqrt(4 * np.pi / 200)
