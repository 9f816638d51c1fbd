"""A paper's numbers beside ours."""

from __future__ import annotations

from typing import Any


def comparisons(rows, published, *, level: float) -> list[dict[str, Any]]:
    """To come."""
    return []
