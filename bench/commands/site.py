"""Write the results as a folder of pages for any static host: an index, and a page per task, dataset and method.

  detailbench site                                         of the folder `results`, into site/
  detailbench site DIR [DIR ...] -o public --title "Breadth of July"
  detailbench site DIR --task reconstruct --shapes 40      with 40 MB of shapes, which load when they are looked at

The pages are those of `detailbench report`, and open from the disk too. The folder must be new, empty, or hold an
earlier site, whose old pages are deleted. docs/report.md shows the pages.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .report import MEGABYTES, add_page_arguments, described, gathered


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("-o", "--output", default="site", metavar="FOLDER", help="where to (default: site)")
    add_page_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Write the pages."""
    from ..pages.site import earlier_files, site, write_site

    folder = Path(args.output)
    earlier_files(folder)  # refuse at once what would be refused at the end
    data, geometry = gathered(args, MEGABYTES)
    files = site(data, geometry)
    write_site(folder, files)
    pages = sum(name.endswith(".html") for name in files)
    size = sum(len(content) for content in files.values()) / 1e6
    print(f"{folder / 'index.html'}: {pages} pages, {size:.1f} MB, {described(data)}")
    return 0
