#!/usr/bin/env python
"""Write datasets/catalog.json: what `detailbench list datasets` shows, and the hashes that catch drift.

usage: python scripts/freeze.py [FAMILY ...]      all families without an argument

Run it when a family is new or was changed on purpose; a changed hash in the diff is a changed benchmark, and wants a
line in the CHANGELOG.
"""

import json
import sys
from pathlib import Path

from bench.errors import UsageError
from bench.plugins.catalog import FILE, measure
from bench.plugins.registry import registry


def main() -> None:
    """Measure the families that are named, or all that make shapes of their own."""
    path = Path(__file__).parent.parent / "datasets" / FILE
    facts = json.loads(path.read_text()) if path.exists() else {}
    ours = [p for p in registry().all("dataset") if p.file.parent == path.parent and not hasattr(p.cls, "state")]
    wanted = sys.argv[1:] or [p.name for p in ours]
    unknown = set(wanted) - {p.name for p in ours}
    if unknown:
        raise UsageError(f"no family is called {', '.join(sorted(unknown))}")
    for plugin in ours:
        if plugin.name in wanted:
            facts[plugin.name] = measure(plugin)
            print(plugin.name, {k: v for k, v in facts[plugin.name].items() if k != "shapes"}, flush=True)
    facts = {name: facts[name] for name in sorted(facts) if name in {p.name for p in ours}}
    path.write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main()
