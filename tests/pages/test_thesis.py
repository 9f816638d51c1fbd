"""A paper's numbers beside ours: which experiments rows belong to, and what the page says of each method."""

from __future__ import annotations

import pandas as pd
import pytest
from boards import row, rows

from bench.errors import UsageError
from bench.pages.thesis import comparisons
from bench.ranking.conventions import load_convention
from bench.ranking.published import load_published

PUBLISHED = {line.method: line for line in load_published("table_4_1").lines if line.method in ("fourier", "hash_sdf")}
THEIRS = float(PUBLISHED["fourier"].values["CD (1e-3)"])


def made(factor=1.0, failed=0, dataset="multiscale", method="fourier", sensor="idf_400k"):
    """Six cases of a method of table 4.1, whose mean is ``factor`` times the paper's number."""
    shares = [0.9, 1.1, 0.95, 1.05, 1.0, 1.0]
    frame = [
        row(method, f"s{i}", scores=None if i < failed else {"chamfer_l1_sum@100000": factor * share * THEIRS / 1000},
            worst={"chamfer_l1_sum@100000": 1.0}, dataset=dataset, sensor=sensor, cell=f"c{i}")
        for i, share in enumerate(shares)
    ]  # fmt: skip
    return rows(*frame)


def lines(frame, names=None, cells=None):
    found = comparisons(frame, names, cells or {}, level=0.95)
    return {(one["experiment"], one["column"], line["label"]): line for one in found for line in one["lines"]}


def test_rows_of_an_experiments_dataset_stand_beside_its_numbers():
    line = lines(made(1.02))["table_4_1", "CD (1e-3)", "fourier"]
    assert (line["theirs"], line["status"], line["why"]) == (THEIRS, "reproduces", "")
    assert line["ours"] == pytest.approx(1.02 * THEIRS) and line["ratio"] == pytest.approx(1.02)
    assert (line["solved"], line["planned"]) == (6, 6)


def test_rows_of_other_datasets_do_not_unless_asked():
    other = made(dataset="bumps")
    assert lines(other) == {}
    assert lines(other, ["table_4_1"])["table_4_1", "CD (1e-3)", "fourier"]["status"] == "reproduces"


@pytest.mark.parametrize("factor,failed,status", [(1.5, 0, "works"), (4.0, 0, "differs"), (1.0, 1, "differs")])
def test_the_status_follows_the_number_and_the_failures(factor, failed, status):
    cells = {f"c{i}": {"profile": "quick"} for i in range(6)}
    line = lines(made(factor, failed), cells=cells)["table_4_1", "CD (1e-3)", "fourier"]
    assert line["status"] == status
    assert "run in the profile quick, shorter than the paper's" in line["why"]
    assert ("1 of 6 cases failed" in line["why"]) == bool(failed)


def test_methods_of_the_paper_that_are_not_there_are_named():
    found = lines(made())
    others = {
        label: line for (name, column, label), line in found.items() if (name, column) == ("table_4_1", "CD (1e-3)")
    }
    assert others["NGLOD (LOD6)"]["status"] == "not run" and others["NGLOD (LOD6)"]["ours"] is None
    assert set(others) == {
        line.title if line.method != "fourier" else "fourier"
        for line in load_published("table_4_1").lines
        if "CD (1e-3)" in line.values
    }


def test_the_experiment_says_why_a_number_differs():
    frame = made(5, method="siren").assign(variant="hidden_layers=7,omega=30")
    theirs = next(line for line in load_published("table_4_1").lines if line.name == "SIREN-7 (30)")
    found = [line for key, line in lines(frame).items() if key[0] == "table_4_1" and line["ours"] is not None]
    assert found and all(theirs.why in line["why"] for line in found if line["status"] != "reproduces")


def test_methods_are_called_as_in_the_tables_and_what_all_share_is_a_note():
    short = made().assign(variant="seconds=3")
    plain = made(method="hash_sdf").assign(variant="seconds=3")
    plain["cell"] = "h" + plain["cell"]
    (found,) = comparisons(pd.concat([short, plain], ignore_index=True), ["table_4_1"], {}, level=0.95)
    assert {line["label"] for line in found["lines"] if line["ours"] is not None} <= {"fourier", "hash_sdf"}
    assert "All methods: seconds=3." in found["notes"]


def test_only_what_results_lack_is_missing_in_the_notes():
    frame = made()
    extra = load_convention("idf").columns[-1].score
    alone = [note for one in comparisons(frame, ["table_4_1"], {}, level=0.95) for note in one["notes"]]
    assert any("have no" in note and extra in note for note in alone)
    frame[f"score.{extra}"] = 1.0
    both = [note for one in comparisons(frame, ["table_4_1"], {}, level=0.95) for note in one["notes"]]
    assert not any(f"({extra})" in note for note in both if "have no" in note)


def test_an_experiment_without_a_table_is_refused():
    with pytest.raises(UsageError, match="repeats no paper's table"):
        comparisons(made(), ["demo"], {}, level=0.95)
    with pytest.raises(UsageError, match="no experiment is called"):
        comparisons(made(), ["table_9"], {}, level=0.95)


def test_nothing_solved_gives_nothing():
    assert comparisons(made(failed=6), None, {}, level=0.95) == []


def test_the_page_shows_numbers_status_and_reason(visit, tmp_path):
    from bench.pages.assemble import one_file
    from bench.pages.data import page_data

    path = tmp_path / "page.html"
    path.write_text(one_file(page_data(made(1.5))), encoding="utf-8")
    page = visit(path, "#view=published")
    line = page.locator("main tbody tr", has_text="fourier").first
    cells = line.locator("td").all_inner_texts()
    assert cells[0] == f"{THEIRS:g}" and cells[1].startswith("8.2") and cells[2:5] == ["1.5", "6/6", "works"]
    assert "not run" in page.locator("main tbody").first.inner_text()
