"""Some 300 command lines, right and wrong, and what becomes of each: `command_lines.txt` beside this file."""

from __future__ import annotations

import copy
import functools
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from bench import UsageError
from bench.plan.cell import Cell, NotSolved, check_root
from bench.sweep.composition import resolved
from bench.sweep.flags import only_overrides, split_words
from bench.sweep.launch import show
from bench.sweep.overrides import check, check_jobs, checked
from bench.sweep.request import Request

LINES = Path(__file__).with_name("command_lines.txt")
SWEEP = "# @package _global_\n{keys}hydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n      {params}\n"
CONFIGS = {
    "experiment/mine": SWEEP.format(keys="cases: 1\n", params="{method: 'poisson,deep', seed: '0,1'}"),
    "experiment/swept_results": SWEEP.format(keys="", params="{results: 'a,b'}"),
    "experiment/own_results": SWEEP.format(keys="results: elsewhere\n", params="{seed: '0,1'}"),
    "experiment/two_at_once": "# @package _global_\ndefaults:\n  - override /hydra/launcher: joblib\n"
    + SWEEP.format(keys="", params="{seed: '0,1'}").partition("\n")[2],
    "experiment/broken": "# @package _global_\ncases: [\n",
    "experiment/targets": "# @package _global_\nhydra:\n  callbacks: {x: {_target_: os.system}}\n",
    "method/deep": "defaults: [poisson]\ndepth: 9\n",
}
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n2 0 0\n0 2 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def read() -> dict[str, str]:
    """What is expected of each line: the text below it, behind an arrow."""
    texts = [text for text in LINES.read_text().splitlines() if text and not text.startswith("#")]
    assert all(expected.startswith("    -> ") for expected in texts[1::2])
    return dict(zip(texts[::2], (expected[7:] for expected in texts[1::2]), strict=True))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working folder with shapes and configs of a user's own."""
    folder = tmp_path_factory.mktemp("work")
    for name, text in CONFIGS.items():
        (folder / "conf" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "conf" / f"{name}.yaml").write_text(text)
    for name in ("shapes/a.off", "shapes/b.off", "scan (2)/c.off", "a=b.off"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(TETRAHEDRON)
    return folder


def outcome(line: str) -> str:
    """How many jobs a line makes, of the only one what it is, or what is wrong."""
    command, *words = shlex.split(line)
    multirun = any(word in ("-m", "--multirun") for word in words)
    words = [word for word in words if word not in ("-m", "--multirun")]
    try:
        if command == "run" and (flags := split_words(words)[1]):
            request = Request.of(split_words(words)[0])
            check(request)
            return "shown" if show(flags, request) == 0 else "not shown"
        request = checked(only_overrides(words, "no option"), command, multirun=multirun, sweeps=True)
        jobs = [job for part in request.parts() for job in part.jobs]
        check_jobs(jobs)
        if len(jobs) > 1:
            at_once = "" if request.launcher == "basic" else f" by {request.launcher}"
            return f"{len(jobs)} jobs{at_once}, the last one {' '.join(sorted(jobs[-1]))}"
        values = resolved(jobs[0])
        check_root(values)
        cell = Cell.from_config(values)
        return f"{cell.title}, {cell.planned} cases, in {request.folder}"
    except NotSolved as error:
        return f"no cell: {error}".partition(". Methods that")[0].partition(": it solves")[0]
    except UsageError as error:
        line = f"error: {error}".splitlines()[0].replace(str(Path.cwd()), ".")
        return line.partition(" Known:")[0].partition(" (/")[0]  # without lists of names, and of folders


def test_every_line_does_what_it_says(folder):
    """In a process of its own: plugins that other tests have loaded would be among the names that are suggested."""
    environment = os.environ | {"WORD": "w", "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(
        [sys.executable, __file__], cwd=folder, env=environment, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr
    expected, found = read(), json.loads(done.stdout.splitlines()[-1])
    assert {line: text for line, text in found.items() if text != expected[line]} == {}
    assert len(found) >= 300 and len(set(found.values())) > 150  # a test that sees no difference would be none


def take_each_file_apart_once() -> None:
    """Hydra reads its own files and ours anew for each config."""
    from hydra._internal.core_plugins.importlib_resources_config_source import ImportlibResourcesConfigSource

    load = functools.cache(ImportlibResourcesConfigSource.load_config)
    ImportlibResourcesConfigSource.__hash__ = lambda source: hash(source.full_path())
    ImportlibResourcesConfigSource.__eq__ = lambda source, other: source.full_path() == other.full_path()
    ImportlibResourcesConfigSource.load_config = lambda source, config_path: copy.deepcopy(load(source, config_path))


if __name__ == "__main__":
    take_each_file_apart_once()
    print(json.dumps({line: outcome(line) for line in read()}))
