"""`detailbench list` of experiments, conventions, profiles and presets: what their files say, ours and the user's."""

import json
from pathlib import Path

import pytest
import yaml

from bench import cli
from bench.plugins import config_files
from bench.plugins.config_listing import described

CONF = Path(config_files.__file__).parents[1] / "conf"


def listed(capsys, *words):
    code = cli.main(["list", *words])
    done = capsys.readouterr()
    return code, done.out, done.err


@pytest.mark.parametrize("group", ["experiment", "convention", "profile", "training"])
def test_every_file_of_a_group_is_listed_with_a_summary(group, capsys):
    code, out, _ = listed(capsys, f"{group}s")
    names = {path.stem for path in Path(CONF, group).glob("*.yaml")}
    lines = {line.split()[0]: line.split(None, 1)[1] for line in out.splitlines()[1:] if line.strip()}
    assert code == 0 and set(lines) == names and all(len(text) > 5 for text in lines.values())


def test_an_experiment_says_what_it_sweeps_chooses_and_sets(capsys):
    content = yaml.safe_load(Path(CONF, "experiment", "demo.yaml").read_text())
    _, out, _ = listed(capsys, "experiment", "demo")
    for key, values in content["hydra"]["sweeper"]["params"].items():
        assert f"  {key}={values}" in out.replace("\n      ", "")
    assert "  profile=quick" in out and "  cases=4" in out and "detailbench run experiment=demo" in out
    code, out, _ = listed(capsys, "experiment", "demo", "--json")
    assert json.loads(out)[0]["swept"]["dataset"] == "bumps,cad"


def test_each_experiment_has_a_swept_value_or_a_choice():
    found, broken = described("experiment")
    assert broken == [] and [facts["name"] for facts in found if not (facts["swept"] or facts["chosen"])] == []


def test_a_convention_shows_the_formula_of_each_column(capsys):
    _, out, _ = listed(capsys, "convention", "idf")
    assert "CD (1e-3)               1000 x chamfer_l1_sum" in out


def test_a_profile_shows_its_numbers(capsys):
    content = yaml.safe_load(Path(CONF, "profile", "quick.yaml").read_text())
    _, out, _ = listed(capsys, "profile", "quick")
    assert f"limit.seconds={content['limit']['seconds']}" in out and f"cases={content['cases']}" in out


def test_a_preset_shows_its_own_parameters(capsys):
    _, out, _ = listed(capsys, "sensor", "noisy")
    assert "a preset of chain" in out and "    gaussian  sigma=0.01" in out and "    poisson_disk  count=5000" in out
    _, out, _ = listed(capsys, "method", "poisson_9")
    assert "  method.depth=9" in out and "at their defaults: trim" in out
    assert listed(capsys, "preset", "noisy")[1].startswith("sensor noisy")
    assert json.loads(listed(capsys, "sensor", "noisy", "--json")[1])["plugin"] == "chain"


def test_a_set_of_metrics_shows_its_metrics(capsys):
    _, out, _ = listed(capsys, "metric", "standard")
    assert "chamfer_l2_sum" in out and "set of metrics standard" in out
    assert "[set]" in listed(capsys, "metrics")[1]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["experimets"], "Did you mean 'experiments'"),
        (["experiment", "dmo"], "no experiment is called 'dmo'. Did you mean 'demo'"),
        (["noisy"], "detailbench list sensor noisy"),
        (["poisson"], "detailbench list method poisson"),
        (["sensor", "nosiy"], "Did you mean 'noisy'"),
    ],
)
def test_a_wrong_argument_gets_the_nearest_right_one(words, hint, capsys):
    code, out, err = listed(capsys, *words)
    assert code == 1 and hint in err and out == ""


def test_a_file_of_ones_own_is_listed_with_its_path_and_a_wrong_one_as_broken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("conf/profile").mkdir(parents=True)
    Path("conf/profile/tiny.yaml").write_text("# @package _global_\n# A minute.\nprofile: tiny\ncases: 2\n")
    Path("conf/profile/bad.yaml").write_text("cases: [\n")
    _, out, _ = listed(capsys, "profiles")
    assert (
        f"A minute. ({tmp_path}/conf/profile/tiny.yaml)" in out and f"broken: {tmp_path}/conf/profile/bad.yaml" in out
    )
    code, _, err = listed(capsys, "profile", "bad")
    assert code == 1 and "bad.yaml: cannot be read as YAML" in err
