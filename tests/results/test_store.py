"""Records on disk: whole, atomic, resumable, and what happens when they are not."""

import json
import os
import resource
import subprocess
import sys

import pandas as pd
import pyarrow.parquet as pq
import pytest
from records import record, row

from bench.errors import StoreError, UsageError
from bench.results.files import COLUMNS, META_KEY, write_atomically
from bench.results.store import Results


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results", mends=True)


def test_a_record_comes_back_as_it_was(results):
    written = record()
    results.write(written)
    back = results.read(written.cell, written.fingerprint)
    assert back.meta == written.meta
    assert back.rows == written.rows
    assert back.solved == 3


def test_every_file_has_the_documented_columns_and_types(results):
    written = record(message=None, parameters=None)
    results.write(written)
    table = pq.read_table(results.path(written.cell, written.fingerprint))
    assert table.column_names == [*COLUMNS, "floor.p2f_mean", "score.p2f_mean"]
    assert [str(table.schema.field(n).type) for n in COLUMNS] == [
        kind.replace("float64", "double") for kind in COLUMNS.values()
    ]
    assert json.loads(table.schema.metadata[META_KEY])["cell_id"] == written.cell


@pytest.mark.parametrize("spoil", ["half", "empty", "garbage", "flipped", "renamed"])
def test_a_damaged_file_is_set_aside_and_reported(results, spoil):
    written = record()
    results.write(written)
    path = results.path(written.cell, written.fingerprint)
    content = path.read_bytes()
    mark = written.fingerprint
    if spoil == "half":
        path.write_bytes(content[: len(content) // 2])
    elif spoil == "empty":
        path.write_bytes(b"")
    elif spoil == "garbage":
        path.write_bytes(os.urandom(len(content)))
    elif spoil == "flipped":
        at = content.index(b"case-1") if b"case-1" in content else 60
        path.write_bytes(content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :])
    else:
        mark = "0" * 16
        path.rename(results.path(written.cell, mark))
    assert results.read(written.cell, mark) is None
    assert len(results.damaged) == 1 and "computed again" in results.damaged[0]
    assert len(list((results.folder / "damaged").iterdir())) == 1
    results.write(written)
    assert results.read(written.cell, written.fingerprint) is not None


def test_nothing_is_there_before_it_is_written(results):
    assert results.read("ab0000000001", "f" * 16) is None
    assert results.rows().empty
    with pytest.raises(UsageError, match="there are no results here"):
        results.find_cell("ab")


def test_partial_rows_survive_a_torn_line(results):
    results.add_partial("ab", "ff", row(0, "ab", "ff"))
    results.add_partial("ab", "ff", row(1, "ab", "ff"))
    with results._partial("ab", "ff").open("a") as file:
        file.write('{"case_index": 2, "sta')
    results.add_partial("ab", "ff", row(3, "ab", "ff"))
    assert [r["case_index"] for r in results.partial_rows("ab", "ff")] == [0, 1, 3]
    results.write(record("ab0000000001"))
    assert results.partial_rows("ab", "ff")
    results.forget_partial("ab", "ff")
    assert results.partial_rows("ab", "ff") == []


def test_a_failed_write_leaves_what_was_there(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, b"old")
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "from pathlib import Path\n"
        "from bench.results.files import write_atomically\nfrom bench.errors import StoreError\n"
        "try:\n    write_atomically(Path(sys.argv[1]), b'x' * 100000)\n"
        "except StoreError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    assert "cannot write" in done.stdout and "Earlier results are intact" in done.stdout
    assert path.read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"], "the temporary file is gone"
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 1000


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="is a file; expected a folder"):
        Results(tmp_path / "file").prepare()
    with pytest.raises(StoreError, match="cannot write"):
        Results(tmp_path / "file" / "below").prepare()


# -- all rows ----------------------------------------------------------------------------------------------------------


