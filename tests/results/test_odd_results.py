"""Whatever lies in a results folder: it is left out with one warning, or its case is run again; nothing is moved."""

import copy
import errno
import json
import os
import random
import shutil

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from records import cell_of, record, row

from bench.engine import runner
from bench.errors import StoreError
from bench.plan.cell import Cell, Settings
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import render
from bench.results import checks
from bench.results.files import COLUMNS, META_KEY
from bench.results.store import Record, Results, _table
from bench.sweep.forecast import Pace

GOOD = "ab0000000001"
ODD = [
    None,
    True,
    -1,
    0,
    7,
    2**63 - 1,
    -(2**63),
    10**30,
    1.5,
    np.nan,
    np.inf,
    -np.inf,
    1e308,
    "",
    "x",
    "\x1b[2J",
    "é" * 300,
]
ODD += [
    "ok",
    "error",
    '{"p2f_mean": 5}',
    "[1]",
    "{",
    "[" * 2000,
    "nan",
    "2999-01-01T00:00:00+00:00",
    [],
    [1],
    {},
    {"a": 1},
]
TYPES = [pa.string(), pa.large_string(), pa.int64(), pa.int32(), pa.uint64(), pa.float64(), pa.float16(), pa.bool_()]
TYPES += [pa.binary(), pa.timestamp("us"), pa.list_(pa.int64()), pa.null(), pa.dictionary(pa.int32(), pa.string())]


def whole(seed: int = 1) -> Record:
    """A record with all that a run stores."""
    cell = cell_of(seed)
    made = record(cell.id, method="identity", seed=seed, directions='{"p2f_mean": "lower"}')
    made.meta |= {
        "schema_version": 5,
        "cell": cell.to_json(),
        "ingredients": {"cell": cell.id, "source of method identity": "0" * 16, "package numpy": "1"},
        "settings": {"limit": {"seconds": 60.0}, "plugins": ["a.py"], "outputs": "none", "profile": "quick"},
        "provenance": {"host": "h", "plugins": {"method identity": {"file": "/identity.py"}}},
        "sources": {"a.py": {"sha256": "0", "text": "x = 1\n"}},
    }
    return made


def array_of(rng: random.Random, length: int) -> pa.Array:
    """A column of any type and values."""
    try:
        return pa.array([rng.choice(ODD) for _ in range(length)], rng.choice(TYPES))
    except (pa.ArrowException, ValueError, TypeError, OverflowError):
        return pa.array(np.arange(length), pa.int64()).cast(rng.choice([pa.int64(), pa.string(), pa.float64()]))


def odd_table(rng: random.Random, table: pa.Table) -> pa.Table:
    """One thing of a table changed."""
    place = rng.randrange(table.num_columns)
    name = table.column_names[place]
    kind = rng.choice(["drop", "type", "value", "value", "value", "twice", "rename", "rows", "more", "none", "copies"])
    if kind == "drop":
        return table.drop_columns([name])
    if kind == "type":
        return table.set_column(place, name, array_of(rng, table.num_rows))
    if kind == "value":
        values, at = table[name].to_pylist(), rng.randrange(table.num_rows)
        values[at] = rng.choice(ODD)
        values = [values[at]] * len(values) if rng.random() < 0.5 else values
        try:
            return table.set_column(place, name, pa.array(values, table.schema.field(name).type))
        except (pa.ArrowException, ValueError, TypeError, OverflowError):
            return table.set_column(place, name, pa.array([None] * len(values), table.schema.field(name).type))
    if kind == "twice":
        return table.append_column(name, array_of(rng, table.num_rows))
    if kind == "rename":
        return table.rename_columns([f"score.{name}" if one == name else one for one in table.column_names])
    if kind == "rows":
        return table.slice(0, rng.randrange(table.num_rows))
    if kind == "more":
        return table.append_column(
            rng.choice(["score.x", "worst.p2f_mean", "foreign", ""]), array_of(rng, table.num_rows)
        )
    return table.select([]) if kind == "none" else pa.concat_tables([table, table])


