"""The contract of every shipped metric: names, keys, kinds of output, floors, light imports."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import set_samples
from bench.plugins.metric_sets import FULL, metric_set
from bench.plugins.origins import installed
from bench.plugins.registry import registry
from bench.sweep.composition import compose

ROOT = Path(__file__).resolve().parents[2]
METRICS = installed("metric")

BOTH, MESH, CLOUD = {"mesh", "cloud"}, {"mesh"}, {"cloud"}
# The keys of these scores in stored results. A new metric needs no entry: all other tests here query the plugins.
PERCENTILES = ("mean", "p50", "p90", "p95", "p99", "max")
KINDS = {
    "box_scaled_distances": (
        "lower",
        BOTH,
        {
            "chamfer_l1_mean_by_diagonal",
            "hausdorff_by_diagonal",
            "chamfer_l1_mean_by_edge",
            "chamfer_l2_sum_by_diagonal",
            "hausdorff_sq_sum_by_diagonal",
        },
    ),
    "chamfer_l1_mean": ("lower", BOTH, {"chamfer_l1_mean"}),
    "chamfer_l1_point_sum": (
        "lower",
        BOTH,
        {f"{k}@10000" for k in ("chamfer_l1_point_sum", "chamfer_l1_sum_by_edge", "rejection_chamfer_l1_sum_by_edge")},
    ),
    "chamfer_l1_sum": ("lower", BOTH, {"chamfer_l1_sum"}),
    "chamfer_l2_sum": ("lower", BOTH, {"chamfer_l2_sum"}),
    "cot_laplacian": ("lower", MESH, {"cot_laplacian", "cot_laplacian_box", "cot_laplacian_per_area"}),
    "coverage": ("higher", BOTH, {"coverage@1"}),
    "directed": ("lower", BOTH, {f"{d}_{p}" for d in ("to_reference", "to_output") for p in PERCENTILES}),
    "dtu_distances": (
        "lower",
        BOTH,
        {"dtu_accuracy", "dtu_accuracy_median", "dtu_completeness", "dtu_completeness_median", "dtu_overall"},
    ),
    "even_distances": ("lower", CLOUD, {"even_chamfer_l2_sum", "even_hausdorff_sq_sum"}),
    "fscore": ("higher", BOTH, {"fscore@0.01", "precision@0.01", "recall@0.01"}),
    "hausdorff": ("lower", BOTH, {"hausdorff"}),
    "hausdorff_sq_sum": ("lower", BOTH, {"hausdorff_sq_sum"}),
    "inner_surface": ("lower", MESH, {"inner_area", "inner_components"}),
    "iou": ("higher", MESH, {"iou"}),
    "mesh_quality": (
        None,
        MESH,
        {"triangle_radius_ratio", "triangle_min_angle_deg", "triangle_aspect_ratio", "triangle_sliver_share"},
    ),
    "normal_angle_deg": ("lower", BOTH, {"normal_angle_deg"}),
    "normal_angle_oriented_deg": ("lower", BOTH, {"normal_angle_oriented_deg", "normal_flipped_share"}),
    "normal_cosine": ("higher", BOTH, {"normal_cosine", "normal_cosine_oriented"}),
    "normal_cosine_distance": (
        "lower",
        BOTH,
        {"normal_cosine_distance_oriented_mean", "normal_cosine_distance_sum"},
    ),
    "own_sphere_distances": ("lower", BOTH, {"own_sphere_chamfer_l2_sum", "own_sphere_hausdorff_sq_sum"}),
    "p2f_mean": ("lower", BOTH, {"p2f_mean"}),
    "p2f_spread": ("lower", BOTH, {"p2f_rms", "p2f_std", "p2f_max"}),
    "p2m_sq_sum": ("lower", BOTH, {"p2m_sq_sum"}),
    "projected_uniformity": ("lower", CLOUD, {f"projected_uniformity@{s}" for s in (0.004, 0.006, 0.008, 0.01, 0.012)}),
    "recentred_chamfer_l2_sum": ("lower", BOTH, {"recentred_chamfer_l2_sum@5000"}),
    "s2f": ("lower", MESH, {"s2f_mean", "s2f_rms", "s2f_max"}),
    "sampled_distances": (
        "lower",
        BOTH,
        {f"{k}@50000" for k in ("chamfer_l1_mean", "chamfer_l2_sum", "hausdorff", "normal_cosine_distance_sum")},
    ),
    "self_intersections": ("lower", MESH, {"self_intersecting_faces", "self_intersecting_share"}),
    "spacing_variation": ("lower", CLOUD, {"spacing_variation"}),
    "surface_distance_mean": ("lower", MESH, {"surface_distance_mean"}),
    "topology": ("reference", MESH, {"components", "genus", "boundary_edges", "watertight", "flipped_faces"}),
    "uniformity": ("lower", CLOUD, {f"uniformity@{s}" for s in (0.004, 0.006, 0.008, 0.01, 0.012)}),
}


VERSIONS = {"own_sphere_distances": 2}  # of metrics whose scores have changed


@pytest.fixture(scope="module")
def case():
    return made()


def made():
    """A sphere; few samples keep this quick. The source of the deformation is a box, like the output."""
    seen = {
        "obs_mask": np.ones((3, 3, 3), bool),
        "obs_box": np.array([[-9.0] * 3, [9.0] * 3]),
        "obs_step": np.array([9.0]),
    }
    ball = Shape("case", trimesh.creation.icosphere(3), info={"symmetry": "mirror x"}, attributes=seen)
    case = Case("case", {"source": trimesh.creation.box()}, ball)
    set_samples(case, 2000)
    return case


# Small counts for the metrics with a sample count of their own.
QUICK = {
    "chamfer_l1_point_sum": {"samples": 700},
    "dtu_distances": {"thin": 0.05},
    "inner_surface": {"samples": 2000},
    "iou": {"samples": 5000},
    "recentred_chamfer_l2_sum": {"samples": 800},
    "sampled_distances": {"samples": 900},
    "uniformity": {"disks": 100},
}
UNSAID = {name: values for name, values in QUICK.items() if not any("@" in key for key in KINDS[name][2])}  # in keys


def outputs_of(name):
    return set(registry().find("metric", name).options.get("outputs", BOTH))


def scores(output, case, kind, parameters=QUICK):
    plugins = [registry().find("metric", name) for name in METRICS if kind in outputs_of(name)]
    metrics = {p.name: p.cls(**parameters.get(p.name, {})) for p in plugins}
    return {name: metric.score(output, case) for name, metric in metrics.items()}


@pytest.mark.parametrize("name", METRICS)
def test_kinds_of_output_and_version(name):
    plugin = registry().find("metric", name)
    assert type(plugin.options["version"]) is int and plugin.version >= 1
    assert outputs_of(name) and outputs_of(name) <= BOTH


@pytest.mark.parametrize("name", KINDS)
def test_metrics_are_registered_as_declared(name):
    better, outputs, keys = KINDS[name]
    plugin = registry().find("metric", name)
    assert plugin.version == VERSIONS.get(name, 1) and plugin.options["floor"] is True
    assert set(plugin.options["outputs"]) == outputs
    assert better is None or {plugin.better(key) for key in keys} == {better}


def test_standard_is_small_and_full_is_all():
    assert metric_set(FULL) == sorted(f.stem for f in (ROOT / "metrics").glob("[a-z]*.py"))
    assert set(metric_set("standard")) < set(metric_set(FULL)) and len(metric_set("standard")) == 8
    assert metric_set("p2f_mean") is None


@pytest.mark.parametrize(
    ("name", "origin", "in_full"),
    [("of_a_package", "other 1.0", True), ("of_a_file", "/elsewhere/new.py", False), ("of_a_test", "imported", False)],
)
def test_full_is_all_installed_metrics_without_a_list(name, origin, in_full, monkeypatch):
    known = registry().find("metric", "p2f_mean")
    monkeypatch.setitem(registry()._plugins["metric"], name, replace(known, name=name, origin=origin))
    full = sorted([*METRICS, name] if in_full else METRICS)
    assert metric_set(FULL) == sorted(compose(["metric=full"]).metric) == full
    assert sorted(compose([f"metric=[full,{name}]"]).metric) == sorted([*METRICS, name])


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_keys_and_values(kind, case):
    output = {"mesh": trimesh.creation.box(), "cloud": PointCloud(np.eye(3), np.eye(3))}[kind]
    for candidate in (output, case.perfect(output)):
        found = scores(candidate, case, kind, parameters=UNSAID)
        if candidate is not output and kind == "mesh":  # the sphere has other faces than the source
            assert found.pop("cot_laplacian") == {}
            found["cot_laplacian"] = dict.fromkeys(KINDS["cot_laplacian"][2], 0.0)
        if candidate is output and kind == "mesh":  # and the faces of the box from those of the reference
            for name in ("vertex_distance_mean", "pose_distance_mean"):
                assert found.pop(name) == {}
                found[name] = {name: 0.0}
        if kind == "cloud":  # of three points, no disk holds five
            assert found.pop("projected_uniformity") == {}
            found["projected_uniformity"] = dict.fromkeys(KINDS["projected_uniformity"][2], 0.0)
        assert set(found) == {name for name in METRICS if kind in outputs_of(name)}
        for name, values in found.items():
            assert set(values) == (KINDS[name][2] if name in KINDS else {*values} or "some score")
            assert all(type(value) is float and np.isfinite(value) for value in values.values()), values


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_an_empty_output_is_the_worst(kind, case):
    empty = {"mesh": trimesh.Trimesh(), "cloud": PointCloud(np.empty((0, 3)))}[kind]
    bad = {"mesh": trimesh.creation.box(extents=(9, 0.1, 0.1)), "cloud": PointCloud(9 * np.eye(3), -np.eye(3))}[kind]
    worst, usual = scores(empty, case, kind), scores(bad, case, kind)
    for name in usual:
        if name in ("topology", "cot_laplacian", "projected_uniformity"):
            continue
        assert set(worst[name]) == set(usual[name])
        for key, value in worst[name].items():
            assert type(value) is float and not np.isnan(value)
            lower = registry().find("metric", name).better(key) == "lower"
            assert value >= usual[name][key] if lower else value <= usual[name][key], key


def test_equal_seeds_give_equal_scores(case):
    again = made()
    assert scores(trimesh.creation.box(), again, "mesh") == scores(trimesh.creation.box(), case, "mesh")


def test_topology_of_the_reference_is_its_floor(case):
    found = registry().find("metric", "topology").cls().score(case.perfect(trimesh.creation.box()), case)
    assert found == {"components": 1, "genus": 0, "boundary_edges": 0, "watertight": 1, "flipped_faces": 0}


def test_genus_is_left_out_where_it_is_not_defined(case):
    fin = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False
    )
    found = registry().find("metric", "topology").cls().score(fin, case)
    assert found == {"components": 1, "boundary_edges": 6, "watertight": 0, "flipped_faces": 0}


def test_importing_the_metrics_loads_no_heavy_library():
    code = (
        "import sys, pkgutil, importlib, bench.metrics as m, bench.geometry.comparison\n"
        "[importlib.import_module('bench.metrics.' + x.name) for x in pkgutil.iter_modules(m.__path__)]\n"
        "print([x for x in ('trimesh', 'scipy', 'igl', 'pykdtree', 'open3d', 'pandas') if x in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


# Metrics that need not rank the outputs below: perfect, the input itself (0.5 % noise), gross noise.
# They depend on more than the distance to the surface, and are documented so.
BY_DOCUMENT = {
    "spacing_variation": "noise spreads points in space",
    "topology": "counts",
    "inner_surface": "sees only what lies deep inside",
    "cot_laplacian": "has its own source",
}


def spoiled(case, kind, sigma):
    rng = generator("spoiled")
    if kind == "mesh":
        mesh = case.reference.mesh
        return trimesh.Trimesh(mesh.vertices + sigma * rng.normal(size=mesh.vertices.shape), mesh.faces, process=False)
    points, normals = case.reference.surface.sample(3000, rng)
    normals = normals + 10 * sigma * rng.normal(size=points.shape)
    return PointCloud(
        points + sigma * rng.normal(size=points.shape), normals / np.linalg.norm(normals, axis=1)[:, None]
    )


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_doing_nothing_is_better_than_noise_and_worse_than_the_truth(kind, case):
    ladder = [scores(spoiled(case, kind, sigma), case, kind) for sigma in (0.0, 0.005, 0.3)]
    for name in set(ladder[0]) - set(BY_DOCUMENT):
        for key in ladder[0][name]:
            sign = 1 if registry().find("metric", name).better(key) == "lower" else -1
            perfect, nothing, noise = (sign * step[name][key] for step in ladder)
            assert nothing < noise, key
            if name != "uniformity":  # a little noise spreads points
                assert perfect <= nothing + 0.1 * abs(nothing), key  # the tolerance covers sampling


def test_order_of_points_and_faces_does_not_matter(case):
    rng = generator("order")
    cloud = spoiled(case, "cloud", 0.02)
    order = rng.permutation(len(cloud))
    usual, shuffled = (
        scores(cloud, case, "cloud"),
        scores(PointCloud(cloud.points[order], cloud.normals[order]), case, "cloud"),
    )
    for name, values in usual.items():
        assert shuffled[name] == pytest.approx(values, rel=1e-9, abs=1e-12), name
    mesh = spoiled(case, "mesh", 0.02)
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    for name in ("iou", "mesh_quality", "self_intersections", "topology"):  # the others draw other samples
        metric = registry().find("metric", name).cls(**QUICK.get(name, {}))
        assert metric.score(trimesh.Trimesh(mesh.vertices, faces, process=False), case) == pytest.approx(
            metric.score(mesh, case)
        )
