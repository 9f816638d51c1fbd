"""The best parameters of a sweep: geometric means, effects and intervals against pandas and scipy by hand."""

import math
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from boards import row, rows
from records import cell_of, record
from scipy import stats

from bench.commands.leaderboard import Output
from bench.commands.leaderboard_best import check_preset, show_best, write_preset
from bench.errors import UsageError
from bench.plan.cell import Choice
from bench.plugins import config_files
from bench.plugins.presets import presets
from bench.ranking.best import Best, Effect, Variant, best
from bench.ranking.report import in_format
from bench.ranking.report.best_tables import best_tables, frame_of
from bench.ranking.report.look import Look
from bench.results.store import Results

CASES = [f"s{i}" for i in range(6)]


def sweep(depths=(6, 8, 10), trims=(0.1, 0.2), left_out=(), split="train", **changes):
    """A grid of two parameters, each case with its own difficulty; depth 10 and trim 0.1 are best."""
    rng = np.random.default_rng(0)
    hard = rng.lognormal(0, 1, len(CASES))
    records = []
    for depth in depths:
        for trim in trims:
            if (depth, trim) in left_out:
                continue
            parts = [f"depth={depth}"] if depth != 8 else []  # 8 is the default
            variant = ",".join([*parts, f"trim={trim:g}"])
            for i, case in enumerate(CASES):
                for seed in (0, 1):
                    score = hard[i] * 20 / depth * (1 + trim) * rng.lognormal(0, 0.05)
                    where = {"variant": variant, "split": split, "case_index": i, **changes}
                    records.append(row("poisson", case, seed, {"d": score}) | where)
    return rows(*records)


def by_hand(frame):
    return np.exp(np.log(frame["score.d"]).groupby(frame["variant"]).mean()).sort_values()


def test_variants_are_in_the_order_of_their_geometric_means():
    frame = sweep()
    (one,) = best(frame)
    means = by_hand(frame)
    assert [v.variant for v in one.variants] == list(means.index)
    assert [v.mean for v in one.variants] == pytest.approx(list(means))
    assert one.variants[0].variant == "depth=10,trim=0.1" and one.shapes == 6
    assert [v.ratio for v in one.variants] == pytest.approx(list(means / means.iloc[0]))


def test_small_scores_have_their_means_too_and_zeros_those_of_the_least():
    frame = sweep()
    frame["score.d"] *= 1e-6
    means = [v.mean for v in best(frame)[0].variants]
    assert means == pytest.approx(list(by_hand(frame)))
    frame.loc[frame["case"] == "s0", "score.d"] = 0.0
    (one,) = best(frame)
    frame["score.d"] = frame["score.d"].clip(lower=1e-9)
    assert [v.mean for v in one.variants] == pytest.approx(list(by_hand(frame)))


def test_the_interval_of_a_ratio_is_students_over_the_shapes():
    frame = sweep()
    (one,) = best(frame)
    logs = np.log(frame["score.d"]).groupby([frame["case"], frame["variant"]]).mean().unstack()
    first = one.variants[0].variant
    for variant in one.variants[1:]:
        test = stats.ttest_rel(logs[variant.variant], logs[first])
        low, high = np.exp(test.confidence_interval(0.95))
        assert (variant.low, variant.high) == pytest.approx((low, high))
        assert variant.is_tied == (test.pvalue >= 0.05)


def test_a_parameter_without_effect_ties():
    frame = sweep(depths=(10,))
    frame["score.d"] = frame.groupby(["case", "seed"])["score.d"].transform("first")
    (one,) = best(frame)
    assert [(v.ratio, v.low, v.high, v.is_tied) for v in one.variants] == [(1, 1, 1, True)] * 2
    assert [(e.parameter, e.value, e.ratio) for e in one.effects] == [("trim", "0.1", 1), ("trim", "0.2", 1)]


@pytest.mark.parametrize("shapes", [3, 4])
def test_fewer_than_four_shapes_give_no_interval(shapes):
    frame = sweep()
    (one,) = best(frame[frame["case"].isin(CASES[:shapes])])
    assert [np.isfinite([v.ratio, v.low, v.high]).tolist() for v in one.variants] == [[True, *[shapes == 4] * 2]] * 6


def test_of_a_share_the_highest_is_best():
    frame = sweep()
    (one,) = best(frame.assign(directions='{"d": "higher"}', **{"score.d": 1 / frame["score.d"]}))
    (lowest,) = best(frame)
    assert [v.variant for v in one.variants] == [v.variant for v in lowest.variants] and one.better == "higher"
    assert [1 / v.ratio for v in one.variants] == pytest.approx([v.ratio for v in lowest.variants])
    assert [(e.value, 1 / e.ratio) for e in one.effects] == [(e.value, pytest.approx(e.ratio)) for e in lowest.effects]


