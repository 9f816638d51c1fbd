"""Plane curves and their family: closed forms, brute force, even samples, and distances to a ribbon."""

from __future__ import annotations

from functools import cache
from itertools import islice, pairwise

import numpy as np
import pytest
from omegaconf import OmegaConf
from scipy.spatial import cKDTree

from bench import Case, PointCloud, generator
from bench.datasets.contours import KINDS, Contours
from bench.datasets.outlines.glyphs import GLYPHS
from bench.datasets.outlines.pieces import area, polygon, spline, turned
from bench.datasets.sensors.normal_noise import NormalNoise
from bench.datasets.sensors.poisson_disk import PoissonDisk
from bench.datasets.surfaces.plane_curves import WANDER, PlaneCurves
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.plugins.catalog import mesh_hash
from bench.plugins.registry import registry
from bench.plugins.schema import build
from bench.sweep.composition import compose

CASES = [(kind, index) for kind in KINDS for index in (0, 1)] + [("digit", 8), ("letter", 1)]
SQUARE = np.array([[1.0, -1], [1, 1], [-1, 1], [-1, -1]])


@cache
def shape(kind: str, index: int, split: str = "test"):
    return next(islice(Contours(kind=kind).shapes(split), index, None))


@cache
def along(surface: PlaneCurves, count: int = 20_000) -> np.ndarray:
    """Evenly spaced points (count, 2) on the curves, in order."""
    return surface.at((np.arange(count) + 0.5) / count * surface.lengths.sum())[0][:, :2]


# -- curves of closed form ---------------------------------------------------------------------------------------------


def test_a_square_matches_its_closed_forms():
    surface = PlaneCurves(lambda: [polygon(SQUARE, 0.0)])
    assert surface.lengths == pytest.approx([8])
    rng = np.random.default_rng(0)
    points = rng.uniform(-2, 2, size=(5000, 3))
    closest, normals = surface.closest(points)
    x = points[:, :2]
    outside = np.linalg.norm(np.maximum(np.abs(x) - 1, 0), axis=1)
    inside = np.maximum(1 - np.abs(x).max(axis=1), 0)
    assert np.abs(np.linalg.norm(closest[:, :2] - x, axis=1) - outside - inside).max() < 1e-12
    assert np.abs(np.abs(closest[:, :2]).max(axis=1) - 1).max() < 1e-12 and not closest[:, 2].any()
    assert np.abs(normals[:, :2] - np.round(closest[:, :2] * (np.abs(normals[:, :2]) > 0.5))).max() < 1e-9
    sampled, normals = surface.sample(20_000, rng)
    assert np.abs(np.abs(sampled[:, :2]).max(axis=1) - 1).max() < 1e-12
    assert np.abs((sampled * normals).sum(axis=1) - 1).max() < 1e-12  # each side is at distance 1, outwards
    assert np.abs((sampled[:, :2] ** 2).mean(axis=0) - 2 / 3).max() < 0.02


def test_a_spline_through_points_of_a_circle_is_nearly_a_circle():
    angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    surface = PlaneCurves(lambda: [spline(np.stack([np.cos(angles), np.sin(angles)], axis=1))])
    assert surface.lengths == pytest.approx([2 * np.pi], rel=1e-6)
    points, normals = surface.sample(1000, np.random.default_rng(0))
    assert np.abs(points - normals).max() < 1e-4
    far, _ = surface.closest(np.concatenate([3 * points, 0.5 * points, np.zeros((1, 3))]))
    assert np.abs(far[:1000] - points).max() < 1e-4 and np.abs(far[1000:2000] - points).max() < 1e-4
    assert np.linalg.norm(far[-1]) == pytest.approx(1, abs=1e-5)


def test_rounded_corners_are_tangent_to_their_sides():
    curve = polygon(SQUARE, 0.5)
    assert len(curve) == 8 and area(curve) > 0 > area(turned(curve))
    joints = np.roll(curve, -1, axis=0)
    assert np.array_equal(curve[:, 3], joints[:, 0])
    before, after = curve[:, 3] - curve[:, 2], joints[:, 1] - joints[:, 0]
    assert np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]).max() < 1e-12


# -- the family --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "index"), CASES)
def test_curves_are_closed_with_the_interior_on_the_left(kind, index):
    made = shape(kind, index)
    curves = made.surface.curves
    assert len(curves) == made.info["curves"] and made.tags == (kind,) == (made.info["kind"],)
    for curve in curves:
        assert np.abs(curve[:, 3] - np.roll(curve[:, 0], -1, axis=0)).max() < 1e-12
    areas = np.array([area(curve) for curve in curves])
    assert (areas > 0).sum() == 1 and areas.sum() > 0  # one outline; all others are holes in it
    points = along(made.surface)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(1, abs=1e-3)
    assert np.abs(points.min(axis=0) + points.max(axis=0)).max() < 1e-3


