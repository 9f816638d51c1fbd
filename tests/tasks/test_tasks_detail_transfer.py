"""Detail transfer: aligned inputs in one frame, a reference that follows from them, files, and what is refused."""

import re
from itertools import islice

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench import BadInput, InvalidOutput, Run, Shape, ShapePair, UsageError
from bench.authoring.conformance import toy_case
from bench.commands.apply import _task_for
from bench.contract.task import Task
from bench.datasets.reliefs import Reliefs
from bench.geometry.alignment import rotation_between
from bench.geometry.io.files import load_mesh, save
from bench.methods.pseudo.empty import Empty
from bench.methods.pseudo.identity import Identity
from bench.methods.pseudo.noise import Noise
from bench.plugins.registry import registry
from bench.tasks.detail_transfer import DetailTransfer
from bench.tasks.reconstruct import Reconstruct

PAIRS = 3  # a ball to a vase, a vase to a ball, a ring to a ring


@pytest.fixture(scope="module")
def pairs():
    return list(islice(Reliefs(cells=64).pairs("test"), PAIRS))


def cases(dataset, count=PAIRS, **parameters):
    made = DetailTransfer(**parameters).recipes(dataset, None, split="test", count=count, seed=0)
    return [recipe.build() for recipe in made]


@pytest.fixture(scope="module")
def reliefs():
    return cases(Reliefs(cells=64))


class Some:
    """A dataset of given pairs."""

    def __init__(self, *pairs):
        self._pairs = pairs

    def pairs(self, split):
        yield from self._pairs


def turned(shape, R, shift=(0, 0, 0)):
    mesh = Trimesh(shape.mesh.vertices @ R.T + shift, shape.mesh.faces, process=False)
    return Shape(shape.id, mesh, attributes={"base_vertices": shape.attributes["base_vertices"] @ R.T + shift})


def test_the_reference_is_the_target_base_with_the_known_displacement(pairs, reliefs):
    for pair, case in zip(pairs, reliefs, strict=True):
        known = pair.target.attributes
        base, offset = case.input["target_base"], known["displacement"][:, None] * known["base_normals"]
        assert np.abs(base.vertices + offset / case.frame.radius - case.reference.mesh.vertices).max() < 1e-9
        assert np.abs(case.frame.invert(base.vertices) - known["base_vertices"]).max() < 1e-9
        assert np.array_equal(base.faces, case.reference.mesh.faces)
        assert case.reference.is_exact


def test_the_source_has_the_same_displacement_in_the_frame_of_the_target(reliefs):
    for case in reliefs:
        source, base = case.input["source"].vertices, case.input["source_base"].vertices
        heights = np.linalg.norm(source - base, axis=1)
        wanted = np.linalg.norm(case.reference.mesh.vertices - case.input["target_base"].vertices, axis=1)
        assert np.abs(heights - wanted).max() < 1e-9
        assert wanted.max() > 1e-3
        assert np.abs(source.min(axis=0) + source.max(axis=0)).max() < 1e-12


def test_the_reference_is_in_the_one_frame(reliefs):
    for case in reliefs:
        vertices = case.reference.mesh.vertices
        assert np.abs(vertices.min(axis=0) + vertices.max(axis=0)).max() < 1e-12
        assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(1)
        assert re.fullmatch(r"[\w.+-]+", case.id)
        surface, _ = case.reference.surface.closest(vertices[::50])
        assert np.abs(surface - vertices[::50]).max() < 1e-6


def test_source_and_target_are_aligned_though_the_dataset_turns_each(pairs, reliefs):
    for pair, case in zip(pairs, reliefs, strict=True):
        before = rotation_between(pair.source.attributes["base_vertices"], pair.target.attributes["base_vertices"])
        after = rotation_between(case.input["source_base"].vertices, case.input["target_base"].vertices)
        assert np.abs(after - np.eye(3)).max() < 1e-12
        assert np.trace(before) < 2.9, "the dataset's own rotations agree by chance: the test shows nothing"
        # The axis of both bodies is the same one now: their normals agree on the whole.
        source, target = (case.input[name].vertex_normals for name in ("source_base", "target_base"))
        assert np.einsum("ni,ni->n", source, target).mean() > 0.9


