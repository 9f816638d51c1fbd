"""Points as the centres of a Gaussian mixture, moved along filtered normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bench import PointCloud, Run, register

from .inputs import distinct_oriented
from .isolated import put_back, without_isolated
from .noise import noise_to_spacing

FILTERINGS = 5  # of the normals in a round
WIDE = 2.0  # ratio of the Gaussians' deviation to that of the heights; with 1, points stop at the next mode
SMALL = 1e-12  # of the size of the cloud: smaller heights are rounding


@register("method", cite="after Lu et al. 2018", requires=("scipy",))
@dataclass(frozen=True)
class Gpf:
    """GPF-like: points are the centres of a Gaussian mixture of the input, and move along bilaterally filtered normals.

    Written from the idea of the paper (Lu et al. 2018, "GPF"), whose code was not released; results may differ from it.
    The input are data, the output the centres of flat Gaussians. E: a datum belongs to the centres around it by its
    distances to their planes, exp(-(n . (p - q))^2 / 2 s^2), so one beyond an edge belongs to those there. M: a centre
    moves along its normal by the mean height of its data, and s is measured again. Centres push each other apart within
    their planes, as in WLOP. Ours: normals are estimated again from the output of a round, weights of data fall with
    the distance and with the angle between normals, and heights are those over the planes of both.
    """

    k: int | None = None  # neighbours; more smooth more; None: by the noise, 16 to 96
    angle: float = 25.0  # degrees between normals at which their weight is exp(-1)
    rounds: int = 2  # of estimating and filtering normals, and then moving points
    iterations: int = 5  # of E and M in a round
    repulsion: float = 0.3  # 0 for none, 1 for as far as the neighbours are apart

    def __post_init__(self) -> None:
        if self.k is not None and self.k < 4:
            raise ValueError(f"k: expected at least 4, got {self.k}")
        if not 0 < self.angle <= 90:
            raise ValueError(f"angle: expected degrees above 0 and up to 90, got {self.angle}")
        for name in ("rounds", "iterations"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if not 0 <= self.repulsion <= 1:
            raise ValueError(f"repulsion: expected a number from 0 to 1, got {self.repulsion}")

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has, in its order, with the filtered normals; isolated ones stay."""
        rest, kept = without_isolated(cloud, "gpf", run)
        data, normals, inverse = distinct_oriented(rest, "gpf", at_least=10)
        k = min(neighbours_for(data, normals) if self.k is None else self.k, len(data) - 1)
        points = data
        for done in range(self.rounds):
            if done:
                normals = estimated_again(points, normals, k)
            normals = filtered_normals(points, normals, k, self.angle)
            points = self._moved(points, data, normals, k, run)
            run.progress(done + 1, self.rounds)
            run.trace(PointCloud(points[inverse]))
            if not run.time_for_more():
                break
        return put_back(cloud, kept, points[inverse], normals[inverse])

    def _moved(self, points: np.ndarray, data: np.ndarray, normals: np.ndarray, k: int, run: Run) -> np.ndarray:
        """The centres after some iterations: (n, 3). Datum i has the normal of centre i, which started there."""
        for _ in range(self.iterations):
            if not run.time_for_more():
                break
            nearby = around(data, points, normals, k, self.angle)
            shares, heights = expectation(points, data, normals, nearby)
            points = points + (shares * heights).sum(axis=1, keepdims=True) * normals
            if self.repulsion:
                points = points + self.repulsion * pushed_apart(points, normals)
        return points


def neighbours_for(points: np.ndarray, normals: np.ndarray) -> int:
    """The number of neighbours, by the noise of these points (n, 3) with unit normals."""
    return int(np.clip(16 * np.exp(4 * noise_to_spacing(points, normals)), 16, 96))


class Nearby(NamedTuple):
    """The data around centres."""

    indices: np.ndarray
    """(n, k) int array"""
    weights: np.ndarray
    """(n, k) float64 array: by distance and by the angle between normals"""


