"""Names of files on the command line: whatever letters they have, Hydra gets them as they are."""

from __future__ import annotations

import pytest

from bench import UsageError
from bench.sweep.composition import resolved
from bench.sweep.flags import split_words
from bench.sweep.overrides import check
from bench.sweep.request import Request

NAMES = ["a=b.ply", "a b.ply", "scan (2)", "a[1].ply", "a,b.ply", "ä ö.ply", "it's.ply", "{x}.ply", "a#b.ply", "$x.ply"]


@pytest.mark.parametrize("name", [*NAMES, "a:b.ply", "a\\b.ply", "100", "1e3", "true", "null", '"q".ply'])
def test_a_file_s_name_arrives_as_it_is(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).touch()
    overrides, _ = split_words(["dataset=files", f"dataset.path={name}"])
    check(Request.of(overrides))
    assert resolved(overrides)["dataset"]["path"] == name


def test_a_pattern_of_files_arrives_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scan (2)").mkdir()
    (tmp_path / "scan (2)" / "a.ply").touch()
    overrides, _ = split_words(["dataset=files", "dataset.path=scan (2)/*.ply"])
    assert resolved(overrides)["dataset"]["path"] == "scan (2)/*.ply"


@pytest.mark.parametrize("command", ["prog {input} {output}", "sh -c 'a; b' {input} {output}", "cp -t {output}"])
def test_a_command_arrives_as_it_is(command):
    overrides, _ = split_words(["method=external", f"method.command={command}"])
    assert resolved(overrides)["method"]["command"] == command
    assert split_words(overrides)[0] == overrides


def test_other_values_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poisson").touch()
    words = ["method=poisson", "seed=1,2", "dataset.path=a,b", "sensor.steps=[uniform,gaussian]", "limit.seconds=60"]
    assert split_words(words)[0] == words


def test_where_there_is_no_such_file_the_message_shows_the_quotes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    value = "scan (2)"
    with pytest.raises(UsageError) as error:
        check(Request.of(split_words(["dataset=files", f"dataset.path={value}"])[0]))
    assert f"\"dataset.path='{value}'\"" in str(error.value)
