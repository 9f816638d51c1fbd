"""Deformation: pairs in one frame, targets without an order, references that correspond, files, and what is refused."""

import re
from itertools import islice

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench import BadInput, InvalidOutput, PointCloud, Run, Shape, ShapePair, UsageError
from bench.authoring.conformance import toy_case
from bench.datasets.bumps import Bumps
from bench.datasets.furniture import Furniture
from bench.geometry.io.files import load_mesh, save
from bench.geometry.one_view import depth_points
from bench.geometry.used import used_vertices
from bench.methods.deformation.anisotropic_scaling import AnisotropicScaling
from bench.methods.pseudo.empty import Empty
from bench.methods.pseudo.identity import Identity
from bench.methods.pseudo.noise import Noise
from bench.metrics.chamfer_l2_sum import ChamferL2Sum
from bench.metrics.cot_laplacian import CotLaplacian
from bench.metrics.vertex_distance_mean import VertexDistanceMean
from bench.tasks.deform import Deform

ALIKE, UNLIKE = Furniture(category="table"), Furniture(category="table", same_parts=False)


class Some:
    """A dataset of given pairs."""

    def __init__(self, *pairs):
        self._pairs = pairs

    def pairs(self, split):
        yield from self._pairs


def plain(mesh):
    return Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)


def pair_of(source, target, **options):
    return Some(ShapePair("a", Shape("source", plain(source)), Shape("target", plain(target)), **options))


def case_of(dataset, count=1, seed=0, **parameters):
    parameters = {"points": 500, "vertices": 0} | parameters
    recipes = Deform(**parameters).recipes(dataset, None, split="test", count=count, seed=seed)
    return [recipe.build() for recipe in recipes][-1]


def box_of(mesh):
    return np.ptp(used_vertices(mesh), axis=0)


def middle_of(mesh):
    used = used_vertices(mesh)
    return (used.min(axis=0) + used.max(axis=0)) / 2


# -- cases -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dataset", [ALIKE, UNLIKE], ids=["alike", "unlike"])
@pytest.mark.parametrize("target", ["cloud", "mesh"])
def test_source_and_reference_are_in_the_frame_of_the_target(dataset, target):
    case, pair = case_of(dataset, target=target), next(dataset.pairs("test"))
    assert re.fullmatch(r"[\w.+-]+-deform", case.id) and case.id.startswith(pair.id)
    vertices, source = case.reference.mesh.vertices, case.input["source"]
    assert np.abs(middle_of(case.reference.mesh)).max() < 1e-12 and np.abs(middle_of(source)).max() < 1e-12
    assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(1)
    assert np.abs(case.frame.invert(vertices) - pair.target.mesh.vertices).max() < 1e-12
    given = case.input["target"]
    theirs = np.ptp(given.points, axis=0) if target == "cloud" else box_of(given)
    assert box_of(source).max() == pytest.approx(theirs.max(), rel=1e-12)
    # It is moved and scaled, and nothing else.
    assert np.array_equal(source.faces, pair.source.mesh.faces)
    ours, theirs = ((m.vertices - m.vertices[0]) / box_of(m).max() for m in (source, pair.source.mesh))
    assert np.abs(ours - theirs).max() < 1e-12


def test_without_scaling_the_source_keeps_its_size_beside_the_target():
    case, pair = case_of(ALIKE, scaled=False), next(ALIKE.pairs("test"))
    ratio = box_of(pair.source.mesh) / box_of(pair.target.mesh)
    assert box_of(case.input["source"]) / box_of(case.reference.mesh) == pytest.approx(ratio)
    assert np.abs(middle_of(case.input["source"])).max() < 1e-12


def test_the_cloud_has_points_of_the_surface_and_its_normals():
    case = case_of(ALIKE)
    cloud = case.input["target"]
    assert isinstance(cloud, PointCloud) and len(cloud) == 500
    assert np.abs(np.linalg.norm(cloud.normals, axis=1) - 1).max() < 1e-12
    found = case.reference.surface.project(cloud.points)
    assert found.distance.max() < 1e-9
    along = np.einsum("ni,ni->n", case.reference.surface.normals[found.faces], cloud.normals)
    assert (along > 1 - 1e-9).mean() > 0.99  # but where two parts of the table meet
    assert np.array_equal(case_of(ALIKE).input["target"].points, cloud.points)
    assert not np.array_equal(case_of(ALIKE, seed=1).input["target"].points, cloud.points)


