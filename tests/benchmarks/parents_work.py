"""The work of the process that runs the jobs of a sweep, Hydra's composition apart, as one line of JSON.

python tests/benchmarks/parents_work.py CELLS FOLDER

The cells do nothing (``nothing.py``). Their seeds differ, and nothing else does: what the process does again for each
of them is the overhead of a cell. The first cell, which also starts a server and fills caches, does not count.
"""

import json
import statistics
import sys
import time
from pathlib import Path

from bench.cli import main
from bench.plugins import registry as plugins
from bench.sweep import launch

PLUGIN = Path(__file__).with_name("nothing.py")
COUNTED = 5  # cells whose calls are counted, which slows them: their times are left out


class Counter:
    """Look-ups in the registry, and calls from a file of the package into another one."""

    def __init__(self):
        self.lookups = self.crossings = 0
        self.package = str(Path(launch.__file__).parents[1])

    def __call__(self, frame, event, argument):
        if event != "call" or not frame.f_code.co_filename.startswith(self.package):
            return
        self.lookups += frame.f_code is plugins.Registry.find.__code__
        caller = frame.f_back.f_code.co_filename if frame.f_back else ""
        self.crossings += caller.startswith(self.package) and caller != frame.f_code.co_filename


def measure(cells, folder):
    """The medians per cell: milliseconds of processor time, look-ups, calls that cross files."""
    times, counts, totals = [], [], []
    run_job, run_hydra = launch._run, launch.launch

    def timed(*arguments):
        counter = Counter() if len(times) >= cells - COUNTED else None
        sys.setprofile(counter)
        begin = time.process_time()
        try:
            return run_job(*arguments)
        finally:
            times.append(time.process_time() - begin)
            sys.setprofile(None)
            if counter:
                counts.append((counter.lookups, counter.crossings))

    def whole(*arguments, **options):
        begin = time.process_time()
        try:
            return run_hydra(*arguments, **options)
        finally:
            totals.append(time.process_time() - begin)

    launch._run, launch.launch = timed, whole
    words = ["task=denoise", "dataset=tiny_balls", "sensor=tiny_samples", "method=nothing", "metric=[tiny_score]"]
    words += ["cases=1", f"seed=range(0,{cells})", f"results={folder}", "--plugin", str(PLUGIN), "--no-leaderboard"]
    code = main(["run", "-m", *words])
    assert code == 0, code
    lookups, crossings = (statistics.median(column) for column in zip(*counts, strict=True))
    own = times[1:-COUNTED]
    counted = sum(times[-COUNTED:]) - COUNTED * statistics.median(own)
    return {
        "ms": 1000 * statistics.median(own),
        "ms with Hydra": 1000 * (totals[0] - counted - times[0]) / cells,
        "lookups": lookups,
        "crossings": crossings,
    }


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]), sys.argv[2])))
