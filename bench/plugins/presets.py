"""Presets: YAML files that give a plugin's parameters a name, such as ``conf/sensor/noisy.yaml``.

::

    # What it is, and whose setting.        <- the help
    defaults: [samples]                     <- the plugin
    noise: 0.01                             <- its parameters

``sensor=noisy`` is ``sensor=samples sensor.noise=0.01``: the same cell, under the preset's name in tables. A preset may
also name another one as its plugin, and change parameters of it. Where the files are: :mod:`config_files`.

``_tier_: tuned`` states that a search chose the parameters (`detailbench tune`). It is not a parameter: tables mark the
method with it.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..errors import UsageError, did_you_mean
from . import config_files
from .config_files import ConfigFile
from .metric_sets import FULL
from .registry import KINDS, Plugin, registry
from .schema import build, parameters, variant

TIER = "_tier_"  # the key that states how parameters were chosen
TUNED = "tuned"


class Preset(NamedTuple):
    """One YAML file of a group of plugins."""

    name: str
    plugin: str
    values: Mapping[str, Any]
    help: str
    file: str
    origin: str
    tier: str = ""


def names(group: str) -> list[str]:
    """The names in a config group, sorted; of metrics also the set of all plugins."""
    found = {FULL} if group == "metric" else set()
    return sorted(found.union(files(group)))


def files(group: str, *, own: bool = True) -> dict[str, ConfigFile]:
    """The files of a group by name, without those named like a plugin, which takes precedence."""
    taken = registry().names(group) if group in KINDS else ()
    return {name: file for name, file in config_files.files(group, own=own).items() if name not in taken}


def warnings() -> list[str]:
    """Warnings about names in two places: which one is used."""
    lines = config_files.hidden()
    for kind in KINDS:
        for name in sorted({*config_files.files(kind)}.difference(files(kind))):
            file = config_files.files(kind)[name].path
            lines.append(f"{kind}={name} is the {kind} itself, and {file} is not used: give the file another name")
    return lines


def presets(kind: str, of: str = "", *, own: bool = True) -> dict[str, Preset]:
    """The presets of a kind of plugin, by name; of all plugins, or of one. Invalid files of users are left out.

    Those are in :func:`broken`, and the error of one is reported when it is requested. Without ``own`` they are
    the installed ones.
    """
    found = files(kind, own=own) if kind != "metric" else {}  # those of metrics choose several plugins
    return _presets(kind, of, found)


def own_presets(kind: str) -> dict[str, Preset]:
    """The presets in the user's own folders, by name; no other file is read."""
    found = files(kind) if kind != "metric" else {}
    return _presets(kind, "", {name: file for name, file in found.items() if file.folder.is_own})


def _presets(kind: str, of: str, files: Mapping[str, ConfigFile]) -> dict[str, Preset]:
    found = {}
    for name, file in files.items():
        # A file of ours that does not mention the plugin need not be parsed, which is slow.
        if file.folder.origin == config_files.OURS and of not in _text(file):
            continue
        try:
            found[name] = _read(kind, name, file)
        except UsageError:
            continue
    return {name: preset for name, preset in found.items() if of in ("", preset.plugin)}


def broken(*, own: bool) -> list[tuple[str, str]]:
    """The files of the user's folders, or those of packages, that are not valid presets, with the reason."""
    found = []
    for kind in KINDS:
        for name, file in files(kind, own=own).items() if kind != "metric" else ():
            if file.folder.origin != config_files.OURS and file.folder.is_own == own:
                try:
                    _read(kind, name, file)
                except UsageError as error:
                    found.append((file.path, str(error).removeprefix(f"{file.path}: ")))
    return found


@functools.cache
def _text(file: ConfigFile) -> str:
    return file.text()


@functools.cache
def _read(kind: str, name: str, file: ConfigFile) -> Preset:
    """The preset of a file, checked unless it is ours.

    Raises
    ------
    UsageError
        With the name of the file.
    """
    text = _text(file)
    content = content_of(file.path, text)
    chosen, tier = content.pop("defaults", None), content.pop(TIER, "")
    if tier not in ("", TUNED):
        raise UsageError(f"{file.path}: {TIER}: expected {TUNED}, or leave the key out")
    plugins = [entry for entry in chosen if entry != "_self_"] if isinstance(chosen, list) else []
    if len(plugins) != 1 or not isinstance(plugins[0], str) or plugins[0] == name:
        raise UsageError(f"{file.path}: expected the {kind} that it is a preset of, for instance defaults: [NAME]")
    plugin, values = plugins[0], content
    if plugin not in registry().names(kind) and plugin in files(kind):
        other = _read(kind, plugin, files(kind)[plugin])
        plugin, values, tier = other.plugin, {**other.values, **content}, tier or other.tier
    if file.folder.origin != config_files.OURS:
        _check(kind, plugin, values, file.path)
    return Preset(name, plugin, values, help_of(text), file.path, file.folder.origin, tier)