def test_the_mesh_is_the_reference_in_another_order_for_each_seed():
    case, again, other = (case_of(ALIKE, target="mesh", seed=seed) for seed in (0, 0, 1))
    mesh, reference = case.input["target"], case.reference.mesh
    assert not np.array_equal(mesh.vertices, reference.vertices) and not np.array_equal(mesh.faces, reference.faces)
    assert np.array_equal(np.sort(mesh.vertices, axis=0), np.sort(reference.vertices, axis=0))

    def corners(mesh):  # of all triangles, each still running from its first corner
        return np.array(sorted(map(tuple, mesh.triangles.reshape(-1, 9))))

    assert np.array_equal(corners(mesh), corners(reference))
    moved = (mesh.vertices != reference.vertices).any(axis=1)
    assert moved.mean() > 0.99
    for name in ("vertices", "faces"):
        assert np.array_equal(getattr(again.input["target"], name), getattr(mesh, name))
        assert not np.array_equal(getattr(other.input["target"], name), getattr(mesh, name))


class CopiesByIndex:
    """Takes vertex i of the target for vertex i, where there are as many."""

    def deform(self, source, target, run):
        output = source.copy()
        if len(target.vertices) == len(source.vertices):
            output.vertices = target.vertices
        return output


def test_what_is_copied_by_index_is_noise():
    task = Deform(target="mesh", vertices=0)
    case = case_of(ALIKE, target="mesh")
    case._cache["samples"] = 2000

    def scores(method):
        output = task.solve(method, "deform", dict(case.input), Run())
        task.validate(output, case.input)
        metrics = (VertexDistanceMean(), ChamferL2Sum(), CotLaplacian())
        return {key: value for metric in metrics for key, value in metric.score(output, case).items()}

    copied, noise, identity = scores(CopiesByIndex()), scores(Noise()), scores(Identity())
    for key in ("vertex_distance_mean", "chamfer_l2_sum", "cot_laplacian_per_area"):
        assert copied[key] > 0.3 * noise[key] and copied[key] > 2 * identity[key], key
    # With the order that the dataset gave it, the same would have been perfect.
    assert VertexDistanceMean().score(case.reference.mesh, case) == {"vertex_distance_mean": 0.0}


def test_source_and_reference_are_divided_alike():
    bare, case = case_of(ALIKE), case_of(ALIKE, vertices=10_000)
    source, reference = case.input["source"], case.reference.mesh
    assert len(bare.input["source"].vertices) < 10_000 <= len(source.vertices)
    assert np.array_equal(source.faces, reference.faces)
    assert reference.area == pytest.approx(bare.reference.mesh.area) and reference.volume == pytest.approx(
        bare.reference.mesh.volume
    )
    assert np.array_equal(bare.reference.mesh.vertices, reference.vertices[: len(bare.reference.mesh.vertices)])
    apart = VertexDistanceMean()
    assert apart.score(reference, case) == {"vertex_distance_mean": 0.0}
    assert apart.score(source, case)["vertex_distance_mean"] > 0.01
    # The mean of the middles is nearly that of the ends.
    assert apart.score(source, case)["vertex_distance_mean"] == pytest.approx(
        apart.score(bare.input["source"], bare)["vertex_distance_mean"], rel=0.1
    )


def test_of_an_unlike_pair_the_source_alone_is_divided():
    bare, case = case_of(UNLIKE), case_of(UNLIKE, vertices=10_000)
    assert len(case.input["source"].vertices) >= 10_000
    assert np.array_equal(case.reference.mesh.faces, bare.reference.mesh.faces)
    assert VertexDistanceMean().score(case.input["source"], case) == {}
    assert ChamferL2Sum().score(case.input["source"], case)["chamfer_l2_sum"] > 0


@pytest.mark.parametrize("least", [5, 8, 9, 20, 21, 26, 56, 57, 1000])
def test_there_are_at_least_as_many_vertices_as_asked_for(least):
    holed = Trimesh(box().vertices, box().faces[:9], process=False)
    two = trimesh.util.concatenate([holed, box()])
    for mesh in (two, Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)):
        mesh = plain(mesh)
        source = case_of(pair_of(mesh, icosphere(1), corresponding=False), vertices=least).input["source"]
        assert len(source.vertices) >= least
        # And one division less would not have been enough.
        coarser = mesh
        while len(coarser.faces) * 4 < len(source.faces):
            coarser = coarser.subdivide()
        assert len(source.faces) == len(mesh.faces) or len(coarser.vertices) < least


def test_too_many_divisions_are_refused():
    flat = Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(BadInput, match="the source has 3 vertices; subdividing it to 200000 takes too many rounds"):
        case_of(pair_of(flat, flat), vertices=200_000)


