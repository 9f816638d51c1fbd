"""Which rows filters and groupings leave, and what they make of hosts and cases: small tables by hand."""

import pandas as pd
import pytest
from boards import row, rows

from bench.errors import UsageError
from bench.ranking.leaderboard import costs, failures
from bench.ranking.selection import matching, pool, prepared, select

GIVEN = ["left", "left", "right", "right", "left", "left"]


@pytest.mark.parametrize(
    ("cases", "hosts"),
    [
        ("abcdab", ["left, right"] * 4 + ["left"] * 2),  # a sweep over two machines is one line
        ("abbcab", GIVEN),  # both ran the second case: a line each, of all their cases
    ],
)
@pytest.mark.parametrize("gone", [None, "device", "variant"])  # results that other tools wrote may lack a value
def test_hosts_are_joined_where_they_share_the_cases(cases, hosts, gone):
    methods = ["sap"] * 4 + ["poisson"] * 2
    frame = rows(*(row(m, c, host=h) for m, c, h in zip(methods, cases, GIVEN, strict=True)))
    assert prepared(frame if gone is None else frame.assign(**{gone: None}))["host"].tolist() == hosts


def test_hosts_that_share_a_case_of_one_table_stay_apart_in_all():
    """A method has the same lines everywhere; names that are joined already are not joined to longer ones."""
    shared = [row(case="a", host="left"), row(case="a", host="right")]
    frame = rows(*shared, row(case="b", host="left", task="repair"), row(case="c", host="right", task="repair"))
    assert prepared(frame)["host"].tolist() == ["left", "right", "left", "right"]
    again = rows(row(case="a", host="left, right"), row(case="b", host="right"), row(case="c", host="mid"))
    assert prepared(again)["host"].tolist() == ["left, mid, right"] * 3


def test_hosts_that_ran_a_case_on_different_devices_did_not_run_it_twice():
    places = [("a", "left", "cpu"), ("b", "right", "cpu"), ("a", "right", "cuda"), ("b", "left", "cuda")]
    frame = rows(*(row(case=case, host=host, device=device) for case, host, device in places))
    assert prepared(frame)["host"].tolist() == ["left, right"] * 4


def test_rows_without_the_later_key_columns_have_their_defaults():
    bare = rows(row(case="a", scores={"d": 1.0}), row(case="b", host="other")).drop(columns="split")
    assert select(bare, split="test")["case"].tolist() == ["a", "b"]
    for made in (pool(bare), pool(bare, "task")):
        assert made["split"].tolist() == ["test", "test"]
    assert pool(bare)["condition"].tolist() == ["", ""] and prepared(bare.iloc[:1])["split"].tolist() == ["test"]
    assert failures(bare)["split"].tolist() == ["test"] and costs(bare).index.get_level_values("split") == ["test"]
    some = bare.assign(split=["train", None])
    assert pool(some)["split"].tolist() == select(some)["split"].tolist() == ["train", "test"]


def seen():
    """The shape `a` of two datasets, one of them seen by two sensors; five shapes of the first are sharp."""
    of = [("bumps", "a", "x"), ("bumps", "a", "y"), ("cad", "a", "x"), *(("bumps", c, "x") for c in "bcde")]
    return rows(*(row(dataset=d, case=c, sensor=s, tags="sharp,gear" if d == "bumps" else "") for d, c, s in of))


@pytest.mark.parametrize(
    ("by", "dataset", "case", "sensor", "condition"),
    [
        (None, "bumps", "a", "x", ""),
        ("task", "all datasets", "bumps/a", "all sensors", "x"),
        ("dataset", "bumps", "a", "all sensors", "x"),
        ("sensor", "all datasets", "bumps/a", "x", ""),
        ("dataset,sensor", "bumps", "a", "x", ""),
        ("tag", "gear", "bumps/a", "all sensors", "x"),
        (["dataset", "tag"], "bumps gear", "a", "all sensors", "x"),
    ],
)
def test_what_a_grouping_makes_of_the_keys(by, dataset, case, sensor, condition):
    found = pool(seen(), by)
    assert found.iloc[0][["dataset", "case", "sensor", "condition"]].tolist() == [dataset, case, sensor, condition]
    assert found.index.is_unique and len(found) == (13 if "tag" in (by or "") else 7)
    tables = {by: len(part) for by, part in found.groupby(["dataset", "sensor"])}
    sizes = {"tag": [6, 6, 1], "dataset": [6, 1], "sensor": [6, 1], "task": [7]}
    if isinstance(by, str) and by in sizes:
        assert sorted(tables.values(), reverse=True) == sizes[by]


def test_a_name_is_expected():
    for option in ("task", "method", "tag"):
        for empty in ("", " , ", []):
            with pytest.raises(UsageError, match=rf"^{option}: expected a name"):
                select(seen(), **{option: empty})


def test_filters_that_no_row_passes_together_are_named():
    with pytest.raises(UsageError, match=r"^no result has dataset=cad and tag=gear together$"):
        select(seen(), dataset="cad", tag="gear")
    assert len(select(seen().iloc[:0])) == 0


def test_names_are_matched_in_their_order_and_patterns_alphabetically():
    known = ("f@0.02", "p2f", "f@0.01", "f")
    assert matching("metric", "p2f,f", known) == ["p2f", "f", "f@0.01", "f@0.02"]
    assert matching("metric", ["f@*", "p2f", "f@0.01"], iter(known)) == ["f@0.01", "f@0.02", "p2f"]
    assert matching("dataset", "bumps[a=1,b=2]", ["bumps[a=1,b=2]", "bumps"]) == ["bumps[a=1,b=2]"]


def test_filters_leave_the_rows_as_they_are():
    frame = seen()
    pd.testing.assert_frame_equal(select(frame, dataset="cad"), frame.iloc[[2]].assign(condition=""))
    assert "condition" not in frame and pool(frame, "task") is not frame and "all datasets" not in set(frame["dataset"])
