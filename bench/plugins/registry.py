"""Plugins: how they register, how they are found, and the messages about wrong names.

Three ways in, one interface::

    @register("method", cite="Kazhdan and Hoppe 2013")      # 1. in a file: detailbench run --plugin my_method.py
    @dataclass(frozen=True)
    class Poisson:
        \"\"\"Screened Poisson surface reconstruction.\"\"\"
        depth: int = 8       # octree depth

    [project.entry-points."detailbench.plugins"]             # 2. in any installed package: the value names a module,
    my_methods = "my_package.methods"                        #    or a package, whose plugin modules are all loaded

    registry().find("method", "poisson")                     # 3. shipped plugins use way 2

Discovery is guarded: a plugin that fails to import is listed as broken, with its reason, and the others still load.
Modules that do not mention ``register`` (building blocks, and whatever heavy library they import) are not loaded.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ..errors import DetailbenchError, MissingLibrary, PluginError, UsageError, did_you_mean
from .config_files import ENTRY_POINTS
from .declared import declared, registers, snake_case

KINDS = ("task", "dataset", "sensor", "method", "metric")
DIRECTIONS = ("lower", "higher", "reference")

# Import names whose distribution has another name, or that need another one.
INSTALL_LINES = {
    "CGAL": "pip install cgal",
    "torch": "pip install torch safetensors",
    "skimage": "pip install scikit-image",
    "sklearn": "pip install scikit-learn",
    "igl": "pip install libigl",
    "cv2": "pip install opencv-python-headless",
}

T = TypeVar("T", bound=type)


def install_line(library: str) -> str:
    """The command that installs the distribution of an import name."""
    if library == "CGAL" and sys.version_info >= (3, 13):
        return f"{INSTALL_LINES[library]} under Python 3.11 or 3.12 (cgal has no build for 3.13)"
    return INSTALL_LINES.get(library, f"pip install {library}")


@dataclass(frozen=True)
class Plugin:
    """One registered class and what its author declared."""

    kind: str
    name: str
    cls: type
    file: Path
    origin: str
    cite: str = ""
    requires: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """The first line of the docstring."""
        return (inspect.getdoc(self.cls) or "").strip().splitlines()[0]

    @property
    def version(self) -> int:
        """The version of the definition: part of every fingerprint (metrics must have one)."""
        return int(self.options.get("version", 1))

    @property
    def fields(self) -> tuple[dataclasses.Field[Any], ...]:
        """The parameters."""
        return dataclasses.fields(self.cls)

    def better(self, key: str) -> str:
        """The direction of a score of this metric: ``lower``, ``higher`` or ``reference`` (nearest the truth's)."""
        better = self.options.get("better", "lower")
        return better if isinstance(better, str) else better.get(key, "lower")

    def length(self, key: str) -> int:
        """The power of length in a score of this metric: 1 for a distance, 2 for its square, 0 for a share."""
        length = self.options.get("length", 0)
        if length == "file":
            return 0
        return length if isinstance(length, int) else length.get(key.partition("@")[0], 0)

    def solves(self, task: str) -> bool:
        """Whether this method has a function named after the task."""
        return callable(getattr(self.cls, task, None))

    def require(self) -> None:
        """Import the libraries that this plugin declares.

        Raises
        ------
        MissingLibrary
            With the line that installs the missing one, or the system package that it lacks.
        """
        for library in self.requires:
            try:
                importlib.import_module(library)
            except ImportError as error:
                raise missing_library(error, library) from error


def missing_library(error: ImportError, library: str | None = None) -> MissingLibrary:
    """The message for a failed import: what to install, from pip or, for a shared object, from the system."""
    library = library or (error.name or "a library").partition(".")[0]
    if "shared object" in str(error):
        packages = "apt-get install -y --no-install-recommends libusb-1.0-0 libgl1 libegl1 libopengl0"
        return MissingLibrary(library, packages, f"lacks a system library ({error})")
    if not isinstance(error, ModuleNotFoundError):
        return MissingLibrary(library, install_line(library), f"cannot be imported ({error})")
    return MissingLibrary(library, install_line(library))


@dataclass(frozen=True)
class Broken:
    """A plugin module that could not be loaded."""

    origin: str
    file: Path | None
    reason: str
    details: str = ""


class Registry:
    """All plugins by kind and name, and those that could not be loaded.

    Names are read from the text of the modules (:mod:`bench.plugins.declared`), and a module is imported when one of
    its plugins is asked for, or if its text does not reveal what it registers.
    """

    def __init__(self) -> None:
        self._plugins: dict[str, dict[str, Plugin]] = {kind: {} for kind in KINDS}
        self._known: dict[str, dict[str, tuple[str, str]]] = {kind: {} for kind in KINDS}  # name -> module, origin
        self._collisions: dict[tuple[str, str], PluginError] = {}
        self.broken: list[Broken] = []
        self.files: set[Path] = set()  # loaded like those of --plugin
        self._loaded: set[str] = set()
        self._discovered = False
        self._origin: str | None = None

    # -- registering -----------------------------------------------------------------------------------------------

    def add(self, plugin: Plugin) -> None:
        """Add one plugin; a second one of that name from elsewhere is refused, naming both."""
        module, origin = self._known[plugin.kind].get(plugin.name, ("", ""))
        if module == plugin.cls.__module__:  # imported by other code than the registry
            del self._known[plugin.kind][plugin.name]
            plugin = replace(plugin, origin=origin)
        self._load_known(plugin.kind, plugin.name)
        known = self._plugins[plugin.kind].get(plugin.name)
        if known and (known.file, known.cls.__qualname__) != (plugin.file, plugin.cls.__qualname__):
            collision = PluginError(
                f"two {plugin.kind}s are called {plugin.name!r}: {known.cls.__qualname__} in {known.file} "
                f"({known.origin}) and {plugin.cls.__qualname__} in {plugin.file} ({plugin.origin}). Rename one: "
                f'@register("{plugin.kind}", name="...")'
            )
            self._collisions[plugin.kind, plugin.name] = collision
            raise collision
        self._plugins[plugin.kind][plugin.name] = plugin

    @property
    def origin(self) -> str:
        """The origin of the module that is being imported."""
        return self._origin or "imported"

    # -- asking ----------------------------------------------------------------------------------------------------

    def names(self, kind: str) -> list[str]:
        """The names of one kind, sorted."""
        return sorted({*self._plugins[kind], *self._known[kind]})

    def all(self, kind: str) -> list[Plugin]:
        """The plugins of one kind, by name."""
        for name in list(self._known[kind]):
            self._load_known(kind, name)
        return [self._plugins[kind][name] for name in self.names(kind)]

    def loaded(self) -> list[Plugin]:
        """The plugins of all kinds whose modules are already imported."""
        return [plugin for kind in KINDS for plugin in self._plugins[kind].values()]

    def find(self, kind: str, name: str, *, also: Iterable[str] = ()) -> Plugin:
        """The plugin of that kind and name; ``also`` are other names to suggest.

        Raises
        ------
        UsageError
            If there is none (with the nearest name, and the plugins that are broken), or if two claim the name.
        """
        self._load_known(kind, name)
        if (kind, name) in self._collisions:
            raise UsageError(str(self._collisions[kind, name]))
        if name in self._plugins[kind]:
            return self._plugins[kind][name]
        broken = "".join(f"\nBroken plugin {b.origin}: {b.reason}" for b in self.broken)
        raise UsageError(f"no {kind} is called {name!r}. {did_you_mean(name, [*self.names(kind), *also])}{broken}")

    # -- loading ---------------------------------------------------------------------------------------------------

    def discover(self) -> None:
        """Record the plugins of every entry point of the group, once."""
        if self._discovered:
            return
        self._discovered = True
        for entry in sorted(importlib.metadata.entry_points(group=ENTRY_POINTS), key=lambda e: (not _ours(e), e.name)):
            origin = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.name
            for module, file in self._plugin_modules(entry.module, origin):
                plugins = declared(file) if file else None
                taken = [(kind, name) for kind, name in plugins or () if kind not in KINDS or self._has(kind, name)]
                for kind, name in taken:  # the import of both reports the error
                    self._load_known(kind, name)
                if plugins is None or taken:
                    self._guarded(origin, module, partial(importlib.import_module, module))
                    continue
                for kind, name in plugins:
                    self._known[kind][name] = (module, origin)

    def _has(self, kind: str, name: str) -> bool:
        return name in self._known[kind] or name in self._plugins[kind]

    def _load_known(self, kind: str, name: str) -> None:
        """Import the module of a name that is known from its text."""
        if name not in self._known.get(kind, ()):
            return
        module, origin = self._known[kind].pop(name)
        outer = self._origin  # this may happen while another module is being imported
        self._guarded(origin, module, partial(importlib.import_module, module))
        self._origin = outer

    def load_file(self, path: str | Path) -> None:
        """Load one plugin file, as ``--plugin`` does.

        Raises
        ------
        UsageError
            If there is no such file, or if one of its names is taken: whoever names a file wants that one.
        """
        path = Path(os.path.expanduser(path)).resolve()
        if not path.is_file():
            raise UsageError(f"--plugin {path}: no such file")
        if path.suffix != ".py":
            raise UsageError(f"--plugin {path}: expected a Python file (.py)")
        for kind in KINDS:
            for name, (module, _) in list(self._known[kind].items()):
                if module.rpartition(".")[2] == path.stem:  # perhaps an installed one
                    self._load_known(kind, name)
        if any(plugin.file == path for kind in KINDS for plugin in self._plugins[kind].values()):
            return  # an installed one
        self.files.add(path)
        module = plugin_module_name(path)
        collisions = set(self._collisions)
        self._guarded(str(path), module, lambda: _import_file(path, module), file=path)
        for key in set(self._collisions) - collisions:
            raise UsageError(str(self._collisions[key]))

    def _guarded(self, origin: str, module: str, load: Callable[[], Any], file: Path | None = None) -> None:
        if module in self._loaded:
            return
        self._loaded.add(module)
        self._origin = origin
        is_imported = module in sys.modules
        try:
            load()
            if is_imported:  # before the registry requested it
                self._adopt(module, origin)
        except (Exception, SystemExit) as error:  # the guard: whatever a plugin's import does, the others still load
            reason, details = _reason(error)
            self.broken.append(Broken(f"{origin} ({module})" if not file else origin, file, reason, details))
        finally:
            self._origin = None

    def _adopt(self, module: str, origin: str) -> None:
        """Set the origin of the plugins of a module that was imported before it was discovered."""
        for plugins in self._plugins.values():
            for name, plugin in plugins.items():
                if plugin.cls.__module__ == module and plugin.origin == "imported":
                    plugins[name] = replace(plugin, origin=origin)

    def _plugin_modules(self, name: str, origin: str) -> Iterable[tuple[str, Path | None]]:
        """The module, or, of a package, its modules that register something, each with its file."""
        try:
            spec = importlib.util.find_spec(name)
        except (Exception, SystemExit) as error:  # the parent package's own import may do anything
            self.broken.append(Broken(f"{origin} ({name})", None, f"{type(error).__name__}: {error}", _trace(error)))
            return
        if spec is None:
            self.broken.append(Broken(f"{origin} ({name})", None, f"there is no module {name!r}"))
            return
        if not spec.submodule_search_locations:
            yield name, Path(spec.origin) if spec.origin else None
            return
        for folder in spec.submodule_search_locations:
            yield from _modules_below(Path(folder), name)


def _modules_below(folder: Path, package: str) -> Iterator[tuple[str, Path]]:
    """The modules of a package that register something, and of the packages in it."""
    for path in sorted(folder.iterdir() if folder.is_dir() else ()):
        if path.suffix == ".py" and registers(path):
            yield package if path.stem == "__init__" else f"{package}.{path.stem}", path
        elif (path / "__init__.py").is_file():
            yield from _modules_below(path, f"{package}.{path.name}")


def _ours(entry: importlib.metadata.EntryPoint) -> bool:
    return entry.dist is not None and entry.dist.name == "detailbench"


def plugin_module_name(path: Path) -> str:
    """The module name of a plugin file: stable, without conflicts."""
    import zlib

    return f"detailbench_plugin_{zlib.crc32(str(path).encode()):08x}_{path.stem}"


def _import_file(path: Path, name: str) -> None:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(path.parent))  # so that a plugin file finds its neighbours
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        sys.path.remove(str(path.parent))


