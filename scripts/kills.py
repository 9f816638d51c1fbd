"""Kill random processes of sweeps, run each command again, and count what it cost.

    python scripts/kills.py [--kills 100] [--seed 0] [--minutes 15] [--folder DIR]

Each round starts a sweep of a toy method in a new folder, under the basic launcher and joblib in turn, kills one
process (front door, fork server, worker of a cell, or process of joblib) by SIGKILL after a random time, and runs the
same command again to its end. Printed is a table: how often each kind of process was killed, or nobody, since the
sweep had ended, and of these rounds how many cases had a row and `lost` it, how many with a row were called `twice`,
how many rows are `crashed` or `differ` from an undisturbed run, how many processes were `orphans` 10 seconds after the
end, and how many commands were `hangs` of 120 seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from pathlib import Path

import psutil

from bench.results.store import Results

TOYS = Path(__file__).resolve().parents[1] / "tests" / "faults" / "toys.py"
SWEEP = ("method=fine", "method.take=0.2", "method.salt=1,2,3,4", "cases=3")
WORDS = ("task=denoise", "dataset=ball", "sensor=dots", "metric=[spread]", "--no-leaderboard", *SWEEP)
LAUNCHERS = {"basic": (), "joblib": ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")}
KINDS = ("front door", "fork server", "worker", "joblib process")
COUNTS = ("kills", "lost", "twice", "crashed", "differ", "orphans", "hangs")
PATIENCE, GRACE = 120.0, 10.0  # seconds
MARK = "DETAILBENCH_KILLS"  # in the environment of all that a command starts


class Round:
    """One sweep in a folder of its own."""

    def __init__(self, folder: Path, launcher: str):
        self.folder, self.mark, self.log = folder, uuid.uuid4().hex, folder / "calls.log"
        folder.mkdir(parents=True)
        command = [sys.executable, "-m", "bench", "run", "-m", "--plugin", str(TOYS), *WORDS]
        self.command = [*command, *LAUNCHERS[launcher], f"results={folder / 'results'}"]

    def start(self) -> subprocess.Popen[bytes]:  # noqa: D102
        environment = {**os.environ, MARK: self.mark, "TOY_LOG": str(self.log)}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(self.command, env=environment, start_new_session=True, **quiet)

    def processes(self) -> list[psutil.Process]:
        """All that the command started, and what they started."""
        found = psutil.process_iter(["environ", "status"])
        ours = [p for p in found if (p.info["environ"] or {}).get(MARK) == self.mark]
        return [p for p in ours if p.info["status"] != psutil.STATUS_ZOMBIE]

    def victims(self, front: int) -> dict[str, list[psutil.Process]]:
        """The processes by what they are."""
        found: dict[str, list[psutil.Process]] = {}
        for process in self.processes():
            with contextlib.suppress(psutil.Error):
                words, parent = (" ".join(p.cmdline()) for p in (process, process.parent() or process))
                kind = "front door" if process.pid == front else "joblib process" if "popen_loky" in words else ""
                if "forkserver import serve" in words:
                    kind = "worker" if "forkserver" in parent else "fork server"
                found.setdefault(kind, []).append(process)
        return {kind: processes for kind, processes in found.items() if kind}

    def rows(self) -> dict[tuple[str, int], dict]:
        """What is stored, in finished cells and in those that were cut off, by parameters and case."""
        results, rows = Results(self.folder / "results"), []
        for path in results.folder.glob("cells/*/*.parquet"):
            rows += results.read(*path.stem.split("-")).rows
        for path in results.folder.glob(".partial/*.jsonl"):
            rows += results.partial_rows(*path.stem.split("-"))
        return {(row["variant"], row["case_index"]): row for row in rows}

    def calls(self) -> Counter[tuple[str, int]]:
        """How often each case was begun."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return Counter((f"take=0.2,salt={line.split()[1]}", int(line.split()[2])) for line in lines if line)

    def end(self, process: subprocess.Popen[bytes]) -> Counter[str]:
        """Wait for the end of a command, and of all that it started; what has none is ended, and counted."""
        counts = Counter()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
        if process.returncode is None:
            process.kill()
            counts["hangs"] = 1
        end = time.monotonic() + GRACE
        while (left := self.processes()) and time.monotonic() < end:
            time.sleep(0.2)
        for process in left:
            process.kill()
        counts["orphans"] = len(left)
        return counts


def play(folder: Path, launcher: str, chance: random.Random, truth: dict) -> tuple[str, Counter[str]]:
    """One kill; who was killed, and what it cost."""
    one, counts = Round(folder, launcher), Counter()
    process, begin, killed = one.start(), time.monotonic(), "nobody"
    while process.poll() is None and not one.log.exists() and time.monotonic() - begin < PATIENCE:
        time.sleep(0.05)  # imports are not what is to be killed
    time.sleep(chance.uniform(0.0, 2.5))
    if process.poll() is None and (victims := one.victims(process.pid)):
        killed = chance.choice(sorted(victims))
        with contextlib.suppress(psutil.NoSuchProcess):
            chance.choice(victims[killed]).kill()
    stored, begun = one.rows(), one.calls()
    counts.update(one.end(process) + one.end(one.start()))
    rows, calls = one.rows(), one.calls()
    counts["lost"] = len(stored.keys() - rows.keys())
    counts["twice"] = sum(calls[key] > begun[key] for key, row in stored.items() if row["status"] == "ok")
    solved = {key: row["score.spread"] for key, row in rows.items() if row["status"] == "ok"}
    counts["crashed"], counts["differ"] = len(rows) - len(solved), len(solved.items() - truth.items())
    return killed, counts


def main() -> None:
    """Play, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("--kills", 100), ("--seed", 0), ("--minutes", 15.0)):
        parser.add_argument(name, type=type(value), default=value)
    parser.add_argument("--folder", help="for the temporary files")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="kills-", dir=asked.folder))
    end, chance = time.monotonic() + 60 * asked.minutes, random.Random(asked.seed)
    table = {who: Counter() for who in (*KINDS, "nobody")}
    undisturbed = Round(folder / "undisturbed", "basic")
    undisturbed.end(undisturbed.start())
    truth = {key: row["score.spread"] for key, row in undisturbed.rows().items()}
    for played in range(2 * asked.kills):
        if sum(table[who]["kills"] for who in KINDS) == asked.kills or time.monotonic() > end:
            break
        killed, counts = play(folder / str(played), list(LAUNCHERS)[played % 2], chance, truth)
        table[killed].update({**counts, "kills": 1})
        print(played, killed, dict(+counts), file=sys.stderr, flush=True)
    print(f"{'killed':16}" + "".join(f"{name:>9}" for name in COUNTS))
    for who, counts in table.items():
        print(f"{who:16}" + "".join(f"{counts[name]:9}" for name in COUNTS))


if __name__ == "__main__":
    main()
