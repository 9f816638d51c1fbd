"""The documentation: links lead somewhere, the navigation has each page, pictures have their commands."""

from __future__ import annotations

import inspect
import pkgutil
import re
import shlex
import tomllib
from collections import Counter

import pytest
from links import ROOT, anchors, broken, links, pages
from task_lists import page_of, with_lists

import bench
import bench.geometry
from bench.cli import main
from bench.plugins.origins import installed
from bench.plugins.registry import registry

DOCS = ROOT / "docs"


# --- links ------------------------------------------------------------------------------------------------------------


def test_no_link_is_broken():
    assert broken() == []


@pytest.mark.parametrize(
    ("link", "why"),
    [
        ("nowhere.md", "no such file"),
        ("docs/page.md#elsewhere", "no such heading"),
        ("docs/page.md#a-c-1", ""),
        ("#start", ""),
        ("#end", "no such heading"),
        ("docs/picture.png#start", "no such heading"),
        ("../outside.md", "outside"),
        ("https://example.org/nowhere#at-all", ""),
    ],
)
def test_a_broken_link_is_found(tmp_path, link, why):
    root = tmp_path / "root"
    (root / "docs").mkdir(parents=True)
    (tmp_path / "outside.md").touch()
    (root / "docs" / "picture.png").touch()
    (root / "docs" / "page.md").write_text("# Page\n## `a`: (c)\n## A C\n```\n[not a link](nothing.md)\n```\n")
    (root / "README.md").write_text(f"# Start\n\n| a | b |\n| --- | --- |\n| c | see [here]({link}) |\n")
    for name in ("CONTRIBUTING.md", "CHANGELOG.md"):
        (root / name).write_text("# Name\n")
    found = broken(root)
    assert len(found) == bool(why)
    assert not why or (found[0].startswith(f"README.md:5: {link}") and why in found[0])


def test_anchors_are_those_of_web_pages():
    assert {"one-row-per-planned-case"} <= {name.partition("columns-")[2] for name in anchors(DOCS / "results.md")}


# --- the site ---------------------------------------------------------------------------------------------------------


def navigation():
    sections = tomllib.loads((DOCS / "navigation.toml").read_text())["section"]
    return [page for section in sections for page in section["pages"]]


def test_each_page_stands_in_the_navigation_once():
    assert sorted(navigation()) == sorted(str(page.relative_to(ROOT)) for page in pages())


def test_each_page_has_one_title():
    for page in pages():
        text = re.sub(r"^(```+).*?^\1", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
        assert len(re.findall(r"^# ", text, re.MULTILINE)) == 1 and text.startswith("# "), page


def documented(page):
    """What the directives of a page of the API name."""
    return re.findall(r"^\.\. auto\w+:: ([\w.]+)", (DOCS / "api" / page).read_text(), re.MULTILINE)


def test_the_api_has_the_public_names():
    assert sorted(documented("bench.md")) == sorted(f"bench.{name}" for name in bench.__all__)
    modules = {f"bench.geometry.{m.name}" for m in pkgutil.iter_modules(bench.geometry.__path__) if not m.ispkg}
    # PointCloud and Frame are names of bench.
    assert Counter(documented("geometry.md")) == Counter(modules - {"bench.geometry.cloud"})
    assert all(inspect.getdoc(getattr(bench, name)) for name in bench.__all__)


def test_the_gallery_has_each_picture_with_its_command():
    shown = [link for _, link in links(DOCS / "gallery.md") if link.endswith(".png")]
    assert sorted(shown) == sorted(str(picture.relative_to(DOCS)) for picture in DOCS.rglob("*.png"))
    parts = re.split(r"^!\[", (DOCS / "gallery.md").read_text(), flags=re.MULTILINE)[1:]
    for part in parts:
        assert re.search(r"^    (detailbench|python|make) ", part, re.MULTILINE), f"say what makes this: {part[:60]}"


# --- the pages of the tasks -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", installed("task"))
def test_the_lists_of_a_task_are_those_of_the_registry(task):
    text = page_of(task).read_text()
    assert with_lists(text, registry().find("task", task)) == text, "python scripts/task_lists.py writes them anew"
    assert not re.search(r"to come|TODO", text)


@pytest.mark.parametrize("task", installed("task"))
def test_the_page_of_a_task_has_its_function_two_commands_a_picture_and_its_chapter(task):
    text = page_of(task).read_text()
    (called,) = re.findall(rf"^\| function of a method \| `{task}\((.*)\)` \|$", text, re.MULTILINE)
    method = next(p for p in registry().all("method") if p.solves(task) and p.file.parent.name != "pseudo")
    assert ["self", *called.split(", ")] == list(inspect.signature(getattr(method.cls, task)).parameters)
    assert len(re.findall(r"^    detailbench (?:run|apply) ", text, re.MULTILINE)) == 2
    assert len(re.findall(r"^!\[", text, re.MULTILINE)) == 1
    assert re.search(r"^\*\*More\*\*: .*\]\(\.\./\w[\w-]*\.md", text, re.MULTILINE)


@pytest.mark.parametrize("task", installed("task"))
def test_the_sweeps_of_a_task_can_be_planned(task, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lines = re.findall(r"^    detailbench run (.*)", page_of(task).read_text(), re.MULTILINE)
    assert lines
    for line in lines:
        assert main(["plan", *shlex.split(line)]) == 0, capsys.readouterr().err
        assert "not planned" not in capsys.readouterr().out
