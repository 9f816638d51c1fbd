"""Which jobs of a sweep are composed before it starts."""

import signal
import sys
import types
from contextlib import nullcontext
from itertools import product

import pytest
from conftest import TOYS
from hydra.core.override_parser.overrides_parser import OverridesParser

from bench.sweep.launch import _deaf_to_interrupts, launch_all
from bench.sweep.parts import _number, representatives
from bench.sweep.request import Request
from bench.sweep.session import Session


def test_each_choice_of_a_group_is_in_one_job_and_few_jobs_are_needed():
    groups = [[f"method={m}" for m in "abcdef"], [f"dataset={d}" for d in "uvwxyz"], ["split=test", "split=train"]]
    batch = [list(job) for job in product(*groups)]
    chosen = representatives(batch)
    assert {o for job in chosen for o in job} == {o for group in groups for o in group}
    assert len(chosen) <= sum(map(len, groups)) - 2


def test_a_parameter_is_tried_with_every_plugin_of_its_group():
    batch = [[f"method={m}", f"method.k={k}", f"seed={s}"] for m, k, s in product("ab", "12", "34")]
    chosen = {tuple(job[:2]) for job in representatives(batch)}
    assert chosen == {(f"method={m}", f"method.k={k}") for m, k in product("ab", "12")}


@pytest.mark.parametrize(
    ("values", "composed"),
    [
        (["seed=0", "seed=7", "seed=-1"], ["seed=0"]),
        (["seed=0", "seed=1.5", "seed=2.5", "seed=1.0e3"], ["seed=0", "seed=1.5"]),
        (["limit.seconds=60", "limit.seconds=90", "limit.seconds=0.5"], ["limit.seconds=60", "limit.seconds=0.5"]),
        (
            ["seed=1", "seed=one", "seed=true", "seed=null", "seed=1-2"],
            ["seed=1", "seed=one", "seed=true", "seed=null", "seed=1-2"],
        ),
        (["device=cpu", "device=cuda"], ["device=cpu", "device=cuda"]),
        (["method=1", "method=2"], ["method=1", "method=2"]),
        (["method.k=1", "method.k=2"], ["method.k=1", "method.k=2"]),
        (["hydra.x=1", "hydra.x=2"], ["hydra.x=1", "hydra.x=2"]),
    ],
)
def test_one_number_of_a_key_of_the_run_stands_for_all_of_its_type(values, composed):
    assert representatives([["dataset=bumps", value] for value in values]) == [["dataset=bumps", v] for v in composed]


def test_a_number_is_one_where_hydra_reads_one():
    """As far as one stands for others: Hydra gives both the same type."""
    parser = OverridesParser.create()
    for text in [
        "0",
        "7",
        "-7",
        "+7",
        "1_000",
        "1.5",
        "-.5",
        "2.",
        "1e3",
        "1.5e-3",
        "-2E+5",
        "007",
        "1__0",
        "1e",
        "0x1",
        "inf",
        "nan",
        "one",
        "1-2",
        "''",
    ]:
        value = parser.parse_override(f"seed={text}").value()
        assert _number(f"seed={text}") in (None, (f"seed=<{type(value).__name__}>", value)), text


def test_one_job_stands_for_itself():
    assert representatives([[]]) == [[]]
    assert representatives([["+method.typo=3"]]) == [["+method.typo=3"]]


@pytest.mark.parametrize(
    ("words", "fixed"),
    [
        ("method=a,b method.x=1", ""),
        ("method=a,b method.x=1,2 dataset.y=[3,4]", "dataset.y=[3,4]"),
        ("method=a method.x=1", "method=a method.x=1"),
        ("experiment=e method.x=[1,2] sensor.y=3", "experiment=e"),
        ("experiment=e method=a method.x=1 limit.seconds=5", "experiment=e method=a method.x=1 limit.seconds=5"),
        ("method=a,b ~method.x seed=1,2 cases=3", "cases=3"),
    ],
)
def test_what_is_the_same_for_all_jobs_has_no_parameter_of_plugins_that_are_swept(words, fixed):
    """Hydra composes a sweep's config without what is swept, and so with the default plugin's parameters."""
    request = Request.of(words.split(), multirun=True)
    assert [override.input_line for override in request.fixed()] == fixed.split()


def test_one_value_for_an_experiment_s_methods():
    """Of what the experiment sweeps, and of what it does not."""
    for word, count in ("method.alpha=0.1", 1), ("method.traces=2", 5):
        jobs = Request.of(["experiment=table_4_3", word], multirun=True).jobs
        assert len(jobs) == count and all(word in job for job in jobs)


