"""MyPlugin: say in a line what the method does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, PointCloud, Run, register


@register("method", cite="Whom to cite, and the year", requires=("scipy",))
@dataclass(frozen=True)
class MyPlugin:
    """Move every point to the mean of its neighbours (replace this by your method)."""

    neighbours: int = 16  # how many nearest points the mean is taken over
    steps: int = 1  # how many times

    # A function named after a task says that the method solves it: reconstruct(self, cloud, run) -> Trimesh,
    # denoise(self, cloud, run) -> PointCloud, upsample(self, cloud, ratio, run) -> PointCloud.
    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The cloud with its points moved; its normals stay as they are."""
        from scipy.spatial import cKDTree  # heavy libraries are imported where they are used

        if len(cloud) < 2 or not np.isfinite(cloud.points).all():
            raise BadInput(f"my_plugin: expected at least 2 finite points, got {len(cloud)}")
        points = cloud.points
        for step in range(self.steps):
            neighbours = min(self.neighbours, len(points))
            _, nearest = cKDTree(points).query(points, k=neighbours, workers=run.threads)
            points = points[nearest].mean(axis=1)
            run.progress(step + 1, self.steps)
        return PointCloud(points, cloud.normals)
