"""Fetch the data of a dataset that is not procedural. The data are not part of this package.

  detailbench fetch                               list the datasets that can be fetched, and whether they are there
  detailbench fetch real                          download, check and unpack what is missing
  detailbench fetch real dataset.path=FOLDER      to another folder; give `run` the same arguments

Versions are pinned and checked by their SHA-256. An interrupted download continues where it ended; a file that you
put into FOLDER/downloads yourself is used. No root is needed.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..plugins.registry import Plugin, load_plugins, registry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("what", nargs="*", metavar="NAME|dataset.KEY=VALUE", help="a dataset, and its parameters")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Fetch one dataset, or list those that can be."""
    from ..sweep.quoting import is_override

    load_plugins(args.plugin)
    known = {plugin.name: plugin for plugin in registry().all("dataset") if hasattr(plugin.cls, "fetch")}
    overrides = [word for word in args.what if is_override(word)]
    names = [word for word in args.what if word not in overrides]
    if not names and not overrides:
        for name, plugin in known.items():
            print(f"{name}: {_how_it_is(plugin)}")
        return 0
    if len(names) != 1 or names[0] not in known:
        wrong = did_you_mean(names[0], known) if len(names) == 1 else f"Known: {', '.join(known)}."
        raise UsageError(f"{' '.join(names) or 'no name'}: expected one dataset that can be fetched. {wrong}")
    _built(known[names[0]], overrides).fetch(lambda line: print(line, file=sys.stderr, flush=True))
    return 0


def _how_it_is(plugin: Plugin) -> str:
    from ..plan.cell import check_dataset

    dataset = plugin.cls()
    try:
        check_dataset(dataset, "test")
    except UsageError as error:
        return str(error)
    return f"there, in {dataset.folder}" if hasattr(dataset, "folder") else "there"


def _built(plugin: Plugin, overrides: list[str]) -> Any:
    """The dataset with the parameters of the overrides."""
    from ..plugins.schema import build
    from ..sweep.overrides import checked

    foreign = [word for word in overrides if not word.startswith("dataset.")]
    if foreign:
        raise UsageError(f"{foreign[0]}: expected parameters of the dataset, dataset.KEY=VALUE")
    return build(plugin, checked([f"dataset={plugin.name}", *overrides], "fetch").values["dataset"])
