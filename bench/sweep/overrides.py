"""Checks of overrides before Hydra gets them: errors about wrong names and parameters suggest the nearest right one.

Hydra itself lists the options of a group but suggests none, and for an unknown key it advises ``+key=value``, which
then accepts any typo.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, did_you_mean
from ..plan.keys import GROUPS, Base
from ..plan.limits import Limits
from ..plan.training import TrainingKeys
from ..plugins import presets
from ..plugins.registry import KINDS, Plugin, registry
from ..plugins.schema import check_value
from .destination import settled
from .quoting import hint
from .request import Request, flat, is_hydras, text_of, values_of

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override


def checked(words: Sequence[str], command: str = "run", *, multirun: bool = False, sweeps: bool = False) -> Request:
    """The request of a command's overrides, with one folder of results, and every name and parameter checked.

    Parameters
    ----------
    words : the overrides of the command line
    command : the one that has been called
    multirun : whether several values of a key are several jobs; an experiment may set it, too, if ``sweeps`` is true
    sweeps : whether the command accepts sweeps

    Raises
    ------
    UsageError
        For names and parameters that do not exist, and for several values where one is expected.
    """
    request = settled(Request.of(words, command, multirun))
    if sweeps and not multirun:
        request = dataclasses.replace(request, multirun=request.is_sweep)
    check(request)
    return request.without_globs()


def check(request: Request) -> None:
    """Raise :class:`UsageError` for names and parameters that do not exist, and for an invalid sweep."""
    for override in request.overrides:
        key = override.key_or_group
        values = values_of(override)
        if is_hydras(override):
            _check_hydra(key, values, override)
            continue
        if override.is_sweep_override() and not request.multirun:
            quoting = f"; {hint(text_of(override))}" if "." in key else ""
            instead = _instead_of_sweep(request.command) + quoting
            raise UsageError(f"{text_of(override)}: several values are a sweep; {instead}")
        if "???" in values:
            raise UsageError(f"{text_of(override)}: ??? stands for a value that is missing; give one")
        head, _, tail = key.partition(".")
        if not tail and head in KINDS:
            for name in values:
                _check_plugin_name(head, name)
            _check_scans(head, values, request, text_of(override))
        elif not tail and head in ("training", "convention", "profile", "experiment"):
            for name in values:
                _check_preset(head, name, override.is_delete())
        elif tail and head in KINDS:
            _check_parameter(head, tail, request, override)
        elif head == "training" and tail:
            known = [f.name for f in dataclasses.fields(TrainingKeys)]
            _check_key("training.", tail.partition(".")[0], known, text_of(override))
        elif head == "limit" and tail:
            _check_key("limit.", tail, [f.name for f in dataclasses.fields(Limits)], text_of(override))
        else:
            _check_root_key(head, request, text_of(override))
            if override.is_delete() and head not in GROUPS:
                raise UsageError(f"{text_of(override)}: every run has {head}; leave this out for its default")


def _instead_of_sweep(command: str) -> str:
    if command in ("run", "plan"):
        return f"add -m: detailbench {command} -m ..."
    return f"`detailbench {command}` takes one value for each key"


# Keys of Hydra that have no effect here, or another one than elsewhere.
NOT_HERE = {
    "hydra.searchpath": "experiments and presets of your own are found in ./conf and in --config-dir DIR",
    "hydra.sweeper.params": "give each key its values, as in seed=0,1,2; an experiment file has hydra.sweeper.params",
    "hydra.run": "results go to the one folder results=DIR",
    "hydra.output_subdir": "configs are stored in the records of the results, and `detailbench why CELL` shows them",
}


def _check_hydra(key: str, values: Sequence[Any], override: Override) -> None:
    line = text_of(override)
    for known, instead in NOT_HERE.items():
        if key == known or key.startswith(f"{known}."):
            raise UsageError(f"{line}: {instead}")
    if override.is_sweep_override():
        raise UsageError(f"{line}: expected one value: keys of Hydra are the same for all jobs")
    if "/" in key and not all(value is None or isinstance(value, str) for value in values):
        raise UsageError(f"{line}: expected a name, as in hydra/launcher=joblib")
    if key == "hydra/sweeper" and "basic" not in values:
        raise UsageError(f"{line}: only Hydra's basic sweeper is supported; list the values: method.depth=7,8,9")


def _check_root_key(key: str, request: Request, line: str) -> None:
    """A key of the run; for a parameter of a chosen plugin, the error suggests its full name."""
    known = [*(f.name for f in dataclasses.fields(Base) if f.name not in SET_ELSEWHERE), *GROUPS]
    if key in known or key in SET_ELSEWHERE:
        return
    owners = [kind for kind in KINDS if kind != "metric" and key in _parameters_of_chosen(kind, request)]
    if owners:
        raise UsageError(f"{line}: there is no key {key!r}. Did you mean {' or '.join(f'{k}.{key}' for k in owners)}?")
    _check_key("", key, known, line)


SET_ELSEWHERE = ("plugins", "config_dirs", "session", "published", "sizes")  # keys not meant for the command line


def _parameters_of_chosen(kind: str, request: Request) -> set[str]:
    names = [presets.resolve(kind, name) for name in request.chosen(kind)]
    if kind == "task" and not request.about("task"):
        names = registry().names(kind)  # `apply` finds the right one
    known = registry().names(kind)
    return {f.name for name in names if name in known for f in registry().find(kind, name).fields}


def is_key(key: str) -> bool:
    """Whether the left side of an override names a key of a run, or a part of one."""
    head = key.lstrip("+~").partition(".")[0].partition("/")[0]
    return head in ("hydra", *GROUPS) or head in {f.name for f in dataclasses.fields(Base)}


def _check_plugin_name(kind: str, name: Any) -> None:
    for one in flat([name]):
        if one in ("None", "null", "") and registry().names(kind):
            raise UsageError(f"{kind}={one}: choose a {kind} by name. Known: {', '.join(registry().names(kind))}")
        known = presets.names(kind)
        if one not in known:
            registry().find(kind, one, also=known)


def _check_preset(group: str, name: Any, is_deleted: bool) -> None:
    known = presets.names(group)
    if str(name) in ("None", "null"):
        if is_deleted:
            return
        raise UsageError(f"{group}=null: leave it out, or write ~{group} where an experiment chooses one")
    if str(name) not in known:
        if "/" in str(name) or str(name).endswith((".yaml", ".yml")):
            raise UsageError(
                f"{group}={name}: expected a name; put the file into ./conf/{group}/, or into DIR/{group}/ with "
                f"--config-dir DIR, and use {group}={Path(str(name)).stem}"
            )
        raise UsageError(f"no {group} is called {name!r}. {did_you_mean(str(name), known)}")


def _check_parameter(kind: str, tail: str, request: Request, override: Override) -> None:
    """A parameter must belong to a plugin that the run chooses (or, if it chooses none, to some plugin)."""
    line = text_of(override)
    names = [presets.resolve(kind, n) for n in request.chosen(kind)]
    names = [n for n in names if n in registry().names(kind)] or registry().names(kind)
    prefix = f"{kind}."
    if kind == "metric":
        name, _, tail = tail.partition(".")
        registry().find(kind, name)
        names, prefix = [name], f"metric.{name}."
    known = {f.name for name in names for f in registry().find(kind, name).fields}
    parameter = tail.partition(".")[0]
    if parameter in known and kind != "metric" and request.chosen(kind):
        _check_all_have(kind, names, parameter, line)
    if parameter and parameter not in known:
        of_the_run = parameter == tail and parameter in {f.name for f in dataclasses.fields(Base)}
        hint = f"The run has it: use {parameter}=..." if of_the_run else _hint(prefix, parameter, known)
        raise UsageError(f"{line}: {_without_it(kind, names)} parameter {parameter!r}. {hint}")
    if parameter == tail and not override.is_delete():
        having = [p for p in (registry().find(kind, n) for n in names) if any(f.name == parameter for f in p.fields)]
        _check_values(having, parameter, override)


def _without_it(kind: str, names: Sequence[str]) -> str:
    """The beginning of a message: the plugins that lack a parameter."""
    names = list(dict.fromkeys(names))
    if len(names) == 1:
        return f"{kind} {names[0]} has no"
    if len(names) == len(registry().names(kind)):
        return f"no {kind} has a"
    return f"none of the {kind}s {', '.join(names)} has a"


def _check_all_have(kind: str, names: Sequence[str], parameter: str, line: str) -> None:
    """A parameter given with several plugins must belong to each: Hydra gives all jobs of a sweep the same keys."""
    having = [n for n in names if any(f.name == parameter for f in registry().find(kind, n).fields)]
    lacking = [n for n in dict.fromkeys(names) if n not in having]
    if lacking:
        first, second = (",".join(dict.fromkeys(some)) for some in (having, lacking))
        raise UsageError(
            f"{line}: {kind} {lacking[0]} has no parameter {parameter!r} ({having[0]} has). To sweep a parameter of "
            f"some beside others, run two commands into one folder: first {kind}={first} {line}, then {kind}={second}; "
            "both with the same results=DIR, and `detailbench leaderboard DIR` shows one table"
        )


def check_jobs(jobs: Iterable[Sequence[str]]) -> None:
    """:func:`check` of parameters for each combination that a sweep, or its experiment, makes of a group."""
    seen: set[tuple[str, ...]] = set()
    jobs = list(jobs)
    _check_parameters_of(jobs)
    for job in jobs:
        for kind in GROUPS:
            words = tuple(word for word in job if word.lstrip("+~").startswith((f"{kind}=", f"{kind}.")))
            if words and words not in seen:
                seen.add(words)
                if any(word.startswith(f"{kind}=") for word in words):
                    check(Request.of(words))


def _check_parameters_of(jobs: Iterable[Sequence[str]]) -> None:
    """For a parameter that only some plugins of a sweep have: report which lack it, and what to do."""
    names: dict[tuple[str, str], dict[str, None]] = {}
    lines: dict[tuple[str, str], str] = {}
    for job in jobs:
        chosen = dict(word.lstrip("+").partition("=")[::2] for word in job)
        for word in job:
            kind, _, parameter = word.lstrip("+").partition("=")[0].partition(".")
            if kind in KINDS and kind != "metric" and parameter and kind in chosen:
                names.setdefault((kind, parameter), {})[presets.resolve(kind, chosen[kind])] = None
                lines[kind, parameter] = word
    for (kind, parameter), plugins in names.items():
        known = [name for name in plugins if name in registry().names(kind)]
        if any(f.name == parameter for name in known for f in registry().find(kind, name).fields):
            _check_all_have(kind, known, parameter, lines[kind, parameter])


def _check_values(plugins: Sequence[Plugin], parameter: str, override: Override) -> None:
    """Each value of a parameter must fit its type, in one of the plugins that have it.

    This is checked before a sweep starts; values that a plugin itself refuses are reported by their job.
    """
    from hydra.core.override_parser.types import Glob, QuotedString, Transformer

    if override.is_interval_sweep() or isinstance(override.value(), Glob):
        return  # refused elsewhere
    swept = override.is_sweep_override()
    values = override.sweep_iterator(transformer=Transformer.identity) if swept else [override.value()]
    for value in values:
        value = value.text if isinstance(value, QuotedString) else value
        if isinstance(value, str) and "${" in value:  # known when Hydra composes
            continue
        errors = []
        for plugin in plugins:
            try:
                check_value(plugin, parameter, value)
            except UsageError as error:
                errors.append(error)
        if errors and len(errors) == len(plugins):
            raise errors[0]


def _check_key(prefix: str, key: str, known: Iterable[str], line: str) -> None:
    known = list(known)
    if key not in known:
        raise UsageError(f"{line}: there is no key '{prefix}{key}'. {_hint(prefix, key, known)}")


def _hint(prefix: str, key: str, known: Iterable[str]) -> str:
    return did_you_mean(key, known).replace("'", f"'{prefix}", 1) if prefix else did_you_mean(key, known)


def _check_scans(kind: str, names: Sequence[Any], request: Request, line: str) -> None:
    """Raise :class:`UsageError` if the usual simulation of scans is requested, but each dataset has its own."""
    from ..plan.cell import USUAL_SENSOR

    if kind != "sensor" or USUAL_SENSOR not in names:
        return
    known = registry().names("dataset")
    datasets = [presets.resolve("dataset", name) for name in request.chosen("dataset")]
    plugins = [registry().find("dataset", name) for name in datasets if name in known]
    if plugins and all(plugin.options.get("scans") for plugin in plugins):
        raise UsageError(
            f"{line}: dataset {plugins[0].name} has its own scans: leave the sensor out, or simulate scans of the "
            "references with dataset=files dataset.path=REFERENCES"
        )
