"""Registering, finding, and what is said when a name is wrong."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from bench.errors import MissingLibrary, PluginError, UsageError, did_you_mean
from bench.fields import _comments_of_fields, field_help
from bench.registry import Registry, missing_library, register, registry, snake_case
from bench.schema import build, config_class, defaults, parameters, variant


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
        (lambda: register("sensor", gives=3)(dataclass(type("S", (), DOC | SENSE))), "gives=3; expected a word"),
        (lambda: register("method", gives="views")(dataclass(type("M", (), DOC))), "unknown 'gives'"),
        (lambda: register("method", name="No Name")(dataclass(type("M", (), DOC))), "should be snake_case"),
        (lambda: register("method")(dataclass(type("M", (), NO_DEFAULT))), "needs a default"),
        (lambda: register("method")(dataclass(type("Undocumented", (), {}))), "docstring"),
    ],
)
def test_what_breaks_the_contract_is_said(make, words):
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
    assert isinstance(error, MissingLibrary) and error.install == 'pip install "detailbench[gpl]"'
    shared = missing_library(ImportError("libGL.so.1: cannot open shared object file", name="open3d"))
    assert "apt-get install" in shared.install and "libgl1" in shared.install


# -- config ------------------------------------------------------------------------------------------------------------


@register("method", name="all_types")
@dataclass(frozen=True)
class AllTypes:
    """Every type that a parameter may have."""

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
        ({"flag": 3}, "method.flag=3: expected bool"),
        ({"real": float("nan")}, "expected a number"),
    ],
)
def test_wrong_values_are_refused(values, words):
    with pytest.raises(UsageError, match=words):
        build(all_types(), values)


def test_wrong_types_are_refused_by_the_config():
    from omegaconf.errors import ValidationError

    with pytest.raises(ValidationError):
        composed(whole="abc")


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


def test_a_type_that_a_config_cannot_hold_is_said(tmp_path):
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
    assert sorted(found._plugin_modules("some_plugins", "test")) == [
        "some_plugins.bad",
        "some_plugins.good",
        "some_plugins.inner.deep",
    ]
    assert list(found._plugin_modules("there_is_no_such_package", "test")) == []
    assert "there is no module" in found.broken[0].reason
