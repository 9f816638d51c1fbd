"""The lists in docs/tasks/*.md: methods, datasets, sensors and metrics of each task, as the registry has them.

    python scripts/task_lists.py            # write them anew
    python scripts/task_lists.py --check    # exit code 1 where a page has others

They stand between two comments of a page; what is around them is written by hand.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from bench.plugins.origins import is_installed
from bench.plugins.registry import Plugin, registry

ROOT = Path(__file__).resolve().parents[1]
BEGIN = "<!-- These lists come from the plugins: python scripts/task_lists.py writes them. -->"
END = "<!-- The end of the lists. -->"
# What a dataset must have for a task; `shapes` for all others.
SOURCES = {"deform": "pairs", "detail_transfer": "pairs", "pose_transfer": "transfers"}
ATTRIBUTES = {"detail_transfer": "base_vertices"}  # that its shapes have


def page_of(task: str) -> Path:
    """The page of a task."""
    return ROOT / "docs" / "tasks" / f"{task}.md"


def _plugins(kind: str) -> list[Plugin]:
    return [plugin for plugin in registry().all(kind) if is_installed(plugin)]


def _codes(plugins: Iterable[Plugin]) -> str:
    return ", ".join(f"`{plugin.name}`" for plugin in plugins)


def _methods(task: Plugin) -> str:
    solving = [plugin for plugin in _plugins("method") if plugin.solves(task.name)]
    bounds = [plugin for plugin in solving if plugin.file.parent.name == "pseudo"]
    rows = [
        f"| `{plugin.name}` | {_cell(plugin.summary)} | {_cell(plugin.cite)} |"
        for plugin in solving
        if plugin not in bounds
    ]
    lines = ["| method | what it does | source |", "| --- | --- | --- |", *rows, ""]
    return "\n".join([*lines, f"For comparison only: {_codes(bounds)}.\n"])


def _cell(text: str) -> str:
    return re.sub(r"``(.*?)``", r"`\1`", text).replace("|", "\\|")


def _datasets(task: Plugin) -> str:
    source, attribute = SOURCES.get(task.name, "shapes"), ATTRIBUTES.get(task.name, "")
    found = [
        plugin
        for plugin in _plugins("dataset")
        if hasattr(plugin.cls, source) and attribute in inspect.getsource(inspect.getmodule(plugin.cls))
    ]
    return f"{_codes(found)}.\n"


def _sensors(task: Plugin) -> str:
    takes = task.cls.takes
    if takes == "none":
        return "None: the input is made from the shapes as they are.\n"
    found = [p for p in _plugins("sensor") if p.options.get("gives", "cloud") == takes or p.name == "chain"]
    return f"{_codes(found)}.\n"


def _metrics(task: Plugin) -> str:
    found = [plugin for plugin in _plugins("metric") if task.cls.output in plugin.options["outputs"]]
    first = " and ".join(f"`{score}`" for score in task.cls.primary)
    how = "ranks the methods" if len(task.cls.primary) == 1 else "are shown as a Pareto front"
    return f"{first} {how}. All that apply: {_codes(found)}.\n"


def lists(task: Plugin) -> str:
    """The part of a page that is not written by hand."""
    parts = {"Methods": _methods, "Datasets": _datasets, "Sensors": _sensors, "Metrics": _metrics}
    return "\n".join([BEGIN, "", *(f"## {title}\n\n{part(task)}" for title, part in parts.items()), END])


def with_lists(text: str, task: Plugin) -> str:
    """A page with the lists of today."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"{page_of(task.name)}: expected the lines {BEGIN} and {END}")
    return before + lists(task) + after


def stale() -> list[Path]:
    """The pages that have other lists."""
    return [
        page for task in _plugins("task") if with_lists(text := (page := page_of(task.name)).read_text(), task) != text
    ]


def main() -> int:
    """Write the lists, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing")
    if parser.parse_args().check:
        pages = stale()
        print("\n".join(f"{page.relative_to(ROOT)}: other lists" for page in pages))
        return int(bool(pages))
    for task in _plugins("task"):
        page = page_of(task.name)
        page.write_text(with_lists(page.read_text(), task))
    return 0


if __name__ == "__main__":
    sys.exit(main())
