"""Which metric ranks a table: the user's, else the task's primary ones, else the usual order."""

import pandas as pd
import pytest
from boards import row, rows

from bench.contract.task import Task
from bench.plugins.registry import registry
from bench.ranking.headline import primary_metrics
from bench.ranking.leaderboard import leaderboard
from bench.ranking.overview import overview
from bench.ranking.report.tables import tables

SCORES = {"surface_distance_mean": 2.0, "chamfer_l1_mean": 1.0, "hausdorff": 3.0}


def frame_of(scores=SCORES, task="reconstruct"):
    return rows(
        *(
            row(method, case, 0, {k: v * factor for k, v in scores.items()}, dict.fromkeys(scores, 0.1), task=task)
            for method, factor in (("a", 1.0), ("b", 1.5))
            for case in "abcdef"
        )
    )


def heads(frame, **options):
    return {table.task: table.metrics[0].name for table in tables(leaderboard(frame), frame, **options)}


def test_every_task_that_is_shipped_names_scores_that_exist():
    for plugin in registry().all("task"):
        for name in plugin.cls.primary:
            # The metric has the name of the score, or begins it: then a toy case tells that it gives the score.
            owners = [m for m in registry().all("metric") if f"{name}_".startswith(f"{m.name}_")]
            metric = max(owners, key=lambda m: len(m.name))
            assert plugin.cls.output in metric.options["outputs"]
            if metric.name != name:
                case = plugin.cls().toy()
                assert name in metric.cls().score(case.input["source"], case)


def test_reconstruct_is_ranked_by_the_exact_distance_and_denoise_by_chamfer():
    frame = pd.concat([frame_of(), frame_of(task="denoise"), frame_of(task="upsample[ratio=8]")])
    assert heads(frame) == {
        "reconstruct": "surface_distance_mean",
        "denoise": "chamfer_l1_mean",
        "upsample[ratio=8]": "chamfer_l1_mean",
    }
    names = [m.name for m in tables(leaderboard(frame_of()))[0].metrics]
    assert names == ["surface_distance_mean", "chamfer_l1_mean", "hausdorff"]  # Chamfer stays beside it


def test_the_two_parts_of_an_f_score_are_for_those_who_ask():
    frame = frame_of(SCORES | dict.fromkeys(("fscore@0.01", "precision@0.01", "recall@0.01"), 0.5))
    board = leaderboard(frame)
    shown = [m.name for m in tables(board)[0].metrics]
    assert "fscore@0.01" in shown and not {"precision@0.01", "recall@0.01"}.intersection(shown)
    asked = [m.name for m in tables(board, metrics=["recall@0.01"])[0].metrics]
    assert asked[0] == "recall@0.01" and set(asked) == set(board["metric"])


def test_the_users_metric_comes_first():
    assert heads(frame_of(), metrics=["hausdorff"]) == {"reconstruct": "hausdorff"}


def test_old_results_without_it_are_ranked_as_before():
    old = {k: v for k, v in SCORES.items() if k != "surface_distance_mean"}
    assert heads(frame_of(old)) == {"reconstruct": "chamfer_l1_mean"}


def test_a_task_that_is_not_installed_breaks_nothing():
    assert primary_metrics("of_somebody_else") == primary_metrics("") == ()
    assert heads(frame_of(task="of_somebody_else")) == {"of_somebody_else": "chamfer_l1_mean"}


@pytest.mark.parametrize(("named", "found"), [((), ()), ("p2f_mean", ("p2f_mean",)), (["x", "y"], ("x", "y"))])
def test_what_a_task_may_say(monkeypatch, named, found):
    assert Task.primary == ()
    monkeypatch.setattr(registry().find("task", "denoise").cls, "primary", named)
    assert primary_metrics("denoise") == found


def test_across_each_task_keeps_its_own_metric():
    board = overview(pd.concat([frame_of(), frame_of(task="denoise")]), "dataset")
    assert board.groupby("task")["metric"].unique().map(list).to_dict() == {
        "denoise": ["chamfer_l1_mean", "bumps"],
        "reconstruct": ["surface_distance_mean", "bumps"],
    }
    assert board.groupby(["task", "metric"])["mean"].min().loc[
        [("denoise", "bumps"), ("reconstruct", "bumps")]
    ].tolist() == [1, 2]
