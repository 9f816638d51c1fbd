"""Measured traits of surfaces, and their tags: against closed forms, other tessellations, rotations and sizes."""

from functools import cache
from math import atan, pi, sqrt

import numpy as np
import pytest
from trimesh import Trimesh, creation, util

from bench import Frame, Shape
from bench.geometry.traits import GAP, NEAR, SHARP, SMOOTH, TAGS, THICKNESS, Traits, all_tags, connected, measure_traits
from bench.geometry.walks import Terrain


def traits(mesh: Trimesh) -> Traits:
    return Shape("one", mesh).traits


@cache
def known_traits(name: str) -> Traits:
    return traits(SHAPES[name])


def rounded_box(radius: float, edge: float = 0.02, half: float = 0.5) -> Trimesh:
    """A cube whose edges are rounded by ``radius``: the points at that distance from an inner cube."""
    flat = np.linspace(-(half - radius), half - radius, max(2, int((2 * half - 2 * radius) / edge)))
    turn = half - radius + radius * np.tan(np.linspace(0, pi / 4, max(3, int(radius / edge * 2)))[1:])
    lines = np.concatenate([-turn[::-1], flat, turn])
    u, v = np.meshgrid(lines, lines, indexing="ij")
    n = len(lines)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    quad = np.stack([i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1], axis=1)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    parts = []
    for axis in range(3):
        for sign in (-1, 1):
            places = np.stack([np.full(u.size, half), u.ravel(), v.ravel()], axis=1) * [sign, 1, 1]
            inner = np.clip(places, radius - half, half - radius)
            away = places - inner
            points = inner + radius * away / np.linalg.norm(away, axis=1, keepdims=True)
            parts.append(Trimesh(np.roll(points, axis, axis=1), faces[:, ::sign], process=False))
    joined = util.concatenate(parts)
    joined.merge_vertices(digits_vertex=9)
    return joined


def turned(mesh: Trimesh, seed: int) -> Trimesh:
    from trimesh.transformations import random_rotation_matrix

    turn = random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]
    return Trimesh(37.0 * mesh.vertices @ turn.T + [1e3, -5, 2], mesh.faces, process=False)


# -- walks -------------------------------------------------------------------------------------------------------------


def test_walks_on_a_unit_sphere_turn_by_their_length():
    sphere = creation.icosphere(5)
    terrain = Terrain(sphere.vertices, sphere.faces)
    at = np.arange(0, len(terrain.faces), 97)
    stops = np.array([0.1, 0.5, 1.0])
    walks = terrain.walk(at, terrain.corners[at].mean(axis=1), np.linspace(0, 6, len(at)), stops)
    start = terrain.normals_at(at, np.full((len(at), 3), 1 / 3))
    angle = np.arccos(np.einsum("nsi,ni->ns", walks, start))
    assert angle == pytest.approx(np.broadcast_to(stops, angle.shape), abs=3e-3)


def test_a_walk_around_a_cube_returns_to_its_start_and_stops_at_a_boundary():
    box = creation.box()
    terrain = Terrain(box.vertices, box.faces)
    side = np.flatnonzero(terrain.normals[:, 0] > 0.9)[:1]
    middle = np.array([[0.5, 0.1, 0.1]])
    for angle in np.linspace(0, 2 * pi, 64, endpoint=False):
        walks = terrain.walk(side, middle, np.array([angle]), np.array([4.0, 6.0]))
        along = terrain.half_edges[0][3 * side[0]] * np.cos(angle) + terrain.half_edges[1][3 * side[0]] * np.sin(angle)
        if np.abs(along).max() > 1 - 1e-9:  # along an axis: over four sides, back to the start
            assert walks[0, 0] == pytest.approx([1, 0, 0])
            assert walks[0, 1] == pytest.approx([-1, 0, 0])
    half = Terrain(box.vertices, box.faces[terrain.normals[:, 0] > 0.9])
    walks = half.walk(np.array([0]), middle, np.array([0.3]), np.array([0.05, 4.0]))
    assert walks[0, 0] == pytest.approx([1, 0, 0]) and not walks[0, 1].any()


