"""What a sweep says to words that cannot be run as they stand, and what to do instead."""

from __future__ import annotations

import re

import pytest

from bench import cli
from bench.errors import UsageError
from bench.installing import line_of_extra
from bench.plan.cell import not_planned
from bench.plugins.registry import registry
from bench.sweep.composition import compose
from bench.sweep.flags import split_words
from bench.sweep.overrides import check, check_jobs
from bench.sweep.request import Request


def refused(words):
    with pytest.raises(UsageError) as error:
        check(Request.of(words, multirun=True))
    return str(error.value)


@pytest.mark.parametrize(
    ("words", "first", "second"),
    [
        (["method=poisson,rimls", "method.depth=8,9"], "method=poisson method.depth=8,9", "method=rimls"),
        (["method=rimls,poisson_9", "method.depth=8"], "method=poisson method.depth=8", "method=rimls"),
        (["sensor=samples,uniform", "sensor.noise=0.1"], "sensor=samples sensor.noise=0.1", "sensor=uniform"),
        (["dataset=bumps,cad", "dataset.degree=9"], "dataset=bumps dataset.degree=9", "dataset=cad"),
    ],
)
def test_a_parameter_that_only_some_have_is_refused_with_the_two_commands_that_do_it(words, first, second):
    message = refused(words)
    assert f"first {first}, then {second}" in message and "same results=DIR" in message
    for half in (first.split(), second.split()):
        check(Request.of(half, multirun=True))


def test_the_same_where_an_experiment_chooses_the_methods():
    jobs = Request.of(["experiment=demo", "method.depth=7"], multirun=True).jobs
    with pytest.raises(UsageError, match="ball_pivoting has no parameter 'depth' .poisson has.*method=poisson method"):
        check_jobs(jobs)
    check_jobs(Request.of(["experiment=demo", "sensor.noise=0.1"], multirun=True).jobs)


def test_a_parameter_of_a_plugin_that_a_file_chooses_is_refused_in_our_words(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf" / "experiment").mkdir(parents=True)
    text = "# @package _global_\ndefaults:\n  - override /method: rimls\nmethod: {dpeth: 3}\n"
    (tmp_path / "conf" / "experiment" / "odd.yaml").write_text(text)
    registry().find("method", "rimls")
    with pytest.raises(UsageError, match="method rimls has no parameter 'dpeth'"):
        compose(["experiment=odd"])


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["method=poisson,rimls", "method.k=3"], "none of the methods poisson, rimls has a parameter 'k'"),
        (["experiment=./mine.yaml"], "put the file into ./conf/experiment/.*experiment=mine"),
        (["hydra.searchpath=[x]"], "--config-dir DIR"),
        (["hydra.run.dir=x"], "results=DIR"),
        (["hydra/sweeper=optuna"], "method.depth=7,8,9"),
        (["seed=interval(0,1)"], "takes listed values"),
        (["dataset.path=scan (2)"], re.escape("\"dataset.path='scan (2)'\"")),
        (["method=poisson", "depth=7"], "Did you mean method.depth"),
        (["ratio=4"], "Did you mean task.ratio"),
    ],
)
def test_what_to_say_instead(words, hint):
    assert re.search(hint, refused(words))


def test_a_key_that_does_not_exist_is_not_compared_with_private_ones():
    assert not re.search("plugins|session|config_dirs", refused(["frobnicate=1"]))


@pytest.mark.parametrize(("command", "hint"), [("plan", "detailbench plan -m"), ("apply", "one value for each key")])
def test_a_sweep_is_refused_in_the_words_of_the_command(command, hint):
    with pytest.raises(UsageError, match=hint):
        check(Request.of(["seed=1,2"], command))


@pytest.mark.parametrize("flag", ["--config-path", "-cn", "--shell-completion", "-sc"])
def test_flags_of_other_applications_of_hydra_are_refused_with_ours(flag):
    with pytest.raises(UsageError, match="--config-dir DIR|detailbench completion"):
        split_words([flag, "x"])


def test_a_group_may_have_a_plus():
    assert split_words(["+experiment=demo", "+method.depth=3"])[0] == ["experiment=demo", "+method.depth=3"]


def test_a_glob_of_datasets_leaves_out_what_wants_a_path():
    (word,) = Request.of(["dataset=glob(*)"]).without_globs().words
    names = word.removeprefix("dataset=").split(",")
    assert "files" not in names and {"bumps", "cad", "detailed"} <= set(names)
    assert Request.of(["method=glob(poiss*)", "seed=1"]).without_globs().words == ["method=poisson,poisson_9", "seed=1"]


def test_all_methods_that_do_not_fit_are_in_one_line():
    some = [f"method {m} does not solve {t}: it solves x. Methods that do: y" for t, m in ("ab", "ac", "de")]
    lines = not_planned([*some, some[0], "real was not fetched"])
    assert lines[0].startswith("a by b, c; d by e: ") and lines[1:] == ["real was not fetched"]
    assert not_planned(some[:1]) == some[:1]


def test_lines_that_install_name_what_an_index_has():
    for library in ("pymeshlab", "CGAL", "torch"):
        assert "detailbench" not in cli.importlib.import_module("bench.plugins.registry").install_line(library)
    assert line_of_extra("joblib") == 'pip install "hydra-joblib-launcher<1.4,>=1.2" "joblib<1.6"'
    assert line_of_extra("nothing") == 'pip install ".[nothing]" in the folder of detailbench'
