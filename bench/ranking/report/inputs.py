"""The conditions of the inputs of a table: the sentence of their task."""

from __future__ import annotations

from collections.abc import Mapping

from ...contract.task import generic_words
from ...errors import UsageError
from ...plugins.presets import resolve
from ...plugins.registry import registry


def words_of_input(task: str, medians: Mapping[str, float]) -> str:
    """The task's own sentence about the measured conditions of its inputs.

    Parameters
    ----------
    task : str
        As in rows: ``upsample``, ``upsample[ratio=16]``, or the name of a preset.
    medians : mapping
        The median over the cases of each ``input.KEY`` that is known.

    Returns
    -------
    str
        ``key=value`` where the task is not installed here, has no sentence, or finds a value missing that its sentence
        needs (results of an older version). Empty without any value.
    """
    if not medians:
        return ""
    try:
        cls = registry().find("task", resolve("task", task.partition("[")[0])).cls
        describe_words = getattr(cls, "describe_words", None)
        return describe_words(cls(), medians) if describe_words else generic_words(medians)
    except (UsageError, KeyError):
        return generic_words(medians)
