"""Every convention held against its paper's script, written anew from its protocol, with random draws of its own.

The scripts share nothing with the bench but the files: they read clouds and meshes in coordinates of their own, draw
their own ground truth, and what they print must differ from what we print by no more than they differ from themselves.
"""

from functools import cache

import igl
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import Case, PointCloud, Shape
from bench.commands.score import Score, _of_convention, in_convention
from bench.engine.call import score
from bench.geometry.comparison import set_samples
from bench.ranking.conventions import load_convention

COUNT = 1000
SEEDS = range(3)
SHAPES = {
    "ball": trimesh.creation.icosphere(4),
    "box": trimesh.creation.box(extents=(1.4, 0.9, 0.5)),
    "ring": trimesh.creation.torus(0.75, 0.25, major_sections=96, minor_sections=48),
}
OUTPUTS = {"perfect": 0.0, "noisy": 0.01}  # the noise in radii, per axis


def perfect_and_noisy(*names):
    """A perfect output for one shape, and a noisy one for another."""
    pairs = list(zip(names, OUTPUTS, strict=True))
    values = [(name, OUTPUTS[kind]) for name, kind in pairs]
    return pytest.mark.parametrize(("name", "sigma"), values, ids=map("-".join, pairs))


# -- what the scripts are given ----------------------------------------------------------------------------------------


def poisson_disk(mesh, count, rng):
    """About as many points, by throwing darts: from many, whatever is closer than r to one that was taken goes."""
    pool = trimesh.sample.sample_surface(mesh, 8 * count, seed=rng)[0]
    tree, radius = cKDTree(pool), 0.73 * np.sqrt(mesh.area / count)
    while True:
        free, taken = np.ones(len(pool), dtype=bool), []
        for i, point in enumerate(pool):
            if free[i]:
                taken.append(i)
                free[tree.query_ball_point(point, radius)] = False
        if abs(len(taken) - count) <= 0.01 * count:
            return pool[taken]
        radius *= np.sqrt(len(taken) / count)


@cache
def files(name, sigma, seed):
    """A mesh in coordinates of its own, and the cloud that a method returned for it."""
    rng = np.random.default_rng([seed, 1])
    shape = SHAPES[name]
    mesh = trimesh.Trimesh(3.0 * shape.vertices + [5, -2, 1], shape.faces, process=False)
    points = poisson_disk(mesh, COUNT, rng)
    return mesh, points + radius_of(mesh) * sigma * rng.normal(size=points.shape)


def radius_of(mesh):
    center = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    return np.linalg.norm(mesh.vertices - center, axis=1).max()


def ours(convention, mesh, output, seed, floors=False):
    """What the bench prints: value by title, and floor by title."""
    shape, frame = Shape("mesh", mesh).framed()
    case = Case(f"mesh-{seed}", {}, shape, frame, seed)
    set_samples(case, 20_000)
    if isinstance(output, np.ndarray):
        output = PointCloud(frame.apply(output))
    else:
        output = trimesh.Trimesh(frame.apply(output.vertices), output.faces, process=False)
    paper = load_convention(convention)
    values, perfect, *_ = score(_of_convention(paper), output, case, floors=floors)
    found = in_convention(paper, {key: Score(values[key], perfect.get(key), "lower") for key in values})
    return {title: s.value for title, s in found.items()}, {title: s.floor for title, s in found.items()}


def agree(ours, theirs, least=0.02):
    """Assert that the means of two lists of draws differ by no more than their spread, and a small share."""
    a, b = np.array(ours), np.array(theirs)
    spread = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    assert abs(a.mean() - b.mean()) <= 4 * spread + least * b.mean() + 1e-9, (a, b)


def squared_both_ways(P, Q):
    forward, backward = cKDTree(Q).query(P)[0] ** 2, cKDTree(P).query(Q)[0] ** 2
    return forward.mean() + backward.mean(), forward.max() + backward.max()