def test_the_metric_is_that_of_the_task_or_the_first_given():
    """Both are distances, which each task would choose by the alphabet if it did not choose itself."""
    surface, chamfer = "surface_distance_mean", "chamfer_l1_mean"
    tasks = {"reconstruct": surface, "denoise": chamfer}
    frame = pd.concat([sweep(task=task) for task in tasks], ignore_index=True)
    frame = frame.rename(columns={"score.d": f"score.{surface}"})
    frame[f"score.{chamfer}"] = frame[f"score.{surface}"]
    frame["directions"] = f'{{"{surface}": "lower", "{chamfer}": "lower"}}'
    assert [(one.group[0], one.metric) for one in best(frame)] == sorted(tasks.items())
    assert [one.metric for one in best(frame, metric=f"{surface},{chamfer}")] == [surface] * 2
    frame[f"score.{surface}"] = np.nan  # of open surfaces, say
    assert [one.metric for one in best(frame)] == [chamfer] * 2


def test_the_effect_of_a_parameter_pools_the_others():
    frame = sweep()
    (one,) = best(frame)
    depth = frame["variant"].str.extract(r"depth=(\d+)")[0].fillna("8")  # the default, from the plugin
    trim = frame["variant"].str.extract(r"trim=([\d.]+)")[0]
    for name, values in (("depth", depth), ("trim", trim)):
        means = np.exp(np.log(frame["score.d"]).groupby(values).mean())
        found = {e.value: e for e in one.effects if e.parameter == name}
        assert set(found) == set(means.index)
        for value, mean in means.items():
            assert found[value].mean == pytest.approx(mean)
            assert found[value].ratio == pytest.approx(mean / means.min())
    assert [e.value for e in one.effects if e.parameter == "depth"] == ["6", "8", "10"]


def test_effects_of_a_grid_with_holes_compare_like_with_like():
    """Without depth 10 at trim 0.2, depths are compared at trim 0.1 alone: pooled, 10 would profit from the hole."""
    frame = sweep(left_out=[(10, 0.2)])
    (one,) = best(frame)
    depths = {e.value: e for e in one.effects if e.parameter == "depth"}
    means = by_hand(frame)
    assert depths["6"].mean == pytest.approx(means["depth=6,trim=0.1"]) and depths["6"].variants == 1


def test_effects_without_like_settings_are_those_of_each_value():
    """No trim was run with both depths: each value has the mean of its own variants."""
    frame = sweep(depths=(6, 10), left_out=[(6, 0.2), (10, 0.1)])
    (one,) = best(frame)
    means = by_hand(frame)
    found = {(e.parameter, e.value): (e.mean, e.variants) for e in one.effects}
    for depth, trim in (("6", "0.1"), ("10", "0.2")):
        expected = pytest.approx((means[f"depth={depth},trim={trim}"], 1))
        assert found["depth", depth] == expected and found["trim", trim] == expected


def test_a_winner_at_the_edge_is_noted_with_what_to_try():
    (one,) = best(sweep())
    assert [re.match(r"\w+=[\d.]+ is the \w+", text)[0] for text in one.edges] == [
        "depth=10 is the largest",
        "trim=0.1 is the least",
    ]
    assert "method.depth=12" in one.edges[0] and "method.trim=0.05" in one.edges[1]


def of_values(values, winner, more=""):
    """One case with each value of a parameter."""
    return rows(
        *(
            row("mine", "s", 0, {"d": 1.0 if value == winner else 2.0}, split="train", variant=f"{more}x={value}")
            for value in values.split()
        )
    )


