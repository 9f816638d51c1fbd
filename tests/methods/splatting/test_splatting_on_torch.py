"""The renderer in torch operations, against the compiled one, which is tested against a plain one."""

from __future__ import annotations

import weakref
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from splat_scenes import ball, crooked_camera, random_splats
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from bench.methods.splatting.fitting.views import Gallery, Lights
from bench.methods.splatting.renderer import differentiable
from bench.methods.splatting.renderer.drawn import draw as compiled
from bench.methods.splatting.renderer.settings import Drawing
from bench.methods.splatting.torch_renderer.differentiable import render
from bench.methods.splatting.torch_renderer.drawn import draw, draw_arrays
from bench.methods.splatting.torch_renderer.ragged import add_rows, parts, spread

DEVICES = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])
SETTINGS = {
    "as it is": {},
    "no culling": {"cull": False},
    "one layer": {"layers": 1},
    "two layers": {"layers": 2},
    "three layers": {"layers": 3},
    "four layers": {"layers": 4},
    "all in front": {"depth_limit": 10.0},
    "thin layers": {"depth_limit": 1e-3},
    "wide": {"cutoff": 3.0, "blur": 0.4},
    "no occlusion": {"occlusion": False, "epsilon": 1e-5},
    "pixel by pixel": {"opening": 0.0},
    "pixel by pixel, no occlusion": {"opening": 0.0, "occlusion": False},
    "large blocks": {"opening": 1.0},
    "small window": {"window": 5.0},
    "window": {"window": 12.0, "opening": 1.0},
    "window, pixel by pixel": {"window": 12.0, "opening": 0.0},
    "wide window": {"window": 30.0},
    "gaussians": {"gradient": "rbf"},
    "gaussians, no culling": {"gradient": "rbf", "cull": False, "layers": 3},
}
SCENES = {
    "random": (random_splats(60), crooked_camera()),
    "ball": (ball(250), crooked_camera(61, 53)),
}


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def some_gradient(image, seed=1):
    """A gradient of an image, zero at some pixels."""
    rng = np.random.default_rng(seed)
    gradient = rng.normal(size=image.shape)
    gradient[rng.random(gradient.shape[:2]) < 0.2] = 0
    return gradient


def assert_close(found, expected, relative, size=None):
    """Equal up to a fraction of the largest number (of ``size``, if given)."""
    assert found.shape == expected.shape
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=relative * np.abs(expected if size is None else size).max()
    )


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("scene", SCENES)
def test_images_and_gradients_match_the_compiled_renderer(scene, settings, device):
    (splats, camera), how = SCENES[scene], Drawing(**settings)
    expected = compiled(*splats, camera, how)
    found = draw_arrays(*splats, camera, how, device, torch.float64)
    for name, mine, wanted in zip(expected.ellipses._fields, found.ellipses, expected.ellipses, strict=True):
        shown = expected.ellipses.shown
        np.testing.assert_allclose(*((mine, wanted) if name == "shown" else (mine[shown], wanted[shown])), rtol=1e-9)
    for mine, wanted in zip(found.lists, expected.lists, strict=True):
        np.testing.assert_allclose(mine, wanted, rtol=1e-9)
    np.testing.assert_allclose(found.image, expected.image, atol=1e-12)
    np.testing.assert_allclose(found.total, expected.total, rtol=1e-9)
    np.testing.assert_array_equal(found.covered, expected.covered)
    np.testing.assert_array_equal(found.occlusions(), expected.occlusions())
    gradient = some_gradient(expected.image)
    assert_close(found.attribute_gradient(gradient), expected.attribute_gradient(gradient), 1e-9)
    by_position = expected.position_gradient(gradient)
    assert_close(found.position_gradient(gradient), by_position, 1e-9)
    for mine, wanted in zip(found.weight_gradients(gradient), expected.weight_gradients(gradient), strict=True):
        assert_close(mine, wanted, 1e-9, by_position)  # 0 up to rounding for single layers
    assert np.abs(by_position).max() > 0


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("settings", [{}, {"window": 12.0}, {"opening": 0.0}, {"gradient": "rbf"}])
def test_the_size_of_chunks_changes_nothing(settings, device):
    (splats, camera), how = SCENES["ball"], Drawing(**settings)
    whole = draw_arrays(*splats, camera, how, device, torch.float64)
    gradient = some_gradient(whole.image)
    exact = whole.position_gradient(gradient)
    for pairs in (1, 3000):
        found = draw_arrays(*splats, camera, how, device, torch.float64, pairs)
        if pairs > 1:  # otherwise each splat is a chunk, and the gradient would take long
            assert_close(found.position_gradient(gradient), exact, 1e-10)
        for mine, wanted in zip(found.lists, whole.lists, strict=True):
            np.testing.assert_array_equal(mine, wanted)
        np.testing.assert_array_equal(found.image, whole.image)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("kind", ["dss", "rbf"])
