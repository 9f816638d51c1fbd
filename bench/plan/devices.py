"""The names of devices."""

from __future__ import annotations

import re

from ..errors import UsageError


def check_name(device: str) -> None:
    """Raise :class:`UsageError` unless this is ``cpu``, ``cuda`` or ``cuda:N``."""
    if not re.fullmatch(r"cpu|cuda(:(0|[1-9][0-9]{0,2}))?", device):
        raise UsageError(f"device={device}: expected cpu, cuda or cuda:N, with the number of a GPU from 0")
