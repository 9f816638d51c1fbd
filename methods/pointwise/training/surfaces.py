"""Training data of Points2Surf: points of shapes, and signed distances of queries near them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..queries.inputs import patches_of, wholes_of

if TYPE_CHECKING:
    from bench import Run, TrainingData

DENSE = 12_000  # points of a shape
PLACES = 4000  # places of a shape
OFFSETS = (0.003, 0.12)  # least and largest deviation of a place from the surface, in radii of the shape


def surfaces_of(data: TrainingData, run: Run) -> dict[str, np.ndarray]:
    """Points of each shape without noise, and places with their true signed distances.

    Returns
    -------
    dict
        ``points`` (shapes, DENSE, 3), ``places`` (shapes, PLACES, 3), ``distances`` (shapes, PLACES), negative inside;
        all float32.
    """
    from bench import generator
    from bench.geometry.signed_distance import signed_distances

    points, places, distances = [], [], []
    low, high = np.log(OFFSETS)
    for number, case in enumerate(data.cases):
        rng = generator(data.seed, case.id, "places")
        points.append(case.reference.surface.sample(DENSE, rng)[0])
        deviation = np.exp(rng.uniform(low, high, (PLACES, 1)))
        places.append(case.reference.surface.sample(PLACES, rng)[0] + deviation * rng.standard_normal((PLACES, 3)))
        distances.append(signed_distances(case.reference.mesh, places[-1]))
        run.progress(number + 1, data.count)
    named = {"points": points, "places": places, "distances": distances}
    return {name: np.stack(arrays).astype(np.float32) for name, arrays in named.items()}


class Batch(NamedTuple):
    """Queries of several clouds, each rotated at random; float32 arrays."""

    patches: np.ndarray
    """(b, size, 3): in radii of the patch"""
    wholes: np.ndarray
    """(b, subsample, 3): in radii of the cloud"""
    distances: np.ndarray
    """(b,): in radii of the patch, negative inside"""


class Surfaces:
    """The examples of :func:`surfaces_of`.

    Parameters
    ----------
    examples : mapping
    held_out : bool
        Take the last tenth of the shapes, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], held_out: bool = False):
        self.points, self.places, self.distances = (examples[name] for name in ("points", "places", "distances"))
        shapes = len(self.points)
        last = max(1, shapes // 10) if shapes > 1 else 0
        whole = range(shapes)
        self.shapes = list(whole[shapes - last :] if held_out and last else whole[: shapes - last])

    def queries(
        self,
        count: int,
        counts: tuple[int, int],
        noise: tuple[float, float],
        size: int,
        subsample: int,
        near: bool,
        rng: np.random.Generator,
    ) -> Batch:
        """``count`` queries of one random shape, sampled as a cloud of random density and noise, and rotated.

        Parameters
        ----------
        count : int
        counts : (int, int)
            The least and the largest number of points; log-uniform between them.
        noise : (float, float)
            Deviations, relative to the radius of the shape, likewise.
        size, subsample : int
            Points of patches and of wholes.
        near : bool
            See :func:`.inputs.wholes_of`.
        rng : numpy Generator
        """
        shape = int(rng.choice(self.shapes))
        many = round(float(np.exp(rng.uniform(*np.log(counts)))))
        points = self.points[shape][rng.choice(len(self.points[shape]), min(many, len(self.points[shape])), False)]
        deviation = np.float32(np.exp(rng.uniform(*np.log(noise))))
        points = points + deviation * rng.standard_normal(points.shape, dtype=np.float32)
        chosen = rng.choice(len(self.places[shape]), count, replace=False)
        turn = _turn(rng)
        points, places = points @ turn, self.places[shape][chosen] @ turn
        squared = ((points - places[:, None]) ** 2).sum(axis=2)
        taken = min(size, len(points))
        nearest = np.argpartition(squared, taken - 1, axis=1)[:, np.arange(size) % taken]
        patches, radii = patches_of(points, nearest, places)
        wholes = wholes_of(points, places, subsample, near, radius_of(points), rng)
        return Batch(patches, wholes, (self.distances[shape][chosen] / radii).astype(np.float32))


def radius_of(points: np.ndarray) -> float:
    """Half the diagonal of the box of points (n, 3): the unit of wholes."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) / 2 or 1.0


def _turn(rng: np.random.Generator) -> np.ndarray:
    """A rotation (3, 3) float32, or one with a reflection: all are equally likely."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    return (q * np.sign(np.diag(r))).astype(np.float32)
