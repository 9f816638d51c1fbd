"""Implicit surfaces and tubes, and their families: blobs, tpms, knots, smooth_csg, branches and teapots."""

from __future__ import annotations

from functools import cache
from itertools import islice

import numpy as np
import pytest
from even_meshes import even
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import cKDTree

from bench import generator
from bench.datasets.blobs import Blobs
from bench.datasets.branches import Branches
from bench.datasets.details.branching import Skeleton, murray_radii, separate
from bench.datasets.knots import Knots
from bench.datasets.smooth_csg import SmoothCsg
from bench.datasets.surfaces.band import sample_near_zero
from bench.datasets.surfaces.blending import smooth_max, smooth_min
from bench.datasets.surfaces.implicit import Body, ImplicitSurface, _largest_component
from bench.datasets.surfaces.sdf_nodes import (
    Difference,
    NodeField,
    Placed,
    Union,
    box,
    capsule,
    cylinder,
    round_cone,
    sphere,
    torus,
)
from bench.datasets.surfaces.tubes import TubeSurface, circle, ellipse, nearest_approach, torus_knot
from bench.datasets.teapots import Teapots
from bench.datasets.tpms import SYMMETRY, WINDOWS, ClippedLevel, Tpms, _body
from bench.geometry.topology import count_topology
from bench.geometry.traits import GAP

FAMILIES = {"blobs": Blobs, "tpms": Tpms, "knots": Knots, "smooth_csg": SmoothCsg, "branches": Branches}
ALL = [(family, index) for family in FAMILIES for index in range(4 if family == "knots" else 2)]
ONE = [("blobs", 1), ("tpms", 1), ("tpms", 2), ("knots", 0), ("knots", 1), ("smooth_csg", 1), ("branches", 1)]
IMPLICIT = [(family, index) for family, index in ONE if family != "knots"]


@cache  # meshes are built once
def shape(family: str, index: int = 0, split: str = "test"):
    """A shape of a family without refinement, which takes seconds and has its own tests."""
    made = next(islice(FAMILIES[family]().shapes(split), index, None))
    return made if family == "knots" else even(made)


def rotation(seed: int = 0) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def implicit(node, step: float = 0.05, size: float = 1.6, **options) -> ImplicitSurface:
    field = NodeField(node, np.eye(3))
    return ImplicitSurface(lambda: Body(field, np.full(3, -size), np.full(3, size), step), **options)


def placed(local, centre=(0.0, 0.0, 0.0), turn=None) -> Placed:
    return Placed(local, np.asarray(centre, dtype=float), np.eye(3) if turn is None else turn)


def diagonal(mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def torus_distance(points, major, minor):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - major, points[:, 2]) - minor


@pytest.mark.parametrize("kind", ["teapot", "mug"])
def test_teapots_and_mugs_have_one_handle_with_an_open_hole(kind):
    made = even(next(islice(Teapots(kind=kind, upright=True).shapes("test"), 3, None)))
    counts = count_topology(made.mesh.vertices, made.mesh.faces)
    assert (counts.components, counts.genus, counts.watertight) == (1, 1, True)
    # The silhouette along y, at 2.5 % of the size: the hole of the handle is a separate component of its background.
    size = np.linalg.norm(made.mesh.vertices - made.mesh.vertices.mean(axis=0), axis=1).max()
    line = np.arange(-1.3, 1.3, 0.025) * size
    places = np.stack(np.meshgrid(line, np.arange(-0.4, 0.4, 0.02), line, indexing="ij"), axis=-1)
    free = (made.surface.body.field.value(places.reshape(-1, 3)) > 0).reshape(places.shape[:3]).all(axis=1)
    pieces, count = label(free)
    assert count == 2
    assert 2 * 0.025 * distance_transform_edt(free & (pieces != pieces[0, 0])).max() > 0.2


# -- the building block ------------------------------------------------------------------------------------------------


