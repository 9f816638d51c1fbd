"""Scores of meshes with defects: vertices that no face uses, spikes, flipped and doubled faces, slivers."""

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.commands.score import _points, read
from bench.engine.call import score
from bench.geometry.comparison import set_samples
from bench.geometry.extents import unlike
from bench.geometry.io.files import save
from bench.geometry.laplacian import cotangent_laplacian, slivers
from bench.plan.cell import Choice
from bench.plugins.metric_sets import metric_set
from bench.plugins.registry import registry

# By name: a plugin that is imported before all others are loaded does not count as an installed one.
Files = registry().find("dataset", "files").cls
BoxScaledDistances = registry().find("metric", "box_scaled_distances").cls
CotLaplacian = registry().find("metric", "cot_laplacian").cls
Directed = registry().find("metric", "directed").cls
Hausdorff = registry().find("metric", "hausdorff").cls
HausdorffSqSum = registry().find("metric", "hausdorff_sq_sum").cls
InnerSurface = registry().find("metric", "inner_surface").cls
Iou = registry().find("metric", "iou").cls
P2fSpread = registry().find("metric", "p2f_spread").cls
S2f = registry().find("metric", "s2f").cls
SampledDistances = registry().find("metric", "sampled_distances").cls
DetailTransfer = registry().find("task", "detail_transfer").cls
Reconstruct = registry().find("task", "reconstruct").cls

BALL = trimesh.creation.icosphere(3)
STRAYS = {
    "behind": ([(50, 50, 50)], []),
    "several": ([(50, 50, 50), (-7, 0, 0)], []),
    "in faces without an area": ([(50, 50, 50)], [(0, 0, 642), (642, 642, 642)]),
}


