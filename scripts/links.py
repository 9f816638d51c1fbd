"""Broken links in README.md, CONTRIBUTING.md, CHANGELOG.md and docs/: files and anchors that are not there.

    python scripts/links.py

It prints a line for each and ends with exit code 1 if there are any. It opens no network: links to other sites are not
followed. ``tests/test_docs.py`` and the hooks of pre-commit call it.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[1]
TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def pages(root: Path = ROOT) -> list[Path]:
    """The pages of the site."""
    return [root / name for name in TOP] + sorted((root / "docs").rglob("*.md"))


@cache
def _inlines(page: Path) -> list[tuple[str, int, list]]:
    """For each inline text of a page: the tag around it, its line, and what it holds."""
    tokens = MarkdownIt("commonmark").enable("table").parse(page.read_text(encoding="utf-8"))
    found, line, tag = [], 1, ""
    for token in tokens:
        line = token.map[0] + 1 if token.map else line
        tag = token.tag if token.nesting == 1 else tag
        if token.type == "inline":
            found.append((tag, line, token.children or []))
    return found


def links(page: Path) -> Iterator[tuple[int, str]]:
    """Line and target of each link and each image."""
    for _, line, children in _inlines(page):
        for child in children:
            target = child.attrGet("href") if child.type == "link_open" else child.attrGet("src")
            if target:
                yield line, str(target)


def anchors(page: Path) -> set[str]:
    """The anchors of the headings, as web pages of repositories and the site make them."""
    seen: Counter[str] = Counter()
    found = set()
    for tag, _, children in _inlines(page):
        if re.fullmatch("h[1-6]", tag):
            text = "".join(child.content for child in children if child.type in ("text", "code_inline"))
            slug = re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")
            found.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
            seen[slug] += 1
    return found


def broken(root: Path = ROOT) -> list[str]:
    """A line for each link that leads nowhere."""
    found = []
    for page in pages(root):
        for line, link in links(page):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            where = f"{page.relative_to(root)}:{line}: {link}"
            if not target.exists():
                found.append(f"{where}: there is no such file")
            elif not target.is_relative_to(root):
                found.append(f"{where}: outside of the repository")
            elif parts.fragment and (target.suffix != ".md" or parts.fragment not in anchors(target)):
                found.append(f"{where}: there is no such heading")
    return found


if __name__ == "__main__":
    problems = broken()
    print("\n".join(problems), end="\n" if problems else "")
    sys.exit(bool(problems))
