"""The one folder for the results of a run, set by the command line or an experiment.

The front door reads results where the jobs write them, so all jobs of a run have the same folder: overrides that give
jobs folders of their own, a sweep or an interpolation of other keys, are refused before anything runs.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from .request import Request, parse, text_of

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

DEFAULT = "results"
ONE = "expected one folder, results=DIR; all jobs of a run, and several runs, share it"
SWEPT = "hydra.sweeper.params.results"
# ${oc.env:NAME} is the same for all jobs; anything else may not be.
OF_A_JOB = re.compile(r"\$\{(?!\s*oc\.env:)")


def settled(request: Request) -> Request:
    """The request with its one results folder in place of all overrides of it, its experiment's included.

    Raises
    ------
    UsageError
        If there is none, or more than one.
    """
    from hydra.core.override_parser.types import Quote, QuotedString

    said = [override for override in request.overrides if override.key_or_group in ("results", SWEPT)]
    folder = [_folder(override) for override in said][-1] if said else _of_experiment(request)
    others = tuple(override for override in request.overrides if override.key_or_group != "results")
    word = f"results={QuotedString(folder, Quote.single).with_quotes()}"
    return replace(request, overrides=(*others, parse(word)), folder=folder)


def _folder(override: Override) -> str:
    word = text_of(override)
    if override.key_or_group == SWEPT or override.is_delete() or override.is_sweep_override():
        raise UsageError(f"{word}: {ONE}")
    value = override.value()
    if isinstance(value, str):
        return _resolved(value, word)
    if value is None or isinstance(value, (list, dict)):
        raise UsageError(f"{word}: {ONE}")
    return _resolved(word.partition("=")[2], word)  # results=2026 is a folder, too


def _of_experiment(request: Request) -> str:
    from omegaconf import OmegaConf

    config = request.experiment
    if config is None:
        return DEFAULT
    swept: Any = OmegaConf.select(config, "hydra.sweeper.params") or {}
    where = f"{', '.join(text_of(override) for override in request.about('experiment'))}: results"
    if DEFAULT in swept:
        raise UsageError(f"{where}={swept['results']}: {ONE}")
    values: Any = OmegaConf.to_container(config, resolve=False)
    folder = str(values["results"])
    return _resolved(folder, f"{where}={folder}")


def _resolved(text: str, said: str) -> str:
    """The folder, with environment variables resolved."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    if OF_A_JOB.search(text):
        raise UsageError(f"{said}: {ONE}; of all ${{...}}, only ${{oc.env:NAME}} has one value for all jobs")
    try:
        folder = str(OmegaConf.create({"folder": text}).folder)
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0].rpartition("interpolation: ")[2]
        raise UsageError(f"{said}: {reason}") from error
    if not folder.strip() or folder in ("null", "???"):
        raise UsageError(f"{said}: {ONE}")
    return folder
