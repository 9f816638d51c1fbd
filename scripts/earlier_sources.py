#!/usr/bin/env python
"""Write bench/results/earlier_sources.json: what the source digests of earlier versions stand for today.

usage: python scripts/earlier_sources.py [--verbose]

Run it in a checkout with its whole history, after the last edit of a plugin's sources before a release. It loads the
versions in REVISIONS, each in a process of its own, takes the digests that they would record for every plugin that
they ship (in a checkout, and installed from a wheel), and compares the sources with today's by the digests of today:

* equal, wherever the files stand: the old digest stands for today's;
* not equal, but all files that differ are in SAME_RESULTS: the same, since somebody has read what changed;
* not equal otherwise: the old digest stands for nothing, and results of that time are made again.

It prints what it leaves out, and with --verbose the files that differ.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "bench/results/earlier_sources.json"
REVISIONS = ("b3d9568",)  # the last version whose digests covered names of files and import lines

# Files of today that differ from those of REVISIONS while no result does, and what was changed. Whoever changes results
# by an edit of one of them takes it off this list.
MOVED, WORDS, READS = "parts of a file that was divided", "words in docstrings", "says which files it reads"
SAME_RESULTS = {
    "bench/contract/case.py": MOVED,
    "bench/contract/shape.py": f"{MOVED}; Shape.renamed; clouds as shapes, and scans",
    "bench/contract/task.py": f"{MOVED}; words for tables, worst outputs, what a sensor must give",
    "bench/geometry/cloud.py": f"{MOVED}; PointCloud.arrays and of",
    "bench/geometry/hopeless.py": "what methods/pseudo did: the same draws of the same generator",
    "bench/geometry/tiny_triangles.py": "was methods/pseudo/triangles.py",
    "bench/tasks/denoise.py": MOVED,
    "bench/tasks/detail_transfer.py": "words for tables; how many vertices are expected",
    "bench/tasks/reconstruct.py": MOVED,
    "bench/tasks/upsample.py": MOVED,
    "datasets/common/own_files.py": "was a part of datasets/files.py",
    "datasets/files.py": "a train split, of which there is none by default; messages",
    "datasets/sensors/chain.py": "says what it gives",
    "datasets/surfaces/field.py": MOVED,
    "datasets/surfaces/implicit.py": MOVED,
    "datasets/surfaces/sdf_nodes.py": WORDS,
    "methods/implicit/direct_residual.py": READS,
    "methods/implicit/fields/displaced_field.py": WORDS,
    "methods/implicit/fields/supervised_field.py": WORDS,
    "methods/implicit/fields/transfer_field.py": WORDS,
    "methods/implicit/fitting/guided.py": WORDS,
    "methods/implicit/hotspot.py": READS,
    "methods/implicit/idf.py": READS,
    "methods/implicit/idf_transfer.py": READS,
    "methods/implicit/siren.py": READS,
    "methods/learned/fitting/fitted.py": f"{MOVED}; {WORDS}; a sampler may see the field",
    "methods/learned/meshing/marching.py": MOVED,
    "methods/learned/networks/shipped.py": MOVED,
    "methods/learned/networks/sphere.py": "where the names of shipped files are made",
    "methods/learned/training/field.py": MOVED,
    "methods/learned/training/files.py": MOVED,
    "methods/learned/training/loop.py": MOVED,
    "methods/learned/training/settings.py": MOVED,
    "methods/learned/training/stages.py": WORDS,
    "methods/pseudo/empty.py": "the empty outputs stand in bench.geometry.hopeless",
    "methods/pseudo/noise.py": "the random outputs stand in bench.geometry.hopeless",
}

# Runs in an earlier version, with the path of today's module of digests: prints, for every plugin, the digest that the
# version would record, today's digest of its sources, and the bare digests of its files.
ASKED = """
import importlib, importlib.util, json, sys
from pathlib import Path

# An editable installation would find today's modules in place of those that the version has not.
sys.meta_path[:] = [one for one in sys.meta_path if not getattr(one, "__module__", "").startswith("__editable")]
import bench

