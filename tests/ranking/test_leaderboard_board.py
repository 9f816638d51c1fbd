"""The leaderboard's numbers, by hand and by what must not change them."""

import numpy as np
import pandas as pd
import pytest
from boards import DOCUMENTED, line, ranks, row, rows, table, units

from bench.errors import UsageError
from bench.ranking.leaderboard import COLUMNS, failures, leaderboard, notes
from bench.ranking.overview import overview
from bench.ranking.report import render
from bench.ranking.report.terminal import remarks
from bench.ranking.selection import CONTENDER, GROUP, pool, select


def test_the_columns_are_the_documented_ones():
    assert ",".join(COLUMNS) == DOCUMENTED
    assert tuple(leaderboard(table({"poisson": units(1, 2)})).columns) == COLUMNS


def test_a_small_table_by_hand():
    frame = rows(
        row("poisson", "a", 0, {"d": 1.0}, {"d": 0.1}, seconds=1.0, peak_rss_mb=50.0),
        row("poisson", "a", 1, {"d": 2.0}, {"d": 0.2}, seconds=2.0, peak_rss_mb=70.0),
        row("poisson", "b", 0, {"d": 3.0}, {"d": 0.3}, seconds=9.0, peak_rss_mb=60.0),
        row("poisson", "b", 1, seconds=60.0, peak_rss_mb=900.0, status="timeout"),
    )
    got = leaderboard(frame).iloc[0]
    assert (got["task"], got["dataset"], got["sensor"]) == ("reconstruct", "bumps", "samples")
    assert (got["metric"], got["better"]) == ("d", "lower")
    assert got["mean"] == pytest.approx(2.0)
    assert got["floor"] == pytest.approx(0.2)
    assert (got["solved"], got["planned"]) == (3, 4)
    assert (got["seconds_median"], got["peak_rss_mb"]) == (2.0, 70.0)
    assert (got["rank_low"], got["rank_high"]) == (1, 1)
    assert got["ci_low"] < 2 < got["ci_high"]
    assert got["true_distances"] == 0  # of results that say nothing of them


def test_clear_differences_have_one_rank_each_and_are_sorted_by_it():
    wobble = np.array([1.00, 1.03, 0.98, 1.01, 0.99, 1.02, 0.97, 1.0])
    board = leaderboard(
        table({"worst": units(*4 * wobble), "best": units(*wobble[::-1]), "middle": units(*2 * wobble**2)})
    )
    assert board["method"].tolist() == ["best", "middle", "worst"]
    assert ranks(board) == {"best": (1, 1), "middle": (2, 2), "worst": (3, 3)}


def test_higher_is_better_turns_the_order_round():
    wobble = np.array([1.00, 1.03, 0.98, 1.01, 0.99, 1.02, 0.97, 1.0])
    scores = {"low": units(*0.2 * wobble), "high": units(*0.9 * wobble**2), "mid": units(*0.4 * wobble)}
    board = leaderboard(table(scores, better="higher"))
    assert ranks(board) == {"high": (1, 1), "mid": (2, 2), "low": (3, 3)}
    assert board["place"].tolist() == ["best", "second", ""]
    assert line(board, "high")["mean"] == pytest.approx((0.9 * wobble**2).mean())


def test_reference_ranks_by_the_distance_and_shows_it():
    near, far, below = (1, 1, 1, 2, 1, 1, 1, 1), (9, 8, 9, 7, 9, 9, 8, 9), (0, -1, 0, -2, -1, -2, -2, -1)
    scores = {"far": units(*far), "near": units(*near), "below": units(*below)}
    board = leaderboard(table(scores, better="reference", floors={"d": 1.0}))
    assert board["method"].tolist() == ["near", "below", "far"]
    assert line(board, "below")["mean"] == pytest.approx(np.mean(np.abs(np.array(below) - 1)))
    assert line(board, "below")["score_mean"] == pytest.approx(np.mean(below))
    assert set(board["floor"]) == {1.0}


def test_identical_results_are_ties():
    board = leaderboard(table({"one": units(1, 2, 3, 4), "two": units(1, 2, 3, 4)}))
    assert ranks(board) == {"one": (1, 2), "two": (1, 2)}
    assert board["method"].tolist() == ["one", "two"]


