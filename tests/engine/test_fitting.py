"""One fit: what it is given, what its log and the header of its weights say, and where an interrupted one goes on."""

from __future__ import annotations

import json
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from bench import Run, UsageError
from bench.engine.fitting import Fit
from bench.plugins.weights import as_bytes, facts_of, load

BEFORE = {"seconds": 3.0, "cpu_seconds": 5.0, "steps": 7}


@pytest.fixture
def clock(monkeypatch):
    """A clock that only the method moves."""
    clock = SimpleNamespace(wall=0.0, cpu=10.0)
    monkeypatch.setattr(Run, "elapsed", lambda run: clock.wall)
    monkeypatch.setattr(time, "process_time", lambda: clock.cpu)
    return clock


@pytest.fixture
def fitted(tmp_path, clock):
    """Fit a method that takes two steps, 1.23456 seconds in all; its row, its run and the files of its folder."""
    folder = tmp_path / "not" / "there yet"

    def fit(weights=None, first=0, progress=True, checkpoint=None, log="", **options):
        def method(examples, run):
            for step in (first, first + 1):
                clock.wall, clock.cpu = clock.wall + 0.61728, clock.cpu + 0.49382
                run.log(step, loss=0.5, validation=np.float32(0.25))
                if progress:
                    run.progress(step + 1, 9)
            seen.append(run)
            return {"shift": np.ones(3)} if weights is None else weights

        seen = []
        if checkpoint is not None or log:
            folder.mkdir(parents=True)
        if checkpoint is not None:
            (folder / "checkpoint.safetensors").write_bytes(checkpoint)
        if log:
            (folder / "log.jsonl").write_text(log)
        made = Fit(SimpleNamespace(fit=method), folder, {"seed": 4, "method": "toy"}, **{"seconds": 60.0, **options})
        row = made.run({"points": np.zeros(2)})
        lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
        return SimpleNamespace(row=row, run=seen[0], log=lines, facts=facts_of(folder / "weights.safetensors"))

    fit.folder = folder
    return fit


def log_of(*steps: int) -> str:
    return "".join(json.dumps({"step": step, "seconds": 0.5, "validation": 9.0}) + "\n" for step in steps)


# -- what it says ------------------------------------------------------------------------------------------------------


def test_the_header_and_the_log_have_milliseconds_steps_and_the_curve(fitted):
    made = fitted(threads=2)
    assert (made.run.seed, made.run.threads, made.run.device) == (4, 2, "cpu")
    expected = {"seconds": 1.235, "cpu_seconds": 0.988, "steps": 2, "device": "cpu"}
    assert made.row == {**expected, "notes": "", "parameters": None}
    curve = [[0.617, 0, 0.25], [1.235, 1, 0.25]]
    assert [[line["seconds"], line["step"], line["validation"]] for line in made.log] == curve
    assert made.facts.items() >= {**expected, "seed": 4, "method": "toy", "curve": curve}.items()
    assert sorted(path.name for path in fitted.folder.iterdir()) == ["log.jsonl", "weights.safetensors"]


def test_a_method_that_reports_no_step_has_made_none(fitted):
    assert fitted(progress=False).row["steps"] == 0


def test_the_weights_of_a_gpu_name_it(fitted, monkeypatch):
    names = {"cuda:0": "small", "cuda:1": "large"}
    torch = SimpleNamespace(cuda=SimpleNamespace(get_device_name=names.get), manual_seed=lambda seed: None)
    monkeypatch.setitem(sys.modules, "torch", torch)
    assert fitted(device="cuda:1").facts["device"] == "cuda (large)"


def test_weights_may_be_plain_numbers_and_are_refused_where_they_are_not_finite(fitted):
    fitted(weights={"scale": 2.5, "table": [1, 2], "on": np.bool_(True)})
    arrays = load(fitted.folder / "weights.safetensors")
    assert {name: array.tolist() for name, array in arrays.items()} == {"scale": 2.5, "table": [1, 2], "on": True}
    before = (fitted.folder / "weights.safetensors").read_bytes()
    for bad in (np.array([1, np.nan], np.float32), [0.0, np.inf], np.nan):
        with pytest.raises(UsageError, match="fit: the weights 'b' are not finite; try a smaller learning rate"):
            fitted(weights={"a": np.ones(2), "b": bad})
    assert (fitted.folder / "weights.safetensors").read_bytes() == before


# -- after an interruption ---------------------------------------------------------------------------------------------


def test_an_interrupted_training_goes_on_with_what_it_has_spent(fitted):
    arrays = {"shift": np.ones(3, np.float16)}
    made = fitted(first=7, checkpoint=as_bytes(arrays, BEFORE), log=log_of(5, 6, 7, 8))
    assert made.run.resumed["shift"].dtype == np.float16 and made.run.resumed["shift"].tolist() == [1, 1, 1]
    assert (made.run.spent, made.run.seconds) == (3.0, 57.0)
    assert [made.row[key] for key in BEFORE] == [4.235, 5.988, 9]
    assert [(line["step"], line["seconds"]) for line in made.log] == [(5, 0.5), (6, 0.5), (7, 3.617), (8, 4.235)]
    assert not (fitted.folder / "checkpoint.safetensors").exists()


def test_a_training_whose_time_was_over_has_none_left_and_keeps_its_steps(fitted):
    made = fitted(progress=False, seconds=2.0, checkpoint=as_bytes({"a": np.ones(1)}, BEFORE))
    assert (made.run.seconds, made.row["steps"]) == (0.0, 7)


WHOLE = as_bytes({"a": np.ones(4)}, BEFORE)
DAMAGED = {
    "killed before the first": None,
    "empty": b"",
    "cut off": WHOLE[:-3],
    "of another shape": WHOLE.replace(b'"shape":[4]', b'"shape":[5]'),
    "without its seconds": as_bytes({"a": np.ones(4)}, {"steps": 7}),
}


@pytest.mark.parametrize("log", [log_of(0, 1, 2), ""], ids=["logged", "not logged"])
@pytest.mark.parametrize("checkpoint", DAMAGED.values(), ids=DAMAGED)
def test_a_training_without_a_whole_checkpoint_begins_anew(fitted, checkpoint, log):
    made = fitted(checkpoint=checkpoint, log=log)
    assert (made.run.resumed, made.run.spent, made.run.seconds) == (None, 0.0, 60.0)
    assert [line["step"] for line in made.log] == [0, 1] and len(made.facts["curve"]) == 2
    assert (made.row["seconds"], made.row["cpu_seconds"], made.row["steps"]) == (1.235, 0.988, 2)
