"""A look at Hydra overrides before Hydra gets them: every wrong name and parameter gets the nearest right one.

Hydra itself lists the options of a group but suggests none, and for an unknown key it advises ``+key=value``, which
then lets any typo in.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..errors import UsageError, did_you_mean
from ..plan.cell import NotSolved, check_dataset
from ..plan.keys import GROUPS, Base
from ..plan.limits import Limits
from ..plan.training import TrainingKeys
from ..plugins import presets
from ..plugins.registry import KINDS, Plugin, registry
from ..plugins.schema import check_value
from ..text import cut
from .quoting import hint


def check_overrides(overrides: Sequence[str], *, multirun: bool, command: str = "run") -> None:
    """Raise :class:`UsageError` for names and parameters that do not exist, and for a sweep without ``-m``.

    ``command`` is the one that has been called; one that has no ``-m`` takes one value for each key.
    """
    for override in _parse(overrides):
        key = override.key_or_group
        values = _values(override)
        if override.is_sweep_override() and not multirun and not key.startswith("hydra"):
            quoting = f"; {hint(override.input_line)}" if "." in key else ""
            instead = _instead_of_sweep(command) + quoting
            raise UsageError(f"{override.input_line}: several values are a sweep; {instead}")
        if key.startswith("hydra"):
            _check_hydra(key, values, override.input_line)
            continue
        if "???" in values:
            raise UsageError(f"{override.input_line}: ??? stands for a value that is missing; give one")
        head, _, tail = key.partition(".")
        if not tail and head in KINDS:
            for name in values:
                _check_plugin_name(head, name)
            _check_scans(head, values, overrides, override.input_line)
        elif not tail and head in ("training", "convention", "profile", "experiment"):
            for name in values:
                _check_preset(head, name, override.is_delete())
        elif tail and head in KINDS:
            _check_parameter(head, tail, overrides, override)
        elif head == "training" and tail:
            known = [f.name for f in dataclasses.fields(TrainingKeys)]
            _check_key("training.", tail.partition(".")[0], known, override.input_line)
        elif head == "limit" and tail:
            _check_key("limit.", tail, [f.name for f in dataclasses.fields(Limits)], override.input_line)
        else:
            _check_root_key(head, overrides, override.input_line)
            if override.is_delete() and head not in GROUPS:
                raise UsageError(f"{override.input_line}: every run has {head}; leave this out for its usual value")


def _instead_of_sweep(command: str) -> str:
    if command in ("run", "plan"):
        return f"add -m: detailbench {command} -m ..."
    return f"`detailbench {command}` takes one value for each key"


# Keys of Hydra that would do nothing here, or not what they do elsewhere.
NOT_HERE = {
    "hydra.searchpath": "experiments and presets of your own are found in ./conf and in --config-dir DIR",
    "hydra.run": "results go to the one folder results=DIR",
    "hydra.output_subdir": "configs are kept in the records of the results, and `detailbench why CELL` shows them",
}


def _check_hydra(key: str, values: Sequence[Any], line: str) -> None:
    for known, instead in NOT_HERE.items():
        if key == known or key.startswith(f"{known}."):
            raise UsageError(f"{line}: {instead}")
    if "/" in key and not all(value is None or isinstance(value, str) for value in values):
        raise UsageError(f"{line}: expected a name, as in hydra/launcher=joblib")
    if key == "hydra/sweeper" and "basic" not in values:
        raise UsageError(f"{line}: only Hydra's basic sweeper is supported; list the values: method.depth=7,8,9")


def _check_root_key(key: str, overrides: Sequence[str], line: str) -> None:
    """A key of the run; one that is a parameter of a chosen plugin gets that one's name."""
    known = [*(f.name for f in dataclasses.fields(Base) if f.name not in SET_ELSEWHERE), *GROUPS]
    if key in known or key in SET_ELSEWHERE:
        return
    owners = [kind for kind in KINDS if kind != "metric" and key in _parameters_of_chosen(kind, overrides)]
    if owners:
        raise UsageError(f"{line}: there is no key {key!r}. Did you mean {' or '.join(f'{k}.{key}' for k in owners)}?")
    _check_key("", key, known, line)


SET_ELSEWHERE = ("plugins", "config_dirs", "session", "published", "sizes")  # keys that no command line needs


def _parameters_of_chosen(kind: str, overrides: Sequence[str]) -> set[str]:
    names = [presets.resolve(kind, name) for name in chosen(kind, overrides)]
    if kind == "task" and not any(word.startswith("task=") for word in overrides):
        names = registry().names(kind)  # `apply` finds out which one is meant
    known = registry().names(kind)
    return {f.name for name in names if name in known for f in registry().find(kind, name).fields}


