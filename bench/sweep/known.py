"""Hydra's config loader, for jobs whose configs are known before they are launched."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .config_source import PRIVATE
from .parts import Configs, interpolations
from .request import parse

if TYPE_CHECKING:
    from hydra.core.config_loader import ConfigLoader
    from omegaconf import DictConfig


class KnownConfigs:
    """Gives known configs to jobs that run in this process, instead of composing each: a tenth of a second a job.

    A launcher that has processes of its own pickles Hydra's loader in its place, which composes there.

    Parameters
    ----------
    loader : Hydra's own
    jobs : the overrides of each job; the launcher's config is composed with those of the first, which gets a copy of it
    configs : the configs of the jobs, without the keys that the front door sets; None if they are not known
    """

    def __init__(self, loader: ConfigLoader, jobs: Sequence[Sequence[str]], configs: Configs | None):
        self._loader, self._first, self._configs = loader, tuple(jobs[0]), configs
        self._places = {tuple(words): place for place, words in enumerate(jobs if configs else ())}

    def __reduce__(self) -> tuple[Any, ...]:
        return copy.copy, (self._loader,)

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """The config of one job; the only call of a launcher."""
        from omegaconf import OmegaConf, open_dict

        words = tuple(sweep_overrides)
        if words == self._first and _is_whole(master_config, words):
            return copy.deepcopy(master_config)
        values = self._configs[self._places[words]] if self._configs and words in self._places else None
        if values is None or interpolations(values):  # a resolved value may look like one
            return self._loader.load_sweep_config(master_config, sweep_overrides)
        master: Any = OmegaConf.masked_copy(master_config, ["hydra", *PRIVATE])
        with open_dict(master):
            master.hydra.overrides.task = list(words)
        config: Any = OmegaConf.unsafe_merge({k: v for k, v in values.items() if k not in PRIVATE}, master)
        OmegaConf.copy_cache(master_config, config)
        return config


def _is_whole(config: DictConfig, words: Sequence[str]) -> bool:
    """Whether a sweep's config is what Hydra composes for one job, where it refuses several values and missing ones."""
    from omegaconf import OmegaConf

    choices = config.hydra.runtime.choices
    return not any(OmegaConf.is_missing(choices, group) for group in choices) and not any(
        parse(word).is_sweep_override() for word in words
    )
