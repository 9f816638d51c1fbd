"""A scan for trials: a subsample of it, two halves of that, and its measured state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..errors import BadInput
from ..geometry.cloud import Frame, PointCloud
from ..geometry.neighbours import curve_order
from ..geometry.normals import disagreement, estimate_normals
from ..geometry.spacing import mean_spacing
from ..seeds import generator

LEAST = 100  # the minimum number of points to halve a scan
NEIGHBOURS = 8  # behind a local density, as in bench.geometry.conditions
FAR_OFF = 3.0  # times as far from its neighbours as the median point: an outlier
NORMAL_MEDIAN = 0.6745  # median |x| of a normal variable with standard deviation 1


class State(NamedTuple):
    """The measures of a scan, without ground truth."""

    noise: float
    """standard deviation of the distances to the planes of the neighbourhoods, from their median, in mean spacings"""
    outliers: float
    """share of the points that are three times as far from their eighth neighbour as the median point is"""
    density_variation: float
    """standard deviation over mean of the area that eight neighbours take up"""
    normals: float
    """1 where the scan has normals, 0 where it has none"""
    contradicting: float
    """share of the normals that point opposite to their neighbours; 0 without normals"""


@dataclass(frozen=True, eq=False)
class Scan:
    """One scan, in the frame in which it has radius 1.

    Attributes
    ----------
    name : str
    total : int
        How many points the file has.
    cloud : PointCloud
        The subsample for trials.
    second : (n,) bool array
        Which points of the subsample belong to the second half.
    outlier : (n,) bool array
        Which of them are outliers, see :attr:`State.outliers`.
    spacing : float
        Mean distance between neighbours in the subsample.
    state : State
    """

    name: str
    total: int
    cloud: PointCloud
    second: np.ndarray
    outlier: np.ndarray
    spacing: float
    state: State
    frame: Frame = field(default_factory=Frame)

    def half(self, which: int) -> PointCloud:
        """The first half (0) or the second (1)."""
        return taken(self.cloud, self.second == bool(which))


def taken(cloud: PointCloud, chosen: np.ndarray) -> PointCloud:
    """The points of a cloud that a mask or indices choose, with their normals and colours."""
    return PointCloud.of({name: array[chosen] for name, array in cloud.arrays().items()})


def scan_of(name: str, cloud: PointCloud, frame: Frame, points: int, seed: int) -> Scan:
    """Subsample a cloud and halve it, both at random.

    Parameters
    ----------
    name : str
    cloud : PointCloud in the frame
    frame : what it was scaled by
    points : int
        How many are tried at most; 0 for all.
    seed : int

    Raises
    ------
    BadInput
        If fewer than :data:`LEAST` points differ.
    """
    total = len(cloud)
    _, first = np.unique(cloud.points, axis=0, return_index=True)
    if len(first) < LEAST:
        raise BadInput(f"{name}: {len(first)} different points; a recommendation needs {LEAST} at least")
    rng = generator(seed, "recommend")
    if points and len(first) > points:
        first = rng.choice(first, points, replace=False)
    cloud = taken(cloud, np.sort(first))
    cloud = taken(cloud, curve_order(cloud.points))  # estimates of planes are much faster along a curve
    second = rng.permutation(len(cloud)) % 2 == 1
    state, outlier = state_of(cloud)
    return Scan(name, total, cloud, second, outlier, mean_spacing(cloud.points[~outlier]), state, frame)


def reach_of(tree: cKDTree) -> np.ndarray:
    """The distance of each point of a tree from its eighth neighbour, (n,)."""
    return tree.query(tree.data, [NEIGHBOURS + 1])[0][:, 0]


def state_of(cloud: PointCloud) -> tuple[State, np.ndarray]:
    """The measured state of a cloud, and which of its points are outliers, an (n,) bool array."""
    points = cloud.points
    reach = reach_of(cKDTree(points))
    outlier = reach > FAR_OFF * np.median(reach)
    kept = points[~outlier]
    area = reach[~outlier] ** 2
    flattened = estimate_normals(kept).flattened
    noise = float(np.median(np.linalg.norm(flattened - kept, axis=1))) / NORMAL_MEDIAN
    return State(
        noise=noise / mean_spacing(kept),
        outliers=float(outlier.mean()),
        density_variation=float(area.std() / area.mean()),
        normals=float(cloud.normals is not None),
        contradicting=0.0 if cloud.normals is None else float(disagreement(points, cloud.normals)),
    ), outlier