def unit_sphere(P):
    P = P - P.mean(axis=0)
    return P / np.linalg.norm(P, axis=1).max()


# -- the scripts -------------------------------------------------------------------------------------------------------


def script_mpu(mesh, output, truth):
    cd, hd = squared_both_ways(unit_sphere(output), unit_sphere(truth))
    to_mesh = np.sqrt(igl.point_mesh_squared_distance(output, np.array(mesh.vertices), np.array(mesh.faces))[0])
    return {"CD (1e-3)": 1e3 * cd, "HD (1e-3)": 1e3 * hd, "P2F (1e-3)": 1e3 * to_mesh.mean()}


def script_pu_gan(mesh, output, rng, share):
    """Projected points in each of 1,000 disks: deviation of their number times deviation of their spacing."""
    projected = igl.point_mesh_squared_distance(output, np.array(mesh.vertices), np.array(mesh.faces))[2]
    radius, expected, parts = np.sqrt(share * mesh.area / np.pi), share * len(output), []
    centers = trimesh.sample.sample_surface(mesh, 1000, seed=rng)[0]
    for members in cKDTree(projected).query_ball_point(centers, radius):
        disk = projected[members]
        if len(disk) < 5:
            continue
        spacing, hexagonal = cKDTree(disk).query(disk, 2)[0][:, 1], np.sqrt(2 * np.pi * radius**2 / len(disk) / 1.732)
        parts.append((len(disk) - expected) ** 2 / expected * np.mean((spacing - hexagonal) ** 2 / hexagonal))
    return 1e3 * np.mean(parts)


def script_score_denoise(output, clean):
    center = (clean.min(axis=0) + clean.max(axis=0)) / 2
    scale = np.linalg.norm(clean - center, axis=1).max()
    return 1e4 * squared_both_ways((output - center) / scale, (clean - center) / scale)[0]


def script_dss(mesh, output, rng):
    """At the scale of the shapes that the paper's code came with."""
    scale = 4.2 / np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    truth = trimesh.sample.sample_surface(mesh, 20_000, seed=rng)[0]
    cd, hd = squared_both_ways(scale * output, scale * truth)
    return {"CD (1e-4)": 1e4 * cd, "HD (1e-3)": 1e3 * hd}


def script_points2surf(mesh, output, rng, sample):
    """The code's sum over 10,000 points a side in the unit cube, of which the table has the mean times 100."""
    unit = 1 / np.ptp(mesh.vertices, axis=0).max()
    P, Q = (sample(m, 10_000, seed=int(rng.integers(2**31)))[0] * unit for m in (output, mesh))
    assert len(P) == len(Q) == 10_000
    return (cKDTree(Q).query(P)[0].sum() + cKDTree(P).query(Q)[0].sum()) / 10_000 * 100


# -- they agree --------------------------------------------------------------------------------------------------------


@perfect_and_noisy("ball", "ring")
def test_mpu_pu_gan_and_score_denoise(name, sigma):
    mine, theirs = [], []
    for seed in SEEDS:
        mesh, output = files(name, sigma, seed)
        rng = np.random.default_rng([seed, 2])
        gan, denoise = ours("pu_gan", mesh, output, seed)[0], ours("score_denoise", mesh, output, seed)[0]
        radius = radius_of(mesh)  # the scripts' lengths are the file's
        scaled = {key: gan[key] * radius for key in gan if key.startswith(("P2F", "uniformity"))}
        mine.append(gan | scaled | {"denoise": denoise["CD (1e-4)"]})
        truth = poisson_disk(mesh, len(output), rng)
        theirs.append(script_mpu(mesh, output, truth) | {"denoise": script_score_denoise(output, truth)})
        for share in (0.008, 0.012):
            theirs[-1][f"uniformity {100 * share:.1f} % (1e-3)"] = script_pu_gan(mesh, output, rng, share)
    for key in theirs[0]:
        both = [m[key] for m in mine], [t[key] for t in theirs]
        if key.startswith("P2F"):  # nothing in it is drawn
            assert both[0] == pytest.approx(both[1], rel=1e-6, abs=1e-9)
        else:
            agree(*both, least=0.05)
    # What is printed beside it is the same cloud in the frame that the denoisers take.
    assert [m["CD in the frame (1e-3)"] for m in mine] == pytest.approx([m["denoise"] / 10 for m in mine])


