#!/usr/bin/env python
"""Read damaged geometry files, and count what becomes of them: each is refused in words, or is whole and finite.

usage: python scripts/fuzz_files.py [--files 20000] [--seed 0] [--keep FOLDER] [--only .ply]

Each file is a sound one of some format with one to four mutations, read once as a mesh and once as a point cloud by the
functions that all commands use. The exit code is 1 when anything else happened: an error that is no BadInput, a
warning that is no notice, a message that does not name the file or is too long, a geometry that is not finite, a read
of more than 5 seconds or of more than 1 GB. The smallest file of each kind is kept in FOLDER. A seed gives the same
files again.
"""

import argparse
import contextlib
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from damaged_files import mutated

from bench import BadInput
from bench.geometry.io.files import load_cloud, load_mesh
from bench.notices import collected

LONG, SECONDS, MEMORY_MB = 1500, 5.0, 1024


def peak_mb() -> float:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class Hang(Exception):
    """The read took too long."""


@contextlib.contextmanager
def no_longer_than(seconds: float):
    """Raise :class:`Hang` inside after so many seconds."""

    def stop(*_):
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def is_whole(geometry) -> bool:
    """Whether what was read is finite, so are its sizes, and its faces name vertices that are there."""
    if hasattr(geometry, "faces"):
        V, F = geometry.vertices, geometry.faces
        inside = len(F) and F.min() >= 0 and F.max() < len(V)
        return bool(inside and np.isfinite(V).all() and 0 < geometry.area < np.inf)
    lengths = [] if geometry.normals is None else np.linalg.norm(geometry.normals, axis=1)
    colors = np.zeros(0) if geometry.colors is None else geometry.colors
    with np.errstate(over="ignore"):
        spread = ((geometry.points - geometry.points.mean(axis=0)) ** 2).sum()
    return bool(0 < spread < np.inf and np.allclose(lengths, 1) and ((colors >= 0) & (colors <= 1)).all())


def outcome(path: Path, load) -> str:
    """``refused`` or ``whole``, or what is wrong."""
    before = peak_mb()
    try:
        with collected(), warnings.catch_warnings(), no_longer_than(SECONDS):
            warnings.simplefilter("error")
            found = "whole" if is_whole(load(path)) else "not finite"
    except BadInput as error:
        named, message = str(path) in str(error), str(error)
        found = "refused" if named and len(message) < LONG and message.isprintable() else "poor message"
        found = (
            "refused" if found == "poor message" and "\nBy its content" in message and len(message) < LONG else found
        )
    except Hang:
        found = "hang"
    except Exception as error:  # the point of this script
        frame = error.__traceback__
        while frame.tb_next:
            frame = frame.tb_next
        found = f"{type(error).__name__} in {Path(frame.tb_frame.f_code.co_filename).name}: {str(error)[:60]}"
    return "memory" if peak_mb() - before > MEMORY_MB else found


def fuzz(count: int, seed: int, folder: Path, only: str = "") -> tuple[Counter, dict[str, tuple[str, bytes]]]:
    """How often each outcome was met, and of each bad one the smallest file."""
    counts: Counter = Counter()
    kept: dict[str, tuple[str, bytes]] = {}
    for suffix, data in mutated(count, seed, only):
        path = folder / f"damaged{suffix}"
        path.write_bytes(data)
        for load in (load_mesh, load_cloud):
            found = outcome(path, load)
            counts[found] += 1
            if found not in ("refused", "whole") and len(data) < len(kept.get(found, ("", data + b"."))[1]):
                kept[found] = suffix, data
    return counts, kept


def main() -> int:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("damaged-files"), metavar="FOLDER")
    parser.add_argument("--only", default="", metavar="SUFFIX", help="files of one format")
    args = parser.parse_args()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        counts, kept = fuzz(args.files, args.seed, Path(folder), args.only)
    for found, count in counts.most_common():
        print(f"{count:8,}  {found}")
    for number, (found, (suffix, data)) in enumerate(sorted(kept.items())):
        args.keep.mkdir(parents=True, exist_ok=True)
        (args.keep / f"{number}{suffix}").write_bytes(data)
        print(f"{found}: {args.keep / f'{number}{suffix}'} ({len(data):,} bytes)")
    print(f"{args.files:,} files, each read twice, in {time.monotonic() - begin:.0f} s; peak {peak_mb():.0f} MB")
    return 1 if kept else 0


if __name__ == "__main__":
    sys.exit(main())