def test_the_torus_matches_its_formulas():
    made = implicit(placed(torus(1.0, 0.4)), 0.04)
    mesh = made.mesh
    assert tuple(count_topology(mesh.vertices, mesh.faces)) == (1, 1, 0, True, 0)
    assert np.abs(torus_distance(mesh.vertices, 1.0, 0.4)).max() < 1e-14
    assert mesh.volume == pytest.approx(2 * np.pi**2 * 0.4**2, rel=4e-3)
    assert made._faces[1][-1] / 2 == pytest.approx(4 * np.pi**2 * 0.4, rel=1e-3)  # area, by midpoints of faces
    points = np.random.default_rng(0).uniform(-1.5, 1.5, size=(2000, 3))
    closest, normals = made.closest(points)
    expected = torus_distance(points, 1.0, 0.4)
    assert np.abs(np.linalg.norm(points - closest, axis=1) - np.abs(expected)).max() < 1e-12
    assert np.abs(np.linalg.norm(np.cross(points - closest, normals), axis=1)).max() < 1e-9
    assert all(part.shape == (0, 3) for part in made.closest(np.empty((0, 3))))
    assert all(part.shape == (0, 3) for part in made.sample(0, generator(0)))


def test_samples_of_a_torus_are_uniform_by_area():
    """The angle around the tube has the density ``(R + r cos v) / (2 pi R)``; that around the axis is uniform."""
    points, normals = implicit(placed(torus(1.0, 0.4)), 0.08).sample(40_000, generator(0))
    v = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]) - 1)
    edges = np.linspace(-np.pi, np.pi, 41)
    expected = 40_000 * np.diff(edges + 0.4 * np.sin(edges)) / (2 * np.pi)
    chi_square = ((np.histogram(v, edges)[0] - expected) ** 2 / expected).sum()
    assert abs(chi_square - 39) < 5 * np.sqrt(2 * 39)
    seen = np.histogram(np.arctan2(points[:, 1], points[:, 0]), edges)[0]
    assert abs(((seen - 1000) ** 2 / 1000).sum() - 39) < 5 * np.sqrt(2 * 39)
    assert np.abs(normals[:, 2] - np.sin(v)).max() < 1e-12


def test_the_mesh_converges_with_second_order():
    exact = 2 * np.pi**2 * 0.4**2
    errors = [exact - implicit(placed(torus(1.0, 0.4)), step, refine=False).mesh.volume for step in (0.1, 0.05, 0.025)]
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx([4, 4], rel=0.12)


def test_symmetric_shapes_on_symmetric_grids_are_manifold():
    """Corners and faces of this box would coincide with grid points."""
    for step in (0.1, 0.125):
        mesh = implicit(placed(box(np.array([1.0, 0.5, 0.25]), 0.25)), step, 2.0).mesh
        assert tuple(count_topology(mesh.vertices, mesh.faces)) == (1, 0, 0, True, 0)
        assert (mesh.area_faces > 0).all() and len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)


def test_no_component_is_missed_and_the_largest_can_be_selected():
    rng = np.random.default_rng(1)
    centres = [(x, y, z) for x in (-1, 0.1, 1) for y in (-1, 1) for z in (-1, 1)]
    node = placed(sphere(0.3))
    for centre in centres:
        node = Union(node, placed(sphere(rng.uniform(0.08, 0.12)), centre), 0.01)
    mesh = implicit(node, 0.03, largest=False).mesh
    assert count_topology(mesh.vertices, mesh.faces).components == 1 + len(centres)
    alone = implicit(node, 0.03).mesh
    assert np.linalg.norm(alone.vertices, axis=1) == pytest.approx(0.3)


@pytest.mark.parametrize("family", ["blobs", "tpms", "smooth_csg"])
def test_the_band_has_the_signs_of_the_dense_grid_at_a_fraction_of_its_cost(family):
    field, low, high, _ = shape(family).surface.body
    step, calls = float(np.linalg.norm(high - low) / 100), []

    class Counted:
        range = staticmethod(field.range)

        @staticmethod
        def value(points):
            calls.append(len(points))
            return field.value(points)

    volume = sample_near_zero(Counted, low, np.ceil((high - low) / step).astype(int), step)
    grid = low + step * np.stack(np.meshgrid(*map(np.arange, volume.shape), indexing="ij"), -1).reshape(-1, 3)
    rows = np.random.default_rng(0).choice(len(grid), 60_000, replace=False)
    assert ((volume.ravel()[rows] < 0) == (field.value(grid[rows]) < 0)).all()
    assert sum(calls) < 0.55 * volume.size


