"""The frame of a scan is that of its bulk, however far a stray point lies; parts of a scene are no strays."""

import numpy as np
import pytest

from bench.geometry.cloud import Frame
from bench.geometry.stray import frame_of_bulk


@pytest.fixture
def ball():
    points = np.random.default_rng(0).normal(size=(2000, 3))
    return 3 * points / np.linalg.norm(points, axis=1, keepdims=True) + (5e5, 5e6, 100)


@pytest.mark.parametrize("distance", [5e3, 1e6, 1e12])
def test_a_point_that_is_very_far_does_not_set_the_frame(ball, distance):
    assert frame_of_bulk(np.vstack([ball, ball[0] + (distance, 0, 0)])) == Frame.of(ball)


def test_what_is_near_or_of_many_points_belongs_to_the_scene(ball):
    clouds = [ball, np.vstack([ball, ball[0] + (30, 0, 0)]), np.vstack([ball, ball[:100] + (1e5, 0, 0)]), ball[:3]]
    for points in (*clouds, np.vstack([np.zeros((500, 3)), [1, 0, 0]])):
        assert frame_of_bulk(points) == Frame.of(points)