def _reason(error: BaseException) -> tuple[str, str]:
    """Why a plugin could not be loaded, and the traceback if it adds information.

    A breach of our contract, or of that of ``@dataclass``, is a message with the line of the class. The traceback of
    other errors begins in the plugin, since the frames of its import are of no help.
    """
    frames = traceback.extract_tb(error.__traceback__)
    machinery = (__file__, dataclasses.__file__)
    own = [f for f in frames if f.filename not in machinery and "importlib" not in f.filename]
    where = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    if isinstance(error, DetailbenchError) and not isinstance(error, ImportError):
        return f"{error}{where}", ""
    reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if frames and frames[-1].filename == dataclasses.__file__:
        hint = "every parameter needs a default; " if "non-default argument" in str(error) else ""
        return f"{hint}@dataclass says: {error}{where}", ""
    trace = traceback.TracebackException.from_exception(error)
    trace.stack = traceback.StackSummary.from_list(frames[frames.index(own[0]) :] if own else [])
    return reason, "".join(trace.format())


def _trace(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))


_REGISTRY = Registry()


def registry(*, discover: bool = True) -> Registry:
    """The registry of this process, in which every installed plugin is known."""
    if discover:
        _REGISTRY.discover()
    return _REGISTRY


def load_plugins(files: Sequence[str], *, warn: bool = True) -> tuple[str, ...]:
    """Load everything that is installed, and ``files``; their absolute paths. Broken ones are reported on stderr."""
    found = registry()
    for file in files:
        found.load_file(file)
    if warn:
        for broken in found.broken:
            print(f"warning: plugin {broken.origin} is broken: {broken.reason}", file=sys.stderr)
    return tuple(str(Path(os.path.expanduser(file)).resolve()) for file in files)


