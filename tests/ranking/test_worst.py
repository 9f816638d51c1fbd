"""The worst cases of a method: ratios by hand, tags against Fisher's exact test, what is printed."""

import io
import math

import numpy as np
import pandas as pd
import pytest
from boards import row, rows
from records import cell_of, record
from scipy import stats

from bench import cli
from bench.commands import worst as command
from bench.errors import UsageError
from bench.ranking.report import FORMATS, in_format
from bench.ranking.report.look import Look
from bench.ranking.report.worst_tables import case_notes, worst_tables
from bench.ranking.statistics import holm_p
from bench.ranking.worst import COLUMNS, commands, folder_of, outputs, worst
from bench.results.store import Results

CASES = [f"s{i:02d}" for i in range(12)]
THIN = {"s00", "s04", "s07"}


def tags(case):
    return ",".join(["smooth", *(["thin"] if case in THIN else []), *(["odd"] if int(case[1:]) % 2 else [])])


@pytest.fixture(scope="module")
def frame():
    """Two variants of `mine` and two others; `mine` is bad on thin shapes, and fails on one of them."""
    rng = np.random.default_rng(0)
    records = []
    for i, case in enumerate(CASES):
        for method, variant, factor in (("mine", "k=3", 1.5), ("mine", "", 1.2), ("a", "", 1.0), ("b", "", 1.1)):
            factor = factor * (8 + i) if method == "mine" and case in THIN else factor
            score = {"d": factor * rng.lognormal(0, 0.1)}
            failed = variant == "k=3" and case == "s04"
            changes = {"variant": variant, "tags": tags(case), "case_index": i, "output": None}
            made = row(method, case, 0, None if failed else score, worst={"d": 100.0}) | changes
            records.append(made | ({"message": "no ball fits\x1b[31m", "status": "error"} if failed else {}))
    return rows(*records)


def by_hand(frame):
    values = frame.assign(score=frame["score.d"].fillna(100.0), who=frame["method"] + frame["variant"])
    table = values.pivot(index="case", columns="who", values="score")
    return (table["minek=3"] / table[["mine", "a", "b"]].min(axis=1)).sort_values(ascending=False)


def test_cases_are_in_the_order_of_their_ratio_to_the_best_other(frame):
    (found,) = worst(frame, "mine[k=3]")
    ratios = by_hand(frame)
    assert found.cases["case"].tolist() == ratios.index.tolist() and found.metric == "d"
    assert found.cases["ratio"].tolist() == pytest.approx(ratios.tolist())
    assert set(found.cases["case"][:3]) == THIN and found.method == "mine (k=3)"
    assert set(found.cases["best_method"]) <= {"a", "b", "mine"}
    assert list(found.cases) == list(COLUMNS) and found.cases.index.equals(pd.RangeIndex(12))


def test_a_failure_has_the_score_of_the_worst_pseudo_method(frame):
    (found,) = worst(frame, "mine[k=3]", order="score")
    first = found.cases.iloc[0]
    assert (first["case"], first["value"], first["status"]) == ("s04", 100.0, "error")


def test_the_score_of_a_failure_may_stand_in_the_row_of_another_method(frame):
    """As that of a method that ended its process; the rows are of files without splits, and the filters leave some."""
    bare = frame.drop(columns="split")
    bare.loc[(bare["method"] == "mine") & (bare["variant"] == "k=3"), "worst.d"] = np.nan
    bare = pd.concat([bare.assign(dataset="cad"), bare.assign(sensor="noisy"), bare], ignore_index=True)
    (found,) = worst(bare, "mine[k=3]", order="score", dataset="bumps", sensor="samples")
    assert found.cases["value"].iloc[0] == 100 and len(found.cases) == 12
    assert (set(found.cases["dataset"]), set(found.cases["sensor"])) == ({"bumps"}, {"samples"})


def test_a_failure_of_unknown_worth_comes_first(frame):
    (found,) = worst(frame.drop(columns="worst.d"), "mine[k=3]")
    assert found.cases["case"].iloc[0] == "s04" and math.isnan(found.cases["ratio"].iloc[0])


