"""Trainings: once, under a lock, resumed to the bit, never on test shapes; their weights in files, cells and tables."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import TOYS, WORDS
from toy_learner import ToyLearner
from trimesh.creation import icosphere

from bench import BadInput, Run, UsageError, fit
from bench.cli import main
from bench.commands.train import job_of
from bench.contract import run as run_module
from bench.engine import again, runner
from bench.engine import training as module
from bench.engine.channel import Channel, read_event
from bench.engine.fitting import Fit, read_curve, read_log, thinned
from bench.engine.forkserver import CannotStart
from bench.engine.trainer import _data, _examples, _fitted, work
from bench.engine.watch import Death
from bench.plan.cell import Cell, Settings
from bench.plan.choice import Choice
from bench.plan.training import Training
from bench.plugins.registry import registry
from bench.plugins.weights import as_bytes, check_fits, content, facts_of, load, shipped
from bench.results.provenance import examples_key, explain, ingredients, weights_of
from bench.results.store import Results

LEARNER = Path(__file__).with_name("toy_learner.py")
OTHER = "{ball: {stretch: 1.5}}"  # whose shapes are not those of the tests
TRAIN = ("method=toy_learner", "training.cases=2", f"training.dataset={OTHER}", "training.threads=1")


@pytest.fixture
def words_of(shell):
    """``detailbench run`` with the toy learner."""
    return lambda *words, **options: shell.run(*TRAIN, *words, plugins=(TOYS, LEARNER), **options)


def train(shell, *words, act=None):
    words = ("train", "--plugin", TOYS, "--plugin", LEARNER, *TRAIN, "sensor=dots", *words, f"results={shell.results}")
    return (act or shell.call)(*words)


def weights_in(shell) -> list[Path]:
    return sorted(shell.results.glob("trainings/*/weights.safetensors"))


def logged(shell) -> list[str]:
    """``examples`` and ``fit``, a line per call, from all processes."""
    log = shell.folder / "learner.log"
    return [line.split()[0] for line in log.read_text().splitlines()] if log.exists() else []


@pytest.fixture(autouse=True)
def learner_log(shell, monkeypatch):
    monkeypatch.setenv("TOY_LEARNER_LOG", str(shell.folder / "learner.log"))


@pytest.fixture(autouse=True, scope="module")
def learner(plugin_file):
    plugin_file(LEARNER)
    plugin_file(TOYS)


# -- once --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("launcher", ["basic", "joblib"])
def test_cells_share_one_training_under_every_launcher(shell, words_of, launcher):
    done = words_of("dataset.stretch=1,2", "method.pause=0.002", launcher=launcher, board=True)
    assert done.returncode == 0, done.stderr
    assert logged(shell) == ["examples", "fit"]
    rows = shell.rows()
    assert len(rows) == 4 and rows["weights"].nunique() == 1
    (path,) = weights_in(shell)
    assert json.loads((path.parent / "about.json").read_text())["title"].startswith("training of toy_learner")
    assert set(rows["weights"]) == {content(path)[:12]}
    assert set(rows["weights_from"]) == {"trained"} and set(rows["train_cases"]) == {1}  # two of one mesh
    assert set(rows["train_steps"]) == {200} and set(rows["train_device"]) == {"cpu"}
    assert (rows["train_seconds"] > rows["seconds"]).all()  # the time of the training is not the method's
    assert "§ toy_learner: trained for" in done.stdout and "weights=trained" in done.stdout
    if launcher == "basic":  # what weights do not depend on is free; variants share their examples
        assert words_of("method.pause=0.002", "method.scale=1.0,0.5", "seed=1").returncode == 0
        assert logged(shell) == ["examples", "fit"]
        assert words_of("method.steps=20").returncode == 0
        assert logged(shell) == ["examples", "fit", "fit"] and len(weights_in(shell)) == 2


FAILURES = {
    "examples": ("error", "the examples cannot be made"),
    "fit": ("error", "the fit cannot be made"),
    "exit": ("crashed", "ended with exit status 3"),
    "nan": ("error", "are not finite"),
}


def test_a_failed_training_fails_each_cell_once_with_one_message(shell, words_of):
    done = words_of(f"method.fail={','.join(FAILURES)}")
    assert done.returncode == 3, done.stderr
    for fail, (status, said) in FAILURES.items():
        rows = shell.rows()
        rows = rows[rows["variant"].str.contains(f"fail={fail}")]
        assert len(rows) == 2 and set(rows["status"]) == {status} and set(rows["stage"]) == {"train"}
        assert len(set(rows["message"])) == 1 and said in rows["message"].iloc[0]
        assert set(rows["case"]) == {"ball-test-000", "ball-test-001"}
    assert logged(shell).count("fit") == 3  # not once a case
    # The next run tries again, once for all cells: what was missing may be there now.
    assert words_of("dataset.stretch=1,2", "method.fail=fit").returncode == 3
    assert logged(shell).count("fit") == 4 and len(shell.rows()) == 10


def test_a_training_that_does_not_end_is_stopped(shell, monkeypatch):
    monkeypatch.setattr(module, "SPARE_SECONDS", 1.0)
    training = Training.of({"cases": 1, "seconds": 0.1, "threads": 1}, choices(fail="hang"))
    begin = time.monotonic()
    with pytest.raises(module.TrainingFailed, match=r"stopped after 1.12 s .*run.seconds_left") as caught:
        settings = Settings(results=str(shell.results), plugins=(str(LEARNER),))
        module.weights_for(training, settings, Results(shell.results))
    assert time.monotonic() - begin < 60
    assert str(caught.value) == caught.value.row["message"]


# -- interrupted -------------------------------------------------------------------------------------------------------


class Killed(BaseException):
    """What a SIGKILL is to a training: nothing after it is done."""


class Life:
    """Dies after so many steps."""

    def __init__(self, steps: int):
        self.left = steps

    def __call__(self, done: int, total: int) -> None:
        self.left -= 1
        if self.left < 0:
            raise Killed


def test_killed_at_any_moment_it_goes_on_to_the_same_weights(tmp_path, monkeypatch):
    """Killed again and again, the weights are those of a training at one go, to the bit; so are log and curve."""
    monkeypatch.setattr(run_module, "CHECKPOINT_SECONDS", 0.0)
    examples, rng, deaths = {"centroids": np.zeros((2, 3))}, np.random.default_rng(0), 0
    fit_of(tmp_path / "whole", steps=150, seed=3).run(examples)
    while not (tmp_path / "fit" / "weights.safetensors").exists():
        try:
            fit_of(tmp_path / "fit", steps=150, seed=3, on_progress=Life(int(rng.integers(5, 60)))).run(examples)
        except Killed:
            deaths += 1
    assert deaths >= 2
    one, other = (load(tmp_path / name / "weights.safetensors") for name in ("fit", "whole"))
    assert (one["shift"] == other["shift"]).all()
    steps = [line["step"] for line in read_log(tmp_path / "fit" / "log.jsonl")]
    assert steps == list(range(150))
    curves = [facts_of(tmp_path / name / "weights.safetensors")["curve"] for name in ("fit", "whole")]
    assert [p[1:] for p in curves[0]] == [p[1:] for p in curves[1]]
    assert not (tmp_path / "fit" / "checkpoint.safetensors").exists()


def fit_of(folder, *, seed=0, seconds=1e6, on_progress=lambda done, total: None, **values) -> Fit:
    return Fit(ToyLearner(**values), folder, {"seed": seed}, seconds=seconds, on_progress=on_progress)


def test_sigkill_of_the_command_leaves_nothing_behind_and_the_same_command_goes_on(shell):
    """The training's process dies with the command; what it had made is used by the next."""
    process = train(shell, "method.pause=0.05", act=shell.start)
    shell.wait_for(lambda: logged(shell) == ["examples", "fit"])
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert shell.left_over() == []
    done = train(shell)
    assert done.returncode == 0, done.stderr
    assert logged(shell) == ["examples", "fit", "fit"]


