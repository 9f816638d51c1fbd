"""The numbers of plots, against closed forms and naive loops."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pictured import cell_of, meta_of
from plotted import DIRECTIONS, METHODS, made_rows, scores
from records import row

from bench.errors import UsageError
from bench.pictures.plots import bars, difference, noise, pareto, profile, time, wins
from bench.pictures.plots.kinds import KINDS, Options, plot
from bench.pictures.plots.scores import scores_of
from bench.plan.cell import Choice
from bench.ranking.leaderboard import leaderboard
from bench.results.store import Record, Results


def values_of(rows, metric="p2f_mean"):
    """(units, methods): NaN where failed."""
    return rows.pivot(index=["case", "sensor"], columns="method", values=f"score.{metric}").astype(float).to_numpy()


# --- performance profiles ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("metric", ["p2f_mean", "fscore@0.01"])
def test_a_performance_profile_against_a_naive_loop(metric):
    rows = made_rows(failing=[("apss", 2), ("jet", 2), ("rimls", 4)])
    values = values_of(rows, metric)
    table = profile.table(scores(rows, metric), Options())
    for i, method in enumerate(METHODS):
        for line in table[table["method"] == method].to_dict("records"):
            within = 0
            for unit in values:
                known = [v for v in unit if math.isfinite(v)]
                if not math.isfinite(unit[i]):
                    continue
                best = min(known) if metric == "p2f_mean" else max(known)
                ratio = unit[i] / best if metric == "p2f_mean" else best / unit[i]
                within += ratio <= line["factor"] * (1 + 1e-9)
            assert line["share"] == pytest.approx(within / len(values), rel=1e-9)
    ends = table.groupby("method")["share"].max()
    assert ends["jet"] <= 10 / 12 and (table["factor"] >= 1).all()


def test_ratios_of_perfect_scores_and_of_failures():
    nan = np.nan
    values = np.array([[0.0, 0.0, 1.0], [2.0, 1.0, nan], [nan, nan, nan], [3.0, 6.0, 12.0]])
    expected = [[1, 1, np.inf], [2, 1, np.inf], [np.inf] * 3, [1, 2, 4]]
    assert np.array_equal(profile.ratios(values, "lower"), expected)
    assert np.array_equal(profile.ratios(np.array([[0.5, 1.0, nan, 0.0]]), "higher"), [[2, 1, np.inf, np.inf]])


def test_profiles_leave_out_what_not_all_ran_and_report_it():
    rows = made_rows()
    table = profile.table(scores(rows[~((rows["method"] == "jet") & (rows["case"] == "case-0"))]), Options())
    assert table.attrs["notes"][1].startswith("2 left out")
    with pytest.raises(UsageError, match="has no direction"):
        profile.table(scores(metric="genus"), Options())


# --- ranks and wins ---------------------------------------------------------------------------------------------------


def test_the_critical_difference_is_that_of_the_formula():
    """Demšar 2006, table 5: q of three methods at 0.05 is 2.343."""
    table = difference.table(scores(), Options())
    assert table["critical_difference"].iloc[0] == pytest.approx(2.343 * math.sqrt(3 * 4 / (6 * 6)), abs=1e-3)
    values = values_of(made_rows()).reshape(6, 2, 3)
    of_units = values.argsort(axis=2).argsort(axis=2) + 1.0
    mean = of_units.mean(axis=1)
    blocks = np.array([[1 + (m < v).sum() + ((m == v).sum() - 1) / 2 for v in m] for m in mean])
    expected = dict(zip(METHODS, blocks.mean(axis=0), strict=True))
    assert {r["method"]: r["average_rank"] for r in table.to_dict("records")} == pytest.approx(expected)
    assert table["average_rank"].is_monotonic_increasing
    with pytest.raises(UsageError, match="two shapes"):
        difference.table(scores(made_rows(cases=1, sensors=("clean",))), Options())


def test_groups_are_the_largest_that_cannot_be_distinguished():
    rng = np.random.default_rng(0)
    for _ in range(50):
        ranks, critical = np.sort(rng.uniform(1, 6, 6)), rng.uniform(0.2, 4)
        all_pairs = [(a, b) for a in range(6) for b in range(a + 1, 6) if ranks[b] - ranks[a] < critical]
        largest = [p for p in all_pairs if not any(q != p and q[0] <= p[0] and p[1] <= q[1] for q in all_pairs)]
        assert difference.cliques(ranks, critical) == largest


def test_wins_are_shares_of_the_units():
    table, values = wins.table(scores(), Options()), values_of(made_rows())
    for line in table.to_dict("records"):
        a, b = (METHODS.index(line[name]) for name in ("method", "other"))
        assert line["rate"] == pytest.approx((values[:, a] < values[:, b]).mean())
        assert line["low"] <= line["rate"] <= line["high"] and line["shapes"] == 6
    assert len(table) == 6
    assert (wins.shade(0.5) == 1).all() and wins.shade(1.0)[2] > wins.shade(1.0)[0] and wins.shade(0.0)[0] > 0.8


# --- means ------------------------------------------------------------------------------------------------------------


def test_bars_are_the_lines_of_the_leaderboard():
    rows = made_rows(failing=[("jet", 1)])
    for by in (None, "sensor", "dataset"):
        table = bars.table(scores(rows), Options(by=by))
        board = leaderboard(rows, by=by or "task", metric="p2f_mean")
        assert len(table) == len(board) == (6 if by == "sensor" else 3)
        key = ["method", "sensor"] if by == "sensor" else ["method"]
        expected = board.set_index(key).sort_index()
        found = table.rename(columns={"group": "sensor"}).set_index(key).sort_index()
        for name, other in (("mean", "mean"), ("low", "ci_low"), ("high", "ci_high"), ("solved", "solved")):
            assert found[name].to_numpy(dtype=float) == pytest.approx(expected[other].to_numpy(dtype=float))
    table = bars.table(scores(rows, method="rimls,apss"), Options())
    assert list(table["method"]) == ["rimls", "apss"]  # as asked
    assert list(bars.table(scores(), Options())["mean"]) == sorted(bars.table(scores(), Options())["mean"])


@pytest.mark.parametrize("cost", ["seconds", "peak_mb"])
@pytest.mark.parametrize("metric", ["p2f_mean", "fscore@0.01"])
def test_the_front_has_the_methods_that_none_beats_in_both(metric, cost):
    table = pareto.table(scores(metric=metric), Options(cost=cost))
    sign = -1 if metric.startswith("fscore") else 1
    for line in table.to_dict("records"):
        beaten = any(o[cost] < line[cost] and sign * o["mean"] < sign * line["mean"] for o in table.to_dict("records"))
        assert line["front"] == (not beaten)


# --- curves -----------------------------------------------------------------------------------------------------------


def stored_sweep(folder):
    """Two methods under three levels of noise, with traces."""
    results = Results(folder)
    for m, method in enumerate(("apss", "poisson")):
        for level in (0.0, 0.01, 0.02):
            cell = cell_of(method, cases=3)
            cell = replace(cell, sensor=Choice("sensor", "samples", {"count": 500, "noise": level}))
            rows = []
            for case in range(3):
                line = row(case, cell.id, "0" * 16, task="reconstruct", method=method, sensor=f"samples[noise={level}]")
                error = (1 + m) * (1 + case) * (level + 0.001)
                states = [{"seconds": s, "score.p2f_mean": error * 8 / s} for s in (1.0, 2.0, 4.0)]
                line |= {
                    "score.p2f_mean": error,
                    "seconds": 8.0 + m,
                    "directions": DIRECTIONS,
                    "input.rms": level * 1.001,
                }
                line |= {"trace": json.dumps(states) if method == "poisson" else None}
                rows.append(line)
            results.write(Record(cell.id, "0" * 16, meta_of(cell, "0" * 16), rows))
    return results


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    results = stored_sweep(tmp_path_factory.mktemp("sweep"))
    return scores_of(results.rows(), [results], metric="p2f_mean")


def test_a_noise_sweep_is_over_the_parameter_of_the_records(sweep):
    for x in (None, "sensor.noise", "input.rms"):
        table = noise.table(sweep, Options(x=x))
        name = table.columns[2]
        assert name == (x or "sensor.noise") and len(table) == 6
        for line in table.to_dict("records"):
            number = ("apss", "poisson").index(line["method"])
            level = line[name] / (1.001 if x == "input.rms" else 1)
            assert line["mean"] == pytest.approx((1 + number) * 2 * (level + 0.001), rel=1e-2)
            assert line["solved"] == 3
    with pytest.raises(UsageError, match=r"sensor\.noise"):
        noise.table(sweep, Options(x="sensor.nois"))
    with pytest.raises(UsageError, match="only one value"):
        noise.table(sweep, Options(x="sensor.count"))


def test_labels_lose_the_parameter_that_a_plot_is_over():
    found = noise._without(pd.Series(["a (depth=8, k=2)", "a (depth=9)", "b"]), "method.depth")
    assert found == ["a (k=2)", "a", "b"]


def test_curves_over_time_are_geometric_means(sweep):
    table = time.table(sweep, Options())
    mean = table[(table["method"] == "poisson") & (table["part"] == "mean")]
    assert mean["seconds"].min() == pytest.approx(1.0) and mean["seconds"].max() == pytest.approx(9.0)
    errors = np.array([2 * (1 + c) * (level + 0.001) for c in range(3) for level in (0.0, 0.01, 0.02)])
    assert mean["error"].iloc[0] == pytest.approx(8 * np.exp(np.log(errors).mean()), rel=1e-6)
    assert mean["error"].iloc[-1] == pytest.approx(np.exp(np.log(errors).mean()), rel=1e-6)
    assert table[table["part"] == "case"]["case"].nunique() == 9
    result = table[(table["method"] == "apss") & (table["part"] == "result")]
    assert result["seconds"].item() == 8.0
    assert result["error"].item() == pytest.approx(np.exp(np.log(errors / 2).mean()), rel=1e-6)
    assert "notes" not in table.attrs


def test_a_mean_curve_where_curves_share_no_time_is_empty():
    a, b = np.array([[1.0, 2.0], [2.0, 1.0]]), np.array([[3.0, 2.0], [4.0, 1.0]])
    assert len(time.mean_curve([a, b])) == 0
    both = time.mean_curve([a, a])
    assert np.interp(1.5, both[:, 0], both[:, 1]) == pytest.approx(math.sqrt(2), rel=1e-2)


# --- what is asked for ------------------------------------------------------------------------------------------------


def test_a_plot_is_of_one_task_one_metric_and_known_methods():
    rows = made_rows()
    with pytest.raises(UsageError, match="choose one with --task"):
        scores(pd.concat([rows, rows.assign(task="upsample")]))
    with pytest.raises(UsageError, match="choose one with --split"):
        scores(pd.concat([rows, rows.assign(split="train")]))
    with pytest.raises(UsageError, match="a plot shows one"):
        scores(metric="p2f_mean,genus")
    with pytest.raises(UsageError, match="choose one"):
        scores(rows.assign(task="strange"), metric=None)
    with pytest.raises(UsageError, match="--level"):
        scores(level=1.5)
    with pytest.raises(UsageError, match="jet"):
        scores(method="jett")
    assert scores(names="jet=Jets").titles == {"apss": "apss", "jet": "Jets", "rimls": "rimls"}


def test_the_plotted_numbers_are_those_of_the_table(sweep):
    """Every number of the drawing is one of the data file."""
    made = plot("noise", sweep, Options())
    drawn = [line for line in made.figure.axes[0].lines if line.get_marker() not in ("None", None, "")]
    for line, (method, part) in zip(drawn, made.table.groupby("method", sort=False), strict=True):
        assert list(line.get_xdata()) == list(part["sensor.noise"]) and list(line.get_ydata()) == list(part["mean"]), (
            method
        )
    made = plot("bars", scores(), Options())
    assert [bar.get_width() for bar in made.figure.axes[0].patches] == list(made.table["mean"])
    made = plot("profile", scores(), Options())
    for line, (_, part) in zip(made.figure.axes[0].lines, made.table.groupby("method", sort=False), strict=False):
        assert line.get_ydata() == pytest.approx(100 * part["share"].to_numpy())
    made = plot("pareto", scores(), Options())
    drawn = {
        (line.get_xdata()[0], line.get_ydata()[0]) for line in made.figure.axes[0].lines if line.get_marker() != "None"
    }
    assert drawn == set(zip(made.table["seconds"], made.table["mean"], strict=True))
    made = plot("wins", scores(), Options())
    assert [t.get_text() for t in made.figure.axes[0].texts] == [f"{100 * rate:.0f}" for rate in made.table["rate"]]
    assert set(KINDS) == {"bars", "difference", "noise", "pareto", "profile", "time", "wins"}
