"""The clock and the memory of one method call."""

from __future__ import annotations

import contextlib
import gc
import math
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

MAXRSS_PER_MB = 2**20 if sys.platform == "darwin" else 1024  # the unit of ru_maxrss


class Meter:
    """Measures the code inside ``with meter:``: wall and processor seconds, and the peak of resident memory.

    Memory is that of the largest process: this one, or one that the method started and waited for (where there were
    several such calls in one process, the largest of all that were started so far).

    On a GPU, that device is waited for before the clock is read, and its peak of allocated memory is taken; the process
    must have begun to use it before (:func:`bench.engine.devices.make_context`).

    Inside, the process may allocate ``memory_gb`` beyond what it has; an allocation past that fails at once, even
    when it is never touched.
    """

    def __init__(self, memory_gb: float, device: str):
        self.memory_gb, self.device = memory_gb, device
        self._limits = resource.getrlimit(resource.RLIMIT_DATA)

    def __enter__(self) -> Meter:
        gc.collect()
        self._wall = self._cpu = 0.0
        self._peak = self._before = resident_mb("VmRSS")
        self._device_peak = math.nan
        self._synchronise()  # work that started before the call is not timed
        self._reset_peaks()
        if self.device == "cpu":  # on a GPU the driver maps far more than it uses
            allowed = int(resident_mb("VmData") * 2**20 + self.memory_gb * 2**30)
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(resource.RLIMIT_DATA, (allowed, self._limits[1]))
        self._start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop()
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_DATA, self._limits)

    @contextlib.contextmanager
    def paused(self) -> Any:
        """Pause while a trace is scored."""
        self._stop()
        try:
            yield
        finally:
            self._reset_peaks()
            self._start()

    def _start(self) -> None:
        self._cpu_begin = cpu_seconds()
        self._children_begin = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        self._wall_begin = time.perf_counter()

    def _stop(self) -> None:
        self._synchronise()
        self._wall += time.perf_counter() - self._wall_begin
        self._cpu += cpu_seconds() - self._cpu_begin
        if cuda := self._cuda:
            self._device_peak = np.fmax(self._device_peak, cuda.max_memory_allocated(self.device) / 2**20)
        self._peak = max(self._peak, resident_mb("VmHWM"))
        if (children := resource.getrusage(resource.RUSAGE_CHILDREN)).ru_utime > self._children_begin:
            self._peak = max(self._peak, children.ru_maxrss / MAXRSS_PER_MB)

    def _synchronise(self) -> None:
        """A GPU works asynchronously: wait for it before reading the clock."""
        if cuda := self._cuda:
            cuda.synchronize(self.device)

    def _reset_peaks(self) -> None:
        with contextlib.suppress(OSError):  # without it the peak is that of the whole process so far
            Path("/proc/self/clear_refs").write_text("5")
        if cuda := self._cuda:
            cuda.reset_peak_memory_stats(self.device)

    @property
    def _cuda(self) -> Any:
        """``torch.cuda`` where the device is a GPU; None where it is not, or nobody has begun to use it."""
        return sys.modules["torch"].cuda if self.device != "cpu" and "torch" in sys.modules else None

    def figures(self) -> dict[str, float]:
        """The measurements."""
        return {
            "seconds": self._wall,
            "cpu_seconds": self._cpu,
            "peak_rss_mb": self._peak,
            "rss_before_mb": self._before,
            "peak_device_mb": float(self._device_peak),
        }


def resident_mb(key: str) -> float:
    """A figure of /proc/self/status in MiB; elsewhere than on Linux the peak of the whole process."""
    with contextlib.suppress(OSError), open("/proc/self/status") as status:
        for line in status:
            if line.startswith(key + ":"):
                return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MAXRSS_PER_MB


def cpu_seconds() -> float:
    """Processor seconds of all threads of this process, and of its children that ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
