"""The noise of a cloud, for parameters whose best value depends on it."""

from __future__ import annotations

import numpy as np

from bench import PointCloud

from .inputs import distinct_oriented

NEIGHBOURS = 8
ON_ONE_SIDE = 0.7  # least cosine of two normals for their points to count as neighbours on the surface
QUERIES = 10_000  # points whose neighbourhoods are used; more change the median in the third digit
ROUGHNESS = 0.35  # of the angle between neighbouring normals, in radians: the residual of rough detail over the spacing
FITTED = (16, 32, 64, 128)  # points of a quadric
FLAT = 0.4  # of the size of a neighbourhood: for more noise a larger one is used
FITS = 2000  # quadrics, at most
WALLS = 0.5  # mean spacings: the residual of thin walls
NORMAL_MEDIAN = 0.6745  # median |x| of a normal variable with standard deviation 1


def noise_of(cloud: PointCloud, method: str, at_least: int) -> float:
    """:func:`noise_to_spacing` of a cloud, with estimated normals if it has none; see :func:`distinct_oriented`."""
    points, normals, _ = distinct_oriented(cloud, method, at_least)
    return noise_to_spacing(points, normals)


def noise_to_spacing(points: np.ndarray, normals: np.ndarray) -> float:
    """The standard deviation of the noise along the normals over the distance between neighbours.

    For two points p, q of a smooth surface and their normals m, n, ``(m + n) . (p - q)`` vanishes up to third
    order in their distance: it is exactly zero on a sphere. The residual is the independent noise of the two
    points. Its median over pairs of neighbours with similar normals is robust to edges, to the other side of a thin
    sheet and to outliers. Rough detail finer than the spacing leaves a residual too, but its normals differ: the share
    :data:`ROUGHNESS` of the median angle between neighbours is subtracted (measured on fractional Brownian motion
    without noise, the roughest train family). With estimated normals such detail counts as noise.

    Parameters
    ----------
    points : (n, 3) array, all different
    normals : (n, 3) array of unit length

    Returns
    -------
    float
        0 without noise; about 0.1, 0.2 and 0.4 for noise of 0.5, 1 and 2 % of the radius on 5,000 points.
    """
    from scipy.spatial import cKDTree

    count = len(points)
    chosen = np.arange(count) if count <= QUERIES else np.linspace(0, count - 1, QUERIES).astype(int)
    distance, neighbour = cKDTree(points).query(points[chosen], min(NEIGHBOURS + 1, count))
    distance, neighbour = distance[:, 1:], neighbour[:, 1:]
    spacing = float(np.median(distance[:, :6].mean(axis=1)))
    m, n = normals[chosen][:, None], normals[neighbour]
    cosine = np.einsum("ijk,ijk->ij", np.broadcast_to(m, n.shape), n)
    similar = cosine > ON_ONE_SIDE
    if not similar.any():
        return 0.0
    between = (m + n)[similar] / np.sqrt(2 + 2 * cosine[similar])[:, None]
    offsets = np.abs(np.einsum("ik,ik->i", between, (points[chosen][:, None] - points[neighbour])[similar]))
    noise = float(np.median(offsets)) / (NORMAL_MEDIAN * np.sqrt(2)) / spacing
    turn = np.sqrt(max(2 - 2 * float(np.median(cosine[similar])), 0.0))
    return float(np.sqrt(max(noise**2 - (ROUGHNESS * turn) ** 2, 0.0)))


def noise_without_normals(points: np.ndarray) -> float:
    """The standard deviation of the noise, in the unit of the points, without any normals.

    A quadric is fitted to the nearest points of each of some points; the residual beyond six degrees of freedom is
    noise and, if walls are as near as neighbours, their other side. From its median the share :data:`WALLS` of the
    spacing is subtracted, in squares (as a leg of a right triangle): the residual of thin shapes without noise
    (measured on the train shapes of branches and furniture). If the noise is large relative to the neighbourhoods,
    larger ones are used.

    Parameters
    ----------
    points : (n, 3) array, all different

    Returns
    -------
    float
        Between half and all of the noise if it is larger than the spacing; 0 if it cannot be distinguished from thin
        walls, and for fewer than 16 points.
    """
    from scipy.spatial import cKDTree

    from bench.geometry.spacing import mean_spacing

    tree, spacing, noise = cKDTree(points), mean_spacing(points), 0.0
    chosen = points[np.unique(np.linspace(0, len(points) - 1, FITS).astype(int))]
    for count in FITTED:
        if count > len(points):
            break
        noise, reach = _left_by_quadrics(points[tree.query(chosen, count)[1]])
        if noise < FLAT * reach:
            break
    return float(np.sqrt(max(noise**2 - (WALLS * spacing) ** 2, 0.0)))


def _left_by_quadrics(near: np.ndarray) -> tuple[float, float]:
    """The residual of quadrics in neighbourhoods (n, k, 3), and the size of these; both are medians."""
    near = near - near.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    height, u, v = np.moveaxis(np.einsum("nki,nij->nkj", near, axes), -1, 0)
    reach = np.sqrt((u**2 + v**2).mean(axis=1, keepdims=True))
    u, v = u / np.maximum(reach, 1e-300), v / np.maximum(reach, 1e-300)
    quadrics = np.linalg.qr(np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2))[0]
    left = height - np.einsum("nkt,nt->nk", quadrics, np.einsum("nkt,nk->nt", quadrics, height))
    variance = np.median((left**2).sum(axis=1)) / (near.shape[1] - 6)
    return float(np.sqrt(variance)), float(np.median(reach))
