"""Configs from parts are those that Hydra composes, and jobs that are finished are not composed at all."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from records import rewritten

from bench import cli
from bench.commands.plan import look_up
from bench.engine.runner import standing_rows
from bench.plan.cell import Cell, NotSolved, settings_of
from bench.plan.keys import GROUPS
from bench.plugins.registry import KINDS
from bench.results.earlier import standing
from bench.results.files import META_KEY
from bench.results.provenance import fingerprint, ingredients
from bench.results.store import Results
from bench.sweep.composition import resolved
from bench.sweep.parts import may_depend, values_of
from bench.sweep.planned import Shelf, planned_jobs
from bench.sweep.request import Request

CONF = Path(__file__).parents[2] / "conf"
NOTHING = str(Path(__file__).parents[1] / "benchmarks" / "nothing.py")
CORPUS = [
    ["task=denoise", "method=jet,poisson", "sensor=clean,noisy", "seed=7"],
    ["method=poisson", "method.depth=7,8", "sensor.noise=0.01,0.02", "cases=${seed}", "seed=3"],
    ["method=jet", "metric=p2f_mean,[p2f_mean,hausdorff]", "limit.seconds=60,30", "limit.memory_gb=2.5"],
    ["profile=quick,study", "method=identity", "seed=1,1_0", "training.cases=3"],
    ["experiment=figure_4_11", "profile=quick", "seed=0,1"],
    ["method=mpu", "training=quick,auto", "task=upsample", "task.ratio=4,16"],
    ["method=idf,idf_30", "method.seconds=5", "dataset=bumps,cad", "threads=2"],
]


@pytest.mark.parametrize("words", CORPUS, ids=" ".join)
def test_each_config_is_the_one_that_hydra_composes(words):
    jobs = Request.of(words, multirun=True).jobs
    found = values_of(jobs)
    assert found is not None
    for job, values in zip(jobs, found, strict=True):
        composed = resolved(job)
        assert values == composed, job
        assert repr(values) == repr(composed)  # and 1 is not 1.0, nor True


def test_cells_of_many_jobs_are_those_of_each():
    words = ["task=denoise,reconstruct", "method=jet,wlop", "sensor=clean,noisy", "seed=0,1", "cases=2"]
    jobs = Request.of(words, multirun=True).jobs
    plan = list(planned_jobs(jobs))
    assert len(plan) == 16
    for job, one in list(zip(jobs, plan, strict=True))[::3]:
        try:
            cell = Cell.from_config(resolved(job))
        except NotSolved as error:
            assert one.cell is None and one.reason == str(error)
            continue
        assert one.cell == cell and one.cell.id == cell.id and one.cell.planned == cell.planned
        assert one.mark == fingerprint(ingredients(cell))


OWN = {
    "a preset that reaches into another node": ("method/mine", "# @package _global_\ndefaults: [poisson]\n"),
    "a choice that depends on another one": ("experiment/mine", "defaults:\n  - override /method: ${dataset}\n"),
}


@pytest.mark.parametrize("name, text", OWN.values(), ids=OWN)
def test_what_could_depend_on_another_choice_is_left_to_hydra(name, text, tmp_path, monkeypatch):
    file = tmp_path / "conf" / f"{name}.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    (tmp_path / "plain").mkdir()
    jobs = [["method=jet"], ["method=poisson"]]
    monkeypatch.chdir(tmp_path / "plain")
    assert values_of(jobs) is not None
    monkeypatch.chdir(tmp_path)
    assert values_of(jobs) is None


def test_what_is_wrong_with_a_job_is_left_to_hydra():
    assert values_of([["method=jet"], ["method=nobody"]]) is None
    assert values_of([["method=jet", "cases=${oc.env:HOME}"], ["method=poisson", "cases=2"]]) is None
    assert values_of([["method=jet"], ["seed=1"]]) is None  # other keys: no sweep makes that


def test_no_config_of_ours_depends_on_another_choice():
    for file in CONF.glob("*/*.yaml"):
        text = file.read_text()
        assert not may_depend(text), file
        assert file.parent.name not in KINDS or "@package" not in text, file
    assert {path.name for path in CONF.iterdir() if path.is_dir()} - {"__pycache__"} <= set(GROUPS)


@pytest.fixture
def sweep(tmp_path, monkeypatch, capsys):
    """A function that runs a sweep of thirteen cells: what it said, and how many configs of jobs Hydra composed."""
    from hydra._internal.config_loader_impl import ConfigLoaderImpl

    compose, composed = ConfigLoaderImpl.load_sweep_config, []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        ConfigLoaderImpl, "load_sweep_config", lambda *words, **keys: composed.append(keys) or compose(*words, **keys)
    )
    words = [
        "task=denoise",
        "method=nothing",
        "dataset=tiny_balls",
        "sensor=tiny_samples",
        "cases=1",
        "metric=tiny_score",
    ]

    def run(*more):
        composed.clear()
        code = cli.main(
            ["run", "-m", "--plugin", NOTHING, *words, "seed=range(0,13)", "results=r", "--no-leaderboard", *more]
        )
        return code, capsys.readouterr().err, len(composed)

    return run


def test_overrides_about_hydra_decide_whether_jobs_are_composed(sweep):
    """A launcher's parameters change no job; the config of the first one is that of the launcher."""
    for words, expected in ((["hydra/launcher=basic"], 0), (["hydra.job.name=mine", "rerun=always"], 2)):
        code, said, composed = sweep("seed=1,2,3", *words)
        assert code == 0 and "3 run, 0 cached" in said and composed == expected


