"""Meshes fitted to images: descent, regularisers, the initial mesh, and a ball that grows to its size."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from trimesh import Trimesh
from trimesh.creation import icosahedron, icosphere, torus

from bench import BadInput, PointCloud, Run, Views
from bench.contract.ball_views import views_of_a_ball
from bench.methods.mesh_rendering.fitting.descent import Adam, Diffused
from bench.methods.mesh_rendering.fitting.loop import Schedule
from bench.methods.mesh_rendering.fitting.regularity import Regularity, edges_of, graph_laplacian
from bench.methods.mesh_rendering.fitting.start import mesh_of, spread_over
from bench.methods.mesh_rendering.large_steps import LargeSteps
from bench.methods.mesh_rendering.neural_mesh_renderer import NeuralMeshRenderer
from bench.methods.mesh_rendering.opendr import Opendr
from bench.methods.mesh_rendering.paparazzi import Paparazzi
from bench.methods.mesh_rendering.soft_rasterizer import SoftRasterizer
from bench.tasks.fit_shape import FitShape

# -- descent and regularisers ------------------------------------------------------------------------------------------


def test_adam_matches_torch():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4, 3))
    free, ours = torch.tensor(values).requires_grad_(), Adam()
    theirs = torch.optim.Adam([free], lr=0.03, eps=1e-12)
    for _ in range(20):
        gradient = rng.normal(size=(4, 3))
        free.grad = torch.tensor(gradient)
        theirs.step()
        values = ours.step(values, gradient, 0.03)
        np.testing.assert_allclose(values, free.detach(), rtol=1e-10)


def test_uniform_steps_keep_the_direction_and_are_scaled_to_the_rate():
    gradient = np.random.default_rng(0).normal(size=(4, 3))
    step = Adam(uniform=True).step(np.zeros((4, 3)), gradient, 0.1)
    np.testing.assert_allclose(step, -0.1 * gradient / np.abs(gradient).max(), rtol=1e-9)


def test_large_steps_match_a_dense_solve_and_are_invertible():
    mesh = icosphere(subdivisions=1)
    faces, vertices = np.array(mesh.faces), np.array(mesh.vertices)
    dense = np.eye(len(vertices))
    for a, b in edges_of(faces):
        dense[[a, b], [a, b]] += 19
        dense[[a, b], [b, a]] -= 19
    diffused, rng = Diffused(faces, len(vertices), 19.0), np.random.default_rng(0)
    gradient = rng.normal(size=vertices.shape)
    np.testing.assert_allclose(diffused.solve(gradient), np.linalg.solve(dense, gradient), atol=1e-12)
    np.testing.assert_allclose(diffused.of(vertices), dense @ vertices, atol=1e-12)
    np.testing.assert_allclose(diffused.solve(diffused.of(vertices)), vertices, atol=1e-12)
    np.testing.assert_array_equal(Diffused(faces, len(vertices), 0.0).of(vertices), vertices)


def test_the_graph_laplacian_of_a_tetrahedron():
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    assert len(edges_of(faces)) == 6
    np.testing.assert_array_equal(graph_laplacian(edges_of(faces), 4).toarray(), 4 * np.eye(4) - 1)


def test_regularisers_and_their_gradient():
    mesh = icosphere(subdivisions=1)
    faces, rng = np.array(mesh.faces), np.random.default_rng(0)
    vertices = mesh.vertices + 0.1 * rng.normal(size=mesh.vertices.shape)
    regularity = Regularity(vertices, faces, 0.3, 0.7)
    gradient, along = regularity.look(vertices)[1], rng.normal(size=vertices.shape)
    ahead, behind = (regularity.look(vertices + sign * 1e-6 * along)[0] for sign in (1, -1))
    assert (gradient * along).sum() == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)
    regular = icosahedron()
    even = Regularity(regular.vertices, np.array(regular.faces), 0.0, 1.0).look(np.array(regular.vertices))
    assert even[0] < 1e-20 and np.abs(even[1]).max() < 1e-12
    # The neighbours of a vertex of an icosahedron of radius 1 form a ring at the height 1 / sqrt(5).
    smooth = Regularity(regular.vertices, np.array(regular.faces), 1.0, 0.0).look(np.array(regular.vertices))[0]
    edge = 4 / np.sqrt(10 + 2 * np.sqrt(5))
    assert smooth == pytest.approx(((1 - 1 / np.sqrt(5)) / edge) ** 2, rel=1e-6)


def test_the_rate_falls_to_its_final_value():
    schedule = Schedule(steps=11, views=1, rate=0.5, rate_end=0.01)
    assert schedule.rate_at(0) == 0.5 and schedule.rate_at(10) == pytest.approx(0.005)
    assert schedule.rate_at(5) == pytest.approx(0.05) and Schedule(1, 1, 0.5, 0.1).rate_at(0) == 0.5


# -- from the cloud to a mesh and back ---------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["sphere", "cube"])
def test_the_initial_points_are_the_vertices_of_a_closed_mesh(start):
    cloud = FitShape(start=start, points=1000, size=0.5).beginning()
    vertices, faces = mesh_of(cloud)
    np.testing.assert_array_equal(vertices, cloud.points)
    mesh = Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and len(np.unique(faces)) == 1000
    assert mesh.euler_number == 2 and mesh.volume == pytest.approx({"sphere": np.pi / 6, "cube": 1}[start], rel=0.03)


def test_a_cloud_that_is_not_star_shaped_starts_from_its_poisson_surface():
    ring = torus(1.0, 0.4, major_sections=48, minor_sections=24)
    cloud = PointCloud(np.array(ring.vertices), np.array(ring.vertex_normals))
    vertices, faces = mesh_of(cloud)
    mesh = Trimesh(vertices, faces, process=False)
    assert mesh.euler_number == 0 and mesh.volume == pytest.approx(ring.volume, rel=0.1)
    assert len(vertices) < 1.3 * len(cloud)


def test_points_are_spread_evenly_over_the_mesh():
    mesh = icosphere(subdivisions=3)
    cloud = spread_over(mesh, 200, np.random.default_rng(0))
    assert len(cloud) == 200 and (np.linalg.norm(cloud.points, axis=1) > 0.98).all()
    distance = torch.cdist(torch.tensor(cloud.points), torch.tensor(cloud.points)).fill_diagonal_(9).min(0).values
    assert distance.min() > 0.4 * np.sqrt(4 * np.pi / 200)
    assert ((cloud.points * cloud.normals).sum(1) > 0.98).all()


# -- the methods -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def views():
    return views_of_a_ball(12, 32)


def off(cloud):
    """RMS distance from the unit sphere."""
    return float(np.sqrt(((np.linalg.norm(cloud.points, axis=1) - 1) ** 2).mean()))


@pytest.mark.parametrize(
    "method",
    [
        SoftRasterizer(steps=40, views=4, rate=0.02, sigma=1e-3),
        NeuralMeshRenderer(steps=40, views=4, rate=0.02),
        Opendr(steps=40, views=4, rate=0.02),
        LargeSteps(steps=40, views=4, rate=0.1, sigma=1e-3),
    ],
    ids=lambda method: type(method).__name__,
)
def test_a_ball_grows_to_its_size(method, views):
    start = FitShape(points=200, size=0.6).beginning()
    fitted = method.fit_shape(views, start, Run(seed=1))
    assert len(fitted) == 200 and off(fitted) < 0.5 * off(start)
    radius = np.linalg.norm(fitted.points, axis=1, keepdims=True)
    assert (fitted.points / radius * fitted.normals).sum(1).mean() > 0.9


def test_shading_alone_does_not_change_the_size_but_turns_normals(views):
    start = FitShape(points=200, size=0.6).beginning()
    fitted = Paparazzi(steps=40, views=4).fit_shape(views, start, Run(seed=1))
    assert 0.3 < off(fitted) < 0.5
    cube = FitShape(start="cube", points=200, size=0.6).beginning()
    bare = Paparazzi(steps=40, views=4, smoothness=0.0, evenness=0.0)

    def cosine(cloud):
        return (cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True) * cloud.normals).sum(1).mean()

    assert cosine(bare.fit_shape(views, cube, Run(seed=1))) > cosine(cube) + 0.02


def test_repeatability_time_limit_traces_and_the_stored_mesh(views):
    start, method = FitShape(points=60).beginning(), Opendr(steps=16, views=2)
    first, offered, kept = method.fit_shape(views, start, Run(seed=2)), [], {}
    looked_at = Run(seed=2)
    looked_at.on_trace = lambda output, seconds, keep=False: offered.append(output())
    looked_at.on_keep = kept.__setitem__
    again = method.fit_shape(views, start, looked_at)
    np.testing.assert_array_equal(first.points, again.points)
    assert len(offered) == 9 and isinstance(kept["mesh"], Trimesh) and len(kept["mesh"].vertices) == 60
    np.testing.assert_array_equal(offered[-1].points, first.points)
    stopped = method.fit_shape(views, start, Run(seconds=0.0))
    assert off(stopped) == pytest.approx(0.3, abs=0.06)


def test_missing_lights_and_normals_are_named(views):
    start = FitShape(points=50).beginning()
    dark = Views(views.images, views.masks, views.extrinsics, views.intrinsics)
    with pytest.raises(BadInput, match="no lights"):
        Opendr().fit_shape(dark, start, Run())
    with pytest.raises(BadInput, match="no normals"):
        Paparazzi().fit_shape(views, PointCloud(start.points), Run())


@pytest.mark.parametrize(
    ("method", "wrong"),
    [
        (Paparazzi, {"steps": 0}),
        (Paparazzi, {"rate": 0.0}),
        (Paparazzi, {"evenness": -1.0}),
        (SoftRasterizer, {"sigma": 0.0}),
        (SoftRasterizer, {"gamma": float("nan")}),
        (NeuralMeshRenderer, {"gap": -1.0}),
        (Opendr, {"gap": -1.0}),
        (LargeSteps, {"diffusion": -1.0}),
    ],
)
def test_wrong_parameters_of_mesh_renderers_are_named(method, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        method(**wrong)
