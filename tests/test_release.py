"""What a release needs: notes by fragment, how to cite, hooks before a commit, an interpreter for each version."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib

import pytest
import yaml
from file_checks import LARGEST, problem
from links import ROOT

import bench

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
TOWNCRIER = PROJECT["tool"]["towncrier"]
KINDS = [kind["directory"] for kind in TOWNCRIER["type"]]


# --- release notes ----------------------------------------------------------------------------------------------------


def fragment_problem(path):
    """What is wrong with a fragment, or nothing."""
    if not re.fullmatch(rf"[a-z0-9][a-z0-9-]*\.({'|'.join(KINDS)})\.md", path.name):
        return f"{path.name}: expected a name like deform-task.added.md; the kinds are {', '.join(KINDS)}"
    text = path.read_text().strip()
    if not text or text.startswith(("* ", "- ", "#")):
        return f"{path.name}: expected sentences, without a bullet and without a heading"
    return ""


def test_fragments_have_names_that_the_tool_reads():
    files = [path for path in (ROOT / TOWNCRIER["directory"]).iterdir() if path != ROOT / TOWNCRIER["template"]]
    assert [said for said in map(fragment_problem, files) if said] == []


@pytest.mark.parametrize(
    ("name", "text", "fine"),
    [
        ("site.added.md", "A site.", True),
        ("site-2.fixed.md", "**A site** opens.", True),
        ("site.md", "A site.", False),
        ("site.add.md", "A site.", False),
        ("Site.added.md", "A site.", False),
        ("site.added.rst", "A site.", False),
        ("site.added.md", "* A site.", False),
        ("site.added.md", "\n", False),
    ],
)
def test_a_wrong_fragment_is_found(tmp_path, name, text, fine):
    (tmp_path / name).write_text(text)
    assert bool(fragment_problem(tmp_path / name)) != fine


def test_the_changelog_has_the_line_below_which_releases_go():
    text = (ROOT / TOWNCRIER["filename"]).read_text()
    assert text.startswith("# Changelog\n") and text.count(TOWNCRIER["start_string"]) == 1
    assert TOWNCRIER["package"] == "bench"  # whose __version__ is the version of the next release


# --- how to cite ------------------------------------------------------------------------------------------------------


def citation():
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_the_citation_has_what_the_format_wants():
    cited = citation()
    assert cited["cff-version"] == "1.2.0" and cited["type"] == "software"
    assert {"message", "title", "authors", "abstract", "version", "license"} <= set(cited)
    assert cited["authors"] == [{"name": "The detailbench developers"}]
    for reference in cited["references"]:
        assert {"type", "title", "authors", "year"} <= set(reference)
        assert all({"family-names", "given-names"} == set(author) for author in reference["authors"])


def test_the_citation_has_the_version_and_the_licence_of_the_package():
    assert (citation()["version"], citation()["license"]) == (bench.__version__, PROJECT["project"]["license"])
    assert citation()["title"] == PROJECT["project"]["name"]


def test_the_citation_has_the_papers_that_conventions_name():
    titles = {reference["title"].lower() for reference in citation()["references"]}
    for name in ("mpu", "dss", "idf", "iso_points", "cages"):
        paper = yaml.safe_load((ROOT / "conf" / "convention" / f"{name}.yaml").read_text())["convention"]["paper"]
        assert any(title in paper.lower() for title in titles), paper


# --- hooks ------------------------------------------------------------------------------------------------------------


def test_hooks_download_nothing_and_name_files_that_are_there():
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    hooks = [hook for repository in config["repos"] for hook in repository["hooks"]]
    assert {repository["repo"] for repository in config["repos"]} == {"local"}
    assert {hook["id"] for hook in hooks} == {"ruff-check", "ruff-format", "files", "links"}
    for hook in hooks:
        program, *words = hook["entry"].split()
        assert hook["language"] == "system" and program == ".venv/bin/python"
        assert words[:2] in (["-m", "ruff"], words[:1]) and (words[0] == "-m" or (ROOT / words[0]).is_file())


def test_ruff_is_the_pinned_one():
    (pinned,) = re.findall(r"^ruff==(.+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    said = subprocess.run([sys.executable, "-m", "ruff", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["ruff", pinned]


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.py", b"x = 1\n", ""),
        ("a.py", b"", ""),
        ("a.py", b"x = 1", "has no end"),
        ("a.py", b"x = 1\n\n", "empty lines"),
        ("a.png", b"\0\1", ""),
        ("a.png", b"\0" * (LARGEST + 1), "at most"),
        ("weights/a.safetensors", b"\0" * (LARGEST + 1), ""),
        ("results/a.safetensors", b"\0" * (LARGEST + 1), "at most"),
    ],
)
def test_ends_and_sizes_of_files(tmp_path, name, data, said):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    assert said in problem(path) and bool(said) == bool(problem(path))


# --- other versions of Python -----------------------------------------------------------------------------------------


def versions():
    """The versions that pyproject.toml names."""
    pattern = r"Programming Language :: Python :: (3\.\d+)"
    return [found[1] for line in PROJECT["project"]["classifiers"] if (found := re.fullmatch(pattern, line))]


def find_python(version):
    return subprocess.run([ROOT / "scripts" / "find_python.sh", version], capture_output=True, text=True)


def test_each_version_has_its_command():
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(rf"^{' '.join(f'test-{version}' for version in versions())}: ", makefile, re.MULTILINE)


def test_an_interpreter_is_found_or_it_is_said_how_to_get_one():
    here = f"{sys.version_info[0]}.{sys.version_info[1]}"
    for version in {*versions(), here, "3.99"}:
        found = find_python(version)
        if found.returncode == 0:
            said = subprocess.run([found.stdout.strip(), "--version"], capture_output=True, text=True, check=True)
            assert said.stdout.startswith(f"Python {version}.")
        else:
            assert f"there is no Python {version} on this machine" in found.stderr
            assert f"uv python install {version}" in found.stderr
    assert find_python("3.99").returncode == 1
