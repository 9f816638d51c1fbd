"""The configs that jobs are given are those that Hydra would compose for them."""

from __future__ import annotations

import contextlib

import pytest
from hydra.errors import ConfigCompositionException
from hydra.types import RunMode
from joblib.externals import cloudpickle
from omegaconf import OmegaConf

from bench.sweep.composition import CONFIG_NAME, hydra_ready
from bench.sweep.known import KnownConfigs
from bench.sweep.parts import values_of
from bench.sweep.request import Request

PRIVATE = ["session='7-8-here'", "plugins=['/a/b.py']"]


@pytest.fixture
def loaders():
    """A function: Hydra's loader, ours over it, the config of the launcher, and the jobs of a sweep."""
    with contextlib.ExitStack() as stack:

        def make(*words):
            jobs = Request.of(words, multirun=True).jobs
            configs = values_of(jobs)
            assert configs is not None
            jobs = [[*job, *PRIVATE] for job in jobs]
            hydras = stack.enter_context(hydra_ready())
            master = hydras.load_configuration(CONFIG_NAME, jobs[0], run_mode=RunMode.MULTIRUN)
            return hydras, KnownConfigs(hydras, jobs, configs), master, jobs

        yield make


def hydras_part(config):
    """What Hydra says of itself, without what nothing reads."""
    part = OmegaConf.to_container(config.hydra)
    del part["job"]["override_dirname"], part["runtime"]["choices"]
    return part


def test_they_are_those_that_hydra_composes(loaders):
    hydras, ours, master, jobs = loaders("method=jet,poisson", "sensor.noise=0.01,0.02", "profile=quick", "seed=3")
    assert len(jobs) == 4
    for job in jobs:
        expected, found = (loader.load_sweep_config(master, job) for loader in (hydras, ours))
        assert hydras_part(found) == hydras_part(expected)
        assert found.hydra.sweep.dir == expected.hydra.sweep.dir == "results/.sweeps/7-8-here/hydra"
        values = read_by_jobs(found)
        assert values == read_by_jobs(expected)
        assert values["session"] == "7-8-here" and values["plugins"] == ["/a/b.py"]
    assert master.hydra.overrides.task == jobs[0]  # still


def read_by_jobs(config):
    """All but Hydra's part."""
    return OmegaConf.to_container(OmegaConf.masked_copy(config, config.keys() - {"hydra"}), resolve=True)


def test_other_jobs_and_other_processes_are_hydras(loaders, monkeypatch):
    hydras, ours, master, jobs = loaders("method=jet,poisson")
    composed = []
    monkeypatch.setattr(hydras, "load_sweep_config", lambda config, words: composed.append(words))
    for job in jobs:
        ours.load_sweep_config(master, job)
    assert composed == []
    other = ["method=identity", *PRIVATE]
    ours.load_sweep_config(master, other)
    assert composed == [other]
    monkeypatch.undo()
    assert type(cloudpickle.loads(cloudpickle.dumps(ours))) is type(hydras)


def test_text_that_looks_like_an_interpolation_is_left_to_hydra(loaders):
    hydras, ours, master, jobs = loaders("method=jet,poisson", r"results='\${here}'")
    found, expected = (loader.load_sweep_config(master, jobs[1]).results for loader in (ours, hydras))
    assert found == expected == "${here}"


@pytest.mark.parametrize("words", [["method=apss", "seed=3"], ["experiment=demo", "method=jet"]], ids=" ".join)
def test_the_first_job_gets_a_copy_of_the_config_of_the_sweep(words):
    with hydra_ready() as hydras:
        master = hydras.load_configuration(CONFIG_NAME, words, run_mode=RunMode.MULTIRUN)
        ours = KnownConfigs(hydras, [words], None)
        expected = hydras.load_sweep_config(master, words)
        first, again = (ours.load_sweep_config(master, words) for _ in range(2))
    for found in (first, again):
        assert repr(OmegaConf.to_container(found)) == repr(OmegaConf.to_container(expected))
        assert found._metadata == expected._metadata
    assert first is not master and first.hydra is not master.hydra and again is not first


def test_several_values_are_left_to_hydra_which_refuses_them():
    with hydra_ready() as hydras:
        master = hydras.load_configuration(CONFIG_NAME, ["seed=1,2"], run_mode=RunMode.MULTIRUN)
        with pytest.raises(ConfigCompositionException, match="seed=1,2"):
            KnownConfigs(hydras, [["seed=1,2"]], None).load_sweep_config(master, ["seed=1,2"])
