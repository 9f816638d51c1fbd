"""From a plugin's dataclass to a Hydra config, and back.

Nothing is declared twice: the fields of the dataclass are the keys of the config, and :func:`build` makes the plugin
from the composed values. Hydra composes and :mod:`conversion` checks the types: OmegaConf knows neither Literal
nor tuples of a fixed length, and it takes 3 for true and "3" for 3.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import typing
from collections.abc import Mapping
from typing import Any

from ..errors import PluginError, UsageError, did_you_mean
from .conversion import ALLOWED, check_type, convert, is_text, plain
from .metric_sets import FULL, metric_set
from .registry import Plugin, registry

NAME_KEY = "_name_"  # which plugin a config node is for


def config_class(plugin: Plugin) -> type:
    """A dataclass for Hydra, with the plugin's parameters and defaults.

    It replaces the plugin's own class for Hydra: a class without a home module is pickled by
    value, so the launchers can carry the config of a ``--plugin`` file into their worker processes.

    Raises
    ------
    PluginError
        If a parameter has a type that a config cannot hold.
    """
    entries: list[tuple[str, Any, Any]] = [(NAME_KEY, str, plugin.name)]
    types = _config_types(plugin)
    for f in plugin.fields:
        default = _default(f)
        annotation = types[f.name]
        if isinstance(default, (list, dict)):
            anew = functools.partial(copy.copy, default)
            entries.append((f.name, annotation, dataclasses.field(default_factory=anew)))
        else:
            entries.append((f.name, annotation, default))
    return dataclasses.make_dataclass(plugin.cls.__name__, entries)


def _config_types(plugin: Plugin) -> dict[str, Any]:
    """The config's type of every parameter, or :class:`PluginError` for one that it cannot hold.

    Texts are declared, since a command line has no quotes: ``dataset.path=2024`` is a folder. All else is Any.
    """
    hints = field_types(plugin)
    for f in plugin.fields:
        check_type(hints[f.name], f"{plugin.kind} {plugin.name}: parameter {f.name!r}")
    return {f.name: str | None if is_text(hints[f.name]) else Any for f in plugin.fields}


def field_types(plugin: Plugin) -> dict[str, Any]:
    """The type of every parameter.

    Raises
    ------
    PluginError
        If an annotation names something undefined.
    """
    try:
        return _type_hints(plugin.cls)
    except (NameError, AttributeError, TypeError, SyntaxError) as error:
        raise PluginError(
            f"{plugin.kind} {plugin.name}: the type of a parameter cannot be resolved ({error}); use {ALLOWED}"
        ) from error


@functools.lru_cache(maxsize=1024)  # called for every object built; failures are not cached
def _type_hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def build(plugin: Plugin, values: Mapping[str, Any]) -> Any:
    """The plugin made from plain values, for instance those of a composed config.

    Raises
    ------
    UsageError
        For an unknown parameter (with the nearest right one) or a value that is refused.
    """
    hints, names = field_types(plugin), [f.name for f in plugin.fields]
    arguments = {}
    for key, value in values.items():
        if key == NAME_KEY:
            continue
        if key not in hints or key not in names:
            raise UsageError(f"{plugin.kind} {plugin.name} has no parameter {key!r}. {did_you_mean(key, names)}")
        arguments[key] = convert(value, hints[key], _key(plugin, key))
    try:
        return plugin.cls(**arguments)
    except (ValueError, TypeError) as error:
        raise UsageError(f"{plugin.kind} {plugin.name}: {error}") from error


def _key(plugin: Plugin, parameter: str) -> str:
    """The name of a parameter on the command line."""
    return f"metric.{plugin.name}.{parameter}" if plugin.kind == "metric" else f"{plugin.kind}.{parameter}"


def check_value(plugin: Plugin, parameter: str, value: Any) -> None:
    """Raise :class:`UsageError` for a value of a command line that does not fit the type of a parameter."""
    annotation = field_types(plugin)[parameter]
    if is_text(annotation) and isinstance(value, (int, float)):
        value = str(value)  # as in the config, see _config_types
    convert(value, annotation, _key(plugin, parameter))


def defaults(plugin: Plugin) -> dict[str, Any]:
    """The default of every parameter, as JSON values."""
    return {f.name: _default(f) for f in plugin.fields}


def _default(field: dataclasses.Field[Any]) -> Any:
    return plain(field.default if field.default_factory is dataclasses.MISSING else field.default_factory())


def parameters(plugin: Plugin, instance: Any) -> dict[str, Any]:
    """The value of every parameter of a plugin object, as JSON values; they identify a cell.

    A parameter added to a plugin later (``metadata={"since": VERSION}``) is left out at its default: cells that were
    stored before it existed keep their ids.
    """
    values = {f.name: plain(getattr(instance, f.name)) for f in plugin.fields}
    return {f.name: values[f.name] for f in plugin.fields if "since" not in f.metadata or values[f.name] != _default(f)}


def variant(plugin: Plugin, values: Mapping[str, Any]) -> str:
    """The parameters that are not at their defaults: ``depth=9,trim=0.1``, or an empty string.

    A class attribute ``called`` names a parameter that replaces all of them if it is set.
    """
    if name := values.get(getattr(plugin.cls, "called", "")):
        return str(name)
    usual = defaults(plugin)
    return ",".join(f"{k}={_short(v)}" for k, v in values.items() if k in usual and v != usual[k])


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):  # a step of a chain: gaussian(sigma=0.01)
        return "+".join(f"{k}({_inner(v)})" if isinstance(v, Mapping) else f"{k}={_short(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)) and any(isinstance(v, Mapping) for v in value):
        return "+".join(_short(v) for v in value)
    return str(value)


def _inner(values: Mapping[str, Any]) -> str:
    return ",".join(f"{k}={_short(v)}" for k, v in values.items())


class _Group(dict):
    """A group of Hydra's config store whose nodes are made when they are first composed.

    Making the nodes of all plugins takes longer than the rest of a start, and a run composes only a few. The nodes
    pickled for the processes of a launcher are the existing ones: Hydra composes a sweep's jobs beforehand.
    """

    def __init__(self, kind: str):
        sets = [FULL] if kind == "metric" else []
        super().__init__({f"{name}.yaml": None for name in [*registry().names(kind), *sets]})
        self._kind = kind

    def __getitem__(self, name: str) -> Any:
        node = super().__getitem__(name)
        if node is None:
            node = self[name] = self._made(name.removesuffix(".yaml"))
        return node

    def _made(self, name: str) -> Any:
        if self._kind == "metric" and name == FULL:
            return _config_set(name)
        return _config_node(registry().find(self._kind, name))

    def __deepcopy__(self, memo: dict[int, Any]) -> _Group:
        return self  # Hydra copies the store with itself, and copies every node again when it loads it

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, ({name: node for name, node in self.items() if node is not None},)


def _config_node(plugin: Plugin) -> Any:
    from hydra.core.config_store import ConfigNode
    from omegaconf import DictConfig, OmegaConf

    package = f"metric.{plugin.name}" if plugin.kind == "metric" else None
    node = OmegaConf.structured(config_class(plugin))
    for name in node:
        if isinstance(node[name], DictConfig):
            OmegaConf.set_struct(node[name], False)  # the keys of a mapping are the user's
    return ConfigNode(f"{plugin.name}.yaml", node, plugin.kind, package, plugin.origin)


def _config_set(name: str) -> Any:
    """The equivalent of a file ``conf/metric/NAME.yaml`` with a list of defaults."""
    from hydra.core.config_store import ConfigNode
    from omegaconf import OmegaConf

    return ConfigNode(f"{name}.yaml", OmegaConf.create({"defaults": metric_set(name)}), "metric", None, "detailbench")


def store_configs() -> None:
    """Put every registered plugin into Hydra's config store, each in the group of its kind."""
    from hydra.core.config_store import ConfigStore

    from .registry import KINDS

    check_configs()
    for kind in KINDS:
        ConfigStore.instance().repo[kind] = _Group(kind)


def check_configs() -> None:
    """List plugins whose parameters a config cannot hold as broken, like those that do not import."""
    from .registry import Broken

    for plugin in registry().loaded():
        try:
            _config_types(plugin)
        except PluginError as error:
            if all(b.reason != str(error) for b in registry().broken):
                registry().broken.append(Broken(plugin.origin, plugin.file, str(error)))
