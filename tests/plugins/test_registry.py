"""Registering, finding, and what is said when a name is wrong."""

import json
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, Literal

import pytest

from bench.errors import MissingLibrary, PluginError, UsageError, did_you_mean
from bench.plan.cell import Cell
from bench.plugins.conversion import check_type
from bench.plugins.fields import _comments_of_fields, field_help
from bench.plugins.registry import Registry, missing_library, register, registry, snake_case
from bench.plugins.schema import _config_node, build, config_class, defaults, parameters, variant
from bench.sweep.composition import compose
from bench.sweep.overrides import check
from bench.sweep.request import Request


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text("from dataclasses import dataclass\nfrom bench import register\n" + text)
    return path


METHOD = """
@register("method"{options})
@dataclass(frozen=True)
class {name}:
    \"\"\"A method.\"\"\"
    depth: int = 8  # octree depth
    def denoise(self, cloud, run): return cloud
"""


@pytest.mark.parametrize(
    ("name", "snake"),
    [("Poisson", "poisson"), ("BallPivoting", "ball_pivoting"), ("ChamferL2Sum", "chamfer_l2_sum"), ("IDF", "idf")],
)
def test_names_are_snake_case(name, snake):
    assert snake_case(name) == snake


def test_a_file_registers_its_plugins(tmp_path):
    path = write(tmp_path, "mine.py", METHOD.format(name="LoadedFromFile", options=', cite="Me 2026"'))
    registry().load_file(path)
    plugin = registry().find("method", "loaded_from_file")
    assert (plugin.file, plugin.cite, plugin.summary) == (path, "Me 2026", "A method.")
    assert plugin.solves("denoise") and not plugin.solves("reconstruct")
    assert field_help(plugin.cls) == {"depth": "octree depth"}


def test_loading_a_file_twice_is_no_collision(tmp_path):
    path = write(tmp_path, "twice.py", METHOD.format(name="LoadedTwice", options=""))
    registry().load_file(path)
    registry().load_file(path)
    assert registry().find("method", "loaded_twice").file == path


def test_a_collision_names_both_sides(tmp_path):
    one = write(tmp_path, "one.py", METHOD.format(name="Contested", options=""))
    two = write(tmp_path, "two.py", METHOD.format(name="Contested", options=""))
    registry().load_file(one)
    with pytest.raises(UsageError, match="two methods are called 'contested'") as error:
        registry().load_file(two)
    assert str(one) in str(error.value) and str(two) in str(error.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise RuntimeError('boom')", "RuntimeError: boom"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("def broken(:", "SyntaxError"),
        ("import there_is_no_such_module", "there_is_no_such_module"),
    ],
)
def test_a_broken_file_is_listed_and_stops_nothing(tmp_path, text, reason):
    path = write(tmp_path, "broken.py", text)
    registry().load_file(path)
    mine = [b for b in registry().broken if b.file == path]
    assert len(mine) == 1 and reason in mine[0].reason
    assert registry().find("task", "denoise")


def test_a_wrong_name_gets_the_nearest_right_one():
    with pytest.raises(UsageError, match="no task is called 'denoize'. Did you mean 'denoise'"):
        registry().find("task", "denoize")
    assert did_you_mean("zzz", ["a", "b"]) == "Known: a, b."


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: register("methods"), "no such kind of plugin. Did you mean 'method'"),
        (lambda: register("method")(type("Plain", (), {"__doc__": "x"})), "put @dataclass"),
        (lambda: register("metric", beter="lower")(dataclass(type("M", (), DOC | SCORE))), "unknown 'beter'"),
        (lambda: register("metric", better="up")(dataclass(type("M", (), DOC | SCORE))), "better='up'"),
        (lambda: register("metric")(dataclass(type("M", (), DOC))), "needs a function score"),
        (
            lambda: register("sensor", gives="none")(dataclass(type("S", (), DOC | SENSE))),
            "gives='none'; expected",
        ),
        (lambda: register("sensor", gives=3)(dataclass(type("S", (), DOC | SENSE))), "gives=3; expected a name"),
        (lambda: register("method", gives="views")(dataclass(type("M", (), DOC))), "unknown 'gives'"),
        (lambda: register("method", name="No Name")(dataclass(type("M", (), DOC))), "should be snake_case"),
        (lambda: register("method")(dataclass(type("M", (), NO_DEFAULT))), "needs a default"),
        (lambda: register("method")(dataclass(type("Undocumented", (), {}))), "docstring"),
    ],
)
def test_what_breaks_the_contract_is_reported(make, words):
    with pytest.raises(PluginError, match=words):
        make()


