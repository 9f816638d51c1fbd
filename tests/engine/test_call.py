"""One measured call and one score: run, apply, check and score agree, whoever asks."""

import json
import random
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from conftest import TOYS
from trimesh import Trimesh

from bench import PointCloud, generator
from bench.authoring.conformance import LIMIT, _Trials, digest_of, toy_cloud, toy_shape
from bench.contract.case import Case
from bench.contract.shape import Shape
from bench.engine.call import MeasuredCall, score
from bench.engine.isolate import Isolation
from bench.engine.memo import Memo
from bench.engine.meter import Meter
from bench.errors import InvalidOutput
from bench.geometry.io.files import load_cloud
from bench.notices import notice
from bench.plan.cell import Choice
from bench.plugins.registry import registry

PLUGINS = '''
import random
import time
from dataclasses import dataclass

import numpy as np

from bench import PointCloud, notice, register


@register("method")
@dataclass
class Shuffled:
    """The points, in an order in which every seeded generator has a part."""

    ready = False

    def prepare(self):
        random.random(), np.random.random()  # drawn before the seeding: without effect on the call
        time.sleep(0.3)
        self.ready = True

    def denoise(self, cloud, run):
        if not self.ready:
            raise RuntimeError("called before it was prepared")
        run.keep("given", cloud)
        if run.has_truth:
            run.true_distances(np.tile(cloud.points, (50, 1)))
        order = run.rng.permutation(len(cloud))[np.random.permutation(len(cloud))]
        return PointCloud(cloud.points[np.roll(order, random.randrange(len(cloud)))])


@register("metric", version=1, better="lower", floor=True, outputs=("cloud",))
@dataclass(frozen=True)
class Choosy:
    """Refuses what lies on the reference, as the perfect output does."""

    def score(self, output, case):
        if output is case.perfect(output):
            raise RuntimeError("not the perfect one")
        return {"choosy": 1.0}


@register("metric", version=1, better="lower", floor=True)
@dataclass(frozen=True)
class Counting:
    """The number of points or vertices."""

    def score(self, output, case):
        return {"counting": float(len(output.points if hasattr(output, "points") else output.vertices))}


@register("metric", version=1, better="lower", outputs=("cloud",))
@dataclass(frozen=True)
class Remarking:
    """Has something to say."""

    def score(self, output, case):
        notice(f"remarking: {len(output)} points are few")
        return {"remarking": 1.0}
'''


def shuffled(points: np.ndarray, seed: int) -> np.ndarray:
    """What the method of this file returns for a seed: the three generators, seeded by hand."""
    order = generator(seed, "method").permutation(len(points))[np.random.RandomState(seed).permutation(len(points))]
    return points[np.roll(order, random.Random(seed).randrange(len(points)))]


@pytest.fixture(scope="module")
def plugin(tmp_path_factory, plugin_file):
    path = tmp_path_factory.mktemp("plugin") / "ordered.py"
    path.write_text(PLUGINS)
    return plugin_file(path)


@pytest.fixture(scope="module")
def ran(shells, plugin):
    """A shell with the method's results, and the row of its second case."""
    shell = shells("call")
    metrics = "metric=[spread,p2f_mean,chamfer_l1_mean,remarking]"
    done = shell.run("method=shuffled", "outputs=all", metrics, sweep=False, plugins=(TOYS, plugin))
    assert done.returncode == 0, done.stderr
    table = pq.read_table(shell.files()[0])
    return shell, table.to_pylist()[1]


def given(ran):
    """What the method was given in the run."""
    shell, row = ran
    (path,) = json.loads(row["artefacts"])
    return shell.results / path


def test_run_seeds_the_call_and_all_global_generators_by_cell_and_case(ran):
    shell, row = ran
    seed = int(generator(0, row["case"], "run").integers(2**31))
    output = load_cloud(shell.results / row["output"])
    assert np.array_equal(output.points, shuffled(load_cloud(given(ran)).points, seed))