def test_a_time_that_is_over_ends_the_training_with_what_it_has(tmp_path):
    row = fit_of(tmp_path, steps=10_000, pause=0.01, seconds=0.2).run({"centroids": np.ones((1, 3))})
    assert 1 < row["steps"] < 40 and row["seconds"] >= 0.2
    # The seconds before an interruption count.
    fitted = fit_of(tmp_path / "other", steps=10_000, pause=0.01, seconds=0.2)
    fitted.folder.mkdir()
    arrays = {"shift": np.zeros(3), "step": np.int64(7)}
    facts = {"seconds": 100.0, "cpu_seconds": 5.0, "steps": 7}
    fitted.checkpoint.write_bytes(as_bytes(arrays, facts))
    row = fitted.run({"centroids": np.ones((1, 3))})
    assert row["steps"] == 8 and row["seconds"] >= 100


# -- test shapes are never seen ----------------------------------------------------------------------------------------


def test_a_shape_that_was_trained_on_is_refused_in_a_test(shell, words_of):
    """The balls of the two splits are one mesh under two names."""
    done = words_of("training.dataset=ball")
    assert done.returncode == 3
    rows = shell.rows()
    assert set(rows["status"]) == {"error"} and rows["message"].str.contains("trained on this very shape").all()
    (path,) = weights_in(shell)
    facts = facts_of(path)
    assert len(facts["shapes"]) == 1 and facts["dataset"] == "ball" and facts["seed"] == 0
    # To look at how well it learned is allowed, and is a table of its own.
    assert words_of("training.dataset=ball", "split=train").returncode == 0