DOC = {"__doc__": "A plugin.", "__module__": __name__}
SCORE = {"score": lambda self, output, case: {}}
SENSE = {"sense": lambda self, shape, rng: None}
NO_DEFAULT = DOC | {"__annotations__": {"depth": int}}


def test_comments_above_and_behind_a_field_are_its_help():
    source = (
        "class A:\n    # first line\n    # second line\n    a: int = 1\n    b: float = 2.0  # behind\n    c: int = 3\n"
    )
    assert _comments_of_fields(source) == {"a": "first line second line", "b": "behind", "c": ""}


def test_a_missing_library_comes_with_the_line_that_installs_it():
    error = missing_library(ModuleNotFoundError("No module named 'pymeshlab'", name="pymeshlab"))
    assert isinstance(error, MissingLibrary) and error.install == "pip install pymeshlab"
    shared = missing_library(ImportError("libGL.so.1: cannot open shared object file", name="open3d"))
    assert "apt-get install" in shared.install and "libgl1" in shared.install


# -- config ------------------------------------------------------------------------------------------------------------


@register("method", name="all_types")
@dataclass(frozen=True)
class AllTypes:
    """Every type that a parameter may have."""

    writes: ClassVar[tuple[str, ...]] = ("path",)  # it need not be there

    whole: int = 1
    real: float = 0.5
    flag: bool = False
    text: str = "a"
    maybe: float | None = None
    choice: Literal["near", "far"] = "near"
    several: tuple[float, ...] = (1.0, 2.0)
    names: list[str] = field(default_factory=list)
    table: dict[str, int] = field(default_factory=dict)
    path: Path = Path("x")

    def __post_init__(self):
        if self.whole < 0:
            raise ValueError(f"whole: expected at least 0, got {self.whole}")

    def denoise(self, cloud, run):
        return cloud


def all_types():
    return registry().find("method", "all_types")


def composed(**values):
    from omegaconf import OmegaConf

    node = OmegaConf.merge(OmegaConf.structured(config_class(all_types())), OmegaConf.create(values))
    return OmegaConf.to_container(node, resolve=True)


def test_a_dataclass_survives_the_way_through_a_config():
    values = {
        "maybe": 2,
        "several": [3, 4],
        "choice": "far",
        "names": ["x"],
        "table": {"a": 1},
        "path": "/tmp",
        "real": 1,
    }
    made = build(all_types(), composed(**values))
    assert made == AllTypes(
        maybe=2.0, several=(3.0, 4.0), choice="far", names=["x"], table={"a": 1}, path=Path("/tmp"), real=1.0
    )
    assert build(all_types(), parameters(all_types(), made)) == made
    assert defaults(all_types()) == parameters(all_types(), AllTypes())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"whole": -1}, "whole: expected at least 0"),
        ({"choice": "fra"}, "Did you mean 'far'"),
        ({"hole": 3}, "no parameter 'hole'. Did you mean 'whole'"),
        ({"flag": 3}, "method.flag=3: expected true or false"),
        ({"real": float("nan")}, "expected a number"),
    ],
)
def test_wrong_values_are_refused(values, words):
    with pytest.raises(UsageError, match=words):
        build(all_types(), values)


def test_a_value_of_a_wrong_type_passes_the_config_and_is_refused_with_its_key():
    with pytest.raises(UsageError, match=r"method\.whole=abc: expected a whole number \(int\), got the text"):
        build(all_types(), composed(whole="abc"))


class Colour(Enum):
    RED = 1
    BLUE = 2


@register("method", name="deep_types")
@dataclass(frozen=True)
class DeepTypes:
    """Types within types."""

    writes: ClassVar[tuple[str, ...]] = ("paths",)  # they need not be there

    kinds: list[Literal["near", "far"]] = field(default_factory=lambda: ["near"])
    paths: tuple[Path, ...] = (Path("a"),)
    pair: tuple[int, str] = (1, "x")
    table: dict[str, float] = field(default_factory=lambda: {"a": 1.0})
    mode: Literal["open", "shut"] | None = None
    counts: list[int] | None = None
    colours: list[Colour] = field(default_factory=lambda: [Colour.RED])
    nested: dict[str, list[tuple[int, Literal["a", "b"]]]] = field(default_factory=dict)
    parts: list[str | dict[str, Any]] = field(default_factory=list)
    either: Literal["auto"] | float = "auto"
    keyed: dict[Literal["left", "right"], bool] = field(default_factory=dict)

    def denoise(self, cloud, run):
        return cloud


