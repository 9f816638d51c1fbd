"""Pose transfer: problems in one frame, characters without an order, exact truth, files, and what is refused."""

import json

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import BadInput, InvalidOutput, PointCloud, PoseTransfer, Run, Shape, UsageError
from bench.authoring.dataset_checks import correspondence_complaints
from bench.datasets.humanoids import Humanoids
from bench.geometry.io.files import save
from bench.geometry.used import used_vertices
from bench.methods.pseudo.empty import Empty
from bench.methods.pseudo.identity import Identity
from bench.methods.pseudo.noise import Noise
from bench.metrics.pose_distance_mean import PoseDistanceMean
from bench.tasks.pose_transfer import PoseTransfer as Task

PLACES = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 1, 0]])


class Some:
    """A dataset of one problem: a ball that becomes an egg, for balls of other sizes."""

    def transfers(self, split):
        yield problem()


def problem():
    ball = icosphere(subdivisions=2)
    sizes = {"template": 1.0, "template_posed": 1.0, "target": 1.1, "character": 2.0, "character_posed": 2.0}
    shapes = {}
    for name, size in sizes.items():
        high = 1.5 if name in ("template_posed", "target", "character_posed") else 1.0
        mesh = Trimesh(ball.vertices * (size, size, size * high) + (3, 2, 1), ball.faces, process=False)
        shapes[name] = Shape(f"some-{name}", mesh)
    landmarks = {f"at_{k}": np.stack([at + (3, 2, 1), 2 * at + (3, 2, 1)]) for k, at in enumerate(PLACES)}
    return PoseTransfer("some", landmarks=landmarks, **shapes)


def case_of(dataset=None, index=0, seed=0, **parameters):
    task = Task(**{"points": 500} | parameters)
    recipes = list(task.recipes(dataset or Some(), None, split="test", count=index + 1, seed=seed))
    return recipes[index].build()


def middle(points):
    return (points.min(axis=0) + points.max(axis=0)) / 2


@pytest.mark.parametrize("target", ["cloud", "mesh", "corresponding"])
def test_all_is_as_large_as_in_the_frame_of_the_truth_and_around_its_own_centre(target):
    case = case_of(target=target)
    assert case.id == "some-pose" and np.linalg.norm(case.reference.mesh.vertices, axis=1).max() == pytest.approx(1)
    size = 3.0  # half the height of the posed character, its farthest vertex
    given = case.input["target"]
    heights = {
        "source": (used_vertices(case.input["source"]), 4),
        "template": (used_vertices(case.input["template"]), 2),
        "target": (
            given.points if target == "cloud" else used_vertices(given),
            3.3 if target != "corresponding" else 3.0,
        ),
    }
    for name, (points, height) in heights.items():
        assert np.abs(middle(points)).max() < (0.05 if name == "target" and target == "cloud" else 1e-12), name
        assert np.ptp(points[:, 2]) == pytest.approx(height / size, rel=0.03 if target == "cloud" else 1e-9), name
    for k, places in enumerate(case.input["landmarks"].values()):
        np.testing.assert_allclose(places, np.stack([PLACES[k], 2 * PLACES[k]]) / size, atol=1e-12)
    posed = case.reference.attributes["template_posed"]
    np.testing.assert_allclose(np.ptp(posed, axis=0), np.array([2, 2, 3]) / size, rtol=0.06)
    if target == "corresponding":
        assert np.array_equal(given.faces, case.input["template"].faces)
        np.testing.assert_allclose(given.vertices, posed)


def test_indices_of_the_template_mean_nothing_on_the_character():
    """What copies the template's displacements by index is no better than staying at rest."""
    case = case_of(Humanoids(characters="body"), target="corresponding")
    source, template = case.input["source"], case.input["template"]
    copied = source.copy()
    copied.vertices = source.vertices + (case.input["target"].vertices - template.vertices)
    score = PoseDistanceMean().score
    at_rest = score(source, case)["pose_distance_mean"]
    assert score(copied, case)["pose_distance_mean"] > at_rest
    assert score(case.reference.mesh, case) == {"pose_distance_mean": 0.0}
    moved = case.reference.mesh.copy()
    moved.apply_translation((1, 2, 3))
    assert score(moved, case)["pose_distance_mean"] < 1e-12
    assert Task().describe(case)["at_rest"] == pytest.approx(at_rest)