def test_ties_are_in_the_order_of_their_names_whoever_was_run_on_the_first_case():
    """And each is compared with the line that is printed below it."""
    scores = {"one": units(*range(2, 8), cases="bcdefg"), "two": units(*range(1, 8)), "last": units(*range(11, 18))}
    board = leaderboard(table(scores))
    assert board["method"].tolist() == ["one", "two", "last"]
    assert board["versus_first"].tolist() == ["first", "equal", "worse"]
    assert board["versus_next"].tolist() == ["open", "better", ""]


def test_a_method_on_a_single_shape_may_be_tied_with_the_best():
    board = leaderboard(table({"all": units(1, 2, 3, 4), "one": units(9, cases="d")}))
    assert board.set_index("method")["place"].to_dict() == {"all": "best", "one": "tied"}


def test_solving_only_the_easy_cases_does_not_pay():
    careful = units(*(1.0, 1.1, 0.9, 1.0, 10.0, 11.0, 9.0, 10.0))
    lucky = units(*(0.99, 1.09, 0.89, 0.99, None, None, None, None))
    board = leaderboard(table({"careful": careful, "lucky": lucky, "bad": units(*[20.0] * 8)}))
    assert line(board, "lucky")["mean"] < line(board, "careful")["mean"]
    assert (line(board, "lucky")["solved"], line(board, "lucky")["planned"]) == (4, 8)
    assert board["method"].tolist()[0] == "careful"


@pytest.mark.parametrize("status", ["error", "timeout", "oom", "crashed", "invalid", "skipped"])
def test_who_solved_nothing_is_last(status):
    frame = table({"good": units(1, 2, 3, 4), "bad": units(8, 9, 7, 8), "none": units(*[None] * 4)})
    frame.loc[frame["method"] == "none", "status"] = status
    board = leaderboard(frame)
    got = board.iloc[-1]
    assert (got["method"], got["solved"], got["planned"]) == ("none", 0, 4)
    assert np.isnan(got["mean"])
    assert np.isnan(got["seconds_median"])
    assert pd.isna(got["rank_low"]) and pd.isna(got["rank_high"])
    assert board["rank_high"].iloc[:2].max() <= 2


def test_several_who_solved_nothing_have_no_rank_and_stand_last():
    board = leaderboard(table({"good": units(1, 2), "no": units(None, None), "nor": units(None, None)}))
    assert ranks(board) == {"good": (1, 1), "no": None, "nor": None}


def test_when_all_failed_the_group_stays_on_the_board():
    failed = table({"a": units(None, None), "b": units(None, None)})
    board = leaderboard(failed)
    assert board["metric"].tolist() == ["", ""]
    assert board["planned"].tolist() == [2, 2]
    assert board["solved"].tolist() == [0, 0]
    assert ranks(board) == {"a": None, "b": None}
    assert board["true_distances"].tolist() == [0, 0]
    beside = leaderboard(pd.concat([table({"c": units(1, 2)}), failed.assign(dataset="cad")]))
    found = beside[["dataset", "method", "metric", "planned"]].to_numpy().tolist()
    assert found == [["bumps", "c", "d", 2], ["cad", "a", "", 2], ["cad", "b", "", 2]]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_score_that_is_no_number_is_a_failure_of_that_metric(value):
    frame = rows(
        *(row("a", c, 0, {"d": 1.0 + i, "e": value if c == "a" else 1.0}) for i, c in enumerate("abcd")),
        *(row("b", c, 0, {"d": 1.5 + i, "e": 2.0}) for i, c in enumerate("abcd")),
    )
    board = leaderboard(frame)
    assert line(board, "a", "d")["solved"] == 4
    assert (line(board, "a", "e")["solved"], line(board, "a", "e")["planned"]) == (3, 4)
    assert line(board, "a", "e")["mean"] == 1


def test_a_metric_that_a_method_is_never_scored_by_is_no_failure():
    frame = rows(
        *(row("clouds", c, 0, {"d": 1.0}) for c in "abc"),
        row("clouds", "d", 0),
        *(row("oriented", c, 0, {"d": 1.0, "normal": 3.0}) for c in "abc"),
        row("oriented", "d", 0),
    )
    board = leaderboard(frame)
    assert board[board["metric"] == "normal"]["method"].tolist() == ["oriented"]
    assert line(board, "oriented", "normal")["planned"] == 4
    assert line(board, "clouds")["planned"] == 4
    other = rows(row("clouds", "a", 0, {"d": 1.0}, dataset="cad"), row("lost", "a", 0, dataset="cad"))
    board = leaderboard(pd.concat([frame, other]), dataset="cad")
    assert board["metric"].tolist() == ["d", "d"]  # nor one that is of other tables only


