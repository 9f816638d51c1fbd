"""Shapes from closed-form patches: the exact surface against identities, finite differences and brute force."""

from __future__ import annotations

from functools import cache
from itertools import islice

import numpy as np
import pytest
from even_meshes import even
from scipy.spatial import cKDTree

from bench import generator
from bench.datasets.common.rotations import random_rotation
from bench.datasets.details.patterns import SEGMENTS, STROKE, hexagons, knurl, letters, weave
from bench.datasets.fbm import Fbm
from bench.datasets.plates import Plates
from bench.datasets.reliefs import Reliefs
from bench.datasets.superquadrics import Superquadrics
from bench.datasets.supershapes import Supershapes
from bench.datasets.surfaces.gradient_noise import BOUND, FractalNoise, GradientNoise
from bench.datasets.surfaces.jets import Jet, abs_power, cos, exp, sin, smooth_step, stack, unit_normal
from bench.datasets.surfaces.parametric import Chart, ParametricSurface, Patch
from bench.datasets.surfaces.patch_mesh import pole_levels
from bench.datasets.vases import Vases
from bench.geometry.alignment import rotation_between
from bench.geometry.topology import count_topology

# The default families, and coarse ones where the default is not needed.
COARSE = {
    "superquadrics": Superquadrics(rows=64, columns=96),
    "supershapes": Supershapes(rows=64, columns=128),
    "fbm": Fbm(cells=32, octaves=3),
    "vases": Vases(columns=96),
    "plates": Plates(spacing=0.04),
    "reliefs": Reliefs(cells=256),
}
FAMILIES = list(COARSE)
CASES = [(family, index) for family in FAMILIES for index in range(4)]
THREE = [(family, index) for family, index in CASES if index < 3]  # walls and sheets, three bases of reliefs and of fbm


@cache
def shape(family: str, index: int, split: str = "test"):
    made = next(islice(COARSE[family].shapes(split), index, None))
    return even(made) if family == "fbm" else made  # refinement has its own tests


