"""The classical methods: known surfaces to a tolerance, outward, repeatable, and no crash on any input.

Native code may crash, so degenerate input is processed in a separate process.
"""

import functools
import importlib.util
import json
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from bench import BadInput, PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.classical.advancing_front import AdvancingFront
from bench.methods.classical.alpha_shape import AlphaShape
from bench.methods.classical.alpha_wrap import AlphaWrap
from bench.methods.classical.apss import Apss
from bench.methods.classical.ball_pivoting import BallPivoting
from bench.methods.classical.bilateral import Bilateral
from bench.methods.classical.ear import Ear
from bench.methods.classical.jet import Jet
from bench.methods.classical.poisson import Poisson
from bench.methods.classical.rimls import Rimls
from bench.methods.classical.wlop import Wlop
from bench.plugins.registry import registry
from bench.tasks.denoise import Denoise
from bench.tasks.reconstruct import Reconstruct

# CGAL's bindings have no build for Python 3.13: there its methods are recorded as skipped, and not tested here.
CGAL = importlib.util.find_spec("CGAL") is not None
POISSON, BALLS, SHAPE, WRAP = Poisson(depth=6), BallPivoting(), AlphaShape(alpha=4), AlphaWrap(alpha=6)
RECONSTRUCT = [POISSON, BALLS, SHAPE, Apss(resolution=50), Rimls(resolution=50)]
RECONSTRUCT += [AdvancingFront(), WRAP] if CGAL else []
# Two defaults are tuned on shapes with thin walls at 5,000 points; stronger settings are used here.
DENOISE = [
    *([Jet(), Wlop(radius=4.5, iterations=15), Bilateral(k=24, angle=15.0)] if CGAL else []),
    Apss(),
    Rimls(),
]
COUNT = 2000
# The median gap of so few random points is 0.04, and the largest holes measure several times that.
SPACING = np.sqrt(4 * np.pi / COUNT)


def name(method):
    return type(method).__name__


@functools.cache
def surface(shape):
    return MeshSurface(
        {
            "sphere": lambda: trimesh.creation.icosphere(4),
            "torus": lambda: trimesh.creation.torus(0.7, 0.3, 64, 32),
            "cube": lambda: trimesh.creation.box((1.15, 1.15, 1.15)),
        }[shape]()
    )


@functools.cache
def cloud_of(shape, sigma=0.0, normals=False, count=COUNT):
    rng = np.random.default_rng(1)
    points, truth = surface(shape).sample(count, rng)
    return PointCloud(points + sigma * rng.standard_normal(points.shape), truth if normals else None)


def distances(shape, points):
    return np.linalg.norm(surface(shape).closest(np.asarray(points))[0] - points, axis=1)


@pytest.mark.parametrize("shape", ["torus", "cube"])  # other tests use spheres and hemispheres
@pytest.mark.parametrize("method", RECONSTRUCT, ids=name)
def test_a_known_surface_is_reconstructed_outward(method, shape):
    cloud = cloud_of(shape)
    mesh = method.reconstruct(cloud, Run())
    Reconstruct().validate(mesh, {"cloud": cloud})
    made, rng = MeshSurface(mesh), np.random.default_rng(0)
    points, _ = made.sample(1500, rng)
    # A chord of length s is off an arc of radius r by s^2 / 8 r; creases are rounded by a fraction of s.
    assert distances(shape, points).mean() < 0.15 * SPACING
    of_truth, _ = surface(shape).sample(1500, rng)
    assert np.linalg.norm(made.closest(of_truth)[0] - of_truth, axis=1).mean() < 0.15 * SPACING
    _, outward = surface(shape).closest(mesh.triangles_center)
    cosines = np.einsum("ni,ni->n", mesh.face_normals, outward)
    assert np.average(cosines, weights=mesh.area_faces) > 0.9


@pytest.mark.parametrize("method", [POISSON, *([WRAP] if CGAL else [])], ids=name)
def test_closed_reconstructions_have_the_volume_of_the_shape(method):
    mesh = method.reconstruct(cloud_of("sphere", normals=True), Run())
    assert mesh.is_watertight
    # A hundredth of the volume is a mean offset of 0.0033.
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.01)


def test_trim_removes_the_least_supported_vertices():
    points, normals = surface("sphere").sample(COUNT, np.random.default_rng(0))
    upper = points[:, 2] > 0
    hemisphere = PointCloud(points[upper], normals[upper])
    closed = Poisson(depth=6).reconstruct(hemisphere, Run())
    trimmed = Poisson(depth=6, trim=0.2).reconstruct(hemisphere, Run())
    assert len(trimmed.vertices) == pytest.approx(0.8 * len(closed.vertices), rel=0.01)
    assert trimmed.area < closed.area
    # The removed part is the lid, which no point supports.
    assert trimmed.triangles_center[:, 2].min() >= closed.triangles_center[:, 2].min()
    assert distances("sphere", trimmed.vertices).mean() < distances("sphere", closed.vertices).mean()