def odd_meta(rng: random.Random, meta: dict) -> bytes | None:
    """One value of the metadata gone or replaced, or all of it."""
    kind = rng.choice(["value"] * 6 + ["gone"] * 4 + ["torn", "bytes", "other", "none"])
    if kind == "none":
        return None
    if kind in ("value", "gone"):
        meta, inner = copy.deepcopy(meta), None
        at = meta
        while isinstance(at, dict) and at and (inner is None or rng.random() < 0.6):
            inner, key = at, rng.choice(list(at))
            at = at[key]
        if kind == "gone":
            del inner[key]
        else:
            inner[key] = rng.choice([value for value in ODD if not isinstance(value, float)])
        return json.dumps(meta).encode()
    text = json.dumps(meta).encode()
    return {"torn": text[: rng.randrange(len(text))], "bytes": b"\xff" + text}.get(kind, b"[" * 5000)


def odd_file(rng: random.Random, made: Record) -> bytes:
    """The file of a record with one thing wrong, or none."""
    table, meta = _table(made), json.dumps(made.meta).encode()
    if rng.random() < 0.6:
        table = odd_table(rng, table)
    else:
        meta = odd_meta(rng, made.meta)
    sink = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata(None if meta is None else {META_KEY: meta}), sink)
    content = sink.getvalue().to_pybytes()
    return content[: rng.randrange(len(content))] if rng.random() < 0.03 else content


@pytest.fixture
def results(tmp_path):
    made = Results(tmp_path / "results")
    made.write(record(GOOD, directions='{"p2f_mean": "lower"}'))
    return made


def files(results: Results) -> dict:
    """What lies in the folder, but for the index."""
    paths = sorted(path for path in results.folder.rglob("*") if ".index" not in path.parts)
    return {path: path.read_bytes() if path.is_file() else None for path in paths}


def test_any_mutation_of_a_record_is_read_or_left_out_with_one_warning(results):
    rng, made, outcomes = random.Random(0), whole(), []
    path = results.path(made.cell, made.fingerprint)
    for _ in range(120):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(odd_file(rng, made))
        fresh = Results(results.folder)
        rows = fresh.rows(use_index=False)
        fresh.meta(made.cell, made.fingerprint), fresh.records(made.cell)
        shown = set(rows["cell"]) - {GOOD}
        assert GOOD in set(rows["cell"]) and shown <= {made.cell}
        assert len(fresh.damaged) == (not shown) and all(str(path) in note for note in fresh.damaged), fresh.damaged
        again = fresh.read(made.cell, made.fingerprint)
        assert (again is not None) == bool(shown) and path.exists()
        outcomes.append(bool(shown))
        if shown and rng.random() < 0.15:
            of_it = rows[rows["cell"] == made.cell]
            render(leaderboard(of_it), "terminal", rows=of_it)
    assert 30 < sum(outcomes) < 90  # both happen


def test_an_index_of_any_kind_is_made_again(results):
    made = whole()
    results.write(made)
    expected = results.rows(use_index=False)
    results.rows()
    index = results.folder / ".index" / "rows.parquet"
    table, rng = pq.read_table(index), random.Random(1)
    ghost = table.set_column(table.column_names.index("__file"), "__file", pa.array(["ghost.parquet"] * len(table)))
    mutated = [odd_table(rng, table) for _ in range(40)] + [pa.concat_tables([table, ghost]), ghost]
    for number, one in enumerate(mutated):
        pq.write_table(one.replace_schema_metadata(table.schema.metadata), index)
        found = Results(results.folder).rows()
        assert set(found["cell"]) <= set(expected["cell"]) and set(found["task"]) == {"denoise"}
        if number % 8 == 0:
            render(leaderboard(found), "terminal", rows=found)
    pq.write_table(ghost.replace_schema_metadata(table.schema.metadata), index)
    pd.testing.assert_frame_equal(
        results.rows().sort_values(["cell", "case"], ignore_index=True),
        expected.sort_values(["cell", "case"], ignore_index=True),
    )