def diagonal(mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


# -- building blocks ---------------------------------------------------------------------------------------------------


def test_derivatives_of_jets_match_finite_differences():
    def f(u, v):
        smooth = sin(u * v) * exp(u) / (2 + cos(v)) + (u * u + v * v + 1) ** -0.5
        return smooth + abs_power(u - 0.3, 3.5) + smooth_step(v) - 1 / (u + 2)

    rng = np.random.default_rng(0)
    u, v = rng.uniform(0.4, 0.9, size=(2, 50))
    h = 1e-5
    exact = f(*Jet.variables(u, v, 3))
    for k, (du, dv) in enumerate([(h, 0), (0, h)]):
        ahead, behind = (f(*Jet.variables(u + s * du, v + s * dv, 2)).c for s in (1, -1))
        assert np.abs((ahead - behind) / (2 * h) - exact.derivative(k).c).max() < 1e-6


def test_the_normal_of_a_sphere_is_its_position():
    u, v = np.random.default_rng(1).uniform(-1.4, 1.4, size=(2, 40))
    U, V = Jet.variables(u, v, 3)
    x = stack(cos(U) * cos(V), cos(U) * sin(V), sin(U))
    assert np.abs(unit_normal(x).c + x.truncate(2).c).max() < 1e-11


def test_rotations_are_rotations_without_a_preferred_direction():
    rng = np.random.default_rng(0)
    R = np.array([random_rotation(rng) for _ in range(4000)])
    assert np.abs(np.einsum("nij,nkj->nik", R, R) - np.eye(3)).max() < 1e-14
    assert np.abs(np.linalg.det(R) - 1).max() < 1e-14
    assert np.abs(R.mean(axis=0)).max() < 0.04  # each entry has mean 0 and variance 1/3
    assert np.abs((R**2).mean(axis=0) - 1 / 3).max() < 0.03
    assert np.abs(np.trace(R, axis1=1, axis2=2).mean()) < 0.06  # the mean trace of a uniform rotation is 0


def test_levels_of_neighbouring_rows_differ_by_one():
    levels = pole_levels(np.cos(np.linspace(-np.pi / 2, np.pi / 2, 101)), np.full(101, 0.5), 64)
    assert np.abs(np.diff(levels)).max() == 1 and levels[50] == 0 and levels[0] > 2


def ball(radius: float = 2.0, cells: int = 48) -> ParametricSurface:
    def position(u, v):
        return stack(cos(u) * cos(v) * radius, cos(u) * sin(v) * radius, sin(u) * radius)

    lines = np.linspace(-np.pi / 2, np.pi / 2, cells + 1), np.linspace(-np.pi, np.pi, 2 * cells + 1)
    return ParametricSurface(lambda: ([Chart(position, flip=True)], [Patch(0, *lines, reach=(0, 2 * np.pi))]))


def test_a_sphere_matches_its_closed_forms():
    surface = ball()
    mesh = surface.mesh()
    assert count_topology(mesh.vertices, mesh.faces)[:2] == (1, 0) and mesh.volume > 0
    u = np.random.default_rng(0).normal(size=(3000, 3))
    u[:2] = [[0, 0, 1], [0, 0, -1]]  # the poles
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    closest, normals = surface.closest(u * np.linspace(0.2, 6, 3000)[:, None])
    assert np.abs(closest - 2 * u).max() < 1e-7 and np.abs(normals - u).max() < 1e-5
    points, normals = surface.sample(20_000, np.random.default_rng(0))
    assert np.abs(points - 2 * normals).max() < 1e-9
    assert np.abs((points**2).mean(axis=0) - 4 / 3).max() < 0.03
    assert all(part.shape == (0, 3) for part in (*surface.closest(np.empty((0, 3))), *surface.sample(0, generator(0))))


def test_noise_is_bounded_twice_differentiable_and_zero_on_the_lattice():
    noise = GradientNoise(np.random.default_rng(0))
    rng = np.random.default_rng(1)
    places = rng.uniform(-20, 300, size=(3, 20_000))
    value = noise(Jet(places[None])).value
    assert 0.5 < np.abs(value).max() <= BOUND and abs(value.mean()) < 0.01
    assert np.abs(noise(Jet(np.floor(places)[None])).value).max() == 0
    # Continuous with two derivatives across the planes of the lattice
    u, v = Jet.variables(np.full(200, 5.0), rng.uniform(0, 9, 200), 2)
    sides = [noise(stack(u + s * 1e-9, v, 0.3 * v)).c for s in (-1, 1)]
    assert np.abs(sides[0] - sides[1]).max() < 1e-6
    assert np.abs(FractalNoise(4, 0.5, 2.0, rng)(Jet(places[None])).value).max() <= 1


def test_letters_stay_within_their_cells_and_heights_within_0_and_1():
    assert np.abs(SEGMENTS).max(axis=(0, 1)).max() + STROKE <= 0.5
    u, v = Jet.variables(*np.random.default_rng(0).uniform(-3.1, 3.1, size=(2, 20_000)), 0)
    for pattern in (hexagons(8, 8), knurl(7, 9), weave(8, 6), letters(5, 8, np.random.default_rng(1))):
        height = pattern(u, v).value
        assert -1e-12 < height.min() < 0.01 and 0.99 < height.max() < 1 + 1e-12


# -- all families ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("family", "index"), CASES)
def test_meshes_are_valid(family, index):
    made = shape(family, index)
    mesh = made.mesh
    counts = count_topology(mesh.vertices, mesh.faces)
    assert counts.components == 1 and counts.genus == made.info["genus"]
    assert counts.watertight == (counts.boundary_edges == 0) == ("open" not in made.traits.tags)
    assert mesh.is_winding_consistent
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices) == len(np.unique(mesh.faces))
    assert mesh.area_faces.min() > 1e-12 * diagonal(mesh) ** 2
    if counts.watertight:
        assert mesh.volume > 0
    # Face normals agree with the exact normals
    centres = mesh.triangles_center[::61]
    closest, normals = made.surface.closest(centres)
    facing = np.einsum("ni,ni->n", mesh.face_normals[::61], normals)
    assert (facing > 0).mean() > 0.99
    assert np.linalg.norm(closest - centres, axis=1).mean() < 2e-3 * diagonal(mesh)
    # Vertices lie on the surface
    vertices = mesh.vertices[::53]
    assert np.linalg.norm(made.surface.closest(vertices)[0] - vertices, axis=1).max() < 1e-9 * diagonal(mesh)