@pytest.mark.parametrize("method", [m for m in RECONSTRUCT if m not in (POISSON, WRAP)], ids=name)
def test_an_open_input_stays_open(method):
    points = cloud_of("sphere").points
    mesh = method.reconstruct(PointCloud(points[points[:, 2] > 0]), Run())
    assert not mesh.is_watertight
    assert mesh.area == pytest.approx(2 * np.pi, rel=0.25)
    assert np.einsum("ni,ni->n", mesh.face_normals, mesh.triangles_center).mean() > 0.8


@pytest.mark.parametrize("method", DENOISE, ids=name)
def test_noise_is_reduced(method):
    cloud = cloud_of("torus", 0.02)
    output = method.denoise(cloud, Run())
    Denoise().validate(output, {"cloud": cloud})
    assert len(output) == len(cloud)
    # An average of n neighbours has 1/sqrt(n) of their noise: half of it with four.
    assert distances("torus", output.points).mean() < 0.55 * distances("torus", cloud.points).mean()


@pytest.mark.parametrize("method", DENOISE, ids=name)
def test_a_clean_cloud_is_hardly_moved(method):
    cloud = cloud_of("sphere", count=3000)
    assert distances("sphere", method.denoise(cloud, Run()).points).mean() < 0.005


@pytest.mark.parametrize("method", [*([Jet(), Bilateral()] if CGAL else []), Apss(), Rimls()], ids=name)
def test_points_keep_their_order_and_duplicates(method):
    cloud = cloud_of("sphere", 0.01, count=600)
    twice = PointCloud(np.repeat(cloud.points, 2, axis=0))
    output = method.denoise(twice, Run()).points
    assert np.array_equal(output[::2], output[1::2])
    assert np.linalg.norm(output - twice.points, axis=1).max() < 0.2


if CGAL:

    def test_wlop_retains_the_requested_share():
        cloud = cloud_of("sphere", 0.01)
        assert len(Wlop(retain=25).denoise(cloud, Run())) == pytest.approx(COUNT / 4, abs=1)


@pytest.mark.parametrize("method", DENOISE, ids=name)
def test_the_unit_does_not_matter(method):
    cloud = cloud_of("sphere", 0.01, count=600)
    small = method.denoise(cloud, Run()).points
    large = method.denoise(PointCloud(cloud.points * 4), Run()).points / 4
    # A power of two scales exactly; only thresholds inside the libraries differ.
    assert np.abs(np.sort(small, axis=0) - np.sort(large, axis=0)).mean() < 1e-5


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Poisson(depth=4),
        lambda: Poisson(trim=1.0),
        lambda: BallPivoting(radii=()),
        lambda: BallPivoting(radii=(2.0, 1.0)),
        lambda: Wlop(retain=0),
        lambda: Wlop(radius=-1),
        lambda: Jet(k=3),
        lambda: Poisson(cut=-1.0),
        lambda: Bilateral(angle=0),
        lambda: Bilateral(iterations=0),
        lambda: Ear(edge_sensitivity=2),
        lambda: Ear(radius=0),
        lambda: AlphaShape(alpha=0),
        lambda: AlphaWrap(offset=0),
        lambda: AdvancingFront(beta=4),
    ],
)
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match="expected|needs"):
        wrong()


def test_messages_name_the_method_and_what_was_expected():
    with pytest.raises(BadInput, match="poisson: has 2 points; expected at least"):
        Poisson().reconstruct(PointCloud(np.eye(3)[:2]), Run())
    with pytest.raises(BadInput, match="jet: all 50 points lie on one line"):
        Jet().denoise(PointCloud(np.outer(np.arange(50.0), [1, 2, 3])), Run())


# -- in separate processes -------------------------------------------------------------------------------------------