def load(*names):
    for name in names:
        if importlib.util.find_spec(name.rpartition(".")[0]) and importlib.util.find_spec(name):
            return importlib.import_module(name)

registry = load("bench.plugins.registry", "bench.registry")
provenance = load("bench.results.provenance", "bench.provenance")
spec = importlib.util.spec_from_file_location("sources", sys.argv[1])
sources = importlib.util.module_from_spec(spec)
sys.modules["sources"] = sources
spec.loader.exec_module(sources)
sources.BENCH = Path(bench.__file__).resolve().parent
told = {}
for kind in registry.KINDS:
    if kind == "metric":
        continue  # their versions count
    for plugin in registry.registry().all(kind):
        closure = [sources._source(key) for key in sources._keys(plugin.file)]
        told[f"{kind} {plugin.name}"] = {
            "recorded": provenance.source_digest(plugin.file),
            "digest": sources.source_digest(plugin.file),
            "files": {str(path): sources._source(key).bare for key in sources._keys(plugin.file) for path in key[:1]},
        }
json.dump(told, sys.stdout)
"""


def plugins_of(root: Path) -> dict[str, dict[str, object]]:
    """What :data:`ASKED` prints for the version whose tree is in ``root``."""
    with tempfile.TemporaryDirectory() as cache:  # the user's listing of plugins is that of today
        environment = {**os.environ, "PYTHONPATH": str(root), "XDG_CACHE_HOME": cache}
        done = subprocess.run(
            [sys.executable, "-c", ASKED, str(ROOT / "bench/results/sources.py")],
            cwd=root,
            env=environment,
            stdout=subprocess.PIPE,
            check=True,
        )
    told = json.loads(done.stdout)
    if not told:
        raise RuntimeError(f"no plugin was found in {root}")
    return told


def trees(revision: str, folder: Path) -> Iterator[Path]:
    """The version's tree as a checkout has it, and as a wheel does, below ``folder``."""
    for layout in ("checkout", "wheel"):
        root = folder / layout
        root.mkdir()
        archive = subprocess.run(["git", "-C", str(ROOT), "archive", revision], stdout=subprocess.PIPE, check=True)
        subprocess.run(["tar", "-x", "-C", str(root)], input=archive.stdout, check=True)
        for name in ("methods", "datasets", "metrics", "conf"):
            inside = root / "bench" / name
            if layout == "wheel":
                inside.unlink(missing_ok=True)
                (root / name).rename(inside)
            elif not inside.exists():
                inside.symlink_to(root / name, target_is_directory=True)
        yield root


def changed_files(then: dict, now: dict | None) -> list[str]:
    """What differs between the sources of a plugin, by the paths of today; empty where it is the same."""
    if now is None:
        return ["it is not shipped any more"]
    if then["digest"] == now["digest"]:
        return []
    known = set(then["files"].values())
    found = [os.path.relpath(path, ROOT) for path, bare in now["files"].items() if bare not in known]
    return sorted(found) or ["its imports"]


def main() -> None:
    """Make the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--verbose", action="store_true", help="print the files that differ")
    verbose = parser.parse_args().verbose
    today, table, left_out = plugins_of(ROOT), {}, {}
    for revision in REVISIONS:
        with tempfile.TemporaryDirectory() as folder:
            for root in trees(revision, Path(folder)):
                for name, then in plugins_of(root).items():
                    changed = changed_files(then, today.get(name))
                    if verbose and changed and root.name == "checkout":
                        print(f"{name}: {', '.join(changed)}")
                    if unread := [file for file in changed if file not in SAME_RESULTS]:
                        left_out[name] = f"edited since {revision}: {', '.join(unread)}"
                    else:
                        table.setdefault(name, {})[then["recorded"]] = today[name]["digest"]
    for name, why in sorted(left_out.items()):
        print(f"left out: {name}: {why}")
    rows = {name: dict(sorted(table[name].items())) for name in sorted(table)}
    TABLE.write_text(json.dumps(rows, indent=1) + "\n")
    print(f"{sum(map(len, rows.values()))} digests of {len(rows)} plugins in {TABLE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
