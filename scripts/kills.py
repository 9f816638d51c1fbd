"""Kill random processes of sweeps, run each command again, and count what it cost.

    python scripts/kills.py [--kills 100] [--seed 0] [--minutes 15] [--folder DIR]

Each round starts a sweep of a small toy method in a new folder, under the basic launcher and joblib in turn, and kills
one process of it by SIGKILL after a random time: the front door, a fork server, the worker of a cell, or a process of
joblib. The same command is then run again to its end. Printed is a table: for each kind of process how often it was
killed, and of these rounds how many

    lost      cases had a row when the process was killed, and have none in the end
    twice     calls of cases that had a row were made again
    crashed   rows in the end are not ok
    differ    scores are not those of an undisturbed run
    orphans   processes were there 10 seconds after the end
    hangs     commands did not end within 120 seconds

A round whose sweep ended before the kill counts as `nobody`.
"""

from __future__ import annotations

import argparse
import json
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

    def start(self) -> subprocess.Popen[bytes]:
        """The command, in the background."""
        environment = {**os.environ, MARK: self.mark, "TOY_LOG": str(self.log)}
        with (self.folder / "said.txt").open("ab") as said:
            return subprocess.Popen(self.command, stdout=said, stderr=said, env=environment, start_new_session=True)

    def processes(self) -> list[psutil.Process]:
        """All that the command started, and what they started."""
        found = []
        for process in psutil.process_iter():
            try:
                if process.environ().get(MARK) == self.mark and process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
            except (psutil.Error, OSError):
                continue
        return found

    def victims(self, front: int) -> dict[str, list[psutil.Process]]:
        """The processes by what they are."""
        by_kind: dict[str, list[psutil.Process]] = {kind: [] for kind in KINDS}
        for process in self.processes():
            try:
                words = " ".join(process.cmdline())
                parent = " ".join((process.parent() or process).cmdline())
            except psutil.Error:
                continue
            if process.pid == front:
                by_kind["front door"].append(process)
            elif "forkserver import serve" in words:
                by_kind["worker" if "forkserver import serve" in parent else "fork server"].append(process)
            elif "popen_loky" in words:
                by_kind["joblib process"].append(process)
        return {kind: processes for kind, processes in by_kind.items() if processes}

    def rows(self) -> dict[tuple[str, int], dict]:
        """What is stored, in finished cells and in those that were cut off, by parameters and case."""
        results, rows = Results(self.folder / "results"), []
        for path in results.folder.glob("cells/*/*.parquet"):
            record = results.read(*path.stem.split("-"))
            rows += record.rows if record else []
        for path in results.folder.glob(".partial/*.jsonl"):
            rows += results.partial_rows(*path.stem.split("-"))
        return {(row["variant"], row["case_index"]): row for row in rows}

    def calls(self) -> Counter[tuple[str, int]]:
        """How often each case was begun."""
        lines = [line.split() for line in self.log.read_text().splitlines()] if self.log.exists() else []
        return Counter((f"take=0.2,salt={line[1]}", int(line[2])) for line in lines if line)

    def hangs(self, process: subprocess.Popen[bytes]) -> bool:
        """Wait for the end of a command, and end it if there is none."""
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            return True
        return False

    def orphans(self) -> int:
        """Processes that outlive the command; they are ended."""
        end = time.monotonic() + GRACE
        while (left := self.processes()) and time.monotonic() < end:
            time.sleep(0.2)
        for process in left:
            process.kill()
        return len(left)


def play(folder: Path, launcher: str, chance: random.Random, truth: dict) -> tuple[str, Counter[str]]:
    """One kill; who was killed, and what it cost."""
    one, counts = Round(folder, launcher), Counter()
    process, begin, killed = one.start(), time.monotonic(), "nobody"
    while process.poll() is None and not one.log.exists() and time.monotonic() - begin < PATIENCE:
        time.sleep(0.05)  # imports are not what is to be killed
    time.sleep(chance.uniform(0.0, 2.5))
    if process.poll() is None and (victims := one.victims(process.pid)):
        killed = chance.choice(sorted(victims))
        chance.choice(victims[killed]).kill()
    stored, begun = one.rows(), one.calls()
    counts["hangs"] += one.hangs(process)
    counts["orphans"] += one.orphans()
    counts["hangs"] += one.hangs(one.start())
    counts["orphans"] += one.orphans()
    rows, calls = one.rows(), one.calls()
    counts["lost"] = len(stored.keys() - rows.keys())
    counts["twice"] = sum(calls[key] > begun[key] for key, row in stored.items() if row["status"] == "ok")
    counts["crashed"] = sum(row["status"] != "ok" for row in rows.values())
    counts["differ"] = sum(row["score.spread"] != truth[key] for key, row in rows.items() if row["status"] == "ok")
    counts["differ"] += len(truth.keys() - rows.keys())
    return killed, counts


def main() -> None:
    """Play, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("--kills", 100), ("--seed", 0), ("--minutes", 15.0)):
        parser.add_argument(name, type=type(value), default=value)
    parser.add_argument("--folder", type=Path, default=None)
    asked = parser.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="kills-"))
    end, chance, table = time.monotonic() + 60 * asked.minutes, random.Random(asked.seed), {}
    undisturbed = Round(folder / "undisturbed", "basic")
    undisturbed.hangs(undisturbed.start())
    truth = {key: row["score.spread"] for key, row in undisturbed.rows().items()}
    played = 0
    while sum(counts["kills"] for who, counts in table.items() if who != "nobody") < asked.kills:
        if time.monotonic() > end:
            break
        killed, counts = play(folder / str(played), list(LAUNCHERS)[played % 2], chance, truth)
        table.setdefault(killed, Counter()).update({**counts, "kills": 1})
        played += 1
        print(json.dumps({"round": played, "killed": killed, **counts}), file=sys.stderr, flush=True)
    print(f"{'killed':16}" + "".join(f"{name:>9}" for name in COUNTS))
    for who in (*KINDS, "nobody"):
        if who in table:
            print(f"{who:16}" + "".join(f"{table[who][name]:9}" for name in COUNTS))


if __name__ == "__main__":
    main()