def test_apply_makes_of_the_same_input_and_seed_what_run_made(ran, plugin):
    shell, row = ran
    seed = int(generator(0, row["case"], "run").integers(2**31))
    words = ("apply", "threads=1", "--plugin", plugin, "method=shuffled", "task=denoise", f"seed={seed}")
    done = shell.call(*words, given(ran), "out.ply")
    assert done.returncode == 0, done.stderr
    ours, theirs = load_cloud(shell.work / "out.ply").points, load_cloud(shell.results / row["output"]).points
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)  # it goes through the frame of the input


def test_check_calls_as_run_does(plugin):
    with Isolation((), (str(plugin),)) as isolation:
        trial = _Trials(registry().find("method", "shuffled"), isolation, {}, LIMIT)
        done = trial.run("solve", task="denoise", input="toy")
    assert done["status"] == "ok", done["message"]  # it was prepared
    assert done["digest"] == digest_of(PointCloud(shuffled(toy_cloud("toy").points, 0)))
    assert done["seconds"] < 0.2  # neither preparing nor the true distances are the method's


def test_score_says_of_the_stored_output_what_run_said(ran, plugin):
    shell, row = ran
    (reference,) = shell.results.glob(f"outputs/references/*{row['case']}-*.ply")
    shutil.copy(reference, shell.work / f"{row['case']}.ply")  # the name seeds the samples, as the case's id does
    metrics = "spread,p2f_mean,chamfer_l1_mean,remarking"
    words = ("score", "--plugin", TOYS, "--plugin", plugin, "--json", "--metric", metrics)
    done = shell.call(*words, shell.results / row["output"], f"{row['case']}.ply")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for kind, prefix in (("scores", "score."), ("floors", "floor.")):
        stored = {key.removeprefix(prefix): value for key, value in row.items() if key.startswith(prefix)}
        assert stored and found[kind] == {key: pytest.approx(value, rel=1e-9) for key, value in stored.items()}
    assert found["better"] == json.loads(row["directions"])
    assert row["message"].startswith("remarking: ") and f"note: {row['message']}" in done.stderr


def test_check_scores_as_run_does(plugin):
    """With the floors: a metric that cannot score the perfect output would fail in every run."""
    with Isolation((), (str(plugin),)) as isolation:
        done = _Trials(registry().find("metric", "choosy"), isolation, {}, LIMIT).run("metric")
    assert done["message"] == "RuntimeError: not the perfect one (while scoring choosy)"


def call_of(**values):
    """A measured call that is not made."""
    parts = {
        "inputs": {},
        "meter": Meter(4, "cpu"),
        "task": Choice("task", "denoise"),
        "method": SimpleNamespace(parts=(), build=object),
        "solver": SimpleNamespace(validate=lambda output, inputs: None),
        "spec": {"threads": 1, "seconds": 60.0, "output_points": 3},
        "channel": SimpleNamespace(enter=lambda *_: None, send=lambda *_, **__: None),
    }
    return MeasuredCall(seed=5, **parts | values)


def test_when_a_method_is_called_its_gpu_is_ready_and_every_generator_is_seeded(monkeypatch):
    told = []
    nothing = dict.fromkeys(("synchronize", "reset_peak_memory_stats", "max_memory_allocated"), lambda device: 0)
    cuda = SimpleNamespace(set_device=lambda index: told.append(f"GPU {index}"), **nothing)
    seeds = {name: lambda seed, name=name: told.append(f"{name} {seed}") for name in ("torch", "open3d")}
    torch = SimpleNamespace(cuda=cuda, zeros=lambda *_, **__: None, manual_seed=seeds["torch"])
    open3d = SimpleNamespace(utility=SimpleNamespace(random=SimpleNamespace(seed=seeds["open3d"])))
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "open3d", open3d)
    plugin = SimpleNamespace(require=lambda: told.append("libraries"))
    method = SimpleNamespace(prepare=lambda: told.append("prepared"))
    choice = SimpleNamespace(parts=[plugin], build=lambda: method)
    solver = SimpleNamespace(solve=lambda *_: told.append("called"))
    call_of(method=choice, solver=solver, meter=Meter(4, "cuda:1")).solve()
    assert told == ["libraries", "GPU 1", "prepared", "torch 5", "open3d 5", "called"]


