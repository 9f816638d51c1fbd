"""Write the results as one page for a browser: tables, charts, cases, failures and shapes, without network or server.

  detailbench report                                       of the folder `results`, as report.html
  detailbench report DIR [DIR ...] -o page.html --title "Breadth of July"
  detailbench report DIR --task reconstruct --sensor noisy,scanned
  detailbench report DIR --published table_4_2             a paper's numbers beside ours

The page has the numbers of `detailbench leaderboard`, with intervals of means and ranks; it opens from the disk, and
can be sent as it is. A link to it restores the view. Saved outputs (outputs=first or all) are shown in 3-D, simplified
so that all shapes stay within --shapes megabytes. docs/report.md shows the page.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..text import below, counted, shown_streams

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pandas as pd

    from ..pages.shapes import Track
    from ..results.store import Results

MEGABYTES = 8.0  # of shapes, if a page has room for them
PAGE = 10.0  # largest page in megabytes, if its tables leave room for shapes
LEAST = 2.0  # megabytes of shapes in a page with large tables
FILTERS = ("task", "dataset", "sensor", "method", "tag", "split")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("-o", "--output", default="report.html", metavar="FILE", help="the page (default: report.html)")
    add_page_arguments(parser)


def add_page_arguments(parser: argparse.ArgumentParser) -> None:
    """The options common to a page and a site."""
    parser.add_argument("results", nargs="*", metavar="RESULTS", help="folders of results (default: results)")
    parser.add_argument("--title", metavar="TEXT", help="of the page (default: the names of the folders)")
    for name in FILTERS:
        parser.add_argument(f"--{name}", metavar="NAMES", help=f"only these {name}s: one, or several with commas")
    named = "experiments whose papers' numbers stand beside ours (default: those whose datasets the results have)"
    parser.add_argument("--published", metavar="NAMES", help=named)
    size = f"of all shapes together, in the page; 0: no 3-D view (default: {MEGABYTES:g}, or what {PAGE:g} leave)"
    parser.add_argument("--shapes", type=float, metavar="MB", help=size)
    parser.add_argument("--level", type=float, default=0.95, help="of the intervals (default: 0.95)")
    parser.add_argument(
        "--equal", type=float, default=0.02, metavar="SHARE", help="differences below count as equal (default: 0.02)"
    )
    parser.add_argument("--no-index", action="store_true", help="read every file, do not use or write the index")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write the page."""
    from ..pages.assemble import one_file
    from ..results.files import write_atomically

    target = Path(args.output)
    if target.is_dir():
        raise UsageError(f"--output {args.output}: is a folder; name a file such as {target / 'report.html'}")
    data, geometry = gathered(args)
    content = one_file(data, geometry).encode()
    write_atomically(target, content)
    print(f"{target}: {len(content) / 1e6:.1f} MB, {described(data)}")
    return 0


def gathered(args: argparse.Namespace, usual: float | None = None) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The data of the page, and its shapes: by default of ``usual`` megabytes, or as many as fit on one page."""
    from ..pages.data import page_data

    rows, folders = chosen_rows(args)
    data = page_data(
        rows,
        folders,
        title=args.title or titled(args.results),
        level=args.level,
        equal=args.equal,
        published=_names(args.published),
    )
    megabytes = args.shapes if args.shapes is not None else usual or _room(data)
    scenes, geometry = _shapes(folders, rows, megabytes)
    return data | {"scenes": scenes}, geometry


def chosen_rows(args: argparse.Namespace) -> tuple[pd.DataFrame, Sequence[Results]]:
    """The rows that pass the filters, and their folders."""
    from ..ranking.selection import select
    from ..results.store import Results
    from .leaderboard import read_rows

    if args.plugin:
        load_plugins(args.plugin)
    if not 0 < args.level < 1:
        raise UsageError(f"--level {args.level}: expected a number between 0 and 1")
    if args.shapes is not None and not args.shapes >= 0:
        raise UsageError(f"--shapes {args.shapes:g}: expected megabytes, 0 for no 3-D view")
    folders = args.results or ["results"]
    rows = read_rows(folders, use_index=not args.no_index)
    rows = select(rows, **{name: getattr(args, name) for name in FILTERS})
    return rows.reset_index(drop=True), [Results(word.removeprefix("results=")) for word in folders]


def titled(folders: Sequence[str]) -> str:
    """A title from the names of the folders."""
    names = [Path(word.removeprefix("results=")).absolute().name for word in folders] or ["results"]
    return ", ".join(dict.fromkeys(names))


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def _room(data: dict[str, Any]) -> float:
    """Megabytes for shapes in a page with this data."""
    from ..pages.assemble import one_file

    rest = len(one_file(data | {"scenes": []}, {})) / 1e6
    return min(MEGABYTES, max(PAGE - rest, LEAST))


def _shapes(folders: Sequence[Results], rows: pd.DataFrame, megabytes: float) -> tuple[list[dict], dict[str, bytes]]:
    """Scenes and shapes of the outputs stored in the results; none if there are none."""
    if not megabytes or "output" not in rows or not rows["output"].fillna("").astype(bool).any():
        return [], {}
    try:
        from ..pages.shapes import scenes
    except ImportError as error:
        print(f"note: no 3-D view: {error}", file=sys.stderr)
        return [], {}
    outputs = int(rows["output"].fillna("").astype(bool).sum())
    print(f"packing the shapes of {counted(outputs, 'output')}; --shapes 0 leaves them out", file=sys.stderr)
    with progress_bar() as track:
        return scenes(folders, rows, int(megabytes * 1e6 * 3 / 4), track)  # base64 makes four letters of three bytes


@contextlib.contextmanager
def progress_bar() -> Iterator[Track]:
    """A bar on a terminal, and nothing elsewhere."""
    from ..pages.shapes import untracked

    if not sys.stderr.isatty():
        yield untracked
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(bar_width=24), MofNCompleteColumn()
    console = Console(file=below(sys.stderr), emoji=False)
    with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as progress, shown_streams():

        def track(items: Sequence[Any], text: str) -> Iterator[Any]:
            task = progress.add_task(text, total=len(items))
            for item in items:
                yield item
                progress.advance(task)
            progress.remove_task(task)

        yield track


def described(data: dict[str, Any]) -> str:
    """``1,242 cases of 24 methods, 12 scenes``."""
    about = data["about"]
    scenes = f", {len(data['scenes'])} scenes" if data["scenes"] else ""
    return f"{about['rows']:,} cases, {about['methods']} methods, {len(data['groups'])} tables{scenes}"