def around(data: np.ndarray, points: np.ndarray, normals: np.ndarray, k: int, angle: float) -> Nearby:
    """The k data (m, 3) nearest each centre (n, 3), n = m, and their weights; the normals are those of both."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(data).query(points, np.arange(1, k + 1))
    radius = np.maximum(distance[:, -1:], 1e-300)
    near = np.exp(-((2 * distance / radius) ** 2) / 2)
    return Nearby(index, near * alike(normals, index, angle))


def alike(normals: np.ndarray, index: np.ndarray, angle: float) -> np.ndarray:
    """The weights of neighbours (n, k) by their normals: exp(-((1 - n . m) / (1 - cos angle))^2)."""
    cosine = np.einsum("ni,nki->nk", normals, normals[index])
    return np.exp(-(((1 - cosine) / (1 - np.cos(np.radians(angle)))) ** 2))


def expectation(
    points: np.ndarray, data: np.ndarray, normals: np.ndarray, nearby: Nearby
) -> tuple[np.ndarray, np.ndarray]:
    """The share of each datum in each centre, and the heights of the data.

    The deviation of the Gaussians is twice that of all heights, not that of the shares: with as many centres as data,
    each centre would settle on its start, and the deviation on 0.

    Parameters
    ----------
    points, data, normals : (n, 3) arrays
    nearby : Nearby

    Returns
    -------
    shares : (n, k) array
        Of the data of a centre; they add up to 1.
    heights : (n, k) array
        Of the data over the planes of the centres: the mean by the centre's normal and by that of the datum, which is
        0 on a sphere, where the mean height over the plane alone would let it shrink.
    """
    index, weights = nearby
    between = (normals[:, None] + normals[index]) / 2
    heights = np.einsum("nki,nki->nk", data[index] - points[:, None], between)
    deviation = WIDE * float(np.sqrt((weights * heights**2).sum() / max(weights.sum(), 1e-300)))
    likely = weights * np.exp(-0.5 * (heights / max(deviation, SMALL * float(np.abs(data).max()))) ** 2)
    of_datum = np.bincount(index.ravel(), likely.ravel(), minlength=len(data))
    belongs = likely / np.maximum(of_datum[index], 1e-300)
    total = belongs.sum(axis=1, keepdims=True)
    return np.where(total > 0, belongs / np.maximum(total, 1e-300), 0.0), heights


def filtered_normals(points: np.ndarray, normals: np.ndarray, k: int, angle: float) -> np.ndarray:
    """Normals (n, 3) after bilateral filtering: means over similar normals of the k nearest points."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(points).query(points, np.arange(1, k + 1))
    near = np.exp(-((2 * distance / np.maximum(distance[:, -1:], 1e-300)) ** 2) / 2)
    for _ in range(FILTERINGS):
        mean = np.einsum("nk,nki->ni", near * alike(normals, index, angle), normals[index])
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        normals = np.where(length > 1e-9, mean / np.maximum(length, 1e-300), normals)
    return normals


def estimated_again(points: np.ndarray, normals: np.ndarray, k: int) -> np.ndarray:
    """Normals (n, 3) of planes through k points, with the signs of the old ones."""
    from bench.geometry.normals import estimate_normals

    distinct, inverse = np.unique(points, axis=0, return_inverse=True)
    fresh = estimate_normals(distinct, max(8, k // 2)).normals[inverse.ravel()]
    return np.where((fresh * normals).sum(axis=1, keepdims=True) < 0, -fresh, fresh)


def pushed_apart(points: np.ndarray, normals: np.ndarray, neighbours: int = 8) -> np.ndarray:
    """The displacements (n, 3) of points (n, 3) away from their nearest ones within their planes.

    The mean of the directions, weighted towards nearer points, times the shortfall of the distances from the typical
    one.
    """
    from scipy.spatial import cKDTree

    k = min(neighbours + 1, len(points))
    distance, index = cKDTree(points).query(points, np.arange(2, k + 1))
    away = points[:, None] - points[index]
    away -= np.einsum("nki,ni->nk", away, normals)[..., None] * normals[:, None]
    wanted = np.median(distance, axis=1, keepdims=True)
    lacks = np.maximum(wanted - distance, 0)
    length = np.linalg.norm(away, axis=2)
    step = (away / np.maximum(length, 1e-300)[..., None] * lacks[..., None]).sum(axis=1) / distance.shape[1]
    return step - (step * normals).sum(axis=1, keepdims=True) * normals