@pytest.mark.parametrize(("kind", "index"), CASES)
def test_samples_are_uniform_by_length(kind, index):
    surface = shape(kind, index).surface
    total = surface.lengths.sum()
    fine = along(surface)
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).sum() < total * (1 + 1e-9) + 2 * len(surface.lengths)
    points, normals = surface.sample(20_000, generator(1))
    distance, at = cKDTree(fine).query(points[:, :2])
    assert distance.max() < 1.01 * total / len(fine) and not points[:, 2].any() and not normals[:, 2].any()
    # Positions along the curve are uniform: Kolmogorov-Smirnov distance, at a significance of 1 in 10,000.
    assert np.abs(np.sort(at) / len(fine) - np.arange(len(at)) / len(at)).max() < 2.23 / np.sqrt(len(at))
    tangents = (np.roll(fine, -1, axis=0) - np.roll(fine, 1, axis=0))[at]
    cosines = np.einsum("ni,ni->n", tangents / np.linalg.norm(tangents, axis=1)[:, None], normals[:, :2])
    assert np.quantile(np.abs(cosines), 0.99) < 0.01


@pytest.mark.parametrize(("kind", "index"), CASES)
@pytest.mark.parametrize("count", [1, 50, 800])
def test_even_samples_have_even_gaps_and_an_exact_number(kind, index, count):
    made, _ = shape(kind, index).framed()
    points, normals = sample_poisson_disk(made, count, generator(2))
    assert points.shape == normals.shape == (count, 3)
    surface = shape(kind, index).surface
    frame = shape(kind, index).framed()[1]
    fine = along(surface)
    at = np.sort(cKDTree(fine).query(frame.invert(points)[:, :2])[1]) / len(fine) * surface.lengths.sum()
    ends = np.concatenate([[0], np.cumsum(surface.lengths)])
    for begin, end in pairwise(ends):
        own = at[(at >= begin) & (at < end)]
        assert abs(len(own) - count * (end - begin) / ends[-1]) < 1
        if len(own) > 1:
            gaps = np.diff(np.append(own, own[0] + end - begin)) / ((end - begin) / len(own))
            slack = 0.02 + 2 * count / len(fine)
            assert gaps.min() > 1 - 2 * WANDER - slack and gaps.max() < 1 + 2 * WANDER + slack


@pytest.mark.parametrize(("kind", "index"), CASES)
def test_closest_points_against_brute_force(kind, index):
    surface = shape(kind, index).surface
    rng = np.random.default_rng(0)
    on, normals = surface.sample(900, rng)
    beside = on + rng.normal(size=(900, 1)) * np.repeat([0.001, 0.02, 0.2], 300)[:, None] * normals
    points = np.concatenate([on, beside, rng.uniform(-1.2, 1.2, size=(900, 3))])
    closest, at = surface.closest(points)
    spacing = 5e-4
    fine = surface.ribbon(1.0, 1.0, spacing).vertices[:, :2]
    brute, _ = cKDTree(fine).query(points[:, :2])
    planar = np.linalg.norm((points - closest)[:, :2], axis=1)
    assert (planar < brute + 1e-9).all()  # no point is nearer,
    assert (brute < planar + 0.51 * spacing).all()  # and it lies on the curve
    assert np.abs(closest[:900] - on).max() < 1e-9
    assert np.abs(np.linalg.norm(at, axis=1) - 1).max() < 1e-12
    assert all(part.shape == (0, 3) for part in surface.closest(np.empty((0, 3))))


@pytest.mark.parametrize(("kind", "index"), CASES)
def test_distances_to_the_ribbon_are_distances_to_the_curve(kind, index):
    made = shape(kind, index)
    dataset, mesh = Contours(), made.mesh
    assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(dataset.height) and mesh.body_count == made.info["curves"]
    on = mesh.vertices * [1, 1, 0]
    assert np.abs(made.surface.closest(on)[0] - on).max() < 1e-9
    facing = np.einsum("ni,ni->n", mesh.face_normals, made.surface.closest(mesh.triangles_center)[1])
    assert facing.min() > 0.9
    assert mesh.area == pytest.approx(dataset.height * made.surface.lengths.sum(), rel=1e-4)
    # In the plane up to the tessellation; above it up to half the height.
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.2, 1.2, size=(2000, 3)) * [1, 1, 0]
    ribbon = MeshSurface(mesh)
    assert np.linalg.norm(made.surface.sample(2000, rng)[0] - points, axis=1).min() > 0
    for lift, within in ((0.0, 1.01 * dataset.tolerance), (0.01, dataset.height / 2 + 1.01 * dataset.tolerance)):
        lifted = points + [0, 0, lift]
        exact = np.linalg.norm(made.surface.closest(lifted)[0] - lifted, axis=1)
        assert np.abs(ribbon.project(lifted).distance - exact).max() < within