def test_higher_is_better_turns_the_ratio_around():
    made = rows(*(row(m, c, 0, {"f": f}, better="higher") for m, f in (("mine", 0.2), ("a", 0.8)) for c in CASES))
    (found,) = worst(made, "mine")
    assert found.cases["ratio"].tolist() == pytest.approx([4.0] * 12)


def test_perfect_results_are_as_good_as_each_other():
    """A distance of 0 is no finite number of times better than another, and not better than 0."""
    scores = {"mine": (0.0, 0.2, 0.0, 0.3), "a": (0.0, 0.1, 0.5, 0.0)}
    made = rows(*(row(m, c, 0, {"d": d}) for m, of in scores.items() for c, d in zip("wxyz", of, strict=True)))
    (found,) = worst(made, "mine")
    assert dict(zip(found.cases["case"], found.cases["ratio"], strict=True)) == {"z": np.inf, "x": 2, "w": 1, "y": 0}
    assert found.cases["case"].tolist() == ["z", "x", "w", "y"]


def test_the_first_metric_that_is_asked_for_decides_or_that_which_ranks():
    scores, directions = {"d": 1.0, "f": 0.5}, '{"d": "lower", "f": "higher"}'
    made = rows(*(row(m, c, 0, scores, directions=directions) for m in ("mine", "a") for c in "xy"))
    chosen = {asked: worst(made, "mine", metric=asked)[0] for asked in (None, "d,f", "f,d", "f")}
    assert {asked: (one.metric, one.better) for asked, one in chosen.items()} == {
        None: ("d", "lower"),
        "d,f": ("d", "lower"),
        "f,d": ("f", "higher"),
        "f": ("f", "higher"),
    }


def test_a_metric_that_is_not_for_the_output_of_the_method_is_refused():
    made = rows(row("mine", "x", 0, {"d": 1.0}), row("a", "x", 0, {"d": 1.0, "angle": 2.0}))
    with pytest.raises(UsageError, match="^mine: has no score by angle here"):
        worst(made, "mine", metric="angle")
    assert worst(made, "mine")[0].metric == "d"


def test_tags_against_fishers_exact_test(frame):
    (found,) = worst(frame, "mine[k=3]")
    bad = set(by_hand(frame).index[:3])
    assert {tag.name for tag in found.tags} == {"thin", "odd"}  # all are smooth, which says nothing
    for tag in found.tags:
        has = {case for case in CASES if tag.name in tags(case).split(",")}
        table = [[len(bad & has), len(bad - has)], [len(has - bad), len(set(CASES) - bad - has)]]
        assert tag.p == pytest.approx(stats.fisher_exact(table, alternative="greater").pvalue)
        assert (tag.bad, tag.of_bad, tag.shapes, tag.of_shapes) == (len(bad & has), 3, len(has), 12)
    assert found.tags[0].name == "thin" and found.tags[0].p == pytest.approx(1 / 220)
    _, second = worst_tables(found, 5)
    assert second.notes[0] == "Over-represented among the worst shapes: thin."


def test_the_correction_is_holms(rng=None):
    p = np.random.default_rng(0).random(7) ** 3
    order = np.argsort(p)
    wanted = np.empty(7)
    wanted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(7, 0, -1)), 1)
    assert holm_p(list(p)) == pytest.approx(list(wanted)) and holm_p([]) == []


def test_few_shapes_have_no_test(frame):
    (found,) = worst(frame[frame["case"].isin(CASES[:7])], "mine[k=3]")
    assert found.tags == () and "a test of tags takes 8" in " ".join(worst_tables(found, 3)[0].notes)
    for shapes, bad in ((8, 2), (9, 3)):  # a quarter, or more
        (found,) = worst(frame[frame["case"].isin(CASES[:shapes])], "mine[k=3]")
        assert {(tag.of_bad, tag.of_shapes) for tag in found.tags} == {(bad, shapes)}


