"""Results that no method has made: several datasets and sensors, failures, traces, and texts that are markup."""

from __future__ import annotations

import json

import numpy as np

from bench.plan.cell import id_of
from bench.results.files import COLUMNS
from bench.results.store import Record, Results

HOSTILE = "</script><img src=x onerror=\"window.hacked = 1\"> <!-- & 'quoted' \u2028"
METHODS = ("poisson", "rimls", "apss", "ball_pivoting", "alpha_wrap")
TRAITS = ("smooth", "sharp", "thin")
DIRECTIONS = {
    "surface_distance_mean": "lower",
    "chamfer_l1_mean": "lower",
    "fscore@0.01": "higher",
    "genus": "reference",
}
WORST = {"surface_distance_mean": 0.1, "chamfer_l1_mean": 0.2, "fscore@0.01": 0.0, "genus": 9.0}


def make(
    folder, *, datasets=("bumps", "cad"), sensors=("noisy", "scanned"), shapes=4, methods=METHODS, hostile=True, seed=0
):
    """Write one record for each dataset, sensor and method; the last method fails on one shape of each dataset."""
    generator = np.random.default_rng(seed)
    results = Results(folder)
    results.prepare()
    for dataset in datasets:
        hard = generator.lognormal(-5, 0.6, shapes)
        for sensor in sensors:
            for m, method in enumerate(methods):
                _write(
                    results, dataset, sensor, method, m, hard, generator, fails=m == len(methods) - 1, hostile=hostile
                )
    return results


def _write(results, dataset, sensor, method, m, hard, generator, fails, hostile):
    described = cell_of(dataset, sensor, method)
    cell = id_of(described)
    rows = []
    for i, difficulty in enumerate(hard):
        error = difficulty * (1 + 0.4 * m) * generator.lognormal(0, 0.1) * (1.5 if sensor == "scanned" else 1)
        rows.append(_row(cell, dataset, sensor, method, i, error, generator, m))
        if fails and i == 1:
            message = HOSTILE if hostile else "no surface was found"
            rows[-1] |= {
                "status": "error",
                "message": message,
                "traceback": f"Traceback\n  {message}",
                "directions": "",
            }
            rows[-1] |= {key: None for key in rows[-1] if key.startswith("score.")} | {"trace": None}
    made = {"host": "node1", "processor": "a processor", "python": "3.12.1", "detailbench": "0.1.0", "memory_gb": 16.0}
    meta = {
        "cell_id": cell, "fingerprint": "f" * 16, "planned": len(hard), "finished": rows[-1]["finished"],
        "cell": described,
        "settings": {"limit": {"seconds": 60.0, "memory_gb": 4.0}, "plugins": ["my plugin.py"] if fails else []},
        "ingredients": {"package numpy": "2.4.6"}, "provenance": made,
    }  # fmt: skip
    results.write(Record(cell, "f" * 16, meta, rows))


def cell_of(dataset, sensor, method):
    """What a record says of its cell; no plugin needs to be there."""
    parts = {"task": "reconstruct", "dataset": dataset, "sensor": sensor}
    chosen = {kind: {"kind": kind, "name": name, "parameters": {}} for kind, name in parts.items()}
    chosen["method"] = {"kind": "method", "name": method, "parameters": {"depth": 9 if method == "apss" else 8}}
    return chosen | {"metrics": [], "seed": 0, "split": "test", "cases": 4, "threads": 1, "device": "cpu"}


def _row(cell, dataset, sensor, method, i, error, generator, m):
    scores = {
        "surface_distance_mean": error,
        "chamfer_l1_mean": 2 * error,
        "fscore@0.01": 1 / (1 + 100 * error),
        "genus": i % 2,
    }
    seconds = float(0.2 * 2**m * generator.lognormal(0, 0.1))
    states = [{"seconds": seconds * k / 4, "score.chamfer_l1_mean": 2 * error * 4 / k} for k in (1, 2, 3, 4)]
    row = dict.fromkeys(COLUMNS) | {
        "schema_version": 5, "cell": cell, "fingerprint": "f" * 16, "task": "reconstruct", "dataset": dataset,
        "sensor": sensor, "split": "test", "method": method, "variant": "depth=9" if method == "apss" else "",
        "seed": 0, "threads": 1, "device": "cpu", "host": "node1", "case": f"{dataset}-{i:03d}", "case_index": i,
        "tags": TRAITS[i % len(TRAITS)], "status": "ok", "seconds": seconds, "cpu_seconds": seconds,
        "peak_rss_mb": 100.0 + 50 * m, "output_points": 5000, "output_faces": 9998,
        "directions": json.dumps(DIRECTIONS), "finished": f"2026-01-0{1 + i % 3}T00:00:00+00:00",
        "trace": json.dumps(states) if method == "rimls" else None,
    }  # fmt: skip
    row |= {f"score.{name}": float(value) for name, value in scores.items()}
    row |= {f"floor.{name}": 1e-4 if name.endswith("mean") else 1.0 for name in DIRECTIONS}
    return row | {f"worst.{name}": value for name, value in WORST.items()}
