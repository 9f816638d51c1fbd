"""Images of meshes and their gradients: against ray casting, tensors, finite differences and closed forms."""

from __future__ import annotations

import numpy as np
import open3d
import pytest
import torch
from mesh_scenes import plain_soft_image, random_scene, square, views_of_a_square

from bench.contract.ball_views import views_of_a_ball
from bench.methods.mesh_rendering.fitting.gallery import Gallery
from bench.methods.mesh_rendering.fitting.loss import image_loss
from bench.methods.mesh_rendering.neural_mesh_renderer import NeuralMeshRenderer
from bench.methods.mesh_rendering.opendr import Opendr
from bench.methods.mesh_rendering.paparazzi import Paparazzi
from bench.methods.mesh_rendering.raster.differences import DifferencesDrawn
from bench.methods.mesh_rendering.raster.hard import HardDrawn, rasterise
from bench.methods.mesh_rendering.raster.scan_lines import ScanLineDrawn
from bench.methods.mesh_rendering.raster.scene import Scene, project, project_back
from bench.methods.mesh_rendering.raster.shading import Lights, normals_back, normals_of
from bench.methods.mesh_rendering.raster.soft import SoftDrawn
from bench.methods.mesh_rendering.soft_rasterizer import SoftRasterizer

CROOKED = np.array([[30.0, 0.8, 11], [0, 26, 9], [0, 0, 1]])


def slopes_of(function, at, step=1e-6):
    """Central differences of a number by an array."""
    gradient = np.zeros_like(at)
    for index in np.ndindex(at.shape):
        values = []
        for sign in (1, -1):
            moved = at.copy()
            moved[index] += sign * step
            values.append(function(moved))
        gradient[index] = (values[0] - values[1]) / (2 * step)
    return gradient


def crooked_view(seed=0):
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    return np.column_stack([rotation, [0.1, -0.2, 3.0]])


# -- projection and shading --------------------------------------------------------------------------------------------


def test_projection_matches_views_and_its_gradient_finite_differences():
    views, points = views_of_a_ball(3, 16), np.random.default_rng(0).normal(size=(5, 3)) / 2
    screen = project(points, views.extrinsics[1], views.intrinsics[1])
    pixels, depth = views.project(points)
    np.testing.assert_allclose(screen, np.column_stack([pixels[1], depth[1]]), rtol=1e-12)
    extrinsics, slope = crooked_view(), np.random.default_rng(1).normal(size=(5, 3))
    back = project_back(slope, project(points, extrinsics, CROOKED), extrinsics, CROOKED)
    expected = slopes_of(lambda moved: (slope * project(moved, extrinsics, CROOKED)).sum(), points)
    np.testing.assert_allclose(back, expected, rtol=1e-6, atol=1e-7)


def test_shading_and_its_gradient():
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(6, 3)), np.array([[0, 1, 2], [2, 1, 3], [4, 3, 1], [5, 0, 4]])
    directions = rng.normal(size=(2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lights, slope = Lights(directions, rng.random((2, 3)), rng.random(3)), rng.normal(size=(4, 3))

    def value(moved):
        return (slope * lights.shade(normals_of(moved, faces).unit)).sum()

    normals = normals_of(vertices, faces)
    back = normals_back(lights.shade_back(slope, normals.unit), normals, vertices, faces)
    np.testing.assert_allclose(back, slopes_of(value, vertices), rtol=1e-6, atol=1e-7)
    flat = normals_of(vertices, np.array([[0, 0, 1]]))
    assert not flat.unit.any() and not normals_back(np.ones((1, 3)), flat, vertices, np.array([[0, 0, 1]])).any()


# -- the plain image ---------------------------------------------------------------------------------------------------


def test_the_nearest_face_matches_ray_casting():
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (300, 1, 3)) + 0.3 * rng.normal(size=(300, 3, 3))
    vertices, faces = corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)
    views = views_of_a_ball(5, 96)
    screen = project(vertices, views.extrinsics[2], views.intrinsics[2])
    seen = rasterise(Scene(screen, faces, np.ones((300, 3)), 96, 96, 9.0))
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(vertices.astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32)))
    rays = np.concatenate(views.rays(2), axis=-1).astype(np.float32)
    cast = scene.cast_rays(open3d.core.Tensor(rays), nthreads=1)
    expected = cast["primitive_ids"].numpy().astype(np.int64)
    expected[expected == open3d.t.geometry.RaycastingScene.INVALID_ID] = -1
    assert (seen.face == expected).mean() > 0.999 and (expected >= 0).mean() > 0.3
    same = (seen.face == expected) & (expected >= 0)
    along = (rays[..., 3:] @ views.extrinsics[2, 2, :3])[same]
    np.testing.assert_allclose(seen.depth[same], cast["t_hit"].numpy()[same] * along, rtol=1e-4)
    # Weights belong to the position on the screen.
    places = np.einsum("pk,pki->pi", seen.weights[same], screen[faces[seen.face[same]], :2])
    rows, columns = np.nonzero(same)
    np.testing.assert_allclose(places, np.column_stack([columns, rows]) + 0.5, atol=1e-8)