def test_the_only_method_of_several_that_has_a_score_is_not_the_best_by_it():
    frame = rows(
        *(row("clouds", c, 0, {"d": 1.0}) for c in "abcd"),
        *(row("oriented", c, 0, {"d": 2.0, "normal": 3.0}) for c in "abcd"),
    )
    board = leaderboard(frame).set_index(["metric", "method"])
    assert board["place"].to_dict() == {("d", "clouds"): "best", ("d", "oriented"): "", ("normal", "oriented"): ""}


def test_not_being_run_on_the_hard_case_does_not_help():
    hard = units(1.0, 1.1, 0.9, 1.2, 50.0)
    easy = units(1.2, 1.3, 1.1, 1.45)
    board = leaderboard(table({"everywhere": hard, "chosen": easy}))
    assert line(board, "chosen")["mean"] < line(board, "everywhere")["mean"]
    assert board["planned"].tolist() == [5, 4]
    assert board["method"].tolist() == ["everywhere", "chosen"]
    assert ranks(board)["everywhere"] == (1, 1)


def test_no_common_case_no_claim():
    board = leaderboard(table({"a": units(1, 1.1, 1.2), "b": units(100, 110, 120, cases="xyz")}))
    assert ranks(board) == {"a": (1, 2), "b": (1, 2)}


def test_a_single_unit_says_nothing():
    board = leaderboard(table({"a": units(1), "b": units(100)}))
    assert board[["ci_low", "ci_high"]].isna().all().all()
    assert ranks(board) == {"a": (1, 2), "b": (1, 2)}


def test_one_case_with_seeds_resamples_the_seeds():
    a, b = units(1, 1.1, 0.9, 1.05, cases="a", seeds=4), units(3, 3.3, 3.1, 2.9, cases="a", seeds=4)
    board = leaderboard(table({"a": a, "b": b}))
    assert (board["ci_low"] < board["mean"]).all()
    assert ranks(board) == {"a": (1, 2), "b": (1, 2)}  # one shape ranks nobody


def synthetic(rng):
    scores = {
        m: {(c, s): None if rng.random() < 0.1 else float(rng.random()) for c in "abcd" for s in range(3)}
        for m in ("one", "two", "three")
    }
    return pd.concat([table(scores), table(scores).assign(dataset="cad"), table(scores).assign(variant="depth=9")])


def test_the_order_of_rows_changes_nothing_and_neither_does_the_clock():
    frame = synthetic(np.random.default_rng(2)).reset_index(drop=True)
    board = leaderboard(frame)
    for seed in range(3):
        pd.testing.assert_frame_equal(board, leaderboard(frame.sample(frac=1, random_state=seed)), check_exact=True)


def test_a_group_does_not_depend_on_the_others():
    frame = synthetic(np.random.default_rng(3))
    board = leaderboard(frame)
    alone = leaderboard(frame, dataset="cad")
    both = board[board["dataset"] == "cad"].reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, both, check_exact=True)


@pytest.mark.parametrize("tags", [["sharp,thin", "smooth"], [["sharp", "thin"], ["smooth"]]])
def test_filters(tags):
    frame = rows(
        row("poisson", "a", 0, {"d": 1.0, "f@0.01": 1.0}, dataset="bumps[a=1,b=2]"),
        row("rimls", "a", 0, {"d": 1.0, "f@0.01": 1.0}, dataset="cad"),
    )
    frame["tags"] = tags
    assert leaderboard(frame, dataset="bumps[a=1,b=2]")["method"].unique().tolist() == ["poisson"]
    assert leaderboard(frame, dataset="bumps")["method"].unique().tolist() == ["poisson"]
    assert leaderboard(frame, dataset="cad,bumps", method=["poisson", "rimls"]).shape[0] == 4
    assert leaderboard(frame, metric="f")["metric"].unique().tolist() == ["f@0.01"]
    assert leaderboard(frame, method="r*")["method"].unique().tolist() == ["rimls"]
    assert select(frame, tag="thin")["method"].tolist() == ["poisson"]
    assert select(frame, tag="smooth,thin")["method"].tolist() == ["poisson", "rimls"]
    with pytest.raises(UsageError, match="together"):
        leaderboard(frame, dataset="cad", method="poisson")