def test_walks_over_inconsistently_wound_faces_stay_on_one_side():
    """On a cube, whose normals are those of its faces everywhere: a walk stays on the side of its start."""
    box = creation.box().subdivide().subdivide()
    flipped = box.faces.copy()
    flipped[::3] = flipped[::3, ::-1]
    mixed = Terrain(box.vertices, flipped)
    at = np.arange(len(flipped))
    # One stop within the start's side, one beyond its edges; both walks start in the same direction in space.
    walks = mixed.walk(at, mixed.corners[at].mean(axis=1), np.full(len(at), 0.7), np.array([0.02, 0.3]))
    same_side = np.einsum("ni,ni->n", walks[:, 0], mixed.normals[at])
    assert same_side == pytest.approx(1)
    assert (np.abs(walks).max(axis=2) > 1 - 1e-9).all()
    assert np.einsum("ni,ni->n", walks[:, 1], mixed.normals[at]).min() > -1e-9


def test_normals_approach_those_of_a_smooth_surface_and_keep_edges():
    for subdivisions, error in ((2, 0.03), (4, 0.003)):
        sphere = creation.icosphere(subdivisions)
        normals = Terrain(sphere.vertices, sphere.faces).corner_normals
        exact = sphere.vertices[sphere.faces]
        assert np.abs(normals - exact).max() < error
    box = creation.box().subdivide()
    terrain = Terrain(box.vertices, box.faces)
    assert terrain.corner_normals == pytest.approx(np.repeat(terrain.normals[:, None], 3, axis=1))


# -- sharp and smooth --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", [creation.icosphere(2), creation.icosphere(5), creation.uv_sphere(count=[64, 64])])
def test_a_sphere_is_smooth_however_it_is_tessellated(mesh):
    assert traits(mesh).tags == ("smooth",)
    assert traits(mesh).detail < 0.1


@pytest.mark.parametrize("pieces", [0, 4])
def test_the_sharpness_of_a_cube_is_the_share_of_its_area_near_edges(pieces):
    mesh = creation.box()
    for _ in range(pieces):
        mesh = mesh.subdivide()
    found = traits(mesh)
    side = 2 / sqrt(3)
    # The best of eight directions is at most 22.5 degrees off.
    share = 1 - (1 - 2 * NEAR / side) ** 2
    assert 0.85 * share < found.edges < 1.1 * share
    assert found.tags == ("sharp",)


@pytest.mark.parametrize("radius", [0.02, 0.04, 0.07, 0.12])
def test_rounded_edges_are_edges_where_the_curvature_is_high_enough(radius):
    """A rounding of radius r turns by 30 degrees within r pi / 6: within 0.03 where r is below 0.0573.

    Then the strip where it does so is 0.03 - r pi / 6 wide on each side: of 2 % of the area where r is below 0.03.
    """
    half = 0.5
    farthest = sqrt(3) * (half - radius) + radius  # the corner, which the frame scales to 1
    mesh = rounded_box(radius * farthest, half=half)
    own = Frame.of(mesh.vertices).radius
    assert (radius * farthest / own) == pytest.approx(radius, rel=0.2)
    found = traits(mesh)
    assert ("sharp" in found.tags) == (radius == 0.02)
    assert ("smooth" in found.tags) == (radius * farthest / own > NEAR * 6 / pi)


def test_a_prism_of_many_sides_is_smooth_around_and_sharp_at_its_ends():
    """Sides that meet at less than 30 degrees approximate a smooth surface; at 60 degrees they form edges."""
    few, many = (traits(creation.cylinder(1, 2, sections=n)).edges for n in (6, 64))
    ends = 0.05
    assert many == pytest.approx(ends, abs=0.02) and few > 1.5 * many


