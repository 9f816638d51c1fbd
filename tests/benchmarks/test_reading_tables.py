"""Tables of millions of points: memory against their arrays, time against the parser of numpy."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from bench.geometry.io.files import load_cloud

COUNT = 500_000 if "DETAILBENCH_SHORT" in os.environ else 5_000_000
PIECE = 100_000
CHILD = """
import resource, sys
import pandas, scipy.spatial
from bench.geometry.io.files import load_cloud
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
before = peak()
cloud = load_cloud(sys.argv[1])
print((peak() - before) / sum(array.nbytes for array in cloud.arrays().values()))
"""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """x y z intensity r g b, as a scanner exports them."""
    path, rng = tmp_path_factory.mktemp("tables") / "scan.csv", np.random.default_rng(0)
    rows = np.hstack([rng.normal(size=(PIECE, 4)) * 100, rng.integers(0, 256, (PIECE, 3))])
    text = "".join("%.4f,%.4f,%.4f,%.3f,%d,%d,%d\n" % tuple(row) for row in rows.tolist())  # noqa: UP031
    with path.open("w") as file:
        file.write("x,y,z,intensity,r,g,b\n")
        for _ in range(COUNT // PIECE):
            file.write(text)
    return path


def test_memory_is_at_most_four_times_the_arrays(table, benchmark):
    call = [sys.executable, "-c", CHILD, str(table)]
    done = benchmark.pedantic(subprocess.run, (call,), {"check": True, "capture_output": True, "text": True}, rounds=1)
    ratio = float(done.stdout)
    benchmark.extra_info["peak over arrays"] = ratio
    print(f"\n{COUNT:,} points: peak {ratio:.2f} x their arrays (limit 4)")
    assert ratio <= 4


def test_time_is_at_most_one_and_a_half_that_of_numpy(table, benchmark):
    begin = time.process_time()
    theirs = np.loadtxt(table, delimiter=",", skiprows=1, max_rows=PIECE)
    numpys = (time.process_time() - begin) * COUNT / PIECE
    small = table.with_name("small.csv")
    small.write_text("1,2,3\n4,5,6\n7,8,10\n")
    load_cloud(small)  # what is imported once is no part of it
    begin = time.process_time()
    cloud = benchmark.pedantic(load_cloud, (table,), rounds=1)
    ours = time.process_time() - begin
    benchmark.extra_info["ours over numpy's"] = ours / numpys
    print(f"\n{COUNT:,} points: {ours:.1f} s, numpy {numpys:.1f} s (processor)")
    assert np.array_equal(cloud.points[:PIECE], theirs[:, :3]) and ours <= 1.5 * numpys