def test_a_grid_too_coarse_is_refused():
    with pytest.raises(ValueError, match="step: expected a grid"):
        _ = implicit(placed(sphere(0.01), (0.31, 0.17, 0.05)), 0.4).mesh


# -- functions ---------------------------------------------------------------------------------------------------------


def check_gradient(gradient, points, tolerance):
    """Checks a gradient against central differences along the axes."""
    value, exact = gradient(points)
    h = 1e-5
    for axis in range(3):
        ahead, behind = (gradient(points + sign * h * np.eye(3)[axis])[0] for sign in (1, -1))
        assert np.abs((ahead - behind) / (2 * h) - exact[:, axis]).max() < tolerance
    return value, exact


PRIMITIVES = {
    "sphere": sphere(0.7),
    "box": box(np.array([0.8, 0.5, 0.3]), 0.1),
    "cylinder": cylinder(0.6, 0.5, 0.1),
    "torus": torus(0.8, 0.2),
    "capsule": capsule(0.5, 0.3),
    "round_cone": round_cone(0.8, 0.4, 0.15),
}


@pytest.mark.parametrize("name", PRIMITIVES)
def test_a_primitive_is_a_distance_with_its_gradient(name):
    node = placed(PRIMITIVES[name], (0.1, -0.2, 0.05), rotation(3))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, size=(3000, 3))
    value, _ = node.gradient(points)
    outside = points[value > 0.01]
    _, exact = check_gradient(node.gradient, outside, 1e-4)
    assert np.linalg.norm(exact, axis=1) == pytest.approx(1)
    # The foot point along the gradient lies on the surface, and no point of the mesh is nearer.
    distance = value[value > 0.01]
    assert np.abs(node.gradient(outside - distance[:, None] * exact)[0]).max() < 1e-12
    nearest = cKDTree(implicit(node, 0.03, 1.5, refine=False).mesh.vertices).query(outside)[0]
    assert (distance <= nearest + 1e-12).all() and (nearest - distance).max() < 0.012


def test_smooth_minima_blend_twice_differentiably():
    a, gradient = np.linspace(-1, 1, 2001), np.ones((2001, 3))
    value, slope = smooth_min(a, gradient, np.zeros(2001), 0 * gradient, 0.4)
    beyond = np.abs(a) >= 0.4
    assert (value[beyond] == np.minimum(a, 0)[beyond]).all()
    assert value.min() == -1 and value[1000] == pytest.approx(-0.4 / 6)
    assert np.abs(np.gradient(value, a) - slope[:, 0])[1:-1].max() < 2e-3
    assert np.abs(np.diff(slope[:, 0], 2)).max() < 2.1 * 1e-3**2 * 2 / 0.4**2  # no jump of the second derivative
    high, _ = smooth_max(a, gradient, np.zeros(2001), 0 * gradient, 0.4)
    assert high == pytest.approx(-smooth_min(-a, gradient, np.zeros(2001), gradient, 0.4)[0])


@pytest.mark.parametrize(("family", "index"), IMPLICIT)
def test_gradients_match_finite_differences_near_the_surface(family, index):
    """Gradients of the exact function, also in blends and rims; its bounds hold for points in the ball."""
    surface = shape(family, index).surface
    points, _ = surface.sample(1000, generator(0))
    rng = np.random.default_rng(0)
    points = points + 0.002 * rng.normal(size=points.shape)
    field = surface.body.field
    value, gradient = field.gradient(points)
    check_gradient(field.gradient, points, 1e-4 * max(1.0, float(np.linalg.norm(gradient, axis=1).max())) * 20)
    assert field.value(points) == pytest.approx(value, abs=1e-12)  # the summed balls depend on neighbouring points
    low, high = field.range(points, 0.05)
    offsets = rng.normal(size=points.shape)
    other = field.value(points + 0.05 * offsets / np.linalg.norm(offsets, axis=1, keepdims=True))
    assert (low <= other + 1e-12).all() and (other <= high + 1e-12).all()