@pytest.mark.parametrize("radius", [0.025, 0.1, 0.4])
def test_a_wire_has_edges_only_at_its_ends(radius):
    found = traits(creation.capsule(2 - 2 * radius, radius, count=[64, 64]))
    ends = (2 * NEAR + pi * radius) / (2 + (pi - 2) * radius) if radius < NEAR else 0  # shares of the length
    assert found.edges <= ends and "multiscale" not in found.tags
    assert ("thin" in found.tags) == (2 * radius < THICKNESS)


# -- thin, near contact ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_plate_is_thin_below_the_threshold(factor):
    side = 1.4
    thickness = factor * THICKNESS
    for mesh in (plate := creation.box((side, side, thickness)), plate.subdivide().subdivide()):
        found = traits(mesh)
        assert ("thin" in found.tags) == (thickness / Frame.of(mesh.vertices).radius < THICKNESS)
        assert "near_contact" not in found.tags


def test_the_opposite_side_of_a_sheet_is_not_an_edge():
    """Only the strip around the rim is."""
    side, thickness = 1.4, 0.004
    found = traits(creation.box((side, side, thickness)))
    rims = 8 * side * NEAR / (2 * side**2)
    assert found.edges == pytest.approx(rims, rel=0.15)


@pytest.mark.parametrize("gap", [0.5 * GAP, 2 * GAP])
def test_two_spheres_near_each_other(gap):
    one = creation.icosphere(5)
    far = 2 + gap * (2 + gap / 2)  # the frame's radius is half of 4 + far - 2
    found = traits(util.concatenate([one, one.copy().apply_translation((far, 0, 0))]))
    assert ("near_contact" in found.tags) == (gap < GAP)
    assert found.components == 2 and found.genus == 0 and "smooth" in found.tags


def test_a_slot_is_near_contact_but_a_narrow_hole_or_a_corner_is_not():
    tube = traits(creation.annulus(0.02, 0.6, 0.6, sections=48))
    assert "near_contact" not in tube.tags and tube.genus == 1
    slot = [(0, 0), (1, 0), (1, 1), (0.52, 1), (0.52, 0.2), (0.48, 0.2), (0.48, 1), (0, 1)]
    assert "near_contact" in traits(prism(slot)).tags
    notch = [(0, 0), (1, 0), (1, 1), (0.7, 1), (0.5, 0.6), (0.3, 1), (0, 1)]
    assert "near_contact" not in traits(prism(notch)).tags


def prism(corners: list[tuple[float, float]]) -> Trimesh:
    from manifold3d import CrossSection

    solid = CrossSection([corners]).extrude(0.5).to_mesh64()
    return Trimesh(np.asarray(solid.vert_properties)[:, :3], np.asarray(solid.tri_verts).astype(int), process=False)


def test_two_sides_are_connected_only_within_a_large_enough_ball():
    box = creation.box((1, 1, 0.01)).subdivide().subdivide().subdivide()
    terrain = Terrain(box.vertices, box.faces)
    top, bottom = (
        int(np.flatnonzero(side * terrain.normals[:, 2] > 0.9)[
            np.abs(terrain.corners[side * terrain.normals[:, 2] > 0.9].mean(axis=1)[:, :2]).max(axis=1).argmin()
        ])
        for side in (1, -1)
    )  # fmt: skip
    centre = terrain.corners[top].mean(axis=0)
    assert not connected(terrain, centre, 0.2, top, bottom)
    assert connected(terrain, centre, 0.8, top, bottom)


# -- genus, scales, boundaries -----------------------------------------------------------------------------------------


def test_genus_counts_all_components():
    ring = creation.torus(1, 0.2, major_sections=24, minor_sections=12)
    for count in (1, 9, 11):
        found = traits(util.concatenate([ring.copy().apply_translation((3 * k, 0, 0)) for k in range(count)]))
        assert found.genus == found.components == count
        assert ("high_genus" in found.tags) == (count >= 10)


def waves(*terms: tuple[float, int]) -> Trimesh:
    """A ball whose radius is ``1 + sum of a sin(k x) sin(k y) sin(k z)`` over the pairs (a, k)."""
    ball = creation.icosphere(6)
    x = ball.vertices
    radius = 1 + sum(a * np.prod(np.sin(k * x), axis=1) for a, k in terms)
    return Trimesh(radius[:, None] * x, ball.faces, process=False)


