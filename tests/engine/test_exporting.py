"""The inputs of cells as files: one cloud and numbers, with what another program needs to know."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from conftest import TOYS

from bench import PointCloud, generator
from bench.engine import exporting
from bench.engine.exporting import _written, group_of, write
from bench.errors import DetailbenchError
from bench.geometry.io.files import load_cloud
from bench.plan.cell import Cell
from bench.plan.choice import Choice
from bench.plan.limits import Limits
from bench.results.provenance import memory_keys

CLOUD = PointCloud(np.eye(3), normals=np.eye(3), colors=np.ones((3, 3)))


def cell(sensor="samples", split="test"):
    labels = {"task": "upsample", "dataset": "ball", "sensor": sensor}
    return SimpleNamespace(**{k: SimpleNamespace(label=v) for k, v in labels.items()}, split=split, seed=7)


def test_a_case_is_its_cloud_and_its_numbers(tmp_path):
    case = SimpleNamespace(id="ball-000", input={"cloud": CLOUD, "ratio": 4})
    assert _written(case, cell(), tmp_path, "group") == {
        "case": "ball-000",
        "group": "group",
        "input": "group/inputs/ball-000.ply",
        "output": "group/outputs/ball-000.ply",
        "points": 3,
        "normals": True,
        "seed": int(generator(7, "ball-000", "run").integers(2**31)),  # that of the run, for the same noise
        "ratio": 4,
    }
    written = load_cloud(tmp_path / "group" / "inputs" / "ball-000.ply")
    assert np.allclose(written.points, CLOUD.points) and np.allclose(written.normals, CLOUD.normals)
    assert written.colors is None


@pytest.mark.parametrize(
    "inputs", [{"ratio": 4}, {"cloud": CLOUD, "other": CLOUD}, {"cloud": CLOUD, "template": trimesh.creation.box()}]
)
def test_what_is_not_one_cloud_is_refused_before_anything_is_written(tmp_path, inputs):
    with pytest.raises(DetailbenchError, match="task upsample: its input is not a single point cloud"):
        _written(SimpleNamespace(id="a", input=inputs), cell(), tmp_path, "group")
    assert not list(tmp_path.iterdir())


def test_cells_of_one_folder_are_written_one_after_the_other_and_the_list_is_not_left(tmp_path, monkeypatch):
    calls, rows = [], [{"status": "ok"}, {"status": "ok"}, {"status": "error", "message": "no such file"}]

    class Worker:
        def __init__(self, **_):
            pass

        __enter__, __exit__ = lambda self: self, lambda *_: None

        def call(self, function, arguments, limit):
            calls.append(arguments)
            (folder / arguments["group"] / exporting.CASES).write_text('[{"case": "a"}]')
            return rows.pop(0)

    monkeypatch.setattr(exporting, "Isolation", Worker)
    monkeypatch.setattr(exporting, "memory_keys", lambda cell: {})
    one, folder = cell(), tmp_path / "new" / "one"
    one.threads, one.title, one.to_json = 1, "upsample ball", dict
    for _ in range(2):
        assert exporting.export(one, folder, Limits()) == [{"case": "a"}]
        assert [path.name for path in (folder / group_of(one)).iterdir()] == ["outputs"]
    with pytest.raises(DetailbenchError, match="upsample ball: no such file"):
        exporting.export(one, folder, Limits())


def test_each_case_has_a_limit_of_its_own_and_nothing_else_is_left_in_the_folder(tmp_path, plugin_file):
    plugin_file(TOYS)
    names = {"task": "denoise", "dataset": "ball", "sensor": "dots", "method": "identity"}
    ball = Cell(**{kind: Choice.of(kind, {"_name_": name}) for kind, name in names.items()}, metrics=(), cases=2)
    asked = {"cell": ball.to_json(), "folder": str(tmp_path), "group": "g", "keys": memory_keys(ball)}
    events = []
    channel = SimpleNamespace(
        stage="start",
        enter=lambda stage, index: events.append((stage, index)),  # from here, the runner counts the seconds anew
        send=lambda event, row: events.append((event, row["status"])),
    )
    write({"arguments": asked, "memory_gb": 4.0}, channel)
    assert events == [("plan", -1), ("case", 0), ("case", 1), ("result", "ok")]
    files = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())
    assert files == [f"g/{exporting.CASES}", "g/inputs/ball-test-000.ply", "g/inputs/ball-test-001.ply"]


def test_a_folder_is_named_by_what_is_not_usual():
    assert group_of(cell()) == "upsample-ball-samples-seed7"
    assert group_of(cell(sensor="none", split="train")) == "upsample-ball-train-seed7"
