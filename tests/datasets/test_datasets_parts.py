"""Parts: closed manifolds with circular fillets and legible numbers."""

from __future__ import annotations

from itertools import islice
from math import pi

import numpy as np
import pytest
from manifold3d import JoinType, Manifold

from bench.datasets.outlines import lettering
from bench.datasets.outlines.glyphs import GLYPHS
from bench.datasets.parts import Parts
from bench.datasets.solids import filleted, fillets
from bench.geometry.topology import count_topology

SHAPES = list(islice(Parts().shapes("test"), len(filleted.KINDS)))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_a_part_has_the_stated_properties(shape):
    mesh, info = shape.mesh, shape.info
    counts = count_topology(mesh.vertices, mesh.faces)
    assert (counts.watertight, counts.components, counts.genus) == (True, 1, info["genus"])
    assert mesh.volume > 0 and mesh.area_faces.min() > 1e-12
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert shape.tags == (info["kind"],)
    assert 0.001 < info["fillet"] < 0.1 and 0.002 < abs(info["depth"]) < 0.05
    assert info["text"].replace("-", "").isalnum()


def test_a_part_with_lettering_is_tagged_sharp():
    assert "sharp" in SHAPES[1].traits.tags


def test_kinds_alternate_and_shapes_are_repeatable():
    assert [shape.info["kind"] for shape in SHAPES] == list(filleted.KINDS)
    again, train = next(Parts().shapes("test")).mesh, next(Parts().shapes("train")).mesh
    assert again.vertices.tobytes() == SHAPES[0].mesh.vertices.tobytes()
    assert train.vertices.tobytes() != again.vertices.tobytes()
    with pytest.raises(ValueError, match="^kind: expected one of"):
        Parts(kind="spoon")


# -- fillets -----------------------------------------------------------------------------------------------------------


def test_the_volume_of_a_rounded_disc_matches_an_integral():
    """At height z of a fillet of radius r, a disc of radius R has the radius R - r + sqrt(r^2 - z^2)."""
    radius, height, r = 1.0, 0.5, 0.2
    z = (np.arange(20_000) + 0.5) / 20_000 * r
    rounded = pi * ((radius - r + np.sqrt(r * r - z * z)) ** 2).mean() * r
    solid = fillets.extruded([fillets.circle(radius, 400)], height, top=r, bottom=r)
    assert solid.volume() == pytest.approx(pi * radius**2 * (height - 2 * r) + 2 * rounded, rel=2e-3)


def test_fillets_are_arcs_also_at_holes_and_inner_corners():
    """The vertices of the upper fillet are at distance r from the outline offset inward by r, r below the top."""
    r, height = 0.05, 0.4
    ell = fillets.polygon([(0, 0), (1, 0), (1, 0.4), (0.4, 0.4), (0.4, 1), (0, 1)], [0.08] * 3 + [0.1] + [0.08] * 2)
    hole = fillets.circle(0.1).at(0.2, 0.2).hole
    solid = fillets.extruded([ell, hole], height, top=r)
    assert solid.genus() == 1
    vertices = np.asarray(solid.to_mesh64().vert_properties)
    upper = vertices[vertices[:, 2] > height - r + 1e-9]
    spine = fillets.section(ell, hole).offset(-r, JoinType.Round, circular_segments=256).to_polygons()
    flat = np.min([_to_polygon(upper[:, :2], line) for line in spine], axis=0)
    assert np.hypot(flat, upper[:, 2] - (height - r)) == pytest.approx(np.full(len(upper), r), abs=2e-4)


def _to_polygon(points, corners):
    """The distances of points (n, 2) to a closed polyline (m, 2)."""
    along = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    share = np.clip((away * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1)


def test_normals_of_lobes_are_perpendicular_to_the_curve():
    curve = fillets.lobes(0.5, 0.05, 7, 2000)
    along = np.roll(curve.points, -1, axis=0) - np.roll(curve.points, 1, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert np.abs((along * curve.normals).sum(axis=1)).max() < 1e-3


# -- lettering ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("character", [*lettering.CHARACTERS])
def test_every_character_is_one_piece_with_its_holes(character):
    letter = lettering.ink(lettering.lines(character, 1.0), filleted.PEN)
    assert len(letter.decompose()) == 1
    holes = {name: count for kind in GLYPHS.values() for name, (count, _) in kind.items()} | {"O": 2}
    assert letter.num_contour() == holes.get(character, 1)


def test_the_ink_of_a_straight_stroke_is_a_stadium():
    stroke = lettering.ink(lettering.lines("I", 1.0), 0.2)
    assert stroke.area() == pytest.approx(0.2 * 1.0 + pi * 0.1**2, rel=0.02)


def test_a_line_of_text_has_the_stated_width_and_can_follow_a_circle():
    strokes = lettering.lines("H-8 H", 2.0)
    points = np.concatenate(strokes)
    assert np.ptp(points[:, 1]) == pytest.approx(2.0, rel=0.01)
    assert np.ptp(points[:, 0]) == pytest.approx(2.0 * lettering.width("H-8 H"), rel=0.05)
    bent = np.concatenate(lettering.around(strokes, 10.0, pi / 2))
    assert np.hypot(*bent.T) == pytest.approx(10 + points[:, 1], abs=1e-9)
    assert bent[:, 0].argmin() == points[:, 0].argmin()  # from left to right, seen from above


@pytest.mark.parametrize("depth", [0.1, -0.1])
def test_lettering_removes_or_adds_its_area_times_its_depth(depth):
    block, strokes = Manifold.cube((4, 2, 1), True), lettering.lines("K-48", 0.8)
    written = filleted._written(block, strokes, 0.8, 0.5, depth)
    area = lettering.ink(strokes, filleted.PEN * 0.8).area()
    assert block.volume() - written.volume() == pytest.approx(area * depth, rel=1e-6)
    assert written.genus() == 0