# -- files that are no records, or cannot be opened --------------------------------------------------------------------


def foreign(path):
    pd.DataFrame({"fingerprint": ["x"], "value": [1.0]}).to_parquet(path)


def tiny_bomb(path):
    """A few kilobytes that stand for ten million rows."""
    made = whole()
    text = json.dumps(made.meta | {"planned": 10**7}).encode()
    table = pa.table({"case_index": pa.nulls(10**7, pa.int64())})
    pq.write_table(table.replace_schema_metadata({META_KEY: text}), path)


KINDS = {
    "a foreign table": (foreign, "is not a record of detailbench"),
    "a link to nothing": (lambda path: path.symlink_to("nowhere"), "No such file"),
    "a link to itself": (lambda path: path.symlink_to(path), "symbolic link"),
    "a folder": (lambda path: path.mkdir(), "is not a regular file"),
    "a fifo": (lambda path: os.mkfifo(path), "is not a regular file"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "is not a regular file"),
    "an empty file": (lambda path: path.write_bytes(b""), "is not a complete Parquet file"),
    "a text": (lambda path: path.write_text("cell,method\n"), "is not a complete Parquet file"),
    "a bomb": (tiny_bomb, "more than any record"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["mine.parquet", "abcd00000009-ffffffffffffffff.parquet"])
def test_what_is_no_record_is_left_out_and_stays(results, kind, name):
    make, reason = KINDS[kind]
    path = results.folder / "cells" / "ab" / name
    make(path)
    before = {one: os.lstat(one).st_ino for one in results.folder.rglob("*")}
    for use_index in (False, True, True):
        opened = Results(results.folder)
        assert set(opened.rows(use_index=use_index)["cell"]) == {GOOD}
        assert len(opened.damaged) == 1 and str(path) in opened.damaged[0] and reason in opened.damaged[0]
    assert opened.read("abcd00000009", "f" * 16) is None and opened.meta("abcd00000009", "f" * 16) == {}
    assert [one.cell for one in opened.records(GOOD)] == [GOOD] and opened.find_cell(GOOD[:11]) == GOOD
    after = {one: os.lstat(one).st_ino for one in results.folder.rglob("*") if ".index" not in one.parts}
    assert after == before
    mends = Results(results.folder, mends=True)  # a run moves what was read and is wrong
    mends.rows(use_index=False)
    damaged = kind in ("an empty file", "a text", "a bomb")
    assert os.path.lexists(path) != damaged and ("set aside" in mends.damaged[0]) == damaged


@pytest.mark.parametrize("error", [PermissionError(errno.EACCES, "no"), OSError(errno.EIO, "no"), MemoryError()])
def test_what_cannot_be_opened_is_not_damaged(results, monkeypatch, error):
    def fails(path):
        raise error

    monkeypatch.setattr(checks, "read_regular", fails)
    before, mends = files(results), Results(results.folder, mends=True)
    assert mends.read(GOOD, "f" * 16) is None and mends.rows(use_index=False).empty
    assert len(mends.damaged) == 1 and "left out" in mends.damaged[0] and files(results) == before


def test_a_shelf_that_cannot_be_read_is_left_out(results, monkeypatch):
    made, scandir = whole(), os.scandir
    results.write(made)

    def scan(folder):
        if os.fspath(folder).endswith("/ab"):
            raise PermissionError(errno.EACCES, "Permission denied", os.fspath(folder))
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", scan)
    opened = Results(results.folder)
    assert set(opened.rows(use_index=False)["cell"]) == {made.cell}
    assert opened.damaged == [f"{results.folder / 'cells' / 'ab'}: left out: cannot be read: Permission denied"]


def test_setting_aside_replaces_nothing_and_follows_no_link(results, tmp_path):
    path = results.path(GOOD, "f" * 16)
    content = path.read_bytes()
    mends = [Results(results.folder, mends=True) for _ in range(3)]
    for number, one in enumerate(mends[:2]):
        path.write_bytes(content[: 100 + number])
        one.read(GOOD, "f" * 16)
    kept = sorted((results.folder / "damaged").iterdir())
    assert [len(file.read_bytes()) for file in kept] == [101, 100] or len(kept) == 2
    shutil.rmtree(results.folder / "damaged")
    (tmp_path / "home").mkdir()
    (results.folder / "damaged").symlink_to(tmp_path / "home")
    path.write_bytes(content[:100])
    mends[2].read(GOOD, "f" * 16)
    assert path.exists() and not list((tmp_path / "home").iterdir()) and "could not be" in mends[2].damaged[0]


# -- cases of unfinished cells -----------------------------------------------------------------------------------------


def test_any_line_of_an_unfinished_cell_can_be_stored_or_is_dropped(results):
    rng, made, kept = random.Random(2), whole(), 0
    plain = [{"split": "test"} | one for one in made.rows]
    partial = results.folder / ".partial" / f"{made.cell}-{made.fingerprint}.jsonl"
    partial.parent.mkdir()
    for _ in range(200):
        lines = []
        for one in copy.deepcopy(plain):
            key = rng.choice([*COLUMNS, "score.p2f_mean", "score.new", "worst.x", "unknown"])
            one |= {key: rng.choice(ODD)} if rng.random() < 0.7 else {}
            lines.append(json.dumps(one).encode())
        lines.append(
            rng.choice([b"[1]", b"5", b"null", b"\xff\xfe", b"[" * 100_000, b"{}", lines[0][: rng.randrange(80)]])
        )
        partial.write_bytes(b"\n".join(rng.sample(lines, len(lines))))
        rows = {one["case_index"]: one for one in results.partial_rows(made.cell, made.fingerprint)}
        kept += len(rows)
        if rows:
            _table(Record(made.cell, made.fingerprint, made.meta, list(rows.values())))
    assert 200 < kept < 600


def test_rows_of_another_cell_are_run_again(results):
    made = whole()
    cell = Cell.from_json(made.meta["cell"])
    for index, values in enumerate([{}, {"method": "jet"}, {"seed": 5}, {"cell": GOOD}, {"fingerprint": "e" * 16}]):
        line = row(index, made.cell, made.fingerprint, method="identity", seed=1) | values
        results.add_partial(made.cell, made.fingerprint, line)
    rows, _ = runner.finished_rows(results, cell, made.fingerprint, Settings(results=str(results.folder)))
    assert set(rows) == {0}


def test_a_record_without_settings_is_run_again(results):
    made = whole()
    del made.meta["settings"]
    results.write(made)
    opened = Results(results.folder, mends=True)
    settings = Settings(results=str(results.folder))
    assert runner.finished_rows(opened, Cell.from_json(made.meta["cell"]), made.fingerprint, settings) == ({}, None)
    assert "its metadata lack settings" in opened.damaged[0] and "set aside" in opened.damaged[0]


def test_locks_and_unfinished_cells_are_not_written_through_links(results, tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("precious")
    for folder, name in ((".locks", GOOD), (".partial", f"{GOOD}-{'f' * 16}.jsonl")):
        (results.folder / folder).mkdir()
        (results.folder / folder / name).symlink_to(mine)
    with pytest.raises(StoreError), results.lock(GOOD):
        pass
    with pytest.raises(StoreError):
        results.add_partial(GOOD, "f" * 16, row())
    (results.folder / ".index").symlink_to(tmp_path)
    (tmp_path / "rows.parquet").write_text("precious")
    assert len(results.rows()) == 3
    assert mine.read_text() == (tmp_path / "rows.parquet").read_text() == "precious"


def test_what_a_pace_is_made_of_may_be_odd(results):
    made = whole()
    for one, value in zip(made.rows, (np.inf, -5.0, None), strict=True):
        one |= {"seconds": value, "started": "never"}
    results.write(made)
    assert Pace.of(results).known
