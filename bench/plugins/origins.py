"""The origin of a plugin: an installed distribution, a file named by ``--plugin``, or neither."""

from __future__ import annotations

from pathlib import Path

from .registry import Plugin, registry


def is_from_file(plugin: Plugin) -> bool:
    """Whether it comes from ``--plugin``, whose file is then the origin."""
    return Path(plugin.origin).is_absolute()


def is_installed(plugin: Plugin) -> bool:
    """Whether it comes from an installed distribution, whose name and version are then the origin."""
    return plugin.origin != "imported" and not is_from_file(plugin)


def installed(kind: str) -> list[str]:
    """The names of the plugins of a kind from installed distributions, sorted."""
    return [plugin.name for plugin in registry().all(kind) if is_installed(plugin)]
