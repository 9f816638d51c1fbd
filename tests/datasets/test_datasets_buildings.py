"""Buildings: one closed body each, with the stated openings and genus."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from bench import generator
from bench.datasets.buildings import Buildings
from bench.datasets.solids import architecture
from bench.geometry.topology import count_topology

SHAPES = list(islice(Buildings().shapes("test"), len(architecture.KINDS)))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_a_building_has_the_stated_properties(shape):
    mesh, info = shape.mesh, shape.info
    counts = count_topology(mesh.vertices, mesh.faces)
    assert (counts.watertight, counts.components, counts.genus) == (True, 1, info["genus"])
    assert mesh.volume > 0 and mesh.area_faces.min() > 1e-12
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert info["openings"] >= 8 and info["thinnest"] < 0.1


@pytest.mark.parametrize("kind", architecture.KINDS)
def test_a_building_is_about_two_in_size_and_of_the_stated_genus(kind):
    for seed in range(2):
        building = architecture.KINDS[kind](generator("architecture", seed))
        solid = building.build()
        assert solid.genus() == building.genus
        low, high = np.array(solid.bounding_box()).reshape(2, 3)
        assert 1.3 < (high - low).max() < 2.6


def test_columns_stand_all_around():
    """A horizontal section through the columns of a temple has an outline per column, and one more."""
    temple = architecture.temple(generator("architecture", 0))
    assert temple.build().slice(0.2).num_contour() == temple.openings + 1  # plus the inner walls


def test_a_church_has_buttresses_on_both_sides():
    left, right = architecture.church(generator("architecture", 0)).build().split_by_plane((1, 0, 0), 0)
    assert left.volume() == pytest.approx(right.volume(), rel=5e-3)  # the spokes of the rose window are rotated


def test_kinds_alternate_and_shapes_are_repeatable():
    assert [shape.info["kind"] for shape in SHAPES] == list(architecture.KINDS)
    first, again, train = (next(Buildings(kind="church").shapes(split)).mesh for split in ("test", "test", "train"))
    assert first.vertices.tobytes() == again.vertices.tobytes() != train.vertices.tobytes()
    with pytest.raises(ValueError, match="^kind: expected"):
        Buildings(kind="igloo")