def test_a_turned_and_shifted_source_makes_the_same_case(pairs, reliefs):
    pair = pairs[0]
    R, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    R *= np.linalg.det(R)
    (case,) = cases(Some(ShapePair(pair.id, turned(pair.source, R, (5, 6, 7)), pair.target)))
    for name, mesh in case.input.items():
        assert np.abs(mesh.vertices - reliefs[0].input[name].vertices).max() < 1e-9


def test_without_bases_only_the_source_s_is_missing(reliefs):
    (case,) = cases(Reliefs(cells=64), count=1, bases=False)
    assert case.input["source_base"] is None
    for name in ("source", "target_base"):
        assert np.array_equal(case.input[name].vertices, reliefs[0].input[name].vertices)


def test_a_constant_displacement_of_a_ball_is_described_by_its_height():
    ball = icosphere(subdivisions=3)
    shapes = [
        Shape(
            name, Trimesh(1.25 * ball.vertices, ball.faces, process=False), attributes={"base_vertices": ball.vertices}
        )
        for name in "ab"
    ]
    (case,) = cases(Some(ShapePair("balls", *shapes)))
    words = DetailTransfer().describe(case)
    assert words["detail_rms"] == pytest.approx(0.2) and words["detail_max"] == pytest.approx(0.2)
    assert words["detail_thickness"] == pytest.approx(0, abs=1e-3)  # vertex normals of a mesh are not quite radial
    assert case.frame.radius == pytest.approx(1.25)


def test_lazy_cases_make_nothing_before_they_are_requested():
    def explode():
        raise AssertionError

    pair = ShapePair("a", Shape("s", explode), Shape("t", explode))
    (recipe,) = DetailTransfer().recipes(Some(pair), None, split="test", count=3, seed=0)
    assert recipe.id == "a-transfer"


def test_what_cannot_be_transferred_is_refused_by_name(pairs):
    with pytest.raises(UsageError, match="has no pairs"):
        list(DetailTransfer().recipes(object(), None, split="test", count=1, seed=0))
    bare = Shape("bare", icosphere(1), attributes={"weights": np.ones(42)})
    with pytest.raises(UsageError, match=r"bare: has no attribute base_vertices \(it has: weights\)"):
        cases(Some(ShapePair("a", bare, bare)))
    short = Shape("short", icosphere(1), attributes={"base_vertices": np.ones((7, 3))})
    with pytest.raises(BadInput, match=r"short: base_vertices have the shape \(7, 3\)"):
        cases(Some(ShapePair("a", short, short)))
    small, large = (
        Shape(f"s{n}", m, attributes={"base_vertices": m.vertices}) for n, m in enumerate(map(icosphere, (1, 2)))
    )
    with pytest.raises(BadInput, match="ab: the bases have 42 and 162 vertices"):
        cases(Some(ShapePair("ab", small, large)))


# -- pseudo-methods ----------------------------------------------------------------------------------------------------


def test_pseudo_methods_are_where_they_belong(reliefs):
    task, case = DetailTransfer(), reliefs[0]
    bare = task.solve(Identity(), "detail_transfer", dict(case.input), Run())
    noise = task.solve(Noise(), "detail_transfer", dict(case.input), Run())
    for output in (bare, noise):
        task.validate(output, case.input)
    assert bare is not case.input["target_base"] and np.array_equal(bare.vertices, case.input["target_base"].vertices)

    def distance(output):
        pair = case.compare(output)
        return (pair.from_surface.distance.mean() + pair.to_surface.distance.mean()) / 2

    case._cache["samples"] = 2000
    height = task.describe(case)["detail_rms"]
    # The reference's mesh is coarse here, and its samples are of the exact surface.
    assert distance(case.reference.mesh) < 0.1 * height < 0.3 * height < distance(bare) < height < distance(noise)
    with pytest.raises(InvalidOutput, match="got a mesh of 0 vertices"):
        task.validate(task.solve(Empty(), "detail_transfer", dict(case.input), Run()), case.input)


