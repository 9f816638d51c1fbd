"""Statues: forward differentiation, their parts, exactness, and detail over three decades of scale."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from functools import cache
from itertools import islice

import numpy as np
import pytest
from even_meshes import even
from scipy.sparse import coo_array, diags_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from bench import generator
from bench.datasets.fbm import Fbm
from bench.datasets.statues import KINDS, Statues
from bench.datasets.surfaces import duals, sculpting
from bench.datasets.surfaces.duals import Dual
from bench.datasets.surfaces.gradient_noise import GradientNoise
from bench.datasets.surfaces.jets import Jet
from bench.geometry.topology import count_topology

COARSE, COARSEST = 60.0, 40.0  # edges per radius: half a second per mesh, and the minimum


@cache
def shape(kind: str, index: int = 0, split: str = "test", resolution: float = COARSE, detail: float = 1.0):
    family = Statues(kind=kind, resolution=resolution, detail=detail)
    return next(islice(family.shapes(split), index, None))


def diagonal(mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def differences(form, points, h=1e-6):
    """Central differences (3, n) of a formula."""
    found = []
    for axis in np.eye(3):
        ahead, behind = (form(Dual.coordinates(points + s * h * axis, gradients=False)).v for s in (1, -1))
        found.append((ahead - behind) / (2 * h))
    return np.array(found)


# -- building blocks ---------------------------------------------------------------------------------------------------

FORMULAS = {
    "arithmetic": lambda p: (2 - p[0]) * p[1] / (p[2].square() + 1) + 3 / (p[0].square() + 2) - p[1] / 4,
    "waves": lambda p: duals.sin(p[0] * 2) * duals.cos(p[1]) + duals.atan2(p[1], p[0] + 3),
    "steps": lambda p: duals.ease(p[0]) * duals.soft_abs(p[1], 0.1) + duals.clipped(p[2], -0.5, 0.5),
    "lengths": lambda p: duals.length(*p) + duals.sqrt(p[0].square() + 1),
    "minima": lambda p: duals.smooth_min(p[0], p[1], 0.4) + duals.smooth_max(p[1] * 2, p[2], 0.3),
    "ellipsoid": lambda p: sculpting.ellipsoid(p, (0.1, 0, 0), (0.5, 0.8, 1.0), sculpting.turn_z(0.4)),
    "limb": lambda p: sculpting.limb(p, (0, 0, 0), (0.5, 0.3, 0.8), 0.3, 0.1),
    "box": lambda p: sculpting.box(p, (0.5, 0.6, 0.7), 0.1),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_derivatives_of_duals_match_finite_differences(name):
    points = np.random.default_rng(0).uniform(-1.2, 1.2, size=(3000, 3))
    exact = FORMULAS[name](Dual.coordinates(points, gradients=True))
    plain = FORMULAS[name](Dual.coordinates(points, gradients=False))
    assert np.array_equal(exact.v, plain.v) and plain.g is None
    wrong = np.abs(differences(FORMULAS[name], points) - exact.g).max(axis=0)
    assert np.quantile(wrong, 0.998) < 1e-7  # except at the kinks of a clamp and inside a box


def test_noise_of_duals_matches_jets_and_has_its_gradient():
    noise = GradientNoise(np.random.default_rng(0))
    points = np.random.default_rng(1).uniform(-20, 300, size=(4000, 3))
    found = noise.at(Dual.coordinates(points, gradients=True))
    assert np.abs(found.v - noise(Jet(points.T[None])).value).max() < 1e-14
    assert np.abs(differences(noise.at, points) - found.g).max() < 1e-7


def test_bounding_balls_of_parts_do_not_change_the_result():
    """A union or difference with a part in a bounding ball equals the one without the ball."""
    points = np.random.default_rng(2).uniform(-1.5, 1.5, size=(6000, 3))
    at = Dual.coordinates(points, gradients=True)
    body, part = sculpting.ball(at, (0, 0, 0), 0.8), lambda p: sculpting.ball(p, (0.7, 0, 0), 0.3)
    for found, expected in (
        (sculpting.add(body, at, (0.7, 0, 0), 0.3, 0.2, part), duals.smooth_min(body, part(at), 0.2)),
        (sculpting.cut(body, at, (0.7, 0, 0), 0.3, 0.2, part), duals.smooth_max(body, -part(at), 0.2)),
    ):
        assert np.abs(found.v - expected.v).max() < 1e-12 and np.abs(found.g - expected.g).max() < 1e-12


# -- the family --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("index", "resolution"), [(0, COARSE), (1, COARSEST)])
def test_a_statue_is_one_closed_body_of_genus_0(kind, index, resolution):
    made = shape(kind, index, "test", resolution)
    mesh = made.mesh
    counts = count_topology(mesh.vertices, mesh.faces)
    assert counts.watertight and counts.components == 1 and counts.genus == made.info["genus"] == 0
    assert mesh.is_winding_consistent and mesh.volume > 0
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert mesh.area_faces.min() > 1e-6 * mesh.area_faces.mean()
    assert np.ptp(mesh.vertices, axis=0).argmax() == 2  # upright
    value, gradient = made.surface.body.field.gradient(mesh.vertices)
    assert np.abs(value / np.linalg.norm(gradient, axis=1)).max() < 1e-10 * diagonal(mesh)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_match_finite_differences_and_bounds_hold(kind):
    field, mesh = shape(kind).surface.body.field, shape(kind).mesh
    rng = np.random.default_rng(0)
    points = mesh.vertices[rng.choice(len(mesh.vertices), 1000)] + 0.002 * rng.normal(size=(1000, 3))
    value, gradient = field.gradient(points)
    assert np.array_equal(value, field.value(points))
    wrong = np.zeros(1000)
    for axis in range(3):
        ahead, behind = (field.value(points + s * 1e-6 * np.eye(3)[axis]) for s in (1, -1))
        wrong = np.maximum(wrong, np.abs((ahead - behind) / 2e-6 - gradient[:, axis]))
    assert np.quantile(wrong, 0.995) < 1e-4
    low, high = field.range(points, 0.05)
    offsets = rng.normal(size=points.shape)
    other = field.value(points + 0.05 * offsets / np.linalg.norm(offsets, axis=1, keepdims=True))
    assert ((low <= other) & (other <= high)).mean() > 0.998  # except on rare steep flanks


@pytest.mark.parametrize("kind", KINDS)
def test_foot_points_agree_with_brute_force(kind):
    made = shape(kind)
    size = diagonal(made.mesh)
    on, outward = made.surface.sample(2000, generator(3))
    rng = np.random.default_rng(0)
    points = on[:180] + rng.normal(size=(180, 3)) * np.repeat([0.0005, 0.01, 0.1], 60)[:, None] * size
    # In one call, whose time hardly depends on the number of points: near and far points, and some on the surface.
    both, found = made.surface.closest(np.concatenate([points, on[:150]]))
    closest, normals, again, found = both[:180], found[:180], both[180:], found[180:]
    distance = np.linalg.norm(points - closest, axis=1)
    brute, _ = cKDTree(np.vstack([on, made.mesh.vertices])).query(points)
    assert (distance <= brute + 1e-9 * size).mean() > 0.97  # fine detail has many foot points that are nearly as close
    assert (distance - brute).max() < 1e-3 * size
    assert np.quantile(np.linalg.norm(np.cross(points - closest, normals), axis=1), 0.98) < 1e-7 * size
    assert np.quantile(np.abs(again - on[:150]).max(axis=1), 0.99) < 1e-9 * size
    assert np.median(np.abs(found - outward[:150]).max(axis=1)) < 1e-7


def test_kinds_alternate_and_shapes_differ_between_indices_and_splits():
    first = list(islice(Statues().shapes("test"), 4))
    assert [s.info["kind"] for s in first] == [*KINDS, next(iter(KINDS))]
    places = np.random.default_rng(0).uniform(-1, 1, size=(2000, 3))
    values = [
        next(islice(Statues(kind=kind).shapes(split), index, None)).surface.body.field.value(places).tobytes()
        for kind in KINDS for split in ("test", "train") for index in (0, 1)
    ]  # fmt: skip
    assert len(set(values)) == len(values)


def test_another_process_makes_the_same_statue():
    code = (
        "import hashlib; from itertools import islice; from bench.datasets.statues import Statues;"
        f"mesh = next(islice(Statues(kind='bust', resolution={COARSEST}).shapes('test'), 1, None)).mesh;"
        "print(hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest())"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    mesh = shape("bust", 1, "test", COARSEST).mesh
    assert told == hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()


def test_nothing_is_built_before_it_is_needed():
    made = next(Statues().shapes("test"))
    assert "mesh" not in vars(made._surface) and "body" not in vars(made._surface)


@pytest.mark.parametrize("parameters", [{"kind": "horse"}, {"detail": -1.0}, {"detail": 2.0}, {"resolution": 5.0}])
def test_bad_parameters_are_named(parameters):
    with pytest.raises(ValueError, match=f"^{next(iter(parameters))}: expected"):
        Statues(**parameters)


# -- detail ------------------------------------------------------------------------------------------------------------


def smoothed(mesh, scale: float) -> np.ndarray:
    """Vertices (v, 3) after implicit fairing: waves much longer than ``scale`` stay, shorter ones go."""
    V, F = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    ends = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]])
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(V),) * 2).tocsr()
    edge = np.linalg.norm(V[ends[:, 0]] - V[ends[:, 1]], axis=1).mean()
    # One step of the averaging operator diffuses by a quarter of the squared edge length.
    laplacian = diags_array(1 / graph.sum(axis=1)) @ graph - eye_array(len(V))
    return splu((eye_array(len(V)) - (4 * (scale / edge) ** 2 / 4) * laplacian).tocsc()).solve(V)


def removed(mesh, scale: float) -> np.ndarray:
    """How far smoothing at ``scale`` (of the radius) moves each vertex along the normal, relative to the radius."""
    radius = diagonal(mesh) / 2
    moves = np.asarray(mesh.vertices) - smoothed(mesh, scale * radius)
    return np.einsum("vi,vi->v", moves, mesh.vertex_normals) / radius


@cache
def detail_at(scale: float, kind: str, detail: float = 1.0) -> float:
    """The detail that smoothing removes, as an RMS."""
    return float(np.sqrt((removed(shape(kind, detail=detail).mesh, scale) ** 2).mean()))


@pytest.mark.parametrize("kind", KINDS)
def test_there_is_detail_at_three_decades(kind):
    """Smoothing removes detail at each scale, at the finer ones more than from the bare forms."""
    for scale, least in ((0.1, 8e-3), (0.01, 6e-4), (0.003, 6.3e-5)):
        rms = detail_at(scale, kind)
        assert rms > least, (scale, rms)


def anisotropy(mesh, rows, patch: float, scale: float = 0.01) -> float:
    """1 - (smaller over larger eigenvalue) of the mean structure tensor of the detail, over patches: 0 if isotropic.

    The tensor of a patch (its size in radii) is that of the tangential gradients of the removed displacement.
    """
    V, F = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    height = removed(mesh, scale)
    n = np.asarray(mesh.face_normals)
    opposite = [V[F[:, (k + 2) % 3]] - V[F[:, (k + 1) % 3]] for k in range(3)]
    area = np.maximum(mesh.area_faces, 1e-300)
    slope = sum(height[F[:, k], None] * np.cross(n, opposite[k]) for k in range(3)) / (2 * area[:, None])
    radius = diagonal(mesh) / 2
    tree = cKDTree(mesh.triangles_center)
    found = []
    for centre in mesh.triangles_center[rows]:
        near = tree.query_ball_point(centre, patch * radius)
        tensor = (slope[near].T * area[near]) @ slope[near]
        low, high = np.linalg.eigvalsh(tensor)[1:]
        found.append(1 - low / high)
    return float(np.mean(found))


def test_hair_is_anisotropic_and_fractal_noise_is_not():
    mesh = shape("bust", 2).mesh  # hair in waves from the forehead to a bun
    centres = mesh.triangles_center
    rng = np.random.default_rng(0)
    hair = np.flatnonzero((centres[:, 2] > 0.35) & (centres[:, 1] > 0.3))  # the back of the skull
    rough = even(next(Fbm(base="sphere", hurst_low=0.3, hurst_high=0.3, cells=64).shapes("test"))).mesh
    # A patch holds about the same number of the finest cells of noise: 0.02 radii for hair, 0.078 for the ball.
    directed = anisotropy(mesh, rng.choice(hair, 200), 0.02, 0.02)
    undirected = anisotropy(rough, rng.choice(len(rough.faces), 200), 0.08, 0.02)
    assert directed > 0.55 and directed > undirected + 0.25, (directed, undirected)


@pytest.mark.parametrize("kind", KINDS)
def test_detail_can_be_left_out(kind):
    assert detail_at(0.01, kind, 0.0) < 0.9 * detail_at(0.01, kind)
