"""From evidence to ranks: significant differences and ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..seeds import generator
from .evidence import PATCHES, Evidence

DRAWS = 400
TINY = 1e-12
LEVEL = 0.95
ALIKE = 0.01  # scores that differ by less than this share are tied: the evidence is no more exact
TRUST = 4  # a method with twice the distance to held-out points has a sixteenth of the weight in judging the others
CRITERIA = ("to_mesh", "to_points", "others", "halves", "gaps")
# What counts of them, together. Distances to the nearest point of a sample have its spacing in them, which is several
# times what methods differ by: they are there to see surfaces that no point supports. Gaps count 4.5 times the share
# of the surface that is hidden.
PARTS = np.array([[0.75, 0.25, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 4.5]])


@dataclass(frozen=True, eq=False)
class Verdict:
    """The ranks of k methods.

    Attributes
    ----------
    score : (k,) array
        Over all scans, relative to the best method, which has 1.
    low, high : (k,) int arrays
        The interval of a method's rank: 1 + how many are significantly better, and k - how many it is significantly
        better than.
    criteria : (k, 5) array
        The distances of :data:`CRITERIA`, in radii; geometric means over the scans: of held-out points to the mesh, of
        the mesh to held-out points, to the other methods' meshes, between the meshes of the two halves, and of the
        mesh to the points of gaps, over the scans that have gaps (0 where none has).
    """

    score: np.ndarray
    low: np.ndarray
    high: np.ndarray
    criteria: np.ndarray

    @property
    def order(self) -> np.ndarray:
        """(k,) int array: the methods, best first."""
        return np.argsort(self.score, kind="stable")


def verdict(found: Sequence[Evidence], families: Sequence[str], seed: int) -> Verdict:
    """Rank k methods by the evidence from one or several scans.

    The score of a method on a scan is the sum of distances: that to the held-out points, of which three quarters are
    that of the points to the mesh; the mean chamfer distance to other methods' meshes, weighted by how near these are
    to the held-out points; and, where a share of the surface is hidden, 4.5 times that share of the distance between
    the mesh and the points of gaps (two thirds of it from the points). Over several scans the geometric mean counts,
    since a hard scan has larger distances. The distance of the two halves is reported and does not count: methods that
    smooth too much are the most repeatable of all. The weights were chosen on train shapes
    (scripts/recommend_study.py).

    A Bayesian bootstrap gives the certainty of a difference (Rubin, *Ann. Statist.* 9, 1981): patches, scans and the
    three parts get random weights. A method is significantly better than another if its score is a hundredth less in
    95 % of the draws.

    Parameters
    ----------
    found : evidence of the same k methods, one for each scan
    families : k names
        Methods of one family, as Poisson at two depths, have one vote together and do not judge each other, unless
        there is no other family.
    seed : int
    """
    rng, names = generator(seed, "verdict"), np.asarray(families)
    judges = (names[:, None] != names) / (names[:, None] == names).sum(axis=0)  # each family has one vote
    if not judges.any(axis=1).all():
        judges = 1 - np.eye(len(names))
    parts = np.stack([_parts(e, judges, np.ones((1, PATCHES)))[0] for e in found])
    counts = np.stack([PARTS * [[1], [1], [e.hidden]] for e in found])  # (scans, parts, criteria)
    score = np.log(np.einsum("skc,spc->sk", parts, counts)).mean(axis=0)
    drawn = np.stack([_parts(e, judges, rng.exponential(size=(DRAWS, PATCHES))) for e in found])
    of_scans, of_parts = rng.exponential(size=(DRAWS, len(found))), rng.exponential(size=(DRAWS, len(PARTS)))
    of_scans /= of_scans.sum(axis=1, keepdims=True)
    scores = np.einsum("ds,sdk->dk", of_scans, np.log(np.einsum("sdkc,spc,dp->sdk", drawn, counts, of_parts)))
    better = (scores[:, :, None] + ALIKE < scores[:, None]).mean(axis=0) >= LEVEL
    return Verdict(
        np.exp(score - score.min()),
        1 + better.sum(axis=0),
        len(score) - better.sum(axis=1),
        _over_scans(parts, found),
    )


def _over_scans(parts: np.ndarray, found: Sequence[Evidence]) -> np.ndarray:
    """Geometric means over scans of (scans, k, 5) distances; that to gaps over the scans that have some."""
    means = np.exp(np.log(parts).mean(axis=0))
    some = parts[[e.hidden > 0 for e in found], :, -1]
    means[:, -1] = np.exp(np.log(some).mean(axis=0)) if len(some) else 0.0
    return means


def _parts(found: Evidence, judges: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The distances of :data:`CRITERIA` under weights of the patches (draws, patches): a (draws, k, 5) array."""

    def mean(sums: np.ndarray) -> np.ndarray:
        total = np.einsum("...sp,dp->ds...", sums, weights)
        return total[:, 0] / np.maximum(total[:, 1], TINY)

    to_mesh, to_points = mean(found.to_mesh), mean(found.to_points)
    gaps = (2 * mean(found.gap_to_mesh) + mean(found.gap_to_points)) / 3
    held = to_mesh + to_points + PARTS[-1, -1] * found.hidden * gaps
    apart = mean(found.apart)
    apart = (apart + apart.transpose(0, 2, 1)) / 2
    trust = judges / (held[:, None] / held.min(axis=1)[:, None, None]) ** TRUST
    others = (trust * apart).sum(axis=2) / trust.sum(axis=2)
    return np.maximum(np.stack([to_mesh, to_points, others, mean(found.halves), gaps], axis=2), TINY)