def test_training_cases_are_of_the_train_split(monkeypatch):
    training = cell_of({"cases": 3, "dataset": "ball"}).training
    seen = []
    cases = list(_data(training, seen.append).cases)
    assert [case.id for case in cases] == [f"ball-train-00{i}" for i in range(3)] and seen == cases
    assert all("points" in case.input["cloud"].arrays() for case in cases)
    again = list(_data(training, seen.append).cases)
    assert all((a.input["cloud"].points == b.input["cloud"].points).all() for a, b in zip(cases, again, strict=True))
    other = _data(training, seen.append).sense(cases[0], {"samples": {"count": 50}}, np.random.default_rng(0))
    assert len(other.points) == 50


# -- weights -----------------------------------------------------------------------------------------------------------


def choices(**values) -> dict[str, Choice]:
    method = Choice.of("method", {"_name_": "toy_learner", **values})
    of = {kind: Choice.of(kind, {"_name_": name}) for kind, name in (("dataset", "bumps"), ("sensor", "samples"))}
    return {"task": Choice.of("task", {"_name_": "denoise"}), "method": method, **of}


def cell_of(training: dict, **values) -> Cell:
    parts = choices(**values)
    return Cell(**parts, metrics=(), training=Training.of(training, parts))


def file_of(path: Path, shift: float, **parameters) -> Path:
    values = {"steps": 200, "rate": 0.1, "pause": 0.0, "fail": ""} | parameters
    path.write_bytes(as_bytes({"shift": np.full(3, shift)}, {"method": "toy_learner", "parameters": values}))
    return path


def test_a_cell_depends_on_the_content_of_a_file_and_never_on_its_name(tmp_path):
    path = file_of(tmp_path / "a.safetensors", 1.0)
    copy = file_of(tmp_path / "copy.safetensors", 1.0)
    first, same = cell_of({"weights": str(path)}), cell_of({"weights": str(copy)})
    assert first.id == same.id and ingredients(first)["weights"] == content(path)
    assert Cell.from_json(json.loads(json.dumps(first.to_json()))) == first
    time.sleep(0.01)
    file_of(path, 2.0)
    other = cell_of({"weights": str(path)})
    assert other.id != first.id
    then = {**ingredients(first), "weights": content(copy)}
    assert explain(then, ingredients(first)) == [f"other weights: {content(copy)[:12]} -> {content(path)[:12]}"]


def test_trainings_are_named_by_what_they_depend_on():
    usual = cell_of({})
    assert usual.training.weights == "trained" and usual.variant == "weights=trained"
    assert cell_of({}, scale=0.5).training.id == usual.training.id
    for other in (cell_of({"seed": 1}), cell_of({"cases": 3}), cell_of({"dataset": "cad"}), cell_of({}, steps=3)):
        assert other.training.id != usual.training.id and other.id != usual.id
        assert weights_of(other.training) != weights_of(usual.training)
        assert Cell.from_json(json.loads(json.dumps(other.to_json()))) == other
    assert examples_key(cell_of({}, steps=3).training) == examples_key(usual.training)
    assert examples_key(cell_of({"seed": 1}).training) != examples_key(usual.training)
    preset = cell_of({"dataset": "headline", "sensor": {"samples": {"count": 100}}}).training
    assert preset.dataset.name == "mixture" and preset.sensor.parameters["count"] == 100


def test_a_learned_step_of_a_chain_has_the_training_of_the_method_alone():
    parts = choices()
    alone = Training.of({}, parts)
    steps = [{"toy_learner": {"scale": 0.5}}, "jet"]
    chained = Training.of({}, parts | {"method": Choice.of("method", {"_name_": "chain", "steps": steps})})
    assert chained.id == alone.id and weights_of(chained) == weights_of(alone)
    twice = Choice.of("method", {"_name_": "chain", "steps": ["toy_learner", "toy_learner"]})
    with pytest.raises(UsageError, match="2 learned steps"):
        Training.of({}, parts | {"method": twice})


def test_methods_that_do_not_learn_have_cells_as_before():
    parts = choices() | {"method": Choice.of("method", {"_name_": "jet"})}
    cell = Cell(**parts, metrics=(), training=Training.of({"seed": 3}, parts))
    assert cell.training is None and "training" not in cell.to_json()


@pytest.mark.parametrize(
    ("training", "said"),
    [
        ({"weights": "nothing.safetensors"}, "no such file"),
        ({"weights": "shipped"}, "has no shipped weights for these parameters"),
        ({"cases": 0}, "training.cases=0: expected a whole number of at least 1"),
        ({"seconds": -1}, "training.seconds=-1: expected a number above 0"),
        ({"device": "gpu"}, "expected cpu, cuda or cuda:N"),
        ({"dataset": "bump"}, "Did you mean 'bumps'"),
        ({"dataset": {"cad": {"size": 3}}}, "training.dataset"),
        ({"sensor": 3}, "expected a name"),
        ({"stepps": 3}, "no key 'training.stepps'"),
    ],
)
def test_what_makes_no_sense_is_refused_by_its_key(training, said):
    with pytest.raises(UsageError, match=said.replace("(", r"\(").replace(".", r"\.")):
        cell_of(training)


