"""What the process that runs a sweep's jobs does for each cell: few look-ups, few calls from file to file."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).with_name("parents_work.py")
CELLS = 12


def test_the_parent_s_work_per_cell(tmp_path, benchmark):
    def measure():
        command = [sys.executable, str(SCRIPT), str(CELLS), str(tmp_path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    found = benchmark.pedantic(measure, rounds=1)
    benchmark.extra_info |= found
    print(
        f"\na cell that does nothing, in the parent: {found['ms']:.1f} ms of processor time, {found['lookups']:.0f} "
        f"look-ups (limit 8), {found['crossings']:.0f} calls from file to file (limit 250); with Hydra "
        f"{found['ms with Hydra']:.0f} ms"
    )
    assert found["lookups"] <= 8  # five choices
    assert found["crossings"] <= 250