def test_one_method_is_meant(frame):
    with pytest.raises(UsageError, match=r"mine: is 2 methods here: mine\[k=3\]; mine"):
        worst(frame, "mine")
    with pytest.raises(UsageError, match="Did you mean 'mine'"):
        worst(frame, "mien")
    with pytest.raises(UsageError, match="^a: has no score here"):
        worst(frame.assign(status="error", directions=""), "a")


def test_train_and_test_shapes_stay_apart(frame):
    both = pd.concat([frame.assign(split="train"), frame], ignore_index=True)
    assert [(one.split, len(one.cases)) for one in worst(both, "a")] == [("test", 12), ("train", 12)]


@pytest.mark.parametrize("format", ["terminal", "markdown", "latex"])
def test_every_format_shows_cases_tags_and_how_many_are_left_out(frame, format):
    (found,) = worst(frame, "mine[k=3]")
    text = in_format(worst_tables(found, 2), format, Look())
    ratios = by_hand(frame)
    assert f"{ratios.iloc[0]:.2f}" in text and ratios.index[1] in text and ratios.index[2] not in text
    assert "10 more cases: " in text and "thin" in text


def stored(tmp_path):
    """A folder with one record that kept an output."""
    folder = tmp_path / "my results"
    cell = cell_of()
    one = record(cell.id, method="identity", cases=9, output="outputs/x/case-0.ply")
    one.meta["cell"] = cell.to_json()
    Results(folder).write(one)
    kept = folder / "outputs" / "x" / "case-0.ply"
    kept.parent.mkdir(parents=True)
    kept.write_bytes(b"ply")
    return folder, cell, kept


def test_the_commands_and_outputs_are_those_of_the_folder_of_a_row(tmp_path):
    folder, cell, kept = stored(tmp_path)
    folders = [str(tmp_path / "none"), str(folder)]
    rows = Results(folder).rows()
    (found,) = worst(rows, "identity")
    line = found.cases.to_dict("records")[0]
    assert folder_of(line, folders) == str(folder)
    assert folder_of(line | {"fingerprint": "e" * 16}, folders) == folders[0]  # no folder has such a file
    runs, files = commands(found.cases, folders), outputs(found.cases, folders)
    assert runs[0] == f"detailbench reproduce {cell.id} results='{folder}'" and files[0] == str(kept)


def test_the_message_of_a_failure_is_text(frame):
    (found,) = worst(frame, "mine[k=3]", order="score")
    lines = case_notes(found, 1, ["detailbench reproduce c results=r"], ["o.ply"])
    assert lines[0].endswith("detailbench reproduce c results=r") and lines[1] == "  output: o.ply"
    assert lines[2] == r"  error: no ball fits\x1b[31m"


@pytest.mark.parametrize("format", FORMATS)
def test_the_command(tmp_path, capsys, format):
    folder, cell, _ = stored(tmp_path)
    assert cli.main(["worst", "identity", str(folder), "--count", "2", "--format", format]) == 0
    text = capsys.readouterr().out
    assert f"reproduce {cell.id}" in text and "case-0" in text and "case-2" not in text
    if format == "csv":
        back = pd.read_csv(io.StringIO(text))
        assert back["value"].tolist() == [0.1, 0.1] and back["command"].str.contains(cell.id).all()


def test_a_picture_is_drawn_by_the_command_for_figures(tmp_path, monkeypatch, capsys):
    folder, _, _ = stored(tmp_path)
    words = ["worst", "identity", str(folder), "--picture", "w.png"]
    monkeypatch.delitem(cli.COMMANDS, "figure", raising=False)
    assert cli.main(words) == 1 and "has no command `figure`" in capsys.readouterr().err
    asked = []
    monkeypatch.setitem(cli.COMMANDS, "figure", "")
    monkeypatch.setattr(command, "main", lambda words: asked.append(words) or 0)
    assert cli.main(words) == 0
    (drawn,) = asked
    assert drawn[:4] == ["figure", str(folder), "-o", "w.png"]
    options = dict(zip(drawn[4::2], drawn[5::2], strict=True))
    assert options["--case"] == "case-0,case-1,case-2" and options["--method"] == "identity"
    assert options["--metric"] == "p2f_mean" and options["--dataset"] == "balls"
