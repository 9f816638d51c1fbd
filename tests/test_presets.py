"""Presets: a name for a plugin's parameters, the same cell, refused as clearly as a plugin's own name."""

import pytest

from bench import presets
from bench.config import compose
from bench.errors import UsageError
from bench.overrides import check_overrides
from bench.plan import Cell, Choice
from bench.registry import registry
from bench.schema import build, parameters

SENSORS = presets.presets("sensor")


def cell(*overrides):
    from omegaconf import OmegaConf

    return Cell.from_config(OmegaConf.to_container(compose(overrides)))


@pytest.mark.parametrize("name", SENSORS)
def test_every_preset_of_a_sensor_is_a_sensor_with_parameters_of_its_own(name):
    preset = SENSORS[name]
    plugin = registry().find("sensor", preset.plugin)
    values = parameters(plugin, build(plugin, preset.values))
    assert values != parameters(plugin, plugin.cls())
    assert len(preset.help) > 20
    assert Choice("sensor", plugin.name, values).label in SENSORS
    assert name not in registry().names("sensor")


def test_a_preset_is_the_cell_that_its_parameters_make():
    preset = SENSORS["noisy"]
    written = [f"sensor.{key}={value}" for key, value in preset.values.items()]
    named = cell("sensor=noisy")
    assert named == cell(f"sensor={preset.plugin}", *written)
    assert named.sensor.label == "noisy"
    assert named.sensor.name == preset.plugin


def test_a_changed_preset_is_called_after_its_parameters():
    changed = cell("sensor=noisy", "sensor.count=77")
    assert changed.sensor.parameters["count"] == 77
    assert "count=77" in changed.sensor.label and not changed.sensor.label.startswith("noisy")


def test_the_defaults_keep_the_plugins_name():
    assert cell("sensor=samples").sensor.label == "samples"


@pytest.mark.parametrize(("word", "hint"), [("nosiy", "noisy"), ("scaned", "scanned"), ("sampels", "samples")])
def test_a_wrong_name_gets_the_nearest_plugin_or_preset(word, hint):
    with pytest.raises(UsageError, match=f"no sensor is called '{word}'.*'{hint}'"):
        check_overrides([f"sensor={word}"], multirun=False)


def test_a_wrong_parameter_of_a_preset_gets_the_nearest_of_its_plugin():
    with pytest.raises(UsageError, match=r"'?sensor.cuont'?.*'sensor.count'|has no parameter 'cuont'.*count"):
        check_overrides(["sensor=noisy", "sensor.cuont=3"], multirun=False)


def test_a_chain_is_named_by_its_steps():
    chain = cell("sensor=chain", "sensor.steps=[{poisson_disk:{count:625}},{gaussian:{sigma:0.0025}},normals_none]")
    assert chain.sensor.label == "chain[steps=poisson_disk(count=625)+gaussian(sigma=0.0025)+normals_none]"
    assert [p.name for p in chain.sensor.parts] == ["chain", "poisson_disk", "gaussian", "normals_none"]


def test_an_edited_step_is_another_fingerprint(monkeypatch):
    from bench import provenance

    chain = cell("sensor=chain", "sensor.steps=[poisson_disk,gaussian]")
    before, keys = provenance.fingerprint(provenance.ingredients(chain)), provenance.memory_keys(chain)
    real = provenance.source_digest
    monkeypatch.setattr(provenance, "source_digest", lambda file: real(file) + ("x" if file.stem == "gaussian" else ""))
    assert provenance.fingerprint(provenance.ingredients(chain)) != before
    after = provenance.memory_keys(chain)
    assert {key for key in keys if keys[key] != after[key]} == {"sensor"}
