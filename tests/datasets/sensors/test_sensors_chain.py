"""Chains match their steps and refuse mistakes early; presets match their comments."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from hydra import compose
from omegaconf import OmegaConf

from bench import PointCloud, Shape, UsageError, Views, generator
from bench.contract.sensors import given_by, noun_of
from bench.datasets.sensors.chain import Chain
from bench.datasets.sensors.gaussian import Gaussian
from bench.datasets.sensors.holes import Holes
from bench.datasets.sensors.uniform import Uniform
from bench.plugins.registry import registry
from bench.plugins.schema import build, defaults
from bench.sweep.composition import CONFIG_NAME, hydra_ready

BALL = Shape("ball", trimesh.creation.icosphere(3)).framed()[0]
BOX = Shape("box", trimesh.creation.box((1, 2, 3))).framed()[0]
PRESETS = sorted(
    f.name.removesuffix(".yaml") for f in (files("bench.conf") / "sensor").iterdir() if f.suffix == ".yaml"
)
SENSORS = registry().names("sensor")


@pytest.fixture(scope="module")
def composed():
    """The sensor of every preset, as the engine makes it."""
    with hydra_ready():
        nodes = {name: compose(CONFIG_NAME, overrides=[f"sensor={name}"]).sensor for name in PRESETS}
    values = {name: OmegaConf.to_container(node, resolve=True) for name, node in nodes.items()}
    return {name: build(registry().find("sensor", v["_name_"]), v) for name, v in values.items()}


def test_a_chain_matches_its_steps():
    steps = [{"uniform": {"count": 300}}, {"gaussian": {"sigma": 0.02}}, {"holes": {"count": 3, "radius": 0.3}}]
    cloud = Chain(steps=tuple(steps)).sense(BALL, generator(7))
    first, second, third = generator(7).spawn(3)
    by_hand = Uniform(count=300).sense(BALL, first)
    by_hand = Gaussian(sigma=0.02).spoil(by_hand, BALL, second)
    by_hand = Holes(count=3, radius=0.3).spoil(by_hand, BALL, third)
    assert np.array_equal(cloud.points, by_hand.points) and np.array_equal(cloud.normals, by_hand.normals)


def test_a_chain_of_one_step_and_of_a_lone_effect():
    assert len(Chain(steps=("uniform",)).sense(BALL, generator(0))) == 5000
    alone = Chain(steps=({"gaussian": {"sigma": 0.0}},)).sense(BALL, generator(0))
    assert len(alone) == 5000
    assert np.array_equal(alone.points, Gaussian(sigma=0.0).sense(BALL, generator(0).spawn(1)[0]).points)


def test_steps_draw_independently_of_earlier_steps():
    """Another count or noise in the middle does not move the holes."""

    def missing(*middle):
        chain = Chain(steps=({"uniform": {"count": 20_000}}, *middle, {"holes": {"count": 1, "radius": 0.5}}))
        cloud = chain.sense(BALL, generator(1))
        return cloud.points.mean(axis=0)

    assert missing({"gaussian": {"sigma": 0.0}}) == pytest.approx(missing("normals_none"), abs=1e-12)
    assert missing({"gaussian": {"sigma": 0.01}}) == pytest.approx(missing("normals_none"), abs=0.01)


def test_a_chain_names_its_plugins():
    chain = Chain(steps=("uniform", "laplace", {"normals_none": None}))
    assert [plugin.name for plugin in chain.plugins] == ["uniform", "laplace", "normals_none"]
    assert Chain().plugins[0].kind == "sensor"


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ((), "expected at least one"),
        ("uniform", r"expected a list, got 'uniform'; write \[uniform\]"),
        (("unifrom",), "Did you mean 'uniform"),
        (("uniform", "gausian"), "number 2.*Did you mean 'gaussian'"),
        (("uniform", {"gaussian": {"sigm": 1.0}}), "number 2.*Did you mean 'sigma'"),
        (("uniform", {"gaussian": {"sigma": -1.0}}), "number 2.*sigma: expected 0 or more"),
        (("uniform", "poisson_disk"), "number 2, poisson_disk, makes a new cloud.*Effects: .*gaussian"),
        (("uniform", {"gaussian": {}, "laplace": {}}), "number 2"),
        (("uniform", {"gaussian": [1]}), "the parameters of gaussian"),
    ],
)
def test_wrong_steps_are_refused_when_the_chain_is_made(steps, message):
    with pytest.raises(ValueError, match=message):
        Chain(steps=steps)
    if not isinstance(steps, str):
        with pytest.raises(UsageError, match=message):
            build(registry().find("sensor", "chain"), {"steps": list(steps)})


# Parameters of each sensor with values that must be refused, one at a time.
REFUSED = [
    ("uniform", {"count": 0}, "count"),
    ("density_gradient", {"ratio": 0.5}, "ratio"),
    ("density_gradient", {"direction": (0, 0, 0)}, "direction"),
    ("density_gradient", {"direction": (1, 0)}, "direction"),
    ("voxel_thinned", {"voxel": 0.0}, "voxel"),
    ("gaussian", {"sigma": float("inf")}, "sigma"),
    ("uniform_noise", {"amplitude": -1.0}, "amplitude"),
    ("outliers_box", {"fraction": 1.0}, "fraction"),
    ("outliers_ray", {"distance": 1.0}, "distance"),
    ("outliers_clustered", {"clusters": 0}, "clusters"),
    ("half_space", {"keep": 0.0}, "keep"),
    ("view_subset", {"lowest": 10.0, "highest": 5.0}, "highest"),
    ("normals_flip", {"fraction": 1.5}, "fraction"),
    ("normals_noise", {"degrees": 91.0}, "degrees"),
    ("depth_camera", {"distance": 1.0}, "distance"),
    ("depth_camera", {"views": 0}, "views"),
    ("depth_camera", {"resolution": 1}, "resolution"),
    ("depth_camera", {"max_points": 2}, "max_points"),
    ("triangulation", {"baseline": 0.0}, "baseline"),
    ("triangulation", {"misrotation": -1.0}, "misrotation"),
    ("kinect", {"max_angle": 90.0}, "max_angle"),
    ("stereo", {"field": 180.0}, "field"),
    ("time_of_flight", {"flying": 2.0}, "flying"),
    ("lidar", {"azimuth_step": 0.0}, "azimuth_step"),
]


@pytest.mark.parametrize(("name", "values", "parameter"), REFUSED)
def test_bad_parameters_are_named(name, values, parameter):
    with pytest.raises(ValueError, match=f"^{parameter}: expected"):
        registry().find("sensor", name).cls(**values)


@pytest.mark.parametrize(
    ("name", "word"), [("gaussian", "unit"), ("depth_camera", "rig"), ("triangulation", "normals")]
)
def test_unknown_choices_are_refused(name, word):
    with pytest.raises(ValueError, match=f"^{word}: expected one of"):
        registry().find("sensor", name).cls(**{word: "nonsense"})


def test_the_output_of_sensors_and_its_class():
    found = registry()
    assert {p.name for p in found.all("sensor") if given_by(p, p.cls()) != "cloud"} == {
        "rig",
        "pixel_noise",
        "mask_errors",
        "view_few",
        "camera_noise",
    }
    rig, chain = found.find("sensor", "rig"), found.find("sensor", "chain")
    over_rig = Chain(steps=({"rig": {"views": 2}},))
    assert [given_by(chain, sensor) for sensor in (Chain(), over_rig)] == ["cloud", "views"]
    assert [noun_of(p, s) for p, s in ((chain, Chain()), (chain, over_rig), (rig, rig.cls()))] == [
        PointCloud,
        Views,
        Views,
    ]
    own = replace(rig, options={"gives": "depth_maps"})
    assert noun_of(own, object()) is None and noun_of(own, SimpleNamespace(noun=dict)) is dict
    with pytest.raises(ValueError, match="number 2, gaussian, works on cloud, but the first step, rig, gives views"):
        Chain(steps=("rig", "gaussian"))
    with pytest.raises(ValueError, match="number 2, rig, makes new views; only the first may"):
        Chain(steps=("samples", "rig"))


def test_every_sensor_has_help_for_every_parameter():
    from bench.plugins.fields import field_help

    for plugin in registry().all("sensor"):
        assert [name for name, text in field_help(plugin.cls).items() if not text] == [], plugin.name
        assert build(plugin, defaults(plugin)) == plugin.cls()


# -- presets -----------------------------------------------------------------------------------------------------------


def test_no_preset_hides_a_plugin_and_each_has_a_comment():
    assert not set(PRESETS) & set(SENSORS)
    for name in PRESETS:
        text = (files("bench.conf") / "sensor" / f"{name}.yaml").read_text()
        assert text.startswith("# ") and max(map(len, text.splitlines())) <= 120, name


def test_every_preset_composes(composed):
    assert set(composed) == set(PRESETS)
    assert {"clean", "noisy", "scanned", "outliers", "with_holes", "no_normals"} <= set(composed)


@pytest.mark.parametrize(
    ("preset", "count", "sigma"),
    [
        ("clean", 5000, 0.0),
        ("noisy", 5000, 0.01),
        ("mpu_625", 625, 0.0025),
        ("mpu_5000", 5000, 0.0025),
        ("idf_40k_002", 40_000, 0.002),
        ("idf_40k_005", 40_000, 0.005),
        ("no_normals", 5000, 0.005),
    ],
)
def test_presets_have_their_count_and_their_noise(composed, preset, count, sigma):
    cloud = composed[preset].sense(BOX, generator(0))
    assert len(cloud) == count
    distance = np.linalg.norm(cloud.points - BOX.surface.closest(cloud.points)[0], axis=1)
    assert np.sqrt((distance**2).mean()) == pytest.approx(sigma, rel=0.06, abs=1e-9)
    assert (cloud.normals is None) == (preset == "no_normals")


def test_the_noise_of_dss_is_relative_to_the_diagonal(composed):
    diagonal = np.linalg.norm(np.ptp(BOX.mesh.vertices, axis=0))
    for name, count, noise, bound in (("20k_1pct", 20_000, 0.01, 0.00841), ("100k_03pct", 100_000, 0.003, 0.00252)):
        text, shipped = composed[f"dss_{name}"].steps, composed[f"dss_{name}_shipped"].steps
        assert text[0] == shipped[0] == {"poisson_disk": {"count": count}}
        assert text[1] == {"gaussian": {"sigma": noise, "unit": "diagonal"}}
        assert shipped[1] == {"uniform_noise": {"amplitude": bound, "unit": "diagonal"}}
        moved = Gaussian(sigma=noise, unit="diagonal").spoil(Uniform().sense(BOX, generator(0)), BOX, generator(1))
        assert (moved.points - Uniform().sense(BOX, generator(0)).points).std() == pytest.approx(
            noise * diagonal, rel=0.03
        )


def test_virtual_scans_share_their_viewpoint_and_grow_in_resolution(composed):
    scans = [composed[f"mpu_scan_{r}"].sense(BOX, generator(0)) for r in (56, 79, 112)]
    assert np.array([len(b) / len(a) for a, b in zip(scans, scans[1:], strict=False)]) == pytest.approx(2, rel=0.06)
    for scan in scans:
        # From one viewpoint at most three faces of a box are visible, the same in all scans.
        faces = {tuple(n) for n in np.round(scan.normals, 6)}
        assert len(faces) <= 3 and faces == {tuple(n) for n in np.round(scans[0].normals, 6)}
        distance = np.linalg.norm(scan.points - BOX.surface.closest(scan.points)[0], axis=1)
        assert distance.max() <= 0.002 * np.sqrt(3)
        assert np.sqrt((distance**2).mean()) == pytest.approx(0.002 / np.sqrt(3), rel=0.06)


def test_the_preset_scanned_resembles_a_good_scan(composed):
    for shape in (BALL, BOX):
        cloud = composed["scanned"].sense(shape, generator(0))
        assert 5000 <= len(cloud) <= 10_000
        closest, normals = shape.surface.closest(cloud.points)
        assert 0.001 < np.sqrt(((cloud.points - closest) ** 2).sum(axis=1).mean()) < 0.01
        assert np.degrees(np.arccos(np.clip((cloud.normals * normals).sum(axis=1), -1, 1))).mean() < 15
