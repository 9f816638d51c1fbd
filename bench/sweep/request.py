"""The request of a command line: its overrides, each parsed once, and the jobs that they define."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..plan.cell import NotSolved, check_dataset
from ..plan.keys import GROUPS
from ..plugins import presets
from ..plugins.registry import KINDS, registry
from ..text import cut
from .composition import CONFIG_NAME, experiment_config, hydra_ready, in_words, resolved
from .quoting import hint, is_override

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

HERE = ("basic", "joblib", "submitit_local")  # launchers that run jobs on this machine, as far as is known


@functools.lru_cache(maxsize=100_000)
def parse(text: str) -> Override:
    """One override.

    Raises
    ------
    UsageError
        With the text, what is expected, and, if it may be a file name, how to quote it.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    try:
        return OverridesParser.create().parse_overrides([text])[0]
    except OverrideParseException as error:
        raise UsageError(
            f"cannot read {cut(text, 200)!r}: expected key=value, for instance method=poisson or limit.seconds=60 "
            f"({cut(str(error).splitlines()[0], 200)})" + (f"; {hint(text)}" if is_override(text) else "")
        ) from error
    except RecursionError as error:
        raise UsageError(f"cannot read {cut(text, 200)!r}: nested too deeply") from error


@dataclass(frozen=True)
class Request:
    """The overrides of one command.

    Attributes
    ----------
    overrides : tuple
        As parsed by Hydra.
    command : str
        The called command, for messages.
    multirun : bool
        Whether it is a sweep: several values of a key are several jobs.
    folder : str
        The results folder; empty until it is settled (:mod:`bench.sweep.destination`).
    """

    overrides: tuple[Override, ...]
    command: str = "run"
    multirun: bool = False
    folder: str = ""

    @classmethod
    def of(cls, words: Sequence[str], command: str = "run", multirun: bool = False) -> Request:
        """The request of the overrides of a command line.

        Raises
        ------
        UsageError
            For an argument that is not an override.
        """
        return cls(tuple(parse(word) for word in words), command, multirun)

    @property
    def words(self) -> list[str]:
        """The overrides as written."""
        return [text_of(override) for override in self.overrides]

    def about(self, key: str) -> list[Override]:
        """The overrides of one key or group."""
        return [override for override in self.overrides if override.key_or_group == key]

    def with_words(self, *words: str) -> Request:
        """The same with more overrides at the end."""
        return replace(self, overrides=(*self.overrides, *map(parse, words)))

    # -- what they choose ------------------------------------------------------------------------------------------

    def chosen(self, kind: str) -> list[str]:
        """The chosen names of a kind; without any, and without an experiment, the default."""
        if found := self.about(kind):
            return flat(values_of(found[-1]))  # of several, Hydra takes the last
        return [] if self.about("experiment") else [name for name in (_default_choice(kind),) if name]

    @property
    def threads(self) -> int:
        """The first requested number of threads; 1 if none is given, or it is invalid."""
        found = self.about("threads")
        first = next(iter(values_of(found[-1])), None) if found else None
        return max(first, 1) if isinstance(first, int) else 1

    @property
    def devices(self) -> list[str]:
        """The requested devices; those in presets are found when their cells are run."""
        return list(dict.fromkeys(str(v) for override in self.about("device") for v in values_of(override)))

    @property
    def launcher(self) -> str:
        """The requested launcher, also by the experiment; Hydra's own one without a request."""
        if found := self.about("hydra/launcher"):
            return str(found[-1].value())
        return "basic" if self.hydra is None else str(self.hydra.hydra.runtime.choices["hydra/launcher"])

    @property
    def runs_here(self) -> bool:
        """Whether jobs are run on this machine, as far as is known."""
        return self.launcher in HERE

    def warning_of_threads(self, processors: int) -> str:
        """The warning about more threads than processors; empty if jobs are run elsewhere."""
        if self.threads <= processors or not self.runs_here:
            return ""
        return (
            f"threads={self.threads}: only {processors} processors are available, so the times are not those of "
            f"{self.threads} threads"
        )

    @property
    def experiments(self) -> list[str]:
        """The names of the experiments."""
        return [name for override in self.about("experiment") for name in flat(values_of(override))]

    @cached_property
    def experiment(self) -> DictConfig | None:
        """The config of the experiment, with Hydra's own part; None without one.

        None also for one that cannot be composed: its error is reported where it is used.
        """
        found = self.about("experiment")
        return experiment_config(text_of(found[-1])) if found else None

    @property
    def is_sweep(self) -> bool:
        """Whether this is a sweep without ``-m``, by the experiment or by Hydra's mode."""
        if found := self.about("hydra.mode"):
            return found[-1].value() == "MULTIRUN"
        return self.experiment is not None and _select(self.experiment, "hydra.mode", "name") == "MULTIRUN"

    # -- what they make --------------------------------------------------------------------------------------------

    def parts(self) -> list[Request]:
        """The request of each experiment in turn: ``experiment=a,b`` is one command after the other.

        An experiment has its own sweep, and values for keys of all groups; Hydra cannot sweep over those.
        """
        for place, override in enumerate(self.overrides):
            if override.key_or_group == "experiment" and override.is_sweep_override():
                before, after = self.overrides[:place], self.overrides[place + 1 :]
                key = text_of(override).partition("=")[0]
                names = dict.fromkeys(flat(values_of(override)))
                return [replace(self, overrides=(*before, parse(f"{key}={name}"), *after)) for name in names]
        return [self]

    def without_globs(self) -> Request:
        """The request with the names that ``dataset=glob(*)`` stands for: those that work with their defaults."""
        from hydra.core.override_parser.types import Glob

        found = []
        for override in self.overrides:
            if isinstance(override.value(), Glob):
                override = parse(f"{text_of(override).partition('=')[0]}={','.join(_matching(override))}")
            found.append(override)
        return replace(self, overrides=tuple(found))

    @cached_property
    def hydra(self) -> DictConfig | None:
        """The config with Hydra's own part, without the swept keys; None if nothing sets that part.

        Raises
        ------
        UsageError
            With Hydra's message, if it cannot be composed.
        """
        from hydra.types import RunMode

        if not any(override.key_or_group == "experiment" or is_hydras(override) for override in self.overrides):
            return None
        words = [text_of(override) for override in self.fixed()]
        with hydra_ready() as loader, in_words(words):
            mode = RunMode.MULTIRUN if self.multirun else RunMode.RUN
            return loader.load_configuration(CONFIG_NAME, words, run_mode=mode)

    def fixed(self) -> Iterator[Override]:
        """The overrides common to all jobs; a parameter of swept plugins is not one: only some may have it."""
        fixed = {override.key_or_group for override in self.overrides if not override.is_sweep_override()}
        swept = {override.key_or_group for override in self.overrides} - fixed
        for override in self.overrides:
            kind, _, parameter = override.key_or_group.partition(".")
            is_open = kind in swept or (self.multirun and "experiment" in fixed and kind not in fixed)
            if not (override.is_sweep_override() or (kind in KINDS and parameter and is_open)):
                yield override

    @cached_property
    def jobs(self) -> list[list[str]]:
        """The overrides of every job, in the order of Hydra's own sweeper; those about Hydra are in none.

        Raises
        ------
        UsageError
            With Hydra's message.
        """
        from hydra.core.override_parser.overrides_parser import OverridesParser

        own = [override for override in self.overrides if not is_hydras(override)]
        config = self.hydra
        if not self.multirun:
            return [[text_of(override) for override in own]]
        params = _select(config, "hydra.sweeper.params") or {}
        given = {override.get_key_element() for override in own}
        added = [f"{key}={value}" for key, value in params.items() if str(key) not in given]
        with hydra_ready() as loader, in_words(self.words):  # the loader resolves globs in an experiment
            parsed = OverridesParser.create(config_loader=loader).parse_overrides(added)
            # Of two overrides of one key the last one wins, in the position of the first.
            choices = {override.get_key_element(): _choices(override) for override in [*parsed, *own]}
        return [list(job) for job in itertools.product(*choices.values())]

    @cached_property
    def values(self) -> dict[str, Any]:
        """The values of the one config of the overrides, with all interpolations resolved.

        Raises
        ------
        UsageError
            With Hydra's message, and for an interpolation of a missing key.
        """
        return resolved(self.words)