# -- every family ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("family", "index"), ALL)
def test_a_shape_has_the_stated_properties(family, index):
    made = shape(family, index)
    mesh = made.mesh
    counts = count_topology(mesh.vertices, mesh.faces)
    rings = counts.components if family == "knots" else 1
    assert counts.watertight and counts.components == rings and counts.genus == made.info.get("genus", counts.genus)
    assert mesh.is_winding_consistent and mesh.volume > 0
    assert 10_000 <= len(mesh.vertices) <= 105_000
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert mesh.area_faces.min() > 1e-6 * mesh.area_faces.mean()
    assert made.is_exact and made.id.startswith(f"{family}-test-{index:03d}")
    # Vertices lie on the surface, and it is smooth: its normals are close to those of the faces.
    foot, normals = made.surface.closest(mesh.vertices[::30])
    assert np.abs(foot - mesh.vertices[::30]).max() < 1e-10 * diagonal(mesh)
    normals = made.surface.closest(mesh.triangles_center[::50])[1]
    along = np.einsum("ni,ni->n", mesh.face_normals[::50], normals)
    assert np.mean(along > 0.9) > 0.995 and np.median(along) > 0.998


@pytest.mark.parametrize(("family", "index"), ONE)
def test_foot_points_agree_with_brute_force(family, index):
    made = shape(family, index)
    size = diagonal(made.mesh)
    on, outward = made.surface.sample(30_000, generator(3))
    rng = np.random.default_rng(0)
    points = on[:1200] + rng.normal(size=(1200, 3)) * np.repeat([0.0005, 0.01, 0.1], 400)[:, None] * size
    closest, normals = made.surface.closest(points)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    distance = np.linalg.norm(points - closest, axis=1)
    assert np.linalg.norm(np.cross(points - closest, normals), axis=1).max() < 1e-8 * size
    brute, _ = cKDTree(np.vstack([on, made.mesh.vertices])).query(points)
    assert (distance <= brute + 1e-9 * size).mean() > 0.998  # rarely, another part is nearer by a tiny amount
    assert (distance - brute).max() < 2e-4 * size
    assert (brute**2 - distance**2).max() < (0.02 * size) ** 2
    # Points on the surface are their own foot points, with the same normals.
    again, found = made.surface.closest(on[:2000])
    assert np.abs(again - on[:2000]).max() < 1e-9 * size
    assert np.abs(found - outward[:2000]).max() < 1e-6


@pytest.mark.parametrize(("family", "index"), ONE)
def test_samples_are_uniform_by_area(family, index):
    """Chi-square over the cells of a coarse set of points, whose areas come from the fine mesh."""
    made = shape(family, index)
    mesh = made.mesh
    cells = cKDTree(made.surface.sample(150, generator(8))[0])
    expected = np.bincount(cells.query(mesh.triangles_center)[1], mesh.area_faces, 150)
    expected *= 20_000 / expected.sum()
    points, normals = made.surface.sample(20_000, generator(9))
    seen = np.bincount(cells.query(points)[1], minlength=150)
    chi_square = ((seen - expected) ** 2 / expected).sum()
    # The boundary of a cell cuts through faces, and tight folds have more area than their faces.
    assert chi_square < 149 + 8 * np.sqrt(2 * 149)
    # Normals point outward: a little along them leaves the body.
    tiny = 1e-4 * diagonal(mesh)
    nearest, found = made.surface.closest(points[:500] + tiny * normals[:500])
    assert np.einsum("ni,ni->n", found, normals[:500]).min() > 0.99
    assert np.abs(nearest - points[:500]).max() < 1e-8


