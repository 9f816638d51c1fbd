"""Composition of the configs of a run by Hydra."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, did_you_mean
from ..installing import line_of_extra
from ..plan.keys import Base
from ..plan.numbers import ALL_CASES
from ..plugins.registry import registry
from ..text import cut

if TYPE_CHECKING:
    from omegaconf import DictConfig


CONFIG_MODULE = "bench.conf"
CONFIG_NAME = "config"
VERSION_BASE = "1.3"


def usual_cases(count: int, *, _root_: DictConfig) -> int:
    """The number of cases of the chosen dataset in a profile: ``count``, but all of the user's own files.

    Profiles have ``cases: ${usual_cases:4}``; the user's value replaces it.
    """
    from ..plugins.registry import load_plugins
    from ..safe_path import isolate_imports

    name = (_root_.get("dataset") or {}).get("_name_")
    if name not in registry().names("dataset"):  # in the process of a launcher, which has no plugins yet
        isolate_imports()
        load_plugins(list(_root_.plugins), warn=False)
    own = name in registry().names("dataset") and registry().find("dataset", name).options.get("own")
    return ALL_CASES if own else int(count)


def register_resolvers() -> None:
    """Let configs use :func:`usual_cases`."""
    from omegaconf import OmegaConf

    OmegaConf.register_new_resolver("usual_cases", usual_cases, replace=True)


def register_base() -> None:
    """Put the typed base, and every plugin, into Hydra's config store; new ones since the last call are added."""
    from ..plugins.registry import KINDS
    from .config_source import register

    register_resolvers()
    register()
    _register(tuple((kind, *registry().names(kind)) for kind in KINDS))


@functools.lru_cache(maxsize=1)
def _register(names: tuple[tuple[str, ...], ...]) -> None:
    from hydra.core.config_store import ConfigStore

    from ..plugins.schema import store_configs

    ConfigStore.instance().store(name="base", node=Base, provider="detailbench")
    store_configs()


@contextmanager
def hydra_ready() -> Iterator[Any]:
    """Hydra's config loader over our configs, without a Hydra application."""
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    register_base()
    with initialize_config_module(CONFIG_MODULE, version_base=VERSION_BASE):
        yield GlobalHydra.instance().config_loader()


def compose(overrides: Sequence[str]) -> DictConfig:
    """One composed config.

    Raises
    ------
    UsageError
        With Hydra's own message if it cannot compose.
    """
    from hydra import compose as hydra_compose

    with hydra_ready(), in_words(overrides):
        config = hydra_compose(CONFIG_NAME, overrides=list(overrides))
        if "cases" in config:
            config.cases = config.cases  # the number, if a profile has the resolver for it
        return config


def resolved(overrides: Sequence[str]) -> dict[str, Any]:
    """The values of one composed config, with all interpolations resolved.

    Raises
    ------
    UsageError
        As :func:`compose`, and for an interpolation of a missing key.
    """
    from omegaconf import OmegaConf

    config = compose(overrides)
    with in_words(overrides):
        values: Any = OmegaConf.to_container(config, resolve=True)
        return values


@contextmanager
def in_words(overrides: Sequence[str]) -> Iterator[None]:
    """Turn exceptions of Hydra while it only reads and composes overrides into errors about these."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(hydra_message(error)) from error
    except RecursionError as error:
        raise UsageError(f"{cut(' '.join(overrides), 200)}: nested too deeply") from error
    except (ValueError, TypeError, AttributeError, AssertionError, KeyError) as error:
        hydras = [word for word in overrides if word.lstrip("+~").startswith("hydra")]
        raise UsageError(f"{cut(' '.join(hydras or overrides), 200)}: Hydra cannot use this: {error}") from error


def hydra_message(error: BaseException) -> str:
    """Hydra's message, with the underlying cause if it adds information, without types or hints to add keys."""
    if line := _no_parameter(str(error), str(error.__cause__ or "")):
        return line
    parts = [str(error)]
    if error.__cause__ is not None and str(error.__cause__) not in parts[0]:
        parts.append(str(error.__cause__))
    lines = [line for part in parts for line in part.splitlines()]
    for launcher, extra in (("joblib", "joblib"), ("submitit", "slurm"), ("ray", "ray")):
        if f"hydra/launcher/{launcher}" in parts[0]:
            lines.append(f"This launcher is an extra: {line_of_extra(extra)}")
    noise = ("append", "prepend", "full_key:", "object_type=", "reference_type=", "provider=", "Config search path:")
    return "\n".join(line for line in lines if line.strip() and not any(word in line for word in noise))


def _no_parameter(*texts: str) -> str:
    """The message for a parameter that a plugin lacks, where Hydra names its class; empty for another one.

    The overrides of a command line are checked before; this is for those of an experiment that chooses plugins.
    """
    text = "\n".join(texts)
    name = re.search(r"Key '(\w+)' (?:is )?not in '(\w+)'", text)
    if name is None:
        return ""
    key, file = re.search(r"'(\w+)\.[\w.]+'", text), re.search(r"In '(\w+/\w+)'", text)
    for plugin in registry().loaded():
        if plugin.cls.__name__ == name[2] and (not key or plugin.kind == key[1]):
            hint = did_you_mean(name[1], [f.name for f in plugin.fields])
            where = f"{file[1]}.yaml: " if file else ""
            return f"{where}{plugin.kind} {plugin.name} has no parameter {name[1]!r}. {hint}"
    return ""


@functools.lru_cache(maxsize=4)
def experiment_config(word: str) -> DictConfig | None:
    """The config of one ``experiment=NAME``, with Hydra's own part; None if it cannot be composed."""
    from hydra.errors import HydraException
    from hydra.types import RunMode
    from omegaconf.errors import OmegaConfBaseException

    with hydra_ready() as loader:
        try:
            return loader.load_configuration(CONFIG_NAME, [word], run_mode=RunMode.RUN)
        except (HydraException, OmegaConfBaseException, ValueError):  # the last for a name that is not text
            return None
