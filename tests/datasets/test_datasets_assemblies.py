"""Assemblies: closed bodies separated by the stated clearance, and metric threads."""

from __future__ import annotations

from itertools import islice
from math import pi, sqrt

import numpy as np
import pytest
import trimesh

from bench.datasets.assemblies import Assemblies
from bench.datasets.solids import assembled, threads
from bench.geometry.closest import TriangleTree
from bench.geometry.topology import count_topology

SHAPES = list(islice(Assemblies().shapes("test"), len(assembled.KINDS)))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_bodies_are_closed_and_as_far_apart_as_stated(shape):
    mesh, info = shape.mesh, shape.info
    counts = count_topology(mesh.vertices, mesh.faces)
    assert (counts.watertight, counts.components, counts.genus) == (True, info["components"], info["genus"])
    assert mesh.volume > 0 and mesh.area_faces.min() > 1e-12
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    gap, nearest = info["gap"] * info["size"], []
    pieces = mesh.split(only_watertight=False)
    for one in pieces:  # the nearest point of a body is a vertex or lies inside a flat face
        others = trimesh.util.concatenate([piece for piece in pieces if piece is not one])
        samples = np.concatenate([one.vertices, one.triangles_center])
        nearest.append(TriangleTree(others.vertices, others.faces).closest(samples).distance.min())
    assert max(nearest) < 1.1 * gap, "a body that touches nothing"
    assert min(nearest) == pytest.approx(gap, rel=0.1)


def test_kinds_alternate_and_shapes_are_repeatable():
    assert [shape.info["kind"] for shape in SHAPES] == list(assembled.KINDS)
    again, train = (next(Assemblies(kind="hinge").shapes(split)).mesh for split in ("test", "train"))
    same = next(Assemblies(kind="hinge").shapes("test")).mesh
    assert again.vertices.tobytes() == same.vertices.tobytes() != train.vertices.tobytes()


@pytest.mark.parametrize("values", [{"kind": "spoon"}, {"gap_low": 0.1}, {"gap_low": 1e-5}, {"gap_high": 0.1}])
def test_wrong_parameters_are_named(values):
    with pytest.raises(ValueError, match=rf"^{next(iter(values))}: expected"):
        Assemblies(**values)


def test_near_contacts_are_tagged():
    assert "near_contact" in SHAPES[2].traits.tags


def test_a_thread_is_a_closed_rod_with_the_metric_profile():
    """The profile through the axis is that of ISO 68: crest P/8, root P/4, flanks of 60 degrees."""
    radius, pitch, length = 0.5, 0.1, 0.6
    rod = threads.thread(radius, pitch, length, 256)
    assert rod.genus() == 0 and rod.bounding_box()[5] == pytest.approx(length)
    # Every cross section has the mean over a pitch of pi r^2 as its area, by the trapezoidal rule.
    profile = np.interp(np.linspace(0, 1, 4001), [0, 1 / 8, 7 / 16, 11 / 16, 1], [0, 0, 1, 1, 0])
    root = 5 / 8 * sqrt(3) / 2 * pitch
    area = pi * ((radius - root * profile) ** 2).mean()
    assert rod.slice(0.33).area() == pytest.approx(area, rel=2e-3)
    assert rod.volume() == pytest.approx(area * length, rel=2e-3)


def test_a_thread_is_right_handed_and_rises_by_its_pitch():
    """The crest at height z is at the angle 2 pi z / pitch."""
    solid = threads.thread(0.5, 0.1, 0.6, 360)
    angles = []
    for z in (0.20, 0.21, 0.22):
        points = np.concatenate(solid.slice(z).to_polygons())
        crest = points[np.hypot(*points.T) > 0.4999]
        angles.append(np.angle((crest[:, 0] + 1j * crest[:, 1]).mean()))
    assert np.diff(np.unwrap(angles)) == pytest.approx([2 * pi / 10] * 2, abs=0.05)
