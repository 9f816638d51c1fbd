"""Methods that fit a field to images, on a ball in closed form."""

import numpy as np
import pytest
import torch

from bench import BadInput, Run, Views
from bench.contract.ball_views import views_of_a_ball
from bench.methods.isopoints.idr import Idr
from bench.methods.isopoints.iso_curvature import IsoCurvature
from bench.methods.isopoints.iso_loss import IsoLoss
from bench.methods.isopoints.iso_points import IsoPoints
from bench.methods.isopoints.iso_uniform import IsoUniform
from bench.methods.isopoints.neus import Neus

SMALL = {"omega": 5.0, "width": 96, "views": 3, "samples": 100, "space": 50, "resolution": 24, "learning_rate": 1e-3}
POINTS = SMALL | {"points": 300, "most_points": 400, "refresh": 10}


def radii(mesh):
    return np.linalg.norm(mesh.vertices, axis=1)


@pytest.fixture(scope="module")
def views():
    return views_of_a_ball(6, 48)


def run():
    return Run(seed=0, threads=1)


@pytest.mark.parametrize(
    "method",
    [
        Idr(steps=20, **SMALL),
        IsoUniform(steps=20, **POINTS),
        IsoCurvature(steps=20, **POINTS),
        IsoLoss(steps=20, **POINTS),
        Neus(steps=30, **SMALL | {"samples": 60, "coarse": 12, "fine": 12}),
    ],
    ids=lambda method: method.name,
)
def test_a_sphere_grows_to_the_ball(method, views):
    """From radius 0.5 towards 1: the images determine the size and the normals."""
    mesh = method.multiview(views, run())
    assert mesh.is_watertight
    found = radii(mesh)
    assert abs(found.mean() - 1) < 0.25, found.mean()
    towards = (mesh.vertex_normals * mesh.vertices).sum(1) / found
    assert towards.mean() > 0.9


def test_the_same_seed_gives_the_same_mesh(views):
    method = IsoLoss(steps=4, **POINTS | {"refresh": 2})
    one, two = (method.multiview(views, run()) for _ in range(2))
    assert np.array_equal(one.vertices, two.vertices)


def test_without_lights_colours_are_learned(views):
    dark = Views(views.images, views.masks, views.extrinsics, views.intrinsics)
    method, told = IsoUniform(steps=10, **POINTS), run()
    mesh = method.multiview(dark, told)
    assert radii(mesh).mean() > 0.52
    assert told.parameters > 28_417 + 3 * 128  # the network and its colours
    with pytest.raises(BadInput, match=r"the views have no lights; use method.appearance=learned"):
        IsoUniform(steps=2, appearance="lights", **POINTS).multiview(dark, run())


def test_images_without_any_mask_are_refused(views):
    empty = Views(views.images, np.zeros_like(views.masks), views.extrinsics, views.intrinsics)
    with pytest.raises(BadInput, match="the masks of all 6 views are empty"):
        Idr(steps=2, **SMALL).multiview(empty, run())


def test_a_field_is_saved_trained_further_and_sampled(views, tmp_path):
    from bench.geometry.cloud import PointCloud

    path = str(tmp_path / "field.safetensors")
    slow = POINTS | {"learning_rate": 1e-4, "refresh": 5}
    first = IsoUniform(steps=5, save=path, **slow).multiview(views, run())
    again = IsoUniform(steps=0, load=path, **slow).multiview(views, run())
    assert np.array_equal(first.vertices, again.vertices)
    cloud = IsoUniform(steps=0, load=path, **slow).fit_shape(views, PointCloud(np.zeros((300, 3))), run())
    assert len(cloud) == 300 and cloud.normals is not None
    assert abs(np.linalg.norm(cloud.points, axis=1).mean() - radii(first).mean()) < 0.02
    further = IsoUniform(steps=5, load=path, **slow).multiview(views, run())
    assert not np.array_equal(further.vertices, first.vertices)
    with pytest.raises(BadInput, match="was saved by iso_uniform, not by idr"):
        Idr(steps=0, load=path, **SMALL).multiview(views, run())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"views": 0}, "views: expected at least 1, got 0"),
        ({"motion": "up"}, "motion: expected normal, ray, got 'up'"),
        ({"appearance": "red"}, "appearance: expected auto, lights, learned, got 'red'"),
        ({"surface": 1.0}, "surface: expected a number between 0 and 1, got 1.0"),
        ({"points": 500, "most_points": 400}, "most_points: expected at least 500, got 400"),
        ({"omega": 0}, "omega: expected more than 0, got 0"),
    ],
)
def test_wrong_parameters_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        IsoUniform(**changes)


# -- iso-points of fields ----------------------------------------------------------------------------------------------


def ball_cloud():
    from bench.geometry.cloud import PointCloud
    from bench.geometry.spiral import golden_spiral

    return PointCloud(3 * golden_spiral(400) + [5.0, 0, -2], golden_spiral(400))


def test_iso_points_of_a_saved_field_of_any_method(tmp_path):
    from bench.methods.implicit.siren import Siren

    path, cloud = str(tmp_path / "siren.safetensors"), ball_cloud()
    Siren(steps=40, omega=5.0, width=96, save=path, resolution=16, learning_rate=1e-3).reconstruct(cloud, run())
    found = IsoPoints(load=path, rounds=1).upsample(cloud, 2, run())
    assert len(found) == 800
    away = np.linalg.norm(found.points - [5.0, 0, -2], axis=1)
    assert abs(away.mean() - 3) < 0.1 and away.std() < 0.1
    assert ((found.normals * (found.points - [5.0, 0, -2])).sum(1) > 0).all()


def test_iso_points_fit_a_field_if_none_is_given():
    method = IsoPoints(of={"siren": {"steps": 40, "omega": 5.0, "width": 96, "learning_rate": 1e-3}}, rounds=1)
    assert len(method.denoise(ball_cloud(), run())) == 400
    assert [plugin.name for plugin in method.plugins] == ["siren"]


def test_iso_points_refuse_files_and_methods_without_a_field(tmp_path, views):
    with pytest.raises(ValueError, match="of: poisson does not fit a field to a cloud"):
        IsoPoints(of="poisson")
    path = str(tmp_path / "views.safetensors")
    IsoUniform(steps=2, save=path, **POINTS).multiview(views, run())
    with pytest.raises(BadInput, match="was saved by iso_uniform, whose field is not fitted to a cloud"):
        IsoPoints(load=path).denoise(ball_cloud(), run())
    with pytest.raises(BadInput, match="expected a safetensors file"):
        IsoPoints(load=str(tmp_path / "nothing.safetensors")).denoise(ball_cloud(), run())


def test_tensors_are_made_on_the_device_of_the_scene():
    """A scene on the device ``meta`` has no tensor on the CPU, so a GPU runs the same code."""
    from bench.methods.isopoints.images.scene import Scene

    scene = Scene(views_of_a_ball(2, 16), "meta")
    assert {scene.images.device.type, scene.masks.device.type, scene.centers.device.type} == {"meta"}
    view = torch.zeros(3, dtype=torch.long, device="meta")
    assert scene.rays(view, torch.zeros(3, 2, device="meta")).directions.device.type == "meta"
