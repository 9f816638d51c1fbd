"""The mesher of implicit surfaces: exact shapes, nothing missed, nothing computed twice, and helpful errors."""

import time
import tracemalloc

import igl
import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from bench import InvalidOutput, generator
from bench.geometry.topology import count_topology
from bench.methods.implicit.idf import Idf
from bench.methods.learned.meshing.lattice import CORNERS, Lattice
from bench.methods.learned.meshing.marching import COARSE, extract, march
from bench.methods.learned.meshing.narrow_band import REACH, Sampler
from bench.methods.learned.meshing.triangles import NEAREST
from bench.plugins.registry import registry


class Counted:
    """A field that records its points of evaluation."""

    def __init__(self, field):
        self.field, self.asked = field, []

    def __call__(self, points):
        self.asked.append(points.copy())
        return self.field(points)

    @property
    def points(self):
        return np.concatenate(self.asked)


def sphere(points, radius=0.7, centre=(0.05, -0.03, 0.02)):
    return np.linalg.norm(points - np.asarray(centre), axis=1) - radius


def torus(points, radius=0.6, tube=0.25):
    return np.hypot(np.hypot(points[:, 0] - 0.02, points[:, 1] + 0.01) - radius, points[:, 2] - 0.03) - tube


def capsule(points, half=0.85, radius=0.08):
    """A rod along a diagonal, of aspect 1 : 7."""
    along = np.ones(3) / np.sqrt(3)
    middle = np.clip(points @ along, -half, half)
    return np.linalg.norm(points - middle[:, None] * along, axis=1) - radius


def two_balls(points, radius=0.016):
    """Two distant balls, by default between the points of the coarse lattice."""
    one, two = (-0.5 + 1 / COARSE + np.array([(25, 25, 25), (-26, -25, 21)]) * 2 / COARSE).clip(-0.85, 0.85)
    return np.minimum(sphere(points, radius, one), sphere(points, 0.9 * radius, two))


def knot():
    """The exact distance to enough points of the curves to be smooth on the lattice."""
    shape = next(s for s in registry().find("dataset", "knots").cls().shapes("test") if s.info["kind"] == "torus_knot")
    curves = np.vstack([curve.at(np.linspace(0, 2 * np.pi, 2000))[0] for curve in shape.surface.curves])
    scale = 0.95 / np.abs(shape.mesh.vertices).max()
    tree = cKDTree(curves * scale)
    return lambda points: tree.query(points)[0] - scale * shape.surface.radius


def sheet():
    """A thin sheet of a minimal surface; its slope is up to the root of 2, mostly below 1."""
    shape = next(s for s in registry().find("dataset", "tpms").cls(form="sheet").shapes("test"))
    return lambda points: shape.surface.body.field.value(1.15 * points) / 1.15


def lattice_over(samples, turned=True):
    """A lattice over [-1, 1]^3, in general position."""
    axes = np.linalg.qr(generator(3).standard_normal((3, 3)))[0] if turned else np.eye(3)
    return Lattice.over(np.full(3, -1.01), np.full(3, 1.03), axes, samples)


def dense(field, lattice):
    """Vertices and faces from the whole lattice, by libigl."""
    shape = np.array(lattice.cells) + 1
    k, j, i = (c.ravel() for c in np.indices(shape[::-1]))  # the first axis runs fastest
    points = lattice.origin + lattice.spacing * (np.stack([i, j, k], axis=1) @ lattice.axes)
    V, F, _ = igl.marching_cubes(field(points), points, *shape.tolist(), 0.0)
    return V, F


def canonical(faces):
    """Each face starting at its least vertex, sorted."""
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T)]


def assert_same(found, expected, tolerance=1e-8):
    """The same vertices and faces up to their order."""
    (V, F), (W, G) = found, expected
    distance, twin = cKDTree(W).query(V)
    assert len(V) == len(W) == len(np.unique(twin))
    assert distance.max() < tolerance
    assert np.array_equal(canonical(twin[F]), canonical(G))


def assert_closed_and_outward(mesh, field):
    assert count_topology(mesh.vertices, mesh.faces).genus is not None
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.area_faces.min() > 0
    middle, step = mesh.triangles_center, 0.3 * mesh.metadata["spacing"] * mesh.face_normals
    large = mesh.area_faces > 0.02 * mesh.metadata["spacing"] ** 2  # normals of slivers are inaccurate
    assert (field(middle + step) > field(middle - step))[large].all()


