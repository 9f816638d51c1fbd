"""The one folder that results go to, however it is said."""

import pytest
from omegaconf import OmegaConf

from bench.errors import UsageError
from bench.sweep import request as requests
from bench.sweep.destination import settled
from bench.sweep.request import Request

PLACE = "it's a/b,c"


@pytest.mark.parametrize(
    ("words", "folder"),
    [
        (["seed=1"], "results"),
        (["results=a/b"], "a/b"),
        (["results='a,b'"], "a,b"),
        (["+results=a", "++results=b"], "b"),
        (["results=2026"], "2026"),
        (["results=true"], "true"),
        (["results='~/x'"], "~/x"),
        (["results=${oc.env:PLACE}/x"], f"{PLACE}/x"),
        (["experiment=demo"], "results"),
        (["experiment=no_such"], "results"),
    ],
)
def test_one_folder(words, folder, monkeypatch):
    """It is handed on in place of what was said, whatever letters are in it."""
    monkeypatch.setenv("PLACE", PLACE)
    request = settled(Request.of(words))
    assert request.folder == folder
    assert request.words[:-1] == [word for word in words if "results" not in word]
    override = request.overrides[-1]
    assert override.key_or_group == "results" and override.value() == folder and not override.is_sweep_override()


@pytest.mark.parametrize(
    "word",
    [
        "results=a,b",
        "results=choice(a,b)",
        "results=range(3)",
        "results='out_${seed}'",
        "+results='out_${seed}'",
        "++results=${method._name_}",
        "results='${oc.env:PLACE}/${seed}'",
        "results=${hydra.runtime.cwd}/x",
        "results=${now:%S}",
        "results=${oc.env:NOT_SET_ANYWHERE}",
        "results=null",
        "results=",
        "results=' '",
        "results=[a]",
        "results=~/x",
        "~results",
        "hydra.sweeper.params.results=a,b",
    ],
)
def test_anything_but_one_folder_is_refused_with_its_override(word, monkeypatch):
    monkeypatch.setenv("PLACE", PLACE)
    with pytest.raises(UsageError) as refused:
        settled(Request.of(["seed=0,1", word], multirun=True))
    assert word in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("says", "folder"),
    [
        ({"results": "mine"}, "mine"),
        ({"results": "out_${seed}"}, None),
        ({"results": "results", "hydra": {"sweeper": {"params": {"results": "a,b"}}}}, None),
    ],
)
def test_an_experiment_may_name_the_folder(says, folder, monkeypatch):
    monkeypatch.setattr(requests, "experiment_config", lambda named: OmegaConf.create({"seed": 0, **says}))
    assert settled(Request.of(["experiment=e", "results=other"])).folder == "other"
    if folder:
        assert settled(Request.of(["experiment=e"])).folder == folder
    else:
        with pytest.raises(UsageError, match="experiment=e: results=.*expected one folder"):
            settled(Request.of(["experiment=e"]))
