"""How many cases a run has: what the user says, else the profile's number, else all of the user's own files."""

from __future__ import annotations

import pytest
import trimesh

from bench.geometry.io.files import save
from bench.plan.cell import Cell
from bench.plan.numbers import ALL_CASES
from bench.sweep.composition import resolved
from bench.sweep.planned import planned_jobs


@pytest.fixture
def six(tmp_path):
    for number in range(6):
        save(trimesh.creation.icosphere(0, radius=1 + number), tmp_path / f"{number}.ply")
    return f"dataset.path={tmp_path}"


def cell(*words: str) -> Cell:
    return Cell.from_config(resolved(words))


def test_all_of_the_users_files_are_taken(six):
    for profile in ("quick", "study", "paper"):
        assert cell("dataset=files", six, f"profile={profile}").planned == 6


def test_the_users_number_counts(six):
    assert cell("dataset=files", six, "cases=4").planned == 4
    assert cell("dataset=files", six, "cases=40").planned == 6
    assert cell("dataset=bumps", "cases=40").planned == 40


def test_other_datasets_have_the_profile_s_number():
    assert [resolved([f"profile={p}"])["cases"] for p in ("quick", "study", "paper")] == [4, 8, 32]
    assert resolved(["experiment=breadth"])["cases"] == 1


def test_one_more_file_is_no_other_cell(six, tmp_path):
    before = cell("dataset=files", six)
    save(trimesh.creation.icosphere(0), tmp_path / "more.ply")
    after = cell("dataset=files", six)
    assert (after.id, after.planned) == (before.id, 7) and after.cases == ALL_CASES


def test_each_job_of_a_sweep_has_the_number_of_its_dataset(six):
    jobs = [[f"dataset={name}", *(() if name == "bumps" else (six,))] for name in ("files", "bumps", "files")]
    assert [one.cell.planned for one in planned_jobs(jobs)] == [6, 4, 6]


def test_what_is_left_out_is_reported(six):
    assert cell("dataset=files", six, "cases=4").left_out == "2 of 6 cases left out (cases=4)"
    assert cell("dataset=files", six).left_out == cell("dataset=bumps").left_out == ""
