"""Write a new plugin and its test, ready to run.

  detailbench new method my_method      writes my_method.py and test_my_method.py into this folder
  detailbench new dataset|sensor|metric|task NAME [--folder DIR]

What is written passes `detailbench check my_method.py` at once, and runs with
`detailbench run --plugin my_method.py method=my_method ...`. Replace the algorithm, keep the rest.
"""

from __future__ import annotations

import argparse
import keyword
import re
from pathlib import Path

from ..authoring.scaffold import FIRST_RUNS, first_run, plugin_and_test
from ..errors import UsageError, did_you_mean
from ..plugins.registry import registry, snake_case


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", help="method, dataset, sensor, metric or task")
    parser.add_argument("name", help="the plugin's name, like my_method")
    parser.add_argument("--folder", default=".", help="where to write (this folder)")


def run(args: argparse.Namespace) -> int:
    """Write the two files."""
    kind = args.kind.lower().removesuffix("s")
    if kind not in FIRST_RUNS:
        raise UsageError(f"no template for {args.kind!r}. {did_you_mean(args.kind, FIRST_RUNS)}")
    name = snake_case(args.name.replace("-", "_"))
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise UsageError(f"{args.name!r}: expected a name of letters, digits and underscores, a letter first")
    if keyword.iskeyword(name):
        raise UsageError(f"{args.name!r} is a word of the Python language; choose another name")
    if name in registry().names(kind):
        known = registry().find(kind, name)
        raise UsageError(f"there is a {kind} {name!r} already, in {known.file}; choose another name")
    folder = Path(args.folder)
    files = dict(zip((folder / f"{name}.py", folder / f"test_{name}.py"), plugin_and_test(kind, name), strict=True))
    for path in files:
        if path.exists():
            raise UsageError(f"{path} exists; nothing was written")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, text in files.items():
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}") from error
    plugin, test = files
    print(f"wrote {plugin} and {test}; next:")
    print(f"  detailbench check {plugin}")
    print(f"  pytest {test}")
    print(f"  detailbench run --plugin {plugin} {first_run(kind, name)}")
    return 0