@pytest.mark.parametrize(("family", "index"), THREE)
def test_samples_are_on_the_surface_and_uniform_by_area(family, index):
    made = shape(family, index)
    points, normals = made.surface.sample(8_000, generator(1))
    size = diagonal(made.mesh)
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-12
    some = points[:800]
    assert np.linalg.norm(made.surface.closest(some)[0] - some, axis=1).max() < 1e-9 * size
    # The counts per region follow the area of the mesh there (regions: Voronoi cells of the first 20 points)
    tree = cKDTree(points[:20])
    hits = np.bincount(tree.query(points)[1], minlength=20)
    area = np.bincount(tree.query(made.mesh.triangles_center)[1], weights=made.mesh.area_faces, minlength=20)
    expected = len(points) * area / area.sum()
    # The mesh is coarse: allow 2.5 % per region in addition to the random error of the counts.
    assert (np.abs(hits - expected) < 4.5 * np.sqrt(expected) + 0.025 * expected + 10).all()


@pytest.mark.parametrize(("family", "index"), [(family, index) for family in FAMILIES for index in (0, 3)])
def test_area_elements_are_within_the_bound_of_their_cell(family, index):
    surface = shape(family, index).surface
    owners, corners, widths, bounds, _ = surface._cells
    rng = np.random.default_rng(3)
    cell = rng.integers(len(owners), size=10_000)
    places = corners[cell] + rng.random((len(cell), 2)) * widths[cell]
    _, x_u, x_v = surface.evaluate(surface._table["chart"][owners[cell]], *places.T, 1)
    assert (np.linalg.norm(np.cross(x_u, x_v), axis=1) <= bounds[cell]).mean() > 0.9999


@pytest.mark.parametrize(("family", "index"), THREE)
def test_closest_points_against_brute_force(family, index):
    made = shape(family, index)
    surface, size = made.surface, diagonal(made.mesh)
    rng = np.random.default_rng(0)
    on, _ = surface.sample(300, rng)
    points = on + size * rng.normal(size=on.shape) * np.repeat([0.001, 0.02, 0.2], 100)[:, None]
    closest, normals = surface.closest(points)
    distance = np.linalg.norm(points - closest, axis=1)
    start = np.linalg.norm(points - surface._tree.closest(points).points, axis=1)
    brute = cKDTree(surface.sample(4_000, rng)[0]).query(points)[0]
    # Where two points are nearly equally close, the tessellation may lead to the farther one.
    assert (distance <= brute + 1e-9).mean() > 0.97
    assert (distance - brute).max() < 5e-3 * size and np.abs(distance - start).max() < 0.02 * size
    # Away from edges and boundaries the connecting line is normal to the surface
    askew = np.linalg.norm(np.cross(points - closest, normals), axis=1)
    if family not in ("superquadrics", "supershapes", "plates") and made.mesh.is_watertight:
        assert (askew < 1e-6 * size).mean() > 0.99


@pytest.mark.parametrize("family", FAMILIES)
def test_normals_and_derivatives_against_finite_differences(family):
    surface = shape(family, 1).surface
    owners, corners, widths, _, _ = surface._cells
    rng = np.random.default_rng(5)
    cell = rng.integers(len(owners), size=300)
    u, v = (corners[cell] + rng.uniform(0.3, 0.7, size=(300, 2)) * widths[cell]).T
    patch = owners[cell]
    chart = surface._table["chart"][patch]
    h = 1e-6
    exact = surface.evaluate(chart, u, v, 2)
    scale = np.abs(exact[1:]).max() + 1
    for k, (du, dv) in enumerate([(h, 0), (0, h)]):
        ahead, behind = (surface.evaluate(chart, u + s * du, v + s * dv, 1) for s in (1, -1))
        difference = (ahead - behind) / (2 * h)
        assert np.quantile(np.abs(difference[0] - exact[1 + k]), 0.99) < 1e-6 * scale
        assert np.quantile(np.abs(difference[1 + k] - 2 * exact[3 + 2 * k]), 0.97) < 1e-4 * scale
    points, normals = surface.at(patch, u, v)
    assert np.abs(np.einsum("ni,ni->n", normals, exact[1])).max() < 1e-10 * scale
    assert np.array_equal(points, exact[0])


