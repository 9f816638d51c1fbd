"""Cloth: open, exact sheets that do not cross themselves, with the stated gaps."""

from __future__ import annotations

from itertools import islice
from math import pi

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from bench.datasets.cloth import Cloth
from bench.datasets.details import drapery
from bench.datasets.surfaces.jets import Jet
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology

SHAPES = list(islice(Cloth().shapes("test"), len(drapery.KINDS)))
BORDERS = {"skirt": 2}  # number of boundary loops of a sheet; usually one
APART = {"curtain": 2.5, "skirt": 2.5, "napkin": 2.5, "scroll": 5.0}  # of the parameter, between facing parts


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_a_sheet_is_open_connected_and_does_not_cross_itself(shape):
    mesh = shape.mesh
    counts = count_topology(mesh.vertices, mesh.faces)
    assert (counts.components, counts.genus, counts.flipped_faces, counts.watertight) == (1, 0, 0, False)
    borders = BORDERS.get(shape.info["kind"], 1)
    assert mesh.euler_number == 2 - borders
    assert not self_intersecting_faces(mesh.vertices, mesh.faces).any()
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices) and mesh.area_faces.min() > 1e-9


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_the_vertices_are_on_the_exact_surface(shape):
    some = shape.mesh.vertices[:: len(shape.mesh.vertices) // 50]
    assert np.abs(shape.surface.closest(some)[0] - some).max() < 1e-7


@pytest.mark.parametrize("kind", APART)
@pytest.mark.parametrize("gap", [0.01, 0.04])
def test_the_stated_gap_is_the_nearest_distance_of_facing_parts(kind, gap):
    """The distance of points of a section that are far apart along the sheet."""
    sheet = drapery.KINDS[kind](np.random.default_rng(3), gap)
    u = np.linspace(sheet.u[0], sheet.u[-1], 1500)
    apart = np.abs(u[:, None] - u)
    if kind == "skirt":  # the section is closed
        apart = np.minimum(apart, np.ptp(u) - apart)
    nearest = np.inf
    for v in np.linspace(sheet.v[0], sheet.v[-1], 9):
        points = sheet.position(*Jet.variables(u, np.full_like(u, v), 0)).value.T
        points = points[:, :2] if kind == "scroll" else points  # successive turns are shifted along the axis
        nearest = min(nearest, cdist(points, points)[apart > APART[kind]].min())
    assert nearest == pytest.approx(sheet.gap, rel=0.1)
    assert sheet.gap == pytest.approx(gap, rel=0.15)


def test_the_neck_of_a_fold():
    """Against the curve itself: how far one side reaches towards the other."""
    t = np.linspace(-pi / 2, 0, 200_001)
    for q in (1.7, 3.0, 4.5):
        x = t - q / 2 * np.sin(2 * t)
        assert drapery.neck(q) == pytest.approx(pi - 2 * x.max(), abs=1e-6)
        assert drapery.overhang(drapery.neck(q)) == pytest.approx(q, abs=1e-9)


def test_kinds_alternate_and_shapes_are_repeatable():
    assert [shape.info["kind"] for shape in SHAPES] == list(drapery.KINDS)
    first, again, train = (next(Cloth(kind="scroll").shapes(split)).mesh for split in ("test", "test", "train"))
    assert first.vertices.tobytes() == again.vertices.tobytes() != train.vertices.tobytes()
    for values in ({"kind": "sock"}, {"gap_low": 0.5}, {"gap_high": 0.5}):
        with pytest.raises(ValueError, match=rf"^{next(iter(values))}: expected"):
            Cloth(**values)