@pytest.mark.parametrize("family", FAMILIES)
def test_shapes_are_repeatable_and_splits_are_disjoint(family):

    def made(split):
        return even(next(islice(FAMILIES[family]().shapes(split), 1, None)))

    first, second = shape(family, 1), made("test")
    assert first.mesh.vertices.tobytes() == second.mesh.vertices.tobytes()
    assert np.array_equal(first.mesh.faces, second.mesh.faces)
    assert all(
        a.tobytes() == b.tobytes()
        for a, b in zip(*(one.surface.sample(500, generator(1)) for one in (first, second)), strict=True)
    )
    ours, theirs = first.surface, made("train").surface
    places = np.random.default_rng(0).uniform(-1, 1, size=(100, 3))
    if family == "knots":
        assert theirs.mesh.vertices[:100].tobytes() != ours.mesh.vertices[:100].tobytes()
    else:
        assert theirs.body.field.value(places).tobytes() != ours.body.field.value(places).tobytes()


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_is_built_before_it_is_needed(family):
    made = next(FAMILIES[family]().shapes("test"))
    assert callable(made._mesh) and "mesh" not in vars(made._surface) and "body" not in vars(made._surface)


@pytest.mark.parametrize(
    ("family", "parameters", "name"),
    [
        ("blobs", {"balls_low": 0}, "balls_low"),
        ("blobs", {"balls_high": 1000}, "balls_high"),
        ("blobs", {"looseness_low": 1.0, "looseness_high": 0.5}, "looseness_low"),
        ("tpms", {"kind": "cube"}, "kind"),
        ("tpms", {"form": "solids"}, "form"),
        ("knots", {"kind": "granny"}, "kind"),
        ("knots", {"gap_low": 0.0}, "gap_low"),
        ("knots", {"gap_high": 0.5}, "gap_high"),
        ("smooth_csg", {"kind": "car"}, "kind"),
        ("smooth_csg", {"blend_low": 0.0}, "blend_low"),
        ("branches", {"kind": "oak"}, "kind"),
        ("branches", {"tip": 0.001}, "tip"),
        ("branches", {"exponent_low": 1.0}, "exponent_low"),
        ("branches", {"goals": 2}, "goals"),
    ],
)
def test_wrong_parameters_are_named(family, parameters, name):
    with pytest.raises(ValueError, match=rf"^{name}: expected"):
        FAMILIES[family](**parameters)


@pytest.mark.parametrize(
    ("family", "parameters"),
    [
        ("blobs", {"balls_low": 1, "balls_high": 1}),
        ("branches", {"tip": 0.04, "goals": 20}),
        ("smooth_csg", {"kind": "organic", "blend_low": 2.0, "blend_high": 2.0}),
        ("knots", {"kind": "borromean", "gap_low": 0.0005, "gap_high": 0.0005}),
    ],
)
def test_parameters_at_their_limits(family, parameters):
    made = next(FAMILIES[family](**parameters).shapes("train"))
    if family in ("blobs", "smooth_csg"):
        even(made)
    counts = count_topology(made.mesh.vertices, made.mesh.faces)
    assert counts.watertight and counts.genus == made.info.get("genus", counts.genus)


# -- single families ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", WINDOWS, ids="-".join)
def test_the_genus_holds_over_each_window_of_sizes(variant):
    """At one end of each window, with the thinnest or the thickest sheet, the lowest or the highest level."""
    for window in WINDOWS[variant]:
        cells, share = (window.fewest, 1.0) if window.genus % 2 else (window.most, 0.0)
        body = _body(*variant, window.centre, cells, share, rotation(1))
        surface = ImplicitSurface(lambda body=body: body)
        vertices, faces = _largest_component(*surface._march(np.array([0.382, 0.236, 0.146])))
        assert count_topology(vertices, faces).genus == window.genus


