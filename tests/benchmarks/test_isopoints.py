"""What new iso-points cost, in steps of the training that they serve (thesis 4.2.1: about three)."""

import os

import numpy as np
import torch
from turns import medians_by_turns

from bench import Run
from bench.geometry.spiral import golden_spiral
from bench.methods.isopoints.fitting.guide import GuidedSampler
from bench.methods.isopoints.siren_iso import SirenIso
from bench.methods.learned.training.loop import _step
from bench.methods.learned.training.settings import Training
from bench.plugins.presets import presets

ROUNDS = 2 if "DETAILBENCH_SHORT" in os.environ else 9
MOST_STEPS = 3
POINTS = 30_000  # of the cloud: an eighth as many iso-points


def test_new_iso_points(benchmark, capsys):
    """With the sizes of the thesis: 3 x 256, 5,000 points of the cloud and 5,000 of the space a step."""
    torch.set_num_threads(1)
    thesis = SirenIso(**presets("method")["siren_iso_thesis"].values)
    field = thesis.field(torch.Generator().manual_seed(0))
    unit = golden_spiral(POINTS)
    noise = np.random.default_rng(0).normal(scale=0.005, size=(POINTS, 1))
    sampler = thesis.sampler_of(field, 0.5 * unit * (1 + noise), unit, None, Run())
    assert isinstance(sampler, GuidedSampler)
    training = Training(steps=1, learning_rate=1e-4, clip=1.0)
    optimizer = field.optimizer(training)
    sampler._renew()  # from here on new ones begin at the last ones

    def step():
        _step(field, sampler.draw(), optimizer, 0.5, training)

    def extraction():
        sampler._renew()

    for _ in range(2):
        step()
    medians = medians_by_turns({"new": extraction, "step": step}, ROUNDS)
    steps = medians["new"] / medians["step"]
    benchmark.pedantic(extraction, rounds=1)
    benchmark.extra_info["steps"] = steps
    with capsys.disabled():
        print(f"\n{len(sampler.iso.points):,} new iso-points take as long as {steps:.1f} steps of the training")
    assert steps < MOST_STEPS
