"""Patches: cut, normalised, and a whole cloud upsampled by them."""

import numpy as np
import pytest

from bench.methods.upsampling.patches.cut import centrality, covering, cut, cut_along, normalise, seed_count
from bench.methods.upsampling.patches.progressive import patch_size, strays, thin
from bench.methods.upsampling.patches.whole import in_patches

RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(300, 3))


def test_a_patch_has_the_nearest_points_of_its_seed_in_order():
    found = cut(POINTS, np.array([4, 20]), 30)
    for seed, patch in zip((4, 20), found, strict=True):
        order = np.linalg.norm(POINTS - POINTS[seed], axis=1).argsort()
        np.testing.assert_array_equal(patch, order[:30])


def test_normalised_patches_are_in_the_unit_ball_and_can_be_restored():
    patches = POINTS.reshape(3, 100, 3) * 7 + 40
    normalised = normalise(patches)
    np.testing.assert_allclose(normalised.points.mean(axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normalised.points, axis=2).max(axis=1), 1)
    np.testing.assert_allclose(normalised.restore(normalised.points), patches)


def test_a_patch_of_copies_of_one_point_is_not_scaled():
    normalised = normalise(np.full((1, 5, 3), 0.1))
    assert normalised.radii.item() == 1 and np.abs(normalised.points).max() < 1e-15


@pytest.mark.parametrize(("points", "size", "seeds"), [(5000, 312, 48), (625, 156, 12), (20, 20, 3), (600, 312, 5)])
def test_three_patches_cover_a_point(points, size, seeds):
    assert seed_count(points, size) == seeds


def test_patches_have_at_least_as_many_points_as_the_cloud():
    assert seed_count(600, 312, 1) == 2


@pytest.mark.parametrize(("points", "size"), [(5000, 312), (625, 156), (100, 33), (10, 10)])
def test_size_of_patches(points, size):
    assert patch_size(points, 312, 32) == size


@pytest.mark.parametrize("points", [1, 2, 20, 300])
def test_a_cloud_in_patches_has_the_exact_count(points):
    result = in_patches(POINTS[:points], 50, 3, lambda patches: patches.repeat(4, axis=1), 4 * points)
    assert result.shape == (4 * points, 3)
    assert {tuple(p) for p in np.round(result, 9)} <= {tuple(p) for p in np.round(POINTS, 9)}


@pytest.mark.parametrize("used", [None, 10])
def test_each_point_of_an_uneven_cloud_is_in_a_patch(used):
    crowd = RNG.normal(size=(900, 3)) * 1e-3
    cloud = np.concatenate([POINTS, crowd, np.full((60, 3), 0.25)])  # and sixty copies of one point
    patches = covering(cloud, 20, 3, used)
    assert set(patches[:, :used].ravel()) == set(range(len(cloud)))
    assert all(len(set(patch)) == 20 for patch in patches)
    spread = np.linalg.norm(cloud[patches] - cloud[patches[:, :1]], axis=2)
    assert (np.diff(spread, axis=1) >= 0).all()


def test_a_geodesic_patch_does_not_reach_the_other_side():
    """Two strands of a narrow U: along it, the nearest points are those with the nearest arc length."""
    length = np.linspace(0, 4, 401)
    turned = length > 2
    strand = np.stack([np.where(turned, 4 - length, length), np.where(turned, 0.05, 0.0), 0 * length], axis=1)
    seeds = np.array([100, 390])
    for seed, patch, near in zip(seeds, cut_along(strand, seeds, 21, 2), cut(strand, seeds, 21), strict=True):
        assert patch[0] == seed and set(patch) == set(range(min(seed - 10, 380), min(seed + 11, 401)))
        assert len(np.unique(strand[near, 1])) == 2


def test_a_geodesic_patch_of_a_small_component_is_filled_from_others():
    pieces = np.concatenate([POINTS[:30], POINTS[:30] + 50, np.zeros((12, 3))])
    patches = covering(pieces, 40, 3, None, cut_along)
    assert all(len(set(patch)) == 40 for patch in patches) and set(patches.ravel()) == set(range(72))


def test_centrality_counts_patches_in_which_a_point_is_nearer_the_seed():
    patches = covering(POINTS, 30, 3)
    rank = centrality(patches)
    for number, patch in enumerate(patches):
        for column, point in enumerate(patch):
            others = [(int(np.flatnonzero(p == point)[0]), k) for k, p in enumerate(patches) if point in p]
            assert rank[number, column] == sorted(others).index((column, number))


@pytest.mark.parametrize(("central", "used"), [(1, None), (1, 25)])
def test_a_point_comes_from_the_patches_where_it_is_most_central(central, used):
    """With distances to the seed as heights, the copies of a point are the lowest from all its patches."""
    flat = POINTS * (1, 1, 0)

    def lift(patches):
        heights = np.linalg.norm(patches - patches[:, :1], axis=2)
        return np.concatenate([patches[:, :used] + h * heights[:, :used, None] * (0, 0, 1) for h in (1, 2)], axis=1)

    result = in_patches(flat, 50, 3, lift, 600, central, used)
    assert result.shape == (600, 3)
    assert len(np.unique(np.round(result[:, :2], 9), axis=0)) == 300
    everything = in_patches(flat, 50, 3, lift, 600, 0, used)
    assert result[:, 2].mean() < 0.75 * everything[:, 2].mean()


def test_the_order_of_the_input_makes_no_difference():
    def near(patches):
        return np.concatenate([patches, patches * 0.99], axis=1)

    first = in_patches(POINTS, 50, 3, near, 600)
    second = in_patches(POINTS[RNG.permutation(300)], 50, 3, near, 600)
    np.testing.assert_array_equal(first, second)


def test_strays_are_removed_unless_nothing_else_is_left():
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    cloud = np.concatenate([grid, [[6.0, 6.0, 9.0]]])
    np.testing.assert_array_equal(np.flatnonzero(strays(cloud)), [144])
    dense = np.concatenate([cloud, grid + 0.01])
    assert thin(dense, 140)[:, 2].max() < 1
    assert thin(dense[:1], 5).shape == (5, 3)