def register(
    kind: str,
    name: str | None = None,
    *,
    cite: str = "",
    requires: Iterable[str] = (),
    **options: Any,
) -> Callable[[T], T]:
    """Register a dataclass as a plugin.

    Parameters
    ----------
    kind : ``"task"``, ``"dataset"``, ``"sensor"``, ``"method"`` or ``"metric"``
    name : str, optional
        The plugin's name; the class name in snake case without it.
    cite : str
        Whom to cite, shown in listings.
    requires : import names
        Libraries that are imported before the clock starts; cells are ``skipped`` when one is missing.
    options
        Of a metric: ``version`` (int), ``better`` (``lower``, ``higher``, ``reference``, or a mapping from score to
        one of them), ``outputs`` (tuple of ``"mesh"``, ``"cloud"``), ``floor`` (bool: score a perfect output too),
        ``length`` (int, or a mapping from score, without its ``@...``, to one: 1 of a length, 2 of its square, 0 of
        scores without a unit, the default; ``"file"``: in the units of the reference's file).
        Of a dataset: ``own`` (bool: its files are the user's, and a run takes all of them if no number is given),
        ``scans`` (bool: its shapes come with scans, and need sensors that give these).
        Of a sensor: ``scans`` (bool: it gives a shape's own scan), ``gives`` (``"cloud"``, ``"views"``, or a
        name of your own that a task ``takes``).

    Raises
    ------
    PluginError
        If the class is not a dataclass with defaults, has no docstring, or if its name is taken.

    Example
    -------
    >>> @register("method", cite="Nobody, 1900")
    ... @dataclass(frozen=True)
    ... class UnchangedExample:
    ...     '''The input as it is.'''
    ...
    ...     def denoise(self, cloud, run):
    ...         return cloud
    >>> registry().find("method", "unchanged_example").solves("denoise")
    True
    """
    if kind not in KINDS:
        raise PluginError(f"@register({kind!r}): no such kind of plugin. {did_you_mean(str(kind), KINDS)}")

    def decorate(cls: T) -> T:
        plugin_name = name or snake_case(cls.__name__)
        _check_class(kind, plugin_name, cls)
        _check_options(kind, plugin_name, options)
        _REGISTRY.add(
            Plugin(
                kind=kind,
                name=plugin_name,
                cls=cls,
                file=Path(inspect.getsourcefile(cls) or sys.modules[cls.__module__].__file__ or "?").resolve(),
                origin=_REGISTRY.origin,
                cite=cite,
                requires=(requires,) if isinstance(requires, str) else tuple(requires),
                options=options,
            )
        )
        return cls

    return decorate