def test_several_experiments_are_one_command_after_the_other():
    def by_experiment(words):
        return [part.words for part in Request.of(words, multirun=True).parts()]

    words = ["method=jet,rimls", "experiment=demo,first_table", "seed=0,1"]
    demo = ["method=jet,rimls", "experiment=demo", "seed=0,1"]
    assert by_experiment(words) == [demo, [word.replace("demo", "first_table") for word in demo]]
    assert by_experiment(["experiment=glob(table_4_3*)"]) == [["experiment=table_4_3"], ["experiment=table_4_3_nu"]]
    assert by_experiment(demo) == [demo]
    assert by_experiment([]) == [[]]


def test_two_experiments_are_both_run_with_their_own_sweeps(shell):
    """Each brings its own methods; what is said beside it holds for both."""
    words = ("experiment=demo,first_table", "seed=0,1", "method=fine", "task=denoise", "dataset=ball", "sensor=dots")
    plan = shell.call("plan", "-m", "--plugin", TOYS, *words, "cases=1", f"results={shell.results}")
    assert "2 cells, 2 cases, 0 finished, 2 to do" in plan.stdout, plan.stdout + plan.stderr
    done = shell.run(*words, "cases=1")
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stderr.splitlines() if "experiment=" in line] == [
        "experiment=demo",
        "experiment=first_table",
    ]
    assert "Traceback" not in done.stderr


def test_processes_of_submitit_leave_ctrl_c_to_the_front_door(monkeypatch):
    """They are in its process group, and are started with Ctrl-C ignored."""
    local = types.SimpleNamespace(start_controller=lambda: signal.getsignal(signal.SIGINT))
    monkeypatch.setitem(sys.modules, "submitit", types.ModuleType("submitit"))
    monkeypatch.setitem(sys.modules, "submitit.local", types.SimpleNamespace(local=local))
    ours = signal.getsignal(signal.SIGINT)
    with _deaf_to_interrupts(Request.of(["hydra/launcher=submitit_local"])):
        assert local.start_controller() == signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) == ours
    assert local.start_controller() == ours
    with _deaf_to_interrupts(Request.of(["hydra/launcher=joblib"])):
        assert local.start_controller() == ours


def test_hydra_keeps_no_config_of_a_job_that_has_ended():
    """Each is 0.1 MB, and a sweep may have 50,000."""
    from hydra import compose
    from hydra.core.utils import JobReturn
    from hydra.utils import instantiate

    from bench.sweep.composition import CONFIG_NAME, hydra_ready

    with hydra_ready():
        config = compose(CONFIG_NAME, return_hydra_config=True)
    ended = JobReturn(overrides=["seed=1"], cfg=config, hydra_cfg=config)
    for callback in instantiate(config.hydra.callbacks).values():
        callback.on_job_end(config, ended)
    assert ended.cfg is None and ended.hydra_cfg is None and ended.overrides == ["seed=1"]


class UncompletedJobError(Exception):
    """As submitit's."""


class RayError(Exception):
    """As ray's."""


class LocalRayletDiedError(RayError):
    """As ray's of a killed raylet."""


@pytest.mark.parametrize("kills", [1, 2])
@pytest.mark.parametrize("error", [UncompletedJobError, LocalRayletDiedError])
def test_cells_that_a_launcher_with_a_killed_process_left_are_launched_once_more(
    error, kills, tmp_path, monkeypatch, capsys
):
    shut, session = [], Session.new(tmp_path)
    left = iter([["1"], ["2", "3"] if kills == 1 else ["2"]])  # jobs that are finished in each launch
    ends = iter([error("gone")] * kills + [None])

    class Launcher:
        def launch(self, batch, initial_job_idx):
            for name in next(left):
                session.leave(name, job=int(name))
            if end := next(ends):
                raise end
            return []

    monkeypatch.setattr("bench.sweep.launch._launcher", lambda *_: nullcontext((Launcher(), [[[]]])))
    monkeypatch.setitem(sys.modules, "ray", types.SimpleNamespace(shutdown=lambda: shut.append(True)))
    assert launch_all(session, Request(()), [[], [], []]) == (0 if kills == 1 else 3)
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("warning: ") and f"({error.__name__}): 2 of 3 cells" in said[0]
    assert said[1:] == ([] if kills == 1 else [said[-1]])
    assert kills == 1 or (said[-1].startswith("error: ") and "1 of 3 cells are not finished" in said[-1])
    assert len(shut) == kills  # a cluster without its raylet is not used again
