"""The configs of users and of installed packages, as Hydra sees them: files of our groups, which are data.

Hydra instantiates what a config's ``_target_`` names, and configures itself from the keys below ``hydra``:
a config can run code. The user's command line may do so. A file that is merely in the working folder, or came
with a package, may not: it chooses plugins, gives values to the keys of a run, and sweeps over them.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin

from ..errors import UsageError, did_you_mean
from ..plan.keys import GROUPS, Base
from ..plugins.config_files import OURS
from ..plugins.presets import TIER, content_of, files

PRIVATE = ("plugins", "session", "config_dirs")  # set by the front door: the first names files to import
LAUNCHERS = ("basic", "joblib")  # the others start programs that their parameters name
INSTANTIATES = ("_target_", "_partial_", "_args_", "_recursive_", "_convert_")
ROOTS = ("convention", "profile", "experiment")  # groups whose files hold keys of the run


class OwnConfigs(ConfigSource):
    """All files that are not ours, of all folders; those in use, if a name is in several."""

    def __init__(self, provider: str, path: str) -> None:
        super().__init__(provider, path)
        # Hydra pickles this object for the processes of a launcher, which do not know the folders.
        self.files = {
            f"{group}/{name}": file.path
            for group in GROUPS
            for name, file in files(group).items()
            if file.folder.origin != OURS
        }

    @staticmethod
    def scheme() -> str:
        """The name of this source in the search path."""
        return "detailbench"

    def load_config(self, config_path: str) -> ConfigResult:
        """One file, which has been checked to be data."""
        name = config_path.removesuffix(".yaml")
        if name not in self.files:
            raise ConfigLoadError(f"Config not found : {config_path}")
        from omegaconf import OmegaConf

        path = self.files[name]
        text = Path(path).read_text(encoding="utf-8")
        check(name.partition("/")[0], path, text)
        config: Any = OmegaConf.create(text) if text.strip() else OmegaConf.create()
        config.pop(TIER, None)  # not a parameter
        return ConfigResult(provider=self.provider, path=path, config=config, header=self._get_header_dict(text[:512]))

    def available(self) -> bool:
        """Always: it may be empty."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether this group has files."""
        return any(name.startswith(f"{config_path}/") for name in self.files)

    def is_config(self, config_path: str) -> bool:
        """Whether this file exists."""
        return config_path.removesuffix(".yaml") in self.files

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The files of a group."""
        if results_filter == ObjectType.GROUP:
            return []
        return sorted(name.partition("/")[2] for name in self.files if name.startswith(f"{config_path}/"))


class OwnSearchPath(SearchPathPlugin):
    """Puts the source before ours: which of two files of a name is used has been decided before."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add the source, once."""
        search_path.prepend(OURS, "detailbench://own")


def register() -> None:
    """Register both with Hydra; may be called repeatedly."""
    plugins = Plugins.instance()
    plugins.register(OwnConfigs)
    plugins.register(OwnSearchPath)


def check(group: str, path: str, text: str) -> None:
    """Check that a user's file is data, with keys of a run only.

    Raises
    ------
    UsageError
        With the file, the key, and what is expected.
    """
    content = content_of(path, text)
    package = re.search(r"^\s*#\s*@package\s+(\S+)", text, re.MULTILINE)
    if package and package[1] not in ("_global_", "_group_"):
        raise UsageError(f"{path}: @package {package[1]}: expected @package _global_, or none")
    if group in ROOTS and (not package or package[1] != "_global_"):
        raise UsageError(f"{path}: expected `# @package _global_` as the first line of a file of {group}s")
    for key in _keys(content):
        if key in INSTANTIATES:
            raise UsageError(f"{path}: {key}: a config file cannot create objects; leave this key out")
    _check_defaults(path, content.get("defaults") or [])
    if group in ROOTS:
        _check_root(path, content)
    elif "hydra" in content:
        raise UsageError(f"{path}: hydra: expected only parameters of a {group}; only an experiment may have a sweep")


def _keys(content: Any) -> Iterator[Any]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield key
            yield from _keys(value)
    elif isinstance(content, list):
        for value in content:
            yield from _keys(value)


def _check_defaults(path: str, defaults: Any) -> None:
    """Each entry must choose from one of our groups, or a launcher that starts Python processes only."""
    if not isinstance(defaults, list):
        raise UsageError(f"{path}: defaults: expected a list, for instance [poisson]")
    for entry in defaults:
        for key, value in entry.items() if isinstance(entry, Mapping) else ():
            group = str(key).removeprefix("override").removeprefix("optional").strip().lstrip("/")
            if group == "hydra/launcher" and value in LAUNCHERS:
                continue
            _check_names(path, f"defaults: {key}", value)
            if group not in GROUPS:
                raise UsageError(
                    f"{path}: defaults: {key}: {value}: expected one of {', '.join(GROUPS)}, or hydra/launcher with "
                    f"{' or '.join(LAUNCHERS)}; put other keys of Hydra on the command line"
                )
        if not isinstance(entry, Mapping) and not re.fullmatch(r"[\w-]+", str(entry)):
            raise UsageError(f"{path}: defaults: {entry}: expected a name")


def _check_names(path: str, key: str, value: Any) -> None:
    """Names must refer to files of the groups only; the values of ``${...}`` are checked by the jobs."""
    for name in value if isinstance(value, list) else [value]:
        if "/" in str(name) or "\\" in str(name):
            raise UsageError(f"{path}: {key}: {name}: expected names, without a folder")


def _check_root(path: str, content: Mapping[str, Any]) -> None:
    """The keys of a convention, a profile or an experiment."""
    known = [f.name for f in dataclasses.fields(Base) if f.name not in PRIVATE]
    for key in content:
        if key not in (*known, "defaults", "hydra"):
            raise UsageError(f"{path}: there is no key {key!r}. {did_you_mean(str(key), known)}")
    hydra = content.get("hydra") or {}
    sweeper, launcher = (_mapping(path, hydra, key) for key in ("sweeper", "launcher"))
    wrong = [f"hydra.{key}" for key in hydra if key not in ("mode", "sweeper", "launcher")]
    wrong += [f"hydra.sweeper.{key}" for key in sweeper if key != "params"]
    wrong += [f"hydra.launcher.{key}" for key in launcher if key != "n_jobs"]
    if wrong:
        raise UsageError(
            f"{path}: {wrong[0]}: expected hydra.mode, hydra.sweeper.params or hydra.launcher.n_jobs; whatever else is "
            "Hydra's belongs on the command line"
        )
    for key, value in _mapping(path, sweeper, "params").items():
        if key in GROUPS:
            _check_names(path, f"hydra.sweeper.params: {key}", value)
        if not re.fullmatch(r"\w+(\.\w+)*", str(key)) or str(key).partition(".")[0] not in known:
            head = str(key).partition(".")[0]
            raise UsageError(f"{path}: hydra.sweeper.params: there is no key {key!r}. {did_you_mean(head, known)}")


def _mapping(path: str, content: Any, key: str) -> Mapping[str, Any]:
    value = content.get(key) or {} if isinstance(content, Mapping) else None
    if not isinstance(value, Mapping):
        raise UsageError(f"{path}: {key}: expected keys with values below it")
    return value