def content_of(path: str, text: str) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Raises
    ------
    UsageError
        If it is not YAML, or not a mapping, with the place.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    try:
        content: Any = OmegaConf.to_container(OmegaConf.create(text)) if text.strip() else {}
    except (YAMLError, OmegaConfBaseException, AssertionError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise UsageError(f"{path}: expected keys with values, one `key: value` on a line")
    return content


def help_of(text: str) -> str:
    """The comment of a YAML file as one paragraph, without the line that names its package."""
    lines = [line for line in text.splitlines() if line.startswith("#") and not line.startswith("# @package")]
    return " ".join(line.lstrip("# ").rstrip() for line in lines)


def _check(kind: str, plugin: str, values: Mapping[str, Any], path: str) -> None:
    """Check that a preset's plugin exists and has these parameters; interpolations are left to Hydra."""
    if plugin not in registry().names(kind):
        raise UsageError(f"{path}: no {kind} is called {plugin!r}. {did_you_mean(plugin, registry().names(kind))}")
    known = [f.name for f in registry().find(kind, plugin).fields]
    for key in values:
        if key not in known:
            raise UsageError(f"{path}: {kind} {plugin} has no parameter {key!r}. {did_you_mean(str(key), known)}")


def name_of(plugin: Plugin, values: Mapping[str, Any]) -> str | None:
    """The preset that gives ``plugin`` exactly these parameters; the first by name where several do.

    A preset of the user's own is called ``NAME[parameters]``: its file may change while results stay.
    """
    return _known(plugin.kind, plugin.name, config_files.folders()).get(_key(values))


@functools.cache
def _known(kind: str, name: str, folders: tuple[config_files.Folder, ...]) -> dict[str, str]:
    plugin = registry().find(kind, name)
    found: dict[str, str] = {}
    # The first one is used: ours before those of users, and of equals the first by name.
    for preset in sorted(presets(kind, name).values(), key=lambda preset: preset.origin != config_files.OURS):
        try:
            values = parameters(plugin, build(plugin, preset.values))
        except UsageError:
            if preset.origin == config_files.OURS:
                raise
            continue  # its error is reported when it is chosen
        changed = variant(plugin, values)
        label = f"{preset.name}[{changed}]" if preset.origin == "own" and changed else preset.name
        found.setdefault(_key(values), label)
    return found


def variants(kind: str, of: str) -> Mapping[str, str]:
    """The changes of each preset of a plugin, as results name them: ``{"idf_30": "omega=30"}``.

    Empty for a plugin that is not installed; presets that are broken, or change nothing, are left out.
    """
    return _variants(kind, of, config_files.folders()) if of in registry().names(kind) else {}


@functools.cache
def _variants(kind: str, of: str, folders: tuple[config_files.Folder, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for name, preset in presets(kind, of).items():
        try:
            plugin = registry().find(kind, of)
            changed = variant(plugin, parameters(plugin, build(plugin, preset.values)))
        except UsageError:
            continue  # its error is reported when it is chosen
        if changed:
            found[name] = changed
    return found


def tuned_variants(kind: str, of: str) -> frozenset[str]:
    """The parameters of a plugin, as results name them, that a search chose, according to its presets."""
    return _tuned(kind, of, config_files.folders())


@functools.cache
def _tuned(kind: str, name: str, folders: tuple[config_files.Folder, ...]) -> frozenset[str]:
    if not any(preset.tier for preset in own_presets(kind).values()) or name not in registry().names(kind):
        return frozenset()
    plugin, found = registry().find(kind, name), set()
    for preset in presets(kind, name).values():
        with contextlib.suppress(UsageError):  # its error is reported when it is chosen
            if preset.tier:
                found.add(variant(plugin, parameters(plugin, build(plugin, preset.values))))
    return frozenset(found - {""})


def _key(values: Mapping[str, Any]) -> str:
    import json

    return json.dumps(values, sort_keys=True)


def resolve(kind: str, name: str) -> str:
    """The plugin behind a name: that of the preset, or of the plugin itself."""
    if name in registry().names(kind):
        return name
    found = files(kind) if kind != "metric" else {}
    return _read(kind, name, found[name]).plugin if name in found else name