def test_laplacians_are_scored_against_the_source():
    case, metric = case_of(ALIKE), CotLaplacian()
    assert set(metric.score(case.input["source"], case).values()) == {0.0}
    scaled = AnisotropicScaling().deform(**case.input, run=Run())
    truth = metric.score(case.reference.mesh, case)
    for key, value in metric.score(scaled, case).items():
        assert 0 < value < 10 * truth[key]


def test_vertices_without_faces_are_kept_and_have_no_part_in_frames():
    ball, egg = icosphere(2), icosphere(2)
    egg.vertices *= (1, 2, 1)
    ball, egg = (Trimesh(np.vstack([m.vertices, [[50, 0, 0]]]), m.faces, process=False) for m in (ball, egg))
    case = case_of(pair_of(ball, egg), target="mesh")
    source = case.input["source"]
    assert len(source.vertices) == 163 and Deform().expected(case.input) == 162
    assert box_of(source) == pytest.approx(np.array([2, 2, 2]), rel=0.05)
    assert np.abs(middle_of(source)).max() < 1e-12
    Deform().validate(AnisotropicScaling().deform(**case.input, run=Run()), case.input)


def test_a_depth_image_sees_one_side_and_its_mirror_image_completes_it():
    ball, bump = icosphere(subdivisions=3), icosphere(subdivisions=2, radius=0.2)
    bump.apply_translation((-0.9, 0, 0))  # on the right side of the ball, which the camera does not see
    seen = depth_points(ball + bump)
    assert len(seen) > 10_000 and np.abs(np.linalg.norm(seen.points, axis=1) - 1).max() < 0.02
    camera = 3 * np.array([0.539, -0.770, 0.342])
    assert (np.einsum("na,na->n", seen.normals, camera - seen.points) > 0).all()
    assert np.einsum("na,a->n", seen.points, camera / 3).min() > 1 / 3 - 0.07  # to the horizon, of flat faces
    case = case_of(pair_of(ball, ball + bump), target="depth", points=4000)
    given = case.input["target"].points
    flipped = cKDTree(given).query(given * (-1, 1, 1))[0]
    assert len(given) == 4000 and np.median(flipped) < 0.05 and case.input["target"].normals is not None


def test_the_input_is_described():
    case = case_of(ALIKE)
    count, faces = len(case.input["source"].vertices), len(case.input["source"].faces)
    described = Deform().describe(case)
    assert described == {"source_vertices": count, "source_faces": faces, "target_points": 500}
    assert Deform().describe_words(described) == (
        f"sources of {count:,} vertices; targets are clouds of 500 points (medians of the cases)."
    )
    meshes = Deform(target="mesh").describe(case_of(ALIKE, target="mesh"))
    assert f"targets are meshes of {count:,} vertices" in Deform().describe_words(meshes)
    assert Deform().describe_words({}) == ""


def test_parameters_and_datasets_that_do_not_fit():
    for wrong, says in (
        ({"target": "points"}, "target: expected cloud, mesh or depth, got 'points'"),
        ({"points": 3}, "points: expected at least 4, got 3"),
        ({"vertices": -1}, "vertices: expected 0 to 200000, got -1"),
        ({"vertices": 200_001}, "vertices: expected 0 to 200000, got 200001"),
    ):
        with pytest.raises(ValueError, match=says):
            Deform(**wrong)
    with pytest.raises(UsageError, match="task deform: this dataset has no pairs"):
        list(Deform().recipes(Bumps(), None, split="test", count=1, seed=0))


def test_a_source_that_is_no_surface_is_named():
    bad = Trimesh(np.eye(3), np.empty((0, 3), dtype=int), process=False)
    with pytest.raises(BadInput, match="source: has 3 vertices but no faces"):
        case_of(Some(ShapePair("a", Shape("source", bad), Shape("target", box()))))
    with pytest.raises(BadInput, match="target: has 3 vertices but no faces"):
        case_of(Some(ShapePair("a", Shape("source", box()), Shape("target", bad))))


# -- outputs -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    """A case with a source of 642 vertices."""
    return Deform().toy()


def changed(mesh, vertices=None, faces=None):
    return Trimesh(
        mesh.vertices if vertices is None else vertices, mesh.faces if faces is None else faces, process=False
    )


