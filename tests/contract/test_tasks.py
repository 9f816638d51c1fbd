"""What tasks promise, how cases are made, and the one frame."""

import numpy as np
import pytest
import trimesh

from bench import Case, Frame, PointCloud, Shape
from bench.contract.sensors import taken_by
from bench.errors import BadInput, InvalidOutput, UsageError
from bench.ranking.report.inputs import words_of_input
from bench.tasks.denoise import Denoise
from bench.tasks.detail_transfer import DetailTransfer
from bench.tasks.reconstruct import Reconstruct
from bench.tasks.upsample import Upsample

CLOUD = PointCloud(np.eye(3), np.eye(3))


class Balls:
    def shapes(self, split):
        for i in range(5):
            yield Shape(f"ball-{split}-{i}", lambda i=i: ball(2.0 + i, center=(1e6, 0, i)), tags=("smooth",))


class Few:
    def sense(self, shape, rng):
        return PointCloud(*shape.surface.sample(50, rng))


def ball(radius=1.0, center=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(2, radius)
    mesh.vertices += center
    return mesh


def recipes(task, **changes):
    return list(task.recipes(Balls(), Few(), **({"split": "test", "count": 3, "seed": 0} | changes)))


def test_cases_are_in_the_one_frame():
    case = recipes(Denoise())[1].build()
    vertices = case.reference.mesh.vertices
    assert np.allclose(vertices.min(axis=0) + vertices.max(axis=0), 0, atol=1e-9)
    assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(1)
    assert np.allclose(case.frame.invert(vertices), ball(3.0, (1e6, 0, 1)).vertices, atol=1e-8)
    assert case.tags == ("smooth",)


def test_a_case_depends_on_seed_and_shape_alone():
    one, again, other = (recipes(Denoise(), seed=s)[0].build().input["cloud"].points for s in (0, 0, 1))
    assert np.array_equal(one, again) and not np.array_equal(one, other)
    alone = recipes(Denoise(), count=1)[0].build().input["cloud"].points
    assert np.array_equal(one, alone)


def test_lazy_cases_make_nothing_before_they_are_requested():
    class Explosive:
        def shapes(self, split):
            yield Shape("a", lambda: 1 / 0)

    assert [r.id for r in Denoise().recipes(Explosive(), Few(), split="test", count=4, seed=0)] == ["a"]


def test_a_dataset_without_shapes_is_reported():
    with pytest.raises(UsageError, match="has no shapes"):
        list(Denoise().recipes(object(), Few(), split="test", count=1, seed=0))


def mesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0)), faces=((0, 1, 2),)):
    return trimesh.Trimesh(np.array(vertices, dtype=float), np.array(faces).reshape(-1, 3), process=False)


BAD_NORMALS = PointCloud(np.eye(3), 2 * np.eye(3))


@pytest.mark.parametrize(
    ("task", "output", "words"),
    [
        (Denoise(), np.eye(3), "promised a PointCloud.*got numpy.ndarray of shape"),
        (Denoise(), None, "got NoneType"),
        (Denoise(), PointCloud(np.zeros((0, 3))), "got no points"),
        (Denoise(), PointCloud([[0, 0, np.nan], [0, 0, 0]]), "1 of 2 points are NaN"),
        (Denoise(), BAD_NORMALS, "normals are not of unit length"),
        (Denoise(), mesh(), "got trimesh"),
        (Upsample(4), PointCloud(np.ones((11, 3))), "12 points; got 11"),
        (Reconstruct(), CLOUD, "promised a trimesh.Trimesh.*got bench.geometry.cloud.PointCloud"),
        (Reconstruct(), mesh(faces=()), "a mesh of 3 vertices without faces"),
        (Reconstruct(), mesh(vertices=((0, 0, np.inf), (1, 0, 0), (0, 1, 0))), "1 of 3 vertices are NaN or infinite"),
        (Reconstruct(), mesh(faces=((0, 1, 7),)), "vertices that do not exist"),
        (Reconstruct(), mesh(vertices=((0, 0, 0), (1, 0, 0), (2, 0, 0))), "none of its 1 faces has an area"),
    ],
)
def test_broken_promises_are_reported(task, output, words):
    with pytest.raises(InvalidOutput, match=words):
        task.validate(output, {"cloud": CLOUD})


