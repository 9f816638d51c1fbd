"""The tables of boards that are written down: who is marked, what the notes say, the format of each number."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from boards import row, rows

from bench.plugins import config_files
from bench.plugins.registry import registry
from bench.ranking.published import Line, Published
from bench.ranking.report.latex import escape, latex
from bench.ranking.report.look import Look
from bench.ranking.report.table import FLOOR, GIVEN, LEARNED, TUNED
from bench.ranking.report.tables import FAILED, FAILED_NOTE, LEFT_OUT, LEFT_OUT_NOTE, looking, tables

ONE = {
    "task": "of_nobody", "dataset": "bumps", "sensor": "samples", "method": "a", "variant": "", "metric": "d",
    "better": "lower", "mean": 2.0, "ci_low": 1.9, "ci_high": 2.1, "floor": 0.5, "rank_low": 1, "rank_high": 1,
    "solved": 8, "planned": 8, "seconds_median": 1.0, "peak_rss_mb": 90.0,
}  # fmt: skip  # what boards have had from the first version on


def board(*changes):
    """A board with a line for each of these changes to a line."""
    return pd.DataFrame([ONE | change for change in changes])


def table(*changes, **options):
    (made,) = tables(board(*changes), **options)
    return made


def cells(*changes, **options):
    """The texts, with their signs, of the first metric."""
    return [cell.text + cell.signs for cell in table(*changes, **options).metrics[0].cells]


NUMBERS = "; seconds: median; peak MB: largest, of solved cases."


def test_a_board_of_an_earlier_version_is_a_table():
    made = table({}, {"method": "b", "mean": 4.0, "rank_low": 2, "rank_high": 3})
    assert made.methods == ("a", "b") and made.ranks == ("1", "2-3") and made.fronts == ()
    assert made.solved == ("8/8", "8/8") and made.parameters == ()
    assert f"mean [95% interval over shapes]{NUMBERS}" in made.notes
    assert not any("No interval" in note or "different cases" in note for note in made.notes)
    other = board({})
    other.attrs["level"] = 0.9
    (made,) = tables(other)
    assert f"mean [90% interval over shapes]{NUMBERS}" in made.notes


def test_fronts_with_gaps_as_a_file_gives_them():
    made = board({}, {"method": "b"}, {"method": "c"}).assign(front=pd.array([1, None, 0], "Int64"))
    assert tables(made)[0].fronts == ("1", "", "")


def test_a_front_replaces_the_rank_of_a_task_that_is_judged_by_two_metrics(monkeypatch):
    monkeypatch.setattr(registry().find("task", "reconstruct").cls, "primary", ("e", "d"))
    lines = board(*({"method": m, "metric": name} for m in "ab" for name in "de"))
    lines = lines.assign(task="reconstruct", front=[1.0, 1.0, math.nan, math.nan])

    def shown(metrics=(), **attrs):
        lines.attrs = attrs
        (made,) = tables(lines, metrics=metrics)
        said = [note for note in made.notes if "front:" in note or "single rank" in note]
        return [m.name for m in made.metrics], made.ranks, made.fronts, said

    by = "front: 1 where no other method is better in both {0}, by the means; equal is not better."
    two, costs = by.format("e and d"), by.format("d and seconds")
    instead = "This task has no single rank: it is judged by e and d."
    assert shown() == (["e", "d"], (), ("1", ""), [instead, two])
    assert shown(metrics=["d"]) == (["d", "e"], ("1", "1"), ("1", ""), [two])
    assert shown(pareto=("d", "seconds")) == (["e", "d"], ("1", "1"), ("1", ""), [costs])


def test_methods_and_metrics_that_lack_cases_are_named():
    lines = board({}, {"method": "b"}, {"metric": "precision@0.01"}).assign(undefined=[2, 0, 5], not_run=[0, 3, 0])
    (made,) = tables(lines)
    assert [metric.name for metric in made.metrics] == ["d"]  # half of an F-score is not shown
    different, undefined = made.notes[-2:]
    assert different.startswith("Methods were run on different cases: b lacks 3.")
    assert undefined.startswith("Not defined for every output: d (up to 2 outputs of a method). Each pair")


def test_where_all_failed_there_is_a_line_and_no_score():
    made = table({"metric": "", "mean": math.nan, "ci_low": math.nan, "ci_high": math.nan, "solved": 0})
    assert (made.methods, made.metrics, made.ranks, made.solved) == (("a",), (), ("-",), ("0/8",))
    assert made.notes == ()


# -- marks -------------------------------------------------------------------------------------------------------------


def test_methods_are_marked_by_what_they_were_given(tmp_path, monkeypatch):
    folder = tmp_path / "conf" / "method"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("defaults: [jet]\n_tier_: tuned\nk: 24\n")
    monkeypatch.chdir(tmp_path)
    config_files.use([])
    lines = ({}, {"method": "b", "true_distances": 1}, {"method": "jet", "variant": "k=24", "true_distances": 9})
    made = table(*(line | {"true_distances": line.get("true_distances", math.nan)} for line in lines))
    assert made.methods == ("a", f"b {GIVEN}", f"mine {GIVEN}{TUNED}")
    assert [note[0] for note in made.notes if note[0] in (GIVEN, LEARNED, TUNED)] == [GIVEN, TUNED]
    assert not any(note[0] in (GIVEN, TUNED) for note in table({}, {"method": "jet"}).notes)


@pytest.mark.parametrize("sign", [FAILED, LEFT_OUT, GIVEN, LEARNED, TUNED, "|diff|"])
def test_the_signs_of_a_table_are_explained_below_it_in_latex_too(sign):
    made = replace(table({}), notes=(f"{sign} is what it is.", "An author may need this."))
    text = latex([made])
    below = next(line for line in text.splitlines() if "parbox" in line)
    assert f"{escape(sign)} is what it is." in below and "% An author may need this." in text.splitlines()


@pytest.mark.parametrize(
    ("solved", "imputed", "mark"),
    [(0, 0, ""), (8, 0, ""), (7, 1, FAILED), (7, 0, LEFT_OUT), (1, 7, FAILED), (6, 1, LEFT_OUT)],
)
def test_a_mean_over_failures_says_how_they_enter(solved, imputed, mark):
    made = table({}, {"method": "b", "solved": solved, "imputed": imputed})
    assert [cell.mark for cell in made.metrics[0].cells] == ["", mark]
    assert (FAILED_NOTE in made.notes) == (mark == FAILED) and (LEFT_OUT_NOTE in made.notes) == (mark == LEFT_OUT)


def test_a_metric_that_has_fewer_scores_than_the_method_solved_has_its_own_count():
    made = table({"solved": 7}, {"metric": "e", "solved": 5})
    assert [metric.cells[0].mark for metric in made.metrics] == [LEFT_OUT, f"{LEFT_OUT}5/8"]
    assert made.solved == ("7/8",) and LEFT_OUT_NOTE in made.notes and FAILED_NOTE not in made.notes


def places(*means_and_places, **changes):
    """Which of the cells of a column are the best, second and tied ones, as letters."""
    lines = [{"method": f"m{i}", "mean": m, "place": place} for i, (m, place) in enumerate(means_and_places)]
    lines[-1] |= changes
    made = table(*lines, look=Look(digits=1))
    return ["b" * c.best + "s" * c.second + "t" * c.tied for c in made.metrics[0].cells]


def test_the_same_printed_mean_is_the_best_everywhere_and_then_there_is_no_second():
    assert places((1.0, "best"), (2.0, "tied second"), (3.0, "tied"), (4.0, "")) == ["b", "st", "t", ""]
    assert places((1.0, "best"), (1.001, "tied second"), (3.0, "")) == ["b", "b", ""]
    assert places((1.0, "best"), (1.001, "tied"), (3.0, "second")) == ["b", "b", ""]
    assert places((1.0, "best"), (2.0, "second"), (1.0, "tied"), solved=7) == ["b", "s", "t"]  # it has failures
    assert places((1.0, "tied"), (2.0, "")) == ["t", ""]


# -- numbers -----------------------------------------------------------------------------------------------------------


def test_a_column_of_small_numbers_has_a_power_of_ten_and_a_note():
    made = table({"mean": 0.0021, "ci_low": 0.002, "ci_high": 0.0022, "floor": 0.0005})
    (metric,) = made.metrics
    assert (metric.exponent, metric.cells[0].text, metric.floor) == (-3, "2.10 [2.00, 2.20]", "0.500")
    assert "A power of ten beside a metric: its numbers are in that unit." in made.notes
    assert not any("power of ten" in note for note in table({}).notes)


@pytest.mark.parametrize(("floors", "said"), [((0.5, 0.5), "0.500"), ((0.25, 0.5), "0.250 to 0.500")])
def test_floors_that_differ_are_a_range(floors, said):
    made = table(*({"method": m, "floor": floor} for m, floor in zip("ab", floors, strict=True)))
    ((name, cell),) = made.feet
    assert (name, cell(made.metrics[0]).text) == (FLOOR, said)
    assert table({"floor": math.nan}).feet == []


def test_a_difference_to_the_reference_is_named_and_a_paper_prints_the_value():
    made = table({"better": "reference", "floor": 1.0})
    assert (made.metrics[0].better, made.metrics[0].floor) == ("difference", "ref 1")
    assert any(note.startswith("|diff|: mean absolute difference") for note in made.notes)
    assert table({"better": "reference", "floor": math.nan}).metrics[0].floor == ""
    assert not any("|diff|" in note for note in table({}).notes)


@pytest.mark.parametrize(
    ("shapes", "low", "said"),
    [(1, math.nan, True), (1, 1.9, False), (2, math.nan, False), (4, 1.9, False)],
)
def test_one_case_has_no_interval(shapes, low, said):
    made = table({"shapes": shapes, "ci_low": low, "ci_high": 4 - low})
    assert ("No interval: only one case." in made.notes) == said
    assert made.metrics[0].cells[0].text == ("2" if math.isnan(low) else "2.00 [1.90, 2.10]")
    nothing = {"method": "b", "shapes": 0, "mean": math.nan, "ci_low": math.nan, "ci_high": math.nan, "solved": 0}
    assert not any("No interval" in note for note in table({}, nothing).notes)


def test_costs_have_as_many_decimals_as_asked_for_and_a_dash_where_nothing_was_solved():
    failed = {"method": "b", "solved": 0, "seconds_median": math.nan, "peak_rss_mb": math.nan}
    lines = ({"seconds_median": 12.344, "peak_rss_mb": 1234.5678}, failed)
    made = table(*lines)
    assert made.seconds == ("12.3", "-") and made.memory == ("1,235", "-")
    assert table(*lines, look=Look(digits=2)).seconds == ("12.34", "-")
    assert cells({}, look=Look(digits=3)) == ["2.000 [1.900, 2.100]"]


def test_only_what_is_shown_is_explained():
    def first(*columns):
        notes = table({}, {"method": "b"}, look=Look(columns=columns)).notes
        (found,) = [note for note in notes if note.startswith("mean")]
        return found, any(note.startswith("rank: by d") for note in notes)

    mean = "mean [95% interval over shapes]"
    assert first() == (f"{mean}{NUMBERS}", True)
    assert first("d") == (f"{mean}.", False)
    assert first("d", "seconds") == (f"{mean}; seconds: median, of solved cases.", False)
    assert first("peak_mb", "rank") == (f"{mean}; peak MB: largest, of solved cases.", True)
    few = table({"shapes": 3}, {"method": "b", "shapes": 3})
    assert few.ranks == ("-", "-") and not any(note.startswith("rank:") for note in few.notes)


def test_parameters_are_those_of_learned_methods():
    def shown(*counts):
        changes = {"task": "of_nobody", "host": "", "status": "ok"}
        names = "abcde"[: len(counts)]
        made = rows(*(row(m, **changes, parameters=n) for m, (n, _) in zip(names, counts, strict=True)))
        made = made.assign(active_parameters=[active for _, active in counts])
        return table(*({"method": m} for m in names), rows=made).parameters

    counts = [(1_300_000, None), (None, None), (0, None), (2, 1), (1_300_000, 0)]
    assert shown(*counts) == ("1.3M", "-", "-", "2 (1 active)", "1.3M")
    assert shown((0, None), (None, None)) == ()


# -- the user's wishes -------------------------------------------------------------------------------------------------


def test_captions_and_columns():
    made = table({})
    assert looking([made], Look()) == [made]
    (captioned,) = looking([made], Look(caption="Ours."))
    assert captioned.title == "Ours." and captioned.order == () and made.title == "of_nobody · bumps · samples"
    (ordered,) = looking([made], Look(columns=("d", "rank", "d")))
    assert ordered.order == ("d", "rank") and ordered.title == made.title
    assert looking([], Look(columns=("d",))) == []  # there is no table that could have it


def test_a_papers_column_stands_beside_ours():
    lines = (Line({"d": 9.85}, "a"), Line({"d": 3.0}, "c"), Line({"d": 4.0}, "a", sensor="other"))
    lines += (Line({"d": 5.0}, "e", sensor="samples"), Line({"d": 6.0}, "f", sensor="test"))
    paper = Published("their table", "paper", "", lines)
    made = table({}, {"method": "b"}, {"metric": "e"}, published=paper)
    assert [metric.name for metric in made.metrics] == ["d", "d, paper", "e"]
    _, theirs, _ = made.metrics
    assert [cell.text for cell in theirs.cells] == ["9.85", ""]
    assert (theirs.exponent, theirs.floor, theirs.better) == (0, "", "lower")
    assert made.notes[-2:] == ("paper: their table.", "paper, not among ours: c: d 3.0; e: d 5.0.")
