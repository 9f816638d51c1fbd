"""Where a plugin comes from: an installed distribution, a file that ``--plugin`` names, or neither."""

from __future__ import annotations

from pathlib import Path

from .registry import Plugin, registry


def is_from_file(plugin: Plugin) -> bool:
    """Whether ``--plugin`` brought it, whose file is then the origin."""
    return Path(plugin.origin).is_absolute()


def is_installed(plugin: Plugin) -> bool:
    """Whether an installed distribution brought it, whose name and version are then the origin."""
    return plugin.origin != "imported" and not is_from_file(plugin)


def installed(kind: str) -> list[str]:
    """The names of the plugins of a kind that installed distributions bring, sorted."""
    return [plugin.name for plugin in registry().all(kind) if is_installed(plugin)]
