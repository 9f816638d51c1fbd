"""Views: the conventions in closed form, what is refused, the rig, and a task over images through every command."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import BadInput, Frame, Shape, Views, generator
from bench.authoring.conformance import toy_views
from bench.datasets.sensors.rig import COLORS, Rig
from bench.geometry.io.files import load_mesh

FILE = Path(__file__).parents[1] / "faults" / "silhouettes.py"
BALL = Shape("ball", icosphere(5)).framed()[0]
K = np.array([[100.0, 0, 64], [0, 100, 48], [0, 0, 1]])


def views(count: int = 3, **changes) -> Views:
    """Random cameras that look anywhere."""
    rng = np.random.default_rng(7)
    rotations = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    given = {
        "images": rng.integers(256, size=(count, 96, 128, 3)).astype(np.uint8),
        "masks": rng.random((count, 96, 128)) < 0.5,
        "extrinsics": np.concatenate([rotations, rng.normal(size=(count, 3, 1))], axis=2),
        "intrinsics": K,
    }
    return Views(**(given | changes))


# -- cameras -----------------------------------------------------------------------------------------------------------


def test_a_known_camera():
    """At (0, 0, -10), looking along z: x is right, y is down, and the middle of the image is the principal point."""
    camera = views(1, extrinsics=[[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 10]]])
    pixels, depth = camera.project(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 2, 10], [0, 0, -20], [0, 0, -10]]))
    assert np.array_equal(pixels[0, :4], [[64, 48], [74, 48], [64, 58], [69, 58]])
    assert np.array_equal(depth[0], [10, 10, 10, 20, -10, 0])
    assert np.isnan(pixels[0, 5]).all()
    assert np.array_equal(camera.centers, [[0, 0, -10]])
    _, directions = camera.rays(0)
    corner = np.array([(0.5 - 64) / 100, (0.5 - 48) / 100, 1])  # the centre of the first pixel
    assert directions[0, 0] == pytest.approx(corner / np.linalg.norm(corner))


def test_projecting_is_what_a_naive_loop_does():
    some, points = views(), np.random.default_rng(0).normal(size=(20, 3))
    pixels, depth = some.project(points)
    for view, (extrinsics, intrinsics) in enumerate(zip(some.extrinsics, some.intrinsics, strict=True)):
        whole = np.vstack([extrinsics, [0, 0, 0, 1]])
        assert some.centers[view] == pytest.approx(np.linalg.inv(whole)[:3, 3])
        for index, point in enumerate(points):
            x = intrinsics @ (whole @ [*point, 1])[:3]
            assert pixels[view, index] == pytest.approx(x[:2] / x[2])
            assert depth[view, index] == pytest.approx(x[2])


def test_pixels_at_are_what_a_naive_loop_finds():
    """Of random points, many of which no image shows; a camera's own centre has no pixel."""
    some = views()
    points = np.vstack([np.random.default_rng(1).normal(size=(200, 3)), some.centers])
    rows, columns, shown = some.pixels_at(points)
    pixels, depth = some.project(points)
    for view in range(len(some)):
        for index in range(len(points)):
            x, y = pixels[view, index]
            seen = depth[view, index] > 0 and 0 <= x < 128 and 0 <= y < 96
            assert shown[view, index] == seen
            assert (rows[view, index], columns[view, index]) == ((int(y), int(x)) if seen else (0, 0))
    assert 0.1 < shown.mean() < 0.9
    assert rows.dtype == columns.dtype == np.int64


def test_unprojecting_and_rays_are_the_inverse_of_projecting():
    skewed = np.repeat(K[None], 3, axis=0)
    skewed[:, 0, 1], skewed[:, 1, 1] = (0, 3, -5), (100, 90, 110)
    some, points = views(intrinsics=skewed), np.random.default_rng(0).normal(size=(20, 3))
    pixels, depth = some.project(points)
    for view in range(3):
        assert some.unproject(view, pixels[view], depth[view]) == pytest.approx(points)
        origins, directions = some.rays(view)
        assert origins.shape == directions.shape == (96, 128, 3)
        assert np.linalg.norm(directions, axis=-1) == pytest.approx(np.ones((96, 128)))
        again, along = some.project((origins + 2.5 * directions).reshape(-1, 3))
        columns, rows = np.meshgrid(np.arange(128) + 0.5, np.arange(96) + 0.5)
        assert again[view].reshape(96, 128, 2) == pytest.approx(np.stack([columns, rows], axis=-1))
        assert (along[view] > 0).all()


