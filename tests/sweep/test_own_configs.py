"""Configs of the user's own: found beside the working folder, in a folder, in a package; data, and never code."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bench import cli
from bench.errors import UsageError
from bench.plan.cell import Cell
from bench.plugins import config_files, presets
from bench.plugins.listing import listing
from bench.ranking.conventions import load_convention
from bench.ranking.published import load_published
from bench.sweep.composition import compose, resolved
from bench.sweep.overrides import check
from bench.sweep.request import Request

MINE = """# @package _global_
# My own comparison.
defaults:
  - override /profile: tiny
  - override /metric: few
  - override /hydra/launcher: basic
hydra:
  mode: MULTIRUN
  sweeper:
    params:
      method: fine,poisson
      sensor: rough
"""
FILES = {
    "experiment/mine": MINE,
    "method/fine": "# A deeper tree.\n# Said in two lines.\ndefaults: [poisson]\ndepth: 10\n",
    "method/finer": "# On top of another preset.\ndefaults: [fine]\ntrim: 0.2\n",
    "sensor/rough": "# Much noise.\ndefaults: [samples]\nnoise: 0.03\n",
    "profile/tiny": "# @package _global_\n# A minute.\nprofile: tiny\ncases: 2\nlimit: {seconds: 7}\n",
    "metric/few": "# Two.\ndefaults: [p2f_mean, hausdorff]\n",
    "dataset/round": "# Large.\ndefaults: [bumps]\n",
    "training/short": "# Seconds.\nweights: trained\nseconds: 9\n",
    "convention/ours": "# @package _global_\ndefaults:\n  - override /metric: [p2f_mean]\nconvention:\n  name: ours\n"
    "  paper: We\n  code: none\n  prints: P2F.\n  columns: [{title: P2F, score: p2f_mean, factor: 1000}]\n",
}


def write(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / f"{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A working folder with a ``conf/`` of its own."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "conf", FILES)
    yield tmp_path / "conf"
    config_files.use([])


# -- found -------------------------------------------------------------------------------------------------------------


def test_an_experiment_of_ones_own_is_a_sweep_over_presets_of_ones_own(own):
    check(Request.of(["experiment=mine"], multirun=True))
    assert Request.of(["experiment=mine"]).is_sweep
    cells = [Cell.from_config(resolved(job)) for job in Request.of(["experiment=mine"], multirun=True).jobs]
    assert [(cell.method.name, cell.method.parameters["depth"]) for cell in cells] == [("poisson", 10), ("poisson", 8)]
    assert {cell.sensor.label for cell in cells} == {"rough[noise=0.03]"}
    assert {cell.cases for cell in cells} == {2} and [m.name for m in cells[0].metrics] == ["hausdorff", "p2f_mean"]


@pytest.mark.parametrize("group", ["method=finer", "dataset=round", "training=short", "convention=ours"])
def test_each_group_is_composed(own, group):
    values = resolved([group])
    wanted = {
        "method=finer": ("method", "trim", 0.2),
        "dataset=round": ("dataset", "_name_", "bumps"),
        "training=short": ("training", "seconds", 9),
        "convention=ours": ("convention", "name", "ours"),
    }[group]
    assert values[wanted[0]][wanted[1]] == wanted[2]
    assert presets.resolve("method", "finer") == "poisson" and presets.presets("method")["finer"].values["depth"] == 10


def test_a_folder_that_is_named_is_found_from_anywhere(own, tmp_path, monkeypatch):
    monkeypatch.chdir(Path(tmp_path, "..").resolve())
    with pytest.raises(UsageError, match="no experiment is called 'mine'"):
        check(Request.of(["experiment=mine"], multirun=True))
    config_files.use([str(own)])
    check(Request.of(["experiment=mine"], multirun=True))
    assert load_convention("ours").columns[0].title == "P2F"


@pytest.mark.parametrize(
    ("folder", "message"),
    [
        ("nowhere", "no such folder"),
        ("conf/experiment", "name the folder above"),
        ("empty", "expected files"),
    ],
)
def test_a_folder_without_configs_is_refused(own, tmp_path, folder, message):
    Path(tmp_path, "empty").mkdir()
    with pytest.raises(UsageError, match=message):
        config_files.use([folder])


def test_presets_of_an_installed_package_are_found_and_ours_count_before_them(tmp_path, monkeypatch):
    package = tmp_path / "their_package"
    write(package / "conf", {"method/theirs": FILES["method/fine"], "sensor/noisy": FILES["sensor/rough"]})
    write(package / "plugins" / "conf", {"sensor/theirs": FILES["sensor/rough"]})
    for folder in (package, package / "plugins"):
        Path(folder, "__init__.py").write_text("raise AssertionError('imported')\n")
    info = tmp_path / "their_package-1.0.dist-info"
    info.mkdir()
    Path(info, "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    Path(info, "entry_points.txt").write_text("[detailbench.plugins]\ntheirs = their_package.plugins\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(config_files, "_folders", config_files._folders.__wrapped__)  # sys.path has changed
    assert presets.presets("method")["theirs"].origin == "their-package 1.0"
    assert resolved(["method=theirs", "sensor=theirs"])["sensor"]["noise"] == 0.03
    assert resolved(["sensor=noisy"])["sensor"]["_name_"] == "chain"
    assert any("sensor=noisy" in line and "bench/conf" in line.split(" is used")[0] for line in presets.warnings())


def test_ones_own_name_counts_before_ours_and_it_is_reported(own, tmp_path):
    write(own, {"sensor/noisy": FILES["sensor/rough"], "method/jet": FILES["method/fine"]})
    write(tmp_path / "other", {"sensor/rough": FILES["sensor/rough"], "sensor/noisy": "defaults: [samples]\n"})
    config_files._found.cache_clear()
    assert resolved(["sensor=noisy"])["sensor"]["noise"] == 0.03
    assert resolved(["method=jet"])["method"]["_name_"] == "jet"  # a plugin's name is the plugin
    noisy, jet = presets.warnings()
    assert noisy.startswith(f"sensor=noisy: {own}/sensor/noisy.yaml is used, and ") and "method=jet" in jet
    config_files.use([str(tmp_path / "other")])
    assert presets.files("sensor")["noisy"].path.startswith(str(tmp_path / "other"))
    assert not any("rough" in line for line in presets.warnings())  # the same in both places


def test_our_own_checkout_is_no_folder_of_the_user(monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    assert [folder.origin for folder in config_files.folders()] == [config_files.OURS]


def test_the_listing_has_them_where_they_are_and_keeps_none(own, tmp_path, monkeypatch):
    write(own, {"method/wrong": "defaults: [poison]\n", "method/typo": "defaults: [poisson]\ndetph: 3\n"})
    config_files._found.cache_clear()
    found = listing()
    assert {"fine", "finer", "idf_30"} <= {preset["name"] for preset in found["presets"]["method"]}
    (poisson,) = (facts for facts in found["plugins"]["method"] if facts["name"] == "poisson")
    assert (
        poisson["presets"]["fine"]["help"] == "A deeper tree. Said in two lines." and "poisson_9" in poisson["presets"]
    )
    reasons = {Path(broken["file"]).stem: broken["reason"] for broken in found["broken"]}
    assert "'poisson'" in reasons["wrong"] and "'depth'" in reasons["typo"]
    monkeypatch.chdir(Path(tmp_path, "..").resolve())
    assert "fine" not in {preset["name"] for preset in listing()["presets"]["method"]}


# -- data, and never code ----------------------------------------------------------------------------------------------

GLOBAL = "# @package _global_\n"
CODE = {
    "callbacks": (GLOBAL + "hydra: {callbacks: {x: {_target_: os.mkdir, path: ran}}}\n", "_target_"),
    "a target in a method": ("defaults: [poisson]\ndepth: {_target_: os.mkdir, path: ran}\n", "_target_"),
    "logging": (GLOBAL + "hydra: {job_logging: {version: 1, '()': os.mkdir}}\n", "hydra.job_logging"),
    "the package of Hydra": ("# @package hydra\njob_logging: {version: 1}\n", "@package hydra"),
    "a package of a default": (GLOBAL + "defaults:\n  - override /sensor@hydra.callbacks: x\n", "defaults"),
    "a group of Hydra": (GLOBAL + "defaults:\n  - override /hydra/job_logging: mine\n", "hydra/job_logging"),
    "a launcher that starts programs": (GLOBAL + "defaults:\n  - override /hydra/launcher: ray\n", "hydra/launcher"),
    "parameters of a launcher": (GLOBAL + "hydra: {launcher: {setup: [mkdir ran]}}\n", "hydra.launcher.setup"),
    "another sweeper": (GLOBAL + "hydra: {sweeper: {_target_: os.mkdir}}\n", "_target_"),
    "plugin files": (GLOBAL + "plugins: [ran.py]\n", "no key 'plugins'"),
    "plugin files in a sweep": (GLOBAL + "hydra: {sweeper: {params: {plugins: '[ran.py]'}}}\n", "no key 'plugins'"),
    "a sweep of Hydra": (GLOBAL + "hydra: {sweeper: {params: {hydra.job_logging: x}}}\n", "hydra.job_logging"),
    "a file elsewhere": (GLOBAL + "defaults:\n  - override /method: ../../ran\n", "without a folder"),
    "a sweep over files elsewhere": (GLOBAL + "hydra: {sweeper: {params: {profile: ../ran}}}\n", "without a folder"),
    "a tag of YAML": (GLOBAL + "cases: !!python/object/apply:os.mkdir [ran]\n", "YAML"),
    "no YAML": (GLOBAL + "cases: [\n", "YAML"),
    "no mapping": ("- 3\n", "expected keys"),
    "no package": ("cases: 3\n", "# @package _global_"),
    "a wrong key": (GLOBAL + "case: 3\n", "Did you mean 'cases'"),
}


@pytest.mark.parametrize("name", CODE)
def test_a_file_that_is_more_than_data_is_refused_by_name_and_runs_nothing(own, tmp_path, name, capsys):
    text, message = CODE[name]
    group = "method" if "[poisson]" in text else "experiment"
    write(own, {f"{group}/bad": text})
    Path(tmp_path, "ran.py").write_text("import os\nos.mkdir('ran')\n")
    config_files._found.cache_clear()
    assert cli.main(["plan", f"{group}=bad"]) == 1
    error = capsys.readouterr().err
    assert f"{own}/{group}/bad.yaml" in error and message in error and "Traceback" not in error
    assert not Path(tmp_path, "ran").exists()


def test_a_name_that_is_put_in_for_an_interpolation_leads_to_no_other_file(own, tmp_path, capsys):
    """Hydra would take ``profile=../../ran`` for a path."""
    write(tmp_path, {"ran": GLOBAL + "cases: 99\n"})
    sweep = "sizes: {quick: ../../../ran}\nhydra: {mode: MULTIRUN, sweeper: {params: {profile: '${sizes.quick}'}}}\n"
    write(own, {"experiment/bad": GLOBAL + sweep})
    config_files._found.cache_clear()
    assert cli.main(["plan", "experiment=bad"]) == 1
    assert "no profile is called" in (error := capsys.readouterr().err) or "expected a name" in error


def test_what_is_beside_our_groups_is_not_looked_at(own):
    """Not the main config, which Hydra would take instead of ours, and none of Hydra's groups."""
    write(own, {"config": "cases: 77\n", "hydra/job_logging/none": "version: 2\n", "hydra/callbacks/x": "a: 1\n"})
    assert compose([]).cases == 4


