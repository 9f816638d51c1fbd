"""How Sphinx makes a site of README.md, CONTRIBUTING.md, CHANGELOG.md and docs/: ``make docs`` calls it.

The folder of sources is that of the repository, so that links between the files are the same here, in an editor and on
a web page that shows the repository. The pages need no network: they open from the disk, with search.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from bench import __version__  # noqa: E402

NAVIGATION = ROOT / "docs" / "navigation.toml"
SOURCES = {"docs", "README.md", "CONTRIBUTING.md", "CHANGELOG.md"}

project = "detailbench"
author = "The detailbench developers"
copyright = "2026, the detailbench developers"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
root_doc = "README"
exclude_patterns = [path.name for path in ROOT.iterdir() if path.name not in SOURCES]
myst_heading_anchors = 6
highlight_language = "bash"  # of blocks that name no language: commands
highlight_options = {"bash": {"stripnl": False}}

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_use_type_comments = False
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"detailbench {__version__}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_copy_source = False
html_show_sphinx = False
# Summaries of search results are fetched, which browsers refuse to pages from the disk.
html_show_search_summary = False


def toctrees() -> str:
    """The navigation, as directives for the first page."""
    sections = tomllib.loads(NAVIGATION.read_text(encoding="utf-8"))["section"]
    parts = []
    for section in sections:
        pages = [page.removesuffix(".md") for page in section["pages"] if page != "README.md"]
        parts.append("\n".join(["```{toctree}", ":hidden:", f":caption: {section['title']}", "", *pages, "```"]))
    return "\n\n" + "\n\n".join(parts) + "\n"


def add_navigation(app: Any, docname: str, source: list[str]) -> None:
    """README.md as it is read: its text, and the navigation that the site adds."""
    if docname == root_doc:
        source[0] += toctrees()


def copy_first_page(app: Any, failure: Exception | None) -> None:
    """The first page under the name that browsers and servers open in a folder."""
    if failure is None and app.builder.format == "html":
        shutil.copy(Path(app.outdir, f"{root_doc}.html"), Path(app.outdir, "index.html"))


def setup(app: Any) -> dict[str, bool]:
    """Connect both with the build."""
    app.connect("source-read", add_navigation)
    app.connect("build-finished", copy_first_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