def test_views_in_another_frame_see_the_same():
    frame, some, points = Frame((1.0, -2, 0.5), 3.0), views(), np.random.default_rng(0).normal(size=(20, 3))
    (pixels, depth), (again, shrunk) = some.project(points), some.in_frame(frame).project(frame.apply(points))
    assert again == pytest.approx(pixels) and shrunk == pytest.approx(depth / 3)
    assert some.in_frame(frame).centers == pytest.approx(frame.apply(some.centers))


def test_arrays_and_back_and_nothing_can_be_changed():
    lights = {"light_directions": np.tile([[[0, 0.6, 0.8]]], (3, 2, 1)), "light_colors": np.ones((3, 2, 3))}
    for some in (views(), views(**lights, ambient=np.full((3, 3), 0.1))):
        again = Views.of(some.arrays())
        assert all(np.array_equal(array, again.arrays()[name]) for name, array in some.arrays().items())
        assert again.arrays().keys() == some.arrays().keys()
    assert len(again) == 3 and (again.height, again.width) == (96, 128) and "2 lights" in repr(again)
    with pytest.raises(ValueError, match="read-only"):
        again.images[0] = 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"images": np.zeros((3, 96, 128), np.uint8)},
            r"images: expected .*\(views, height, width, 3\), got \(3, 96, 128\)",
        ),
        ({"images": np.zeros((3, 96, 128, 3))}, "images: expected uint8, 0 to 255, got float64"),
        ({"masks": np.zeros((3, 96, 127), bool)}, r"masks: expected .*\(3, 96, 128\)"),
        ({"masks": np.zeros((3, 96, 128))}, "masks: expected bool, got float64"),
        ({"extrinsics": np.zeros((3, 4, 4))}, r"extrinsics: expected .*\(3, 3, 4\), got \(3, 4, 4\)"),
        ({"extrinsics": np.zeros((3, 3, 4))}, "extrinsics: view 0: the first three columns are not a rotation"),
        ({"extrinsics": np.tile(np.diag([1, 1, -1, 0])[:3], (3, 1, 1))}, "view 0: .* not a rotation"),
        ({"extrinsics": np.full((3, 3, 4), np.nan)}, "extrinsics: view 0 has numbers that are NaN"),
        ({"intrinsics": np.eye(4)}, r"intrinsics: expected an array of shape \(3, 3\) or \(3, 3, 3\)"),
        ({"intrinsics": -K}, "intrinsics: view 0: expected .*positive focal lengths"),
        ({"light_directions": np.ones((3, 1, 3))}, "light_directions and light_colors belong together"),
        (
            {"light_directions": np.ones((3, 1, 3)), "light_colors": np.ones((3, 1, 3))},
            "light_directions: view 0: a direction is not of unit length",
        ),
        (
            {"light_directions": np.tile([[[0, 0, 1.0]]], (3, 1, 1)), "light_colors": -np.ones((3, 1, 3))},
            "light_colors: view 0: expected intensities of 0 or more",
        ),
        ({"ambient": np.ones(3)}, r"ambient: expected an array of shape \(3, 3\)"),
    ],
)
def test_what_are_no_views_is_refused(changes, words):
    with pytest.raises(BadInput, match=words):
        views(**changes)


# -- images of a ball, against rays that meet it in closed form --------------------------------------------------------