@pytest.mark.parametrize("option", ["task", "dataset", "sensor", "method", "metric", "tag"])
def test_a_wrong_name_gets_the_nearest_right_one(option):
    frame = rows(row("poisson", "a", 0, {"chamfer": 1.0}, tags="sharp"))
    right = {"metric": "chamfer", "tag": "sharp"}.get(option) or frame[option].iloc[0]
    with pytest.raises(UsageError, match=f"{option} '{right}x'.*Did you mean '{right}'"):
        leaderboard(frame, **{option: right + "x"})


@pytest.mark.parametrize("wrong", [{"level": 0}, {"level": 1}, {"level": 95}])
def test_settings_that_make_no_sense(wrong):
    with pytest.raises(UsageError, match=next(iter(wrong))):
        leaderboard(table({"a": units(1, 2)}), **wrong)


def test_failures_are_listed_by_kinds_of_messages():
    frame = table({"a": units(None, 1, None, None, None), "b": units(1, 1, 1, 1, 1)})
    said = [
        "x/one.ply: ends after 3 rows",
        "",
        "nothing else",
        "y/two.ply: ends after 1,234.5 rows",
        "x/3.ply: is empty",
    ]
    frame.loc[frame["method"] == "a", "message"] = said
    got = failures(frame)
    pd.testing.assert_frame_equal(got, failures(frame[::-1]))
    assert list(got.columns) == [*GROUP, *CONTENDER, "status", "count", "message", "case"]
    assert got[["method", "status", "count", "message"]].to_numpy().tolist() == [
        ["a", "error", 2, said[0]],
        ["a", "error", 1, said[2]],
        ["a", "error", 1, said[4]],
    ]
    text = remarks(leaderboard(frame), frame)
    case = frame["case"][2]
    assert all(message in text for message in (said[0], said[4], f"{case}: nothing else")) and said[3] not in text


def test_failures_without_a_message_are_of_one_kind():
    """However a file leaves it out; a message that reads like that is another."""
    frame = table({"a": units(*[None] * 6)})
    frame["message"] = pd.Series([None, np.nan, "", "None", "nan", None], dtype=object)
    assert failures(frame)["count"].tolist() == [4, 1, 1]


def test_notes_of_solved_cases_are_listed_below_failures():
    frame = table({"a": units(None, 1, 1), "b": units(1, 1, 1)})
    frame["message"] = ["broken", "", "only half\nof it", "", "", ""]
    assert notes(frame)[["method", "status", "count"]].to_numpy().tolist() == [["a", "ok", 1]]
    assert failures(frame)["method"].tolist() == ["a"]
    text = remarks(leaderboard(frame), frame).splitlines()
    assert text[1] == "Not solved" and text[2].endswith(": broken") and text[2].startswith("  a: 1 error (")
    assert text[4] == "Solved, with a note" and text[5].startswith("  a: 1 (") and text[5].endswith(": only half of it")


# --- tables over several datasets, and by tag ---------------------------------------------------------------------


@pytest.fixture
def spread():
    """Two datasets with the same case ids, two sensors, tags that overlap."""
    return rows(
        *(
            row(method, case, 0, {"d": value * factor}, dataset=dataset, sensor=sensor, tags=tags)
            for method, factor in (("poisson", 1.0), ("apss", 2.0))
            for dataset, case, tags, value in (
                ("bumps", "a", "smooth", 1.0),
                ("bumps", "b", "smooth,thin", 2.0),
                ("cad", "a", "sharp,thin", 4.0),
                ("cad", "b", "", 8.0),
            )
            for sensor in ("clean", "noisy")
        )
    )


def test_by_tag_each_case_counts_under_all_of_its_tags(spread):
    board = leaderboard(spread, by="tag")
    assert set(board["sensor"]) == {"all sensors"}
    means = board[board["method"] == "poisson"].set_index("dataset")
    assert dict(means["mean"]) == {"smooth": 1.5, "thin": 3.0, "sharp": 4.0, "untagged": 8.0}
    assert dict(means["planned"]) == {"smooth": 4, "thin": 4, "sharp": 2, "untagged": 2}


