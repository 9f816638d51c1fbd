"""Standard streams that are closed, full, or of another encoding; a working folder that is gone."""

import os
import subprocess
import sys

import pytest

from bench import cli
from bench.errors import LONGEST, DetailbenchError, Terminated, UsageError, code_of


def shell(line, folder, **environment):
    """A line of shell, in which $bench is the command, and its exit code, output and error."""
    words = {**os.environ, **environment, "bench": f"{sys.executable} -m bench"}
    words.pop("PYTHONPATH", None)  # of relative entries Python itself complains where the folder is gone
    done = subprocess.run(["bash", "-c", line], cwd=folder, env=words, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("to", [">&-", ">/dev/full"])
def test_an_output_that_cannot_be_written_is_an_error_in_words(tmp_path, to):
    code, out, err = shell(f"$bench --help {to}", tmp_path)
    assert code == 1 and out == ""
    assert err.startswith("error: cannot write to the standard output: ") and len(err.splitlines()) == 1


@pytest.mark.parametrize("to", ["2>&-", "2>/dev/full", "0<&-"])
def test_other_streams_need_not_be_there(tmp_path, to):
    code, out, err = shell(f"$bench --version {to}", tmp_path)
    assert code == 0 and out.startswith("detailbench ") and err == ""
    code, out, err = shell(f"$bench nothing {to}", tmp_path)
    assert code == 1 and out == ""


def test_a_reader_may_leave(tmp_path):
    code, out, err = shell("$bench --help | head -1; exit ${PIPESTATUS[0]}", tmp_path)
    assert code == 0 and len(out.splitlines()) == 1 and err == ""


def test_a_reader_that_left_does_not_change_the_exit_code(tmp_path):
    script = (
        "from bench.cli import *\nwith reader_may_leave():\n  print('x' * 10**6, flush=True)\nprint('y')\nsys.exit(3)"
    )
    code, _, err = shell(f'{sys.executable} -c "{script}" | head -c 1; exit ${{PIPESTATUS[0]}}', tmp_path)
    assert code == 3 and err == ""


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "ascii:strict"])
def test_what_an_encoding_lacks_is_escaped(tmp_path, encoding):
    code, _, err = shell("$bench ♜", tmp_path, PYTHONIOENCODING=encoding, PYTHONUTF8="0")
    assert code == 1 and r"\u265c" in err and "Traceback" not in err


def test_a_folder_that_is_gone_is_reported(tmp_path):
    code, _, err = shell("mkdir x; cd x; rmdir ../x; $bench list", tmp_path)
    assert code == 1 and err.startswith("error: the working folder no longer exists") and len(err.splitlines()) == 1


def test_plugins_need_no_docstrings_where_python_leaves_them_out(tmp_path):
    code, out, err = shell("$bench list task", tmp_path, PYTHONOPTIMIZE="2")
    assert code == 0 and "denoise" in out and "roken" not in out + err


@pytest.mark.parametrize(("raised", "code"), [(KeyboardInterrupt(), 130), (Terminated(15), 143), (Terminated(1), 129)])
def test_an_interruption_prints_one_word_and_its_signal_s_exit_code(monkeypatch, capsys, raised, code):
    def interrupted(arguments):
        raise raised

    monkeypatch.setattr(cli, "_main", interrupted)
    assert cli.main(["list"]) == code == code_of(raised)
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize("kind", [DetailbenchError, UsageError])
def test_a_message_has_an_end(kind):
    assert str(kind("short")) == "short"
    assert len(str(kind("x" * 10**7))) <= LONGEST
