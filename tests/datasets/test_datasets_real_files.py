"""The fetched meshes match the table; collected only where they have been fetched (see tests/conftest.py)."""

from __future__ import annotations

import numpy as np
import pytest

from bench.contract.task import Task
from bench.datasets import real
from bench.datasets.real import Real
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology
from bench.plugins.registry import registry
from bench.tasks.detail_transfer import DetailTransfer

MESHES = {mesh.name: mesh for mesh in real._table()[0]}
LIGHT = [name for name, mesh in MESHES.items() if mesh.faces < 6000]


@pytest.mark.parametrize("name", LIGHT)
def test_a_mesh_matches_the_table(name):
    (shape,) = Real(which=[name]).shapes("test")
    line, mesh = MESHES[name], shape.mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (line.vertices, line.faces)
    topology = count_topology(mesh.vertices, mesh.faces)
    crossing = int(self_intersecting_faces(mesh.vertices, mesh.faces).sum())
    assert (topology.boundary_edges == 0) == (line.group != "open")
    if line.group == "closed":
        assert topology.watertight and topology.genus == line.genus and crossing == 0 and mesh.volume > 0
    if line.group == "crossing":
        assert crossing > 0


def test_no_two_meshes_are_the_same():
    spectra = []
    for shape in Real(which=LIGHT).shapes("test"):
        moved = shape.mesh.vertices - shape.mesh.centroid
        size = np.sort(np.linalg.norm(moved, axis=1))
        spectra.append(np.quantile(size / size[-1], np.linspace(0, 1, 50)))
    apart = np.abs(np.array(spectra)[:, None] - np.array(spectra)[None]).max(axis=2) + np.eye(len(spectra))
    assert apart.min() > 0.01


def test_the_halves_of_the_brain_make_cases_of_detail_transfer():
    (recipe, *_) = DetailTransfer().recipes(Real(), None, split="test", count=1, seed=0)
    case = recipe.build()
    source, base = case.input["source"], case.input["target_base"]
    assert source.is_watertight and base.is_watertight and base.volume > 0
    # The halves of a brain are similar: mirrored, rotated and moved, the source is near the reference, not equal to it.
    far = np.linalg.norm(source.vertices - case.reference.mesh.vertices, axis=1)
    assert 0.01 < np.median(far) < 0.3


def test_a_case_of_reconstruction():
    plugin = registry().find("sensor", "poisson_disk")
    (recipe, *_) = Task().recipes(Real(which=["joint"]), plugin.cls(count=500), split="test", count=1, seed=0)
    assert len(recipe.build().input["cloud"]) == 500