def test_single_precision_is_accurate(kind, device):
    (splats, camera), how = SCENES["ball"], Drawing(gradient=kind, weights=True)
    expected = compiled(*splats, camera, how)
    found = draw_arrays(*splats, camera, how, device, torch.float32)
    assert found.drawn.image.dtype == torch.float32 and found.image.dtype == np.float64
    # A pixel on the boundary of a splat may be on either side, so a few may differ.
    assert (np.abs(found.image - expected.image).max(axis=2) > 1e-4).mean() < 1e-3
    gradient = some_gradient(expected.image)
    assert_close(found.attribute_gradient(gradient), expected.attribute_gradient(gradient), 1e-4)
    wanted = expected.position_gradient(gradient)
    off = np.abs(found.position_gradient(gradient) - wanted).max(axis=1) / np.abs(wanted).max()
    assert (off > 1e-4).mean() < 0.01 and off.max() < 1e-2
    for mine, wanted in zip(found.weight_gradients(gradient), expected.weight_gradients(gradient), strict=True):
        assert_close(mine, wanted, 1e-4)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_results_are_repeatable(dtype, device):
    splats, camera = SCENES["ball"]
    found = []
    for _ in range(2):
        drawn = draw_arrays(*splats, camera, Drawing(), device, dtype)
        gradient = some_gradient(drawn.image)
        found.append([drawn.image, drawn.position_gradient(gradient), drawn.attribute_gradient(gradient)])
        found[-1] += drawn.weight_gradients(gradient)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("device", DEVICES)
def test_equally_deep_splats_keep_their_order(device):
    points, normals = np.zeros((7, 3)), np.tile([0.0, 0, -1], (7, 1))
    colors = np.arange(7.0)[:, None]
    how = Drawing(layers=4)
    expected = compiled(points, normals, colors, 0.2, crooked_camera(), how)
    for dtype in (torch.float32, torch.float64):
        for pairs in (None, 1):
            found = draw_arrays(points, normals, colors, 0.2, crooked_camera(), how, device, dtype, pairs)
            np.testing.assert_array_equal(found.lists.index, expected.lists.index)
    assert expected.lists.index.max() == 3


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("count", [0, 1])
def test_empty_clouds_and_points_behind_the_camera_give_empty_images(count, device):
    points, normals = np.full((count, 3), [0.0, 0, -9]), np.full((count, 3), [0.0, 0, 1])
    for how in (Drawing(cull=False), Drawing(gradient="rbf")):
        drawn = draw_arrays(points, normals, np.ones((count, 2)), 0.1, crooked_camera(), how, device)
        assert drawn.image.shape == (20, 24, 2) and not drawn.image.any() and not drawn.covered.any()
        slope = -np.ones((20, 24, 2))
        for gradient in (drawn.position_gradient(slope), *drawn.weight_gradients(slope)):
            assert gradient.shape == (count, 3) and not gradient.any()
        assert not drawn.attribute_gradient(slope).any() and drawn.occlusions().shape == (count,)


@pytest.mark.parametrize("device", DEVICES)
def test_a_zero_gradient_of_the_image_gives_zero_gradients(device):
    splats, camera = SCENES["random"]
    drawn = draw_arrays(*splats, camera, Drawing(), device)
    for found in (drawn.position_gradient(0 * drawn.image), drawn.attribute_gradient(0 * drawn.image)):
        assert not found.any()


# -- memory and devices ------------------------------------------------------------------------------------------------


class Memory(TorchDispatchMode):
    """Bytes of existing tensors, and their maximum."""

    def __init__(self):
        super().__init__()
        self.users, self.now, self.most = Counter(), 0, 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        out = func(*args, **(kwargs or {}))
        for tensor in tree_leaves(out):
            if isinstance(tensor, torch.Tensor):
                memory = (tensor.untyped_storage().data_ptr(), tensor.untyped_storage().nbytes())
                self.now += memory[1] * (not self.users[memory])
                self.users[memory] += 1
                weakref.finalize(tensor, self.forget, memory)
        self.most = max(self.most, self.now)
        return out

    def forget(self, memory):
        self.users[memory] -= 1
        self.now -= memory[1] * (not self.users[memory])


@pytest.mark.parametrize("settings", [{"opening": 0.0}, {}, {"gradient": "rbf", "cutoff": 0.2}], ids=str)
def test_the_memory_stays_below_half_of_all_pairs(settings):
    (splats, camera), how = (ball(1000), crooked_camera(64, 64)), Drawing(**settings)
    tensors = [torch.from_numpy(each) for each in splats]
    with Memory() as memory:
        drawn = draw(*tensors, camera, how, pairs=16384)
        drawn.position_gradient(torch.from_numpy(some_gradient(drawn.image)))
    all_pairs = int(drawn.ellipses.shown.sum()) * 64 * 64
    assert 1e5 < memory.most < 0.5 * 16 * all_pairs  # two numbers of 8 bytes per pair


