"""The shipped weights of the upsamplers: their headers, sizes and usefulness."""

from pathlib import Path

import numpy as np
import pytest

from bench import Case, PointCloud, Run, generator
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.plugins.registry import registry
from bench.plugins.schema import parameters
from bench.plugins.weights import FACTS, facts_of, load, shipped

METHODS = Path(__file__).resolve().parents[3] / "methods"
FILES = sorted(METHODS.glob("*/weights/*.safetensors"))
# The training data of methods for meshes; methods for clouds were trained on the mixture of families.
TRAINED_ON = {
    "neural_cages": "furniture[category=chair,same_parts=False]",
    "neural_cages_tables": "furniture[category=table,same_parts=False]",
    "character_cages": "humanoids[characters=body]",
}
LEARNED = ("mpu", "pu_net", "ec_net", "grad_pu")


def plugin_and_values(name):
    plugin = registry().find("method", name)
    return plugin, parameters(plugin, plugin.cls())


def test_all_together_are_small():
    assert FILES and sum(file.stat().st_size for file in FILES) < 15e6


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_header_describes_the_training(file):
    facts = facts_of(file)
    assert set(facts) >= set(FACTS) - {"examples"}
    assert facts["cases"] == len(facts["shapes"]) > 8
    assert facts["dataset"] == TRAINED_ON.get(file.stem, "detailed")
    assert facts["steps"] > 0 and facts["cpu_seconds"] > 60 and len(facts["curve"]) > 5
    plugin, _ = plugin_and_values(facts["method"])
    assert set(facts["parameters"]) <= set(plugin.cls.trained_by)
    assert all(
        array.dtype in (np.float32, np.int32, np.int64) and np.isfinite(array).all() for array in load(file).values()
    )


@pytest.mark.parametrize("name", LEARNED)
def test_the_defaults_have_weights(name):
    assert shipped(*plugin_and_values(name)) in FILES


@pytest.fixture(scope="module")
def sparse():
    """A test shape, not used in any training, as 625 points with noise of 0.25 %."""
    bumps = registry().find("dataset", "bumps").cls()
    shape, frame = next(iter(bumps.shapes("test"))).framed()
    rng = generator("shipped")
    points = sample_poisson_disk(shape, 625, rng)[0] + rng.normal(scale=0.0025, size=(625, 3))
    return Case("bumps", {"cloud": PointCloud(points), "ratio": 4}, shape, frame)


@pytest.mark.parametrize("name", LEARNED)
def test_they_are_nearer_to_the_truth_than_random_points(name, sparse):
    """Four times as many points: better than noise of the spacing, the result of untrained networks."""
    plugin, values = plugin_and_values(name)
    run = Run(weights=load(shipped(plugin, values)), threads=1)
    output = plugin.cls().upsample(**sparse.input, run=run)
    assert len(output) == 2500
    even = registry().find("metric", "even_distances").cls()
    scores = even.score(output, sparse)
    twice = PointCloud(np.repeat(sparse.input["cloud"].points, 4, axis=0))
    assert scores["even_chamfer_l2_sum"] < 0.6 * even.score(twice, sparse)["even_chamfer_l2_sum"]