def _choices(override: Override) -> list[str]:
    """One override for each value that a sweep gives to a key."""
    if not override.is_sweep_override():
        return [text_of(override)]
    if not override.is_discrete_sweep():
        values_of(override)  # raises
    found = [f"{override.get_key_element()}={value}" for value in override.sweep_string_iterator()]
    if not found:
        raise UsageError(f"{text_of(override)}: no value is left; expected at least one")
    return found


def text_of(override: Override) -> str:
    """An override as written."""
    return override.input_line or ""


def is_hydras(override: Override) -> bool:
    """Whether an override is about Hydra itself, for instance its launcher."""
    return override.key_or_group.startswith("hydra")


def values_of(override: Override) -> list[Any]:
    """The values of an override: one, those of a sweep, or those of a list.

    Raises
    ------
    UsageError
        For an interval, and for a pattern that matches no name.
    """
    from hydra.core.override_parser.types import ChoiceSweep, Glob

    if isinstance(override.value(), Glob):
        return _matching(override)
    if override.is_interval_sweep():
        raise UsageError(
            f"{text_of(override)}: a sweep takes listed values, not an interval; list some, or use range(...)"
        )
    value = override.value()
    if isinstance(value, ChoiceSweep):
        return [_text(one) for one in value.list]
    return [_text(one) for one in value] if isinstance(value, list) else [_text(value)]


