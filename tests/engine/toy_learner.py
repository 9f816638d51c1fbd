"""A learned method in numpy alone: it learns one number per axis, slowly, in steps that can be interrupted."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bench import PointCloud, Run, TrainingData, UsageError, register


@register("method", requires=("safetensors",))
@dataclass(frozen=True)
class ToyLearner:
    """Moves points by what it learned, which is how far the training clouds are off centre."""

    trained_by: ClassVar[tuple[str, ...]] = ("steps", "rate", "pause", "fail")
    examples_by: ClassVar[tuple[str, ...]] = ("fail",)

    steps: int = 200
    rate: float = 0.1
    pause: float = 0.0  # seconds a step takes
    scale: float = 1.0  # of what is learned; free to change
    fail: str = ""  # where to fail: examples, fit, exit, hang, nan

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """The centroid of each training cloud, and the hash of its points."""
        if self.fail == "examples":
            raise UsageError("the examples cannot be made")
        if log := os.environ.get("TOY_LEARNER_LOG"):
            with open(log, "a") as file:
                file.write(f"examples {os.getpid()}\n")
        return {"centroids": np.array([case.input["cloud"].points.mean(axis=0) for case in data.cases])}

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """Gradient descent on the mean, with noise that depends on the step."""
        if log := os.environ.get("TOY_LEARNER_LOG"):
            with open(log, "a") as file:
                file.write(f"fit {os.getpid()}\n")
        if self.fail == "fit":
            raise UsageError("the fit cannot be made")
        if self.fail == "exit":
            os._exit(3)
        if self.fail == "hang":
            time.sleep(1000)
        state = dict(run.resumed or {"shift": np.zeros(3), "step": np.int64(0)})
        shift, target = state["shift"].copy(), examples["centroids"].mean(axis=0)
        for step in range(int(state["step"]), self.steps):
            noise = np.random.default_rng([run.seed, step]).normal(scale=0.01, size=3)
            shift -= self.rate * (shift - target + noise)
            time.sleep(self.pause)
            error = float(np.abs(shift - target).max())
            run.log(step, loss=error, **({"validation": error} if step % 10 == 0 else {}))
            run.progress(step + 1, self.steps)
            run.checkpoint(lambda step=step, shift=shift: {"shift": shift.copy(), "step": np.int64(step + 1)})
            if run.seconds_left() <= 0:
                break
        return {"shift": shift.astype(np.float32) * (np.nan if self.fail == "nan" else 1)}

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The points, moved."""
        run.parameters = 3
        return PointCloud(cloud.points - self.scale * run.weights["shift"])