@pytest.mark.parametrize("key", SYMMETRY, ids=lambda key: f"{key[0]}-{key[1]}-{key[2]:.1f}")
def test_the_symmetry_is_as_stated(key):
    kind, form, centre = key
    field = ClippedLevel(kind, 1.7, centre, np.eye(3), 0.1, sheet=form == "sheet")
    points = np.random.default_rng(0).uniform(-0.9, 0.9, size=(200, 3))
    moves = {
        "rotation 3": points[:, [1, 2, 0]],
        "inversion": -points,
        "mirrors": points[:, [1, 0, 2]],
        "octahedral": points[:, [1, 0, 2]] * [-1, 1, 1],
    }
    for word, moved in moves.items():
        same = np.allclose(field.value(moved), field.value(points), atol=1e-12)
        stated = word in SYMMETRY[key] or SYMMETRY[key] == "octahedral"
        assert same == stated, word


@pytest.mark.parametrize("index", [0, 2, 4])
def test_sheets_are_as_thin_as_stated(index):
    """From the surface inward along the normal to the change of sign of the function."""
    made = shape("tpms", index)
    points, normals = made.surface.sample(1000, generator(0))
    stated = made.info["thickness"] * diagonal(made.mesh)
    depth = np.linspace(0.3, 1.5, 121) * stated
    lines = points[:, None] - depth[:, None] * normals[:, None]
    inside = made.surface.body.field.value(lines.reshape(-1, 3)).reshape(1000, -1) < 0
    rim = np.linalg.norm(points, axis=1) > 0.93
    assert inside[~rim, : np.searchsorted(depth, 0.94 * stated)].all()
    assert not inside[~rim, : np.searchsorted(depth, 1.06 * stated)].all()


@pytest.mark.parametrize("index", range(6))
def test_the_gap_of_a_knot(index):
    """The shortest ray along a normal from the surface to another part is as long as the gap."""
    import open3d as o3d

    made = shape("knots", index)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(np.asarray(made.mesh.vertices, np.float32), np.asarray(made.mesh.faces, np.uint32))
    points, normals = made.surface.sample(60_000, generator(0))
    size, radius = diagonal(made.mesh), made.surface.radius
    rays = np.hstack([points + 1e-3 * radius * normals, normals]).astype(np.float32)
    first = float(scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy().min() / size)
    assert made.info["gap"] - 1e-3 < first < made.info["gap"] + 4e-3
    assert 2 * radius / size == pytest.approx(made.info["thickness"], rel=2e-3)
    assert made.info["gap"] > 0.001
    radius_of_frame = np.linalg.norm(made.mesh.vertices - made.mesh.bounds.mean(axis=0), axis=1).max()
    if made.info["gap"] * size > 1.1 * GAP * radius_of_frame:
        assert "near_contact" not in made.traits.tags
    if made.info["gap"] * size < 0.5 * GAP * radius_of_frame:
        assert "near_contact" in made.traits.tags
    assert all(radius * curve.curvature < 0.81 for curve in made.surface.curves)


def test_nearest_approaches_in_closed_form():
    shifted = circle().moved(np.eye(3), np.array([2.5, 0, 0]))
    assert nearest_approach([circle(), shifted]) == pytest.approx(0.5)
    # Linked rings: the nearest points lie on the line through their centres.
    turned = circle().moved(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]), np.array([1.4, 0, 0]))
    assert nearest_approach([circle(), turned]) == pytest.approx(0.6)


def test_a_tube_around_a_circle_is_the_torus():
    for turn in (False, True):  # the closed form of circles, and Newton's method
        curve = circle() if not turn else ellipse(1.0, 1.0 + 1e-12)
        tube = TubeSurface(lambda curve=curve: ([curve], 0.4))
        points = np.random.default_rng(0).uniform(-1.5, 1.5, size=(3000, 3))
        closest, normals = tube.closest(points)
        assert np.linalg.norm(points - closest, axis=1) == pytest.approx(
            np.abs(torus_distance(points, 1, 0.4)), abs=1e-10
        )
        assert tube.mesh.area == pytest.approx(4 * np.pi**2 * 0.4, rel=3e-3)
    normals = tube.closest(np.array([[1.0, 0, 0]]))[1]  # on the curve all sides are equally near
    assert np.linalg.norm(normals) == pytest.approx(1) and abs(normals[0, 1]) < 1e-12