def test_files_that_do_not_fit_are_refused(tmp_path):
    plugin, values = registry().find("method", "toy_learner"), choices()["method"].parameters
    check_fits(plugin, values, file_of(tmp_path / "good.safetensors", 1.0))
    with pytest.raises(BadInput, match=r"trained with steps=3.*method\.steps=3"):
        check_fits(plugin, values, file_of(tmp_path / "steps.safetensors", 1.0, steps=3))
    other = tmp_path / "other.safetensors"
    other.write_bytes(as_bytes({"a": np.ones(2)}, {"method": "jet"}))
    with pytest.raises(BadInput, match="expected weights of toy_learner, but it was trained as jet"):
        check_fits(plugin, values, other)
    bare = tmp_path / "bare.safetensors"
    bare.write_bytes(as_bytes({"a": np.ones(2)}, {}))
    with pytest.raises(BadInput, match="does not say"):
        check_fits(plugin, values, bare)
    for name, text in (("empty", b""), ("cut", other.read_bytes()[:40]), ("text", b"no weights at all, but text")):
        path = tmp_path / name
        path.write_bytes(text)
        with pytest.raises(BadInput, match=name):
            facts_of(path)


def test_damaged_weights_are_trained_again_and_that_is_said(shell):
    assert train(shell).returncode == 0
    (path,) = weights_in(shell)
    expected, whole = load(path), path.read_bytes()
    for damaged in (whole[:-3], whole[:50], b"", whole + b"more"):
        path.write_bytes(damaged)
        with pytest.raises(BadInput):
            facts_of(path)
    done = train(shell)
    assert done.returncode == 0 and done.stderr.count("; moved aside; the method is trained again") == 1
    assert (load(path)["shift"] == expected["shift"]).all() and path.with_suffix(".damaged").exists()
    assert logged(shell) == ["examples", "fit", "fit"]


def test_damaged_examples_are_made_again(tmp_path):
    """Those that are cut off, and those whose header says another shape."""
    training = cell_of({"cases": 1, "dataset": "ball"}).training
    path, said = tmp_path / "examples.safetensors", []
    asked = {"from_examples": "", "examples": str(path)}
    channel = SimpleNamespace(send=lambda event, **values: said.append(event))

    def examples():
        return _examples(training, asked, {"threads": 1}, channel)[0]["centroids"]

    made, whole = examples(), path.read_bytes()
    assert (examples() == made).all() and said == ["progress"]  # those that are there are used
    for damaged in (whole[:-3], whole.replace(b'"shape":[1,3]', b'"shape":[2,3]')):
        assert damaged != whole
        path.write_bytes(damaged)
        assert (examples() == made).all() and path.read_bytes() == whole
    assert said == ["progress"] * 3


