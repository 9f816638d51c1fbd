"""One call of a learned method's ``fit``: its clock, its log, its checkpoints and its weights.

Imported by the child process of a training, and by :mod:`bench.fit` where there is little more than numpy and torch.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.run import Run
from ..errors import BadInput, UsageError
from ..own_folder import open_own
from ..plugins.weights import as_bytes, as_stored, facts_of
from ..results.files import write_atomically
from .channel import plain
from .seeding import seed_globals

KEPT = 400  # points of a curve in a header


class Fit:
    """One call of a method's ``fit``, with its log, its checkpoints and its clock, in a folder.

    Parameters
    ----------
    method : the learned method, built
    folder : Path
        Of ``weights.safetensors``, ``log.jsonl`` and ``checkpoint.safetensors``; training resumes
        from an existing checkpoint, whose seconds count.
    facts : mapping
        The facts about the examples, for the header of the weights.
    seconds : float
        Of training, wall clock, including those before an interruption.
    device, threads : where and how
    on_progress : called with the number of finished steps and the total
    """

    def __init__(
        self,
        method: Any,
        folder: Path,
        facts: Mapping[str, Any],
        *,
        seconds: float,
        device: str = "cpu",
        threads: int = 1,
        on_progress: Callable[[int, int], None] = lambda done, total: None,
    ):
        self.method, self.folder, self.facts = method, folder, dict(facts)
        self.seconds, self.device, self.threads, self.on_progress = seconds, device, threads, on_progress
        self.checkpoint, self.log = folder / "checkpoint.safetensors", folder / "log.jsonl"
        self.before = {"seconds": 0.0, "cpu_seconds": 0.0, "steps": 0}
        self.step = 0

    def run(self, examples: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Fit and store; the entries on the training in the header of the weights."""
        resumed = self._resumed()
        self._run = Run(
            seed=self.facts["seed"],
            device=self.device,
            threads=self.threads,
            seconds=max(self.seconds - self.before["seconds"], 0.0),
            spent=self.before["seconds"],
            resumed=resumed,
            on_progress=self._progress,
            on_log=self._log,
            on_checkpoint=self._store,
        )
        seed_globals(self.facts["seed"])
        self._cpu = time.process_time()
        weights = dict(self.method.fit(examples, self._run))
        spent = self._spent()
        for name, array in weights.items():
            array = np.asarray(array)
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise UsageError(f"fit: the weights {name!r} are not finite; try a smaller learning rate")
        facts = {
            **self.facts,
            **spent,
            "device": self.device if self.device == "cpu" else _gpu(self.device),
            "curve": thinned(read_curve(self.log), KEPT),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        write_atomically(self.folder / "weights.safetensors", as_bytes(weights, facts))
        self.checkpoint.unlink(missing_ok=True)
        return {key: facts[key] for key in ("seconds", "cpu_seconds", "steps", "device")} | {
            "notes": "; ".join(self._run.notes),
            "parameters": self._run.parameters,
        }

    def _spent(self) -> dict[str, Any]:
        return {
            "seconds": round(self.before["seconds"] + self._run.elapsed(), 3),
            "cpu_seconds": round(self.before["cpu_seconds"] + time.process_time() - self._cpu, 3),
            "steps": max(self.step, self.before["steps"]),
        }

    def _resumed(self) -> dict[str, np.ndarray] | None:
        """The arrays of a readable checkpoint, if any; the log is cut back to that point."""
        try:
            facts, arrays = facts_of(self.checkpoint), as_stored(self.checkpoint)
            self.before = {key: facts[key] for key in self.before}
        except (BadInput, KeyError):  # there is none, or it is damaged
            self.log.unlink(missing_ok=True)
            return None
        lines = [line for line in read_log(self.log) if line["step"] < self.before["steps"]]
        write_atomically(self.log, "".join(json.dumps(line) + "\n" for line in lines).encode())
        return arrays

    def _log(self, step: int, values: Mapping[str, float]) -> None:
        line = {"step": step, "seconds": self._spent()["seconds"], **values}
        self.folder.mkdir(parents=True, exist_ok=True)
        with os.fdopen(open_own(self.log, os.O_WRONLY | os.O_APPEND), "a") as file:
            file.write(json.dumps(plain(line)) + "\n")

    def _progress(self, done: int, total: int) -> None:
        self.step = done
        self.on_progress(done, total)

    def _store(self, arrays: Mapping[str, np.ndarray]) -> None:
        write_atomically(self.checkpoint, as_bytes(arrays, self._spent()))


def _gpu(device: str) -> str:
    import torch

    return f"cuda ({torch.cuda.get_device_name(device)})"


def read_log(path: Path) -> list[dict[str, Any]]:
    """The lines of a log; a line cut off by a crash is left out."""
    lines = []
    if path.is_file():
        for text in path.read_text().splitlines():
            try:
                line = json.loads(text)
            except ValueError:
                continue
            if isinstance(line, dict) and isinstance(line.get("step"), int):
                lines.append(line)
    return lines


def read_curve(path: Path) -> list[list[float]]:
    """``[seconds, step, validation]`` of every validation in a log."""
    return [[x["seconds"], x["step"], x["validation"]] for x in read_log(path) if x.get("validation") is not None]


def thinned(curve: list[list[float]], count: int) -> list[list[float]]:
    """At most about ``count`` of the points of a curve, evenly spaced, including the last one."""
    step = max(1, -(-len(curve) // count))
    return curve[::-1][::step][::-1]
