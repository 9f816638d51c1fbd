"""How evenly a cloud is spread, as PU-GAN measures it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Case, PointCloud, generator, register

SHARES = (0.004, 0.006, 0.008, 0.010, 0.012)  # of the tables of PU-GAN
NEIGHBOURS = 8  # of a point; the nearest one inside a disk is mostly among them


@register("metric", version=1, length=1, better="lower", outputs=("cloud",), floor=True, requires=("scipy",))
@dataclass(frozen=True)
class Uniformity:
    """Uniformity over disks of several sizes: deviation of the count times deviation of the spacing.

    For a share s of the reference's area A, disks of radius ``r = sqrt(s A / pi)`` around seeded points of the
    reference; S is the set of the n output points in a disk, ``n_hat = s N``, d the distance of each to its nearest
    neighbour in S, ``d_hat = sqrt(2 pi r^2 / (sqrt(3) n))`` the spacing of n points on a hexagonal lattice:
    ``uniformity@s = mean over disks of (n - n_hat)^2 / n_hat * mean (d - d_hat)^2 / d_hat``, in frame units. PU-GAN
    (Li et al. 2019), there with geodesic disks of 0.4 to 1.2 %. Here disks are Euclidean balls, as in PU-GAN's own
    loss: on thin sheets and near contacts they collect both sides.

    PU-GAN's script first projects the points to the mesh, and leaves out disks with fewer than five points: that is
    ``projected_uniformity``. Here points count where they are, and every disk counts: one with fewer than two points
    has d = r and the d_hat of n_hat points, since a hole must not count as even. The floor is that of uniform random
    points; a lattice or blue noise scores below it. It says nothing about the distance to the surface, and a little
    noise spreads random points and lowers it. A point far away is in no disk and counts only in N.
    """

    shares: tuple[float, ...] = SHARES  # areas of the disks as shares of the surface
    disks: int = 1000  # number of disks of each size

    def __post_init__(self) -> None:
        check_disks(self.shares, self.disks)

    def score(self, output: PointCloud, case: Case) -> dict[str, float]:
        """``uniformity@s`` for each share s: frame units."""
        if not len(output):
            return {f"uniformity@{share:g}": float("inf") for share in self.shares}
        disks = Disks(output.points, disk_centers(case, self.disks))
        area = case.compare(output).reference_area
        return {f"uniformity@{share:g}": float(np.mean(disks.unevenness(share, area)[1])) for share in self.shares}


def check_disks(shares: tuple[float, ...], disks: int) -> None:
    """Raise ValueError for invalid shares or an invalid number of disks."""
    if not shares or not all(0 < s < 1 for s in shares):
        raise ValueError(f"shares: expected numbers between 0 and 1, got {shares}")
    if disks < 1:
        raise ValueError(f"disks: expected at least 1, got {disks}")


def disk_centers(case: Case, disks: int) -> np.ndarray:
    """(disks, 3) uniform points of the reference, the same for every output of the case."""
    return case.reference.surface.sample(disks, generator(case.seed, case.id, "disks"))[0]


class Disks:
    """The points of a cloud around some centres, with the nearest neighbours of all points for all disks."""

    def __init__(self, points: np.ndarray, centers: np.ndarray):
        from scipy.spatial import cKDTree

        self.points, self.centers = points, centers
        self._tree = cKDTree(points)
        count = min(NEIGHBOURS + 1, len(points))  # one of them is the point itself
        distance, index = self._tree.query(points, count)
        self._distance, self._index = distance.reshape(-1, count), index.reshape(-1, count)
        self._is_inside = np.zeros(len(points), dtype=bool)

    def unevenness(self, share: float, area: float) -> tuple[np.ndarray, np.ndarray]:
        """Of each disk, how many points it holds, and the deviation of count times the deviation of spacing."""
        radius = np.sqrt(share * area / np.pi)
        expected = share * len(self.points)
        members = [np.asarray(m, dtype=int) for m in self._tree.query_ball_point(self.centers, radius)]
        counts = np.array([len(m) for m in members])
        return counts, np.array([self._one(m, radius, expected) for m in members])

    def _one(self, members: np.ndarray, radius: float, expected: float) -> float:
        count = len(members)
        imbalance = (count - expected) ** 2 / expected
        if count < 2:
            spacing, hexagonal = np.array([radius]), _hexagonal(radius, max(expected, 1))
        else:
            spacing, hexagonal = self._spacing(members), _hexagonal(radius, count)
        return float(imbalance * ((spacing - hexagonal) ** 2).mean() / hexagonal)

    def _spacing(self, members: np.ndarray) -> np.ndarray:
        """The distance of each member of a disk to the nearest other one: the first of its neighbours that is inside.

        A tree for each disk would give the same and takes ten times as long.
        """
        from scipy.spatial import cKDTree

        self._is_inside[members] = True
        neighbours = self._index[members]
        found = self._is_inside[neighbours] & (neighbours != members[:, None])
        self._is_inside[members] = False
        spacing = self._distance[members, found.argmax(axis=1)]
        alone = ~found.any(axis=1)  # at the rim: all its neighbours are outside
        if alone.any():
            inside = self.points[members]
            spacing[alone] = cKDTree(inside).query(inside[alone], 2)[0][:, 1]
        return spacing


def _hexagonal(radius: float, count: float) -> float:
    """The distance of neighbours when ``count`` points fill a disk as a hexagonal lattice."""
    return float(np.sqrt(2 * np.pi * radius**2 / (np.sqrt(3) * count)))