@pytest.mark.parametrize(
    ("values", "winner", "beyond"),
    [
        ("5 10", "10", "15"),
        ("5 10 15", "15", "20"),
        ("100 110 120", "120", "130"),
        ("0.5 0.55 0.6", "0.6", "0.65"),
        ("1.5 2.0 2.5", "1.5", "1"),
        ("3 6 10", "3", "2"),
        ("1 2 4", "4", "8"),
        ("1 2 4 8", "8", "16"),
        ("1 3 10 30", "30", "90"),
        ("0.001 0.003 0.01 0.03", "0.03", "0.09"),
        ("0.001 0.01 0.1", "0.001", "0.0001"),
        ("0.1 0.2", "0.1", "0.05"),  # no error, weight or radius is 0 or less
        ("0 1 2", "0", "-1"),
        ("0 1 2", "2", "3"),
        ("-4 -2 -1", "-4", "-8"),
        ("262144 524288 1048576", "1048576", "2097152"),  # all digits: it is the number of something
        ("2 4 8", "2", "1"),
        ("1 2 3", "1", None),  # 0 of something is none, and half of one too
    ],
)
def test_what_to_try_next_continues_the_series(values, winner, beyond):
    (one,) = best(of_values(values, winner))
    (text,) = one.edges
    assert f"x={winner} is the {'least' if winner == values.split()[0] else 'largest'}" in text
    assert re.findall(r"method\.x=(.*)\.$", text) == ([beyond] if beyond else [])


def test_only_numbers_have_an_edge():
    assert best(of_values("5 10 15", "10"))[0].edges == ()
    assert best(of_values("fast slow", "slow"))[0].edges == ()
    assert best(of_values("auto 5", "5"))[0].edges == ()  # one number is no series
    both = [of_values("5 10", "10", "mode=fast,"), of_values("5 10", "", "mode=slow,")]
    (text,) = best(pd.concat(both, ignore_index=True))[0].edges
    assert text.startswith("x=10 is the largest")


def test_effects_are_in_the_order_of_the_numbers_then_words():
    (one,) = best(of_values("10 none 0.5 2 0 auto", "2"))
    assert [e.value for e in one.effects] == ["0", "0.5", "2", "10", "auto", "none"]


def test_only_train_shapes_count_unless_the_user_chooses_others():
    both = pd.concat([sweep(), sweep(split="test").assign(**{"score.d": 1e-3})], ignore_index=True)
    (one,) = best(both)
    assert one.group[3] == "train" and one.variants[0].mean > 0.1
    (flattered,) = best(both, split="test")
    notes = [note for table in best_tables([flattered]) for note in table.notes]
    assert any(note.startswith("Chosen on test shapes") for note in notes)
    with pytest.raises(UsageError, match="split=train.*--split test"):
        best(sweep(split="test"))
    with pytest.raises(UsageError, match="split=train.*--split test"):
        best(sweep().drop(columns="split"))  # of another tool: test shapes


def test_a_failure_counts_what_the_worst_pseudo_method_scores():
    frame = sweep()
    frame["worst.d"] = 50.0
    at = frame.index[frame["variant"] == "depth=10,trim=0.1"][0]
    frame.loc[at, ["status", "score.d", "seconds"]] = ["timeout", np.nan, 600.0]
    (one,) = best(frame)
    found = next(v for v in one.variants if v.variant == "depth=10,trim=0.1")
    values = frame["score.d"].fillna(50.0)[frame["variant"] == found.variant]
    assert found.mean == pytest.approx(math.exp(np.log(values).mean())) and (found.solved, found.planned) == (11, 12)
    assert {v.seconds for v in one.variants} == {1.0}  # the limit of time is not the time of the method


def test_a_failure_of_unknown_cost_is_no_mean():
    """Left out of the mean, the failure would pay: also if the case was solved with another seed, or more threads."""
    frame = sweep()
    again = frame.assign(threads=4)
    failed = (frame["variant"] == "depth=10,trim=0.1") & (frame["case"] == "s0") & (frame["seed"] == 0)
    again.loc[failed, ["status", "score.d"]] = ["error", np.nan]
    (one,) = best(pd.concat([frame, again], ignore_index=True))
    means = by_hand(frame).drop("depth=10,trim=0.1")
    *others, last = one.variants
    assert [v.variant for v in others] == list(means.index)
    assert [v.ratio for v in others] == pytest.approx(list(means / means.iloc[0]))
    assert last.variant == "depth=10,trim=0.1" and not last.is_tied and (last.solved, last.planned) == (23, 24)
    assert np.isnan([last.mean, last.ratio, last.low, last.high]).all()
    effects = {e.value: e for e in one.effects if e.parameter == "depth"}
    assert np.isnan([effects["10"].mean, effects["10"].ratio]).all() and effects["8"].ratio == 1


def test_a_case_that_failed_with_every_setting_is_left_out():
    """As one that could not be made."""
    frame = sweep()
    frame.loc[frame["case"] == "s0", ["status", "score.d"]] = ["error", np.nan]
    (one,) = best(frame)
    means = by_hand(frame[frame["case"] != "s0"])
    assert [v.variant for v in one.variants] == list(means.index)
    assert [v.mean for v in one.variants] == pytest.approx(list(means))
    assert one.shapes == 5 and [(v.solved, v.planned) for v in one.variants] == [(10, 12)] * 6
    assert any("2 of 12" in note for note in one.notes) and not best(sweep())[0].notes


