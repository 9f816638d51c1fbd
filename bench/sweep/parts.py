"""The configs of all jobs of a sweep, assembled from parts that Hydra composes once each.

Hydra takes a tenth of a second to compose a config: hours for fifty thousand jobs. But the effect of ``method=rimls
method.filterscale=3`` on the config does not depend on the dataset, so one composition for each distinct choice
of a group is enough:

* Overrides of one job are put into groups by their key: ``method`` and ``method.depth`` have the same *head*.
* Heads that may change anything (a profile, an experiment, a convention, Hydra's own) are *outer* ones. For each
  combination of these, one job is the base.
* For each other head, each distinct set of overrides is composed once, in place of those of the base; a number that
  replaces another one of its type is put in without Hydra.
* Nodes with interpolations are composed once for each combination of the heads that they refer to.

Everything is verified: a head that changes anything outside of its own node, and a config file that could, leave
the sweep to Hydra, as does a sample of jobs if one of them is composed differently.

Jobs in the front door's process are given these configs, instead of one that Hydra composes for each.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, overload

from ..errors import UsageError
from ..plan.keys import GROUPS, Base
from ..plugins import config_files, presets
from ..plugins.registry import KINDS
from .composition import CONFIG_NAME, hydra_ready, in_words

if TYPE_CHECKING:
    from omegaconf import DictConfig

Words = tuple[str, ...]
Values = dict[str, Any]

# Heads whose overrides change only their own node: plugins, and plain keys of the run.
INNER = (*KINDS, *(f.name for f in fields(Base) if f.name not in GROUPS))
PLAIN_KEY = re.compile(r"\+?(\w+)(\.\w+)*")
# Numbers in Hydra's grammar.
WHOLE = re.compile(r"[+-]?(0|[1-9][0-9]*)")
DECIMAL = re.compile(r"[+-]?[0-9]+\.[0-9]+([eE][+-]?[0-9]+)?")
SAMPLE = 4  # jobs that Hydra composes as well, besides the last one
KEPT = 100  # composed configs that are kept for when they are needed again: they are large
FEW = 12  # jobs of which the last one is the sample: composing more takes as long as composing all
RESOLVER = re.compile(r"\$\{\s*([\w.]+)\s*:")
REFERENCE = re.compile(r"\w+")
USUAL_CASES = "usual_cases"  # depends on the dataset


class Apart(Exception):
    """The jobs cannot be assembled from parts."""


@functools.lru_cache(maxsize=100_000)
def _head(word: str) -> str:
    """The head of an override; empty for an outer one."""
    key, equals, _ = word.partition("=")
    found = PLAIN_KEY.fullmatch(key)
    return found[1] if equals and found and found[1] in INNER else ""


@functools.lru_cache(maxsize=100_000)
def _number(word: str) -> tuple[str, int | float] | None:
    """The override without its value, and its value as a number; None if it is not one."""
    key, _, value = word.partition("=")
    if key.startswith("+"):
        return None
    if WHOLE.fullmatch(value):
        return f"{key}=<int>", int(value)
    return (f"{key}=<float>", float(value)) if DECIMAL.fullmatch(value) else None


def _split(job: Sequence[str]) -> tuple[Words, dict[str, Words]]:
    """The outer overrides of a job, and those of each other head."""
    outer: list[str] = []
    inner: dict[str, Words] = {}
    for word in job:
        if head := _head(word):
            inner[head] = (*inner.get(head, ()), word)
        else:
            outer.append(word)
    return tuple(outer), inner


def representatives(jobs: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """Some of the jobs, with which Hydra shows whether it can compose all: each choice of a head is in one of them.

    Whether ``method=jet method.k=24`` can be composed does not depend on the dataset, and ``seed=7`` is composed like
    ``seed=8``.
    """
    seen: set[Words] = set()
    chosen = []
    for job in jobs:
        outer, inner = _split(job)
        choices = (words if head in KINDS else _template(words)[0] for head, words in inner.items())
        if fresh := {outer, *choices} - seen:
            chosen.append(job)
            seen |= fresh
    return chosen


def values_of(jobs: Sequence[Sequence[str]]) -> Configs | None:
    """The resolved config of each job, as by :func:`bench.sweep.composition.resolved`; None if not possible.

    Parameters
    ----------
    jobs : the overrides of each job
    """
    if len(jobs) < 2 or not _configs_are_plain():
        return None
    try:
        with hydra_ready():
            configs = Configs(jobs)
            if any(configs[place] != configs.composed(jobs[place], resolve=True) for place in _sample(len(jobs))):
                return None
    except (Apart, UsageError):
        return None  # an invalid job reports its own error
    return configs


def _sample(count: int) -> list[int]:
    """Some of the jobs, evenly spread, including the last one."""
    parts = SAMPLE if count > FEW else 1
    return sorted({count - 1 - part * (count - 1) // parts for part in range(parts)})


def _configs_are_plain() -> bool:
    """Whether no file of a user or a package can make one choice depend on another, or change another's node."""
    for group in GROUPS:
        for file in presets.files(group).values():
            if file.folder.origin == config_files.OURS:
                continue  # tests cover those
            text = file.text()
            if (group in KINDS and "@package" in text) or may_depend(text):
                return False
    return True


