"""The bar of ``detailbench compare``: no alarm on re-runs of the same, an alarm on 5 % less quality.

  python scripts/compare_bar.py                 20 re-runs, one planted loss: some ten minutes
  python scripts/compare_bar.py --reruns 3      shorter

The plugin below is run once as a baseline and then again and again, each time from nothing: with methods of ours, with
one that draws other random numbers each time (``restless``), and with one that takes a while (``steady``). Every
comparison must end with exit code 0. Then the same plugin is run with noise on the output of ``planted`` that is scaled
so that ``p2f_mean`` loses 5 %: that must end with 3, and with 0 where 10 % are allowed. At last ``steady`` does twice
its work, which ``--fail-slower 20%`` must see; how often that option raises a false alarm on the re-runs is printed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

PLUGIN = '''
"""Methods whose quality and speed are planted."""

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, register

LOSS, WORK = {loss}, {work}


@register("method", name="planted")
@dataclass(frozen=True)
class Planted:
    """The input, with as much noise as it takes to lose a share LOSS of p2f_mean."""

    def denoise(self, cloud, run):
        noise = run.rng.normal(size=cloud.points.shape)
        wanted = (1 + LOSS) * abs(run.true_distances(cloud.points)).mean()
        low, high = 0.0, 0.01
        for _ in range(12 if LOSS else 0):
            middle = (low + high) / 2
            loss = abs(run.true_distances(cloud.points + middle * noise)).mean()
            low, high = (middle, high) if loss < wanted else (low, middle)
        return PointCloud(cloud.points + low * noise)


@register("method", name="restless")
@dataclass(frozen=True)
class Restless:
    """The input with noise of a quarter of its own, another one each time: nothing seeds it."""

    def denoise(self, cloud, run):
        return PointCloud(cloud.points + np.random.default_rng().normal(scale=0.0025, size=cloud.points.shape))


@register("method", name="steady")
@dataclass(frozen=True)
class Steady:
    """The input, after some work."""

    def denoise(self, cloud, run):
        for _ in range(WORK):
            np.sort(np.linalg.norm(cloud.points[:, None] - cloud.points[None], axis=2), axis=None)
        return cloud
'''
WORDS = (
    *("task=denoise", "method=planted,restless,steady,statistical_outlier", "dataset=bumps,cad", "cases=3"),
    *("sensor=samples", "sensor.count=600", "sensor.noise=0.01", "metric=[p2f_mean,chamfer_l1_mean]"),
)


def detailbench(*words: str) -> subprocess.CompletedProcess[str]:
    """One command."""
    root = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    return subprocess.run(
        [sys.executable, "-m", "bench", *words],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )


def run(folder: Path, name: str, loss: float = 0.0, work: int = 2, words: tuple[str, ...] = WORDS) -> str:
    """Run the plugin into a folder of its own; the folder."""
    plugin = folder / "planted_methods.py"
    plugin.write_text(PLUGIN.format(loss=loss, work=work))
    done = detailbench("run", "-m", "--no-leaderboard", "--plugin", str(plugin), *words, f"results={folder / name}")
    if done.returncode:
        raise SystemExit(f"the run {name} ended with {done.returncode}:\n{done.stderr}")
    return str(folder / name)


def compare(then: str, now: str, *options: str) -> int:
    """The exit code of a comparison, which is printed where it is not 0."""
    done = detailbench("compare", then, now, *options)
    if done.returncode:
        print(done.stderr.strip())
    return done.returncode


def main() -> int:
    """Run it all; 0 where the bar is reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reruns", type=int, default=20)
    count = parser.parse_args().reruns
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        baseline = run(folder, "baseline")
        again = [run(folder, f"again-{i}") for i in range(count)]
        quiet = sum(compare(baseline, now) == 0 for now in again)
        print(f"re-runs without an alarm: {quiet} of {count}")
        quick = sum(compare(baseline, now, "--fail-slower", "20%") == 0 for now in again)
        print(f"re-runs without an alarm of speed: {quick} of {count}")
        lost = run(folder, "lost", loss=0.05)
        codes = compare(baseline, lost), compare(baseline, lost, "--fail-worse", "10%")
        print(f"5 % less quality: exit code {codes[0]}; where 10 % are allowed: {codes[1]}")
        slow = run(folder, "slow", work=4)
        slower = compare(baseline, slow, "--fail-slower", "20%"), compare(baseline, slow)
        print(f"twice the work: exit code {slower[0]}; without --fail-slower: {slower[1]}")
    return 0 if (quiet, *codes) == (count, 3, 0) else 1


if __name__ == "__main__":
    sys.exit(main())
