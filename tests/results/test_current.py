"""Which of several records of one place counts: the current one, else the newest, by clocks that may be wrong."""

import os
from datetime import UTC, datetime

import numpy as np
import pytest
from records import cell_of as cell
from records import record

from bench.plan.cell import Cell, Choice
from bench.results.current import Today, timestamp
from bench.results.index import rows as rows_of
from bench.results.provenance import fingerprint, ingredients
from bench.results.store import Record, Results

NOW = datetime(2026, 6, 1, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("finished", "written", "expected"),
    [
        ("2026-01-01T00:00:00+00:00", NOW, datetime(2026, 1, 1, tzinfo=UTC).timestamp()),
        ("2026-01-01T02:00:00+02:00", NOW, datetime(2026, 1, 1, tzinfo=UTC).timestamp()),
        ("2026-01-01T00:00:00", NOW, datetime(2026, 1, 1, tzinfo=UTC).timestamp()),
        ("2999-01-01T00:00:00+00:00", NOW - 5, NOW - 5),
        ("2999-01-01T00:00:00+00:00", NOW + 5, -np.inf),
        ("yesterday", NOW - 5, NOW - 5),
        (None, NOW - 5, NOW - 5),
        (None, NOW + 5, -np.inf),
    ],
)
def test_a_time_in_the_future_does_not_count(finished, written, expected):
    assert timestamp(finished, written, NOW) == expected


def stored(one: Cell, parts: dict, finished: str, score: float) -> Record:
    mark = fingerprint(parts)
    made = record(one.id, mark, finished, seed=one.seed, method=one.method.name, **{"score.p2f_mean": score})
    return Record(one.id, mark, made.meta | {"cell": one.to_json(), "ingredients": parts}, made.rows)


def test_the_current_record_counts_before_a_newer_one(tmp_path):
    """Place by place, in one folder and over several; and that of a run where it is asked for."""
    results, other = Results(tmp_path / "one"), Results(tmp_path / "two")
    for seed in range(3):
        now = ingredients(cell(seed))
        edited = now | {"source of method identity": "another"}
        old, new = ("2026-01-01T00:00:00+00:00", "2026-02-01T00:00:00+00:00")
        if seed < 2:
            results.write(stored(cell(seed), now, old, 1.0))
        results.write(stored(cell(seed), edited, new, 2.0))
        if seed == 1:
            other.write(stored(cell(seed), edited, "2026-03-01T00:00:00+00:00", 3.0))
        results.write(stored(cell(seed), edited | {"package numpy": "0"}, "2025-01-01T00:00:00+00:00", 4.0))
    for use_index in (False, True, True):
        shown = results.rows(use_index=use_index).groupby("seed")["score.p2f_mean"].agg(["min", "max", "size"])
        assert shown.to_numpy().tolist() == [[1, 1, 3], [1, 1, 3], [2, 2, 3]]
    both = rows_of([results, other], use_index=False).groupby("seed")["score.p2f_mean"].max()
    assert both.tolist() == [1, 1, 2]
    assert not [name for name in results.rows() if name.startswith("__")]
    edited = fingerprint(ingredients(cell(1)) | {"source of method identity": "another"})
    of_run = results.rows(of={(cell(1).id, edited)})
    assert of_run["score.p2f_mean"].tolist() == [2.0] * 3 and list(of_run.index) == [0, 1, 2]
    assert results.rows(of=set()).empty and results.rows(of={("nothing", edited)}).empty


def test_a_plugin_that_is_not_installed_is_compared_by_its_file_and_not_imported(tmp_path):
    from bench.results.provenance import source_digest

    file = tmp_path / "mine.py"
    file.write_text("raise SystemExit('imported')\n")
    one = Cell(**{**vars(cell()), "method": Choice("method", "nobody_has_this", {})})
    parts = {"cell": one.id, "source of method nobody_has_this": source_digest(file), "version of metric p2f_mean": 1}
    meta = {"cell": one.to_json(), "ingredients": parts, "provenance": {"plugins": {}}}
    meta["provenance"]["plugins"]["method nobody_has_this"] = {"file": str(file)}
    today = Today()
    assert today.is_current(meta)
    file.write_text("raise SystemExit('imported and edited')\n")
    assert today.differences(meta) == ["source of method nobody_has_this was edited"]
    file.unlink()
    assert today.differences(meta) is None and not today.is_current(meta)


@pytest.mark.parametrize(
    "meta", [{}, {"ingredients": 3}, {"ingredients": {}, "cell": 5}, {"ingredients": [], "cell": {}}]
)
def test_metadata_of_any_kind_is_no_error(meta):
    assert Today().is_current(meta) in (True, False)


def test_a_file_is_newer_than_another_by_its_own_time_where_its_date_cannot_be(tmp_path):
    results = Results(tmp_path)
    for mark, finished, age in (
        ("a" * 16, "2999-01-01T00:00:00+00:00", 500),
        ("b" * 16, "2026-01-01T00:00:00+00:00", 0),
    ):
        results.write(record(mark=mark, finished=finished, **{"score.p2f_mean": float(age)}))
        moment = datetime(2026, 1, 1, tzinfo=UTC).timestamp() - age
        os.utime(results.path("ab0000000001", mark), (moment, moment))
    assert set(results.rows()["score.p2f_mean"]) == {0.0}
    assert "is dated 2999-01-01T00:00:00+00:00, in the future" in results.damaged[0] and len(results.damaged) == 1
