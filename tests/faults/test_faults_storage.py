"""The disk is hurt: damaged files, a full disk, a folder that cannot be written."""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import subprocess
import sys
from collections import Counter

import pandas as pd
import pytest
from conftest import TOYS

FOUR = ("method=fine", "method.salt=1,2,3,4")
launchers = pytest.mark.parametrize("launcher", ["basic", "joblib"])


def assert_one_clear_error(done, *words: str) -> None:
    """Exit code 1 and a message, no traceback."""
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    assert "error: " in done.stderr
    for word in words:
        assert word in done.stderr


def test_damaged_results_are_set_aside_reported_and_computed_again(shell):
    assert shell.run(*FOUR).returncode == 0
    half, garbage, empty, whole = files = shell.files()
    before = whole.read_bytes()
    half.write_bytes(half.read_bytes()[: half.stat().st_size // 2])
    garbage.write_bytes(b"PAR1" + b"\x7fnonsense" * 100 + b"PAR1")
    empty.write_bytes(b"")
    done = shell.run(*FOUR, launcher="joblib")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "8/8 cases solved, 6 run, 2 cached" in done.stderr
    assert {p.name for p in (shell.results / "damaged").iterdir()} == {p.name for p in (half, garbage, empty)}
    for path in (half, garbage, empty):
        assert sum(path.name in line and "damaged" in line for line in done.stderr.splitlines()) == 1
    assert shell.files() == files
    assert whole.read_bytes() == before
    assert sorted(Counter(shell.calls()).values()) == [1, 1, 2, 2, 2, 2, 2, 2]
    assert (shell.rows()["status"] == "ok").all()


def test_one_flipped_byte_is_noticed(shell):
    shell.run("method=fine", sweep=False)
    (file,) = shell.files()
    content = bytearray(file.read_bytes())
    content[40] ^= 0x10  # in the data of the first column, where only a checksum notices
    file.write_bytes(content)
    done = shell.run("method=fine", sweep=False)
    assert done.returncode == 0, done.stderr
    assert "damaged" in done.stderr
    assert Counter(shell.calls()) == {"fine 0 0": 2, "fine 0 1": 2}


def test_what_only_reads_leaves_odd_files_where_they_are_and_says_each_once(shell):
    """Of what was read and is wrong, a run sets aside; a foreign table, a folder and a FIFO stay where they are."""
    shell.run("method=fine", "method.salt=1,2,3")
    damaged, other, good = shell.files()
    damaged.write_bytes(damaged.read_bytes()[:100])
    pd.DataFrame({"fingerprint": ["x"]}).to_parquet(other.with_name("mine.parquet"))
    os.mkfifo(other.with_name("pipe.parquet"))
    other.with_name("folder.parquet").mkdir()
    before = set(shell.results.glob("cells/*/*"))
    board = shell.call("leaderboard", shell.results, "--format", "csv")
    assert len(board.stdout.strip().splitlines()) == 3  # the header and the two that are left
    plan = shell.run("method=fine", "method.salt=1,2,3", act=lambda _, *words: shell.call("plan", *words))
    assert "6 cases, 4 finished, 2 to do" in plan.stdout
    why = shell.call("why", good.name[:12], f"results={shell.results}", "--plugin", TOYS)
    assert "it would not be run again" in why.stdout
    assert set(shell.results.glob("cells/*/*")) == before and not (shell.results / "damaged").exists()
    again = shell.run("method=fine", "method.salt=1,2,3", board=True)
    assert "2 run, 4 cached" in again.stderr
    assert [path.name for path in (shell.results / "damaged").iterdir()] == [damaged.name]
    assert good.exists() and other.with_name("mine.parquet").exists()
    for done in (board, plan, why, again):
        assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
        warned = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
        for name in ("mine.parquet", "pipe.parquet", "folder.parquet", damaged.name):
            count = sum(name in line for line in warned)
            assert count == 1 or (done is why and count == 0), done.stderr  # which reads the files of its cell alone


def test_a_torn_line_of_an_unfinished_cell_costs_that_case_alone(shell):
    """What a power cut leaves: the rows of a cell whose last line was not written to its end."""
    process = shell.run("method=fine", "method.take=0.4", "cases=4", sweep=False, act=shell.start)
    shell.wait_for(lambda: len(shell.calls()) >= 3)
    process.kill()
    process.communicate()
    assert not shell.left_over()
    (partial,) = shell.results.glob(".partial/*.jsonl")
    kept = [line for line in partial.read_text().splitlines() if line.strip()]
    partial.write_text("\n".join(kept)[:-20])
    before = Counter(shell.calls())
    done = shell.run("method=fine", "method.take=0.4", "cases=4", sweep=False)
    assert done.returncode == 0, done.stderr
    assert f"{4 - len(kept) + 1} run, {len(kept) - 1} cached" in done.stderr
    after = Counter(shell.calls())
    assert all(after[f"fine 0 {index}"] == before[f"fine 0 {index}"] for index in range(len(kept) - 1))


def small_files_only(size: int):
    """As on a full disk, every write past ``size`` bytes of a file fails."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@launchers
def test_no_space_from_the_start_is_one_error_before_anything_is_computed(shell, launcher):
    full = shell.run(*FOUR, launcher=launcher, preexec_fn=small_files_only(3000))
    assert_one_clear_error(full, "cannot write", str(shell.results), "File too large")
    assert shell.calls() == []
    assert not shell.left_over()


def test_no_space_in_mid_write_ends_in_one_error_and_the_same_command_completes_later(shell):
    """A method whose traceback is longer than what can be written, which a record of the other is not."""
    words = ("method=fine,says_too_much", "seed=0,1", "cases=3")
    plugins = (TOYS, TOYS.with_name("misbehaving.py"))
    assert shell.run("method=fine", "method.salt=9").returncode == 0
    (earlier,) = shell.files()
    before = earlier.read_bytes()
    full = shell.run(*words, launcher="joblib", plugins=plugins, preexec_fn=small_files_only(45_000))
    assert_one_clear_error(full, "cannot write", str(shell.results), "File too large")
    assert not shell.left_over()
    assert earlier in shell.files()
    assert earlier.read_bytes() == before
    assert not list(shell.results.rglob("*.tmp"))
    assert not list(shell.results.glob(".sweeps/*"))
    kept = {path: path.read_bytes() for path in shell.files()}
    done = shell.run(*words, plugins=plugins)
    assert done.returncode == 3, done.stderr
    assert "10/12 cases solved" in done.stderr
    assert {path: path.read_bytes() for path in kept} == kept
    assert max(Counter(shell.calls()).values()) <= 4  # two seeds, each begun twice at most
    assert sorted(shell.rows(method="says_too_much")["status"]) == ["error"] * 2 + ["ok"] * 4


def _can_mount() -> bool:
    """Whether a small file system can be had here; where not, the test above stands for it."""
    unshare = shutil.which("unshare")
    script = "mount -t tmpfs -o size=1m tmpfs /mnt"
    return (
        bool(unshare)
        and not subprocess.run(
            [unshare, "--map-root-user", "--mount", "sh", "-c", script], capture_output=True, check=False
        ).returncode
    )


@pytest.mark.parametrize("size", ["1m"] if _can_mount() else [])
def test_a_full_disk(shell, size):
    """A small file system: fill it, sweep, free it, sweep again."""
    shell.results.mkdir()
    before = shell.folder / "before"
    assert shell.run("method=fine", "cases=3", "method.salt=1", f"results={before}").returncode == 0
    words = " ".join(("method=fine", "method.salt=$1", "cases=3"))
    script = f"""
        mount -t tmpfs -o size={size} tmpfs "$RESULTS" || exit 99
        sweep() {{
            {sys.prefix}/bin/detailbench run -m --no-leaderboard --plugin {TOYS} task=denoise dataset=ball sensor=dots \
                'metric=[spread]' {words} results="$RESULTS"
            echo "code $?" >&2
        }}
        cp -a {before}/cells "$RESULTS"
        cat "$RESULTS"/cells/*/*.parquet | cksum >&2
        before=$(ls "$RESULTS"/cells/*/*.parquet)
        cat /dev/zero > "$RESULTS/ballast" 2>/dev/null
        echo "--- full" >&2
        sweep 1,2,3
        cat $before | cksum >&2
        rm "$RESULTS/ballast"
        echo "--- freed" >&2
        sweep 1,2,3
        echo "files $(ls "$RESULTS"/cells/*/*.parquet | wc -l)" >&2
    """
    done = shell.call(
        "-c", f"RESULTS={shell.results}; {script}", command=["unshare", "--map-root-user", "--mount", "sh"]
    )
    assert done.returncode == 0, done.stderr
    first, full, freed = done.stderr.split("---")
    assert "code 1" in full, full
    assert "cannot write" in full
    assert "No space left on device" in full
    assert "Traceback" not in full, full
    assert first.strip().splitlines()[-1] == full.strip().splitlines()[-1]  # the check sums: earlier results are intact
    assert "code 0" in freed
    assert "9/9 cases solved" in freed
    assert "files 3" in freed
    assert not shell.left_over()


def without_root_s_rights() -> None:
    """Root may write everywhere; the process that is started after this may not."""
    PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


@launchers
def test_a_results_folder_that_cannot_be_written(shell, launcher):
    shell.results.mkdir(mode=0o555)
    done = shell.run(*FOUR, launcher=launcher, preexec_fn=without_root_s_rights)
    assert_one_clear_error(done, "cannot write", str(shell.results), "Permission denied")
    assert shell.calls() == []  # found out before anything was computed
    assert len(done.stderr.strip().splitlines()) <= 2


def test_results_below_a_file_or_nowhere(shell):
    file = shell.folder / "file"
    file.write_text("")
    for place, words in {
        file: "is a file",
        file / "below": "Not a directory",
        "/proc/detailbench": "cannot write",
    }.items():
        assert_one_clear_error(shell.run("method=fine", f"results={place}", sweep=False), words, str(place))
    assert file.read_text() == ""