def test_torus_knots_match_the_formula():
    s = np.linspace(0, 6, 50)
    for p, q in ((2, 3), (3, 2)):
        around = 1 + 0.4 * np.cos(q * s)
        expected = np.stack([around * np.cos(p * s), around * np.sin(p * s), 1.2 * 0.4 * np.sin(q * s)], axis=1)
        assert np.abs(torus_knot(p, q, 0.4, bulge=1.2).at(s)[0] - expected).max() < 1e-14


def test_radii_follow_murrays_law():
    parent = np.array([-1, 0, 1, 1, 3, 3])
    radius = murray_radii(parent, 0.1, 3.0)
    assert radius == pytest.approx(0.1 * np.array([3, 3, 1, 2, 1, 1]) ** (1 / 3))


def test_twigs_that_return_to_the_tree_are_cut():
    """A ring that almost closes is cut; a straight twig is not."""
    angle = np.linspace(0, 2 * np.pi, 40)[:-1]
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    skeleton = Skeleton(points, np.arange(-1, 38), np.linspace(0.1, 0.05, 39))
    left = separate(skeleton, 1.6)
    assert 30 < len(left.points) < 39 and (left.parent == np.arange(-1, len(left.points) - 1)).all()
    assert np.linalg.norm(left.points[-1] - points[0]) > 1.6 * (left.radius[-1] + 0.1)
    straight = Skeleton(np.linspace([0, 0, 0], [1, 0, 0], 20), np.arange(-1, 19), np.full(20, 0.08))
    assert len(separate(straight, 1.6).points) == 20


def test_a_straight_branch_has_its_radius():
    from bench.datasets.branches import REACH, _strung
    from bench.datasets.surfaces.balls import BallField

    skeleton = Skeleton(np.linspace([0, 0, 0], [0, 0, 1.13], 18), np.arange(-1, 17), np.full(18, 0.05))
    centres, radius, spacing = _strung(skeleton)
    field = BallField(centres, REACH * radius, spacing / (32 / 35 * (1 - 1 / REACH**2) ** 3.5 * REACH))
    z = np.linspace(0.2, 0.9, 500)
    for angle in (0.0, 2.0):
        side = np.stack([0.05 * np.cos(angle) + 0 * z, 0.05 * np.sin(angle) + 0 * z, z], axis=1)
        value, gradient = field.gradient(side)
        assert np.abs(value / np.linalg.norm(gradient, axis=1)).max() < 0.003 * 0.05


def test_plants_have_thin_twigs():
    made = shape("branches", 0)
    assert diagonal(made.mesh) > 1.5 and 2 * made.info["tip"] < 0.03 * diagonal(made.mesh)
    assert "thin" in made.traits.tags


def test_all_rings_of_a_chain_are_apart_by_the_gap():
    """Even from the next ring but one, whose plane is nearly the same."""
    for made in islice(Knots(kind="chain").shapes("test"), 8):
        around = np.linspace(0, 2 * np.pi, 1000)
        rings = [curve.at(around)[0] for curve in made.surface.curves]
        apart = [cKDTree(a).query(b)[0].min() for k, a in enumerate(rings) for b in rings[:k]]
        gap = made.info["gap"] * (np.linalg.norm(np.ptp(np.vstack(rings), axis=0) + 2 * made.surface.radius))
        assert min(apart) - 2 * made.surface.radius == pytest.approx(gap, abs=2e-3)
        assert made.surface.radius > 0.079


def test_a_difference_has_the_volume_of_its_formula():
    """A ball with a bore: a ring of genus 1, whose volume is nearly that of the napkin ring."""
    ring = implicit(Difference(placed(sphere(1.0)), placed(capsule(3.0, 0.6)), 0.002), 0.04, refine=False).mesh
    assert count_topology(ring.vertices, ring.faces).genus == 1
    assert ring.volume == pytest.approx(np.pi / 6 * (2 * 0.8) ** 3, rel=0.01)
