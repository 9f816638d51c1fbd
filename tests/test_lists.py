"""Lists of plugins that are kept by hand: the docs name every plugin that is installed."""

import re
from pathlib import Path

import pytest

from bench.plugins.origins import installed
from bench.plugins.registry import KINDS

DOCS = Path(__file__).resolve().parents[1] / "docs"
# Where each kind is described; one of the files is enough.
PAGES = {
    "task": ("write-a-plugin.md", "cages.md", "multiview.md"),
    "dataset": ("datasets.md", "own-data.md"),
    "sensor": ("sensors.md", "own-data.md"),
    # Pseudo-methods bound the scores of metrics.
    "method": (
        "which-method.md",
        "implicit.md",
        "upsampling.md",
        "splatting.md",
        "isopoints.md",
        "multiview.md",
        "cages.md",
        "metrics.md",
        "external.md",
    ),
    "metric": ("metrics.md", "own-data.md"),
}


def words(kind):
    """The names in code, inline or in blocks, of the pages of a kind."""
    text = "\n".join((DOCS / page).read_text(encoding="utf-8") for page in PAGES[kind])
    blocks = re.findall(r"```.*?```", text, re.DOTALL)
    spans = re.findall(r"`[^`\n]+`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    return set(re.findall(r"\w+", " ".join([*blocks, *spans])))


@pytest.mark.parametrize("kind", KINDS)
def test_the_docs_name_every_plugin(kind):
    known = words(kind)
    missing = [name for name in installed(kind) if name not in known]
    assert missing == [], f"say what they are in docs/{' or docs/'.join(PAGES[kind])}"
