"""Bumps: the exact surface against independent libraries, identities and brute force."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from functools import cache
from itertools import islice

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.special import sph_harm_y_all

from bench import generator
from bench.datasets.bumps import Bumps
from bench.datasets.surfaces.harmonics import HarmonicSum
from bench.datasets.surfaces.star_surface import StarSurface, icosphere


def directions(count: int, seed: int = 0) -> np.ndarray:
    u = np.random.default_rng(seed).normal(size=(count, 3))
    if seed == 0:
        u[:2] = [[0, 0, 1], [0, 0, -1]]  # the poles
    return u / np.linalg.norm(u, axis=1, keepdims=True)


@cache  # surfaces cache their trees and bounds
def shape(index: int = 1, split: str = "test", **parameters):
    return next(islice(Bumps(**parameters).shapes(split), index, None))


def sphere(radius: float = 1.0) -> StarSurface:
    return StarSurface(lambda: HarmonicSum(np.array([radius * np.sqrt(4 * np.pi)])))


# -- spherical harmonics -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [0, 1, 2, 7, 16, 40])
def test_the_sum_matches_scipy(degree):
    a = np.random.default_rng(degree).normal(size=(degree + 1) ** 2)
    u = directions(400)
    theta, phi = np.arctan2(np.hypot(u[:, 0], u[:, 1]), u[:, 2]), np.arctan2(u[:, 1], u[:, 0])
    Y = sph_harm_y_all(degree, degree, theta, phi)
    expected = np.zeros(len(u))
    for l in range(degree + 1):  # noqa: E741
        expected += a[l * l + l] * Y[l, 0].real
        for m in range(1, l + 1):
            sign = np.sqrt(2) * (-1) ** m  # scipy has the Condon-Shortley sign
            expected += sign * (a[l * l + l + m] * Y[l, m].real + a[l * l + l - m] * Y[l, m].imag)
    assert np.abs(HarmonicSum(a).value(u) - expected).max() < 1e-13 * (degree + 1) ** 2


@pytest.mark.parametrize("degree", [0, 1, 2, 5, 16])
def test_derivatives_along_great_circles_match_finite_differences(degree):
    f = HarmonicSum(np.random.default_rng(3).normal(size=(degree + 1) ** 2))
    u = directions(300)
    t = np.cross(u, directions(300, 1))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    value, gradient, hessian = f.hessian(u)
    tangent = f.gradient(u)[1]
    h = 1e-3

    def along(s):
        return f.value(np.cos(s) * u + np.sin(s) * t)

    # Fourth-order differences
    first = (along(-2 * h) - 8 * along(-h) + 8 * along(h) - along(2 * h)) / (12 * h)
    second = (-along(-2 * h) + 16 * along(-h) - 30 * value + 16 * along(h) - along(2 * h)) / (12 * h**2)
    exact = np.einsum("ni,nij,nj->n", t, hessian, t) - (gradient * u).sum(axis=1)
    scale = max(1, degree) ** 2
    assert np.abs(first - (tangent * t).sum(axis=1)).max() < 1e-7 * scale
    assert np.abs(second - exact).max() < 1e-6 * scale**1.5
    assert np.abs((tangent * u).sum(axis=1)).max() < 1e-11


def test_coefficients_must_fill_a_degree():
    with pytest.raises(ValueError, match=r"\(L \+ 1\)\^2"):
        HarmonicSum(np.zeros(5))


# -- the surface -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [1, 4])
def test_samples_lie_on_the_surface(index):
    surface = shape(index).surface
    points, normals = surface.sample(5000, generator(0))
    r = np.linalg.norm(points, axis=1)
    assert points.shape == normals.shape == (5000, 3)
    assert np.abs(surface.radius.value(points / r[:, None]) - r).max() < 1e-12
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-14


def test_normals_are_orthogonal_to_the_surface_and_point_outward():
    surface = shape(1).surface
    u = directions(500)
    points, normals = surface.at(u)
    h = 1e-4
    for t in (np.cross(u, directions(500, 5)), np.cross(u, directions(500, 6))):
        t /= np.linalg.norm(t, axis=1, keepdims=True)
        tangent = (surface.at(np.cos(h) * u + np.sin(h) * t)[0] - surface.at(np.cos(h) * u - np.sin(h) * t)[0]) / (
            2 * h
        )
        assert np.abs((tangent * normals).sum(axis=1)).max() < 1e-5
    assert ((normals * u).sum(axis=1) > 0).all()  # a star-shaped body


def test_samples_are_uniform_by_area():
    """Chi-square over the cells of an icosphere, whose exact areas come from quadrature on a finer one."""
    surface = shape(1).surface
    fine, faces = icosphere(5)
    cells = icosphere(2)[0]
    centres = fine[faces].mean(axis=1)
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    a, b, c = (fine[faces[:, i]] for i in range(3))
    solid_angle = 2 * np.arctan2(
        np.einsum("ni,ni->n", a, np.cross(b, c)), 1 + (a * b).sum(1) + (b * c).sum(1) + (c * a).sum(1)
    )
    assert solid_angle.sum() == pytest.approx(4 * np.pi)
    r, gradient = surface.radius.gradient(centres)
    area = solid_angle * r * np.sqrt(r**2 + (gradient**2).sum(axis=1))
    tree = cKDTree(cells)
    expected = np.bincount(tree.query(centres)[1], area, len(cells))
    points, _ = surface.sample(30_000, generator(2))
    seen = np.bincount(tree.query(points / np.linalg.norm(points, axis=1, keepdims=True))[1], minlength=len(cells))
    expected *= 30_000 / expected.sum()
    chi_square = ((seen - expected) ** 2 / expected).sum()
    freedom = len(cells) - 1
    # Centres on the boundary of a cell blur its area a little; six deviations still reveal any real bias.
    assert abs(chi_square - freedom) < 6 * np.sqrt(2 * freedom)
    uniform_on_sphere = np.full(len(cells), 30_000 / len(cells))
    assert ((seen - uniform_on_sphere) ** 2 / uniform_on_sphere).sum() > 5 * freedom  # so the test can detect a bias


def test_the_bound_of_rejection_sampling_holds():
    for index in range(3):
        surface = shape(index).surface
        r, gradient = surface.radius.gradient(directions(50_000, 9))
        largest = (r * np.sqrt(r**2 + (gradient**2).sum(axis=1))).max()
        assert largest <= surface._area_elements[0] <= 1.2 * largest


@pytest.mark.parametrize("index", [1, 2])
def test_foot_points_agree_with_brute_force(index):
    surface = shape(index).surface
    rng = np.random.default_rng(0)
    on, _ = surface.sample(300, rng)
    points = on + rng.normal(size=on.shape) * np.repeat([0.001, 0.03, 0.3], 100)[:, None]
    closest, normals = surface.closest(points)
    # On the surface, and the connecting line is normal to it
    r = np.linalg.norm(closest, axis=1)
    assert np.abs(surface.radius.value(closest / r[:, None]) - r).max() < 1e-12
    assert np.linalg.norm(np.cross(points - closest, normals), axis=1).max() < 1e-10
    # None of the 163,842 vertices of a tessellation is nearer; the nearest is not much farther than the foot point
    brute, _ = cKDTree(surface.mesh(7).vertices).query(points)
    distance = np.linalg.norm(points - closest, axis=1)
    assert (distance <= brute + 1e-12).all()
    assert (brute**2 - distance**2).max() < 4e-4


def test_closest_points_of_the_surface_are_themselves():
    surface = shape(1).surface
    points, normals = surface.sample(2000, generator(1))
    closest, found = surface.closest(points)
    assert np.abs(closest - points).max() < 1e-10
    assert np.abs(found - normals).max() < 1e-8


def test_a_sphere_matches_its_closed_forms():
    ball = sphere(2.0)
    points = directions(500) * np.linspace(0.5, 5, 500)[:, None]
    closest, normals = ball.closest(points)
    assert np.abs(closest - 2 * normals).max() < 1e-12
    assert np.abs(normals - points / np.linalg.norm(points, axis=1, keepdims=True)).max() < 1e-10
    assert np.linalg.norm(ball.closest(np.zeros((1, 3)))[0]) == pytest.approx(2)  # from the centre all are equally near
    assert all(part.shape == (0, 3) for part in ball.closest(np.empty((0, 3))))
    assert all(part.shape == (0, 3) for part in ball.sample(0, generator(0)))


def test_the_mesh_converges_to_the_surface_with_second_order():
    made = shape(4)
    areas = [made.surface.mesh(k).area for k in (3, 4, 5, 6)]
    differences = np.abs(np.diff(areas))
    assert differences[:-1] / differences[1:] == pytest.approx([4, 4], rel=0.1)
    coarse, fine = (made.surface.mesh(k) for k in (4, 5))
    errors = [
        np.linalg.norm(made.surface.closest(m.triangles_center)[0] - m.triangles_center, axis=1).mean()
        for m in (coarse, fine)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)


# -- the dataset -------------------------------------------------------------------------------------------------------


def test_the_default_mesh():
    mesh = shape(0).mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (40_962, 81_920)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert mesh.euler_number == 2
    assert np.linalg.norm(mesh.vertices, axis=1).min() >= 0.25


def test_the_amplitude_is_the_root_mean_square():
    for index in range(4):
        r = shape(index, amplitude=0.1).surface.radius.value(icosphere(5)[0])
        assert np.sqrt(((r - 1) ** 2).mean()) == pytest.approx(0.1, rel=0.01)


def test_the_spectrum_has_its_exponent():
    """Recovered from values only: the mean square of a_lm over many shapes falls as l^-exponent."""
    exponent, degree = 3.0, 12
    dataset = Bumps(degree=degree, exponent_low=exponent, exponent_high=exponent)
    u = directions(800)
    basis = np.column_stack([HarmonicSum(row).value(u) for row in np.eye((degree + 1) ** 2)])
    pseudo_inverse = np.linalg.pinv(basis)
    degrees = np.repeat(np.arange(degree + 1), 2 * np.arange(degree + 1) + 1)
    power = np.zeros(degree + 1)
    for made in islice(dataset.shapes("test"), 40):
        a = pseudo_inverse @ made.surface.radius.value(u)
        power += np.bincount(degrees, a**2) / np.bincount(degrees)
    assert power[1] < 1e-20
    slope = np.polyfit(np.log(np.arange(2, degree + 1)), np.log(power[2:]), 1)[0]
    assert slope == pytest.approx(-exponent, abs=0.25)


def test_a_few_shapes_include_smooth_and_other_ones():
    tags = [made.traits.tags for made in islice(Bumps().shapes("test"), 2)]
    assert tags == [("smooth",), ()]  # 0.3 % of the second one is near an edge


def test_splits_are_disjoint_and_ids_are_file_names():
    train, test = ([*islice(Bumps(subdivisions=2).shapes(split), 5)] for split in ("train", "test"))
    assert [made.id for made in test[:2]] == ["bumps-test-000", "bumps-test-001"]
    vertices = [made.mesh.vertices.tobytes() for made in train + test]
    assert len(set(vertices)) == 10


def test_nothing_is_built_before_it_is_needed():
    made = next(Bumps().shapes("test"))
    assert "radius" not in vars(made.surface)
    assert callable(made._mesh)


SCRIPT = """
import hashlib, sys
from itertools import islice
from bench import generator
from bench.datasets.bumps import Bumps
digest = hashlib.sha256()
for made in islice(Bumps(subdivisions=4).shapes("test"), 3):
    digest.update(made.mesh.vertices.tobytes())
    for part in made.surface.sample(2000, generator(1)):
        digest.update(part.tobytes())