def may_depend(text: str) -> bool:
    """Whether the list of defaults in a YAML file has an interpolation, or is not a plain list."""
    inside = False
    for line in text.splitlines():
        if re.match(r"defaults\s*:", line):
            inside = True
        elif inside and re.match(r"[^\s#-]", line):
            inside = False
        if inside and "${" in line:
            return True
    return False


class Configs(Sequence[Values]):
    """The resolved configs of jobs, from parts that are composed within :func:`hydra_ready`.

    Configs share their nodes: treat them as read-only.

    Parameters
    ----------
    jobs : the overrides of each job

    Raises
    ------
    Apart
        If they cannot be assembled.
    UsageError
        If a part cannot be composed.
    """

    def __init__(self, jobs: Sequence[Sequence[str]]):
        self._composed: dict[Words, DictConfig] = {}
        self._jobs = [_split(job) for job in jobs]
        self._families: dict[Words, _Family] = {}
        for outer, inner in self._jobs:
            if outer not in self._families:
                self._families[outer] = _Family(outer, inner, self.composed)
        for outer, inner in self._jobs:
            self._families[outer].add(inner)
        for family in self._families.values():
            family.findinterpolations()

    def composed(self, job: Sequence[str], *, resolve: bool = False) -> Values:
        """The config that Hydra composes for one job."""
        from omegaconf import OmegaConf

        key = tuple(sorted(job))  # a job and its parts may name the same overrides in another order
        config = self._composed.pop(key, None) or _composed(job)
        if not resolve and len(self._composed) < KEPT:
            self._composed[key] = config
        with in_words(job):
            if resolve and "cases" in config:
                config.cases = config.cases
            values: Any = OmegaConf.to_container(config, resolve=resolve)
            return values

    def at(self, places: Sequence[int]) -> Configs:
        """Those of some of the jobs."""
        some = copy.copy(self)
        some._jobs = [self._jobs[place] for place in places]
        return some

    def __len__(self) -> int:
        return len(self._jobs)

    @overload
    def __getitem__(self, place: int) -> Values: ...

    @overload
    def __getitem__(self, place: slice) -> list[Values]: ...

    def __getitem__(self, place: int | slice) -> Values | list[Values]:
        if isinstance(place, slice):
            return [self[at] for at in range(*place.indices(len(self)))]
        outer, inner = self._jobs[place]
        return self._families[outer].values(inner)


