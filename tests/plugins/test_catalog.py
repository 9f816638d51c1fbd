"""The catalogue of datasets: what `detailbench list datasets` shows is true, and no generator drifts."""

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench.commands.list import dataset_table
from bench.plugins import catalog
from bench.plugins.listing import listing
from bench.plugins.registry import registry

OURS = Path(__file__).parents[2] / "datasets"
FAMILIES = [p for p in registry().all("dataset") if p.file.parent == OURS and not hasattr(p.cls, "state")]
EXPECTED = """bumps cad superquadrics supershapes fbm blobs tpms knots smooth_csg vases plates reliefs branches fractals
furniture humanoids scenes statues"""


def test_every_family_is_there_and_in_the_catalogue():
    assert {p.name for p in FAMILIES} >= set(EXPECTED.split())
    assert {p.name for p in FAMILIES} == set(json.loads((OURS / catalog.FILE).read_text()))


@pytest.mark.parametrize("plugin", FAMILIES, ids=lambda p: p.name)
def test_the_first_shapes_are_those_that_were_frozen(plugin):
    """A hash that differs means that the benchmark is another: see scripts/freeze.py.

    Or that this processor's mathematics rounds otherwise (numpy has other sines with AVX-512 than without): then the
    mesh must be the same but for that. Of the frozen shapes the smallest is built, in half the time of the first.
    """
    facts = catalog.known(plugin)
    shapes = list(islice(plugin.cls().shapes("test"), catalog.LOOKED_AT))
    assert sorted({tag for shape in shapes for tag in shape.tags}) == facts["kinds"]
    assert sorted({shape.exactness for shape in shapes}) == facts["exactness"]
    for shape, frozen in zip(shapes, facts["shapes"], strict=False):
        assert shape.id == frozen["id"] and set(frozen["tags"]) <= set(facts["tags"])
    built, frozen = min(zip(shapes, facts["shapes"], strict=False), key=lambda pair: pair[1]["vertices"])
    mesh = built.mesh
    if catalog.mesh_hash(mesh) != frozen["hash"]:
        assert len(mesh.vertices) == pytest.approx(frozen["vertices"], rel=1e-3)
        assert len(mesh.faces) == pytest.approx(frozen["faces"], rel=1e-3)
        assert catalog.mesh_measures(mesh) == pytest.approx(frozen["measures"], rel=1e-5, abs=1e-6)


def test_the_hash_sees_what_moves_and_not_the_last_digits():
    mesh = icosphere(subdivisions=2)
    noise = np.random.default_rng(0).normal(size=mesh.vertices.shape)
    same = catalog.mesh_hash(Trimesh(mesh.vertices + 1e-14 * noise, mesh.faces, process=False))
    assert same == catalog.mesh_hash(mesh)
    moved = mesh.vertices.copy()
    moved[5, 1] += 1e-5
    assert catalog.mesh_hash(Trimesh(moved, mesh.faces, process=False)) != same
    assert catalog.mesh_hash(Trimesh(mesh.vertices, mesh.faces[::-1], process=False)) != same


def test_measures_tell_another_shape_and_no_other_rounding():
    mesh = icosphere(subdivisions=3)
    noise = np.random.default_rng(0).normal(size=mesh.vertices.shape)
    measures = catalog.mesh_measures(mesh)
    same = catalog.mesh_measures(Trimesh(mesh.vertices + 1e-9 * noise, mesh.faces, process=False))
    assert same == pytest.approx(measures, rel=1e-5, abs=1e-6)
    bumpy = mesh.vertices * (1 + 1e-3 * np.sin(9 * mesh.vertices[:, :1]))
    for other in (mesh.vertices * 1.0001, mesh.vertices + [1e-4, 0, 0], bumpy, mesh.vertices * [1.0002, 0.9998, 1]):
        assert catalog.mesh_measures(Trimesh(other, mesh.faces, process=False)) != pytest.approx(
            measures, rel=1e-5, abs=1e-6
        )


def test_the_listing_shows_family_exactness_vertices_time_and_tags():
    table = dataset_table(listing())
    (line,) = [line for line in table.splitlines() if line.startswith("bumps ")]
    assert "parametric" in line and "40,962" in line and " s " in line and "smooth" in line
    (line,) = [line for line in table.splitlines() if line.startswith("files ")]
    assert line.split()[1:5] == ["-"] * 4