@pytest.mark.parametrize("family", FAMILIES)
def test_splits_are_disjoint_and_shapes_are_repeatable_and_lazy(family):
    made = [*islice(COARSE[family].shapes("test"), 5)]
    assert [one.id.startswith(f"{family}-test-{i:03d}") for i, one in enumerate(made)] == [True] * 5
    assert all(one.exactness == "parametric" and "parts" not in vars(one._surface) for one in made)
    again = even(next(COARSE[family].shapes("test")))
    assert np.array_equal(again.mesh.vertices, shape(family, 0).mesh.vertices)
    assert np.array_equal(again.surface.sample(50, generator(1))[0], made[0].surface.sample(50, generator(1))[0])
    train = shape(family, 0, "train").mesh.vertices
    assert train.shape != again.mesh.vertices.shape or np.abs(train - again.mesh.vertices).max() > 1e-3


@pytest.mark.parametrize("family", [family for family in FAMILIES if family != "fbm"])
def test_default_meshes_have_ten_to_a_hundred_thousand_vertices(family):
    dataset = type(COARSE[family])()
    for made in islice(dataset.shapes("test"), 1, 2):
        assert 10_000 <= len(made.mesh.vertices) <= 100_000


@pytest.mark.parametrize(
    ("dataset", "parameters", "name"),
    [
        (Superquadrics, {"exponent_low": 0.0}, "exponent_low"),
        (Superquadrics, {"exponent_high": 3.0}, "exponent_high"),
        (Superquadrics, {"kind": "cube"}, "kind"),
        (Superquadrics, {"rows": 3}, "rows"),
        (Supershapes, {"lobes_low": 1}, "lobes_low"),
        (Supershapes, {"lobes_high": 99}, "lobes_high"),
        (Supershapes, {"depth": 0.0}, "depth"),
        (Supershapes, {"columns": 1}, "columns"),
        (Fbm, {"octaves": 0}, "octaves"),
        (Fbm, {"hurst_low": 2.0}, "hurst_low"),
        (Fbm, {"strength": 1.0}, "strength"),
        (Fbm, {"frequency": 0.0}, "frequency"),
        (Fbm, {"base": "cube"}, "base"),
        (Fbm, {"cells": 1}, "cells"),
        (Vases, {"thickness_low": 0.0}, "thickness_low"),
        (Vases, {"thickness_high": 0.2}, "thickness_high"),
        (Vases, {"columns": 100}, "columns"),
        (Plates, {"ratio_low": 0.0}, "ratio_low"),
        (Plates, {"ratio_high": 0.5}, "ratio_high"),
        (Plates, {"kind": "curved"}, "kind"),
        (Plates, {"spacing": 1.0}, "spacing"),
        (Reliefs, {"cells": 100}, "cells"),
    ],
)
def test_bad_parameters_are_named(dataset, parameters, name):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        dataset(**parameters)


# -- each family -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, 1, 2])
def test_superellipsoids_satisfy_their_implicit_equation(index):
    made = shape("superquadrics", index)
    points, _ = made.surface.sample(2000, generator(2))
    a, b, c = made.info["axes"]
    e1, e2 = made.info["e1"], made.info["e2"]
    x, y, z = np.abs(points @ np.array(made.info["rotation"])).T
    value = ((x / a) ** (2 / e2) + (y / b) ** (2 / e2)) ** (e2 / e1) + (z / c) ** (2 / e1)
    assert np.abs(value - 1).max() < 1e-11


def test_exponents_range_from_box_to_octahedron():
    box = next(Superquadrics(exponent_low=0.1, exponent_high=0.1, kind="ellipsoid", rows=64, columns=96).shapes("test"))
    volume = np.prod(box.info["axes"])
    assert 0.96 < box.mesh.volume / (8 * volume) < 1 and box.info["sharpest_turn"] > 20
    octahedron = next(Superquadrics(exponent_low=2.0, rows=32, columns=64).shapes("test"))
    assert octahedron.mesh.volume == pytest.approx(4 / 3 * np.prod(octahedron.info["axes"]), rel=1e-9)
    assert octahedron.traits.tags == ("sharp",)
    sphere = next(Superquadrics(exponent_low=1.0, exponent_high=1.0, rows=64, columns=96).shapes("test"))
    assert sphere.traits.tags == ("smooth",)
    assert sphere.mesh.volume == pytest.approx(4 / 3 * np.pi * np.prod(sphere.info["axes"]), rel=5e-3)