def test_by_sensor_all_datasets_are_one_table(spread):
    board = leaderboard(spread, by="sensor")
    assert set(board["dataset"]) == {"all datasets"} and set(board["sensor"]) == {"clean", "noisy"}
    assert (board[board["method"] == "poisson"]["mean"] == 3.75).all()
    assert (board["planned"] == 4).all()  # cases of one id in two datasets are two


def test_by_dataset_and_tag(spread):
    board = leaderboard(spread, by="dataset,tag,sensor")
    assert set(board["dataset"]) == {"bumps smooth", "bumps thin", "cad sharp", "cad thin", "cad untagged"}
    assert len(board) == 2 * 2 * 5


def test_by_dataset_and_sensor_is_the_usual_table(spread):
    pd.testing.assert_frame_equal(leaderboard(spread, by="dataset,sensor"), leaderboard(spread))


def test_by_something_else_is_refused(spread):
    with pytest.raises(UsageError, match="--by tags.*'tag'"):
        leaderboard(spread, by="tags")


# --- one metric side by side ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "across,means",
    [
        ("tag", {"d": 3.75, "smooth": 1.5, "thin": 3.0, "sharp": 4.0, "untagged": 8.0}),
        ("dataset", {"d": 3.75, "bumps": 1.5, "cad": 6.0}),
        ("sensor", {"d": 3.75, "clean": 3.75, "noisy": 3.75}),
    ],
)
def test_across_groups_one_metric_stands_beside_that_over_all(spread, across, means):
    board = overview(spread, across)
    assert list(board.columns) == list(leaderboard(spread).columns)
    assert dict(board[board["method"] == "poisson"].set_index("metric")["mean"]) == means
    assert len(board.groupby(["task", "dataset", "sensor", "split"])) == 1
    assert list(board.index) == list(range(len(board)))
    text = render(board, "markdown", rows=pool(spread, "task"), metrics=list(dict.fromkeys(board["metric"])))
    head = text.splitlines()[2]
    assert all(f"| {name} ↓ " in head for name in means) and head.startswith("| method | rank | d ↓ |")
    assert text.count("###") == 1


def test_across_groups_of_chosen_results_at_a_level_of_ones_own(spread):
    board = overview(spread, "dataset", method="apss", sensor="clean", level=0.8, equal=0.1)
    assert board[["metric", "method", "mean", "planned"]].to_numpy().tolist() == [
        ["d", "apss", 7.5, 4],
        ["bumps", "apss", 3.0, 2],
        ["cad", "apss", 12.0, 2],
    ]
    reach = 3.077683537  # Student's t at 90 % with one degree of freedom, of 2 and 4
    assert board.loc[1, ["ci_low", "ci_high"]].tolist() == pytest.approx([0, 3 + reach])
    assert (board.attrs["level"], board.attrs["equal"]) == (0.8, 0.1)  # as notes below tables say it


def test_across_takes_the_first_metric_asked_for():
    two = rows(*(row("poisson", case, 0, {"d": 1.0, "e": value}) for case, value in (("a", 2.0), ("b", 4.0))))
    board = overview(two, "dataset", metric="e,d")
    assert dict(zip(board["metric"], board["mean"], strict=True)) == {"e": 3.0, "bumps": 3.0}


def test_across_shows_who_solved_nothing_and_keeps_tasks_apart(spread):
    failed = pd.concat([spread, spread.assign(method="rimls", status="error"), spread.assign(task="denoise")])
    board = overview(failed, "tag")
    lost = board[board["method"] == "rimls"]
    assert set(lost["metric"]) == {"d", "smooth", "thin", "sharp", "untagged"}
    assert (lost["solved"] == 0).all() and lost["rank_low"].isna().all()
    assert list(dict.fromkeys(board["task"])) == ["denoise", "reconstruct"]
    assert (board.groupby("task").size() == [10, 15]).all()


def test_across_needs_something_solved():
    with pytest.raises(UsageError, match="nothing was solved"):
        overview(rows(row(case="a"), row(case="b", method="apss")), "tag")


@pytest.mark.parametrize("wrong", ["tag,sensor", "*", "task", "tags"])
def test_across_something_else_is_refused(spread, wrong):
    with pytest.raises(UsageError, match="across"):
        overview(spread, wrong)
