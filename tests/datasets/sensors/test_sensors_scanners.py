"""Scanners: measured points are on visible surface, and their errors follow the formulas."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bench import BadInput, Shape, generator
from bench.datasets.sensors.depth_camera import DepthCamera
from bench.datasets.sensors.kinect import BASELINE, FOCAL, Kinect, axial_sigma, lateral_sigma
from bench.datasets.sensors.lidar import Lidar
from bench.datasets.sensors.scanning import survives_grazing
from bench.datasets.sensors.scene import Scene, focal_length, see
from bench.datasets.sensors.stereo import Stereo
from bench.datasets.sensors.time_of_flight import TimeOfFlight
from bench.datasets.sensors.triangulation import Triangulation
from bench.datasets.sensors.views import Pose, look_at

move = trimesh.transformations.translation_matrix
BALL = Shape("ball", trimesh.creation.icosphere(4)).framed()[0]
# A post before a wall: shadows, edges, and both faces of thin parts.
POST = Shape(
    "post",
    trimesh.util.concatenate(
        [
            trimesh.creation.box((1.6, 0.1, 1.6)),
            trimesh.creation.cylinder(0.2, 1.2, sections=24, transform=move((0, -0.6, 0))),
        ]
    ),
).framed()[0]
IDEAL = {
    "depth_camera": DepthCamera(views=3, resolution=40),
    "triangulation": Triangulation(views=3, resolution=40, intensity_noise=0, quantised=False),
    "stereo": Stereo(views=3, width=200, subpixel=0, steps=0),
    "time_of_flight": TimeOfFlight(views=3, resolution=40, noise=0, flying=0),
    "lidar": Lidar(views=3, channels=20, azimuth_step=1, noise=0),
}
REAL = {
    "depth_camera": DepthCamera(resolution=24),
    "triangulation": Triangulation(resolution=24),
    "kinect": Kinect(views=3, max_points=1000),
    "stereo": Stereo(views=3, width=100),
    "time_of_flight": TimeOfFlight(resolution=24),
    "lidar": Lidar(channels=12, azimuth_step=1),
}
FRONT = look_at(np.array([0.0, -3.0, 0.0]), np.zeros(3))


def wall(angle: float = 0.0, at: float = 0.0) -> Scene:
    """A square of side 2 that faces FRONT, rotated about z by an angle in degrees, at a distance behind the origin."""
    square = trimesh.Trimesh([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], [[0, 1, 2], [0, 2, 3]], process=False)
    square.apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle), (0, 0, 1)))
    square.apply_translation((0, at, 0))
    return Scene(square)


def blocked(mesh: trimesh.Trimesh, points: np.ndarray, viewer: np.ndarray) -> np.ndarray:
    """Whether a triangle lies between points and a viewer, by Möller and Trumbore in float64, for all pairs."""
    a, b, c = (mesh.triangles[:, k] for k in range(3))
    direction = viewer - points
    e1, e2 = b - a, c - a
    p = np.cross(direction[:, None], e2)
    det = np.einsum("nfi,fi->nf", p, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = points[:, None] - a
        u = np.einsum("nfi,nfi->nf", s, p) / det
        q = np.cross(s, e1)
        v = np.einsum("ni,nfi->nf", direction, q) / det
        t = np.einsum("fi,nfi->nf", e2, q) / det
        inside = (u > 1e-6) & (v > 1e-6) & (u + v < 1 - 1e-6) & (t > 1e-3) & (t < 1)
    return inside.any(axis=1)


# -- visibility --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", IDEAL)
@pytest.mark.parametrize("shape", [BALL, POST], ids=lambda s: s.id)
def test_ideal_points_lie_on_the_mesh(name, shape):
    cloud = IDEAL[name].sense(shape, generator(0))
    assert len(cloud) > 200
    assert np.abs(cloud.points - shape.surface.closest(cloud.points)[0]).max() < 1e-6


@pytest.mark.parametrize("name", IDEAL)
def test_occluded_points_are_never_returned(name):
    scanner, scene = IDEAL[name], Scene(POST.mesh)
    for pose in scanner.poses(scene, generator(5)):
        scan = scanner.measure(scene, pose, generator(0))
        assert len(scan.points) > 50
        assert not blocked(POST.mesh, scan.hits, pose.center).any()


def test_a_camera_measures_every_pixel_that_the_mesh_covers():
    """Against casting every ray at every triangle in float64."""
    scene = Scene(POST.mesh)
    view = see(scene, FRONT, focal_length(scene, 3, 15), 15)
    line = np.arange(15) - 7
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    directions = np.column_stack([x / view.focal, y / view.focal, np.ones(225)]) @ FRONT.axes
    hits = [first_hit(POST.mesh.triangles, FRONT.center, direction) for direction in directions]
    rays = [ray for ray, hit in enumerate(hits) if hit is not None]
    assert np.array_equal(view.index, rays)
    assert view.points == pytest.approx(np.array([hits[ray] for ray in rays]), abs=1e-6)
    assert view.unproject(view.depth) == pytest.approx(view.points, abs=1e-6)


def first_hit(triangles, origin, direction):
    """The first hit of a ray on triangles (f, 3, 3), or None: Cramer's rule for a + u e + v f = o + t d."""
    a, e, f = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    determinant = np.cross(e, f) @ -direction
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.cross(origin - a, f) @ -direction / determinant
        v = np.cross(e, origin - a) @ -direction / determinant
        t = np.einsum("fi,fi->f", np.cross(e, f), origin - a) / determinant
        met = (determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return origin + t[met].min() * direction if met.any() else None


def test_the_bounding_sphere_fills_the_image():
    scene = Scene(BALL.mesh)
    view = see(scene, FRONT, focal_length(scene, 3, 101), 101)
    radius = np.linalg.norm(view.pixels, axis=1)
    assert 49 < radius.max() <= 50.5
    assert len(view.index) == pytest.approx(np.pi * 50.5**2, rel=0.02)


def test_incidence_is_that_of_the_faces():
    for angle in (0, 30, 75):
        view = see(wall(angle), FRONT, 2000.0, 41)
        assert np.degrees(np.arccos(view.cosine)) == pytest.approx(angle, abs=1)


@pytest.mark.parametrize("name", REAL)
def test_scans_depend_on_the_seed_alone(name):
    first, again, other = (REAL[name].sense(POST, generator(seed)) for seed in (0, 0, 1))
    assert np.array_equal(first.points, again.points) and np.array_equal(first.normals, again.normals)
    assert not np.array_equal(first.points[:10], other.points[:10])


def edge_cases() -> list[Shape]:
    half = trimesh.creation.icosphere(3)
    half.update_faces(half.triangles_center[:, 2] > 0.1)
    plate = trimesh.creation.box((1, 1, 0.002))
    tiny = trimesh.creation.icosphere(2)
    tiny.apply_scale(1e-6)
    tiny.apply_translation((5, 5, 5))
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 1]], process=False)
    return [Shape(n, m).framed()[0] for n, m in {"open": half, "thin": plate, "tiny": tiny, "triangle": flat}.items()]


