"""The package: what is installed, what stays light, and a wheel that works on its own."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import bench
from bench.results.provenance import machine

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PLUGIN_FOLDERS = ("methods", "datasets", "metrics")
FOLDERS = {"bench": "bench", "conf": "bench.conf", **{name: f"bench.{name}" for name in PLUGIN_FOLDERS}}
HEAVY = ("torch", "open3d", "pymeshlab", "CGAL", "igl", "trimesh", "pandas", "scipy", "pyarrow", "pykdtree")
TEXT = {".py", ".md", ".toml", ".txt", ".yaml", ".sh", ".cfg"}
NOT_OURS = {"build", "dist", "node_modules", "outputs", "multirun", "__pycache__"}


# --- the folders and pyproject.toml -----------------------------------------------------------------------------------


def test_the_plugin_folders_are_links_inside_the_package():
    for name in (*PLUGIN_FOLDERS, "conf"):
        link = ROOT / "bench" / name
        assert link.is_symlink() and link.resolve() == ROOT / name, f"bench/{name}: expected a link to ../{name}"


def test_every_folder_with_modules_or_yaml_is_a_package():
    for top in FOLDERS:
        for file in (ROOT / top).rglob("*.*"):
            if file.suffix in (".py", ".yaml") and "__pycache__" not in file.parts:
                assert (file.parent / "__init__.py").is_file(), f"{file.parent} lacks its __init__.py"


def test_the_version_is_in_one_place():
    assert "version" not in PROJECT["project"] and PROJECT["project"]["dynamic"] == ["version"]
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "bench.__version__"}
    assert str(Version(bench.__version__)) == bench.__version__
    assert importlib.metadata.version("detailbench") == bench.__version__, "the installed metadata are old: make setup"
    said = re.compile(rf"""version\w*["']?\s*[:=]+\s*["']?{re.escape(bench.__version__)}\b""")
    found = [file.relative_to(ROOT) for file in our_text_files() if said.search(file.read_text())]
    assert set(found) <= {Path("bench/__init__.py"), Path("CITATION.cff")}  # the latter has a test of its own


def test_records_of_results_have_that_version():
    assert machine()["detailbench"] == bench.__version__


def declared(*extras: str) -> list[Requirement]:
    project = PROJECT["project"]
    lines = [line for extra in extras for line in project["optional-dependencies"][extra]]
    return [Requirement(line) for line in project["dependencies"] + lines]


def constraints() -> dict[str, str]:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    pins = dict(re.fullmatch(r"([A-Za-z0-9._-]+)==([^\s;]+)(?:\s*;.*)?", line).groups() for line in lines)
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pins.items()}


def test_constraints_pin_all_that_is_declared():
    pins = constraints()
    for requirement in declared(*set(PROJECT["project"]["optional-dependencies"]) - {"ray"}):
        if requirement.marker is None or requirement.marker.evaluate({"platform_system": "Linux"}):
            assert requirement.name in pins
            assert Version(pins[requirement.name]) in requirement.specifier


def test_gpl_libraries_are_optional():
    assert {requirement.name for requirement in declared()}.isdisjoint({"pymeshlab", "cgal"})


