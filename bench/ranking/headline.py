"""The metric that ranks a table if the user names none: the task's own choice."""

from __future__ import annotations

from ..errors import UsageError
from ..plugins.registry import registry


def primary_metrics(task: str) -> tuple[str, ...]:
    """The scores that a task's tables are ranked by, see ``Task.primary``.

    Parameters
    ----------
    task : str
        As in the column ``task`` of results: ``upsample[ratio=8]`` is the task ``upsample``.

    Returns
    -------
    tuple of str
        Empty for a task that declares none, and for one that is not installed: results can be read without the plugin
        that made them.
    """
    try:
        plugin = registry().find("task", task.partition("[")[0])
    except UsageError:
        return ()
    named = getattr(plugin.cls, "primary", ())
    return (named,) if isinstance(named, str) else tuple(named)
