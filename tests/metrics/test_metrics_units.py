"""The unit of each score, a power of length, found by scaling everything by two."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import set_samples
from bench.plugins.origins import installed
from bench.plugins.registry import registry

# Their thresholds are in units of the frame (in file units: DTU).
FIXED = ("fscore", "inner_surface", "dtu_distances")


def scored(scale, kind):
    ball = trimesh.creation.icosphere(2, radius=scale)
    source = trimesh.creation.box((scale, scale, 2 * scale))
    case = Case("case", {"source": source}, Shape("case", ball, info={"symmetry": "mirror x"}))
    set_samples(case, 1000)
    rng = generator("units")
    outputs = {"cloud": [PointCloud(scale * (trimesh.creation.icosphere(2).vertices + 0.05 * rng.normal(size=(162, 3))),
                                    trimesh.creation.icosphere(2).vertices)]}  # fmt: skip
    moved = trimesh.Trimesh(ball.vertices * (1.1, 1, 1), ball.faces, process=False)
    box = trimesh.Trimesh(source.vertices * (1.2, 1, 1), source.faces, process=False)
    outputs["mesh"] = [moved, box]
    found = {}
    for name in installed("metric"):
        plugin = registry().find("metric", name)
        if name in FIXED or kind not in plugin.options.get("outputs", ("mesh", "cloud")):
            continue
        metric = plugin.cls(**{f.name: 500 for f in plugin.fields if f.name in ("samples", "disks")})
        for number, output in enumerate(outputs[kind]):
            values = metric.score(output, case)
            found |= {(name, key, number): (value, plugin.length(key)) for key, value in values.items()}
    return found


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_every_score_grows_with_its_declared_power(kind):
    once, twice = scored(1.0, kind), scored(2.0, kind)
    assert len(once) > 30 and any(value > 0 for value, _ in once.values())
    assert once.keys() == twice.keys()
    for name, (value, length) in once.items():
        assert twice[name] == (pytest.approx(value * 2.0**length, rel=2e-3, abs=1e-9), length), name
        assert np.isfinite(value)
