"""Every library that draws from a generator of its own is seeded, with any seed that a run may have."""

import random
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from bench.engine.seeding import seed_globals
from bench.plan.numbers import WHOLE_NUMBERS


@pytest.mark.parametrize("seed", WHOLE_NUMBERS["seed"])
def test_the_least_and_the_largest_seed_seed_all_libraries(monkeypatch, seed):
    seen = []

    def of_open3d(seed):
        np.int32(seed)  # OverflowError: it takes no larger ones
        seen.append("open3d")

    open3d = SimpleNamespace(utility=SimpleNamespace(random=SimpleNamespace(seed=of_open3d)))
    monkeypatch.setitem(sys.modules, "open3d", open3d)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(manual_seed=lambda seed: seen.append("torch")))
    drawn = []
    for _ in range(2):
        seed_globals(seed)
        drawn.append((random.random(), np.random.random()))  # noqa: NPY002
    assert drawn[0] == drawn[1] and seen == ["torch", "open3d"] * 2
