"""The DTU benchmark's distances against a slow, plain computation, on masks and planes in MATLAB files."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.io import savemat

from bench import BadInput, Case, PointCloud, Shape, generator
from bench.geometry.io.dtu import load_mask, load_plane
from bench.geometry.thinning import grids_on, thinned
from bench.plugins.registry import registry

LOW, HIGH, STEP = np.array([-10.0, -20.0, 590.0]), np.array([30.0, 20.0, 630.0]), 4.0
THIN, CUT, MARGIN = 1.5, 12.0, 6.0
# By name: a plugin that is imported before all others are loaded does not count as an installed one.
DtuDistances = registry().find("metric", "dtu_distances").cls
METRIC = DtuDistances(thin=THIN, cut=CUT, margin=MARGIN)


@pytest.fixture
def attributes(tmp_path):
    """A mask of random cells and a tilted plane, as MATLAB writes them."""
    mask = (generator("mask").random((11, 11, 11)) < 0.6).astype(np.uint8)
    savemat(tmp_path / "ObsMask1_10.mat", {"ObsMask": mask, "BB": np.array([LOW, HIGH], np.float32), "Res": STEP})
    savemat(tmp_path / "Plane1.mat", {"P": np.array([[0.1], [0.0], [1.0], [-603.0]])})
    return load_mask(tmp_path / "ObsMask1_10.mat") | load_plane(tmp_path / "Plane1.mat")


def cloud_about(name, count=500):
    """Points within and around the box, some of them far away."""
    rng = generator(name)
    points = rng.uniform(LOW - 12, HIGH + 18, (count, 3))
    points[:20] += 60
    return points


def case_of(points, attributes):
    shape, frame = Shape("scan1", PointCloud(points), attributes=attributes).framed()
    return Case("scan1", {}, shape, frame)


def within(a, b):
    return np.linalg.norm(a[:, None] - b, axis=2)


def by_hand(points, truth, attributes):
    """Scores computed point by point, of an output already thinned; lengths are in millimetres."""
    box, mask, plane = (attributes[name] for name in ("obs_box", "obs_mask", "ground_plane"))
    inside = [p for p in points if all(box[0] - MARGIN <= p) and all(p < box[1] + 2 * MARGIN)]
    observed = []
    for p in inside:
        cell = np.round((p - LOW) / STEP).astype(int)
        if all(cell >= 0) and all(cell < mask.shape) and mask[tuple(cell)]:
            observed.append(p)
    above = [q for q in truth if plane @ [*q, 1] > 0]
    accuracy = [d for p in observed if (d := min(np.linalg.norm(truth - p, axis=1))) < CUT]
    completeness = [d for q in above if (d := min(np.linalg.norm(np.array(inside) - q, axis=1))) < CUT]
    assert 50 < len(accuracy) < len(inside) < len(points) and 50 < len(completeness) < len(above) < len(truth)
    return {
        "dtu_accuracy": np.mean(accuracy),
        "dtu_accuracy_median": np.median(accuracy),
        "dtu_completeness": np.mean(completeness),
        "dtu_completeness_median": np.median(completeness),
        "dtu_overall": (np.mean(accuracy) + np.mean(completeness)) / 2,
    }


def test_scores_of_a_cloud_match_a_loop(attributes):
    truth, output = cloud_about("truth"), cloud_about("output")
    case = case_of(truth, attributes)
    points = thinned(output, THIN, generator(0, "scan1", "thinned"))
    found = METRIC.score(PointCloud(case.frame.apply(output)), case)
    assert found == pytest.approx(by_hand(points, truth, attributes), rel=1e-9)


def test_a_mesh_is_covered_with_points(attributes):
    truth = cloud_about("truth")
    case = case_of(truth, attributes)
    ball = trimesh.creation.icosphere(2, radius=18).apply_translation((LOW + HIGH) / 2)
    points = np.concatenate([ball.vertices, *grids_on(ball.triangles, THIN)])
    framed = trimesh.Trimesh(case.frame.apply(ball.vertices), ball.faces, process=False)
    found = METRIC.score(framed, case)
    thin = thinned(points, THIN, generator(0, "scan1", "thinned"))
    # The vertices were moved into the frame and back: rounding decides which of two equal distances is below THIN.
    assert found == pytest.approx(METRIC.score(PointCloud(case.frame.apply(thin)), case), rel=0.02)
    assert found["dtu_accuracy"] > 0


def test_the_grid_on_a_triangle():
    """It matches a loop over rows and columns, with the same spacing along both edges."""
    corners = np.array(
        [[[0, 0, 0], [7, 0, 0], [1, 4, 0]], [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], np.zeros((3, 3))], float
    )
    a, b = corners[0, 1], corners[0, 2]
    step = 0.5 * np.sqrt(np.linalg.norm(a) * np.linalg.norm(b) / np.linalg.norm(np.cross(a, b)))
    n, m = int(np.linalg.norm(a) // step), int(np.linalg.norm(b) // step)
    pairs = [((i + 0.5) / n, (j + 0.5) / m) for i in range(n + 1) for j in range(m + 1)]
    expected = np.array([u * a + v * b for u, v in pairs if u + v < 1])
    np.testing.assert_allclose(np.concatenate(list(grids_on(corners, 0.5))), expected, atol=1e-12)
    assert sum(map(len, grids_on(np.repeat(corners, 50, axis=0), 0.5))) == 50 * len(expected)


def test_an_output_without_points_nearby_scores_worst(attributes):
    truth = cloud_about("truth")
    case = case_of(truth, attributes)
    far = PointCloud(case.frame.apply(truth[:50] + 1000))
    for output in (far, PointCloud(np.empty((0, 3)))):
        assert set(METRIC.score(output, case).values()) == {np.inf}
    assert METRIC.score(case.reference.cloud, case)["dtu_accuracy"] == pytest.approx(0, abs=1e-9)


def test_without_a_plane_all_points_count_and_without_a_mask_there_is_no_score(attributes):
    truth = cloud_about("truth")
    output = PointCloud(case_of(truth, {}).frame.apply(cloud_about("output")))
    del attributes["ground_plane"]
    high = attributes | {"ground_plane": np.array([0, 0, 0, 1.0])}
    assert METRIC.score(output, case_of(truth, attributes)) == METRIC.score(output, case_of(truth, high))
    without = case_of(truth, {})
    assert METRIC.score(output, without) == {} and "dataset.mask=FILE" in METRIC.why_not(output, without)


def test_an_unthinned_reference_can_be_thinned(attributes):
    truth = cloud_about("truth")
    dense = np.repeat(truth, 3, axis=0) + 1e-9 * generator("dense").normal(size=(1500, 3))
    output = cloud_about("output")
    found = [
        DtuDistances(THIN, CUT, MARGIN, thin_reference=0.01).score(PointCloud(case.frame.apply(output)), case)
        for case in (case_of(truth, attributes), case_of(dense, attributes))
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-6)


@pytest.mark.parametrize("count", [1, 100, 5000])
def test_thinning_matches_a_loop_over_all_points(count):
    points, distance = generator("thin").uniform(0, 20 if count > 1000 else 4, (count, 3)), 0.5
    order = generator("order")
    shuffled = points[np.lexsort(points.T)]
    shuffled = shuffled[generator("order").permutation(count)]
    kept = np.empty((0, 3))
    for point in shuffled:
        if not len(kept) or np.linalg.norm(kept - point, axis=1).min() > distance:
            kept = np.vstack([kept, point])
    np.testing.assert_array_equal(thinned(points, distance, order), kept)
    np.testing.assert_array_equal(thinned(points[::-1], distance, generator("order")), kept)


def test_invalid_files_are_refused(tmp_path):
    (tmp_path / "text.mat").write_text("nothing")
    savemat(tmp_path / "other.mat", {"x": 1})
    savemat(tmp_path / "flat.mat", {"ObsMask": np.ones((3, 3)), "BB": np.ones((2, 3)), "Res": 1.0, "P": np.ones(3)})
    for load in (load_mask, load_plane):
        with pytest.raises(BadInput, match="text.mat: cannot be read as a MATLAB file"):
            load(tmp_path / "text.mat")
        with pytest.raises(BadInput, match="none.mat: cannot be read"):
            load(tmp_path / "none.mat")
        with pytest.raises(BadInput, match="other.mat: has no"):
            load(tmp_path / "other.mat")
    with pytest.raises(BadInput, match="expected three dimensions"):
        load_mask(tmp_path / "flat.mat")
    with pytest.raises(BadInput, match="expected four numbers"):
        load_plane(tmp_path / "flat.mat")