def test_faces_of_outputs_must_be_those_of_the_source(small):
    task, source = Deform(), small.input["source"]
    task.validate(changed(source, source.vertices * 0.5), small.input)
    faces = np.array(source.faces)
    swapped = faces.copy()
    swapped[[0, 1]] = swapped[[1, 0]]
    for output in (
        changed(source, faces=faces[:, ::-1]),
        changed(source, faces=faces[:, [1, 2, 0]]),
        changed(source, faces=swapped),
        changed(source, faces=faces[1:]),
        changed(source, faces=np.vstack([faces, faces[:1]])),
        changed(source, np.vstack([source.vertices, np.zeros((1, 3))])),
        icosphere(2),
    ):
        with pytest.raises(
            InvalidOutput, match=r"faces of the source, in order.*; got \d+ vertices and \d+ faces that"
        ):
            task.validate(output, small.input)


def test_outputs_must_be_finite_meshes(small):
    task, source = Deform(), small.input["source"]
    broken = source.vertices.copy()
    broken[3] = np.nan
    for output, says in (
        (changed(source, broken), "1 of 642 vertices are NaN or infinite"),
        (changed(source, 0 * source.vertices), "none of its 1280 faces has an area"),
        (PointCloud(source.vertices), "got .*PointCloud"),
        (np.array(source.vertices), r"got numpy.ndarray.* of shape \(642, 3\)"),
    ):
        with pytest.raises(InvalidOutput, match=says):
            task.validate(output, small.input)


def test_pseudo_methods_are_where_they_belong(small):
    task = Deform()

    def of(method):
        output = task.solve(method, "deform", dict(small.input), Run())
        task.validate(output, small.input)
        assert output is not small.input["source"]
        return VertexDistanceMean().score(output, small)["vertex_distance_mean"]

    assert of(AnisotropicScaling()) < of(Identity()) < of(Noise())
    with pytest.raises(InvalidOutput, match="got a mesh of 0 vertices"):
        task.validate(task.solve(Empty(), "deform", dict(small.input), Run()), small.input)
    assert [len(mesh.faces) for mesh in task.hopeless(small)] == [642, 0]


@pytest.mark.parametrize("target", ["cloud", "mesh"])
def test_the_toy_keeps_its_word(target):
    task = Deform(target=target)
    case, again = task.toy(), task.toy()
    assert len(case.reference.mesh.vertices) == len(case.input["source"].vertices) == 642
    assert np.array_equal(case.input["source"].vertices, again.input["source"].vertices)
    assert isinstance(case.input["target"], PointCloud if target == "cloud" else Trimesh)
    assert VertexDistanceMean().score(case.input["source"], case)["vertex_distance_mean"] > 0.05
    assert set(toy_case(task, "toy").input) == {"source", "target"}


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    """A source of radius 3 far away; a target of radii 2, 2 and 4 elsewhere, as a mesh, as its points, with normals."""
    source, target = icosphere(2, 3.0).apply_translation((100, 0, 0)), icosphere(3, 2.0)
    target.vertices = target.vertices * (1, 1, 2) + (0, -50, 0)
    made = {
        "source.ply": source,
        "mesh.ply": target,
        "points.xyz": PointCloud(target.vertices),
        "normals.ply": PointCloud(target.vertices, target.vertex_normals),
    }
    for name, geometry in made.items():
        save(geometry, tmp_path / name)
    return {name: str(tmp_path / name) for name in made}


@pytest.mark.parametrize("name", ["mesh.ply", "points.xyz", "normals.ply"])
def test_files_are_read_into_the_frame_of_the_target(files, name):
    task = Deform(points=400)
    inputs, frame = task.read([files["source.ply"], files[name]])
    assert frame.radius == pytest.approx(4) and frame.center == pytest.approx((0, -50, 0))
    source, target = inputs["source"], inputs["target"]
    assert len(source.vertices) == 162  # files are not divided
    assert np.abs(middle_of(source)).max() < 1e-12
    assert np.ptp(source.vertices, axis=0).max() == pytest.approx(np.ptp(target.points, axis=0).max())
    assert len(target) == (400 if name == "mesh.ply" else 642)
    assert (target.normals is None) == (name == "points.xyz")
    if target.normals is not None:
        assert (np.einsum("ni,ni->n", target.points, target.normals) > 0).all()
    back = task.restore(source, frame)
    assert middle_of(back) == pytest.approx(np.array([0, -50, 0])) and box_of(back).max() == pytest.approx(8, rel=0.02)


