#!/usr/bin/env python
"""Print what is measured of the shapes of each family, and the tags that follow: how the thresholds were chosen.

usage: python scripts/traits.py [--split train] [--count 12] [FAMILY ...]      all families without an argument

A row a shape: the measures of bench.geometry.traits, in the order of its class, the seconds of processor time that
measuring took, and the tags.
"""

import argparse
import time
from itertools import islice

from bench.geometry.traits import all_tags
from bench.plugins.registry import registry


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*")
    parser.add_argument("--split", default="train", choices=("train", "test"))
    parser.add_argument("--count", type=int, default=12)
    args = parser.parse_args()
    plugins = [p for p in registry().all("dataset") if not hasattr(p.cls, "state")]
    print(f"{'shape':36} edges  thin contact detail genus parts boundary seconds tags")
    for plugin in plugins:
        if args.families and plugin.name not in args.families:
            continue
        for shape in islice(plugin.cls().shapes(args.split), args.count):
            _ = shape.mesh
            start = time.process_time()
            t = shape.traits
            seconds = time.process_time() - start
            tags = ", ".join(all_tags(t, shape.tags))
            print(
                f"{shape.id:36} {t.edges:5.3f} {t.thin:5.3f} {t.contact:7.3f} {t.detail:6.1f} {t.genus:5} "
                f"{t.components:5} {t.boundary_edges:8} {seconds:7.2f} {tags}",
                flush=True,
            )


if __name__ == "__main__":
    main()
