"""The messages of a child process to the runner: lines of JSON, each an event.

The method runs in the process that writes them, so it can write there, too. A line that is no event is refused by
:func:`read_event`, and an event out of place by the runner; but no secret can protect a process from the
code in it, and a method that forges a row of its own case, as its worker would send it, is believed.
"""

from __future__ import annotations

import json
import math
import os
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..results.store import is_row

LONGEST = 1 << 23  # bytes of one event; rows have bounds of their own, see bench.text.bounded


class NoEvent(ValueError):
    """A message of a worker is no event, or one that the worker cannot send at this point."""

    def __init__(self, reason: str):
        super().__init__(f"something other than the worker wrote to its event pipe: {reason}")


class Channel:
    """Lines of JSON to the runner.

    Attributes
    ----------
    stage : str
        The current stage, as last reported to the runner.
    """

    def __init__(self, fd: int):
        self._file = os.fdopen(fd, "wb", buffering=0)
        self._owner = os.getpid()
        self._lock = threading.Lock()
        self.stage = "start"

    def send(self, event: str, **values: Any) -> None:
        """Send one event. A process that a method forked may not send, and ends."""
        if os.getpid() != self._owner:
            os._exit(0)
        line = json.dumps({"event": event, **values}).encode() + b"\n"
        with self._lock:  # a method may report from several threads
            while line:
                line = line[self._file.write(line) or 0 :]

    def enter(self, stage: str, index: int) -> None:
        """Report the stage and the case from now on: the runner enforces the limits of that stage."""
        self.stage = stage
        self.send("begin", index=index, stage=stage)


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, (int, float)) and abs(value) < 2**63)


def _is_index(value: Any) -> bool:
    return type(value) is int and -1 <= value < 2**63


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_end(value: Any) -> bool:
    """Whether it is the status of something outside records, such as a plan."""
    return isinstance(value, dict) and is_row({"case": "", "case_index": 0, **value})


def _is_result(value: Any) -> bool:
    """Whether it is the result of a single call, whose status is its own."""
    return isinstance(value, dict) and _is_text(value.get("status")) and _is_end({**value, "status": "ok"})


def _are_worst(value: Any) -> bool:
    return _is_end({"status": "ok", **value}) and all(key.startswith("worst.") or key == "directions" for key in value)


# The events, their values, and the check of each.
EVENTS: dict[str, dict[str, Callable[[Any], bool]]] = {
    "begin": {"stage": _is_text, "index": _is_index},
    "cases": {"ids": lambda value: isinstance(value, list) and all(map(_is_text, value))},
    "row": {"row": is_row},
    "no_plan": {"row": _is_end},
    "result": {"row": _is_result},
    "worst": {"index": _is_index, "row": lambda value: isinstance(value, dict) and _are_worst(value)},
    "progress": {"done": _is_number, "total": _is_number},
    "doing": {"what": _is_text},
    "pause": {},
    "resume": {},
    "replace": {},
    "done": {},
}


def read_event(line: bytes) -> dict[str, Any]:
    """One line of a child process.

    Raises
    ------
    NoEvent
        If it is none of :data:`EVENTS` with the right values.
    """
    try:
        event = json.loads(line)
    except (ValueError, RecursionError) as error:  # no JSON, no UTF-8, or nested too deeply
        raise NoEvent(f"a line that is not an event ({line[:40]!r})") from error
    kind = event.get("event") if isinstance(event, dict) else None
    values = EVENTS.get(kind) if isinstance(kind, str) else None
    if values is None:
        raise NoEvent(f"a line that is not an event ({line[:40]!r})")
    for name, fits in values.items():
        if not fits(event.get(name)):
            raise NoEvent(f"an event {kind!r} with an invalid {name!r}")
    return event


def plain(value: Any) -> Any:
    """A value for JSON: numpy scalars become Python's, not-a-number becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else value
    return value
