"""Uniform samples of a mesh."""

import numpy as np
import pytest
import trimesh
from scipy.stats import kstest

from bench import generator
from bench.geometry.sampling import face_normals, sample_uniform


def test_faces_get_points_in_proportion_to_their_area():
    # Areas 1 : 2 : 3 along a strip, with faces of zero area at the start, between and at the end.
    x = np.array([0, 1, 3, 6.0])
    vertices = np.vstack([np.c_[x, 0 * x, 0 * x], np.c_[x, 0 * x + 2, 0 * x]])
    faces = [[0, 0, 1], [0, 1, 4], [1, 1, 1], [1, 2, 5], [0, 1, 2], [2, 3, 6], [3, 3, 2]]
    points, chosen = sample_uniform(trimesh.Trimesh(vertices, faces, process=False), 60_000, generator(0))
    counts = np.bincount(chosen, minlength=7)
    assert counts[[0, 2, 4, 6]].sum() == 0
    assert counts[[1, 3, 5]] / 60_000 == pytest.approx([1 / 6, 2 / 6, 3 / 6], abs=4 * np.sqrt(0.25 / 60_000))
    assert points[:, 2] == pytest.approx(0)


def test_points_are_uniform_on_a_triangle():
    triangle = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    points, _ = sample_uniform(triangle, 20_000, generator(1))
    # Each barycentric coordinate of a uniform point is Beta(1, 2): P(coordinate <= t) = 1 - (1 - t)^2.
    for coordinate in (points[:, 0], points[:, 1], 1 - points[:, 0] - points[:, 1]):
        assert kstest(coordinate, lambda t: 1 - (1 - np.clip(t, 0, 1)) ** 2).pvalue > 1e-4


def test_samples_are_in_random_order_and_depend_on_the_seed_alone():
    sphere = trimesh.creation.icosphere(3)
    points, faces = sample_uniform(sphere, 4000, generator(2))
    again, _ = sample_uniform(sphere, 4000, generator(2))
    assert np.array_equal(points, again)
    # The first half is a sample of the whole, too.
    assert abs(np.corrcoef(np.arange(4000), faces)[0, 1]) < 0.07
    assert not np.array_equal(points, sample_uniform(sphere, 4000, generator(3))[0])


def test_face_normals_follow_the_right_hand_rule():
    mesh = trimesh.Trimesh([[0, 0, 0], [2, 0, 0], [0, 3, 0]], [[0, 1, 2], [0, 2, 1], [0, 1, 1]], process=False)
    assert face_normals(mesh) == pytest.approx(np.array([[0, 0, 1], [0, 0, -1], [0, 0, 0.0]]))
    sphere = trimesh.creation.icosphere(2)
    assert face_normals(sphere) == pytest.approx(np.array(sphere.face_normals), abs=1e-9)