def test_shapes_are_repeatable_and_distinct():
    made = [*islice(Contours().shapes("train"), 60), *islice(Contours().shapes("test"), 20)]
    assert len({np.concatenate(one.surface.curves).tobytes() for one in made}) == 80
    for one, again in zip(made[:5], Contours().shapes("train"), strict=False):
        assert mesh_hash(one.mesh) == mesh_hash(again.mesh)


@pytest.mark.parametrize("kind", list(GLYPHS))
def test_glyphs_have_their_holes(kind):
    """With a shaky hand and a broad pen, a B still has two holes and an E has none."""
    shapes = list(islice(Contours(kind=kind).shapes("train"), 2 * len(GLYPHS[kind])))
    assert [len(s.surface.curves) for s in shapes] == 2 * [count for count, _ in GLYPHS[kind].values()]
    assert [s.info["name"] for s in shapes] == 2 * list(GLYPHS[kind])


def test_kinds_alternate_and_every_other_star_is_sharp():
    assert [s.info["kind"] for s in islice(Contours().shapes("test"), 7)] == [*KINDS, *KINDS[:2]]
    pieces = [len(s.surface.curves[0]) for s in islice(Contours(kind="star").shapes("test"), 2)]
    assert pieces[0] % 4 == 0 and len(shape("star", 1).surface.curves[0]) == pieces[1]
    assert np.degrees(_turn(shape("star", 0))) < 1 < 30 < np.degrees(_turn(shape("star", 1)))


def _turn(made) -> float:
    """The largest angle between neighbouring pieces of the outline."""
    curve = made.surface.curves[0]
    before = curve[:, 3] - curve[:, 2]
    after = np.roll(curve, -1, axis=0)
    after = after[:, 1] - after[:, 0]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return float(np.abs(np.arctan2(cross, (before * after).sum(axis=1))).max())


@pytest.mark.parametrize(("name", "value"), [("kind", "cube"), ("height", 0.0), ("tolerance", 0.0)])
def test_bad_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        Contours(**{name: value})


# -- with sensors and cases --------------------------------------------------------------------------------------------


@cache
def sensor(preset: str):
    values = OmegaConf.to_container(compose([f"sensor={preset}"])["sensor"], resolve=True)
    return build(registry().find("sensor", values["_name_"]), values)


@pytest.mark.parametrize(
    ("preset", "count", "sigma"),
    [(f"contour_{n}", n, 0.0) for n in (50, 45, 40, 35, 30, 25)]
    + [(f"contour_50_{n}pct", 50, s) for n, s in (("0_5", 0.005), ("1", 0.01), ("1_5", 0.015), ("2", 0.02))],
)
def test_presets_have_their_count_and_their_noise_in_the_plane(preset, count, sigma):
    made, _ = shape("blob", 0).framed()
    clouds = [sensor(preset).sense(made, generator(k)) for k in range(20)]
    assert {len(cloud) for cloud in clouds} == {count}
    points = np.concatenate([cloud.points for cloud in clouds])
    assert not points[:, 2].any()
    distance = np.linalg.norm(points - made.surface.closest(points)[0], axis=1)
    assert np.sqrt((distance**2).mean()) == pytest.approx(sigma, rel=0.1, abs=1e-9)


def test_a_case_of_a_contour_scores_the_known_distance():
    """Points moved off the curve by a known length are at that distance."""
    made, frame = shape("polygon", 0).framed()
    cloud = PoissonDisk(count=100).sense(made, generator(0))
    moved = PointCloud(cloud.points + 0.01 * cloud.normals)
    case = Case("contour", {"cloud": cloud}, made, frame)
    assert case.compare(moved).to_surface.distance == pytest.approx(np.full(100, 0.01), abs=2e-5)
    noisy = NormalNoise(sigma=0.02).spoil(cloud, made, generator(1))
    assert np.sqrt((case.compare(noisy).to_surface.distance ** 2).mean()) == pytest.approx(0.02, rel=0.25)
    assert case.compare(moved).to_output.distance.max() < 0.05


def test_ten_kinds_of_man_made_shapes_alternate():
    values = OmegaConf.to_container(compose(["dataset=man_made"])["dataset"], resolve=True)
    dataset = build(registry().find("dataset", values["_name_"]), values)
    shapes = list(islice(dataset.shapes("test"), 40))
    kinds = ["chair", "table", "shelf", "plate", "bracket", "gear", "pipe_tee", "heat_sink", "block", "lattice"]
    assert [s.tags for s in shapes] == 4 * [(kind,) for kind in kinds]
    assert len({s.id for s in shapes}) == 40
