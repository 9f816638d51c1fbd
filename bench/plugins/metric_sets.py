"""Sets of metrics: those of the config group ``metric``, such as ``standard``, and ``full``, which no file lists.

``full`` is every metric of an installed distribution, ours or another one, in alphabetical order. Metrics of
``--plugin`` files are added by name: ``metric=[full,my_metric]``. Otherwise a file with a method under trial would
give all cells of a sweep new ids.
"""

from __future__ import annotations

import functools

from ..errors import UsageError
from .config_files import ConfigFile, file_of
from .origins import installed

FULL = "full"


def metric_set(name: str) -> list[str] | None:
    """The names of the metrics in a set; None if no set has that name."""
    return installed("metric") if name == FULL else _of_file(name)


def _of_file(name: str) -> list[str] | None:
    file = file_of("metric", name)
    return _defaults(file) if file else None


@functools.cache
def _defaults(file: ConfigFile) -> list[str]:
    import yaml

    try:
        content = yaml.safe_load(file.text())
    except yaml.YAMLError as error:
        raise UsageError(f"{file.path}: cannot be read as YAML: {' '.join(str(error).split())}") from error
    chosen = content.get("defaults") if isinstance(content, dict) else None
    if not isinstance(chosen, list) or not all(isinstance(name, str) for name in chosen):
        raise UsageError(f"{file.path}: expected the names of metrics, for instance defaults: [p2f_mean, hausdorff]")
    return [name for name in chosen if name != "_self_"]