def test_without_any_mean_there_is_no_winner(here):
    """Each setting failed on a case of its own, at unknown cost."""
    frame = stored(here / "results")
    for i, variant in enumerate(frame["variant"].unique()):
        failed = (frame["variant"] == variant) & (frame["case"] == f"s{i}")
        frame.loc[failed, ["status", "score.d"]] = ["error", np.nan]
    (one,) = best(frame)
    assert np.isnan([line.mean for line in (*one.variants, *one.effects)]).all() and one.edges == ()
    variants, effects = best_tables([one])
    assert [cell.text for cell in variants.metrics[1].cells] == ["-"] * 3
    assert not any("Fewer than" in note for note in variants.notes)
    assert len(effects.methods) == 3
    with pytest.raises(UsageError, match="no setting of poisson"):
        write_preset("x", [one], frame, ["results"])


def test_variants_of_fewer_cases_are_left_out_and_named():
    frame = sweep()
    frame = frame[~((frame["variant"] == "depth=6,trim=0.2") & (frame["case"] == "s0"))]
    (one,) = best(frame)
    assert len(one.variants) == 5 and "depth=6,trim=0.2 (10 of 12)" in one.notes[0]


def test_of_other_cases_those_of_most_variants_are_compared():
    frame = sweep(trims=(0.1,))
    other = frame["variant"] == "depth=10,trim=0.1"  # best, and first in the alphabet
    frame = frame[frame["case"] != np.where(other, "s0", "s5")]
    (one,) = best(frame)
    means = by_hand(frame).drop("depth=10,trim=0.1")
    assert [v.variant for v in one.variants] == list(means.index) and one.shapes == 5
    assert [v.mean for v in one.variants] == pytest.approx(list(means))
    assert "depth=10,trim=0.1 (10 of 10)" in one.notes[0]
    (alone,) = best(frame[frame["variant"] != "trim=0.1"])  # nothing left to compare
    assert [v.ratio for v in alone.variants] == [1] and alone.effects == alone.edges == ()


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(UsageError, match="several settings"):
        best(rows(*(row("a", c, 0, {"d": 1.0}, split="train") for c in CASES)))
    with pytest.raises(UsageError, match="reference's own value"):
        best(sweep().assign(directions='{"d": "reference"}', **{"floor.d": 1.0}))
    with pytest.raises(UsageError, match="nothing was solved"):
        best(sweep().assign(status="error", directions=""))


def test_the_csv_has_every_variant():
    found = best(sweep())
    frame = frame_of(found)
    assert frame["geometric_mean"].tolist() == [v.mean for v in found[0].variants]
    assert set(frame["split"]) == {"train"}


# --- in print ---------------------------------------------------------------------------------------------------------


def of_lines(*lines, shapes=6, effects=()):
    """Variants by hand, from their names, means, ratios, and the intervals of these."""
    variants = (Variant(name, {}, mean, ratio, *ends, 3, 4, 1.5) for name, mean, ratio, ends in lines)
    group = ("reconstruct", "all datasets", "all sensors", "train")
    return Best(group, "mine", "d", "lower", shapes, 0.95, tuple(variants), effects, (), ())


def printed(one, **options):
    """The cells of all tables in Markdown, a line each."""
    text = in_format(best_tables([one], Look(**options)), "markdown", Look())
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:2] == "| "]


NO_ENDS = (math.nan, math.nan)
LINES = (
    ("", 2.5, 1.0, (1.0, 1.0)),
    ("x=2,y=3", 2.75, 1.1, (0.9, 1.3)),
    ("x=3", 5.0, 2.0, (1.5, 2.6)),
    ("x=4", math.nan, math.nan, NO_ENDS),  # failed at unknown cost
)


def test_the_ratios_stand_with_their_intervals_and_ties():
    one = of_lines(*LINES, shapes=4)
    assert printed(one) == [
        ["parameters", "d ↓", "ratio", "solved", "seconds"],
        ["---", "---", "---", "--:", "--:"],
        ["(the defaults)", "2.500", "**1**", "3/4", "1.50"],
        ["x=2, y=3", "2.750", "1.100 [0.900, 1.300] ≈", "3/4", "1.50"],
        ["x=3", "5.000", "2.000 [1.500, 2.600]", "3/4", "1.50"],
        ["x=4", "-", "-", "3/4", "1.50"],
    ]
    (table,) = best_tables([one])
    assert any("it holds 1 for 1 of the others" in note for note in table.notes)
    assert not any("Fewer than" in note for note in table.notes)
    (table,) = best_tables([of_lines(LINES[0], LINES[3])])
    assert any("it holds 1 for 0 of the others" in note for note in table.notes)