def test_faces_behind_the_camera_or_of_zero_area_are_not_drawn():
    screen = np.array([[1.0, 1, -2], [8, 1, -2], [1, 8, -2], [1, 1, 2], [5, 5, 2], [8, 8, 2]])
    scene = Scene(screen, np.array([[0, 1, 2], [3, 4, 5]]), np.ones((2, 3)), 8, 8, 4.0)
    assert (rasterise(scene).face == -1).all() and not SoftDrawn.of(
        scene._replace(faces=scene.faces[:1]), 1e-3, 0.1
    ).image.any()


def test_gradients_of_colours_are_sums_over_their_pixels():
    scene, rng = random_scene(), np.random.default_rng(0)
    drawn, slope = HardDrawn.of(scene), rng.normal(size=(16, 20, 4))
    of_screen, of_colors = drawn.backward(slope)

    def value(colors):
        return (HardDrawn.of(scene._replace(colors=colors)).image * slope).sum()

    np.testing.assert_allclose(of_colors, slopes_of(value, scene.colors, 1e-3), atol=1e-9)
    assert not of_screen.any()


# -- the soft image ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_the_soft_image_and_its_gradient_match_plain_tensors(seed):
    scene, rng = random_scene(seed=seed), np.random.default_rng(seed)
    sigma, gamma = 0.02, 0.2
    drawn, slope = SoftDrawn.of(scene, sigma, gamma), rng.normal(size=(16, 20, 4))
    screen, colors = (torch.tensor(array).requires_grad_() for array in (scene.screen, scene.colors))
    image = plain_soft_image(screen, scene.faces, colors, 20, 16, scene.far, sigma * 100, gamma)
    np.testing.assert_allclose(drawn.image, image.detach(), atol=1e-12)
    (image * torch.tensor(slope)).sum().backward()
    of_screen, of_colors = drawn.backward(slope)
    np.testing.assert_allclose(of_colors, colors.grad, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(of_screen, screen.grad, rtol=1e-8, atol=1e-8)
    assert np.abs(of_screen[:, 2]).max() > 1e-3  # depths have a gradient too


def test_without_blur_the_soft_image_approaches_the_plain_one():
    scene = random_scene(20, 40, 32)
    plain = HardDrawn.of(scene).image
    off = [np.abs(SoftDrawn.of(scene, sigma, 1e-4).image - plain) for sigma in (1e-3, 1e-5, 1e-9)]
    assert off[0][..., 3].mean() > 3 * off[1][..., 3].mean() > 9 * off[2][..., 3].mean()
    assert off[2].mean() < 1e-3


def test_the_gradient_of_a_soft_mesh_matches_finite_differences():
    views, (vertices, faces) = views_of_a_square(6, 26), square(9, 22)
    vertices = vertices + 0.01 * np.random.default_rng(0).normal(size=vertices.shape)
    gallery = Gallery(views, faces, SoftRasterizer(sigma=0.01, gamma=0.1).draw, 1.0)
    far = gallery.draw(vertices, normals_of(vertices, faces), 0).scene.far

    def value(moved):
        gallery_of = Gallery(views, faces, lambda s: SoftDrawn.of(s._replace(far=far), 0.01, 0.1), 1.0)
        return gallery_of.look(moved, np.array([0]))[0]

    np.testing.assert_allclose(
        gallery.look(vertices, np.array([0]))[1], slopes_of(value, vertices, 1e-7), rtol=1e-3, atol=1e-5
    )


# -- approximate gradients ---------------------------------------------------------------------------------------------


def test_gradients_of_a_single_surface_sum_to_those_of_the_image():
    # Weights sum to 1, and at a boundary both pixels move with the surface: in total, dI = -(dI/dx) dx.
    rng = np.random.default_rng(0)
    screen = np.array([[5.2, 3.1, 2], [16.3, 6.2, 2.1], [7.7, 13.4, 2.2]])
    scene = Scene(screen, np.array([[0, 1, 2]]), rng.random((1, 3)), 20, 16, 4.0)
    drawn, slope = DifferencesDrawn.of(scene), rng.normal(size=(16, 20, 4))
    of_screen = drawn.backward(slope)[0]
    for axis, along in ((0, 1), (1, 0)):
        n = drawn.image.shape[along]
        first, second = (np.take(slope, range(k, n - 1 + k), along) for k in (0, 1))
        expected = -(0.5 * (first + second) * np.diff(drawn.image, axis=along)).sum()
        assert of_screen[:, axis].sum() == pytest.approx(expected, rel=1e-9)
    assert not of_screen[:, 2].any()


def test_at_an_occlusion_boundary_only_the_surface_in_front_moves():
    screen = np.array([[-9.0, -9, 3], [60, -9, 3], [-9, 60, 3], [4, 4, 2], [15, 5, 2], [6, 14, 2]])
    scene = Scene(screen, np.array([[0, 1, 2], [3, 4, 5]]), np.array([[0.2] * 3, [0.9] * 3]), 20, 16, 4.0)
    of_screen = DifferencesDrawn.of(scene).backward(np.random.default_rng(0).normal(size=(16, 20, 4)))[0]
    assert not of_screen[:3].any() and (np.abs(of_screen[3:, :2]) > 0).all()


def test_a_pixel_pulls_an_edge_of_its_row_inversely_to_its_distance():
    screen = np.array([[2.6, 2, 2], [10, 2, 2], [10, 10, 2]])
    scene = Scene(screen, np.array([[0, 1, 2]]), np.ones((1, 3)), 20, 16, 4.0)
    slope = np.zeros((16, 20, 4))
    slope[5, 13, 3] = -1  # should be covered: 3.5 pixels from the edge, 3.5 of 8 below its upper end
    of_screen = ScanLineDrawn.of(scene).backward(slope)[0]
    expected = np.zeros((3, 3))
    expected[1, 0], expected[2, 0] = -(4.5 / 8) / 3.5, -(3.5 / 8) / 3.5
    np.testing.assert_allclose(of_screen, expected, atol=1e-12)
    assert not ScanLineDrawn.of(scene).backward(-slope)[0].any()  # a move that increases the loss has no gradient
    slope[5, 13, 3], slope[5, 8, 3] = 0, 1  # should not be covered: the edges on both sides move inward
    of_screen = ScanLineDrawn.of(scene).backward(slope)[0]
    assert (
        of_screen[:, 0].sum() == pytest.approx(1 / 1.5 - 1 / (8.5 - (2.6 + 7.4 * 3.5 / 8)))
        and (of_screen[1:, 0] != 0).all()
    )


@pytest.mark.parametrize("method", [SoftRasterizer(sigma=0.01), NeuralMeshRenderer(), Opendr()])
@pytest.mark.parametrize("shift", [-2, 2])
def test_a_square_is_pulled_to_its_target(method, shift):
    vertices, faces = square(8, 24)
    gradient = Gallery(views_of_a_square(8 + shift, 24 + shift), faces, method.draw, 1.0).look(vertices, np.array([0]))[
        1
    ]
    assert np.sign(gradient[:, 0].sum()) == -np.sign(shift)
    assert abs(gradient[:, 0].sum()) > 5 * abs(gradient[:, 1].sum())


def test_shading_has_no_gradient_for_a_silhouette():
    vertices, faces = square(8, 24)
    for target in (views_of_a_square(4, 28), views_of_a_square(12, 20)):
        assert not Gallery(target, faces, Paparazzi().draw, 1.0).look(vertices, np.array([0]))[1].any()
        assert Gallery(target, faces, Opendr().draw, 1.0).look(vertices, np.array([0]))[1].any()


def test_the_loss_and_its_derivative_match_torch():
    rng = np.random.default_rng(0)
    image, wanted = rng.random((5, 4, 4)), rng.random((5, 4, 4))
    wanted[..., 3] = wanted[..., 3] > 0.5
    free, other = torch.tensor(image).requires_grad_(), torch.tensor(wanted)
    colors = ((free - other)[..., :3].abs() * other[..., 3:]).mean()
    expected = colors + 0.7 * ((free - other)[..., 3] ** 2).mean()
    expected.backward()
    loss, slope = image_loss(image, wanted, 0.7)
    assert loss == pytest.approx(expected.item(), rel=1e-12)
    np.testing.assert_allclose(slope, free.grad, atol=1e-15)