@pytest.mark.parametrize("sigma", [0.0, 0.02], ids=OUTPUTS)  # half as much noise would be 1.09 to 1.13 floors
def test_mpu_prints_what_pu_gan_does(sigma):
    mesh, output = files("ring", sigma, 0)
    (mpu, floors), (gan, _) = ours("mpu", mesh, output, 0, floors=True), ours("pu_gan", mesh, output, 0)
    assert {key: gan[key] for key in mpu if key in gan} == {key: mpu[key] for key in mpu if key != "P2F std (1e-3)"}
    # The floor is that of another Poisson-disk cloud: a perfect output sits on it.
    for key in ("CD (1e-3)", "CD in the frame (1e-3)"):
        assert mpu[key] == pytest.approx(floors[key], rel=0.1) if sigma == 0 else mpu[key] > 1.1 * floors[key]


@perfect_and_noisy("box", "ring")
def test_dss(name, sigma):
    mine, theirs = [], []
    for seed in SEEDS:
        mesh, output = files(name, sigma, seed)
        mine.append(ours("dss", mesh, output, seed)[0])
        theirs.append(script_dss(mesh, output, np.random.default_rng([seed, 2])))
    for key in theirs[0]:
        agree([m[key] for m in mine], [t[key] for t in theirs])


@perfect_and_noisy("ball", "ring")
def test_points2surf(name, sigma):
    mine, theirs = [], []
    for seed in SEEDS:
        mesh, _ = files(name, 0.0, seed)
        rng = np.random.default_rng([seed, 2])
        noise = radius_of(mesh) * sigma * rng.normal(size=mesh.vertices.shape)
        output = trimesh.Trimesh(mesh.vertices + noise, mesh.faces, process=False)
        found = ours("points2surf", mesh, output, seed)[0]
        mine.append([found["Chamfer (1e-2)"], found["Chamfer of uniform samples (1e-2)"]])
        samplers = (trimesh.sample.sample_surface_even, trimesh.sample.sample_surface)
        theirs.append([script_points2surf(mesh, output, rng, sample) for sample in samplers])
    for column in range(2):
        agree([m[column] for m in mine], [t[column] for t in theirs], least=0.005)
    assert all(even < uniform for even, uniform in mine)


# -- why they do -------------------------------------------------------------------------------------------------------


def test_uniform_ground_truth_would_not_do():
    """Two uniform samples are farther apart than a good output is from a Poisson-disk sample."""
    mesh, output = files("ball", 0.0, 0)
    truth = trimesh.sample.sample_surface(mesh, len(output), seed=3)[0]
    uniform = 1e4 * squared_both_ways(output, truth)[0] / radius_of(mesh) ** 2
    assert ours("score_denoise", mesh, output, 0)[0]["CD (1e-4)"] < 0.8 * uniform


def test_one_far_point_shrinks_a_cloud_in_its_own_sphere_and_not_in_the_frame():
    mesh, output = files("ball", 0.0, 0)
    far = np.vstack([output[1:], output.mean(axis=0) + [2.0 * radius_of(mesh), 0, 0]])
    (usual, _), (spoiled, _) = (ours("mpu", mesh, cloud, 0) for cloud in (output, far))
    assert spoiled["CD (1e-3)"] > 20 * usual["CD (1e-3)"]
    # One squared distance, 1, in the mean of all.
    gained = spoiled["CD in the frame (1e-3)"] - usual["CD in the frame (1e-3)"]
    assert gained == pytest.approx(1e3 / len(output), rel=0.1)