def test_the_newest_record_of_a_place_counts(results):
    results.write(record(mark="a" * 16, finished="2026-01-01T00:00:00+00:00", **{"score.p2f_mean": 1.0}))
    results.write(record(mark="b" * 16, finished="2026-01-02T00:00:00+00:00", **{"score.p2f_mean": 2.0}))
    rows = results.rows()
    assert len(rows) == 3 and set(rows["score.p2f_mean"]) == {2.0}
    assert [r.fingerprint[0] for r in results.records("ab0000000001")] == ["b", "a"]


def test_records_with_other_metrics_meet_in_one_frame(results):
    results.write(record("ab0000000001"))
    results.write(record("cd0000000002", method="wlop", **{"score.hausdorff": 3.0}))
    rows = results.rows()
    assert len(rows) == 6
    assert rows["score.hausdorff"].notna().sum() == 3


def test_the_index_gives_what_reading_gives_and_notices_changes(results):
    for i in range(5):
        results.write(record(f"ab000000000{i}", seed=i))
    fresh = results.rows(use_index=False)
    first, second = results.rows(), results.rows()
    pd.testing.assert_frame_equal(fresh, first)
    pd.testing.assert_frame_equal(first, second)
    results.write(record("ab0000000007", seed=7))
    results.path("ab0000000001", "f" * 16).unlink()
    changed = results.rows()
    assert set(changed["seed"]) == {0, 2, 3, 4, 7}
    pd.testing.assert_frame_equal(
        changed.sort_values(["cell", "case"], ignore_index=True),
        results.rows(use_index=False).sort_values(["cell", "case"], ignore_index=True),
    )


@pytest.mark.parametrize("spoil", [b"", b"garbage"])
def test_a_damaged_index_is_made_again(results, spoil):
    results.write(record())
    results.rows()
    index = results.folder / ".index" / "rows.parquet"
    assert index.exists()
    index.write_bytes(spoil)
    assert len(results.rows()) == 3
    assert len(results.rows()) == 3


def test_a_damaged_record_does_not_stop_the_others(results):
    results.write(record("ab0000000001"))
    results.write(record("cd0000000002", seed=1))
    results.path("ab0000000001", "f" * 16).write_bytes(b"PAR1 nonsense PAR1")
    assert len(results.rows()) == 3
    assert "damaged" in results.damaged[0]


def test_merging_folders_by_copying(tmp_path):
    import shutil

    one, two = Results(tmp_path / "one"), Results(tmp_path / "two")
    one.write(record("ab0000000001"))
    two.write(record("cd0000000002", seed=1))
    one.rows()
    shutil.copytree(two.folder, one.folder, dirs_exist_ok=True)
    assert set(one.rows()["cell"]) == {"ab0000000001", "cd0000000002"}


def test_a_cell_is_found_by_its_beginning(results):
    results.write(record("ab0000000001"))
    results.write(record("ab1000000002"))
    assert results.find_cell("ab0") == "ab0000000001"
    with pytest.raises(UsageError, match="not unique"):
        results.find_cell("ab")
    with pytest.raises(UsageError, match="Did you mean 'ab1000000002'|Did you mean"):
        results.find_cell("ab1000000003")


def test_two_processes_read_what_one_reads(results, monkeypatch):
    """Very many records are read by two; a damaged one is reported as always."""
    for place in range(8):
        results.write(record(cell=f"{place:012x}", seed=place))
    paths = sorted(results.path(f"{place:012x}", record().fingerprint) for place in range(8))
    paths[1].write_bytes(paths[1].read_bytes()[:-40])
    expected = Results(results.folder)
    alone = expected.rows(use_index=False)
    monkeypatch.setattr("bench.results.index.MANY", 4)
    monkeypatch.setattr("bench.results.index.PART", 3)
    both = Results(results.folder)
    pd.testing.assert_frame_equal(both.rows(use_index=False), alone)
    assert len(alone) == 21 and both.damaged == expected.damaged and len(both.damaged) == 1


def test_where_no_processes_can_be_started_one_reads_all(results, monkeypatch):
    results.write(record())
    monkeypatch.setattr("bench.results.index.MANY", 1)

    def refused(*_):
        raise OSError("no semaphores")

    monkeypatch.setattr("bench.results.index.ProcessPoolExecutor", refused)
    assert len(results.rows(use_index=False)) == 3