# -- kept in records ---------------------------------------------------------------------------------------------------


def test_a_cell_of_a_preset_is_explained_and_repeated_where_the_preset_is_not(own, tmp_path, monkeypatch, capsys):
    words = ["task=denoise", "method=kept", "dataset=cad", "sensor=rough", "metric=few", "cases=1", "profile=tiny"]
    write(own, {"method/kept": "# As it is.\ndefaults: [identity]\n"})
    config_files._found.cache_clear()
    assert cli.main(["run", *words, "results=r", "--no-leaderboard"]) == 0
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.move(tmp_path / "r", elsewhere / "r")
    monkeypatch.chdir(elsewhere)
    capsys.readouterr()
    assert "rough" not in presets.names("sensor")
    cell = next(Path("r", "cells").glob("**/*.parquet")).stem[:12]
    assert cli.main(["why", cell, "results=r"]) == 0
    assert "it would not be run again" in capsys.readouterr().out
    assert cli.main(["reproduce", cell, "results=r"]) == 0
    assert "every status and score agrees" in capsys.readouterr().out


def test_an_experiment_of_ones_own_may_have_published_numbers(own):
    published = "published: {source: S, short: s, convention: ours, lines: [{method: poisson, values: {P2F: 3}}]}\n"
    write(own, {"experiment/paper": GLOBAL + published, "experiment/half": GLOBAL + "published: {source: S}\n"})
    config_files._found.cache_clear()
    assert load_published("paper").value("P2F", "poisson", "", "samples") == 3
    with pytest.raises(UsageError, match=r"half\.yaml: published: expected"):
        load_published("half")