@pytest.mark.parametrize("align", ["pca", "axes"])
@pytest.mark.parametrize("field, genus", [(sphere, 0), (torus, 1)])
def test_second_order_convergence(field, genus, align):
    errors, spacings = [], []
    for resolution in (13, 25):
        mesh = extract(field, resolution=resolution, align=align)
        assert_closed_and_outward(mesh, field)
        assert count_topology(mesh.vertices, mesh.faces).genus == genus
        errors.append(np.abs(field(mesh.vertices)).mean())
        spacings.append(mesh.metadata["spacing"])
    order = np.log(errors[0] / errors[1]) / np.log(spacings[0] / spacings[1])
    assert order == pytest.approx(2, abs=0.15)
    assert errors[1] < 0.1 * spacings[1] ** 2 / 0.25


def test_shortest_side_has_the_resolution_and_a_margin_increases_spacing():
    field, resolution = torus, 33
    tight = extract(field, resolution=resolution, align="axes").metadata["spacing"]
    # The coarse search locates the box up to its own spacing of 2 / COARSE on each side.
    assert 0.5 / 32 < tight < (0.5 + 5 / COARSE) / 32
    wide = extract(field, resolution=resolution, align="axes", margin=0.2).metadata["spacing"]
    assert wide == pytest.approx(0.9 / 32, rel=0.01)


def test_principal_axes_follow_the_longest_direction():
    field, resolution = capsule, 33
    turned, straight = (extract(field, resolution=resolution, align=align) for align in ("pca", "axes"))
    assert turned.metadata["spacing"] < 0.35 * straight.metadata["spacing"]
    assert turned.volume == pytest.approx(np.pi * 0.08**2 * (1.7 + 4 / 3 * 0.08), rel=0.02)


@pytest.mark.parametrize("name", ["knot", "sheet", "two balls", "ellipsoid of slope 0.01", "truncated", "steep"])
def test_the_mesh_equals_that_of_the_dense_lattice(name):
    field = {
        "knot": knot,
        "sheet": sheet,
        "two balls": lambda: lambda p: two_balls(p, 0.03),
        "ellipsoid of slope 0.01": lambda: lambda p: 0.01 * sphere(p * (1, 1.3, 0.8)),
        "truncated": lambda: lambda p: np.clip(torus(p), -0.15, 0.15),
        "steep": lambda: lambda p: np.sinh(4 * capsule(p)),
    }[name]()
    lattice = lattice_over(129 if name == "two balls" else 65)
    sampler = Sampler(field, (-2, 2))
    found = march(sampler, lattice)
    assert_same(found, dense(field, lattice), 2 * NEAREST * lattice.spacing)
    assert sampler.count < 0.6 * np.prod(np.array(lattice.cells) + 1)


def test_the_mesh_of_networks_equals_that_of_the_dense_lattice():
    """With high frequencies and random displacements, and so with unknown slopes, as in practice."""
    field = Idf(omega=60.0, omega_detail=60.0, alpha=0.1).field(torch.Generator().manual_seed(5))
    with torch.no_grad():
        field.displacement.weights[-1].mul_(20.0)  # an initial displacement is almost zero
    lattice = lattice_over(49)
    sampler = Sampler(field.values, (-2, 2))
    found = march(sampler, lattice)
    assert np.ptp(np.linalg.norm(found[0], axis=1)) > 0.05  # not a ball
    assert_same(found, dense(field.values, lattice), 2 * NEAREST * lattice.spacing)
    assert sampler.count < 0.6 * np.prod(np.array(lattice.cells) + 1)


def test_infinite_bound_is_dense():
    lattice = lattice_over(65)
    sampler = Sampler(torus, (-2, 2))
    assert_same(march(sampler, lattice, lipschitz=np.inf), march(Sampler(torus, (-2, 2)), lattice))
    assert sampler.count == np.prod(np.array(lattice.cells) + 1)


def test_parts_smaller_than_a_coarse_cell_are_found():
    coarse = np.stack(np.meshgrid(*[np.linspace(-1, 1, COARSE + 1)] * 3), axis=-1).reshape(-1, 3)
    assert two_balls(coarse).min() > 0
    mesh = extract(two_balls, resolution=193)
    assert_closed_and_outward(mesh, two_balls)
    assert count_topology(mesh.vertices, mesh.faces).components == 2


def test_surface_is_followed_where_the_bound_missed_it():
    # Only signs: no value gives the distance of the surface, and the rod lies between points of the coarsest level.
    def signs(points):
        rod = np.hypot(points[:, 1] - 0.033, points[:, 2] - 0.029)
        return np.where((sphere(points, 0.3) < 0) | ((rod < 0.02) & (np.abs(points[:, 0]) < 0.9)), -1.0, 1.0)

    lattice = Lattice.over(np.full(3, -1.0), np.full(3, 1.0), np.eye(3), 129)
    sampler = Sampler(signs)
    vertices, faces = march(sampler, lattice, lipschitz=1e-9)
    counts = count_topology(vertices, faces)
    assert counts.watertight and counts.genus == 0 and counts.components == 1
    assert np.abs(vertices[:, 0]).max() == pytest.approx(0.9, abs=lattice.spacing)
    assert sampler.count < 0.1 * 129**3