@pytest.mark.parametrize("kind", ["dss", "rbf"])
def test_all_tensors_are_made_on_the_device_of_the_points(kind):
    """Tensors created without a device would be on another one, and fail."""
    splats, camera = SCENES["random"]
    tensors = [torch.from_numpy(each) for each in splats]
    gradient = torch.ones(20, 24, 3)
    with torch.device("meta"):
        drawn = draw(*tensors, camera, Drawing(gradient=kind, window=9.0))
        found = [drawn.position_gradient(gradient), drawn.attribute_gradient(gradient)]
        found += [*drawn.weight_gradients(gradient), drawn.occlusions()]
        image, _ = render(tensors[0].requires_grad_(), *tensors[1:], camera, Drawing(weights=True))
        image.square().sum().backward()
    assert {each.device.type for each in (*found, drawn.image, tensors[0].grad)} == {"cpu"}


# -- building blocks ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [1, 3, 10, 100])
def test_chunks_contain_all_lists_in_order(limit):
    counts = torch.tensor([3, 0, 2, 2, 9, 0, 0, 1])
    found = list(parts(counts, limit))
    assert [i for some in found for i in range(len(counts))[some]] == list(range(8))
    assert all(counts[some].sum() <= limit or some.stop - some.start == 1 for some in found)


def test_lists_are_spread():
    which, place = spread(torch.tensor([2, 0, 3]))
    assert which.tolist() == [0, 0, 2, 2, 2] and place.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("device", DEVICES)
def test_sums_of_integers_do_not_depend_on_the_order(device):
    rng = np.random.default_rng(0)
    values, index = rng.normal(size=(5000, 3)) * [1, 1e-6, 1e6], rng.integers(0, 7, 5000)
    expected = np.zeros((7, 3))
    np.add.at(expected, index, values)
    found = []
    for order in (np.arange(5000), rng.permutation(5000)):
        into = torch.zeros(7, 3, dtype=torch.float64, device=device)
        known = (torch.from_numpy(each[order]).to(device) for each in (index, values))
        add_rows(into, *known, fixed=True)
        found.append(into.cpu().numpy())
    np.testing.assert_array_equal(*found)
    assert_close(found[0] / [1, 1e-6, 1e6], expected / [1, 1e-6, 1e6], 1e-10)


# -- use by others -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("cull", [True, False])
def test_gradients_in_torch_match_the_compiled_renderer(cull, device):
    (points, normals, colors, sigma), camera = SCENES["random"]
    how, gradient = Drawing(weights=True, cull=cull), some_gradient(np.zeros((20, 24, 3)))
    found = []
    for function, where in ((differentiable.render, "cpu"), (render, device)):
        tensors = [torch.tensor(each, device=where, requires_grad=True) for each in (points, 2 * normals, colors)]
        image, _ = function(*tensors, torch.from_numpy(sigma), camera, how)
        (image * torch.tensor(gradient, device=where)).sum().backward()
        found.append([image.detach().cpu(), *(each.grad.cpu() for each in tensors)])
    for expected, mine in zip(*found, strict=True):
        assert_close(mine.numpy(), expected.numpy(), 1e-9 if device == "cpu" else 1e-3)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("of_normals", [True, False])
def test_a_gallery_gives_the_same_loss_and_gradient(of_normals, device):
    class OnDevice(Gallery):
        def draw(self, points, normals, sigma, view):
            colors, _ = self.shaded(normals, view)
            camera = self.cameras[view]
            return draw_arrays(points, normals, colors, sigma, camera, self.how, device, torch.float64)

    (points, normals, _, sigma), camera = SCENES["ball"]
    points = points.copy()
    points.flags.writeable = False  # like the arrays of a cloud
    lights = Lights(np.eye(3)[None] * -1, np.eye(3)[None] * 0.9, np.full((1, 3), 0.1))
    wanted = np.roll(compiled(points, normals, 0.5 + 0.5 * normals, sigma, camera).image, 4, axis=1)[None]
    arguments = ([camera], wanted, lights, replace(Drawing(), weights=True, window=20.0), 1)
    looks = [kind(*arguments).look(points, normals, sigma, np.arange(1), of_normals) for kind in (Gallery, OnDevice)]
    assert looks[1].loss == pytest.approx(looks[0].loss, rel=1e-9)
    assert_close(looks[1].gradient, looks[0].gradient, 1e-9)
    np.testing.assert_array_equal(looks[1].hidden, looks[0].hidden)
