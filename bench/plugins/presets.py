"""Presets: YAML files that give a plugin's parameters a name, such as ``conf/sensor/noisy.yaml``.

::

    # What it is, and whose setting.        <- the help
    defaults: [samples]                     <- the plugin
    noise: 0.01                             <- its parameters

``sensor=noisy`` is ``sensor=samples sensor.noise=0.01``: the same cell, under the preset's name in tables.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

from .metric_sets import FULL
from .registry import Plugin, registry
from .schema import build, parameters


class Preset(NamedTuple):
    """One YAML file of a group of plugins."""

    name: str
    plugin: str
    values: Mapping[str, Any]
    help: str


def names(group: str) -> list[str]:
    """The YAML files of a config group, without the suffix; of metrics also the set that is made of the plugins."""
    from importlib.resources import files

    folder = files("bench.conf") / group
    found = {FULL} if group == "metric" else set()
    if folder.is_dir():
        found |= {f.name.removesuffix(".yaml") for f in folder.iterdir() if f.name.endswith(".yaml")}
    return sorted(found)


def presets(kind: str, of: str = "") -> dict[str, Preset]:
    """The presets of a kind of plugin, by name; of all plugins, or of one."""
    if kind == "metric":
        return {}  # those of metrics choose several plugins
    # A file that does not mention the plugin need not be parsed, which is slow.
    found = {name: _read(kind, name) for name in names(kind) if of in _text(kind, name)}
    return {name: preset for name, preset in found.items() if of in ("", preset.plugin)}


@functools.cache
def _text(kind: str, name: str) -> str:
    from importlib.resources import files

    return (files("bench.conf") / kind / f"{name}.yaml").read_text(encoding="utf-8")


@functools.cache
def _read(kind: str, name: str) -> Preset:
    from omegaconf import OmegaConf

    text = _text(kind, name)
    content = OmegaConf.to_container(OmegaConf.create(text))
    assert isinstance(content, dict)
    plugin = next(entry for entry in content.pop("defaults") if entry != "_self_")
    comment = [line.lstrip("# ").rstrip() for line in text.splitlines() if line.startswith("#")]
    return Preset(name, plugin, content, " ".join(comment))


def name_of(plugin: Plugin, values: Mapping[str, Any]) -> str | None:
    """The preset that gives ``plugin`` just these parameters; the first by name where several do."""
    return _known(plugin.kind, plugin.name).get(_key(values))


@functools.cache
def _known(kind: str, name: str) -> dict[str, str]:
    plugin = registry().find(kind, name)
    mine = reversed(presets(kind, name).values())
    return {_key(parameters(plugin, build(plugin, preset.values))): preset.name for preset in mine}


def _key(values: Mapping[str, Any]) -> str:
    import json

    return json.dumps(values, sort_keys=True)


def resolve(kind: str, name: str) -> str:
    """The plugin behind a name: that of the preset, or of the plugin itself."""
    if name in registry().names(kind):
        return name
    return _read(kind, name).plugin if kind != "metric" and name in names(kind) else name
