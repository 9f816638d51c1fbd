"""Rows and boards for the tests of the leaderboard."""

import json

import pandas as pd

DOCUMENTED = (
    "task,dataset,sensor,split,method,variant,threads,device,host,metric,better,mean,ci_low,ci_high,floor,rank_low,"
    "rank_high,solved,planned,imputed,seconds_median,peak_rss_mb,train_seconds,true_distances,front,shapes,not_run,undefined,"
    "score_mean,versus_next,detectable,more_shapes,versus_first,place"
)


def row(method="poisson", case="a", seed=0, scores=None, floors=None, better="lower", worst=None, **changes):
    """One row as the store gives it; ``scores=None`` is a failure that says nothing of metrics."""
    base = {
        "schema_version": 1,
        "cell": "c",
        "fingerprint": "f",
        "task": "reconstruct",
        "dataset": "bumps",
        "sensor": "samples",
        "split": "test",
        "method": method,
        "variant": "",
        "seed": seed,
        "threads": 1,
        "device": "cpu",
        "host": "h",
        "case": case,
        "case_index": 0,
        "tags": "",
        "status": "ok" if scores is not None else "error",
        "stage": "",
        "message": "" if scores is not None else "boom",
        "seconds": 1.0,
        "cpu_seconds": 1.0,
        "peak_rss_mb": 100.0,
        "peak_device_mb": 0.0,
        "parameters": None,
        "directions": "" if scores is None else json.dumps(dict.fromkeys(scores, better)),
        "finished": "2024-01-01T00:00:00",
    }
    base |= {f"score.{key}": value for key, value in (scores or {}).items()}
    base |= {f"floor.{key}": value for key, value in (floors or {}).items()}
    base |= {f"worst.{key}": value for key, value in (worst or {}).items()}
    return base | changes


def rows(*records):
    frame = pd.DataFrame(records)
    frame["parameters"] = frame["parameters"].astype("Int64")
    return frame


def table(scores, **options):
    """Rows from {method: {(case, seed): score, None for a failure}} for one metric ``d``."""
    return rows(
        *(
            row(method, case, seed, None if value is None else {"d": value}, **options)
            for method, results in scores.items()
            for (case, seed), value in results.items()
        )
    )


def units(*values, cases="abcdefgh", seeds=1):
    keys = [(c, s) for c in cases for s in range(seeds)]
    return dict(zip(keys, values, strict=False))


def ranks(board):
    """The rank interval of each method; None for one that solved nothing."""
    lines = zip(board["method"], board["rank_low"], board["rank_high"], strict=True)
    return {m: None if pd.isna(low) else (int(low), int(high)) for m, low, high in lines}


def line(board, method, metric="d"):
    return board[(board["method"] == method) & (board["metric"] == metric)].iloc[0]