def ball_hits(some: Views, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Of all pixels: the squared distance of the ray from the origin, and where it first meets the unit ball."""
    origins, directions = some.rays(view)
    along = -np.einsum("hwi,hwi->hw", origins, directions)
    squared = (origins**2).sum(axis=-1) - along**2
    return squared, origins + (along - np.sqrt(np.maximum(1 - squared, 0)))[..., None] * directions


def shaded(some: Views, view: int, normals: np.ndarray) -> np.ndarray:
    """What the documented formula makes of normals (h, w, 3)."""
    light = np.maximum(np.einsum("hwi,ki->hwk", normals, some.light_directions[view]), 0) @ some.light_colors[view]
    return 255 * np.clip(light + (0 if some.ambient is None else some.ambient[view]), 0, 1)


def test_the_toy_views_are_of_the_unit_ball():
    some = toy_views()
    for view in range(len(some)):
        squared, normals = ball_hits(some, view)
        assert np.array_equal(some.masks[view], squared < 1)
        expected = np.where(some.masks[view][..., None], shaded(some, view, normals), 0)
        assert np.abs(some.images[view] - expected).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("placement", ["sphere", "random", "turntable"])
def test_the_rig_sees_a_ball_as_the_formulas_say(placement):
    rig = Rig(views=4, resolution=64, placement=placement, distance=2.0, normals="smooth")
    some = rig.sense(BALL, generator(0))
    assert np.linalg.norm(some.centers, axis=1) == pytest.approx(2)
    for view in range(4):
        squared, normals = ball_hits(some, view)
        near = np.abs(squared - 1) < 0.02  # the mesh is a polyhedron
        assert np.array_equal(some.masks[view][~near], squared[~near] < 1)
        assert some.masks[view].sum() == pytest.approx(np.pi * 32**2, rel=0.01)  # the ball fills the image
        inner = squared < 0.9
        assert np.abs(some.images[view] - shaded(some, view, normals))[inner].max() < 3
        assert (some.images[view][~some.masks[view]] == 0).all()
    L = some.light_directions
    assert L @ L.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (4, 1, 1)))
    assert L[:, 0] == pytest.approx(some.centers / 2)  # red light comes from behind the camera
    assert np.array_equal(some.light_colors[0], COLORS)


def test_flat_normals_are_those_of_the_triangles():
    """Of a cube with axis-parallel faces at most three colours are seen."""
    from trimesh.creation import box

    some = Rig(views=5, resolution=32).sense(Shape("box", box()).framed()[0], generator(1))
    for view in range(5):
        colors = np.unique(some.images[view][some.masks[view]], axis=0)
        faces = np.eye(3)[:, None] * np.sign(some.centers[view])
        expected = shaded(some, view, faces.sum(axis=1)[None])[0]
        assert all(np.abs(expected - color).max(axis=1).min() <= 0.5 + 1e-6 for color in colors)


def test_both_sides_of_an_open_surface_are_lit():
    square = Trimesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    some = Rig(views=6, resolution=16, ambient=0.0).sense(Shape("square", square).framed()[0], generator(0))
    red = [image[mask][:, 0] for image, mask in zip(some.images, some.masks, strict=True) if mask.any()]
    assert len(red) == 6 and all((values > 0).all() for values in red)
    assert {-1.0, 1.0} == set(np.sign(some.centers[:, 2]))


def test_the_rig_repeats_itself_and_its_exact_normals_are_those_of_the_surface():
    class Up:
        def closest(self, points):
            return points, np.tile([0.0, 0, 1], (len(points), 1))

    exact = Shape("ball", BALL.mesh, surface=Up())
    rig = Rig(views=3, resolution=24, normals="smooth")
    one, again, other = (rig.sense(exact, generator(seed)) for seed in (0, 0, 1))
    assert all(np.array_equal(array, again.arrays()[name]) for name, array in one.arrays().items())
    assert not np.array_equal(one.extrinsics, other.extrinsics)
    for view in range(3):
        assert len(np.unique(one.images[view][one.masks[view]], axis=0)) == 1  # one normal, one colour
    wide = Rig(views=2, resolution=32, field_of_view=90.0).sense(BALL, generator(0))
    assert wide.intrinsics[0, 0, 0] == pytest.approx(16)  # half the width: 45 degrees to each side


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"views": 0}, "views: expected a whole number of at least 1"),
        ({"distance": 1.0}, "distance: expected at least 1.01"),
        ({"field_of_view": 180.0}, "field_of_view: expected 0, or less than 180"),
        ({"placement": "around"}, "placement: expected one of sphere, random, turntable"),
        ({"normals": "exact"}, "normals: expected one of flat, smooth"),
        ({"ambient": 2.0}, "ambient: expected 0 to 1"),
    ],
)
def test_wrong_parameters_of_the_rig_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        Rig(**values)


# -- a task over images, through the commands --------------------------------------------------------------------------

WORDS = ("task=silhouettes", "sensor=logged_rig", "metric=[spread]")
TOYS = FILE.with_name("toys.py")


def run(shell, *words, **options):
    return shell.run(*WORDS, *words, plugins=(TOYS, FILE), **options)


def sensed(shell) -> int:
    return sum(call.startswith("rig") for call in shell.calls())


def test_a_task_over_images_runs_and_its_images_are_made_once(shell):
    plan = shell.call("plan", "--plugin", TOYS, "--plugin", FILE, *WORDS, "dataset=ball", "method=cubes_in_masks")
    assert plan.returncode == 0, plan.stderr
    assert "silhouettes ball logged_rig cubes_in_masks" in plan.stdout
    done = run(shell, "method=cubes_in_masks", "method.grid=20,28", "outputs=first", board=True)
    assert done.returncode == 0, done.stderr
    assert "the shape covers" in done.stdout and "of its images" in done.stdout
    assert sensed(shell) == 2  # two cells of two cases
    again = run(shell, "method=cubes_in_masks", "method.grid=24", sweep=False)
    assert again.returncode == 0, again.stderr
    assert sensed(shell) == 2
    rows = shell.rows()
    assert len(rows) == 6 and (rows["status"] == "ok").all()
    assert abs(rows["score.spread"] - 1).max() < 0.1  # six silhouettes of a ball leave little more than the ball
    board = shell.call("leaderboard", shell.results)
    assert "silhouettes · ball · logged_rig" in board.stdout, board.stderr
    assert "covered=0." in board.stdout  # the task is not installed here, so the values stand without its sentence
    (record, *_) = [path for path in shell.results.glob("outputs/*-*/ball-test-000") if "references" not in str(path)]
    assert {path.name for path in record.iterdir()} == {"first_image.png", "inside.npz", "trace-000.ply"}
    assert load_mesh(record / "trace-000.ply").is_watertight


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("sensor=dots",), r"takes views, but sensor dots gives cloud. Sensors that give views: .*logged_rig.*rig"),
        (("sensor=night",), r"sensor night only degrades views .*sensor=chain 'sensor.steps=\[NAME,night\]'"),
        (("task=denoise", "method=fine"), r"task denoise takes cloud, but sensor logged_rig gives views. .*dots"),
        (("sensor=chain", "sensor.steps=[logged_rig,gaussian]"), "gaussian, works on cloud, .* gives views. .*night"),
        (("sensor=chain", "sensor.steps=[night,night]"), "number 1, night, only degrades views; .*logged_rig"),
        (("sensor=chain", "sensor.steps=[dots,night]"), "night, works on views, but the first step, dots, gives cloud"),
    ],
)
def test_a_sensor_that_does_not_fit_is_refused_when_planned(shell, words, said):
    given = {word.partition("=")[0]: word for word in ("method=cubes_in_masks", "dataset=ball", *WORDS, *words)}
    done = shell.call("plan", "--plugin", TOYS, "--plugin", FILE, *given.values(), f"results={shell.results}")
    assert done.returncode == 1
    assert re.search(said, done.stdout + done.stderr), done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_images_may_be_corrupted_in_a_chain(shell):
    steps = "sensor.steps=[logged_rig,{night:{brightness:0.1}}]"
    done = run(shell, "method=cubes_in_masks", "sensor=chain", steps, "cases=1", "outputs=all", sweep=False)
    assert done.returncode == 0, done.stderr
    (path,) = shell.results.glob("outputs/*/ball-test-000/first_image.png")
    from PIL import Image

    assert 0 < np.asarray(Image.open(path)).max() <= 25


def test_a_run_leaves_out_what_does_not_fit_and_tells_broken_promises(shell):
    done = run(shell, "method=cubes_in_masks", "sensor=logged_rig,dots,liar", "cases=1")
    assert done.returncode == 3, done.stderr
    assert "not planned: task silhouettes takes views, but sensor dots gives cloud" in done.stderr
    rows = shell.rows().set_index("sensor")
    assert rows["status"].to_dict() == {"logged_rig": "ok", "liar": "error"}
    assert "expected a Views from sense(), got float" in rows.loc["liar", "message"]
    alone = run(shell, "method=cubes_in_masks", "sensor=dots", "cases=1", sweep=False)
    assert alone.returncode == 1 and "not planned: task silhouettes takes views" in alone.stderr


def test_check_and_list_know_sensors_and_tasks_of_images(shell):
    names = ("silhouettes", "cubes_in_masks", "logged_rig", "night", "liar")
    done = shell.call("check", "--plugin", FILE, *names, "--json")
    verdicts = {(entry["plugin"], entry["check"]): entry for entry in json.loads(done.stdout)}
    assert {key for key, entry in verdicts.items() if entry["verdict"] == "fail"} == {
        ("sensor liar", "sensor on a toy")
    }
    assert "promises Views; got float" in verdicts["sensor liar", "sensor on a toy"]["detail"]
    for sensor in "logged_rig", "night":
        assert "6 images of 48 x 48" in verdicts[f"sensor {sensor}", "sensor on a toy"]["detail"]
    assert "input views" in verdicts["task silhouettes", "task on a toy"]["detail"]
    assert verdicts["method cubes_in_masks", "silhouettes: toy case"]["verdict"] == "ok"
    assert "gives: views" in shell.call("list", "sensor", "rig").stdout


def test_a_task_over_images_that_reads_no_files_reports_it(shell):
    (shell.work / "images").mkdir()
    done = shell.apply("--plugin", FILE, "method=cubes_in_masks", "images", "out.ply")
    assert done.returncode == 1
    assert "task Silhouettes: cannot be applied to files, because it has no read(paths) for views" in done.stderr