# What is written in a config or a record, and what the plugin gets.
DEEP = {
    "kinds": (["far", "near"], ["far", "near"]),
    "paths": (["/tmp", "b"], (Path("/tmp"), Path("b"))),
    "pair": ([2, "y"], (2, "y")),
    "table": ({"b": 2, "c": 0.5}, {"b": 2.0, "c": 0.5}),
    "mode": ("shut", "shut"),
    "counts": ([3, 4], [3, 4]),
    "colours": (["BLUE", "RED"], [Colour.BLUE, Colour.RED]),
    "nested": ({"k": [[1, "a"], [2, "b"]]}, {"k": [(1, "a"), (2, "b")]}),
    "parts": (["fbm", {"cad": {"kind": "gear"}}], ["fbm", {"cad": {"kind": "gear"}}]),
    "either": (3, 3.0),
    "keyed": ({"left": True}, {"left": True}),
}


def deep_types():
    return registry().find("method", "deep_types")


def typed(value):
    """A value as Hydra's command line takes it: like JSON, but keys have no quotes."""
    if isinstance(value, dict):
        return f"{{{','.join(f'{k}:{typed(v)}' for k, v in value.items())}}}"
    return f"[{','.join(map(typed, value))}]" if isinstance(value, list) else json.dumps(value)


def deep_cell(*overrides):
    from omegaconf import OmegaConf

    words = ["task=denoise", "method=deep_types", *overrides]
    check(Request.of(words))
    return Cell.from_config(OmegaConf.to_container(compose(words), resolve=True))


@pytest.mark.parametrize("name", DEEP)
def test_a_type_within_a_type_is_converted_and_survives_command_line_yaml_and_record(name):
    from omegaconf import OmegaConf

    written, expected = DEEP[name]
    made = build(deep_types(), {name: written})
    assert repr(getattr(made, name)) == repr(expected)  # types count: 3 is no 3.0, a list no tuple
    stored = parameters(deep_types(), made)
    assert build(deep_types(), json.loads(json.dumps(stored))) == made
    # As YAML, over the defaults that the config has; the keys of a mapping are added to them.
    yaml = OmegaConf.to_yaml(OmegaConf.create({name: written}))
    merged = OmegaConf.merge(_config_node(deep_types()).node, OmegaConf.create(yaml))
    default = getattr(DeepTypes(), name)
    united = default | expected if isinstance(expected, dict) else expected
    assert getattr(build(deep_types(), OmegaConf.to_container(merged)), name) == united
    cell = deep_cell(f"method.{name}={typed(written)}")
    assert getattr(cell.method.build(), name) == united
    assert Cell.from_json(json.loads(json.dumps(cell.to_json()))) == cell


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kinds": ["near", "fra"]}, r"^method\.kinds\[1\]=fra: expected one of near, far\. Did you mean 'far'\?$"),
        ({"kinds": "near"}, r"^method\.kinds=near: expected a list .*one of near, far.*got the text"),
        ({"paths": ["a", 3]}, r"method\.paths\[1\]=3: expected a path"),
        ({"pair": [1]}, r"method\.pair=\[1\]: expected a list of 2 \(a whole number .*, a text .*\), got 1"),
        ({"pair": ["1", "x"]}, r"method\.pair\[0\]=1: expected a whole number \(int\), got the text '1'"),
        ({"pair": [True, "x"]}, r"method\.pair\[0\]=true: expected a whole number \(int\), got true or false"),
        ({"pair": [1, 2]}, r"method\.pair\[1\]=2: expected a text \(str\), got a whole number"),
        ({"table": {"a": "x"}}, r"method\.table\.a=x: expected a number"),
        ({"table": {"a": True}}, r"method\.table\.a=true: expected a number"),
        ({"table": {"a": float("nan")}}, r"method\.table\.a=nan: expected a number"),
        ({"table": [1.0]}, r"method\.table=\[1.0\]: expected a mapping"),
        ({"table": {1: 1.0}}, r"method\.table, key=1: expected a text"),
        ({"mode": "shot"}, r"method\.mode=shot: expected one of open, shut\. Did you mean 'shut'"),
        ({"counts": [1, 2.0]}, r"method\.counts\[1\]=2.0: expected a whole number"),
        ({"colours": ["BLEU"]}, r"method\.colours\[0\]=BLEU: expected one of RED, BLUE\. Did you mean 'BLUE'"),
        ({"nested": {"k": [[1, "c"]]}}, r"method\.nested\.k\[0\]\[1\]=c: expected one of a, b"),
        ({"parts": ["fbm", 3]}, r"method\.parts\[1\]=3: expected a text .* or a mapping"),
        ({"either": "atuo"}, r"method\.either=atuo: expected auto or a number .*\. Did you mean 'auto'"),
        ({"keyed": {"letf": True}}, r"method\.keyed, key=letf: expected one of left, right\. Did you mean 'left'"),
        ({"pair": None}, r"method\.pair=null: expected a list of 2 .*got null"),
    ],
)
def test_what_does_not_fit_deep_within_is_refused_with_place_and_nearest_value(values, words):
    with pytest.raises(UsageError, match=words):
        build(deep_types(), values)