def test_shapes_without_sharp_turns_have_no_edges():
    """Tags, measured on the mesh, against the exact turn along the two generating curves."""
    for family in ("superquadrics", "supershapes"):
        for made in (shape(family, index) for index in range(8)):
            if made.info["sharpest_turn"] < 20:  # within 0.02 diagonals: more than the 0.03 radii of the tags
                assert "smooth" in made.traits.tags
            if made.info["sharpest_turn"] > 85:
                assert "sharp" in made.traits.tags


@pytest.mark.parametrize("base", ["sphere", "torus", "box", "ellipsoid"])
def test_rough_surfaces_do_not_cross_themselves(base):
    """The displacement stays below the reach of the base, checked against its curvature and width."""
    dataset = Fbm(base=base, cells=24, octaves=1, strength=0.0)
    bare = next(dataset.shapes("test"))
    reach = next(Fbm(base=base, strength=0.5).shapes("test")).info["largest_displacement"] / 0.5
    points, normals = bare.surface.sample(500, generator(0))
    for side in (-1, 1):  # moving along the normal by less than the reach keeps the foot point
        moved = points + side * 0.95 * reach * normals
        assert np.abs(bare.surface.closest(moved)[0] - points).max() < 1e-5


def test_roughness_grows_as_the_exponent_falls():
    rough, smooth = (even(next(Fbm(hurst_low=h, hurst_high=h, cells=32).shapes("test"))) for h in (0.2, 1.2))
    assert rough.info["fine"] and not smooth.info["fine"]
    assert rough.traits.detail > 1.5 * smooth.traits.detail
    bends = [np.abs(made.mesh.face_adjacency_angles).mean() for made in (rough, smooth)]
    assert bends[0] > 1.5 * bends[1]


@pytest.mark.parametrize("index", [0, 1])
def test_the_wall_of_a_vase_has_its_thickness_everywhere(index):
    made = shape("vases", index)
    thickness = made.info["wall"]
    points, normals = made.surface.sample(2000, generator(3))
    through = points - thickness * normals
    other, there = made.surface.closest(through)
    wall = np.linalg.norm(other - through, axis=1) < 1e-2 * thickness
    assert wall.mean() > 0.85  # all except the rim
    assert (np.einsum("ni,ni->n", normals, there)[wall] < -0.99).mean() > 0.99
    # From the middle of the wall, no surface is nearer than half the thickness
    middle = points - 0.5 * thickness * normals
    distance = np.linalg.norm(made.surface.closest(middle)[0] - middle, axis=1)
    assert distance.min() > 0.49 * thickness
    assert "thin" in made.traits.tags or made.info["thickness"] > 0.025
    assert 0.75 < thickness / diagonal(made.mesh) / made.info["thickness"] < 1.33  # box of the rotated shape


def test_single_sheets_have_one_boundary():
    made = shape("vases", 2)
    assert "open" in made.traits.tags and "thin" not in made.traits.tags and "thickness" not in made.info
    counts = count_topology(made.mesh.vertices, made.mesh.faces)
    assert counts.boundary_edges == 96 and counts.genus == 0


@pytest.mark.parametrize("index", range(8))
def test_plates_have_their_thickness_ends_and_tags(index):
    made = shape("plates", index)
    size = diagonal(made.mesh)
    thickness = made.info["wall"]
    points, normals = made.surface.sample(1500, generator(4))
    middle = points - 0.5 * thickness * normals
    distance = np.linalg.norm(made.surface.closest(middle)[0] - middle, axis=1)
    inside = distance > 0.499 * thickness
    assert inside.mean() > 0.6  # except near a flat end
    angles = np.degrees(made.mesh.face_adjacency_angles)
    assert (angles.max() > 80) == (made.info["ends"] == "flat")
    assert "sharp" in made.traits.tags or made.info["ends"] == "round"
    assert made.mesh.volume == pytest.approx(thickness * made.mesh.area / 2, rel=0.35)
    assert "thin" in made.traits.tags or made.info["thickness"] > 0.025
    # the box of the rotated shape differs from that of the sheet
    assert 0.5 < made.info["thickness"] * size / thickness < 2