def mesh_of(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def with_strays(mesh, name):
    vertices, faces = STRAYS[name]
    faces = np.vstack([mesh.faces, np.array(faces, dtype=int).reshape(-1, 3)])
    return mesh_of(np.vstack([mesh.vertices, vertices]), faces)


def noisy(mesh, size=0.01, seed=0):
    moved = np.array(mesh.vertices) + size * generator(seed, "noise").normal(size=mesh.vertices.shape)
    return mesh_of(moved, mesh.faces)


def case_of(mesh, samples=3000, source=None):
    case = Case("case", {} if source is None else {"source": source}, Shape("case", mesh))
    set_samples(case, samples)
    return case


# -- vertices that no face uses ----------------------------------------------------------------------------------------

# Small counts for the metrics with a sample count of their own: scores are compared bit for bit.
FEWER = {"iou": 5000, "chamfer_l1_point_sum": 2000, "sampled_distances": 2000, "inner_surface": 2000}
ALL = [
    Choice.of("metric", {"_name_": name} | ({"samples": FEWER[name]} if name in FEWER else {}))
    for name in metric_set("full")
]


def scores_of(output, reference, source=None):
    kind = "cloud" if isinstance(output, PointCloud) else "mesh"
    shape, frame = Shape("case", reference).framed()
    case = Case("case", {} if source is None else {"source": source}, shape, frame)
    set_samples(case, 2000)
    moved = PointCloud(frame.apply(output.points), output.normals) if kind == "cloud" else None
    moved = moved or mesh_of(frame.apply(output.vertices), output.faces)
    metrics = [m for m in ALL if kind in m.plugin.options.get("outputs", ("mesh", "cloud"))]
    found = score(metrics, moved, case)
    return found.values | {f"floor of {key}": value for key, value in found.floors.items()}


@pytest.fixture(scope="module")
def without_strays():
    """A noisy ball, and its scores."""
    output = noisy(BALL)
    return output, scores_of(output, BALL, source=BALL)


@pytest.mark.parametrize("name", ["behind", "in faces without an area"])
def test_vertices_that_no_face_uses_change_no_score_of_a_mesh(name, without_strays):
    # The source of a deformation has the faces of the output, and so the same strays.
    output, expected = without_strays
    assert len(expected) > 60
    for o, r, s in (
        (output, with_strays(BALL, name), BALL),
        (with_strays(output, name), BALL, with_strays(BALL, name)),
    ):
        found = scores_of(o, r, source=s)
        # Or require the same faces.
        of_all_faces = ("self_intersecting_share", "triangle_", "cot_laplacian", "vertex_distance", "pose_distance")
        for key in expected:
            if name == "behind" or not key.removeprefix("floor of ").startswith(of_all_faces):
                assert found[key] == expected[key], key


def test_vertices_that_no_face_uses_change_no_score_of_a_cloud():
    cloud = PointCloud(noisy(BALL).vertices, np.array(BALL.vertices))
    assert scores_of(cloud, with_strays(BALL, "several")) == scores_of(cloud, BALL)


@pytest.mark.parametrize("name", STRAYS)
def test_vertices_that_no_face_uses_change_neither_frame_nor_overlap(tmp_path, name):
    save(BALL, tmp_path / "ball.ply")
    save(with_strays(BALL, name), tmp_path / "stray.ply")
    for reference in ("ball", "stray"):
        case, output = read(str(tmp_path / "stray.ply"), str(tmp_path / f"{reference}.ply"))
        assert case.frame.radius == pytest.approx(1) and case.frame.center == pytest.approx((0, 0, 0))
        assert not unlike(_points(output), "a", _points(case.reference.mesh), "b")
        far = mesh_of(np.array(BALL.vertices) + 30, BALL.faces)
        hint = unlike(_points(with_strays(far, name)), "a", _points(case.reference.mesh), "b")
        assert hint == "the boxes of a and b do not overlap; are they in the same coordinates?"


def test_a_folder_of_files_with_strays(tmp_path):
    clouds = []
    for name, mesh in (("ball", BALL), ("stray", with_strays(BALL, "several"))):
        save(mesh, tmp_path / name / "mesh.ply")
        dataset = Files(path=str(tmp_path / name))
        found = {}
        for sensor in ("uniform", "outliers_box", "voxel_thinned", "density_gradient", "lidar"):
            parameters = {"azimuth_step": 2.0} if sensor == "lidar" else {}
            plugin = registry().find("sensor", sensor)
            (recipe,) = Reconstruct().recipes(dataset, plugin.cls(**parameters), split="test", count=1, seed=0)
            found[sensor] = recipe.build().input["cloud"].points
        clouds.append(found)
    assert clouds[0].keys() == clouds[1].keys() and len(clouds[0]) == 5
    for name, points in clouds[0].items():
        assert np.array_equal(points, clouds[1][name]), name


def test_details_are_transferred_in_the_same_frames():
    egg = mesh_of(BALL.vertices * (0.8, 0.9, 1.2), BALL.faces)

    class Pairs:
        def __init__(self, change):
            shapes = [
                Shape(name, change(noisy(base, 0.02)), attributes={"base_vertices": np.array(change(base).vertices)})
                for name, base in (("ball", BALL), ("egg", egg))
            ]
            self.pair = type("Pair", (), {"id": "pair", "source": shapes[0], "target": shapes[1]})

        def pairs(self, split):
            yield self.pair

    task = DetailTransfer()
    plain, stray = (
        next(iter(task.recipes(Pairs(change), None, split="test", count=1, seed=0))).build()
        for change in (lambda mesh: mesh, lambda mesh: with_strays(mesh, "behind"))
    )
    for name, mesh in plain.input.items():
        assert np.array_equal(stray.input[name].vertices[:642], mesh.vertices), name
    assert task.describe(stray) == task.describe(plain)
    assert task.expected(stray.input) == task.expected(plain.input)


# -- spikes ------------------------------------------------------------------------------------------------------------

LENGTH = 0.5


def with_needle(mesh, face=7, base=1e-5):
    """The mesh with a spike on one face that no sample hits: its area is a millionth of the whole."""
    V, F = np.array(mesh.vertices), np.array(mesh.faces)
    corners = V[F[face]]
    middle = corners.mean(axis=0)
    foot = middle + base * (corners - middle) / np.linalg.norm(corners - middle, axis=1, keepdims=True)
    tip = middle * (1 + LENGTH / np.linalg.norm(middle))
    a, b, c = F[face]
    d, e, f, t = range(len(V), len(V) + 4)
    ring = [(a, b, e), (a, e, d), (b, c, f), (b, f, e), (c, a, d), (c, d, f), (d, e, t), (e, f, t), (f, d, t)]
    return mesh_of(np.vstack([V, foot, [tip]]), np.vstack([np.delete(F, face, axis=0), ring]))


MAXIMA = {
    "hausdorff": (Hausdorff(), "both"),
    "to_reference_max": (Directed(), "output"),
    "to_output_max": (Directed(), "reference"),
    "p2f_max": (P2fSpread(), "output"),
    "s2f_max": (S2f(), "reference"),
}


@pytest.mark.parametrize("key", MAXIMA)
def test_a_spike_is_the_largest_distance(key):
    metric, side = MAXIMA[key]
    spiky = with_needle(BALL)
    in_output = metric.score(spiky, case_of(BALL))[key]
    in_reference = metric.score(BALL, case_of(spiky))[key]
    # Without the spike, the sample spacing remains; a flat face is a little inside the sphere.
    assert in_output == pytest.approx(LENGTH, rel=0.02) if side != "reference" else in_output < 0.15
    assert in_reference == pytest.approx(LENGTH, rel=0.02) if side != "output" else in_reference < 0.15
    assert metric.score(spiky, case_of(spiky))[key] < 0.15  # a spike on both is no difference


def test_a_cloud_that_lacks_the_spike():
    cloud = PointCloud(BALL.vertices)
    assert Hausdorff().score(cloud, case_of(with_needle(BALL)))["hausdorff"] == pytest.approx(LENGTH, rel=0.02)
    assert Directed().score(cloud, case_of(with_needle(BALL)))["to_output_max"] == pytest.approx(LENGTH, rel=0.02)


def test_means_and_paper_conventions_use_samples_alone():
    spiky, case = with_needle(BALL), case_of(BALL)
    pair = case.compare(spiky)
    assert pair.to_reference.distance.max() < 0.15
    found = Directed().score(spiky, case)
    assert found["to_reference_mean"] == pair.to_reference.distance.mean()
    assert P2fSpread().score(spiky, case)["p2f_rms"] == np.sqrt((pair.to_surface.distance**2).mean())
    assert HausdorffSqSum().score(spiky, case)["hausdorff_sq_sum"] < 2 * 0.15**2
    assert BoxScaledDistances().score(spiky, case)["hausdorff_by_diagonal"] < 0.06
    assert SampledDistances(samples=2000).score(spiky, case)["hausdorff@2000"] < 0.15


def test_maxima_of_meshes_without_spikes_are_those_of_their_samples():
    ball, case = mesh_of(BALL.vertices * 1.01, BALL.faces), case_of(BALL)
    pair = case.compare(ball)
    assert Hausdorff().score(ball, case)["hausdorff"] == max(
        pair.to_reference.distance.max(), pair.to_output.distance.max()
    )


# -- volumes of inconsistently wound faces -----------------------------------------------------------------------------


def flipped(mesh, share, seed=0):
    chosen = generator(seed, "flips").random(len(mesh.faces)) < share
    return mesh_of(mesh.vertices, np.where(chosen[:, None], np.array(mesh.faces)[:, ::-1], mesh.faces))


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_iou_of_flipped_faces(share):
    metric, small = Iou(samples=5000), mesh_of(BALL.vertices * 0.8, BALL.faces)
    expected = metric.score(small, case_of(BALL))
    assert expected["iou"] == pytest.approx(0.8**3, abs=0.03)
    assert metric.score(flipped(small, share), case_of(BALL)) == expected
    assert metric.score(small, case_of(flipped(BALL, share))) == expected
    assert metric.score(flipped(small, share), case_of(flipped(BALL, share, 1))) == expected


def test_iou_of_doubled_faces():
    doubled = mesh_of(BALL.vertices, np.vstack([BALL.faces, BALL.faces[:, ::-1]]))
    assert Iou(samples=2000).score(doubled, case_of(BALL)) == {"iou": 1.0}
    assert Iou(samples=2000).score(BALL, case_of(doubled)) == {"iou": 1.0}


def test_the_reason_for_a_missing_iou_is_reported():
    rng = generator(2)
    sheets = [(x, np.cos(a) * y, np.sin(a) * y) for a in (0, 2, 4) for x in range(12) for y in range(6)]
    corners = [72 * s + 6 * x + y for s in range(3) for x in range(11) for y in range(5)]
    shreds = np.array([f for c in corners for f in ((c, c + 6, c + 1), (c + 1, c + 6, c + 7))])
    band = mesh_of(sheets, np.where((rng.random(len(shreds)) < 0.5)[:, None], shreds[:, ::-1], shreds))
    iou = [Choice.of("metric", {"_name_": "iou", "samples": 5000})]
    for output, reference, reason in (
        (band, BALL, "the output has no inside: its faces are wound inconsistently"),
        (BALL, band, "the reference has no inside"),
        (BALL, mesh_of(BALL.vertices, BALL.faces[3:]), "the reference is not closed"),
    ):
        found = score(iou, output, case_of(reference))
        assert not found.values and reason in found.left_out["iou"]
    assert not score(iou, BALL, case_of(BALL)).left_out


# -- inside ------------------------------------------------------------------------------------------------------------


def with_inner(*meshes):
    return trimesh.util.concatenate([BALL, *meshes])


@pytest.mark.parametrize("radius", [0.3, 0.6])
def test_a_ball_inside_a_ball_is_one_inner_component(radius):
    """Its area is radius^2, whichever way its faces are wound."""
    inner = mesh_of(BALL.vertices * radius, BALL.faces)
    for output in (with_inner(inner), with_inner(flipped(inner, 1.0)), with_inner(flipped(inner, 0.5))):
        found = InnerSurface().score(output, case_of(BALL))
        assert found["inner_area"] == pytest.approx(radius**2, abs=4 * 1.4 * np.sqrt(0.25 / 20_000))
        assert found["inner_components"] == 1


def test_faces_at_the_surface_or_outside_are_not_inner_surface():
    nothing = {"inner_area": 0.0, "inner_components": 0.0}
    for output in (BALL, mesh_of(BALL.vertices * 0.99, BALL.faces), with_inner(mesh_of(BALL.vertices + 5, BALL.faces))):
        assert InnerSurface(samples=3000).score(output, case_of(BALL)) == nothing
    assert InnerSurface(samples=3000, depth=0.0).score(mesh_of(BALL.vertices * 0.99, BALL.faces), case_of(BALL)) == {
        "inner_area": pytest.approx(0.99**2),
        "inner_components": 1,
    }


@pytest.mark.parametrize(("half", "pieces"), [(0.5, 1), (2.0, 0)])
def test_a_plane_inside_a_ball(half, pieces):
    """Two large faces: the part within radius 1 - depth counts as area; a plane that protrudes is not a component."""
    square = mesh_of([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [(0, 1, 2), (0, 2, 3)])
    found = InnerSurface(samples=50_000).score(with_inner(square), case_of(trimesh.creation.icosphere(5)))
    area = min(4 * half**2, np.pi * 0.98**2) / (4 * np.pi)
    assert found["inner_area"] == pytest.approx(area, abs=0.012)
    assert found["inner_components"] == pieces


def test_small_components_are_counted_one_by_one():
    """Even those that no sample hits, and one of unmerged triangles; the wall of a cavity is not inner surface."""
    crumbs = [mesh_of(0.001 * BALL.vertices + (x, 0, 0), BALL.faces) for x in (-0.5, 0.0, 0.5)]
    soup = mesh_of(crumbs[0].triangles.reshape(-1, 3), np.arange(3 * len(BALL.faces)).reshape(-1, 3))
    found = InnerSurface(samples=500).score(with_inner(soup, *crumbs[1:]), case_of(BALL))
    assert found["inner_components"] == 3
    assert found["inner_area"] < 0.01
    hollow = with_inner(flipped(mesh_of(0.5 * BALL.vertices, BALL.faces), 1.0))
    assert InnerSurface(samples=3000).score(hollow, case_of(hollow)) == {"inner_area": 0.0, "inner_components": 0.0}


def test_an_open_reference_has_no_inner_surface():
    metric, opened = InnerSurface(samples=500), mesh_of(BALL.vertices, BALL.faces[3:])
    assert metric.score(BALL, case_of(opened)) == {}
    assert "the reference is not closed" in metric.why_not(BALL, case_of(opened))
    assert metric.why_not(opened, case_of(BALL)) == ""
    assert metric.score(opened, case_of(BALL)) == {"inner_area": 0.0, "inner_components": 0.0}
    for name, value in (("depth", -1.0), ("samples", 0)):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            InnerSurface(**{name: value})


# -- slivers -----------------------------------------------------------------------------------------------------------


def with_sliver(mesh, height, kind):
    """A vertex in one face, at ``height`` above the middle of an edge (cap) or from a corner (needle)."""
    V, F = np.array(mesh.vertices), np.array(mesh.faces)
    a, b, c = F[0]
    start, towards = ((V[a] + V[b]) / 2, V[c]) if kind == "cap" else (V[a], (V[a] + V[b] + V[c]) / 3)
    step = (towards - start) / np.linalg.norm(towards - start)
    m = len(V)
    return mesh_of(np.vstack([V, start + height * step]), np.vstack([F[1:], [(a, b, m), (b, c, m), (c, a, m)]]))


def laplacian_of_noise(mesh):
    return CotLaplacian().score(noisy(mesh, 0.002), case_of(mesh, source=mesh))["cot_laplacian"]


@pytest.mark.filterwarnings("ignore:cot_laplacian")
@pytest.mark.parametrize("kind", ["cap", "needle"])
@pytest.mark.parametrize("height", [0, 1e-15, 1e-9, 1e-6, 1e-4, 1e-3])
def test_a_sliver_of_any_height_changes_little(height, kind):
    assert laplacian_of_noise(with_sliver(BALL, height, kind)) == pytest.approx(laplacian_of_noise(BALL), rel=0.02)


@pytest.mark.filterwarnings("ignore:cot_laplacian")
def test_many_slivers_change_little():
    mesh = BALL
    for _ in range(60):  # the first face is a new one each time
        mesh = with_sliver(mesh, 1e-7, "cap")
    assert slivers(mesh.vertices, mesh.faces).sum() == 60
    assert laplacian_of_noise(mesh) == pytest.approx(laplacian_of_noise(BALL), rel=0.1)


def test_a_warning_reports_slivers_that_are_left_out():
    with pytest.warns(UserWarning, match="1 of the 1282 faces of the source are slivers"):
        laplacian_of_noise(with_sliver(BALL, 1e-8, "cap"))


@pytest.mark.parametrize(
    "mesh",
    [
        BALL,
        trimesh.creation.cylinder(1, 5, sections=2000),
        trimesh.creation.box((1, 1, 1e-3)),
        trimesh.creation.cone(1, 9),
    ],
    ids=["ball", "strips of 1:1600", "plate", "cone"],
)
def test_meshes_made_of_long_faces_have_no_slivers(mesh):
    assert not slivers(mesh.vertices, mesh.faces).any()
    V, F = np.array(mesh.vertices), np.array(mesh.faces)
    dense = np.zeros((len(V), len(V))) if len(V) < 700 else None
    if dense is not None:
        for a, b, c in [tuple(np.roll(f, k)) for f in F for k in range(3)]:
            u, w = V[b] - V[a], V[c] - V[a]
            dense[[b, c], [c, b]] += u @ w / np.linalg.norm(np.cross(u, w)) / 2
        dense -= np.diag(dense.sum(axis=1))
        assert abs(cotangent_laplacian(V, F).toarray() - dense).max() <= 1e-13 * abs(dense).max()