def test_finished_jobs_are_not_composed_and_others_are_run(sweep, tmp_path):
    code, said, composed = sweep()
    assert code == 0 and "13 run, 0 cached" in said and composed == 0
    code, said, composed = sweep()
    assert code == 0 and "13/13 cases solved, 0 run, 13 cached" in said and composed == 0
    assert len(re.findall(r"^\[\d+/13\] .*: 1/1 solved, all cached$", said, re.MULTILINE)) == 13

    files = sorted((tmp_path / "r" / "cells").glob("*/*.parquet"))
    before = {file: file.read_bytes() for file in files}
    files[3].unlink()
    damaged = files[5]
    damaged.write_bytes(before[damaged][:-20])
    code, said, composed = sweep()
    assert code == 0 and "13/13 cases solved, 2 run, 11 cached" in said and composed == 0
    assert "set aside" in said
    again = {file: file.read_bytes() for file in sorted((tmp_path / "r" / "cells").glob("*/*.parquet"))}
    assert again.keys() == before.keys()
    assert [f for f in files if again[f] != before[f]] == [files[3], files[5]]

    # What a shelf says of each cell is what opening its record says.
    rewritten(files[7], lambda meta: meta.pop("provenance"))
    rewritten(files[8], lambda meta: meta["settings"].pop("limit"))
    rewritten(files[9], table=lambda table: _with(table, "status", "timeout"))
    rewritten(files[10], table=lambda table: _with(table, "status", "error"))
    results = Results(tmp_path / "r")
    shelf, states = Shelf(results), []
    for file in files:
        meta = json.loads(pq.read_metadata(file).metadata[META_KEY])
        cell = Cell.from_json(meta["cell"])
        settings = settings_of(SETTINGS | {"limit": {"seconds": 1000.0, "memory_gb": 4.0}, "rerun": "failed"})
        for chosen in (settings, settings_of(SETTINGS)):
            stands = shelf.look_up(cell, chosen, meta["fingerprint"])
            opened = standing(results, cell, ingredients(cell))
            rows, stored = standing_rows(results, cell, opened, chosen)
            assert [row["status"] for row in stands.rows] == [row["status"] for row in rows.values()]
            of_record = stored.rows if stored else []
            assert [row["status"] for row in stands.stored] == [row["status"] for row in of_record]
            assert stands.complete == (len(of_record) == len(rows) == 1) and not stands.stale
            states.append(look_up(shelf, cell, chosen, meta["fingerprint"])[1])
    assert {*states} >= {"finished", "1 failed", "failed"}


SETTINGS = {"results": "r", "limit": {}, "outputs": "none", "rerun": "never", "verbose": False, "plugins": [],
            "profile": "quick"}  # fmt: skip


def _with(table, name, value):
    import pyarrow as pa

    place = table.column_names.index(name)
    return table.set_column(place, name, pa.array([value] * table.num_rows, table.schema.field(name).type))