class _Family:
    """Jobs with the same outer overrides: their base, and the node of each head."""

    def __init__(self, outer: Words, inner: Mapping[str, Words], composed: Callable[..., Values]):
        self.outer, self.first, self._composed = outer, dict(inner), composed
        self.base = composed(self._job({}))
        self.nodes: dict[tuple[str, Words], Any] = {}  # unresolved, by head and overrides
        self._templates: dict[tuple[str, Words], tuple[str, Any]] = {}
        self.context: tuple[str, ...] = ()  # heads that interpolations refer to, and those with interpolations
        self.resolved: tuple[str, ...] = ()  # those with interpolations
        self._contexts: dict[tuple[Words, ...], Values] = {}

    def _job(self, changed: Mapping[str, Words]) -> Words:
        return (*self.outer, *(word for words in (self.first | dict(changed)).values() for word in words))

    def add(self, inner: Mapping[str, Words]) -> None:
        """Compose those of these overrides that no earlier job had."""
        if inner.keys() != self.first.keys():
            raise Apart
        for item in inner.items():
            if item not in self.nodes:
                self.nodes[item] = self._node(*item)

    def _node(self, head: str, words: Words) -> Any:
        if words == self.first[head]:
            return self._known(head, words, self.base[head])
        key, number = _template(words)
        if number is not None and (known := self._templates.get((head, key))):
            return _with_number(known[1], known[0], number)
        values = self._composed(self._job({head: words}))
        if values.keys() != self.base.keys() or any(
            values[other] != node for other, node in self.base.items() if other != head
        ):
            raise Apart  # it changes more than its own node
        return self._known(head, words, values[head])

    def _known(self, head: str, words: Words, node: Any) -> Any:
        """Use a node for those with another number in the same place, if it has that number there."""
        key, number = _template(words)
        if number is not None:
            path = words[-1].partition("=")[0].partition(".")[2]
            found = _at(node, path)
            if type(found) is type(number) and found == number:
                self._templates[head, key] = (path, node)
        return node

    def findinterpolations(self) -> None:
        """Which heads have interpolations in any job, and which they refer to."""
        texts = {head: interpolations(node) for head, node in self.base.items()}
        for (head, _), node in self.nodes.items():
            texts[head] |= interpolations(node)
        self.resolved = tuple(head for head, found in texts.items() if found)
        named = set(self.resolved)
        for text in {text for found in texts.values() for text in found}:
            if any(name != USUAL_CASES for name in RESOLVER.findall(text)):
                raise Apart  # what it refers to is not known
            named |= {name for name in REFERENCE.findall(text) if name in self.base}
            named |= {"dataset"} if RESOLVER.search(text) else set()
        self.context = tuple(head for head in self.first if head in named)

    def values(self, inner: Mapping[str, Words]) -> Values:
        """The resolved config of a job with these overrides."""
        values = self.base | {head: self.nodes[head, words] for head, words in inner.items()}
        if self.resolved:
            key = tuple(inner[head] for head in self.context)
            if key not in self._contexts:
                full = self._composed(self._job({head: inner[head] for head in self.context}), resolve=True)
                self._contexts[key] = {head: full[head] for head in self.resolved}
            values |= self._contexts[key]
        return values


def _composed(job: Sequence[str]) -> DictConfig:
    """One job's config by Hydra, whether or not it is ready: configs are requested one by one, too."""
    from hydra import compose
    from hydra.core.global_hydra import GlobalHydra

    ready = contextlib.nullcontext() if GlobalHydra.instance().is_initialized() else hydra_ready()
    with ready, in_words(job):
        return compose(CONFIG_NAME, overrides=list(job))


def _template(words: Words) -> tuple[Words, int | float | None]:
    """Overrides with a type in place of the last one's number, and that number; unchanged without one."""
    found = _number(words[-1])
    return ((*words[:-1], found[0]), found[1]) if found else (words, None)


def _at(node: Any, path: str) -> Any:
    for name in path.split(".") if path else ():
        node = node.get(name) if isinstance(node, dict) else None
    return node


def _with_number(node: Any, path: str, number: int | float) -> Any:
    """A node with a number at a place; all nodes off that path are shared."""
    if not path:
        return number
    name, _, rest = path.partition(".")
    return node | {name: _with_number(node[name], rest, number)}


def interpolations(node: Any) -> set[str]:
    """The texts with interpolations within a node, keys included."""
    if isinstance(node, str):
        return {node} if "${" in node else set()
    if isinstance(node, dict):
        return set().union(*map(interpolations, (*node, *node.values())), set())
    return set().union(*map(interpolations, node), set()) if isinstance(node, list) else set()
