"""What a child process tells the runner: lines of JSON."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np


class Channel:
    """Lines of JSON to the runner.

    Attributes
    ----------
    stage : str
        What is being done, as the runner was told last.
    """

    def __init__(self, fd: int):
        self._file = os.fdopen(fd, "wb", buffering=0)
        self._owner = os.getpid()
        self.stage = "start"

    def send(self, event: str, **values: Any) -> None:
        """Send one event. A process that a method forked has nothing to say here, and ends."""
        if os.getpid() != self._owner:
            os._exit(0)
        line = json.dumps({"event": event, **values}).encode() + b"\n"
        while line:
            line = line[self._file.write(line) or 0 :]

    def enter(self, stage: str, index: int) -> None:
        """Say what is done from now on, for which case: the runner watches the limits of that stage."""
        self.stage = stage
        self.send("begin", index=index, stage=stage)


def plain(value: Any) -> Any:
    """As JSON can hold it: numpy scalars become Python's, not-a-number becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else value
    return value
