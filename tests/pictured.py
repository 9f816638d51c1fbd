"""Results with kept outputs for the tests of pictures, written as a run does, without running anything."""

from __future__ import annotations

import numpy as np
import trimesh
from records import row

from bench.geometry.io.files import save
from bench.plan.cell import Cell, Choice
from bench.results.kept_outputs import FOLDER, file_name, reference_file
from bench.results.store import Record, Results

COARSE = {"bumps": {"subdivisions": 4}}  # 5,120 faces; most of the time would go into drawing 81,920
PUSHED = {"poisson": 0.01, "apss": 0.02, "rimls": 0.005}  # how far each method's output is outside, in radii


def cell_of(method="poisson", dataset="bumps", cases=2, parameters=None):
    return Cell(
        task=Choice("task", "reconstruct", {}),
        dataset=Choice("dataset", dataset, COARSE.get(dataset, {})),
        sensor=Choice("sensor", "samples", {"count": 500, "noise": 0.02}),
        method=Choice("method", method, parameters or {}),
        metrics=(Choice("metric", "p2f_mean", {}),),
        cases=cases,
    )


def meta_of(cell, mark, references=None):
    return {
        "cell_id": cell.id, "fingerprint": mark, "planned": cell.cases, "finished": "2026-01-01T00:00:00+00:00",
        "cell": cell.to_json(), "ingredients": {}, "provenance": {}, "settings": {"limit": {}},
        "references": references or {},
    }  # fmt: skip


def pushed(mesh, distance):
    """The mesh with its vertices moved along their normals."""
    return trimesh.Trimesh(mesh.vertices + distance * mesh.vertex_normals, mesh.faces, process=False)


def stored(folder, methods=tuple(PUSHED), cases=2, dataset="bumps", keeps=True, failing=()):
    """A results folder: for each method a record of all cases, with its outputs and their references.

    ``failing`` are pairs of (method, index of the case) that raised.
    """
    results = Results(folder)
    first = cell_of(methods[0], dataset, cases)
    recipes = list(
        first.task.build().recipes(
            first.dataset.build(), first.sensor.build(), split="test", count=cases, seed=first.seed
        )
    )
    made = [recipe.build() for recipe in recipes]
    for number, method in enumerate(methods):
        cell, mark = cell_of(method, dataset, cases), f"{number:016x}"
        rows, references = [], {}
        for index, case in enumerate(made):
            push = PUSHED.get(method, 0.03)
            line = row(
                index, cell.id, mark, task="reconstruct", dataset=dataset, sensor="samples[count=500,noise=0.02]",
                method=method, case=case.id, output="", seconds=1.0 + number, peak_rss_mb=100.0 * (number + 1),
            )  # fmt: skip
            line |= {"score.p2f_mean": push * (1 + index), "input.points": 500.0, "input.rms": 0.02}
            if (method, index) in failing:
                line |= {"status": "error", "message": "ValueError: a wall of bricks", "score.p2f_mean": None}
            elif keeps:
                output = f"{FOLDER}/{cell.id}-{mark}/{file_name(case.id)}"
                reference = reference_file(dataset, case.id, case.reference)
                save(pushed(case.reference.mesh, push), results.folder / output)
                save(case.reference.mesh, results.folder / reference)
                references[case.id] = reference
                line |= {"output": output, "output_faces": len(case.reference.mesh.faces)}
            rows.append(line)
        meta = meta_of(cell, mark, references)
        results.write(Record(cell.id, mark, meta, rows))
    return results, made


def is_close(a, b):
    return np.allclose(a, b, atol=1e-6)  # coordinates of PLY files