def test_a_sweep_is_refused_before_it_starts_for_one_value_of_a_wrong_type():
    with pytest.raises(UsageError, match=r"method\.kinds\[0\]=naer: .*Did you mean 'near'"):
        check(Request.of(["method=deep_types", "method.kinds=[far],[naer]"], multirun=True))
    with pytest.raises(UsageError, match=r"metric\.fscore\.t=x: expected a number"):
        check(Request.of(["metric=[fscore]", "metric.fscore.t=x"]))
    check(Request.of(["method=deep_types", "method.pair=[1,a],[2,b]"], multirun=True))
    check(Request.of(["method=all_types", "method.whole=${seed}"], multirun=True))


def test_a_number_on_the_command_line_is_a_text_where_one_is_expected():
    """A command line has no quotes, and a folder may be called 2024."""
    from omegaconf import OmegaConf

    words = ["task=denoise", "method=all_types", "method.text=7", "method.path=2024"]
    check(Request.of(words))
    made = Cell.from_config(OmegaConf.to_container(compose(words))).method.build()
    assert (made.text, made.path) == ("7", Path("2024"))
    with pytest.raises(UsageError, match=r"method\.text=7: expected a text"):
        build(all_types(), {"text": 7})  # of a record, say


@pytest.mark.parametrize("annotation", [complex, list[complex], dict[int, str], tuple[int, set[str]], bytes | None])
def test_types_that_cannot_be_held_are_refused_however_deep(annotation):
    with pytest.raises(PluginError, match="method x: .*cannot hold the type|keys of .* are not strings"):
        check_type(annotation, "method x")


def test_the_variant_names_what_is_not_default():
    assert variant(all_types(), defaults(all_types())) == ""
    assert variant(all_types(), defaults(all_types()) | {"whole": 2, "real": 0.25}) == "whole=2,real=0.25"


def test_a_config_class_is_pickled_by_value():
    # Launchers carry configs into processes that have not loaded the plugin file.
    import pickletools

    import cloudpickle

    dumped = cloudpickle.dumps(config_class(all_types()))
    assert b"test_registry" not in dumped
    assert any(op.name in ("STACK_GLOBAL", "GLOBAL") for op, _, _ in pickletools.genops(dumped))


def test_a_type_that_a_config_cannot_hold_is_reported(tmp_path):
    text = METHOD.format(name="OddType", options="").replace("depth: int = 8", "depth: complex = 8")
    registry().load_file(write(tmp_path, "odd.py", text))
    with pytest.raises(PluginError, match="method odd_type: parameter 'depth': a config cannot hold"):
        config_class(registry().find("method", "odd_type"))


def test_discovery_finds_packages_and_skips_what_does_not_register(tmp_path, monkeypatch):
    package = tmp_path / "some_plugins"
    (package / "inner").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "inner" / "__init__.py").write_text("")
    write(package, "good.py", METHOD.format(name="FoundInPackage", options=""))
    write(package / "inner", "deep.py", METHOD.format(name="FoundDeep", options=""))
    write(package, "bad.py", "raise RuntimeError('bad'); register()")
    (package / "building_block.py").write_text("raise AssertionError('must not be imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = Registry()
    assert sorted(name for name, _ in found._plugin_modules("some_plugins", "test")) == [
        "some_plugins.bad",
        "some_plugins.good",
        "some_plugins.inner.deep",
    ]
    assert list(found._plugin_modules("there_is_no_such_package", "test")) == []
    assert "there is no module" in found.broken[0].reason
