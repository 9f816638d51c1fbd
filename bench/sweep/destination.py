"""The one folder that the results of a run go to, as the command line or an experiment says it.

The front door reads results from where the jobs write them, so every job of a run has the same folder: what would give
jobs folders of their own, a sweep or an interpolation of other keys, is refused before anything runs.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ..errors import UsageError

DEFAULT = "results"
ONE = "expected one folder, results=DIR; all jobs of a run, and several runs, share it"
# ${oc.env:NAME} is the same for all jobs; anything else may not be.
OF_A_JOB = re.compile(r"\$\{(?!\s*oc\.env:)")


def destination(overrides: Sequence[str]) -> str:
    """The results folder that the overrides name, or the experiment among them.

    Raises
    ------
    UsageError
        If they name none, or more than one.
    """
    words = [word for word in overrides if _key(word) in ("results", "hydra.sweeper.params.results")]
    if not words:
        return _of_experiment(overrides)
    for word in words:
        folder = _folder(word)
    return folder


def settled(overrides: Sequence[str], folder: str) -> list[str]:
    """The overrides with that one folder in place of all that they say of it."""
    from hydra.core.override_parser.types import Quote, QuotedString

    others = [word for word in overrides if _key(word) != "results"]
    return [*others, f"results={QuotedString(folder, Quote.single).with_quotes()}"]


def _key(word: str) -> str:
    return word.partition("=")[0].strip().lstrip("+~")


def _folder(word: str) -> str:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    try:
        (override,) = OverridesParser.create().parse_overrides([word])
    except OverrideParseException as error:
        raise UsageError(f"{word}: {ONE}; unusual letters need quotes, \"results='DIR'\"") from error
    if _key(word) != "results" or override.is_delete() or override.is_sweep_override():
        raise UsageError(f"{word}: {ONE}")
    value = override.value()
    if isinstance(value, str):
        return _resolved(value, word)
    if value is None or isinstance(value, (list, dict)):
        raise UsageError(f"{word}: {ONE}")
    return _resolved(word.partition("=")[2], word)  # results=2026 is a folder, too


def _of_experiment(overrides: Sequence[str]) -> str:
    from omegaconf import OmegaConf

    from .composition import experiment_config

    config = experiment_config(overrides)
    if config is None:
        return DEFAULT
    swept: Any = OmegaConf.select(config, "hydra.sweeper.params") or {}
    where = f"{', '.join(word for word in overrides if word.startswith('experiment='))}: results"
    if DEFAULT in swept:
        raise UsageError(f"{where}={swept['results']}: {ONE}")
    folder = str(OmegaConf.to_container(config, resolve=False)["results"])
    return _resolved(folder, f"{where}={folder}")


def _resolved(text: str, said: str) -> str:
    """The folder, with variables of the environment put in."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    if OF_A_JOB.search(text):
        raise UsageError(f"{said}: {ONE}; of what ${{...}} can be, only ${{oc.env:NAME}} is the same for every job")
    try:
        folder = str(OmegaConf.create({"folder": text}).folder)
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0].rpartition("interpolation: ")[2]
        raise UsageError(f"{said}: {reason}") from error
    if not folder.strip() or folder in ("null", "???"):
        raise UsageError(f"{said}: {ONE}")
    return folder
