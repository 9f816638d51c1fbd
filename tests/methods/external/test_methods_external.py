"""A program as a method: its input, its output, its row, and every way in which it can fail."""

from __future__ import annotations

import os
import stat
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from toy_cells import config

from bench import BadInput, InvalidOutput, PointCloud, Run, UsageError
from bench.commands.reproduce import check_programs
from bench.geometry.io.files import load_cloud
from bench.methods.external.external import PREFIX, External
from bench.plan.cell import Cell
from bench.plan.choice import Choice
from bench.plugins.reads import contents
from bench.plugins.registry import registry
from bench.plugins.schema import build, defaults
from bench.results.current import Today
from bench.results.provenance import ingredients, stated_versions

COPY = "import shutil, sys; shutil.copy(sys.argv[1], sys.argv[2])"
METHOD = registry().find("method", "external")


@pytest.fixture
def ball():
    points = np.random.default_rng(0).standard_normal((300, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return PointCloud(points, normals=points)


@pytest.fixture
def program(tmp_path):
    """Makes programs: the source of a Python script -> the start of a command."""

    def make(source: str, name: str = "program.py") -> str:
        path = tmp_path / name
        path.write_text(f"#!{sys.executable}\n{source}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return str(path)

    return make


def solve(cloud, **parameters):
    return External(**parameters).denoise(cloud, run=Run(seed=7, threads=2))


# --- input and output -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["ply", "xyz", "pcd", "csv"])
def test_a_copy_equals_the_input_bit_for_bit(ball, format):
    output = solve(ball, input_format=format, output_format=format)
    np.testing.assert_array_equal(output.points, ball.points)
    np.testing.assert_allclose(output.normals, ball.normals, atol=1e-15)
    assert solve(ball, input_format=format, output_format=format, normals=False).normals is None


@pytest.mark.parametrize("format", ["off", "obj"])
@pytest.mark.parametrize("normals", [True, False])
def test_clouds_in_formats_of_meshes(ball, tmp_path, format, normals):
    # The program stores its input, which is then read by our readers alone.
    kept = tmp_path / f"kept.{format}"
    command = f"sh -c 'cp {{input}} {kept}; cp {kept} {{output}}'"
    solve(ball, command=command, input_format=format, output_format=format, normals=normals)
    np.testing.assert_array_equal(load_cloud(kept).points, ball.points)
    assert ("vn " in kept.read_text() or kept.read_text().startswith("NOFF")) == normals


def test_placeholders_environment_and_folder(ball, program, tmp_path):
    source = "import os, sys; open('said.txt', 'w').write(' '.join([*sys.argv[3:], os.environ['WORD'], os.getcwd()]))"
    command = f"{program(COPY + chr(10) + source)} {{input}} {{output}} {{seed}} {{threads}} {{points}} {{{{x}}}}"
    solve(ball, command=command, env={"WORD": "a b"}, cwd=str(tmp_path))
    assert (tmp_path / "said.txt").read_text() == f"7 2 300 {{x}} a b {tmp_path}"


def test_no_shell_is_used(ball, tmp_path):
    with pytest.raises(BadInput, match="cp ended with exit code 1"):
        solve(ball, command=f"cp {{input}} {{output}} ; touch {tmp_path}/no")
    assert not (tmp_path / "no").exists()


def test_the_output_in_the_frame_unit_is_moved_back(ball, program):
    moved = PointCloud(ball.points * 0.01 + [5.0, 6.0, 7.0])
    source = """
import sys
import numpy as np
p = np.loadtxt(sys.argv[1])[:, :3]
p -= (p.min(axis=0) + p.max(axis=0)) / 2
np.savetxt(sys.argv[2], p / np.linalg.norm(p, axis=1).max(), fmt="%.17g")
"""
    command = f"{program(source)} {{input}} {{output}}"
    formats = {"input_format": "xyz", "output_format": "xyz"}
    output = solve(moved, command=command, frame="unit", **formats)
    np.testing.assert_allclose(output.points, moved.points, atol=1e-12)
    with pytest.raises(InvalidOutput, match="in another frame than the input"):
        solve(moved, command=command, **formats)


def test_it_solves_the_named_task(ball):
    made = build(METHOD, {"task": "upsample"})
    assert not hasattr(made, "denoise") and callable(made.upsample)
    usual = defaults(METHOD)
    assert Choice("method", "external", usual).solves("denoise")
    assert not Choice("method", "external", usual).solves("reconstruct")


def test_nothing_is_left_in_the_temporary_folder(ball, program, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left = tmp_path / f"{PREFIX}gone"  # left by a killed process
    left.mkdir()
    (left / ".lock").touch()
    solve(ball)
    assert not list(tmp_path.glob(f"{PREFIX}*"))


# --- mistakes refused before the program is run -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"command": "no_such_binary {input} {output}"}, "no program 'no_such_binary' on the PATH"),
        ({"command": "./no_such_binary {input} {output}"}, "no program './no_such_binary' in"),
        ({"command": "cp {input}"}, "expected {output} in it"),
        ({"command": "cp {input} {output} {sed}"}, "{sed} is not known"),
        ({"command": "cp {input} {output} {"}, "written twice"),
        ({"command": "cp '{input} {output}"}, "No closing quotation"),
        ({"command": " "}, "expected a program"),
        ({"cwd": "/no/such/folder"}, "no such folder"),
        ({"version_command": "no_such_binary --version"}, "version_command: there is no program"),
    ],
)
def test_mistakes_are_refused_early(values, words):
    with pytest.raises(UsageError, match="method external") as caught:
        build(METHOD, values)
    assert words in str(caught.value)


# --- failures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "error", "words"),
    [
        (
            "import sys; print('no memory of it', file=sys.stderr); sys.exit(3)",
            BadInput,
            "exit code 3: no memory of it",
        ),
        ("import os; os.kill(os.getpid(), 9)", BadInput, "was killed by SIGKILL"),
        ("raise MemoryError", MemoryError, "exit code 1"),
        ("pass", InvalidOutput, "there is no output output.ply of program.py"),
        ("import sys; open(sys.argv[2], 'w')", InvalidOutput, "output.ply of program.py: is empty"),
        ("import sys; open(sys.argv[2], 'w').write('ply nonsense')", InvalidOutput, "output.ply of program.py"),
        (
            "import sys; d = open(sys.argv[1], 'rb').read(); open(sys.argv[2], 'wb').write(d[:len(d) // 2])",
            InvalidOutput,
            "output.ply of program.py",
        ),
    ],
)
def test_failures_are_reported(ball, program, source, error, words):
    with pytest.raises(error) as caught:
        solve(ball, command=f"{program(source)} {{input}} {{output}}")
    assert words in str(caught.value) and PREFIX not in str(caught.value)


def test_only_the_last_lines_of_the_errors_are_shown(ball, program):
    source = "import sys; [print('line', i, file=sys.stderr) for i in range(99999)]; sys.exit(1)"
    with pytest.raises(BadInput) as caught:
        solve(ball, command=f"{program(source)} {{input}} {{output}}")
    assert "line 99998" in str(caught.value) and "line 99990" not in str(caught.value)


def test_a_child_that_keeps_standard_error_open_does_not_block(ball, program):
    source = COPY + "\nimport subprocess; subprocess.Popen(['sleep', '60'], start_new_session=True)"
    begin = time.monotonic()
    solve(ball, command=f"{program(source)} {{input}} {{output}}")
    assert time.monotonic() - begin < 20


# --- dependencies of a result -----------------------------------------------------------------------------------------


def test_another_program_or_script_makes_results_stale(program, tmp_path):
    path = Path(program(COPY))
    for command in (f"{path} {{input}} {{output}}", f"{sys.executable} {path} {{input}} {{output}}"):
        choice = Choice("method", "external", defaults(METHOD) | {"command": command})
        before = contents([choice])
        assert f"{path.name} (read by method external)" in before
        path.write_text(path.read_text() + "\n# other\n")
        os.utime(path, ns=(1, path.stat().st_mtime_ns + 1))
        assert contents([choice]) != before


def test_another_version_makes_results_stale():
    def key(version: str) -> str:
        made = Choice("method", "external", defaults(METHOD) | {"version_command": f"echo {version}"})
        return stated_versions(made)["version that method external states"]

    assert (key("1.2"), key("1.3")) == ("1.2", "1.3")


def test_programs_of_one_process_do_not_end_each_other(ball, program, tmp_path):
    """Two at once, one of which ends while the other is running."""
    long = program(f"import time; open({str(tmp_path / 'begun')!r}, 'w'); time.sleep(1)\n{COPY}", "long.py")
    wait = f"import os, time\nwhile not os.path.exists({str(tmp_path / 'begun')!r}): time.sleep(0.01)\n{COPY}"
    commands = [f"{path} {{input}} {{output}}" for path in (program(wait, "short.py"), long)]
    with ThreadPoolExecutor(2) as pool:
        outputs = list(pool.map(lambda command: solve(ball, command=command), commands))
    assert [len(output) for output in outputs] == [300, 300]


def test_a_record_starts_no_program(program, tmp_path):
    """Neither to check whether it is current, nor to list differences, nor to reproduce it without permission."""
    touched = tmp_path / "touched"
    command = f"{program(f'open({str(touched)!r}, chr(119))')} {{input}} {{output}}"
    values = {"_name_": "external", "command": command, "version_command": program(f"open({str(touched)!r}, chr(119))")}
    cell = Cell.from_config(config(method=values))
    then = {"cell": cell.id, "version that method external states": "1"}
    now = ingredients(cell, recorded=then)
    assert now["version that method external states"] == "1"
    assert Today().is_current({"cell": cell.to_json(), "ingredients": now})
    with pytest.raises(UsageError, match="--allow-program"):
        check_programs(cell)
    assert not touched.exists()
    ingredients(cell)
    assert touched.exists()