@pytest.mark.parametrize("shape", edge_cases(), ids=lambda s: s.id)
@pytest.mark.parametrize("name", REAL)
def test_open_thin_tiny_and_flat_meshes(name, shape):
    cloud = REAL[name].sense(shape, generator(0))
    assert len(cloud) >= 3
    assert np.isfinite(cloud.points).all()
    assert np.linalg.norm(cloud.normals, axis=1) == pytest.approx(1)
    assert np.median(np.linalg.norm(cloud.points - shape.surface.closest(cloud.points)[0], axis=1)) < 0.05


def test_a_scene_without_visible_surface_is_refused():
    speck = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1e-9, 0]], [[0, 1, 2]], process=False)
    shape = Shape("speck", speck).framed()[0]
    with pytest.raises(
        BadInput, match=r"sensor depth_camera: 0 points of speck were measured from 8 views.*try more views"
    ):
        DepthCamera(resolution=4).sense(shape, generator(0))


# -- common parameters -------------------------------------------------------------------------------------------------


def test_thinning_takes_a_subset_of_that_size():
    every, some = (DepthCamera(views=2, max_points=m).sense(BALL, generator(0)) for m in (0, 500))
    rows = {tuple(p): i for i, p in enumerate(every.points)}
    order = [rows[tuple(p)] for p in some.points]
    assert len(order) == 500 and order == sorted(order)
    assert np.array_equal(some.normals, every.normals[order])


