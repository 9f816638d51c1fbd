"""The lines that install what is missing. detailbench itself is on no index, so they name its libraries."""

from __future__ import annotations

import importlib.metadata
import re


def line_of_extra(extra: str) -> str:
    """The command that installs what an extra of pyproject.toml names: ``pip install "joblib<1.6" ...``."""
    try:
        wanted = importlib.metadata.requires("detailbench") or []
    except importlib.metadata.PackageNotFoundError:  # a source tree that is on the path and not installed
        wanted = []
    found = [_plain(line) for line in wanted if re.search(rf"extra\s*==\s*['\"]{re.escape(extra)}['\"]", line)]
    if not found:
        return f'pip install ".[{extra}]" in the folder of detailbench'
    return f"pip install {' '.join(found)}"


def _plain(requirement: str) -> str:
    """A requirement without its conditions, in quotes where a shell would take a letter of it for its own."""
    text = requirement.partition(";")[0].replace(" ", "")
    return f'"{text}"' if re.search(r"[<>!*\[]", text) else text
