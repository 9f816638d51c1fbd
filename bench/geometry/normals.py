"""Normals of a point cloud: estimated where there are none, and turned outward."""

from __future__ import annotations

import numpy as np

from ..errors import BadInput
from .cloud import PointCloud

NEIGHBOURHOODS = (16, 32, 64)  # numbers of neighbours that are tried, smallest first
FLATNESS = 0.05  # the thickness^2 / width^2 of a neighbourhood above which noise hides the tangent plane
GRAPH_NEIGHBOURS = 12  # along how many edges per point the orientation may travel
CHUNK = 20_000  # neighbourhoods decomposed at once, to bound the memory


def with_normals(cloud: PointCloud) -> PointCloud:
    """The cloud with a unit normal for every point.

    Normals that came with the cloud are kept, scaled to unit length; those that are zero or not finite are taken from
    the nearest point that has one. A cloud without any gets estimated, oriented normals.

    Raises
    ------
    BadInput
        If normals must be estimated and fewer than three points differ.
    """
    if cloud.normals is not None:
        lengths = np.linalg.norm(cloud.normals, axis=1)
        good = np.isfinite(lengths) & (lengths > 0)
        if good.any():
            normals = cloud.normals[_nearest(cloud.points, good)]
            return PointCloud(cloud.points, normals / np.linalg.norm(normals, axis=1, keepdims=True), cloud.colors)
    return PointCloud(cloud.points, oriented_normals(cloud.points), cloud.colors)


def oriented_normals(points: np.ndarray) -> np.ndarray:
    """Unit normals from the points alone, consistent over each connected piece, outward where a piece is closed.

    The number of neighbours grows with the noise, from 16 to 64, as long as that flattens the neighbourhoods.

    Parameters
    ----------
    points : (n, 3) array, finite; points that coincide get one normal

    Returns
    -------
    (n, 3) float64 array

    Raises
    ------
    BadInput
        If fewer than three points differ.
    """
    distinct, inverse = np.unique(points, axis=0, return_inverse=True)
    if len(distinct) < 3:
        raise BadInput(f"{len(points)} points, of which {len(distinct)} differ: normals need at least 3")
    normals, centroids, neighbours = estimate_normals(distinct)
    # On the fitted plane of its neighbourhood a point has lost most of its noise.
    offsets = np.einsum("ni,ni->n", distinct - centroids, normals)
    flattened = distinct - offsets[:, None] * normals
    return orient_normals(flattened, normals, neighbours[:, 1 : GRAPH_NEIGHBOURS + 1])[inverse.ravel()]


def estimate_normals(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unoriented normals by principal component analysis of the nearest neighbours (Hoppe et al. 1992).

    Returns
    -------
    normals : (n, 3) float64 array of unit length, of either sign
    centroids : (n, 3) float64 array, of the neighbourhoods
    neighbours : (n, k) int array, the point itself first
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    best, thickness = (), np.inf
    for k in NEIGHBOURHOODS:
        neighbours = tree.query(points, min(k, len(points)))[1]
        normals, centroids, flatness = _planes(points, neighbours)
        # Twice the neighbours halve the share of the noise; where they do not, it is curvature that they add.
        if np.median(flatness) > 0.75 * thickness:
            break
        best, thickness = (normals, centroids, neighbours), np.median(flatness)
        if thickness < FLATNESS or k >= len(points):
            break
    return best


def orient_normals(points: np.ndarray, normals: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    """Give normals consistent signs along a minimum spanning tree of the neighbour graph.

    Hoppe et al. 1992 carry the sign of ``n_i . n_j`` along an edge; König and Gumhold 2009 first reflect ``n_i`` across
    the edge, which is right at creases and across thin sheets but sensitive to noise. The reflected sign is used, and
    edges on which the two disagree are dear, so that the tree avoids them. A connected piece is then turned so that
    the volume that it encloses, as far as its samples are uniform, is positive (an inner wall, as of a hollow ball,
    would need the other sign).

    Parameters
    ----------
    points : (n, 3) array
    normals : (n, 3) array of unit length
    neighbours : (n, k) int array, the graph's edges

    Returns
    -------
    (n, 3) float64 array
    """
    start = np.repeat(np.arange(len(points)), neighbours.shape[1])
    end = neighbours.ravel()
    # One number for each edge: rows are a good deal slower to sort.
    i, j = np.divmod(np.unique(np.minimum(start, end) * len(points) + np.maximum(start, end)), len(points))
    i, j = i[i != j], j[i != j]

    along = points[j] - points[i]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    reflected = normals[i] - 2 * np.einsum("ei,ei->e", normals[i], along)[:, None] * along
    across = np.einsum("ei,ei->e", reflected, normals[j])
    direct = np.einsum("ei,ei->e", normals[i], normals[j])
    doubt = np.minimum(np.abs(across), np.abs(direct))
    cost = np.where(across * direct > 0, 1 - doubt, 1 + doubt)

    signs, piece = _signs_along_tree(len(points), i, j, cost, np.where(across < 0, -1.0, 1.0))
    normals = normals * signs[:, None]
    sizes = np.bincount(piece)
    centers = np.stack([np.bincount(piece, points[:, axis]) / sizes for axis in range(3)], axis=1)
    # Divergence theorem: 3 V = integral of p . n over the surface.
    volumes = np.bincount(piece, np.einsum("ni,ni->n", points - centers[piece], normals))
    return normals * np.where(volumes < 0, -1.0, 1.0)[piece, None]


def _signs_along_tree(
    count: int, i: np.ndarray, j: np.ndarray, cost: np.ndarray, flip: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The sign of every node, by multiplying ``flip`` along the cheapest tree of each piece; and the piece."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    # An edge that costs nothing would not be stored; the order of the others is not touched.
    tree = minimum_spanning_tree(coo_array((cost + 1e-6, (i, j)), shape=(count, count)).tocsr())
    pieces, piece = connected_components(tree, directed=False)
    flips = coo_array((flip, (i, j)), shape=(count, count)).tocsr()
    signs = np.ones(count)
    _, roots = np.unique(piece, return_index=True)
    for root in roots:
        order, parent = breadth_first_order(tree, root, directed=False)
        child, parent = order[1:], parent[order[1:]]
        if not len(child):
            continue
        step = np.asarray(flips[np.minimum(child, parent), np.maximum(child, parent)]).ravel()
        for c, p, s in zip(child.tolist(), parent.tolist(), step.tolist(), strict=True):
            signs[c] = signs[p] * s
    return signs, piece


def _planes(points: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normal, centroid and flatness (smallest over middle variance) of each neighbourhood."""
    normals, centroids, flatness = np.empty((len(points), 3)), np.empty((len(points), 3)), np.empty(len(points))
    for begin in range(0, len(points), CHUNK):
        part = slice(begin, begin + CHUNK)
        local = points[neighbours[part]]
        centroids[part] = local.mean(axis=1)
        local = local - centroids[part][:, None]
        variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))
        normals[part] = axes[:, :, 0]
        flatness[part] = variances[:, 0] / np.maximum(variances[:, 1], 1e-300)
    return normals, centroids, flatness


def _nearest(points: np.ndarray, good: np.ndarray) -> np.ndarray:
    """For each point its own index where it is good, otherwise that of the nearest good one."""
    index = np.arange(len(points))
    if not good.all():
        from scipy.spatial import cKDTree

        candidates = np.flatnonzero(good)
        index[~good] = candidates[cKDTree(points[candidates]).query(points[~good])[1]]
    return index