DEGENERATE = """
import hashlib, json, sys
import numpy as np
from bench import BadInput, PointCloud, Run
from bench.plugins.registry import registry
from bench.tasks.denoise import Denoise
from bench.tasks.reconstruct import Reconstruct
from bench.tasks.upsample import Upsample

def sphere(n):
    points = np.random.default_rng(n).standard_normal((n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)

def with_value(value):
    points = sphere(200)
    points[3, 1] = value
    return points

rng = np.random.default_rng(0)
outliers = sphere(500)
outliers[:10] = rng.uniform(-1, 1, (10, 3))
inputs = {
    **{str(n): sphere(n) for n in (0, 1, 2, 3, 4, 10)},
    "collinear": np.outer(np.linspace(-1, 1, 200), [1, 0.5, 0.2]),
    "coplanar": rng.uniform(-1, 1, (200, 3)) * [1, 1, 0],
    "grid": np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2, [0.0]), -1).reshape(-1, 3),
    "equal": np.tile([[0.1, 0.2, 0.3]], (100, 1)),
    "tripled": np.repeat(sphere(200), 3, axis=0),
    "few, many times": np.repeat(sphere(20), 50, axis=0),
    "nearly equal": 0.5 + 1e-12 * sphere(200),
    "nan": with_value(np.nan),
    "infinite": with_value(np.inf),
    "outliers": outliers,
    "far away": with_value(1e6),
    "two clusters": np.vstack([0.01 * sphere(200) - 0.5, 0.01 * sphere(200) + 0.5]),
}
degenerate = len(sys.argv) > 2
# Lattices of a plane are seen in the tests of planes, and in those of splines.
ELSEWHERE = [("poisson", "grid"), ("ipsr", "grid"), ("neural_splines", "grid")]
# A surface is sampled whatever it was made of: that it is made is seen by reconstruct already.
SAMPLED = {"poisson": ["0", "4", "equal", "nan", "tripled", "two clusters"]}
for name, parameters in json.loads(sys.argv[1]).items():
    method = registry().find("method", name).cls(**parameters)
    for task in (Reconstruct(), Denoise(), Upsample(ratio=3)):
        what = type(task).__name__.lower()
        if not hasattr(method, what):
            continue
        labels = SAMPLED.get(name, inputs) if what == "upsample" else [x for x in inputs if (name, x) not in ELSEWHERE]
        for label, points in [(label, inputs[label]) for label in labels] if degenerate else ():
            print("BEGIN", name, what, label, flush=True)
            given = task.input(PointCloud(points))
            try:
                task.validate(task.solve(method, what, given, Run()), given)
                outcome = "ok"
            except BadInput as error:
                assert name in str(error), error
                outcome = "refused"
            print("END", json.dumps([name, what, label, outcome]), flush=True)
        noisy = task.input(PointCloud(sphere(500) + 0.01 * np.random.default_rng(5).standard_normal((500, 3))))
        output = task.solve(method, what, noisy, Run(seed=1))
        arrays = [output.points] if hasattr(output, "points") else [output.vertices, output.faces]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
        print("HASH", name, what, digest, flush=True)
"""
QUICK = {
    "poisson": {"depth": 5},
    "ipsr": {"depth": 5, "rounds": 2},
    "apss": {"resolution": 20},
    "rimls": {"resolution": 20},
    "wnnc": {"rounds": 2, "depth": 5},
    "neural_splines": {"centers": 60, "resolution": 16},
}
OF_CLOUDS = ("reconstruct", "denoise", "upsample")
TIMEOUT = 300  # seconds


def classical(library):
    """The methods of the folder that need a library, or, for None, those that need no optional one."""
    mine = [p for p in registry().all("method") if p.file.parent.name == "classical"]
    mine = [p for p in mine if any(map(p.solves, OF_CLOUDS))]
    needs = {p.name: next((r for r in p.requires if r in ("CGAL", "pymeshlab")), None) for p in mine}
    return {name: QUICK.get(name, {}) for name in needs if needs[name] == library}


OPEN3D_AND_SCIPY, MESHLAB, BY_CGAL = map(classical, (None, "pymeshlab", "CGAL"))


ALL = OPEN3D_AND_SCIPY | MESHLAB | (BY_CGAL if CGAL else {})


@pytest.fixture(scope="module")
def of_degenerate_input():
    """The output of a process that runs all methods, each on all inputs, and then on a noisy one."""
    return in_own_process(ALL, "degenerate")


@pytest.fixture(scope="module")
def hashes_elsewhere():
    """The hashes of all methods in another process, whose C library overwrites freed and allocated memory.

    A result that depends on uninitialised memory would differ.
    """
    return hashes(in_own_process(ALL, MALLOC_PERTURB_="255"))


def hashes(output):
    """For each method and task, the digest of what it returned."""
    return [tuple(line.split()[1:]) for line in output.splitlines() if line.startswith("HASH")]


def in_own_process(methods, *options, **environment):
    command = [sys.executable, "-c", DEGENERATE, json.dumps(methods), *options]
    environment = {**os.environ, **environment}
    told = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, env=environment)
    assert told.returncode == 0, f"exit code {told.returncode}\n{told.stdout[-500:]}\n{told.stderr[-2000:]}"
    return told.stdout


@pytest.mark.parametrize(
    "methods", [OPEN3D_AND_SCIPY, MESHLAB, *([BY_CGAL] if CGAL else [])], ids=lambda methods: "+".join(methods)
)
def test_degenerate_input_is_refused_or_gives_valid_repeatable_output(methods, of_degenerate_input, hashes_elsewhere):
    outcomes = [json.loads(line[4:]) for line in of_degenerate_input.splitlines() if line.startswith("END ")]
    outcomes = [outcome for outcome in outcomes if outcome[0] in methods]
    assert {name for name, *_ in outcomes} == set(methods)
    for name, task, label, outcome in outcomes:
        if label in ("0", "1", "equal", "nearly equal", "collinear", "nan", "infinite"):
            assert outcome == "refused", (name, task, label)
        if label in ("outliers", "tripled"):
            assert outcome == "ok", (name, task, label)

    # After many calls in one process, and as the first call of another.
    here = [line for line in hashes(of_degenerate_input) if line[0] in methods]
    assert {name for name, *_ in here} == set(methods)
    assert here == [line for line in hashes_elsewhere if line[0] in methods]