def test_weights_survive_a_file_also_as_halves(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {"a": rng.normal(size=(3, 4)).astype(np.float32), "n": np.int64(7), "x": np.float32(0.1)}
    path = tmp_path / "w.safetensors"
    path.write_bytes(as_bytes(arrays, {"seed": 3, "shapes": ["a", "b"]}))
    back = load(path)
    assert all((back[k] == arrays[k]).all() and back[k].shape == np.shape(arrays[k]) for k in arrays)
    assert facts_of(path)["seed"] == 3 and facts_of(path)["shapes"] == ["a", "b"]
    half = tmp_path / "h.safetensors"
    half.write_bytes(as_bytes(arrays, {}, half=True))
    back = load(half)
    assert back["a"].dtype == np.float32 and np.abs(back["a"] - arrays["a"]).max() < 1e-3 and back["n"] == 7


def test_shipped_weights_are_found_by_their_parameters(tmp_path, monkeypatch):
    (tmp_path / "weights").mkdir()
    plugin = replace(registry().find("method", "toy_learner"), file=tmp_path / "toy_learner.py")
    values = choices()["method"].parameters
    assert shipped(plugin, values) is None
    path = file_of(tmp_path / "weights" / "any_name.safetensors", 1.0)
    assert shipped(plugin, values) == path and shipped(plugin, {**values, "scale": 9.0}) == path
    assert shipped(plugin, {**values, "steps": 9}) is None


def test_shipped_weights_that_are_not_there_say_what_to_do(tmp_path):
    training = SimpleNamespace(weights="shipped", shipped=None, method=SimpleNamespace(label="learned"))
    with pytest.raises(UsageError, match="method learned: its shipped weights are missing; install detailbench again"):
        module.known_weights(Results(tmp_path), training)
    training.shipped = file_of(tmp_path / "w.safetensors", 1.0)
    assert module.known_weights(Results(tmp_path), training) == module.Weights.of(training.shipped, "shipped")


def test_a_line_of_a_log_that_was_cut_off_costs_that_line_alone(tmp_path):
    """What goes on after a crash is written below it."""
    path = tmp_path / "log.jsonl"
    lines = ['{"step": 0, "validation": 0.5, "seconds": 1.5}', '{"step": 1, "val', '{"loss": 1}', "3", '{"step": 2}']
    path.write_text("\n".join(lines))
    assert [line["step"] for line in read_log(path)] == [0, 2] and read_log(tmp_path / "none") == []
    assert read_curve(path) == [[1.5, 0, 0.5]]


def test_a_long_curve_is_thinned_and_keeps_its_end():
    curve = [[float(i), i, 1.0 / (i + 1)] for i in range(1000)]
    short = thinned(curve, 400)
    assert len(short) <= 400 and short[-1] == curve[-1] and short == sorted(short)
    assert thinned(curve[:3], 400) == curve[:3] and thinned([], 400) == []


def test_a_run_stores_checkpoints_at_most_once_a_minute():
    stored = []
    run = Run(on_checkpoint=stored.append)
    for _ in range(5):
        run.checkpoint(lambda: {"a": np.ones(1)})
    assert stored == []
    run._stored -= 61
    run.checkpoint(lambda: {"a": np.ones(1)})
    run.checkpoint(lambda: {"a": np.ones(1)})
    assert len(stored) == 1
    Run().checkpoint(lambda: 1 / 0)  # nobody stores: it is not even made


# -- the process that trains ------------------------------------------------------------------------------------------


@pytest.fixture
def trainer(tmp_path):
    """Train as the child process does, but in this one: the events that it sends, the last of which is the result."""

    def run(training: Training, **asked) -> list[dict]:
        reads, writes = os.pipe()
        usual = {"training": training.to_json(), "folder": str(tmp_path), "examples": str(tmp_path / "made")}
        rest = {"from_examples": "", "only_examples": False, "fingerprint": "f", "device": "cpu"}
        with os.fdopen(reads, "rb") as pipe:
            channel = Channel(writes)
            work({"arguments": usual | rest | asked, "threads": 1, "seconds": 100.0}, channel)
            channel._file.close()
            return [read_event(line) for line in pipe]

    return run


def ball_of(**values) -> Training:
    return cell_of({"cases": 1, "dataset": "ball", "sensor": "dots"}, **values).training


def test_a_training_tells_its_stages_and_how_far_each_is(trainer):
    *events, result = trainer(ball_of(steps=2))
    told = [e["stage"] if e["event"] == "begin" else (e["done"], e["total"]) for e in events]
    assert told == ["examples", (1, 1), "method", (1, 2), (2, 2)]
    assert (result["row"]["status"], result["row"]["cases"], result["row"]["steps"]) == ("ok", 1, 2)


def test_a_training_that_needs_a_missing_library_says_how_to_install_it(trainer, monkeypatch):
    training, plugins = ball_of(steps=1), registry()._plugins["sensor"]
    monkeypatch.setitem(plugins, "dots", replace(plugins["dots"], requires=("no_such_library",)))
    row = trainer(training)[-1]["row"]
    assert row["status"] == "skipped" and "pip install no_such_library" in row["message"]


def test_a_dataset_without_train_shapes_is_named_before_a_method_fails_for_want_of_an_array(trainer, monkeypatch):
    training = ball_of(steps=1)
    monkeypatch.setattr(type(training.dataset.build()), "shapes", lambda self, split: iter(()))
    stacked = lambda self, data, run: {"centroids": np.stack([c.input["cloud"].points[0] for c in data.cases])}  # noqa: E731
    monkeypatch.setattr(type(training.method.build()), "examples", stacked)
    row = trainer(training)[-1]["row"]
    assert (row["status"], row["message"]) == ("error", "dataset ball has no shapes in the split 'train'")
    assert row["stage"] == "examples"


def test_examples_of_another_method_are_refused(trainer, tmp_path):
    file = tmp_path / "given.safetensors"
    file.write_bytes(as_bytes({"centroids": np.zeros((1, 3))}, {"method": "mpu", "shapes": []}))
    row = trainer(ball_of(steps=1), from_examples=str(file))[-1]["row"]
    assert row["message"] == f"{file}: expected examples for toy_learner, got those of mpu"


def test_equal_seeds_give_equal_weights_also_with_global_generators(trainer, tmp_path, monkeypatch):
    training, found = ball_of(steps=1), []
    learner = type(training.method.build())
    monkeypatch.setattr(learner, "examples", lambda self, data, run: {"a": np.full(3, random.random())})
    monkeypatch.setattr(learner, "fit", lambda self, examples, run: {"b": examples["a"] + random.random()})
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        given = trainer(training, folder=str(tmp_path / name), examples=str(tmp_path / name / "examples"))
        assert given[-1]["row"]["status"] == "ok", given
        # The fit alone, as on another machine, begins with the same draws.
        examples = {"a": load(tmp_path / name / "examples")["a"]}
        Fit(training.method.build(), tmp_path / name / "alone", {"seed": 0}, seconds=9.0).run(examples)
        found += [load(tmp_path / name / file / "weights.safetensors")["b"] for file in ("", "alone")]
    assert all((weights == found[0]).all() for weights in found)


def test_on_a_second_gpu_the_fit_has_it_as_its_current_one(trainer, monkeypatch):
    used = []
    cuda = SimpleNamespace(set_device=used.append, synchronize=lambda _: None, get_device_name=lambda _: "second")
    torch = SimpleNamespace(cuda=cuda, zeros=lambda *_, **__: None, manual_seed=lambda _: None)
    monkeypatch.setitem(sys.modules, "torch", torch)
    row = trainer(ball_of(steps=1), device="cuda:1")[-1]["row"]
    assert used == [1] and row["device"] == "cuda (second)"


# -- the process that waits for it -------------------------------------------------------------------------------------


def trained_in(folder: Path, training: Training) -> tuple[Results, Path]:
    """A results folder in which a training has left its weights."""
    results = Results(folder)
    path = module.folder_of(results, training) / "weights.safetensors"
    path.parent.mkdir(parents=True)
    return results, file_of(path, 1.0)


def make_examples(training, settings, results, hear, alive, extra):
    examples = module.examples_file(results, training)
    examples.parent.mkdir()
    examples.write_bytes(as_bytes({"centroids": np.zeros((1, 3))}, {"method": "toy_learner"}))
    return {"status": "ok"}


def test_weights_that_are_there_wait_for_nobody_and_examples_are_made_though_they_are(tmp_path, monkeypatch):
    training = cell_of({}).training
    results, path = trained_in(tmp_path, training)
    settings = Settings(results=str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(Results, "lock", None)  # it may be held, for hours, by what makes examples
        assert module.weights_for(training, settings, results) == module.Weights.of(path, "trained")
    monkeypatch.setattr(module, "_train", make_examples)
    made = module.weights_for(training, settings, results, extra=module.Extra(only_examples=True))
    assert made.path == module.examples_file(results, training) and made.origin == "examples"


@pytest.mark.parametrize(
    ("rerun", "only_examples", "goes_on"), [("never", False, True), ("always", False, False), ("always", True, True)]
)
def test_what_is_run_again_begins_anew_and_its_steps_are_heard(tmp_path, monkeypatch, rerun, only_examples, goes_on):
    """Examples alone replace no training, so they leave the checkpoint of one."""
    training = cell_of({}).training
    checkpoint = module.folder_of(Results(tmp_path), training) / "checkpoint.safetensors"
    checkpoint.parent.mkdir(parents=True)
    checkpoint.write_bytes(b"begun")
    begun, heard = [], []

    def watched(spec, training, settings, hear, alive):
        begun.append(checkpoint.exists())
        hear({"event": "progress", "done": 1, "total": 2})
        hear({"event": "result", "row": {"status": "error", "message": "enough"}})

    monkeypatch.setattr(module, "_watched", watched)
    settings, extra = Settings(results=str(tmp_path), rerun=rerun), module.Extra(only_examples=only_examples)
    for _ in range(2):
        with pytest.raises(module.TrainingFailed, match=f"{training.title}: enough"):
            module.weights_for(training, settings, Results(tmp_path), heard.append, extra=extra)
    assert begun == [goes_on] * 2 and [event["event"] for event in heard] == ["train", "progress"] * 2


def test_a_training_that_succeeds_after_a_failure_is_no_longer_called_failed(tmp_path, monkeypatch):
    training = cell_of({}).training
    results, path = trained_in(tmp_path, training)
    path.unlink()
    monkeypatch.setattr(module, "_train", lambda *_: {"status": "error", "message": "no memory"})
    with pytest.raises(module.TrainingFailed, match="no memory"):
        module.weights_for(training, Settings(), results)
    assert module.state_of(results, training) == "failed"
    monkeypatch.setattr(module, "_train", lambda *_: file_of(path, 1.0) and {"status": "ok"})
    assert module.weights_for(training, Settings(), results).path == path
    assert module.state_of(results, training) == "finished"
    path.unlink()
    assert module.state_of(results, training) == "new"


def test_a_training_on_a_device_that_is_not_there_is_refused_and_is_no_failed_training(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(module, "_train", lambda *_: pytest.fail("trains"))
    with pytest.raises(UsageError, match="device=cuda: torch"):
        module.weights_for(cell_of({"device": "cuda"}).training, Settings(), Results(tmp_path))


GONE = Death("crashed", "the fork server was killed", 0, "method", 1.0, "", with_server=True)
OWN = Death("crashed", "killed by SIGSEGV (signal 11)", 0, "method", 1.0, "")


@pytest.fixture
def dying(tmp_path, monkeypatch):
    """Train in processes that end like this, one after the other; how often it was tried."""

    def train(*deaths: Death) -> int:
        left = list(deaths)
        server = SimpleNamespace(load=lambda *_: None, close=lambda: None)
        monkeypatch.setattr(module, "take_prestarted", lambda threads: server)
        monkeypatch.setattr(module, "Worker", lambda *_: SimpleNamespace(watch=lambda: left.pop(0)))
        with contextlib.suppress(module.TrainingFailed):
            module.weights_for(cell_of({}).training, Settings(), Results(tmp_path))
        return len(deaths) - len(left)

    return train


def test_a_training_is_tried_once_more_where_its_fork_server_was_killed(dying):
    """A system short of memory may have killed it; what kills the training alone would do so again."""
    assert dying(GONE, GONE, GONE) == dying(GONE, OWN, GONE) == 2 and dying(OWN, GONE) == 1


def test_a_training_whose_process_cannot_start_says_why_and_is_no_failed_training(dying):
    printed = "Traceback (most recent call last):\n  ...\nImportError: no numpy"
    with pytest.raises(CannotStart, match="no numpy") as caught:
        dying(Death("crashed", "ended with exit status 70", -1, "start", 0.1, printed))
    assert "run the cases: ended with exit status 70; ImportError: no numpy. No result was stored" in str(caught.value)


def test_a_training_short_of_memory_names_its_own_limit(dying, tmp_path):
    dying(Death("oom", "used 5 GB (limit.memory_gb=4)", 0, "method", 1.0, ""))
    (failed,) = tmp_path.glob("trainings/*/failed.json")
    row = json.loads(failed.read_text())["row"]
    assert row["status"] == "oom" and row["message"].endswith("used 5 GB (limit.train_memory_gb=4)")


def test_a_training_that_is_forgotten_is_as_new(tmp_path):
    training = cell_of({}).training
    results, _ = trained_in(tmp_path, training)
    for _ in range(2):
        module.forget(results, training)
        assert module.state_of(results, training) == "new"


def test_a_run_says_that_it_trains_again_what_is_damaged(tmp_path, monkeypatch):
    cell = cell_of({})
    _, path = trained_in(tmp_path, cell.training)
    path.write_bytes(path.read_bytes()[:-3])
    monkeypatch.setattr(module, "_train", lambda *_: {"status": "error", "message": "no memory"})
    results = Results(tmp_path, mends=True)
    made = runner.prepared_weights(cell, Settings(results=str(tmp_path)), results, None, lambda: None)
    assert made["failed"]["message"].endswith(": no memory")
    (note,) = results.damaged
    assert str(path) in note and note.endswith("; moved aside; the method is trained again")


@pytest.fixture
def run_again(monkeypatch):
    """Run the second of three cases of a cell again; the rows that are known."""
    monkeypatch.setattr(again, "run_cell", lambda cell, settings, known: SimpleNamespace(record=known))
    monkeypatch.setattr(again, "writing_nothing", lambda cell: (cell, []))
    rows = [{"case": name, "case_index": index} for index, name in enumerate("abc")]

    def run(cell, results, folder):
        stored = SimpleNamespace(cell=cell, results=results, settings=Settings(), shown=SimpleNamespace(rows=rows))
        assert again.run_again(stored, folder, {"b"}) == {0: rows[0], 2: rows[2]}

    return run


def test_a_case_that_is_run_again_elsewhere_has_the_very_weights_of_its_cell(tmp_path, run_again):
    cell, variant = cell_of({}), cell_of({}, scale=0.5)
    results, path = trained_in(tmp_path / "here", cell.training)
    for one in (cell, variant):  # which share them
        run_again(one, results, tmp_path / "there")
        copy = module.known_weights(Results(tmp_path / "there"), one.training)
        assert copy is not None and copy.path.read_bytes() == path.read_bytes()


def test_a_case_is_run_again_elsewhere_where_there_are_no_weights_to_take_along(tmp_path, run_again):
    file = file_of(tmp_path / "a.safetensors", 1.0)
    untrained, given, unlearned = cell_of({"seed": 1}), cell_of({"weights": str(file)}), cell_of({})
    for cell in (untrained, given, replace(unlearned, training=None)):
        run_again(cell, Results(tmp_path / "here"), tmp_path / "there")
    assert not (tmp_path / "there").exists()


@pytest.mark.parametrize(
    ("commit", "said"),
    [({"commit": "abc", "dirty": False}, "abc"), ({"commit": "abc", "dirty": True}, "abc+"), (None, "")],
)
def test_weights_say_of_which_commit_they_are_and_whether_it_was_edited(tmp_path, monkeypatch, commit, said):
    monkeypatch.setattr("bench.results.provenance.machine", lambda: {"commit": commit, "detailbench": "1"})
    asked = {"device": "cpu", "fingerprint": "f", "folder": str(tmp_path)}
    channel = SimpleNamespace(enter=lambda *_: None, send=lambda *_, **__: None)
    spec = {"threads": 1, "seconds": 100.0}
    _fitted(cell_of({}, steps=3).training, asked, spec, channel, {"centroids": np.zeros((1, 3))}, {})
    facts = facts_of(tmp_path / "weights.safetensors")
    assert (facts["commit"], facts["detailbench"], facts["training"]) == (said, "1", "f")


# -- commands ----------------------------------------------------------------------------------------------------------


def test_train_makes_exports_and_takes_examples(shell, tmp_path, capsys):
    examples, saved, alone = (tmp_path / f"{name}.safetensors" for name in ("examples", "weights", "alone"))
    done = train(shell, "--export-examples", examples)
    assert done.returncode == 0 and "1 cases" in done.stdout and weights_in(shell) == [], done.stderr
    assert facts_of(examples)["method"] == "toy_learner"
    done = train(shell, "--examples", examples, "--save", saved, "--half")
    assert done.returncode == 0, done.stderr
    assert "200 steps" in done.stdout and "validation" in done.stdout and logged(shell) == ["examples", "fit"]
    again = train(shell)
    assert again.returncode == 0 and "finished" in again.stderr and logged(shell) == ["examples", "fit"]
    (path,) = weights_in(shell)
    assert np.abs(load(path)["shift"] - load(saved)["shift"]).max() < 1e-3
    # On a machine without the rest, from the file alone.
    assert fit.main([str(examples), str(alone), "--threads", "1", "--plugin", str(LEARNER)]) == 0
    assert (load(alone)["shift"] == load(path)["shift"]).all() and facts_of(alone)["steps"] == 200
    assert fit.main([str(saved.with_name("no.safetensors")), str(alone)]) == 1
    assert "cannot be read" in capsys.readouterr().err
    assert fit.main([str(examples), str(alone), "--device", "cuda:99", "--plugin", str(LEARNER)]) == 1
    assert "device=cuda:99: torch" in capsys.readouterr().err
    plan = shell.call("plan", "--plugin", TOYS, "--plugin", LEARNER, *TRAIN, *WORDS, "training.seed=1")
    assert "first: training of toy_learner" in plan.stdout and "15 min" in plan.stdout, plan.stderr


def test_examples_alone_replace_no_weights_and_so_leave_those_that_are_there(tmp_path, monkeypatch):
    words, plugins = (*TRAIN, "sensor=dots", f"results={tmp_path}", "rerun=always"), (str(TOYS), str(LEARNER))
    _, path = trained_in(tmp_path, job_of(list(words), plugins)[0])
    monkeypatch.setattr(module, "_train", make_examples)
    options = ("--plugin", plugins[0], "--plugin", plugins[1], "--export-examples", str(tmp_path / "examples"))
    assert main(["train", *options, *words]) == 0
    assert path.exists() and facts_of(tmp_path / "examples")["method"] == "toy_learner"


def test_train_on_ones_own_folder_then_apply(shell, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    for name, subdivisions in (("a", 1), ("b", 2)):
        icosphere(subdivisions=subdivisions).export(folder / f"{name}.ply")
    scan, clean, saved = folder / "a.ply", tmp_path / "clean.ply", tmp_path / "mine.safetensors"
    plugin = ("--plugin", LEARNER, "method=toy_learner")
    missing = shell.apply(*plugin, scan, clean)
    assert missing.returncode == 1 and "detailbench train method=toy_learner" in missing.stderr
    words = ("dataset=files", f"dataset.path={folder}", "dataset.train_share=1", f"results={shell.results}")
    done = shell.call("train", *plugin, *words, "--save", saved)
    assert done.returncode == 0, done.stderr
    applied = shell.apply(*plugin, f"training.weights={saved}", scan, clean)
    assert applied.returncode == 0 and clean.exists(), applied.stderr
    refused = shell.call("train", "method=jet", f"results={shell.results}")
    assert refused.returncode == 1 and "is not a learned method" in refused.stderr


def test_check_tries_to_learn(shell):
    done = shell.call("check", LEARNER)
    assert done.returncode == 0, done.stdout + done.stderr
    for line in ("examples and a few steps", "same seed, same weights", "continues from a checkpoint", "denoise: toy"):
        assert line in done.stdout
    assert "FAIL" not in done.stdout.upper().replace("FAILED", "")
