"""Train and test shapes are never in one table: in every format and view, of one folder and of several."""

import json

import pandas as pd
import pytest
from boards import row, rows
from records import record

from bench.commands.leaderboard import read_rows
from bench.errors import UsageError
from bench.plan.cell import id_of
from bench.ranking.leaderboard import failures, leaderboard
from bench.ranking.overview import overview
from bench.ranking.report import FORMATS, render
from bench.ranking.report.terminal import remarks
from bench.ranking.selection import pool
from bench.results.store import Results, _table


@pytest.fixture
def tuned():
    """One method on test shapes, and a variant of it on train shapes with the same ids, where it looks much better."""
    return rows(
        *(row("plain", case, 0, {"d": 1.0 + i}, tags="thin") for i, case in enumerate("abcd")),
        *(row("plain", c, 0, {"d": 0.1}, split="train", variant="depth=9", tags="thin") for c in "abcd"),
        row("plain", "e", 0, split="train", variant="depth=9", tags="thin"),
    )


@pytest.mark.parametrize("by", [None, "task", "dataset", "sensor", "tag", "dataset,tag"])
def test_no_mean_and_no_rank_is_over_both(tuned, by):
    board = leaderboard(tuned, by=by)
    assert board["split"].tolist() == ["test", "train"]
    assert board["mean"].tolist() == pytest.approx([2.5, 0.1])
    assert board["planned"].tolist() == [4, 5]
    assert board["rank_high"].tolist() == [1, 1]


@pytest.mark.parametrize("across", ["tag", "dataset", "sensor"])
def test_views_across_groups_keep_them_apart(tuned, across):
    board = overview(tuned, across)
    assert board["split"].tolist() == ["test", "test", "train", "train"]
    assert board["mean"].tolist() == pytest.approx([2.5, 2.5, 0.1, 0.1])
    text = render(board, "markdown", rows=pool(tuned, "task"), metrics=list(dict.fromkeys(board["metric"])))
    assert text.count("###") == 2


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_says_which_table_is_over_train_shapes(tuned, format):
    text = render(leaderboard(tuned), format, rows=tuned)
    if format == "csv":
        assert ",test," in text.splitlines()[1] and ",train," in text.splitlines()[2]
    else:
        title = "Reconstruct: bumps, samples" if format == "latex" else "reconstruct · bumps · samples"
        assert text.count(title) >= 2
        assert text.count("split train") == (2 if format == "terminal" else 1)  # the failure says so as well


def test_failures_are_counted_apart(tuned):
    tuned.loc[len(tuned)] = tuned.iloc[-1].to_dict() | {"split": "test"}
    assert failures(tuned)[["split", "count"]].to_numpy().tolist() == [["test", 1], ["train", 1]]
    assert "(reconstruct · bumps · samples · split train): boom" in remarks(leaderboard(tuned), tuned)


def test_the_filter(tuned):
    assert leaderboard(tuned, split="train")["variant"].tolist() == ["depth=9"]
    assert leaderboard(tuned, split=["test", "train"]).shape[0] == 2
    with pytest.raises(UsageError, match="no result has split 'tset'.*'test'"):
        leaderboard(tuned, split="tset")


def test_rows_without_the_column_are_of_the_test_split(tuned):
    bare = tuned[tuned["split"] == "test"].drop(columns="split")
    assert leaderboard(bare)["split"].tolist() == ["test"]


def earlier(split, **values):
    """A record as version 3 wrote it: the split is in the metadata alone."""
    cell = {"split": split}
    made = record(id_of(cell), schema_version=3, split=split, **values)
    made.meta["cell"] = cell
    return made


def write_earlier(results, made):
    """Write a record without the column of the split."""
    results.write(made)
    path = results.path(made.cell, made.fingerprint)
    table = _table(made).drop_columns(["split"])
    import pyarrow.parquet as pq

    pq.write_table(table, path, compression="zstd", write_page_checksum=True)


@pytest.mark.parametrize("use_index", [False, True])
def test_files_of_earlier_versions_say_their_split_in_the_metadata(tmp_path, use_index):
    results = Results(tmp_path)
    write_earlier(results, earlier("train"))
    write_earlier(results, earlier("test"))
    results.write(record("ab0000000003", split="train", seed=1))
    for _ in range(2):  # from the files, and from the index
        found = results.rows(use_index=use_index)
        assert found.groupby(["split", "seed"]).size().to_dict() == {("test", 0): 3, ("train", 0): 3, ("train", 1): 3}
    assert {r["split"] for r in results.read(id_of({"split": "train"}), "f" * 16).rows} == {"train"}


def test_an_index_of_an_earlier_version_is_made_again(tmp_path):
    results = Results(tmp_path)
    write_earlier(results, earlier("train"))
    results.rows()
    index = tmp_path / ".index" / "rows.parquet"
    import pyarrow.parquet as pq

    table = pq.read_table(index)
    meta = json.loads(table.schema.metadata[b"files"]) | {"schema_version": 3}
    pq.write_table(table.drop_columns(["split"]).replace_schema_metadata({b"files": json.dumps(meta)}), index)
    assert set(results.rows()["split"]) == {"train"}


def test_two_folders_with_equal_cases_of_two_splits_replace_nothing(tmp_path):
    """`leaderboard paper tune`: the tuned variant was run on train shapes with the same ids."""
    for name, split, finished in (("paper", "test", "2026-01-01T00:00:00"), ("tune", "train", "2026-02-01T00:00:00")):
        write_earlier(Results(tmp_path / name), earlier(split, finished=finished))
    found = read_rows([str(tmp_path / "paper"), str(tmp_path / "tune")])
    assert found["split"].value_counts().to_dict() == {"test": 3, "train": 3}
    assert isinstance(found, pd.DataFrame)
