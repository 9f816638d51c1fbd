"""Under every launcher that is installed here, a sweep over good and bad methods leaves the same rows, to the bit."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pandas as pd
import pytest
from conftest import TOYS

MISBEHAVING = Path(__file__).parents[1] / "faults" / "misbehaving.py"
METHODS = "fine,raises,segfaults,returns_nan,exits"
# What Hydra calls each, and the package that brings it; those of extras that are not installed are left to CI.
LAUNCHERS = {
    "joblib": ("hydra_plugins.hydra_joblib_launcher", ("hydra.launcher.n_jobs=2",)),
    "submitit_local": ("hydra_plugins.hydra_submitit_launcher", ("hydra.launcher.timeout_min=5",)),
    "ray": ("hydra_plugins.hydra_ray_launcher", ("+hydra.launcher.ray.init.num_cpus=2",)),
}


def _is_there(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:
        return False


INSTALLED = [name for name, (package, _) in LAUNCHERS.items() if _is_there(package)]
# What a run measures, and when and in which process it did.
MEASURED = (
    "seconds",
    "cpu_seconds",
    "reference_seconds",
    "exchange_seconds",
    "peak_rss_mb",
    "rss_before_mb",
    "started",
    "finished",
    "traceback",
    "host",
)


@pytest.fixture(scope="module")
def table(shells):
    """A function that runs the sweep under a launcher: its exit code and its rows, without what it measured."""
    made = {}

    def run(name, *words):
        if name not in made:
            shell = shells(f"launched_{name}")
            limits = ("cases=2", "limit.seconds=20", f"method={METHODS}")
            done = shell.run(*limits, *words, plugins=(TOYS, MISBEHAVING), timeout=300)
            assert "Traceback" not in done.stderr, done.stderr
            rows = shell.rows().sort_values(["method", "case_index"]).reset_index(drop=True)
            made[name] = done.returncode, rows.drop(columns=[c for c in MEASURED if c in rows])
            assert shell.left_over() == []
        return made[name]

    return run


def test_one_launcher_at_least_is_installed():
    assert "joblib" in INSTALLED


@pytest.mark.parametrize("name", INSTALLED)
def test_the_rows_are_those_of_the_basic_launcher(table, name):
    code, expected = table("basic")
    assert code == 3 and len(expected) == 10
    assert set(expected["status"]) == {"ok", "error", "crashed", "invalid"}
    found = table(name, f"hydra/launcher={name}", *LAUNCHERS[name][1])
    assert found[0] == code
    pd.testing.assert_frame_equal(found[1], expected, check_exact=True)