def test_misregistration_moves_each_scan_rigidly():
    quiet, loud = (
        DepthCamera(views=3, misrotation=degrees, misshift=shift, max_points=0)
        for degrees, shift in ((0.0, 0.0), (2.0, 0.05))
    )
    scene = Scene(POST.mesh)
    before, after = (scanner.sense(POST, generator(0)) for scanner in (quiet, loud))
    sizes = [len(quiet.measure(scene, p, generator(0)).points) for p in quiet.poses(scene, generator(0).spawn(4)[0])]
    start, shifts = 0, []
    for size in sizes:
        p, q = before.points[start : start + size], after.points[start : start + size]
        u, _, vt = np.linalg.svd((p - p.mean(axis=0)).T @ (q - q.mean(axis=0)))  # Kabsch
        turn = (u @ vt).T
        assert (p - p.mean(axis=0)) @ turn.T + q.mean(axis=0) == pytest.approx(q, abs=1e-9)
        assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) == pytest.approx(2.0, abs=1e-4)
        assert before.normals[start : start + size] @ turn.T == pytest.approx(
            after.normals[start : start + size], abs=1e-9
        )
        shifts.append(q.mean(axis=0) - p.mean(axis=0))
        start += size
    assert start == len(before) == len(after)
    assert 0.01 < np.std(shifts) < 0.1


def test_normals_are_exact_or_estimated_towards_the_scanner_or_missing():
    exact, estimated, none = (
        DepthCamera(normals=n, views=1).sense(BALL, generator(0)) for n in ("exact", "pca", "none")
    )
    assert none.normals is None
    assert np.array_equal(exact.points, estimated.points)
    assert exact.normals == pytest.approx(BALL.surface.closest(exact.points)[1], abs=1e-6)
    assert (exact.normals * estimated.normals).sum(axis=1).min() > 0.8
    hollow = trimesh.creation.icosphere(4)
    hollow.update_faces(hollow.triangles_center[:, 1] > 0.3)  # seen from inside, where normals point away
    shape = Shape("bowl", hollow)
    for normals, sign in (("exact", 1), ("pca", -1)):
        scanner = DepthCamera(views=1, normals=normals, resolution=40)
        object.__setattr__(scanner, "poses", lambda scene, rng: [Pose(FRONT.center, FRONT.axes)])
        cloud = scanner.sense(shape, generator(0))
        assert (sign * cloud.normals[:, 1] > 0).all()


@pytest.mark.parametrize("rig", ["sphere", "turntable"])
def test_the_scanner_keeps_its_distance(rig):
    scene = Scene(BALL.mesh)
    poses = DepthCamera(views=7, rig=rig, elevation=30, distance=2.5).poses(scene, generator(0))
    centers = np.array([p.center for p in poses])
    assert np.linalg.norm(centers, axis=1) == pytest.approx(2.5)
    if rig == "turntable":
        assert centers[:, 2] == pytest.approx(1.25)


def test_grazing_measurements_are_lost_in_proportion_to_the_cosine():
    cosine = np.linspace(0, 1, 100_001)
    kept = survives_grazing(cosine, 0.1, 0.3, generator(0))
    assert not kept[cosine < 0.1].any() and kept[cosine > 0.3].all()
    assert kept[(cosine > 0.19) & (cosine < 0.21)].mean() == pytest.approx(0.5, abs=0.05)


# -- errors of each scanner --------------------------------------------------------------------------------------------


def quiet_triangulation(baseline: float) -> Triangulation:
    return Triangulation(baseline=baseline, intensity_noise=0, quantised=False, peak_threshold=0)


def quiet_stereo(baseline: float) -> Stereo:
    return Stereo(baseline=baseline, steps=0, subpixel=0, max_angle=89.9)


@pytest.mark.parametrize("scanner", [quiet_triangulation, quiet_stereo])
def test_shadows_vanish_with_the_baseline(scanner):
    scene = Scene(POST.mesh)
    seen = [{tuple(p) for p in scanner(b).measure(scene, FRONT, generator(0)).hits} for b in (1e-5, 0.05, 0.2)]
    assert seen[0] > seen[1] > seen[2]
    focal = focal_length(scene, 3, 128) if scanner is quiet_triangulation else Stereo().focal
    view = see(scene, FRONT, focal, 128 if scanner is quiet_triangulation else int(np.ceil(2 * focal / np.sqrt(8))))
    assert {tuple(p) for p in view.points[view.cosine > 0.01]} <= seen[0]