def _text(value: Any) -> Any:
    from hydra.core.override_parser.types import QuotedString

    if isinstance(value, QuotedString):
        return value.text
    return [str(one) for one in value] if isinstance(value, list) else value


def flat(values: Sequence[Any]) -> list[str]:
    """The names among values, of which some may be lists of names."""
    return [str(one) for value in values for one in (value if isinstance(value, list) else [value])]


def _matching(override: Override) -> list[str]:
    """The plugins and presets that ``method=glob(p*)`` matches."""
    group = override.key_or_group
    if group not in GROUPS:
        raise UsageError(f"{text_of(override)}: glob() is for names of plugins; list the values of {group}")
    known = {*presets.names(group), *(registry().names(group) if group in KINDS else ())}
    pattern: Any = override.value()  # a Glob, missing in Hydra's annotations
    found = pattern.filter(sorted(known))
    if group == "dataset":
        found = [name for name in found if not _wants_more(name)]
    if not found:
        raise UsageError(f"{text_of(override)}: no {group} matches. Known: {', '.join(sorted(known))}")
    return found


def _wants_more(dataset: str) -> bool:
    """Whether a dataset cannot be used with its defaults, like ``files``, which needs a path."""
    if dataset not in registry().names("dataset"):
        return False
    try:
        check_dataset(registry().find("dataset", dataset).cls(), "test")
    except NotSolved:  # it was not fetched: the plan reports it
        return False
    except UsageError:
        return True
    return False


@functools.cache
def _default_choice(group: str) -> str | None:
    """The choice in the main config."""
    from importlib.resources import files

    from omegaconf import OmegaConf

    config = OmegaConf.create((files("bench.conf") / "config.yaml").read_text())
    return next((e[group] for e in config.defaults if not isinstance(e, str) and group in e), None)


def _select(config: DictConfig | None, key: str, attribute: str = "") -> Any:
    from omegaconf import OmegaConf

    found = None if config is None else OmegaConf.select(config, key)
    return getattr(found, attribute, None) if attribute else found
