"""From evidence to ranks: what is surely better, and what is tied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..seeds import generator
from .evidence import PATCHES, Evidence

DRAWS = 400
TINY = 1e-12
LEVEL = 0.95
TRUST = 4  # a method whose distance to held-out points is twice as large has a sixteenth of the say on the others
CRITERIA = ("held-out points", "other methods", "halves")


@dataclass(frozen=True, eq=False)
class Verdict:
    """The ranks of k methods.

    Attributes
    ----------
    score : (k,) array
        Over all scans, relative to the best method, which has 1.
    low, high : (k,) int arrays
        Between which ranks a method lies: 1 + how many are surely better, and k - how many it is surely better than.
    criteria : (k, 3) array
        The distances of :data:`CRITERIA`, in radii; geometric means over the scans. The last one is no part of the
        score.
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
    """Rank k methods by what one or several scans say of them.

    The score of a method on a scan is the sum of two chamfer distances: that to the held-out points, and the mean of
    those to other methods' meshes, weighted by how near these are to the held-out points. Over several scans the
    geometric mean counts, since a hard scan has larger distances. How far two halves are apart is reported and does
    not count: methods that smooth too much are the most repeatable of all.

    How sure a difference is, a Bayesian bootstrap says (Rubin, *Ann. Statist.* 9, 1981): patches, scans and the two
    parts of the score get random weights. A method is surely better than another if it is so in 95 % of the draws.

    Parameters
    ----------
    found : evidence of the same k methods, one for each scan
    families : k names
        Methods of one family, as Poisson at two depths, do not judge each other, unless there is no other family.
    seed : int
    """
    rng, names = generator(seed, "verdict"), np.asarray(families)
    judges = names[:, None] != names
    if not judges.any(axis=1).all():
        judges = ~np.eye(len(names), dtype=bool)
    parts = np.stack([_parts(e, judges, np.ones((1, PATCHES)))[0] for e in found])
    score = np.log(parts[:, :, :2].sum(axis=2)).mean(axis=0)
    drawn = np.stack([_parts(e, judges, rng.exponential(size=(DRAWS, PATCHES))) for e in found])
    of_scans, of_parts = rng.exponential(size=(DRAWS, len(found))), rng.exponential(size=(DRAWS, 2))
    of_scans /= of_scans.sum(axis=1, keepdims=True)
    scores = np.einsum("ds,sdk->dk", of_scans, np.log(np.einsum("sdkp,dp->sdk", drawn[..., :2], of_parts)))
    better = (scores[:, :, None] < scores[:, None]).mean(axis=0) >= LEVEL
    better &= score[:, None] < score
    return Verdict(
        np.exp(score - score.min()),
        1 + better.sum(axis=0),
        len(score) - better.sum(axis=1),
        np.exp(np.log(parts).mean(axis=0)),
    )


def _parts(found: Evidence, judges: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The distances of :data:`CRITERIA` under weights of the patches (draws, patches): a (draws, k, 3) array."""

    def mean(sums: np.ndarray) -> np.ndarray:
        total = np.einsum("...sp,dp->ds...", sums, weights)
        return total[:, 0] / np.maximum(total[:, 1], TINY)

    held = (mean(found.to_mesh) + mean(found.to_points)) / 2
    apart = mean(found.apart)
    apart = (apart + apart.transpose(0, 2, 1)) / 2
    trust = judges / (held[:, None] / held.min(axis=1)[:, None, None]) ** TRUST
    others = (trust * apart).sum(axis=2) / trust.sum(axis=2)
    return np.maximum(np.stack([held, others, mean(found.halves)], axis=2), TINY)
