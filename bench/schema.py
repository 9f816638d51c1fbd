"""From a plugin's dataclass to a typed Hydra config, and back.

Nothing is declared twice: the fields of the dataclass are the keys of the config, their types are checked when Hydra
composes, and :func:`build` makes the plugin from the composed values.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union

from .errors import PluginError, UsageError, did_you_mean
from .registry import Plugin, registry

NAME_KEY = "_name_"  # which plugin a config node is for
_SCALARS = (bool, int, float, str, Path)


def config_class(plugin: Plugin) -> type:
    """A dataclass that Hydra understands, with the plugin's parameters and defaults.

    It is made anew instead of handing Hydra the plugin's own class: a class without a home module is pickled by
    value, so the launchers can carry the config of a ``--plugin`` file into their worker processes.

    Raises
    ------
    PluginError
        If a parameter has a type that a config cannot hold.
    """
    entries: list[tuple[str, Any, Any]] = [(NAME_KEY, str, plugin.name)]
    types = _config_types(plugin)
    for f in plugin.fields:
        default = _plain(f.default_factory() if f.default is dataclasses.MISSING else f.default)  # type: ignore[misc]
        annotation = types[f.name]
        if isinstance(default, (list, dict)):
            entries.append((f.name, annotation, dataclasses.field(default_factory=lambda value=default: value)))
        else:
            entries.append((f.name, annotation, default))
    return dataclasses.make_dataclass(plugin.cls.__name__, entries)


def _config_types(plugin: Plugin) -> dict[str, Any]:
    """The config's type of every parameter, or :class:`PluginError` for one that it cannot hold."""
    hints = field_types(plugin)
    where = f"{plugin.kind} {plugin.name}: parameter"
    return {f.name: _config_type(hints[f.name], f"{where} {f.name!r}") for f in plugin.fields}


def field_types(plugin: Plugin) -> dict[str, Any]:
    """The type of every parameter.

    Raises
    ------
    PluginError
        If an annotation names what is not there.
    """
    try:
        return typing.get_type_hints(plugin.cls)
    except NameError as error:
        raise PluginError(
            f"{plugin.kind} {plugin.name}: the type of a parameter cannot be resolved ({error}); use int, float, str, "
            "bool, Path, Literal, list, dict, or one of these | None"
        ) from error


def _config_type(annotation: Any, where: str) -> Any:
    """The nearest type that OmegaConf knows; a Literal becomes the type of its values and is checked by `build`."""
    origin, args = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation is Any or annotation in _SCALARS:
        return annotation
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return annotation
    if origin is Literal:
        kinds = {type(value) for value in args}
        return kinds.pop() if len(kinds) == 1 else Any
    if origin in (Union, types.UnionType):
        inner = tuple(_config_type(a, where) for a in args if a is not type(None))
        if len(inner) == len(args):
            return Union[inner] if all(i in _SCALARS for i in inner) else Any  # noqa: UP007
        return typing.Optional[inner[0]] if len(inner) == 1 else Any  # noqa: UP045
    if origin is list or annotation is list:
        return list[_config_type(args[0], where)] if args else list[Any]
    if origin is tuple or annotation is tuple:
        inner = {_config_type(a, where) for a in args if a is not Ellipsis}
        return list[inner.pop()] if len(inner) == 1 else list[Any]
    if origin is dict or annotation is dict:
        return dict[str, _config_type(args[1], where)] if args else dict[str, Any]
    raise PluginError(
        f"{where}: a config cannot hold the type {annotation!r}; use int, float, str, bool, Path, Literal, list, dict, "
        "or one of these | None"
    )


def _plain(value: Any) -> Any:
    """The value as JSON would have it: paths and enums as text, tuples as lists."""
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    return value


def build(plugin: Plugin, values: Mapping[str, Any]) -> Any:
    """The plugin made from plain values, for instance those of a composed config.

    Raises
    ------
    UsageError
        For an unknown parameter (with the nearest right one) or a value that is refused.
    """
    hints = field_types(plugin)
    arguments = {}
    for key, value in values.items():
        if key == NAME_KEY:
            continue
        if key not in hints or key not in {f.name for f in plugin.fields}:
            names = [f.name for f in plugin.fields]
            raise UsageError(f"{plugin.kind} {plugin.name} has no parameter {key!r}. {did_you_mean(key, names)}")
        arguments[key] = _convert(value, hints[key], f"{plugin.kind}.{key}")
    try:
        return plugin.cls(**arguments)
    except (ValueError, TypeError) as error:
        raise UsageError(f"{plugin.kind} {plugin.name}: {error}") from error


def _convert(value: Any, annotation: Any, where: str) -> Any:
    """From JSON values to what the annotation says."""
    origin, args = typing.get_origin(annotation), typing.get_args(annotation)
    if value is None or annotation is Any:
        return value
    if origin is Literal:
        if value not in args:
            names = [str(a) for a in args]
            raise UsageError(f"{where}={value}: not one of {', '.join(names)}. {did_you_mean(str(value), names)}")
        return value
    if origin in (Union, types.UnionType):
        inner = [a for a in args if a is not type(None)]
        return _convert(value, inner[0], where) if len(inner) == 1 else value
    if origin is tuple or annotation is tuple:
        return tuple(value)
    if annotation is Path:
        return Path(value)
    if annotation is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum) and isinstance(value, str):
        return annotation[value]
    if annotation in (int, float, bool, str) and type(value) is not annotation:
        raise UsageError(f"{where}={value}: expected {annotation.__name__}, got {type(value).__name__}")
    if annotation is float and math.isnan(value):
        raise UsageError(f"{where}=nan: expected a number")
    return value


def defaults(plugin: Plugin) -> dict[str, Any]:
    """The default of every parameter, as JSON values."""
    return {
        f.name: _plain(f.default_factory() if f.default is dataclasses.MISSING else f.default)  # type: ignore[misc]
        for f in plugin.fields
    }


def parameters(plugin: Plugin, instance: Any) -> dict[str, Any]:
    """The value of every parameter of a plugin object, as JSON values."""
    return {f.name: _plain(getattr(instance, f.name)) for f in plugin.fields}


def variant(plugin: Plugin, values: Mapping[str, Any]) -> str:
    """The parameters that are not at their defaults: ``depth=9,trim=0.1``, or an empty string."""
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

    Making a node of each plugin there is takes longer than all else that a start does, and a run composes a few. What
    is pickled for the processes of a launcher are the nodes that were made: Hydra composes a sweep's jobs beforehand.
    """

    def __init__(self, kind: str):
        super().__init__({f"{name}.yaml": None for name in registry().names(kind)})
        self._kind = kind

    def __getitem__(self, name: str) -> Any:
        node = super().__getitem__(name)
        if node is None:
            node = self[name] = _config_node(registry().find(self._kind, name.removesuffix(".yaml")))
        return node

    def __deepcopy__(self, memo: dict[int, Any]) -> _Group:
        return self  # Hydra copies the store with itself, and every node again when it loads it

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, ({name: node for name, node in self.items() if node is not None},)


def _config_node(plugin: Plugin) -> Any:
    from hydra.core.config_store import ConfigNode
    from omegaconf import OmegaConf

    package = f"metric.{plugin.name}" if plugin.kind == "metric" else None
    node = OmegaConf.structured(config_class(plugin))
    return ConfigNode(f"{plugin.name}.yaml", node, plugin.kind, package, plugin.origin)


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
