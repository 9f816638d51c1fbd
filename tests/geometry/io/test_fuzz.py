"""Randomly damaged files: each is refused with a message or read whole, and the fuzzer reports all other outcomes."""

from __future__ import annotations

import time
import warnings

import numpy as np
import pytest
from damaged_files import MUTATIONS, corpus, mutated
from fuzz_files import fuzz, outcome

from bench import BadInput, PointCloud
from bench.geometry.io.files import CLOUD_READERS, load_cloud

WELL = {"refused", "whole"}


@pytest.mark.parametrize("seed", [1, 2])
def test_hundreds_of_damaged_files(tmp_path, seed):
    counts, kept = fuzz(300, seed, tmp_path)
    assert set(counts) == WELL, (counts, kept)
    assert counts["refused"] > 300 and counts["whole"] > 30


def test_the_files_are_valid_before_they_are_damaged(tmp_path):
    for number, (suffix, data) in enumerate(corpus()):
        path = tmp_path / f"{number}{suffix}"
        path.write_bytes(data)
        assert outcome(path, load_cloud) == ("whole" if suffix in CLOUD_READERS else "refused")


def test_a_seed_gives_the_same_files_again():
    assert list(mutated(20, 5)) == list(mutated(20, 5)) != list(mutated(20, 6))
    assert len(set(MUTATIONS)) == 7


def unnamed(path):
    raise BadInput("some file: is damaged")


def endless(path):
    raise BadInput(f"{path}: {'x' * 5000}")


def warned(path):
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


def not_finite(path):
    return PointCloud(np.array([[0.0, 0, 0], [1, 0, 0], [np.nan, 1, 0]]))


def too_far(path):
    return PointCloud(np.array([[0.0, 0, 0], [1e308, 0, 0], [0, -1e308, 0]]))


@pytest.mark.parametrize(
    ("load", "found"),
    [
        (unnamed, "poor message"),
        (endless, "poor message"),
        (warned, "RuntimeWarning in test_fuzz.py: overflow"),
        (not_finite, "not finite"),
        (too_far, "not finite"),
        (lambda path: [][0], "IndexError in test_fuzz.py: list index out of range"),
    ],
)
def test_the_fuzzer_reports_each_fault(tmp_path, load, found):
    assert outcome(tmp_path / "x.ply", load) == found


def test_the_fuzzer_reports_a_hang(tmp_path, monkeypatch):
    monkeypatch.setattr("fuzz_files.SECONDS", 0.05)
    assert outcome(tmp_path / "x.ply", lambda path: time.sleep(10)) == "hang"


def test_the_fuzzer_reports_a_file_that_takes_too_much_memory(tmp_path, monkeypatch):
    peaks = iter([200.0, 1300.0])
    monkeypatch.setattr("fuzz_files.peak_mb", lambda: next(peaks))
    assert outcome(tmp_path / "x.ply", load_cloud) == "memory"
