"""The device of a method: the processor, or a GPU, which is checked, addressed by its number and claimed.

torch is imported only where a GPU is asked for: it takes seconds.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Iterator

from ..errors import MissingLibrary, UsageError
from ..plan.devices import check_name
from ..plugins.registry import install_line
from .affinity import hold

LOOK = 0.2  # seconds between looks at a GPU that another cell holds


def check_device(device: str) -> None:
    """Raise :class:`UsageError` unless this machine has the device: a result comes from the device that it names."""
    check_name(device)
    if device == "cpu":
        return
    try:
        import torch
    except ImportError as error:
        raise UsageError(f"device={device}: {MissingLibrary('torch', install_line('torch'))}") from error
    if not torch.cuda.is_available():
        raise UsageError(f"device={device}: torch {torch.__version__} sees no GPU on this machine; use device=cpu")
    count = torch.cuda.device_count()
    if index_of(device) >= count:
        known = ", ".join(f"cuda:{index}" for index in range(count))
        raise UsageError(f"device={device}: torch sees no such GPU on this machine; expected {known}")


def index_of(device: str) -> int:
    """The number of a GPU: ``cuda`` is the first."""
    return int(device.partition(":")[2] or 0)


def make_context(device: str) -> None:
    """Initialise a GPU in this process, so that the driver's time and memory are not charged to a method.

    From here on, ``cuda`` without a number means this one, in the calling thread.
    """
    if device == "cpu":
        return
    import torch

    torch.cuda.set_device(index_of(device))
    torch.zeros(1, device=device)
    torch.cuda.synchronize(device)


@contextlib.contextmanager
def claim_device(device: str, alive: Callable[[], None] = lambda: None) -> Iterator[str]:
    """Hold a GPU that no other cell of this user holds, and wait until it is free; ``cuda`` is any free one.

    Parameters
    ----------
    device : ``cpu`` (nothing is held), ``cuda`` or ``cuda:N``
    alive : called while waiting; raises to stop

    Yields
    ------
    str
        The device to use: ``cuda`` becomes ``cuda:N`` where it is not the first.
    """
    if device == "cpu" or not (count := _count()):
        yield device
        return
    candidates = [device] if ":" in device else [device, *(f"cuda:{n}" for n in range(1, count))]
    while True:
        for candidate in candidates:
            with hold(f"gpu-{_physical(index_of(candidate))}") as held:
                if held:
                    yield candidate
                    return
        alive()
        time.sleep(LOOK)


def _count() -> int:
    """How many GPUs torch sees; 0 if torch is not installed."""
    try:
        import torch
    except ImportError:
        return 0  # the worker reports what is missing
    return torch.cuda.device_count() if torch.cuda.is_available() else 0


def _physical(index: int) -> str:
    """A name of this GPU that does not depend on CUDA_VISIBLE_DEVICES, which renumbers GPUs by process."""
    visible = [name.strip() for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name.strip()]
    name = visible[index] if index < len(visible) else str(index)
    return re.sub(r"[^A-Za-z0-9-]", "_", name)