# --- what stays light, and what stays out -----------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["--help"], ["list"], ["run", "--help"], ["leaderboard", "--help"]], ids=" ".join)
def test_looking_around_imports_nothing_heavy(words, tmp_path):
    code = (
        "import sys; from bench.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert not end.code\n"
        f"sys.exit(' '.join(sorted(set(sys.modules) & set({HEAVY!r}))))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert found.stderr.strip() == ""


def our_text_files() -> Iterator[Path]:
    for folder, folders, files in os.walk(ROOT):
        folders[:] = [name for name in folders if name == ".ci" or not name.startswith(".") and name not in NOT_OURS]
        if Path(folder) == ROOT:
            folders[:] = [name for name in folders if name != "results"]  # where the README's commands write
        folders[:] = [name for name in folders if not name.endswith(".egg-info")]
        for name in files:
            if Path(name).suffix in TEXT or name in {"Makefile", "LICENSE", "run"}:
                yield Path(folder, name)


def test_no_file_names_a_place_outside_the_repository():
    outside = re.compile(r"\.\./shared|(?<![\w.)}/-])/(?:work|root|home|Users)\b")
    found = [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in our_text_files()
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if outside.search(line) and file != Path(__file__)
    ]
    assert found == []


def test_a_skipped_test_fails_the_suite(tmp_path):
    (tmp_path / "test_some.py").write_text("import pytest\ndef test_a(): pass\ndef test_b(): pytest.skip('why')\n")

    def pytest_says(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "pytest", "-p", "no_skips", "-p", "no:cacheprovider", *words],
            cwd=tmp_path,
            env={"PYTHONPATH": str(ROOT / "scripts"), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
            capture_output=True,
            text=True,
        )

    for words in ([], ["-p", "xdist", "-n", "1"]):
        skipped = pytest_says(*words)
        assert skipped.returncode == 1, skipped.stdout
        assert "1 passed, 1 skipped" in skipped.stdout
    assert pytest_says("-k", "test_a").returncode == 0


# --- the wheel --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    """A copy of the tree: building leaves folders behind."""
    source = tmp_path_factory.mktemp("source")
    for name in (*FOLDERS, "pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source)
    return source


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory) -> Path:
    """A wheel built from a copy of the tree."""
    out = tmp_path_factory.mktemp("dist")
    assert PROJECT["build-system"]["build-backend"] == "setuptools.build_meta"
    command = [sys.executable, "-c", f"from setuptools.build_meta import build_wheel; build_wheel({str(out)!r})"]
    built = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    (file,) = out.glob("*.whl")
    return file


def environment(place: Path, *what: str | Path) -> Path:
    """The ``bin`` folder of a new environment that has the package, and the libraries of this one after its own."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", place], check=True)
    python = place / "bin" / "python"
    (site,) = place.glob("lib/python*/site-packages")
    # A path line is appended to sys.path, and .pth files found there (our editable install is one) are not read. It
    # comes first, because building needs setuptools; hence --ignore-installed, which leaves our own installation alone.
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    # Not compiled here, because most of the modules are not imported.
    install = ["install", "-q", "--ignore-installed", "--no-deps", "--no-index", "--no-build-isolation", "--no-compile"]
    subprocess.run([sys.executable, "-m", "pip", "--python", python, *install, *what], check=True)
    return place / "bin"


@pytest.fixture(scope="module")
def elsewhere(wheel, tmp_path_factory) -> Path:
    """The ``bin`` folder of a new environment that has the wheel."""
    return environment(tmp_path_factory.mktemp("elsewhere") / "venv", wheel)


@pytest.fixture(scope="module")
def editable(source, tmp_path_factory) -> Path:
    """The ``bin`` folder of a new environment in which a copy of the tree is installed in editable mode."""
    return environment(tmp_path_factory.mktemp("editable") / "venv", "-e", source)


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    info = f"detailbench-{bench.__version__}.dist-info"
    assert {name.partition("/")[0] for name in names} == {"bench", info}
    assert zipfile.ZipFile(wheel).read(f"{info}/top_level.txt").split() == [b"bench"]
    assert f"{info}/licenses/LICENSE" in names
    expected = {
        "/".join((*FOLDERS[top].split("."), *file.relative_to(ROOT / top).parts))
        for top in FOLDERS
        for pattern in (
            "*.py",
            "*.yaml",
            "catalog.json",
            "real.json",
            "earlier_sources.json",
            "priors.json",
            "built/*",
            "py.typed",
            "spheres/*.safetensors",
            "weights/*.safetensors",
        )
        for file in (ROOT / top).rglob(pattern)
    }
    assert {name for name in names if name.startswith("bench/")} == expected


def test_the_wheel_lists_its_plugins_from_anywhere(elsewhere, tmp_path):
    where = [elsewhere / "python", "-c", "import bench; print(bench.__file__)"]
    found = Path(subprocess.run(where, cwd=tmp_path, capture_output=True, text=True, check=True).stdout.strip())
    assert found.is_relative_to(elsewhere.parent)

    listed = subprocess.run([elsewhere / "detailbench", "list"], cwd=tmp_path, capture_output=True, text=True)
    assert listed.returncode == 0, listed.stderr
    words = set(listed.stdout.split())
    assert {"denoise", "bumps", "samples", "identity", "poisson", "hausdorff"} <= words
    assert "broken" not in words


def test_the_wheel_runs_a_cell_from_anywhere(elsewhere, tmp_path):
    words = ["run", "task=denoise", "dataset=bumps", "method=identity", "metric=[hausdorff]", "cases=1", "results=out"]
    ran = subprocess.run([elsewhere / "detailbench", *words], cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "1/1" in ran.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert list((tmp_path / "out").rglob("*.parquet"))


# --- what an author's type checker sees -------------------------------------------------------------------------------


LIBRARIES = ("torch", "pandas", "pyarrow", "scipy", "trimesh", "hydra", "omegaconf", "matplotlib", "numba", "rich")


@pytest.fixture(scope="module")
def authors(elsewhere, tmp_path_factory) -> Path:
    """A folder with a file of an author, right.py, and what mypy keeps of Python's own types."""
    folder = tmp_path_factory.mktemp("authors")
    made = subprocess.run([elsewhere / "detailbench", "new", "method", "right"], cwd=folder, env=outside())
    assert made.returncode == 0
    return folder


def outside() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.mark.slow
@pytest.mark.parametrize("installed", ["elsewhere", "editable"])
def test_a_type_checker_knows_the_package_in_an_authors_file(installed, authors, request):
    programs = request.getfixturevalue(installed)
    right = authors / "right.py"
    wrong = authors / "wrong.py"
    returned = "return PointCloud(points, cloud.normals)"
    assert returned in right.read_text()
    wrong.write_text(right.read_text().replace(returned, "return points"))
    asked = authors / "asked.py"
    asked.write_text("import right\n\nreveal_type(right.Right(neighbours=3).denoise)\nright.Right(neighbors=3)\n")

    # Libraries, their types and their lack of types are not what this is about, and those of some take a minute; a
    # package that is not found is an error all the same.
    settings = authors / "mypy.ini"
    settings.write_text(f"[mypy]\n[mypy-{','.join(f'{name}.*' for name in LIBRARIES)}]\nfollow_imports = skip\n")
    command = [sys.executable, "-m", "mypy", "--python-executable", programs / "python", "--config-file", settings]
    files = ["--disable-error-code", "import-untyped", "right.py", "wrong.py", "asked.py"]
    found = subprocess.run([*command, *files], cwd=authors, env=outside(), capture_output=True, text=True).stdout
    errors = [line for line in found.splitlines() if ": error: " in line]
    assert len(errors) == 2, found
    assert errors[0].startswith("wrong.py:") and 'expected "PointCloud"' in errors[0]
    # Decorated, it is the author's class still: its parameters and the types of its functions are known.
    assert errors[1].startswith("asked.py:") and "neighbors" in errors[1]
    assert "run: bench.contract.run.Run) -> bench.geometry.cloud.PointCloud" in found