def test_detail_on_every_scale_is_multiscale_and_on_one_scale_is_not():
    assert "multiscale" in known_traits("rough").tags
    for k in (4, 19):
        assert "multiscale" not in traits(waves((0.5 / k, k))).tags


def test_a_surface_with_a_boundary_is_open():
    sphere = creation.icosphere(4)
    half = Trimesh(sphere.vertices, sphere.faces[sphere.triangles_center[:, 2] > 0], process=False)
    assert traits(half).tags == ("smooth", "open") and traits(half).boundary_edges > 0


# -- invariance --------------------------------------------------------------------------------------------------------


SHAPES = {
    "box": creation.box((1, 2, 3)),
    "annulus": creation.annulus(0.3, 0.8, 0.05, sections=64),
    "torus": creation.torus(1, 0.3, major_sections=64, minor_sections=32),
    "capsule": creation.capsule(1, 0.4, count=[32, 32]),
    "rough": waves(*[(0.5 / k, k) for k in (4, 9, 19, 40, 80)]),
}


@pytest.mark.parametrize("name", SHAPES)
def test_size_position_and_rotation_matter_only_through_the_box_of_the_frame(name):
    """A rotation changes the box, and so its centre and radius, a little; traits change no more than that."""
    mesh = SHAPES[name]
    moved = turned(mesh, 3)
    unturned = Trimesh(37.0 * mesh.vertices + [1e3, -5, 2], mesh.faces, process=False)
    found = known_traits(name)
    elsewhere = traits(unturned)
    assert elsewhere.tags == found.tags
    assert np.array(elsewhere) == pytest.approx(np.array(found), abs=2e-3)
    assert traits(moved).tags == found.tags
    again = measure_traits(*(lambda m: (m.vertices, m.faces))(Shape("one", mesh).framed()[0].mesh))
    assert again == found


@pytest.mark.parametrize("name", ["box", "annulus", "torus", "capsule"])
def test_a_finer_tessellation_has_the_same_tags(name):
    finer = SHAPES[name].subdivide().subdivide()
    assert traits(finer).tags == known_traits(name).tags
    finer.merge_vertices()
    soup = Trimesh(
        finer.vertices[finer.faces].reshape(-1, 3), np.arange(3 * len(finer.faces)).reshape(-1, 3), process=False
    )
    assert traits(soup).tags == known_traits(name).tags


def test_inward_faces_change_nothing():
    plate = creation.box((1.4, 1.4, 0.02))
    inward = Trimesh(plate.vertices, plate.faces[:, ::-1], process=False)
    assert traits(inward).tags == traits(plate).tags == ("sharp", "thin")


def test_points_and_degenerate_faces_have_no_traits():
    flat = Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False)
    for faces in (flat.faces, np.empty((0, 3), dtype=int)):
        found = measure_traits(np.zeros((3, 3)), faces)
        assert found.tags == () and np.isnan(found.edges)


def test_measured_names_cannot_be_declared():
    found = traits(creation.icosphere(3))
    assert all_tags(found, ("ball", "sharp", "thin")) == ("smooth", "ball")
    assert set(found.tags) <= set(TAGS)
    assert Traits.of(found.arrays()) == found


def test_a_truncated_ball_has_the_edge_of_its_known_angle():
    """A cap cut off a ball leaves an edge of a known angle: at 18 degrees none, at 60 a strip of 2.8 % of the area."""
    for height, edge in ((0.95, 18), (0.5, 60)):
        ball = creation.icosphere(6)
        ball.vertices[:, 2] = np.minimum(ball.vertices[:, 2], height)
        assert np.degrees(atan(sqrt(1 - height**2) / height)) == pytest.approx(edge, abs=1)
        found = traits(ball).edges
        assert (found > SMOOTH) == (edge > 30) and (found >= SHARP) == (edge > 30)