def test_an_output_that_breaks_the_promise_of_its_task_is_refused():
    method = SimpleNamespace(denoise=lambda cloud, run: PointCloud(np.full((3, 3), np.nan)))
    choice = SimpleNamespace(parts=(), build=lambda: method)
    call = call_of(method=choice, solver=Choice("task", "denoise").build(), inputs={"cloud": toy_cloud("toy")})
    with pytest.raises(InvalidOutput, match="3 of 3 points are NaN or infinite"):
        call()


def test_what_a_method_says_is_told_once_also_if_it_fails():
    def solve(method, task, inputs, run):
        run.note("half of it")
        for text in ("half of it", "few points"):
            notice(text)
        raise ArithmeticError

    call = call_of(solver=SimpleNamespace(solve=solve))
    with pytest.raises(ArithmeticError):
        call()
    assert call.columns["message"] == "half of it; few points" and call.columns["seconds"] >= 0


def test_an_intermediate_result_that_breaks_a_promise_has_a_message_and_no_score():
    def solve(method, task, inputs, run):
        run.trace(lambda: PointCloud(np.eye(3)))
        run.trace(PointCloud(np.ones((4, 3))))

    solver = SimpleNamespace(solve=solve, validate=lambda output, inputs: None)
    call = call_of(solver=solver, trace_score=lambda output: {"score.points": len(output)})
    call()
    good, bad = json.loads(call.columns["trace"])
    assert 0 <= good.pop("seconds") <= bad.pop("seconds") and good == {"score.points": 3}
    assert bad == {"message": "returned 4 points, more than limit.output_points=3"}
    unscored = call_of(solver=solver)
    unscored()
    assert "trace" not in unscored.columns


def test_there_is_a_truth_where_the_reference_has_a_face():
    triangle = Trimesh(np.eye(3), [[0, 1, 2]], process=False)
    for reference, has_truth in ((None, False), (PointCloud(np.eye(3)), False), (triangle, True)):
        shape = reference and Shape("toy", reference)
        assert call_of(reference=shape)._new_run().has_truth == has_truth


def test_an_output_may_have_as_many_points_as_the_limit_and_no_more():
    call = call_of()
    call.validate(PointCloud(np.eye(3)))
    call.validate(4)  # neither points nor faces
    for output, said in (
        (PointCloud(np.ones((4, 3))), "returned 4 points, more than limit.output_points=3"),
        (Trimesh(np.ones((4, 3)), [[0, 1, 2]], process=False), "returned 4 vertices, more than"),
        (Trimesh(np.eye(3), [[0, 1, 2]] * 4, process=False), "returned 4 faces, more than"),
    ):
        with pytest.raises(InvalidOutput, match=said):
            call.validate(output)


def test_what_a_metric_raises_names_it(plugin):
    case = Case("toy", {}, toy_shape())
    with pytest.raises(RuntimeError, match="not the perfect one") as caught:
        score([Choice("metric", "choosy")], case.perfect(toy_cloud("toy")), case)
    assert caught.value.__notes__ == ["while scoring choosy"]
    found = score([Choice("metric", "choosy")], toy_cloud("toy"), case, floors=False)
    assert found == ({"choosy": 1.0}, {}, {"choosy": "lower"}, {}) and found.columns == {"score.choosy": 1.0}


def test_a_cached_floor_is_that_of_an_output_of_this_kind_and_size(plugin, tmp_path):
    case = Case("toy", {}, toy_shape(), _memo=Memo(tmp_path))
    triangle = Trimesh(np.eye(3), [[0, 1, 2]], process=False)
    count = len(case.reference.mesh.vertices)
    for output, floor in ((PointCloud(np.eye(3)), 3), (PointCloud(np.ones((4, 3))), 4), (triangle, count)):
        assert score([Choice("metric", "counting")], output, case).floors == {"counting": floor}
