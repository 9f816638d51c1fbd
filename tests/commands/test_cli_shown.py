"""Control characters and markup in other people's text are shown in the terminal by every command, not obeyed."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import TOYS

from bench.cli import main
from bench.plugins.registry import registry
from bench.text import OBEYED

# Colours, a title, a colour by C1, a backspace, a carriage return, DEL, right to left, separators; and rich's words.
PAYLOAD = "\x1b[31m\x1b]0;title\x07\x9b5m\x08\r\x7f\u202e\u2028[bold][link=x][/]:smile:"
VISIBLE = r"\x1b[31m\x1b]0;title\x07\x9b5m\x08\r\x7f\u202e\u2028[bold][link=x][/]:smile:"
PLUGIN = f'''
"""Methods whose texts are hostile."""
from dataclasses import dataclass
from bench import PointCloud, Run, register

@register("method", cite={PAYLOAD!r})
@dataclass(frozen=True)
class Hostile:
    """Denoises. {PAYLOAD}"""
    text: str = "x"  # {PAYLOAD.replace(chr(13), "").replace(chr(0x2028), "")}

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        if self.text == "note":
            run.note({PAYLOAD!r})
            return cloud
        raise ValueError({PAYLOAD!r})
'''


def assert_shown(done, *where: str, visible: str = VISIBLE):
    """Nothing that a terminal obeys, and the payload in letters, in stdout or stderr."""
    printed = done.stdout + done.stderr
    assert not re.search(rf"(?![\n\t])[{OBEYED}]", printed), printed
    for part in where:
        assert visible in getattr(done, part), printed
    assert "Traceback" not in printed or "ValueError" in printed
    return printed


@pytest.fixture(scope="module")
def hostile(shells):
    """A shell with the plugin, and a finished run of it: one method fails, one leaves a note."""
    shell = shells("hostile")
    (shell.folder / "hostile.py").write_text(PLUGIN, encoding="utf-8")
    shell.plugins = (TOYS, shell.folder / "hostile.py")
    done = shell.run("method=hostile", "method.text=x,note", "cases=1", plugins=shell.plugins, board=True)
    return shell, done


def test_a_run_its_progress_and_its_leaderboard(hostile):
    _, done = hostile
    assert done.returncode == 3, done.stderr
    assert_shown(done)
    first_line = VISIBLE.partition(r"\r")[0]  # of a message
    assert f"ValueError: {first_line}" in done.stderr
    lines = [line for line in done.stdout.splitlines() if "hostile" in line and r"\x1b[31m" in line]
    assert len(lines) == 2, done.stdout  # not solved, and solved with a note
    assert all("[bold][link=x][/]:smile:" in line for line in lines)


def test_why_and_its_source(hostile):
    shell, _ = hostile
    cell = shell.rows(status="error")["cell"][0]
    assert_shown(shell.call("why", cell, f"results={shell.results}"), "stdout")
    assert r"Denoises. \x1b[31m" in assert_shown(shell.call("why", cell, f"results={shell.results}", "--source"))


def test_apply(hostile):
    shell, _ = hostile
    np.savetxt(shell.work / "cloud.xyz", np.random.default_rng(0).normal(size=(50, 3)))
    words = ("--plugin", shell.plugins[1], "method=hostile", "method.text=note", "cloud.xyz", "out.xyz")
    assert_shown(shell.apply(*words), "stdout")


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Calls the front door in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> SimpleNamespace:
        code = main(list(map(str, words)))
        printed = capsys.readouterr()
        return SimpleNamespace(returncode=code, stdout=printed.out, stderr=printed.err)

    return call


def test_list(hostile, called):
    shell, _ = hostile
    printed = assert_shown(called("list", "method", "hostile", "--plugin", shell.plugins[1]))
    assert printed.count(r"\x1b[31m\x1b]0;title\x07") > 2  # description, source, parameter


def test_a_broken_plugin(called, tmp_path, monkeypatch):
    monkeypatch.setattr(registry(), "broken", [])  # nor is it in the other tests of this process
    file = tmp_path / "broken.py"
    file.write_text(f"raise ValueError({PAYLOAD!r})", encoding="utf-8")
    done = called("check", file)
    assert done.returncode == 3
    assert_shown(done, "stdout")


def test_names_of_files_and_words(called):
    name, visible = PAYLOAD.replace("/", ""), VISIBLE.replace("/", "")
    for suffix, text in ((".xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"), (".obj", "v 0 0 x\n")):
        Path(f"{name}{suffix}").write_text(text)
    file = f"{name}.xyz"
    assert_shown(called("score", file, file, "--metric", "chamfer_l1_mean"), "stdout", visible=visible)
    assert_shown(called("score", f"{name}.obj", file), "stderr", visible=visible)
    lines = [
        ["run", name],
        ["plan", f"method={name}"],
        ["train", name],
        ["new", "method", name],
        [name],
        ["list", name],
    ]
    lines += [["leaderboard", name], ["why", name], ["check", name], ["fetch", name]]
    for words in lines:
        done = called(*words)
        assert done.returncode == 1
        assert_shown(done)
        assert r"\x1b" in done.stderr or words[0] == "why"  # which looks for results first


def test_what_a_file_of_weights_says_of_itself(called):
    from bench.plugins.weights import as_bytes

    Path("weights.safetensors").write_bytes(as_bytes({"a": np.zeros(3)}, {"method": PAYLOAD, "parameters": {}}))
    Path("cloud.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    words = ("method=mpu", "task=upsample", "training.weights=weights.safetensors", "cloud.xyz", "out.xyz")
    done = called("apply", *words)
    assert done.returncode == 1
    assert_shown(done, "stderr")


def test_streams_are_as_before_when_a_command_has_ended(capsys):
    before = sys.stdout, sys.stderr
    assert main(["\x1b[2J"]) == 1
    assert (sys.stdout, sys.stderr) == before
    assert r"\x1b[2J" in capsys.readouterr().err


def test_messages_need_no_stream(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    assert main(["list", "tasks"]) == 0
    assert main(["nothing"]) == 1