def test_a_target_mesh_may_stay_one(files):
    inputs, frame = Deform(target="mesh").read([files["source.ply"], files["mesh.ply"]])
    mesh = load_mesh(files["mesh.ply"])
    assert np.array_equal(inputs["target"].faces, mesh.faces)
    assert np.abs(frame.invert(inputs["target"].vertices) - mesh.vertices).max() < 1e-12
    unscaled, _ = Deform(scaled=False).read([files["source.ply"], files["mesh.ply"]])
    assert box_of(unscaled["source"]) == pytest.approx(box_of(load_mesh(files["source.ply"])) / 4)


def test_files_that_cannot_be_used_are_named(files, tmp_path):
    task = Deform()
    with pytest.raises(UsageError, match="expected the files SOURCE TARGET; got 1: a.ply"):
        task.read(["a.ply"])
    with pytest.raises(UsageError, match="expected the files SOURCE TARGET; got 0: none"):
        task.read([])
    with pytest.raises(BadInput, match="points.xyz: unknown suffix"):
        task.read([files["points.xyz"], files["mesh.ply"]])
    with pytest.raises(BadInput, match="normals.ply: has 642 vertices but no faces"):
        task.read([files["normals.ply"], files["mesh.ply"]])
    with pytest.raises(BadInput, match="missing.ply: no such file"):
        task.read([files["source.ply"], str(tmp_path / "missing.ply")])
    broken = box()
    broken.vertices[:] = np.nan
    save(broken, tmp_path / "broken.ply")
    for paths in ([tmp_path / "broken.ply", files["mesh.ply"]], [files["source.ply"], tmp_path / "broken.ply"]):
        with pytest.raises(BadInput, match="broken.ply: 8 of 8 (vertices|points) are NaN"):
            task.read(list(map(str, paths)))


OBJ = """\
mtllib box.mtl
o Box
v 9 9 9
v 11 9 9
v 11 11 9
v 9 11 9
v 9 9 11
v 11 9 11
v 11 11 11
v 9 11 11
vt 0 0
vt 1 1
vn 0 0 -1
vn 0 0 1
g lids
usemtl wood
f 1/1/1 4/2/1 3/1/1 2/2/1
f -4/1/2 -3/2/2 -2/1/2 -1/2/2
g walls
usemtl iron
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


@pytest.fixture
def painted(tmp_path):
    """A source with all that an OBJ file has, and a target that is three times as high."""
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "box.mtl").write_text("newmtl wood\nnewmtl iron\n")
    (tmp_path / "models" / "box.obj").write_text(OBJ)
    save(box((2, 2, 6)).subdivide(), tmp_path / "target.ply")
    return str(tmp_path / "models" / "box.obj"), str(tmp_path / "target.ply")


def check_painted(path, folder):
    before, after = OBJ.splitlines(), path.read_text().splitlines()
    assert after[0] == f"mtllib {folder}box.mtl"
    assert [line for line in after[1:] if line[:2] != "v "] == [line for line in before[1:] if line[:2] != "v "]
    made = load_mesh(path)
    assert (
        np.abs(made.vertices - load_mesh(path.parent / folder / "box.obj").vertices * (1, 1, 3) + (10, 10, 30)).max()
        < 1e-9
    )


def test_from_obj_to_obj_all_but_coordinates_stays(painted, tmp_path):
    task = Deform(target="mesh")
    inputs, frame = task.read(painted)
    output = task.solve(AnisotropicScaling(), "deform", inputs, Run())
    task.validate(output, inputs)
    task.save(task.restore(output, frame), str(tmp_path / "out.obj"), painted)
    check_painted(tmp_path / "out.obj", "models/")
    task.save(task.restore(output, frame), str(tmp_path / "out.ply"), painted)
    assert len(load_mesh(tmp_path / "out.ply").faces) == 12
    with pytest.raises(BadInput, match="box.obj: has 8 vertices; expected the 162 of the mesh"):
        task.save(icosphere(2), str(tmp_path / "other.obj"), painted)
    task.save(icosphere(2), str(tmp_path / "plain.obj"), [painted[1], painted[1]])  # the source is none
    assert len(load_mesh(tmp_path / "plain.obj").vertices) == 162


def test_apply_writes_the_deformed_source(painted, shell):
    done = shell.apply("method=anisotropic_scaling", "task=deform", "task.target=mesh", *painted, "out.obj")
    assert done.returncode == 0, done.stderr
    assert "box.obj" in done.stdout and "8 vertices, 12 faces" in done.stdout
    check_painted(shell.work / "out.obj", "../models/")


def test_pairs_come_in_the_order_of_the_dataset():
    recipes = list(Deform().recipes(ALIKE, None, split="train", count=3, seed=0))
    assert [r.id for r in recipes] == [f"{p.id}-deform" for p in islice(ALIKE.pairs("train"), 3)]
