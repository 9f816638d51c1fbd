"""Speed of the upsamplers: edge layers factored and as in the textbook, farthest points, a whole cloud."""

import os
import time

import numpy as np
import pytest
import torch

from bench import PointCloud, Run
from bench.geometry.farthest import farthest_points
from bench.methods.upsampling.mpu import Mpu
from bench.methods.upsampling.networks.dense_features import DenseBlock
from bench.methods.upsampling.networks.neighbours import gather, nearest_others

COUNTS = (5_000, 20_000, 80_000) if "DETAILBENCH_SHORT" in os.environ else (5_000, 20_000, 80_000, 320_000)


def textbook(block, x):
    """The layers on tiled edges of 48 and more channels, as they are written down."""
    c, b, n = x.shape
    index = nearest_others(x, block.neighbours)
    own = x[:, :, None].expand(c, b, index.shape[1], n)
    y, tiled = torch.cat([own, gather(x, index) - own]), own
    made = []
    for number, layer in enumerate(block.layers):
        value = (layer.weight @ y.reshape(len(y), -1) + layer.bias[:, None]).reshape(-1, b, index.shape[1], n)
        value = value if number == len(block.layers) - 1 else value.relu()
        made.insert(0, value)
        y = torch.cat([*made, tiled])
    return y.amax(2)


def seconds(call, repeats=3):
    """The least of some runs."""
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        found.append(time.perf_counter() - begin)
    return min(found)


def test_factored_edge_layers_are_faster(benchmark):
    torch.set_num_threads(1)
    block = DenseBlock(24, 12, 3, 32, torch.Generator().manual_seed(0))
    x = torch.randn(24, 8, 312, generator=torch.Generator().manual_seed(1))

    def step(forward):
        block.zero_grad()
        forward(x).square().sum().backward()

    torch.testing.assert_close(block(x), textbook(block, x), atol=1e-4, rtol=1e-4)
    ratio = seconds(lambda: step(lambda y: textbook(block, y))) / seconds(lambda: step(block))
    benchmark.pedantic(lambda: step(block), rounds=1)
    benchmark.extra_info["textbook over factored"] = ratio
    print(f"\nforward and backward of a dense block: {ratio:.2f} times as fast as on tiled edges")
    assert ratio > 1.2


def test_farthest_points_grow_like_sorting(benchmark):
    rng = np.random.default_rng(0)
    times = {}
    farthest_points(rng.normal(size=(100, 3)), 10)  # compiled
    for count in COUNTS:
        points = rng.normal(size=(3 * count, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        times[count] = seconds(lambda points=points, count=count: farthest_points(points, count), 1)
    benchmark.pedantic(lambda: farthest_points(points[:3000], 1000), rounds=1)
    table = ", ".join(f"{count:,}: {t:.2f} s" for count, t in times.items())
    print(f"\nfarthest points of three times as many: {table}")
    growth = times[COUNTS[-1]] / times[COUNTS[-2]]
    benchmark.extra_info["four times as many"] = growth
    assert growth < 8  # N log N is 4.6, N^2 is 16


@pytest.mark.study
def test_a_cloud_of_5000_points_sixteen_times(benchmark):
    import resource

    network = Mpu()
    generator = torch.Generator().manual_seed(0)
    weights = {name: tensor.numpy() for name, tensor in network._network(generator).state_dict().items()}
    points = np.random.default_rng(0).normal(size=(5000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    run = Run(weights=weights, threads=2)
    begin = time.perf_counter()
    output = benchmark.pedantic(lambda: network.upsample(PointCloud(points), 16, run), rounds=1)
    assert len(output) == 80_000
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"\n5,000 to 80,000 points: {time.perf_counter() - begin:.0f} s, peak {peak:.2f} GB")