def test_the_error_of_a_stripe_follows_from_the_noise_of_its_pixels():
    """First-order error of the vertex of the parabola through three logarithms."""
    made = Triangulation(intensity_noise=0.01, quantised=False)
    _, exact = Triangulation(intensity_noise=0, quantised=False)._peaks(np.full(1000, 0.8), generator(0))
    assert np.abs(exact).max() < 1e-5
    _, delta = made._peaks(np.full(40_000, 0.8), generator(0))
    m = np.linspace(-0.5, 0.5, 2001)
    at, before, after = (np.exp(-((k - m) ** 2) / 2) * 0.8 for k in (0, -1, 1))
    # d = (ln I- - ln I+) / (2 (ln I- + ln I+ - 2 ln I0)): without noise the sum is -1 and d = m.
    variance = 0.01**2 * (((m - 0.5) / before) ** 2 + ((m + 0.5) / after) ** 2 + (2 * m / at) ** 2)
    assert delta.std() == pytest.approx(np.sqrt(variance.mean()), rel=0.05)
    assert abs(delta.mean()) < 1e-3


def test_dark_stripes_are_lost_and_quantisation_leaves_an_error():
    made = Triangulation(intensity_noise=0, peak_threshold=0.1)
    found, delta = made._peaks(np.array([1.0, 0.5, 0.09, 0.0]), generator(0))
    assert list(found) == [0, 1]
    assert (delta != 0).all()
    _, bright = made._peaks(np.full(2000, 1.0), generator(0))
    _, dim = made._peaks(np.full(2000, 0.2), generator(0))
    assert dim.std() == pytest.approx(5 * bright.std(), rel=0.3)


def test_kinect_noise_follows_its_formula():
    """Monte Carlo over a wall, at several depths and angles; at 70 degrees the lateral noise affects the depth too."""
    assert axial_sigma(np.array([1.0]), np.array([0.0]))[0] == pytest.approx(0.0012 + 0.0019 * 0.36)
    assert lateral_sigma(np.array([0.0]))[0] == 0.8
    for angle, distance in ((0, 2.0), (0, 5.0), (70, 3.0)):
        scene = wall(angle)
        pose = look_at(np.array([0.0, -distance * scene.radius, 0.0]), np.zeros(3))
        kinect = Kinect(size=0.5, distance=distance, quantised=False)
        scan = kinect.measure(scene, pose, generator(0))
        metre = scene.radius / 0.5
        middle = np.abs(scan.hits @ pose.axes[0]) < 0.05
        error = ((scan.points - scan.hits) @ pose.axes[2])[middle] / metre
        expected = axial_sigma(np.array([0.5 * distance]), np.array([np.radians(angle)]))[0]
        assert len(error) > 500
        assert error.std() == pytest.approx(expected, rel=0.06)
        across = ((scan.points - scan.hits) @ pose.axes[0])[middle] / metre
        expected = lateral_sigma(np.radians(angle)) * 0.5 * distance / FOCAL
        assert across.std() == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("scanner", [Kinect(), Stereo(steps=16)], ids=["kinect", "stereo"])
def test_disparities_are_quantised(scanner):
    scene = Scene(BALL.mesh)
    scan = scanner.measure(scene, FRONT, generator(0))
    depth = (scan.points - FRONT.center) @ FRONT.axes[2] * 0.4
    if isinstance(scanner, Kinect):
        disparity = 8 * FOCAL * BASELINE / depth
    else:
        disparity = 16 * scanner.focal * scanner.baseline / depth
    assert np.abs(disparity - np.round(disparity)).max() < 1e-6
    assert len(np.unique(np.round(disparity))) < len(depth) / 20


def test_kinect_measures_only_within_its_limits():
    scene = Scene(BALL.mesh)
    near = Kinect(size=0.15).measure(scene, FRONT, generator(0))  # at 0.3 to 0.45 m
    depth = (near.points - FRONT.center) @ FRONT.axes[2] * 0.15
    assert 0.4 <= depth.min() < 0.41
    assert not len(Kinect(size=1.6).measure(scene, FRONT, generator(0)).points)  # beyond 3.2 m
    steep = Kinect(max_angle=30).measure(scene, FRONT, generator(0))
    rays = FRONT.center - steep.hits
    cosine = np.einsum("ni,ni->n", scene.normals[steep.faces], rays) / np.linalg.norm(rays, axis=1)
    assert cosine.min() >= np.cos(np.radians(30)) - 1e-9


