"""The shapes of cases of stored results."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pictured import PUSHED, cell_of, is_close, meta_of, stored
from records import record, row

from bench import PointCloud
from bench.engine.memo import Memo, RememberedDataset, RememberedSensor
from bench.geometry.io.files import save
from bench.pictures.errors import distances
from bench.pictures.labels import labels
from bench.pictures.shapes import case_of, case_shapes, has_faces, places
from bench.plugins.presets import presets
from bench.plugins.registry import registry
from bench.plugins.schema import build, parameters
from bench.results.provenance import memory_keys
from bench.results.store import Record, Results


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return stored(tmp_path_factory.mktemp("kept"), failing=[("apss", 1)])


def shapes_of(results):
    return [case_shapes([results], place, part) for place, part in places(results.rows())]


def test_inputs_outputs_and_references_are_those_of_the_run(kept):
    results, made = kept
    found = {shapes.place.case: shapes for shapes in shapes_of(results)}
    assert found.keys() == {case.id for case in made}
    for case in made:
        shapes = found[case.id]
        (given,) = shapes.inputs
        assert given.note == "" and np.array_equal(given.shape.points, case.input["cloud"].points)
        assert is_close(shapes.reference.shape.vertices, case.reference.mesh.vertices)
        assert shapes.frame == case.frame and shapes.unit == "radii of the reference"
        assert {item.name for item in shapes.outputs} == set(PUSHED)
        for item in shapes.outputs:
            if item.shape is not None:
                far = distances(item.shape, shapes.reference.shape)
                assert np.median(far) == pytest.approx(PUSHED[item.name], rel=0.1)


def test_what_a_run_left_in_its_cache_is_taken_and_nothing_is_added(tmp_path, monkeypatch):
    results, made = stored(tmp_path, methods=("poisson",), cases=1)
    row, cell = results.rows().iloc[0].to_dict(), cell_of("poisson", cases=1)
    case_of(results, row)
    assert not (tmp_path / ".cache").exists()
    keys, plugin = memory_keys(cell), cell.sensor.plugin
    memo = Memo(tmp_path / ".cache", keys["dataset"])
    sensor = RememberedSensor(cell.sensor.build(), memo.at("sensor", keys["sensor"]), PointCloud)
    dataset = RememberedDataset(cell.dataset.build(), memo)
    (recipe,) = cell.task.build().recipes(dataset, sensor, split="test", count=1, seed=0)
    recipe.build()
    monkeypatch.setattr(plugin.cls, "sense", lambda *_: pytest.fail("the scan was made again"))
    case = case_of(results, row)
    assert np.array_equal(case.input["cloud"].points, made[0].input["cloud"].points)
    assert np.array_equal(case.reference.mesh.vertices, made[0].reference.mesh.vertices)


def test_what_failed_is_a_sentence(kept):
    results, made = kept
    shapes = next(shapes for shapes in shapes_of(results) if shapes.place.case == made[1].id)
    (failed,) = (item for item in shapes.outputs if item.name == "apss")
    assert failed.shape is None and failed.note == "error: ValueError: a wall of bricks"


def test_without_stored_outputs_the_note_says_what_keeps_them(tmp_path):
    results, made = stored(tmp_path, methods=("poisson",), cases=1, keeps=False)
    (shapes,) = shapes_of(results)
    assert shapes.outputs[0].shape is None and "outputs=all" in shapes.outputs[0].note
    assert is_close(shapes.reference.shape.vertices, made[0].reference.mesh.vertices)  # of the case, made again


def test_of_a_strange_record_the_input_is_a_note_and_the_outputs_are_shown(tmp_path):
    results = Results(tmp_path)
    save(PointCloud(np.eye(3)), tmp_path / "outputs/x/y.ply")
    results.write(record(cases=1, output="outputs/x/y.ply"))
    (shapes,) = shapes_of(results)
    assert shapes.inputs[0].shape is None and "cannot be made again" in shapes.inputs[0].note
    assert len(shapes.outputs[0].shape) == 3 and shapes.reference.shape is None and shapes.reference.note


def test_a_damaged_output_is_a_note(kept, tmp_path):
    shutil.copytree(kept[0].folder, tmp_path / "copy")
    results = Results(tmp_path / "copy")
    first = results.output_of(next(r for r in results.rows().to_dict("records") if r["method"] == "rimls"))
    first.write_bytes(first.read_bytes()[:5000])
    notes = [item.note for shapes in shapes_of(results) for item in shapes.outputs if item.name == "rimls"]
    assert sorted("cannot be read" in note for note in notes) == [False, True]


def test_the_header_says_what_a_file_is(tmp_path, kept):
    save(PointCloud(np.eye(3)), tmp_path / "cloud.ply")
    assert not has_faces(tmp_path / "cloud.ply")
    assert all(has_faces(file) for file in (kept[0].folder / "outputs/references").iterdir())


def test_labels_are_those_of_tables():
    def of(*pairs, **values):
        return labels(pd.DataFrame([row(method=m, variant=v, **values) for m, v in pairs]))

    assert of(("jet", "k=9"), ("apss", "")) == ["jet (k=9)", "apss"]
    assert of(("jet", "k=9,a=1"), ("jet", "k=7,a=1"), ("jet", "k=9,a=1")) == ["jet (k=9)", "jet (k=7)", "jet (k=9)"]
    two = pd.DataFrame([row(device="cpu"), row(device="cuda")])
    assert labels(two) == ["jet · cpu", "jet · cuda"]


def test_presets_keep_their_names(tmp_path):
    plugin = registry().find("method", "alpha_wrap")
    preset = presets("method", "alpha_wrap")["alpha_wrap_plain"]
    choice = cell_of("alpha_wrap", parameters=parameters(plugin, build(plugin, preset.values))).method
    cell, mark = replace(cell_of("alpha_wrap", cases=1), method=choice), "0" * 16
    line = row(0, cell.id, mark, task="reconstruct", method="alpha_wrap", variant=choice.variant)
    stored = Record(cell.id, mark, meta_of(cell, mark), [line])
    results = Results(tmp_path)
    results.write(stored)
    rows = results.rows()
    assert choice.variant and set(labels(rows)) == {"alpha_wrap_plain"}
