"""Plugins and presets as plain values, as ``detailbench list`` prints them."""

from __future__ import annotations

import importlib.util
import inspect
import typing
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from . import config_files
from .kept import keep, kept_listing, stamp

if TYPE_CHECKING:
    from .registry import Plugin


def listing(files: Sequence[str] = ()) -> dict[str, Any]:
    """Every plugin, every preset, and the broken ones.

    Parameters
    ----------
    files : paths of plugin files, as ``--plugin`` names them

    Returns
    -------
    dict
        ``plugins`` and ``presets``: by kind, lists of facts; ``broken``: a list of origin, file and reason.
    """
    if files:
        return _with_own(_made(files))
    now = stamp()
    found = kept_listing(now)
    if found is None:
        found = _made(())
        if _is_of_installed(found):
            keep(now, found)
    return _with_own(found)


def names_as_kept() -> dict[str, Any]:
    """:func:`listing` as last cached, though sources may have changed since, without the user's own presets.

    For command-line completion, where checking each source would take longest.
    """
    return kept_listing() or listing()


def _with_own(found: dict[str, Any]) -> dict[str, Any]:
    """The listing with the presets of the user's own folders, not cached: they depend on the working folder."""
    if not any(folder.is_own for folder in config_files.folders()):
        return found
    from . import presets

    for kind, plugins in found["plugins"].items():
        own = presets.own_presets(kind)
        if not own:
            continue
        hidden = [preset for preset in found["presets"][kind] if preset["name"] not in own]
        found["presets"][kind] = sorted([*hidden, *map(_preset, own.values())], key=lambda preset: preset["name"])
        for facts in plugins:
            mine = {p.name: {"help": p.help, **p.values} for p in own.values() if p.plugin == facts["name"]}
            others = {name: preset for name, preset in facts.get("presets", {}).items() if name not in own}
            if mine or others:
                facts["presets"] = dict(sorted({**others, **mine}.items()))
    found["broken"] += _broken(own=True)
    return found


def _is_of_installed(found: dict[str, Any]) -> bool:
    """Whether a listing has nothing specific to this process, such as a plugin file or a class imported by hand."""
    from .registry import registry

    origins = [facts["origin"] for plugins in found["plugins"].values() for facts in plugins]
    return "imported" not in origins and not registry().files


def _broken(*, own: bool) -> list[dict[str, str]]:
    from .presets import broken

    return [{"origin": file, "file": file, "reason": reason} for file, reason in broken(own=own)]


def _preset(preset: Any) -> dict[str, Any]:
    return preset._asdict() | {"values": dict(preset.values)}


def _made(files: Sequence[str]) -> dict[str, Any]:
    from .presets import presets
    from .registry import KINDS, load_plugins, registry
    from .schema import check_configs

    load_plugins(files, warn=False)
    found = registry()
    check_configs()
    return {
        "plugins": {kind: [as_json(plugin) for plugin in found.all(kind)] for kind in KINDS},
        "presets": {kind: [_preset(p) for p in presets(kind, own=False).values()] for kind in KINDS},
        "broken": [{"origin": b.origin, "file": str(b.file or ""), "reason": b.reason} for b in found.broken]
        + _broken(own=False),
    }


def as_json(plugin: Plugin) -> dict[str, Any]:
    """A plugin's facts, as JSON values."""
    from . import catalog
    from .fields import field_help
    from .presets import presets
    from .registry import registry
    from .schema import defaults, field_types

    helps = field_help(plugin.cls)
    usual, types = defaults(plugin), field_types(plugin)
    facts: dict[str, Any] = {
        "kind": plugin.kind,
        "name": plugin.name,
        "summary": plugin.summary,
        "doc": inspect.getdoc(plugin.cls) or "",
        "cite": plugin.cite,
        "origin": plugin.origin,
        "file": str(plugin.file),
        "module": plugin.cls.__module__,
        "requires": list(plugin.requires),
        "parameters": {
            f.name: {"default": usual[f.name], "help": helps[f.name], **_choices(types[f.name])} for f in plugin.fields
        },
    }
    if plugin.kind == "dataset":
        facts["shapes"] = catalog.known(plugin)
    presets_of = list(presets(plugin.kind, of=plugin.name, own=False).values())
    if presets_of:
        facts["presets"] = {p.name: {"help": p.help, **p.values} for p in presets_of}
    if plugin.kind == "method":
        facts["tasks"] = [task for task in registry().names("task") if plugin.solves(task)]
    if plugin.kind == "sensor":
        facts["gives"] = plugin.options.get("gives", "cloud")
    if plugin.kind == "metric":
        facts["version"] = plugin.version
        facts["better"] = plugin.options.get("better", "lower")
        facts["outputs"] = list(plugin.options.get("outputs", ("mesh", "cloud")))
    return facts


def _choices(annotation: Any) -> dict[str, list[Any]]:
    """The possible values of a parameter, if they are few: those of a Literal, true and false."""
    if annotation is bool:
        return {"choices": ["true", "false"]}
    if typing.get_origin(annotation) is typing.Literal:
        return {"choices": list(typing.get_args(annotation))}
    nested = [found for part in typing.get_args(annotation) for found in _choices(part).get("choices", [])]
    return {"choices": nested} if nested else {}


def missing(requires: Sequence[str]) -> list[str]:
    """The declared libraries that are not installed."""
    return [library for library in requires if importlib.util.find_spec(library) is None]