def test_stereo_noise_grows_with_the_square_of_depth():
    for distance in (2.0, 4.0):
        scene = wall()
        pose = look_at(np.array([0.0, -distance * scene.radius, 0.0]), np.zeros(3))
        made = Stereo(distance=distance, size=0.5, steps=0, width=400, max_points=0)
        scan = made.measure(scene, pose, generator(0))
        error = ((scan.points - scan.hits) @ pose.axes[2]) * 0.5 / scene.radius
        z = 0.5 * distance
        assert error.std() == pytest.approx(z**2 * 0.08 / (made.focal * 0.05), rel=0.08)


def test_time_of_flight_noise_is_along_the_ray():
    scene = wall()
    scan = TimeOfFlight(resolution=80, noise=0.01, flying=0).measure(scene, FRONT, generator(0))
    rays = scan.hits - FRONT.center
    moved = scan.points - scan.hits
    assert np.abs(np.cross(moved, rays)).max() < 1e-9
    assert np.linalg.norm(moved, axis=1) @ np.linalg.norm(moved, axis=1) / len(moved) == pytest.approx(
        (0.01 * scene.radius) ** 2, rel=0.1
    )


def test_flying_pixels_lie_on_their_rays_between_foreground_and_background():
    scene = Scene(POST.mesh)
    made = TimeOfFlight(resolution=60, noise=0, flying=1, edge=0.1)
    scan = made.measure(scene, FRONT, generator(0))
    rays = scan.hits - FRONT.center
    distance = np.linalg.norm(rays, axis=1)
    measured = np.linalg.norm(scan.points - FRONT.center, axis=1)
    assert np.abs(np.cross(scan.points - FRONT.center, rays)).max() < 1e-9
    flying = np.abs(measured - distance) > 1e-9
    assert 20 < flying.sum() < 0.3 * len(flying)
    view = see(scene, FRONT, focal_length(scene, 3, 60), 60)
    ranges = dict(zip(view.index.tolist(), np.linalg.norm(view.points - FRONT.center, axis=1), strict=True))
    place = {tuple(p): i for p, i in zip(view.points, view.index.tolist(), strict=True)}
    for hit, own, got in zip(scan.hits[flying], distance[flying], measured[flying], strict=True):
        i = place[tuple(hit)]
        others = [ranges[j] for j in (i - 1, i + 1, i - 60, i + 60) if j in ranges]
        other = max(others, key=lambda r: abs(r - own))
        assert abs(other - own) > 0.1
        assert min(own, other) <= got <= max(own, other)


def test_lidar_points_come_in_rings_with_noise_along_the_ray():
    scene = Scene(BALL.mesh)
    scan = Lidar(channels=11, azimuth_step=0.5, noise=0.02, full_intensity=0).measure(scene, FRONT, generator(0))
    rays = scan.hits - FRONT.center
    local = rays @ FRONT.axes.T
    elevation = np.arcsin(-local[:, 1] / np.linalg.norm(local, axis=1))
    channel = (elevation / np.arcsin(1 / 3) + 1) / 2 * 11 - 0.5
    assert np.abs(channel - np.round(channel)).max() < 1e-4
    assert set(np.round(channel)) == set(range(11))
    azimuth = np.degrees(np.arctan2(local[:, 0], local[:, 2])) / 0.5
    assert np.abs((azimuth - azimuth[0]) - np.round(azimuth - azimuth[0])).max() < 1e-3
    moved = scan.points - scan.hits
    assert np.abs(np.cross(moved, rays)).max() < 1e-9
    assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(0.02, rel=0.06)


def test_lidar_loses_weak_returns_in_proportion():
    scene = wall(60)
    pose = look_at(np.array([0.0, -3 * scene.radius, 0.0]), np.zeros(3))
    every, some = (Lidar(channels=40, full_intensity=full).measure(scene, pose, generator(0)) for full in (0.0, 1.0))
    rays = every.hits - pose.center
    distance = np.linalg.norm(rays, axis=1)
    cosine = np.abs(rays @ scene.normals[0]) / distance
    assert np.median(cosine) == pytest.approx(0.5, abs=0.1)
    expected = np.minimum(1, cosine * (3 * scene.radius / distance) ** 2).mean()
    assert len(some.hits) / len(every.hits) == pytest.approx(expected, abs=0.02)
