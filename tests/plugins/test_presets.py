"""Presets: a name for a plugin's parameters, the same cell, refused as clearly as a plugin's own name."""

import pytest

from bench.errors import UsageError
from bench.plan.cell import Cell, Choice, reference_name
from bench.plugins import presets
from bench.plugins.registry import registry
from bench.plugins.schema import build, parameters
from bench.sweep.composition import compose
from bench.sweep.overrides import check
from bench.sweep.request import Request

SENSORS = presets.presets("sensor")


def cell(*overrides):
    from omegaconf import OmegaConf

    return Cell.from_config(OmegaConf.to_container(compose(overrides)))


@pytest.mark.parametrize("name", SENSORS)
def test_every_preset_of_a_sensor_is_a_sensor_and_gives_its_cells_a_name(name):
    preset = SENSORS[name]
    plugin = registry().find("sensor", preset.plugin)
    values = parameters(plugin, build(plugin, preset.values))
    assert len(preset.help) > 20
    label = Choice("sensor", plugin.name, values).label
    assert SENSORS[label].values == preset.values  # its own name, or that of an equal one
    assert name not in registry().names("sensor")


def test_a_preset_is_the_cell_that_its_parameters_make():
    preset = SENSORS["scanned"]
    written = [f"sensor.{key}={value}" for key, value in preset.values.items()]
    named = cell("sensor=scanned")
    assert named == cell(f"sensor={preset.plugin}", *written)
    assert named.sensor.label == "scanned"
    assert named.sensor.name == preset.plugin


def test_a_changed_preset_is_called_after_its_parameters():
    changed = cell("sensor=scanned", "sensor.views=3")
    assert changed.sensor.parameters["views"] == 3
    assert changed.sensor.label.startswith("triangulation[views=3,")


def test_the_defaults_keep_the_plugins_name():
    assert cell("sensor=samples").sensor.label == "samples"


@pytest.mark.parametrize(("word", "hint"), [("nosiy", "noisy"), ("scaned", "scanned"), ("sampels", "samples")])
def test_a_wrong_name_gets_the_nearest_plugin_or_preset(word, hint):
    with pytest.raises(UsageError, match=f"no sensor is called '{word}'.*'{hint}'"):
        check(Request.of([f"sensor={word}"]))


def test_a_wrong_parameter_of_a_preset_gets_the_nearest_of_its_plugin():
    with pytest.raises(UsageError, match="has no parameter 'veiws'.*'sensor.views'"):
        check(Request.of(["sensor=scanned", "sensor.veiws=3"]))


def test_a_chain_is_named_by_its_steps():
    chain = cell("sensor=chain", "sensor.steps=[{poisson_disk:{count:625}},{gaussian:{sigma:0.0025}},normals_none]")
    assert chain.sensor.label == "chain[steps=poisson_disk(count=625)+gaussian(sigma=0.0025)+normals_none]"
    assert [p.name for p in chain.sensor.parts] == ["chain", "poisson_disk", "gaussian", "normals_none"]


def test_an_edited_step_is_another_fingerprint(monkeypatch):
    from bench.results import provenance

    chain = cell("sensor=chain", "sensor.steps=[poisson_disk,gaussian]")
    before, keys = provenance.fingerprint(provenance.ingredients(chain)), provenance.memory_keys(chain)
    real = provenance.source_digest
    monkeypatch.setattr(provenance, "source_digest", lambda file: real(file) + ("x" if file.stem == "gaussian" else ""))
    assert provenance.fingerprint(provenance.ingredients(chain)) != before
    after = provenance.memory_keys(chain)
    assert {key for key in keys if keys[key] != after[key]} == {"sensor"}


@pytest.mark.parametrize("name", presets.names("method"))
def test_every_method_preset_names_parameters_that_exist(name):
    """A preset that nothing can be built from would fail when its experiment is run."""
    from bench.plugins.registry import registry
    from bench.plugins.schema import build

    preset = presets.presets("method")[name]
    built = build(registry().find("method", preset.plugin), preset.values)
    for key, value in preset.values.items():
        assert getattr(built, key) == (tuple(value) if isinstance(value, list) else value)


def test_apply_takes_a_preset(tmp_path):
    from bench.commands.apply import jobs_of

    scan = tmp_path / "scan.xyz"
    scan.write_text("0 0 0\n")
    words = ["method=idf_30", "method.steps=20"]
    (job,) = jobs_of(words, [str(scan), str(tmp_path / "out.ply")], ())
    method = job.method
    assert method.name == "idf"
    assert method.parameters["omega"] == 30
    assert method.parameters["steps"] == 20


def test_a_reference_s_file_tells_the_parameters_of_its_dataset():
    assert reference_name("reliefs", "reliefs-test-000") == "reliefs-reliefs-test-000.ply"
    named = {reference_name(f"reliefs[amplitude={a}]", "reliefs-test-000") for a in (0.1, 0.01)}
    assert len(named) == 2
    assert all(name.startswith("reliefs-") and name.endswith("-reliefs-test-000.ply") for name in named)
    assert "/" not in reference_name("files[path=/data/scans]", "bunny")
