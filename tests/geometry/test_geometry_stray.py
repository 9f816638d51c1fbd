"""Points far from all others, and the frame of a scan without them; parts of a scene are not strays."""

import numpy as np
import pytest

from bench.geometry.cloud import Frame
from bench.geometry.stray import frame_of_bulk, strays


@pytest.fixture
def ball():
    points = np.random.default_rng(0).normal(size=(2000, 3))
    return 3 * points / np.linalg.norm(points, axis=1, keepdims=True) + (5e5, 5e6, 100)


@pytest.mark.parametrize("distance", [5e3, 1e6, 1e12])
def test_a_very_far_point_does_not_change_the_frame(ball, distance):
    assert frame_of_bulk(np.vstack([ball, ball[0] + (distance, 0, 0)])) == Frame.of(ball)


def test_near_points_and_large_groups_belong_to_the_scene(ball):
    clouds = [ball, np.vstack([ball, ball[0] + (30, 0, 0)]), np.vstack([ball, ball[:100] + (1e5, 0, 0)]), ball[:3]]
    for points in (*clouds, np.vstack([np.zeros((500, 3)), [1, 0, 0]])):
        assert frame_of_bulk(points) == Frame.of(points)


@pytest.mark.parametrize("distance", [20, 1e6])
@pytest.mark.parametrize("count", [1, 8])
def test_strays_are_the_points_far_from_all_others(ball, distance, count):
    direction = np.random.default_rng(1).normal(size=(count, 3))
    far = ball.mean(axis=0) + 3 * np.sqrt(3) * distance * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_array_equal(np.flatnonzero(strays(np.vstack([far, ball]))), np.arange(count))


def test_a_tenth_of_the_points_or_a_few_near_points_are_not_strays(ball):
    center = ball.mean(axis=0)
    assert strays(ball) is None
    assert strays(np.vstack([ball, center + 20 * (ball[:200] - center)])) is None
    assert strays(np.vstack([ball, center + 4 * (ball[:1] - center)])) is None
    assert strays(np.vstack([ball[:50], center + 99 * (ball[:1] - center)])) is None