@pytest.mark.parametrize(
    ("task", "output"),
    [(Denoise(), CLOUD), (Upsample(4), PointCloud(np.ones((12, 3)))), (Reconstruct(), mesh())],
)
def test_kept_promises_pass(task, output):
    task.validate(output, {"cloud": CLOUD})


def test_upsample_needs_a_ratio():
    with pytest.raises(ValueError, match="ratio: expected at least 1"):
        Upsample(0)


# -- what a task takes, and what it says of its inputs -----------------------------------------------------------------


def test_what_a_task_takes_is_what_its_sensor_must_give():
    class Images(Denoise):
        takes = "views"

    class OfOldTimes(Denoise):
        needs_sensor = False

    assert [taken_by(task) for task in (Denoise(), Images(), DetailTransfer(), OfOldTimes(), object())] == [
        *("cloud", "views", "none", "none", "cloud")
    ]
    assert Images().input("what the sensor gave") == {"views": "what the sensor gave"}
    with pytest.raises(UsageError, match="no read.paths. for views"):
        Images().read(["a.ply"])


def test_a_task_describes_its_inputs_in_its_own_words():
    cloud = {"points": 5000.0, "rms": 0.02, "rms_inliers": 0.01, "outliers": 0.1, "coverage": 0.98}
    words = words_of_input("upsample[ratio=16]", cloud | {"density_variation": 0.35})
    assert "5,000 points; RMS error 0.01; outliers (> 0.05) 10.0%; coverage 98.0%" in words and "varies by 35%" in words
    assert words_of_input("detail_transfer[bases=False]", {"detail_rms": 0.021, "detail_max": 0.035}).startswith(
        "details"
    )
    assert words_of_input("denoise", {}) == ""


@pytest.mark.parametrize(
    ("task", "medians"),
    [("nobody_has_it", {"noise": 0.01, "views": 24.0}), ("denoise", {"rms": 0.01}), ("denoise", {"odd": 1.0})],
)
def test_without_a_sentence_the_values_are_reported(task, medians):
    values = ", ".join(f"{key}={value:g}" for key, value in medians.items())
    assert words_of_input(task, medians) == f"input, median of the cases: {values}."


# -- nouns -------------------------------------------------------------------------------------------------------------


def test_a_cloud_owns_and_freezes_its_arrays():
    points = np.zeros((2, 3), dtype=np.float32)
    cloud = PointCloud(points)
    points[:] = 1
    assert cloud.points.dtype == np.float64 and not cloud.points.any()
    with pytest.raises(ValueError, match="read-only"):
        cloud.points[0] = 1


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.zeros(3), np.zeros((0,))])
def test_a_cloud_of_another_shape_is_refused(points):
    with pytest.raises(BadInput, match=r"expected an array of shape \(N, 3\)"):
        PointCloud(points)


def test_a_cloud_needs_a_normal_per_point():
    with pytest.raises(BadInput, match="normals: 2 rows for 3 points"):
        PointCloud(np.eye(3), np.eye(3)[:2])


def test_a_frame_and_back():
    points = np.random.default_rng(0).normal(size=(100, 3)) * 5 + 1e6
    frame = Frame.of(points)
    assert np.linalg.norm(frame.apply(points), axis=1).max() == pytest.approx(1)
    assert np.allclose(frame.invert(frame.apply(points)), points, rtol=0, atol=1e-8)
    with pytest.raises(BadInput, match="coincide"):
        Frame.of(np.ones((5, 3)))


def test_a_perfect_output_has_the_kind_and_count_of_the_output():
    shape, frame = Shape("ball", ball()).framed()
    case = Case("ball", {}, shape, frame)
    assert len(case.perfect(PointCloud(np.ones((77, 3))))) == 77
    assert case.perfect(mesh()) is shape.mesh
    assert case.perfect(CLOUD) is case.perfect(PointCloud(np.ones((3, 3))))


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (mesh(faces=()), "no faces"),
        (mesh(vertices=((0, 0, np.nan), (1, 0, 0), (0, 1, 0))), "NaN or infinite"),
        (mesh(vertices=((1, 1, 1),) * 3), "coincide"),
        (mesh(vertices=((0, 0, 0), (1, 0, 0), (2, 0, 0))), "degenerate"),
    ],
)
def test_a_shape_that_is_no_surface_is_refused_by_name(broken, words):
    with pytest.raises(BadInput, match=f"odd: .*{words}"):
        Shape("odd", broken).framed()
