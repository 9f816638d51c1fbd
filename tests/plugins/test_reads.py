"""What is in the files that a plugin reads is part of what its results depend on; what they are called is not."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from conftest import TOYS
from toy_cells import config, node

from bench import register
from bench.errors import UsageError
from bench.plan.cell import Cell
from bench.plugins.origins import installed
from bench.plugins.registry import registry
from bench.results.provenance import explain, fingerprint, ingredients, memory_keys

SHIPPED = Path(__file__).with_name("shipped.bin")
INSTALLED = [registry().find("method", name) for name in installed("method")]
SPHERED = [plugin for plugin in INSTALLED if hasattr(plugin.cls, "prepare")]
READERS = [plugin.name for plugin in SPHERED if tuple(getattr(plugin.cls(), "reads", tuple)())]


@register("method", name="reads_method")
@dataclass(frozen=True)
class Method:
    """Reads files."""

    weights: str = ""
    table: Path = Path()
    parts: tuple[str, ...] = ()
    mode: Literal["fast", "slow"] = "fast"
    save: str = ""
    log: Path | None = None
    reads_shipped: bool = False

    writes = ("save", "log")

    def reads(self):
        return [SHIPPED] if self.reads_shipped else []

    def denoise(self, cloud, run):
        return cloud


def cell(**values) -> Cell:
    return Cell.from_config(config(method=node("method", "reads_method", **values)))


def read(made: Cell) -> dict[str, str]:
    return {key: value for key, value in ingredients(made).items() if key.startswith("content of ")}


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.bin", "b.bin", "c.bin", "fast"):
        (tmp_path / name).write_text(name)
    return tmp_path


def test_the_content_of_a_named_file_counts(files):
    made = cell(weights="a.bin")
    before = ingredients(made)
    assert list(read(made)) == ["content of a.bin (method.weights)"]
    assert fingerprint(ingredients(made)) == fingerprint(before)
    (files / "a.bin").write_text("other")
    assert fingerprint(ingredients(made)) != fingerprint(before)
    assert explain(before, ingredients(made)) == ["content of a.bin (method.weights) has changed"]
    assert explain({}, read(made)) == ["content of a.bin (method.weights) was not recorded"]
    (files / "a.bin").write_text("a.bin")
    assert fingerprint(ingredients(made)) == fingerprint(before)  # with the content it had, whenever it was written


def test_the_hash_is_that_of_the_content_wherever_the_file_is(files):
    import hashlib

    (files / "folder").mkdir()
    (files / "folder" / "same.bin").write_text("a.bin")
    digest = hashlib.sha256(b"a.bin").hexdigest()
    for path in ("a.bin", "folder/same.bin", str(files / "a.bin")):
        assert list(read(cell(weights=path)).values()) == [digest]


def test_paths_lists_of_names_and_declared_files_count_and_what_is_written_does_not(files):
    named = read(cell(table="b.bin", parts=["a.bin", "c.bin", "not there"], save="a.bin", log="b.bin"))
    assert sorted(named) == [
        "content of a.bin (method.parts)",
        "content of b.bin (method.table)",
        "content of c.bin (method.parts)",
    ]


def test_a_cell_that_reads_no_file_has_the_ingredients_that_it_always_had(files):
    made = cell(mode="fast", save="a.bin")  # a file called fast is not what the choice of a mode names
    assert read(made) == {}
    assert "content" not in str(memory_keys(made))


def test_files_that_come_with_a_plugin_are_named_by_their_place_beside_it(monkeypatch, tmp_path):
    plugin = registry().find("method", "reads_method")
    SHIPPED.write_text("one")
    try:
        made = cell(reads_shipped=True)
        before = ingredients(made)
        assert list(read(made)) == ["content of shipped.bin (read by method reads_method)"]
        assert str(plugin.file.parent) not in str(read(made))
        SHIPPED.write_text("two!")
        assert explain(before, ingredients(made)) == [f"{list(read(made))[0]} has changed"]
    finally:
        SHIPPED.unlink()


def test_a_path_that_is_not_there_is_refused_and_one_that_is_written_is_not(files):
    with pytest.raises(UsageError, match=r"method\.table=nowhere\.bin: no such file or folder"):
        cell(table="nowhere.bin")
    cell(log="nowhere.bin", weights="nowhere.bin")  # a text may be something else


def test_weights_exchanged_under_one_name_are_run_again_and_why_names_the_file(shell):
    (shell.work / "mine.py").write_text(
        "from dataclasses import dataclass\nfrom pathlib import Path\nfrom bench import PointCloud, register\n"
        '@register("method")\n@dataclass(frozen=True)\nclass Mine:\n    """Mine."""\n'
        "    weights: str = 'w.txt'\n"
        "    def denoise(self, cloud, run):\n"
        "        return PointCloud(cloud.points * float(Path(self.weights).read_text()))\n"
    )
    words = ("method=mine", "method.weights=w.txt")
    plugins = (TOYS, shell.work / "mine.py")
    flags = [part for file in plugins for part in ("--plugin", file)]
    spreads = []
    for weight in ("1", "2", "1"):
        (shell.work / "w.txt").write_text(weight)
        done = shell.run(*words, sweep=False, plugins=plugins)
        assert done.returncode == 0, done.stderr
        spreads.append("2 run" in done.stderr)
        if weight == "2":
            (shell.work / "w.txt").write_text("3")
            found = shell.call("why", shell.rows()["cell"][0], f"results={shell.results}", *flags)
            assert "content of w.txt (method.weights) has changed" in found.stdout, found.stdout + found.stderr
    assert spreads == [True, True, False]  # the first weights' results are there still


# -- the shipped spheres ----------------------------------------------------------------------------------------------


def test_every_shipped_sphere_is_found_by_its_form():
    from bench.methods.learned.networks.shipped import FOLDER, sphere_file, spheres_read
    from bench.methods.learned.networks.sphere import FORMS, RADIUS

    assert {sphere_file(*form, RADIUS) for form in FORMS} == set(FOLDER.glob("*.safetensors"))
    assert spheres_read(*FORMS[0], 0.0) == () == spheres_read(17.0, 3, 256, RADIUS)


@pytest.mark.parametrize("name", READERS)
def test_methods_say_which_sphere_they_read(name, monkeypatch):
    """The file that they say is the one that is opened when they are prepared, and there is none without a sphere."""
    import safetensors.torch

    from bench.methods.learned.networks import sphere

    opened = []
    monkeypatch.setattr(sphere, "_of_this_process", {})
    load = safetensors.torch.load_file
    monkeypatch.setattr(safetensors.torch, "load_file", lambda path: opened.append(Path(path)) or load(path))
    method = registry().find("method", name).cls()
    method.prepare()
    assert opened == list(method.reads()) and len(opened) == 1


def test_every_method_that_begins_as_a_shipped_sphere_declares_it():
    fitted = [plugin for plugin in registry().all("method") if getattr(plugin.cls, "sine_sphere", False)]
    assert fitted and all(callable(getattr(plugin.cls, "reads", None)) for plugin in fitted)