def test_without_intervals_nothing_ties():
    one = of_lines(*((name, mean, ratio, NO_ENDS) for name, mean, ratio, _ in LINES), shapes=3)
    assert [line[2] for line in printed(one)[2:]] == ["**1**", "1.100", "2.000", "-"]
    (table,) = best_tables([one])
    assert not any("interval over shapes" in note for note in table.notes)
    assert any(note.startswith("Fewer than 4 shapes") for note in table.notes)


@pytest.mark.parametrize("more", [0, 1, 5])
def test_a_long_table_is_cut_but_not_its_ties(more):
    (table,) = best_tables([of_lines(LINES[0], *LINES[1:2] * (29 + more))])
    assert len(table.methods) == 30
    rest = {0: [], 1: ["The CSV has 1 more variant."], 5: ["The CSV has 5 more variants."]}
    assert [note for note in table.notes if "CSV" in note] == rest[more]
    assert any(f"it holds 1 for {29 + more} of the others" in note for note in table.notes)


@pytest.mark.parametrize(
    ("means", "digits", "texts"),
    [
        ((2.5, 3.5), None, ["2.500", "3.500"]),  # one digit more than in a table of methods
        ((0.004, 0.25, 0.3), None, ["0.0040", "0.2500", "0.3000"]),  # but not more than four
        ((2.5, 3.5), 1, ["2.5", "3.5"]),
    ],
)
def test_the_means_have_a_digit_more_for_variants_are_close(means, digits, texts):
    lines = printed(of_lines(*((f"x={mean}", mean, 2.0, NO_ENDS) for mean in means)), digits=digits)
    assert [line[1] for line in lines[2:]] == texts


def test_the_best_value_of_each_parameter_is_bold():
    values = (
        ("x", "1", 3.0, 1.2, 2),
        ("x", "2", 2.5, 1.0, 3),
        ("y", "a", 2.5, 1.0, 1),
        ("y", "b", math.nan, math.nan, 2),
    )
    assert printed(of_lines(LINES[0], effects=tuple(Effect(*value) for value in values)))[3:] == [
        ["parameter", "d ↓", "ratio", "variants"],
        ["---"] * 4,
        ["x=1", "3.000", "1.200", "2"],
        ["x=2", "2.500", "**1.000**", "3"],
        ["y=a", "2.500", "**1.000**", "1"],
        ["y=b", "-", "-", "2"],
    ]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def stored(folder):
    """A sweep in a folder, whose records hold the parameters exactly."""
    frame = sweep(trims=(0.1,))
    results = Results(folder)
    for variant, part in frame.groupby("variant"):
        depth = int(re.search(r"depth=(\d+)", variant)[1]) if "depth" in variant else 8
        method = Choice("method", "poisson", {"depth": depth, "trim": 0.1})
        cell = replace(cell_of(), method=method, split="train")
        one = record(cell.id, method="poisson", split="train")
        one.meta["cell"] = cell.to_json()
        results.write(one)
        frame.loc[part.index, ["cell", "fingerprint"]] = [one.cell, one.fingerprint]
    return frame


def test_the_winner_becomes_a_preset_that_is_found(here, capsys):
    frame = stored(here / "results")
    show_best(frame, Output(), preset="my_poisson", folders=["results"], by=None)
    assert "method=my_poisson" in capsys.readouterr().err
    for cached in (config_files._folders, config_files._found):  # the next command is another process
        cached.cache_clear()
    assert presets("method", "poisson")["my_poisson"].values == {"depth": 10, "trim": 0.1}
    with pytest.raises(UsageError, match="already exists"):
        check_preset("my_poisson")


def test_a_preset_that_cannot_be_written_reports_why(here):
    frame = stored(here / "results")
    found = best(frame)
    with pytest.raises(UsageError, match="small letters"):
        check_preset("My preset")
    with pytest.raises(UsageError, match="is a method itself"):
        check_preset("poisson")
    with pytest.raises(UsageError, match="2 winners"):
        write_preset("x", found * 2, frame, ["results"])
    with pytest.raises(UsageError, match="no record of poisson"):
        write_preset("x", found, frame.assign(cell="nothing"), ["results"])
    assert not (here / "conf").exists()