def test_the_truth_has_the_order_of_the_character_and_depends_on_the_seed():
    case, again, other = case_of(), case_of(), case_of(seed=1)
    assert np.array_equal(case.reference.mesh.faces, case.input["source"].faces)
    # The ball's posed character is its character at rest, 1.5 times as high: vertex by vertex.
    low = case.input["source"].vertices * (1, 1, 1.5)
    np.testing.assert_allclose(low, case.reference.mesh.vertices, atol=1e-12)
    assert np.array_equal(case.input["source"].faces, again.input["source"].faces)
    assert not np.array_equal(case.input["source"].faces, other.input["source"].faces)
    assert not np.array_equal(case.input["source"].faces, case.input["template"].faces)


def test_methods_that_know_nothing():
    case, task = case_of(), Task()
    run = Run()
    for method in (Identity(), Noise()):
        task.validate(method.pose_transfer(**case.input, run=run), case.input)
    with pytest.raises(InvalidOutput):
        task.validate(Empty().pose_transfer(**case.input, run=run), case.input)
    assert PoseDistanceMean().score(Empty().pose_transfer(**case.input, run=run), case) == {}
    described = task.describe(case)
    assert described["landmarks"] == 4 and described["target_points"] == 500 and described["at_rest"] > 0.05
    assert "4 landmarks" in task.describe_words(described) and task.describe_words({}) == ""


def test_toy_problems_can_be_solved():
    case = Task().toy()
    score = PoseDistanceMean().score(case.input["source"], case)["pose_distance_mean"]
    assert score > 0.03 and isinstance(case.input["target"], PointCloud) and len(case.input["landmarks"]) == 42


def test_files_and_what_is_wrong_with_them(tmp_path):
    whole = problem()
    paths = [str(tmp_path / name) for name in ("character.obj", "template.ply", "marks.json", "target.ply")]
    for path, name in ((paths[0], "character"), (paths[1], "template"), (paths[3], "target")):
        save(getattr(whole, name).mesh, path)
    (tmp_path / "marks.json").write_text(json.dumps({name: at.tolist() for name, at in whole.landmarks.items()}))
    given, frame = Task().read(paths)
    assert np.ptp(frame.invert(given["source"].vertices)[:, 2]) == pytest.approx(4)
    np.testing.assert_allclose(given["landmarks"]["at_0"] * frame.radius, [PLACES[0], 2 * PLACES[0]], atol=1e-5)
    corresponding, _ = Task(target="corresponding").read(paths)
    assert np.array_equal(corresponding["target"].faces, given["template"].faces)
    Task().save(given["source"], str(tmp_path / "out.obj"), paths)
    assert (tmp_path / "out.obj").read_text().count("\nf ") == len(given["source"].faces)
    with pytest.raises(UsageError, match="CHARACTER TEMPLATE LANDMARKS TARGET; got 1"):
        Task().read(paths[:1])
    save(icosphere(subdivisions=1), paths[3])
    with pytest.raises(BadInput, match="its faces differ from those of the template"):
        Task(target="corresponding").read(paths)
    for text, says in (
        ("no", "is not JSON"),
        ("[]", "expected JSON like"),
        ('{"a": [[0, 0, 1]]}', "a is .*expected JSON like"),
        ('{"a": [[0, 0, "x"], [1, 2, 3]]}', "a is"),
        ('{"a": [[0, 0, NaN], [1, 2, 3]]}', "a is"),
    ):
        (tmp_path / "marks.json").write_text(text)
        with pytest.raises(BadInput, match=f"marks.json: .*{says}"):
            Task().read(paths)
    with pytest.raises(BadInput, match="no.json: cannot be read"):
        Task().read([*paths[:2], str(tmp_path / "no.json"), paths[3]])


def test_parameters_and_datasets_that_do_not_fit():
    for wrong, says in (({"target": "points"}, "target: expected"), ({"points": 3}, "points: expected at least 4")):
        with pytest.raises(ValueError, match=says):
            Task(**wrong)
    with pytest.raises(UsageError, match="no transfers"):
        list(Task().recipes(object(), None, split="test", count=1, seed=0))


def test_problems_that_do_not_correspond_are_found():
    good = problem()
    shapes = {name: getattr(good, name) for name in ("template", "template_posed", "character", "character_posed")}
    assert correspondence_complaints(good, shapes) == []
    shapes["character_posed"] = Shape("other", icosphere(subdivisions=1))
    assert "character and character_posed have other faces" in correspondence_complaints(good, shapes)[0]
    good.landmarks["at_0"] = np.zeros(3)
    assert "the landmark at_0" in correspondence_complaints(good, shapes)[1]