def test_a_hem_nearly_touches_itself():
    folded = islice(Plates(kind="folded", spacing=0.03).shapes("test"), 8)
    hems = [made for made in folded if made.info["kind"] == "hem"]
    assert hems and all("near_contact" in made.traits.tags for made in hems)
    points, normals = hems[0].surface.sample(4000, generator(5))
    ahead = points + 0.02 * normals  # the gap is 0.02 plus 0.4 of the thickness
    there = hems[0].surface.closest(ahead)[1]
    assert (np.einsum("ni,ni->n", normals, there) < -0.9).mean() > 0.1


def test_ratios_span_the_range():
    ratios = [made.info["ratio"] for made in islice(Plates().shapes("test"), 16)]
    assert min(ratios) < 4e-3 and max(ratios) > 6e-2


@pytest.mark.parametrize("index", range(6))
def test_a_relief_is_its_base_plus_its_displacement(index):
    made = shape("reliefs", index)
    known = made.attributes
    detailed = known["base_vertices"] + known["displacement"][:, None] * known["base_normals"]
    assert np.array_equal(detailed, made.mesh.vertices)
    assert np.abs(np.linalg.norm(known["base_normals"], axis=1) - 1).max() < 1e-12
    height = np.ptp(known["displacement"])
    base_diagonal = np.linalg.norm(np.ptp(known["base_vertices"], axis=0))
    assert 0.5 < height / (made.info["amplitude"] * base_diagonal) < 1.35  # the box is that of the rotated base
    assert (known["displacement"].min() < 0) == made.info["engraved"]
    # The base normals agree with those of the base mesh
    from trimesh import Trimesh

    base = Trimesh(known["base_vertices"], made.mesh.faces, process=False)
    assert base.is_watertight and base.volume > 0
    assert np.einsum("ni,ni->n", base.vertex_normals, known["base_normals"]).min() > 0.98


@pytest.mark.parametrize("index", range(3))
def test_pairs_carry_the_same_displacement_on_another_base(index):
    pair = next(islice(COARSE["reliefs"].pairs("test"), index, None))
    source, target = pair.source, pair.target
    assert np.array_equal(source.mesh.faces, target.mesh.faces)
    assert np.array_equal(source.mesh.vertices, shape("reliefs", index).mesh.vertices)
    assert len({pair.id, source.id, target.id}) == 3
    a, b = source.attributes, target.attributes
    assert np.array_equal(a["displacement"], b["displacement"])
    assert np.abs(a["base_vertices"] - b["base_vertices"]).max() > 0.05
    detailed = b["base_vertices"] + b["displacement"][:, None] * b["base_normals"]
    assert np.array_equal(detailed, target.mesh.vertices)
    assert target.mesh.is_watertight and target.mesh.volume > 0


def test_pairs_can_be_limited_to_one_family_and_amplitude():
    def apart(**parameters):
        dataset = Reliefs(cells=64, **parameters)
        infos, angles = [], []
        for pair in islice(dataset.pairs("test"), 6):
            a, b = pair.source.attributes, pair.target.attributes
            turn = rotation_between(a["base_vertices"], b["base_vertices"])
            cosines = np.einsum("ni,ni->n", a["base_normals"] @ turn.T, b["base_normals"])
            infos.append(pair.source.info)
            angles.append(np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean())
        return infos, angles

    (infos, alike), (_, other) = apart(targets="alike", amplitude=0.01), apart(amplitude=0.01)
    assert {info["amplitude"] for info in infos} == {0.01}
    assert {info["base"] for info in infos} == {"ball", "vase", "ring"}
    assert np.mean(alike) < np.mean(other) < 30  # degrees: normals at the same (u, v) are more similar
    with pytest.raises(ValueError, match=r"amplitude: expected 0\.1"):
        Reliefs(amplitude=0.02)


def test_a_few_shapes_cover_three_amplitudes_and_four_patterns():
    made = [*islice(Reliefs().shapes("test"), 12)]
    assert {one.info["amplitude"] for one in made[:3]} == {1e-1, 1e-2, 1e-3}
    assert len({(one.info["amplitude"], one.info["pattern"]) for one in made}) == 12
    assert {one.info["base"] for one in made[:4]} == {"ball", "vase", "ring"}
