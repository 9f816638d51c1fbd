"""Programs as methods in a sweep: limits reach all that they start, and their rows say what they took."""

from __future__ import annotations

import sys

import pytest

PROGRAMS = {
    "whole": "import shutil, time; x = b'1' * (90 << 20); time.sleep(0.3)\nshutil.copy(sys.argv[1], sys.argv[2])",
    "hangs": "import subprocess, time\n"
    "subprocess.Popen(['sleep', '1000']); subprocess.Popen(['sleep', '1001'], start_new_session=True); time.sleep(999)",
    "leaves": "import shutil, subprocess\n"
    "shutil.copy(sys.argv[1], sys.argv[2]); subprocess.Popen([sys.executable, '-c', 'while True: pass'])",
    "greedy": "import time; x = bytearray(b'1') * (3 << 30); time.sleep(60)",
    "crashes": "import os; os.abort()",
    "silent": "pass",
    "damaged": "open(sys.argv[2], 'w').write('ply and nothing else')",
}
EXPECTED = {
    "whole": ("ok", ""),
    "leaves": ("ok", ""),
    "hangs": ("timeout", "stopped after 4 s"),
    "greedy": ("oom", "memory"),
    "crashes": ("error", "killed by SIGABRT"),
    "silent": ("invalid", "there is no output output.xyz"),
    "damaged": ("invalid", "output.xyz of "),
}
PRESET = "# A program.\ndefaults: [external]\nname: {name}\ncommand: '{python} {script} {{input}} {{output}}'\n"
PRESET += "input_format: xyz\noutput_format: xyz\n"


@pytest.fixture(scope="module")
def swept(shells):
    """A sweep over all programs, each a preset in ./conf."""
    shell = shells("external")
    folder = shell.work / "conf" / "method"
    folder.mkdir(parents=True)
    for name, source in PROGRAMS.items():
        (shell.work / f"{name}.py").write_text(f"import sys\n{source}\n")
        (folder / f"{name}.yaml").write_text(PRESET.format(name=name, python=sys.executable, script=f"{name}.py"))
    limits = ("limit.seconds=4", "limit.memory_gb=1", "cases=1")
    shell.done = shell.run(f"method={','.join(PROGRAMS)}", *limits)
    shell.after = shell.left_over()
    table = shell.rows()
    shell.found = {row["variant"]: row for row in table.to_dict("records")}
    return shell


@pytest.mark.parametrize("name", PROGRAMS)
def test_each_has_its_row(swept, name):
    status, words = EXPECTED[name]
    row = swept.found[name]
    assert row["status"] == status and words in row["message"], row["message"]


def test_nothing_of_them_is_left(swept):
    assert swept.done.returncode == 3
    assert swept.after == []


def test_the_memory_is_the_program_s(swept):
    assert 90 < swept.found["whole"]["peak_rss_mb"] < 300  # its own 90 MB, or twice that, and Python
    assert swept.found["whole"]["rss_before_mb"] == 0


def test_the_files_are_not_the_method_s_time(swept):
    row = swept.found["whole"]
    assert 0 < row["exchange_seconds"] < 5
    assert row["seconds"] > 0.3
    assert 0 < row["reference_seconds"] < 1


def test_a_missing_program_is_reported_before_anything_is_run(swept, tmp_path):
    results = tmp_path / "none"
    words = ("method=external,mark", "method.command=no_such_program {input} {output}", f"results={results}")
    done = swept.run(*words[:1], words[1], words[2])
    assert done.returncode == 1
    assert not list(results.glob("cells/*/*"))
