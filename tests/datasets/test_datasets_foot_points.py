"""Foot points of far points are the global minimum, not that of the nearest bump: against dense samples."""

from itertools import islice

import numpy as np
import pytest
from even_meshes import even
from scipy.spatial import cKDTree
from trimesh.creation import icosphere

from bench import generator
from bench.datasets.branches import Branches
from bench.datasets.bumps import Bumps
from bench.datasets.fbm import Fbm
from bench.datasets.reliefs import Reliefs
from bench.datasets.surfaces.basins import Basins, best_of

FAR = [(Fbm(cells=48), 2), (Branches(goals=100), 2), (Bumps(subdivisions=5), 1), (Reliefs(), 1)]


@pytest.mark.parametrize(
    ("family", "index"), FAR, ids=lambda value: type(value).__name__ if hasattr(value, "shapes") else str(value)
)
def test_far_foot_points_are_nearer_than_all_samples(family, index):
    shape, _ = even(next(islice(family.shapes("test"), index, None))).framed()
    rng = generator(5)
    low, high = shape.mesh.bounds
    points = (low + high) / 2 + (rng.random((300, 3)) - 0.5) * 3 * (high - low)
    distance = np.linalg.norm(points - shape.surface.closest(points)[0], axis=1)
    brute = cKDTree(shape.surface.sample(40_000, rng)[0]).query(points)[0]
    # A basin narrower than an edge of the mesh may still be missed.
    assert (distance > brute + 1e-9).sum() <= 1 and (distance - brute).max() < 2e-4


def test_starts_are_all_vertices_nearer_than_their_neighbours():
    """Two balls equally far from a point in the middle: two starts; nearer to one of them, none are needed."""
    ball = icosphere(3)
    vertices = np.concatenate([ball.vertices - [2, 0, 0], ball.vertices + [2, 0, 0]])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    basins = Basins(vertices, faces)
    points = np.array([[0.0, 0.3, 0.0], [-0.9, 0, 0], [9.0, 0.2, 0.1]])
    away = cKDTree(vertices).query(points)[0]
    rows, starts = basins.starts(points, away)
    assert (rows == 0).all() and set(np.sign(vertices[starts, 0])) == {-1, 1}
    naive = [
        v
        for v in cKDTree(vertices).query(points[0], k=64)[1]
        if all(
            np.linalg.norm(vertices[w] - points[0]) >= np.linalg.norm(vertices[v] - points[0]) - 1e-12
            for w in np.unique(faces[(faces == v).any(axis=1)])
        )
    ]
    assert sorted(starts) == sorted(naive)
    assert list(best_of(np.array([3, 1, 3]), np.array([2.0, 5.0, 1.0]))) == [1, 2]
