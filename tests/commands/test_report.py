"""`detailbench report` and `site`: what they write, what they refuse."""

from __future__ import annotations

import io
import json
import re
import sys

import pytest

from bench.commands.report import progress_bar


@pytest.fixture(scope="module")
def there(shells):
    """A shell with results of toy methods in its working folder."""
    shell = shells("pages")
    words = ("dataset=cad", "method=identity,noise", "task=denoise", "cases=2", "metric=[p2f_mean]", "results=results")
    ran = shell.call("run", "-m", "--no-leaderboard", *words)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return shell


def data_of(path):
    return json.loads(
        re.search(r'id="detailbench-data">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)[1]
    )


def test_a_page_of_the_usual_folder(there):
    ran = there.call("report")
    assert ran.returncode == 0, ran.stderr
    assert re.match(r"report\.html: \d\.\d MB, 4 cases, 2 methods, \d tables", ran.stdout)
    data = data_of(there.work / "report.html")
    assert data["title"] == "results" and data["about"]["rows"] == 4
    commands = {cell["command"] for cell in data["cases"]["cells"].values()}
    assert len(commands) == 2 and all(c.startswith("detailbench reproduce ") for c in commands)


def test_a_command_of_the_page_reproduces_its_cell(there):
    there.call("report", "-o", "again.html")
    command = next(iter(data_of(there.work / "again.html")["cases"]["cells"].values()))["command"]
    ran = there.call(*command.split()[1:])
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_filters_and_a_title(there):
    ran = there.call("report", "results", "--method", "noise", "--title", "One & <only>", "-o", "deep/er/page.html")
    assert ran.returncode == 0, ran.stderr
    data = data_of(there.work / "deep/er/page.html")
    assert data["title"] == "One & <only>" and data["about"]["methods"] == 1


def test_a_bar_shows_the_progress_on_a_terminal_and_nothing_elsewhere(monkeypatch):
    class Stream(io.StringIO):
        def __init__(self, is_terminal):
            super().__init__()
            self.is_terminal = is_terminal

        def isatty(self):
            return self.is_terminal

    for is_terminal in (True, False):
        monkeypatch.setattr(sys, "stderr", stream := Stream(is_terminal))
        with progress_bar() as track:
            assert list(track([1, 2, 3], "packing")) == [1, 2, 3]
        assert ("packing" in stream.getvalue()) == is_terminal


def test_a_site_and_its_second_time(there):
    for _ in range(2):
        ran = there.call("site", "results", "-o", "public")
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout.startswith("public/index.html: 3 pages")
    assert (there.work / "public/method/noise.html").is_file()


@pytest.mark.parametrize(
    "words,message",
    [
        (["report", "nowhere"], "no such folder"),
        (["report", "--level", "2"], "--level 2.0: expected a number between 0 and 1"),
        (["report", "--shapes", "-1"], "--shapes -1: expected megabytes"),
        (["report", "-o", "."], "is a folder; name a file"),
        (["report", "--method", "noize"], "Did you mean 'noise'?"),
        (["report", "--published", "table_9"], "no experiment is called 'table_9'"),
        (["site", "-o", "."], "the folder is not empty and holds no site"),
    ],
)
def test_mistakes_are_reported(there, words, message):
    ran = there.call(*words)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert message in ran.stderr and "Traceback" not in ran.stderr
