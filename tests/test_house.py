"""The floor plan: rooms are the folders, arrows the imports; nothing here names a room that the folders do not have."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import house
import pytest

import bench

ROOT = Path(__file__).resolve().parents[1]
PLUGIN_FOLDERS = ("methods", "datasets", "metrics")
KNOWN = house.modules(ROOT)


@cache
def plan() -> house.House:
    return house.house(ROOT)


@cache
def arrows() -> list[tuple[str, str]]:
    return sorted(set(house.imports_of_modules(KNOWN)))


def is_plugin(module: str) -> bool:
    return module.split(".")[1:2] in [[name] for name in PLUGIN_FOLDERS]


def write_package(root: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        for folder in file.relative_to(root).parents:
            if folder != Path("."):
                (root / folder / "__init__.py").touch()


# --- the script reads the imports right -------------------------------------------------------------------------------


def test_the_imports_are_read_right(tmp_path):
    file = tmp_path / "module.py"
    file.write_text(
        "import a.b\nfrom bench import Run\nif TYPE_CHECKING:\n    import hidden\n"
        "def f():\n    from .siren import Siren\n    from ..cages import cage\n    from . import mls\n"
    )
    assert set(house.imports(file, "bench.methods.implicit")) == {
        "a.b",
        "bench.Run",
        "bench.methods.implicit.siren.Siren",
        "bench.methods.cages.cage",
        "bench.methods.implicit.mls",
    }


def test_rooms_floors_arrows_and_circles_of_a_small_house(tmp_path):
    write_package(
        tmp_path,
        {
            "bench/ground.py": "",
            "bench/a/one.py": "from ..ground import x\n",
            "bench/b/two.py": "def f():\n    from ..a.one import y\n",
            "bench/b/three.py": "from .two import f\n",
            "methods/c/four.py": "from bench.b.two import f\n",
        },
    )
    plan = house.house(tmp_path)
    assert plan.floors == (("bench.ground",), ("bench.a",), ("bench.b",), ("bench.methods.c",))
    assert plan.arrow_count == 3 and plan.circles == () and house.circles_of_modules(tmp_path) == []
    (tmp_path / "bench/a/one.py").write_text("from ..b import three\n")
    plan = house.house(tmp_path)
    assert plan.circles == (("bench.a", "bench.b"),)
    assert house.circles_of_modules(tmp_path) == [("bench.a.one", "bench.b.three", "bench.b.two")]


# --- our house --------------------------------------------------------------------------------------------------------


def test_no_room_and_no_module_is_in_a_circle():
    why = {f"{a} -> {b}": plan().arrows[a][b] for c in plan().circles for a in c for b in c if b in plan().arrows[a]}
    assert why == {}
    assert house.circles_of_modules(ROOT) == []


def test_the_ground_is_below_all_that_computes():
    """Arrays know nothing of plugins, plugins nothing of the engine, results nothing of tables."""
    floor = {room: number for number, rooms in enumerate(plan().floors) for room in rooms}
    order = ("geometry", "contract", "plan", "results", "engine", "sweep", "commands")
    heights = [floor[f"bench.{room}"] for room in order]
    assert heights == sorted(set(heights)), dict(zip(order, heights, strict=True))


def test_bench_imports_no_plugin():
    assert [(a, b) for a, b in arrows() if not is_plugin(a) and is_plugin(b)] == []


@pytest.mark.parametrize("top", PLUGIN_FOLDERS)
def test_plugins_import_public_names_geometry_and_their_own_folder(top):
    public = {f"bench.{name}" for name in bench.__all__}
    own = f"bench.{top}."

    def fine(name: str) -> bool:
        if name.partition(".")[0] not in ("bench", *PLUGIN_FOLDERS):
            return True  # a library
        return name in public or name.startswith(("bench.geometry.", own))

    found = [
        (module, name)
        for module, file in KNOWN.items()
        if module.startswith(own)
        for name in house.imports(file, module if file.name == "__init__.py" else module.rpartition(".")[0])
        if not fine(name)
    ]
    assert found == []


def test_families_of_methods_share_only_learned_ground():
    """A family may not import another; what two of them need is in methods/learned."""

    def family(module: str) -> str:
        return module.split(".")[2] if module.startswith("bench.methods.") else ""

    crossing = [
        (a, b) for a, b in arrows() if family(a) and family(b) and family(a) != family(b) and family(b) != "learned"
    ]
    assert crossing == []
    assert [(a, b) for a, b in arrows() if family(a) == "learned" and family(b) not in ("learned", "")] == []


@pytest.mark.parametrize("top", PLUGIN_FOLDERS)
def test_only_the_uppermost_files_of_a_family_hold_plugins(top):
    """The rooms below are building blocks: nobody has to open them to find a plugin."""
    deep = {
        "methods": lambda parts: len(parts) > 2,
        "datasets": lambda parts: len(parts) > 1 and parts[0] != "sensors",
        "metrics": lambda parts: len(parts) > 1,
    }[top]
    found = [
        file.relative_to(ROOT).as_posix()
        for file in (ROOT / top).rglob("*.py")
        if deep(file.relative_to(ROOT / top).parts) and re.search(r"^@register\(", file.read_text(), re.MULTILINE)
    ]
    assert found == []


def test_the_name_of_a_plugin_is_its_file():
    from bench.plugins.registry import KINDS, registry

    # Tests of this process may have registered some of their own.
    folders = tuple(ROOT / name for name in ("bench", *PLUGIN_FOLDERS))
    everything = [plugin for kind in KINDS for plugin in registry().all(kind)]
    shipped = [plugin for plugin in everything if any(plugin.file.is_relative_to(folder) for folder in folders)]
    assert len(shipped) > 100
    assert [(plugin.kind, plugin.name, plugin.file.name) for plugin in shipped if plugin.name != plugin.file.stem] == []


def test_the_tests_mirror_the_packages():
    """A folder of tests is named after the room, or the plugin folder, whose modules it tests; two are of no room."""
    of_no_room = {"faults", "benchmarks"}
    rooms = {room.removeprefix("bench.").replace(".", "/") for room in plan().arrows}
    rooms |= {parent for room in rooms for parent in (room.rpartition("/")[0],) if parent}
    folders = {file.parent.relative_to(ROOT / "tests").as_posix() for file in (ROOT / "tests").rglob("test_*.py")}
    assert {folder for folder in folders if folder != "."} - rooms - of_no_room == set()
    lying = {file.name for file in (ROOT / "tests").glob("test_*.py")}
    ground = {"test_notices.py", "test_safe_path.py", "test_text.py"}
    whole = {"docs", "house", "lists", "mutants", "packaging", "quick", "release"}
    assert lying == {f"test_{name}.py" for name in whole} | ground
