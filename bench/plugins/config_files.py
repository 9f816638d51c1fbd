"""The places of the YAML files of configs: our folder, and those of users and of installed packages.

A file ``GROUP/NAME.yaml`` is found in four places. If several have the same name, the first one is used:

1. the folders that ``--config-dir DIR`` names, in their order;
2. the folder ``conf/`` of the working folder;
3. our folder, ``bench/conf``;
4. the folder ``conf/`` of an installed package with the entry point ``detailbench.plugins``: beside the module that the
   entry point names, or above it within the package. An installed package does not change the meaning of our names.

Only the groups in :data:`GROUPS` are read, so that a folder called ``conf`` may hold other files.
"""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import UsageError

ENTRY_POINTS = "detailbench.plugins"

GROUPS = ("task", "dataset", "sensor", "method", "metric", "training", "convention", "profile", "experiment")
OURS = "detailbench"
HERE = "conf"  # the folder in the working folder

_NAMED: tuple[str, ...] = ()  # by --config-dir


class Folder(NamedTuple):
    """One folder of configs, and where it comes from."""

    path: str
    origin: str

    @property
    def is_own(self) -> bool:
        """Whether it is a folder of the user's, which may change from one run to the next."""
        return self.origin == "own"


class ConfigFile(NamedTuple):
    """One YAML file of a group."""

    path: str
    folder: Folder

    def text(self) -> str:
        """Its content.

        Raises
        ------
        UsageError
            If it cannot be read as text.
        """
        try:
            return Path(self.path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{self.path}: cannot be read: {error}") from error


def use(folders: Sequence[str]) -> tuple[str, ...]:
    """Search these folders first from now on in this process; their absolute paths.

    Raises
    ------
    UsageError
        If one does not exist, or holds none of the groups.
    """
    global _NAMED
    named = tuple(os.path.abspath(os.path.expanduser(folder)) for folder in folders)
    for folder in named:
        if not os.path.isdir(folder):
            raise UsageError(f"--config-dir {folder}: no such folder")
        if not _groups_in(folder):
            inside = os.path.basename(folder) in GROUPS
            hint = f"; name the folder above, {os.path.dirname(folder)}" if inside else ""
            raise UsageError(
                f"--config-dir {folder}: expected files such as {folder}/experiment/NAME.yaml, in folders called "
                f"{', '.join(GROUPS)}{hint}"
            )
    _NAMED = named
    return named


def named() -> tuple[str, ...]:
    """The folders passed to :func:`use`."""
    return _NAMED


def files(group: str, *, own: bool = True) -> Mapping[str, ConfigFile]:
    """The files of a group by name, sorted: for each name the one in use; the user's only with ``own``."""
    return _found(folders() if own else installed_folders())[0].get(group, {})


def file_of(group: str, name: str) -> ConfigFile | None:
    """The file of a name; None if there is none."""
    return files(group).get(name)


def hidden() -> list[str]:
    """One line for each name in two places with different content: which one is used."""
    return list(_found(folders())[1])


def folders() -> tuple[Folder, ...]:
    """The existing folders, in order of precedence."""
    try:
        here = os.path.abspath(HERE)
    except FileNotFoundError:  # the working folder is gone
        here = ""
    return _folders(_NAMED, here)


def installed_folders() -> tuple[Folder, ...]:
    """Our folder, and those of packages."""
    return tuple(folder for folder in folders() if not folder.is_own)


@functools.lru_cache(maxsize=8)
def _folders(named: tuple[str, ...], here: str) -> tuple[Folder, ...]:
    found = [Folder(path, "own") for path in (*named, here)]
    found.append(Folder(our_folder(), OURS))
    found.extend(_of_packages())
    kept: dict[str, Folder] = {}
    ours = os.path.realpath(our_folder())
    for folder in found:
        place = os.path.realpath(folder.path)
        if place == ours and folder.origin != OURS:  # the checkout is the working folder
            continue
        if _groups_in(folder.path):
            kept.setdefault(place, folder)
    return tuple(kept.values())


def our_folder() -> str:
    """The folder of our configs."""
    spec = importlib.util.find_spec("bench.conf")
    assert spec and spec.submodule_search_locations
    return next(iter(spec.submodule_search_locations))


def _groups_in(folder: str) -> list[str]:
    return [group for group in GROUPS if os.path.isdir(os.path.join(folder, group))]


def _of_packages() -> Iterator[Folder]:
    """The ``conf/`` of installed packages that bring plugins; none of their modules is imported."""
    for entry in sorted(importlib.metadata.entry_points(group=ENTRY_POINTS), key=lambda entry: entry.name):
        if entry.dist and entry.dist.name == OURS:
            continue
        origin = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.name
        top, *below = entry.module.split(".")
        try:
            spec = importlib.util.find_spec(top)
        except (ImportError, ValueError):  # the registry reports what is wrong with it
            continue
        for folder in spec.submodule_search_locations or () if spec else ():
            for depth in range(len(below), -1, -1):
                yield Folder(os.path.join(folder, *below[:depth], "conf"), origin)


@functools.lru_cache(maxsize=8)
def _found(folders: tuple[Folder, ...]) -> tuple[dict[str, dict[str, ConfigFile]], tuple[str, ...]]:
    """The files in use by group and name, and the warnings about the files that they hide."""
    found: dict[str, dict[str, ConfigFile]] = {group: {} for group in GROUPS}
    lines = []
    for folder in folders:
        for group in GROUPS:
            for name in _names_in(os.path.join(folder.path, group)):
                file = ConfigFile(os.path.join(folder.path, group, f"{name}.yaml"), folder)
                counts = found[group].setdefault(name, file)
                if counts is not file and counts.text() != file.text():
                    lines.append(f"{group}={name}: {counts.path} is used, and {file.path} is not")
    return {group: dict(sorted(entries.items())) for group, entries in found.items()}, tuple(lines)


def _names_in(folder: str) -> list[str]:
    try:
        return [name.removesuffix(".yaml") for name in os.listdir(folder) if name.endswith(".yaml")]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise UsageError(f"{folder}: cannot be read: {error.strerror}") from error