# What a plugin of each kind must be able to do; a method is named after its tasks instead.
FUNCTIONS = {
    "task": ("recipes", "solve", "validate"),
    "dataset": (),
    "sensor": ("sense",),
    "method": (),
    "metric": ("score",),
}


def _check_class(kind: str, name: str, cls: type) -> None:
    where = f'@register("{kind}") on {cls.__qualname__}'
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise PluginError(f"{where}: the name {name!r} should be snake_case: letters, digits and underscores")
    if not dataclasses.is_dataclass(cls) or "__dataclass_params__" not in vars(cls):
        raise PluginError(f"{where}: put @dataclass(frozen=True) between @register and the class")
    has_docs = sys.flags.optimize < 2  # PYTHONOPTIMIZE=2 removes them
    text = cls.__doc__ or ""
    if has_docs and (not text.strip() or text.startswith(f"{cls.__name__}(")):
        raise PluginError(f"{where}: give the class a docstring; its first line is shown in listings")
    for f in dataclasses.fields(cls):
        if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise PluginError(f"{where}: parameter {f.name!r} needs a default, so that the plugin runs as it is")
        if f.name.startswith("_"):
            raise PluginError(f"{where}: parameter {f.name!r} must not start with an underscore")
    for function in FUNCTIONS[kind]:
        if not callable(getattr(cls, function, None)):
            raise PluginError(f"{where}: a {kind} needs a function {function}(...)")


def _check_options(kind: str, name: str, options: Mapping[str, Any]) -> None:
    known = {
        "dataset": ("version", "own", "scans"),
        "metric": ("version", "better", "outputs", "floor", "length"),
        "sensor": ("version", "gives", "scans"),
    }
    known = known.get(kind, ("version",))
    for option in options:
        if option not in known:
            raise PluginError(f'@register("{kind}", ...) of {name}: unknown {option!r}. {did_you_mean(option, known)}')
    gives = options.get("gives", "cloud")
    if not isinstance(gives, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", gives) or gives == "none":
        raise PluginError(f"sensor {name}: gives={gives!r}; expected a name like 'cloud' or 'views'")
    length = options.get("length", 0)
    powers = list(length.values()) if isinstance(length, Mapping) else [length]
    if length != "file" and not all(isinstance(power, int) for power in powers):
        raise PluginError(f"metric {name}: length={length!r}; expected a whole number, a mapping to them, or 'file'")
    better = options.get("better", "lower")
    for direction in [better] if isinstance(better, str) else better.values():
        if direction not in DIRECTIONS:
            raise PluginError(f"metric {name}: better={direction!r}; {did_you_mean(str(direction), DIRECTIONS)}")