def test_reach_is_that_of_the_farthest_point():
    for i, child in enumerate(CORNERS):
        ends = 0.5 * child + 0.5 * CORNERS
        for j, corner in enumerate(CORNERS):
            farthest = max(np.linalg.norm(end - corner) for end in ends)
            assert farthest <= REACH[i, j] < 1.000001 * farthest


def test_white_noise_gives_a_manifold():
    lattice = lattice_over(33, turned=False)
    noise = generator(5).standard_normal(np.array(lattice.cells) + 1)
    noise[[0, -1]] = noise[:, [0, -1]] = noise[:, :, [0, -1]] = 1.0

    def field(points):
        return noise[tuple(np.rint((points - lattice.origin) / lattice.spacing).astype(int).T)]

    vertices, faces = march(Sampler(field, (-2, 2)), lattice)
    counts = count_topology(vertices, faces)
    assert counts.watertight and counts.genus is not None
    assert_same((vertices, faces), dense(field, lattice), 2 * NEAREST * lattice.spacing)


def test_zeros_at_lattice_points():
    def box(points):
        return np.abs(points).max(axis=1) - 0.5

    lattice = Lattice.over(np.full(3, -1.0), np.full(3, 1.0), np.eye(3), 65)
    found = march(Sampler(box), lattice)
    assert (box(lattice.origin + lattice.spacing * np.arange(65)[:, None]) == 0).any()
    vertices, faces = found
    counts = count_topology(vertices, faces)
    assert counts.watertight and counts.genus == 0
    a, b, c = vertices[faces].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-10 * lattice.spacing**2
    assert np.abs(box(vertices)).max() < 1e-3 * lattice.spacing


def test_each_point_of_the_domain_is_evaluated_once_in_batches():
    counted = Counted(torus)
    mesh = extract(counted, resolution=25, batch=5000)
    assert max(map(len, counted.asked)) == 5000
    assert len(counted.points) == mesh.metadata["evaluations"]
    assert np.abs(counted.points).max() <= 1
    counted = Counted(torus)
    march(Sampler(counted, (-2, 2)), lattice_over(65))
    assert len(np.unique(np.round(counted.points, 9), axis=0)) == len(counted.points)


def test_long_thin_shape_at_high_resolution_takes_little_memory():
    extract(capsule, resolution=16)  # memory of imports on first use does not count
    tracemalloc.start()
    mesh = extract(capsule, resolution=80, max_aspect=20)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_closed_and_outward(mesh, capsule)
    evaluations, spacing = mesh.metadata["evaluations"], mesh.metadata["spacing"]
    assert 1.7 / spacing > 500
    assert evaluations < 13 * mesh.area / spacing**2
    assert peak < 110 * evaluations


def test_a_surface_is_coarser_if_time_is_short():
    """Each level is half as fine, and parts found by a coarser search are never lost."""

    def slow(points):
        time.sleep(2e-6 * len(points))  # 129 samples take 0.9 s, 65 of them 0.4 s
        return torus(points)

    meshes = [extract(slow, resolution=129, seconds=seconds) for seconds in (np.inf, 0.8, 0.0)]
    coarser = [mesh.metadata["coarser"] for mesh in meshes]
    assert coarser[0] == 1 and coarser[1] in (2, 4) and coarser[2] == 4  # 33 samples: the base level
    for mesh, factor in zip(meshes, coarser, strict=True):
        assert mesh.is_watertight and mesh.metadata["spacing"] == meshes[0].metadata["spacing"] * factor
        assert np.abs(torus(mesh.vertices)).max() < mesh.metadata["spacing"] ** 2 / 0.25


def test_a_flat_shape_is_also_meshed_in_time():
    """Its coarsest level has many points, all near the surface: if that takes too long, the level is coarser, too."""

    def slab(points):
        near = np.abs(points[:, 2]) < 0.35
        time.sleep(2e-6 * np.count_nonzero(near))
        q = np.abs(points) - (1.0, 1.0, 0.2)
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)

    began = time.perf_counter()
    mesh = extract(slab, resolution=129, domain=(-1.05, 1.05), seconds=0.5)
    taken = time.perf_counter() - began
    assert mesh.is_watertight and mesh.metadata["coarser"] >= 8
    assert mesh.volume == pytest.approx(1.6, rel=0.05)
    began = time.perf_counter()
    assert extract(slab, resolution=129, domain=(-1.05, 1.05)).metadata["coarser"] == 1
    assert time.perf_counter() - began > 3 * taken


def test_few_evaluations_on_a_sphere_at_256():
    mesh = extract(sphere, resolution=256)
    assert mesh.metadata["evaluations"] < 256**3 / 10
    assert np.abs(sphere(mesh.vertices)).max() < 1e-5