sys.stdout.write(digest.hexdigest())
"""


def test_two_processes_make_the_same_shapes():
    other = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True).stdout
    digest = hashlib.sha256()
    for made in islice(Bumps(subdivisions=4).shapes("test"), 3):
        digest.update(made.mesh.vertices.tobytes())
        for part in made.surface.sample(2000, generator(1)):
            digest.update(part.tobytes())
    assert digest.hexdigest() == other


def test_framing_keeps_the_exact_surface():
    framed, frame = shape(1).framed()
    assert framed.is_exact
    points, normals = framed.surface.sample(500, generator(0))
    closest, found = framed.surface.closest(points + 0.01 * normals)
    assert np.abs(closest - points).max() < 1e-9 and np.abs(found - normals).max() < 1e-7
    assert np.linalg.norm(framed.mesh.vertices, axis=1).max() == pytest.approx(1)


@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"degree": 1}, "degree"),
        ({"exponent_low": 5.0}, "exponent_low"),
        ({"amplitude": -0.1}, "amplitude"),
        ({"amplitude": 2.0}, "amplitude"),
        ({"subdivisions": 20}, "subdivisions"),
    ],
)
def test_bad_parameters_are_named(parameters, name):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        Bumps(**parameters)


def test_no_amplitude_is_the_sphere():
    radii = np.linalg.norm(shape(0, amplitude=0.0, subdivisions=3).mesh.vertices, axis=1)
    assert np.abs(radii - 1).max() < 1e-14