def by_experiment(overrides: Sequence[str]) -> list[list[str]]:
    """The overrides of each experiment in turn: ``experiment=a,b`` is one command after the other.

    An experiment brings a sweep of its own, and values for keys of all groups; Hydra cannot sweep over those.
    """
    for place, (word, override) in enumerate(zip(overrides, _parse(overrides), strict=True)):
        if override.key_or_group == "experiment" and override.is_sweep_override():
            names = dict.fromkeys(str(value) for value in _values(override))
            key = word.partition("=")[0]
            return [[*overrides[:place], f"{key}={name}", *overrides[place + 1 :]] for name in names]
    return [list(overrides)]


def without_globs(overrides: Sequence[str]) -> list[str]:
    """The overrides with the names that ``dataset=glob(*)`` stands for: those that can be used as they are."""
    from hydra.core.override_parser.types import Glob

    words = []
    for word, override in zip(overrides, _parse(overrides), strict=True):
        if isinstance(override.value(), Glob):
            word = f"{word.partition('=')[0]}={','.join(_matching(override))}"
        words.append(word)
    return words


def is_override(word: str) -> bool:
    """Whether a word of a command line is a key and its value, not the name of a file."""
    key, equals, _ = word.partition("=")
    return bool(equals) and key.lstrip("+").replace(".", "_").replace("@", "_").replace("/", "_").isidentifier()


def is_key(key: str) -> bool:
    """Whether the left side of an override names a key of a run, or a part of one."""
    head = key.lstrip("+~").partition(".")[0].partition("/")[0]
    return head in ("hydra", *GROUPS) or head in {f.name for f in dataclasses.fields(Base)}


def _parse(overrides: Sequence[str]) -> list[Any]:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    parsed = []
    for text in overrides:
        try:
            parsed.extend(OverridesParser.create().parse_overrides([text]))
        except OverrideParseException as error:
            raise UsageError(
                f"cannot read {cut(text, 200)!r}: expected key=value, for instance method=poisson or limit.seconds=60 "
                f"({cut(str(error).splitlines()[0], 200)})" + (f"; {hint(text)}" if is_override(text) else "")
            ) from error
        except RecursionError as error:
            raise UsageError(f"cannot read {cut(text, 200)!r}: nested too deeply") from error
    return parsed


def _values(override: Any) -> list[Any]:
    """The values of an override: one, those of a sweep, or those of a list."""
    from hydra.core.override_parser.types import Glob

    if isinstance(override.value(), Glob):
        return _matching(override)
    if override.is_interval_sweep():
        raise UsageError(
            f"{override.input_line}: a sweep takes listed values, not an interval; list some, or use range(...)"
        )
    if override.is_sweep_override() and override.is_choice_sweep():
        return [_text(v) for v in override.value().list]
    value = override.value()
    return [_text(v) for v in value] if isinstance(value, list) else [_text(value)]


def _matching(override: Any) -> list[str]:
    """The plugins and presets that ``method=glob(p*)`` means."""
    group = override.key_or_group
    if group not in GROUPS:
        raise UsageError(f"{override.input_line}: glob() is for names of plugins; list the values of {group}")
    known = {*presets.names(group), *(registry().names(group) if group in KINDS else ())}
    found = override.value().filter(sorted(known))
    if group == "dataset":
        found = [name for name in found if not _wants_more(name)]
    if not found:
        raise UsageError(f"{override.input_line}: no {group} matches. Known: {', '.join(sorted(known))}")
    return found


def _wants_more(dataset: str) -> bool:
    """Whether a dataset cannot be used at its defaults, as ``files``, which wants a path."""
    if dataset not in registry().names("dataset"):
        return False
    try:
        check_dataset(registry().find("dataset", dataset).cls(), "test")
    except NotSolved:  # it was not fetched: the plan says so
        return False
    except UsageError:
        return True
    return False


def _text(value: Any) -> Any:
    return [str(v) for v in value] if isinstance(value, list) else value


def _flat(values: Iterable[Any]) -> list[str]:
    return [str(v) for value in values for v in (value if isinstance(value, list) else [value])]


def chosen(kind: str, overrides: Sequence[str]) -> list[str]:
    """The plugin names of a kind that the overrides choose; without any, and without a preset, the default."""
    names: list[str] = []
    preset = False
    for override in _parse(overrides):
        preset = preset or override.key_or_group == "experiment"
        if override.key_or_group == kind:
            names = _flat(_values(override))  # of several, Hydra takes the last
    return names if names or preset else [n for n in (_default_choice(kind),) if n]


def threads_of(overrides: Sequence[str]) -> int:
    """How many threads the words of a command ask for first; 1 where they do not say, or what cannot be."""
    asked = [value for key, _, value in (word.partition("=") for word in overrides) if key == "threads"]
    first = asked[-1].partition(",")[0] if asked else ""
    return max(int(first), 1) if first.isdecimal() else 1


def word_of_threads(overrides: Sequence[str], processors: int) -> str:
    """What is to be said of more threads than there are processors here; nothing where jobs are run elsewhere."""
    threads = threads_of(overrides)
    if threads <= processors or not runs_here(overrides):
        return ""
    return f"threads={threads}: only {processors} processors can be used here, so the times are not those of {threads}"