def test_aspect_is_limited():
    def plate(points):
        return (np.abs(points) - (0.8, 0.8, 0.01)).max(axis=1)

    mesh = extract(plate, resolution=25, max_aspect=4)
    assert mesh.metadata["spacing"] == pytest.approx(1.6 / (4 * 24), rel=0.1)
    assert mesh.volume == pytest.approx(1.6**2 * 0.02, rel=0.03)


def test_turned_box_gives_the_same_surface():
    turned, straight = (extract(torus, resolution=25, align=align) for align in ("pca", "axes"))
    assert turned.volume == pytest.approx(straight.volume, rel=2e-3)
    assert turned.area == pytest.approx(straight.area, rel=2e-3)
    distance = cKDTree(straight.vertices).query(turned.vertices)[0]
    assert distance.max() < 1.2 * straight.metadata["spacing"]
    rotation = np.linalg.qr(generator(8).standard_normal((3, 3)))[0]
    again = extract(lambda points: torus(points @ rotation), resolution=25)
    assert again.volume == pytest.approx(turned.volume, rel=2e-3)


def test_a_surface_is_open_where_it_leaves_the_domain():
    mesh = extract(lambda p: sphere(p, 0.7, (0, 0, 0.8)), resolution=40)
    assert count_topology(mesh.vertices, mesh.faces).boundary_edges > 0
    boundary = np.sort(mesh.edges, axis=1)
    edges, uses = np.unique(boundary, axis=0, return_counts=True)
    assert mesh.vertices[edges[uses == 1]][..., 2].min() >= 1 - 1e-9
    assert mesh.vertices[:, 2].max() < 1 + 2 * mesh.metadata["spacing"]
    whole = extract(lambda p: sphere(p, 0.7, (0, 0, 0.8)), resolution=40, domain=((-1, -1, 0), (1, 1, 2)))
    assert_closed_and_outward(whole, lambda p: sphere(p, 0.7, (0, 0, 0.8)))


def test_surface_that_touches_the_domain_is_closed():
    mesh = extract(lambda p: sphere(p, 0.99999, (0, 0, 0)), resolution=30)
    assert mesh.is_watertight


def test_results_do_not_depend_on_the_batch_size():
    one, two = (extract(torus, resolution=25, batch=batch) for batch in (65536, 777))
    assert np.array_equal(one.vertices, two.vertices) and np.array_equal(one.faces, two.faces)


def test_single_precision_is_enough():
    single = extract(lambda p: sphere(p.astype(np.float32)).astype(np.float32), resolution=50)
    assert single.is_watertight
    assert np.abs(sphere(single.vertices)).max() < 3e-4


@pytest.mark.parametrize(
    "field, message",
    [
        (lambda p: sphere(p) + 5, r"no zero crossing in the domain: all [\d,]+ values are positive"),
        (lambda p: sphere(p) - 5, "values are negative"),
        (lambda p: np.ones(len(p)), "values are positive"),
        (lambda p: np.where(p[:, 0] > 0.3, np.nan, sphere(p)), "not finite at [0-9]+ of"),
        (lambda p: np.where(np.arange(len(p)) == 7, np.inf, sphere(p)), "not finite at 1 of"),
    ],
)
def test_fields_without_a_surface(field, message):
    with pytest.raises(InvalidOutput, match=message):
        extract(field, resolution=64)


def test_noise_is_refused_before_memory_runs_out():
    rng = generator(0)
    with pytest.raises(InvalidOutput, match="nearly everywhere: more than 20,000 cells"):
        extract(lambda p: rng.standard_normal(len(p)), resolution=64, max_cells=20_000)


@pytest.mark.parametrize(
    "wrong, name",
    [
        ({"resolution": 3}, "resolution"),
        ({"align": "diagonal"}, "align"),
        ({"margin": -1}, "margin"),
        ({"max_aspect": 0.5}, "max_aspect"),
        ({"lipschitz": 0}, "lipschitz"),
        ({"batch": 0}, "batch"),
        ({"domain": (1, -1)}, "domain"),
    ],
)
def test_wrong_parameters_are_named(wrong, name):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        extract(sphere, **{"resolution": 32, **wrong})


def test_values_of_the_wrong_shape_are_named():
    with pytest.raises(ValueError, match="field: expected values"):
        extract(lambda p: sphere(p)[:, None], resolution=32)


def test_progress_grows_to_its_total():
    seen = []
    extract(sphere, resolution=64, batch=1000, on_progress=lambda done, total: seen.append((done, total)))
    done = [d for d, _ in seen]
    assert {total for _, total in seen} == {100}
    assert done == sorted(set(done)) and done[-1] == 100 and len(done) > 20