def test_the_toy_keeps_its_word():
    task = DetailTransfer()
    case, again = task.toy(), task.toy()
    assert len(case.reference.mesh.vertices) < 1000
    assert np.array_equal(case.input["source"].vertices, again.input["source"].vertices)
    assert task.describe(case)["detail_max"] > 0.01


def test_the_conformance_kit_takes_a_task_s_own_toy_or_one_cloud_or_none():
    class OverPairs(Task):
        needs_sensor = False

    assert set(toy_case(DetailTransfer(), "toy").input) == {"source", "source_base", "target_base"}
    assert len(toy_case(Reconstruct(), "tiny").input["cloud"]) == 3
    assert toy_case(OverPairs(), "toy") is None


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    """A source of radius 3 far away, its base, and a target base of radius 2 elsewhere."""
    meshes = {
        "source": icosphere(2, 3.0).apply_translation((100, 0, 0)),
        "source_base": icosphere(2, 2.5).apply_translation((100, 0, 0)),
        "target_base": icosphere(3, 2.0).apply_translation((0, -50, 0)),
    }
    for name, mesh in meshes.items():
        save(mesh, tmp_path / f"{name}.ply")
    return {name: str(tmp_path / f"{name}.ply") for name in meshes}


def test_files_are_read_into_the_target_s_frame_and_restored(files):
    task = DetailTransfer()
    inputs, frame = task.read(list(files.values()))
    assert frame.radius == pytest.approx(2) and frame.center == pytest.approx((0, -50, 0))
    radii = [np.linalg.norm(inputs[name].vertices, axis=1) for name in files]
    assert np.allclose(radii[0], 1.5) and np.allclose(radii[1], 1.25) and np.allclose(radii[2], 1)
    back = task.restore(inputs["target_base"], frame)
    assert np.allclose(back.vertices, load_mesh(files["target_base"]).vertices, rtol=0, atol=1e-12)


def test_two_files_are_source_and_target_base(files):
    inputs, frame = DetailTransfer().read([files["source"], files["target_base"]])
    assert inputs["source_base"] is None and frame.radius == pytest.approx(2)
    assert np.allclose(np.linalg.norm(inputs["source"].vertices, axis=1), 1.5)


def test_files_that_cannot_be_used_are_named(files, tmp_path):
    task = DetailTransfer()
    with pytest.raises(UsageError, match="SOURCE SOURCE_BASE TARGET_BASE.*got 1: a.ply"):
        task.read(["a.ply"])
    with pytest.raises(UsageError, match="task.bases=false.*leave .*source_base.ply out"):
        DetailTransfer(bases=False).read(list(files.values()))
    with pytest.raises(BadInput, match="missing.ply: no such file"):
        task.read([files["source"], str(tmp_path / "missing.ply"), files["target_base"]])
    broken = box()
    broken.vertices[:] = np.nan
    save(broken, tmp_path / "broken.ply")
    with pytest.raises(BadInput, match="broken.ply: 8 of 8 vertices are NaN"):
        task.read([files["source"], str(tmp_path / "broken.ply")])


def test_the_number_of_files_tells_the_task(files, shell):
    identity = registry().find("method", "identity")
    assert [_task_for(identity, "out.obj", ["a.ply"] * count, []) for count in (1, 3)] == [
        "reconstruct",
        "detail_transfer",
    ]
    with pytest.raises(UsageError, match="task=deform or task=detail_transfer"):
        _task_for(identity, "out.obj", ["a.ply"] * 2, [])
    done = shell.apply("method=identity", *files.values(), "out.obj")
    assert done.returncode == 0, done.stderr
    assert "source.ply" in done.stdout and "162 vertices, 320 faces; 162 vertices, 320 faces; 642" in done.stdout
    made = load_mesh(shell.work / "out.obj")
    assert np.allclose(made.vertices, load_mesh(files["target_base"]).vertices, rtol=0, atol=1e-12)