def devices_of(overrides: Sequence[str]) -> list[str]:
    """The devices that the words of a command ask for; what a preset may say is found when its cell is run."""
    asked = [str(v) for override in _parse(overrides) if override.key_or_group == "device" for v in _values(override)]
    return list(dict.fromkeys(asked))


def runs_here(overrides: Sequence[str]) -> bool:
    """Whether the launcher that the words choose runs jobs on this machine, as far as is known."""
    chosen = [word.partition("=")[2] for word in overrides if word.lstrip("+").startswith("hydra/launcher=")]
    return not chosen or chosen[-1] in ("basic", "joblib", "submitit_local")


def _default_choice(group: str) -> str | None:
    """What the main config chooses."""
    from importlib.resources import files

    from omegaconf import OmegaConf

    config = OmegaConf.create((files("bench.conf") / "config.yaml").read_text())
    for entry in config.defaults:
        if not isinstance(entry, str) and group in entry:
            return entry[group]
    return None


def _check_plugin_name(kind: str, name: Any) -> None:
    for one in _flat([name]):
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
                f"--config-dir DIR, and say {group}={Path(str(name)).stem}"
            )
        raise UsageError(f"no {group} is called {name!r}. {did_you_mean(str(name), known)}")


def _check_parameter(kind: str, tail: str, overrides: Sequence[str], override: Any) -> None:
    """A parameter must be one of a plugin that the run chooses (or, where it chooses none, of some plugin)."""
    line = override.input_line
    names = [presets.resolve(kind, n) for n in chosen(kind, overrides)]
    names = [n for n in names if n in registry().names(kind)] or registry().names(kind)
    prefix = f"{kind}."
    if kind == "metric":
        name, _, tail = tail.partition(".")
        registry().find(kind, name)
        names, prefix = [name], f"metric.{name}."
    known = {f.name for name in names for f in registry().find(kind, name).fields}
    parameter = tail.partition(".")[0]
    if parameter in known and kind != "metric" and chosen(kind, overrides):
        _check_all_have(kind, names, parameter, line)
    if parameter and parameter not in known:
        of_the_run = parameter == tail and parameter in {f.name for f in dataclasses.fields(Base)}
        hint = f"The run has: say {parameter}=..." if of_the_run else _hint(prefix, parameter, known)
        raise UsageError(f"{line}: {_without_it(kind, names)} parameter {parameter!r}. {hint}")
    if parameter == tail and not override.is_delete():
        having = [p for p in (registry().find(kind, n) for n in names) if any(f.name == parameter for f in p.fields)]
        _check_values(having, parameter, override)


def _without_it(kind: str, names: Sequence[str]) -> str:
    """The beginning of a message: who has no parameter of a name."""
    names = list(dict.fromkeys(names))
    if len(names) == 1:
        return f"{kind} {names[0]} has no"
    if len(names) == len(registry().names(kind)):
        return f"no {kind} has a"
    return f"none of the {kind}s {', '.join(names)} has a"


def _check_all_have(kind: str, names: Sequence[str], parameter: str, line: str) -> None:
    """A parameter beside several plugins is one of each of them: Hydra gives all of a sweep the same keys."""
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
    """:func:`check_overrides` of parameters for each combination that a sweep, or its experiment, makes of a group."""
    seen: set[tuple[str, ...]] = set()
    jobs = list(jobs)
    _check_parameters_of(jobs)
    for job in jobs:
        for kind in GROUPS:
            words = tuple(word for word in job if word.lstrip("+~").startswith((f"{kind}=", f"{kind}.")))
            if words and words not in seen:
                seen.add(words)
                if any(word.startswith(f"{kind}=") for word in words):
                    check_overrides(words, multirun=False)


def _check_parameters_of(jobs: Iterable[Sequence[str]]) -> None:
    """Of a parameter that some plugins of a sweep have: say which have not, and what to do."""
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


def _check_values(plugins: Sequence[Plugin], parameter: str, override: Any) -> None:
    """Each value of a parameter must fit its type, in one of the plugins that have it.

    This is found out before a sweep starts; what a plugin itself refuses is, by the job that meets it.
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


def _check_scans(kind: str, names: Sequence[Any], overrides: Sequence[str], line: str) -> None:
    """Raise :class:`UsageError` where the usual simulation of scans is asked for, and each dataset brings its own."""
    from ..plan.cell import USUAL_SENSOR

    if kind != "sensor" or USUAL_SENSOR not in names:
        return
    known = registry().names("dataset")
    datasets = [presets.resolve("dataset", name) for name in chosen("dataset", overrides)]
    plugins = [registry().find("dataset", name) for name in datasets if name in known]
    if plugins and all(plugin.options.get("scans") for plugin in plugins):
        raise UsageError(
            f"{line}: dataset {plugins[0].name} brings its own scans: leave the sensor out, or simulate scans of the "
            "references with dataset=files dataset.path=REFERENCES"
        )
