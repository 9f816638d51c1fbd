"""Sets of metrics: those of the config group ``metric``, such as ``standard``, and ``full``, which no file lists.

``full`` is every metric of an installed distribution, ours or another one, in alphabetical order. Metrics of
``--plugin`` files are added by name: ``metric=[full,my_metric]``. Otherwise a file that brings a method for a try would
give all cells of a sweep new ids.
"""

from __future__ import annotations

import functools

from .origins import installed

FULL = "full"


def metric_set(name: str) -> list[str] | None:
    """The names of the metrics in a set; None where no set has that name."""
    return installed("metric") if name == FULL else _of_file(name)


@functools.cache
def _of_file(name: str) -> list[str] | None:
    from importlib.resources import files

    import yaml

    file = files("bench.conf") / "metric" / f"{name}.yaml"
    return yaml.safe_load(file.read_text(encoding="utf-8"))["defaults"] if file.is_file() else None
