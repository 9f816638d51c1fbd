"""Wires: round, with the stated thickness, connected or separate as stated."""

from __future__ import annotations

from itertools import islice
from math import pi

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bench import Frame
from bench.datasets.solids import wirework
from bench.datasets.wires import Wires
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology

SHAPES = list(islice(Wires().shapes("test"), len(wirework.KINDS)))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_wires_are_closed_and_thinner_than_half_a_per_cent_of_the_radius(shape):
    mesh, info = shape.mesh, shape.info
    counts = count_topology(mesh.vertices, mesh.faces)
    assert (counts.watertight, counts.components, counts.genus) == (True, info["components"], info["genus"])
    assert mesh.volume > 0 and mesh.area_faces.min() > 1e-13
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    # For a long prism, volume over area is a quarter of the diameter of the inscribed circle of its section.
    inner = 4 * mesh.volume / mesh.area
    assert inner == pytest.approx(info["thickness"] * np.cos(pi / wirework.SIDES), rel=0.05)
    assert info["thickness"] / Frame.of(mesh.vertices).radius < 0.005


def test_kinds_alternate_and_shapes_are_repeatable():
    assert [shape.info["kind"] for shape in SHAPES] == list(wirework.KINDS)
    first, again, train = (next(Wires(kind="spring").shapes(split)).mesh for split in ("test", "test", "train"))
    assert first.vertices.tobytes() == again.vertices.tobytes() != train.vertices.tobytes()
    with pytest.raises(ValueError, match="^thickness_low: expected"):
        Wires(thickness_low=0.01)
    with pytest.raises(ValueError, match="^kind: expected"):
        Wires(kind="rope")


def test_a_ring_of_wire_is_a_torus():
    """Pappus: the area of the octagon times the path of its centre, which is a polygon here."""
    n, thickness = 200, 0.02
    a = 2 * pi * np.arange(n) / n
    ring = np.column_stack([np.cos(a), np.sin(a), 0 * a])
    work = wirework.Wirework([], [ring], np.empty((0, 3)), False, 1, 1)
    mesh = wirework.solid(work, thickness)
    octagon = wirework.SIDES / 2 * np.sin(2 * pi / wirework.SIDES) * (thickness / 2) ** 2
    assert mesh.genus() == 1
    assert mesh.volume() == pytest.approx(octagon * 2 * n * np.sin(pi / n), rel=1e-3)


@pytest.mark.parametrize("number", [1, 2])  # a cloth, and a spring with another inside
def test_no_wires_of_a_cloth_or_a_spring_touch(number):
    mesh = SHAPES[number].mesh
    assert SHAPES[number].info["components"] > 1
    assert not self_intersecting_faces(mesh.vertices, mesh.faces).any()


def test_lattices_are_connected_and_have_the_struts_of_their_kind():
    found = [wirework.lattice(np.random.default_rng(seed), 0.01) for seed in range(12)]
    degrees = set()
    for work in found:
        ends, number = np.unique(np.round(np.array(work.lines), 9).reshape(-1, 3), axis=0, return_inverse=True)
        pairs = number.reshape(-1, 2)
        assert len(np.unique(np.sort(pairs, axis=1), axis=0)) == len(pairs)
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(ends),) * 2)
        assert connected_components(graph, directed=False)[0] == 1
        assert work.genus == len(pairs) - len(ends) + 1
        degrees.add(np.bincount(number.ravel()).max())
    assert degrees == {6, 14, 12}  # cubic; body-centred with the edges of the cells; octet
