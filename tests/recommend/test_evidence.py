"""Evidence and ranks of meshes whose errors are known in closed form: balls of wrong radii, with bumps, with holes."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import PointCloud, generator
from bench.errors import BadInput
from bench.geometry.cloud import Frame
from bench.recommend.evidence import evidence
from bench.recommend.gaps import Gaps, gaps_of
from bench.recommend.scan import scan_of
from bench.recommend.verdict import verdict

SIGMA = 0.01
POINTS = 2000


def on_ball(count, sigma=SIGMA, seed=0):
    rng = generator(seed, "ball")
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points * (1 + sigma * rng.normal(size=(count, 1)))


def scan(points=None, count=0, seed=0, normals=None):
    return scan_of("ball.ply", PointCloud(on_ball(POINTS) if points is None else points, normals), Frame(), count, seed)


def ball(radius=1.0, bumps=0.0, seed=0):
    mesh = trimesh.creation.icosphere(4)
    height = radius + bumps * generator(seed, "bumps").normal(size=(len(mesh.vertices), 1))
    return trimesh.Trimesh(mesh.vertices * height, mesh.faces, process=False)


def three(*parts):
    return parts if len(parts) == 3 else parts * 3


BUMPY = (ball(bumps=SIGMA), ball(bumps=SIGMA, seed=1), ball(bumps=SIGMA, seed=2))
HALF = trimesh.Trimesh(ball().vertices, ball().faces[ball().triangles_center[:, 2] > 0], process=False)
SHEETS = trimesh.util.concatenate([ball(), ball(0.8)])
METHODS = {
    "exact": three(ball()),
    "large": three(ball(1.05)),
    "bumpy": BUMPY,
    "half": three(HALF),
    "two sheets": three(SHEETS),
}
NAMES = list(METHODS)


@pytest.fixture(scope="module")
def found():
    return evidence(scan(), list(METHODS.values()), 0)


def means(sums):
    total = sums.sum(axis=-1)
    return total[..., 0] / total[..., 1]


def test_distances_have_their_closed_forms(found):
    held = means(found.to_mesh)
    assert held[0] == pytest.approx(SIGMA * np.sqrt(2 / np.pi), rel=0.08)  # mean |x| of a normal variable
    assert held[1] == pytest.approx(0.05, rel=0.03)
    assert found.median_held[0] == pytest.approx(0.6745 * SIGMA, rel=0.08)
    apart = means(found.apart + np.eye(5)[:, :, None, None])
    assert apart[0, 1] == pytest.approx(0.05, rel=0.03) and apart[1, 0] == pytest.approx(0.05, rel=0.03)
    assert apart[4, 0] == pytest.approx(0.2 * 0.8**2 / (1 + 0.8**2), rel=0.1)  # the inner sheet's share of the area
    missing = 2 / 3 * (1 + np.sqrt(0.5)) - 2 * (1 - np.sqrt(0.5))  # mean distance of the other half ball to the rim
    assert apart[3, 0] < 1e-6 and apart[0, 3] == pytest.approx(missing / 2, rel=0.08)


def test_halves_that_agree_and_halves_that_do_not(found):
    halves = means(found.halves)
    assert halves[0] < 1e-12 and halves[1] < 1e-12
    assert halves[2] == pytest.approx(SIGMA, rel=0.35)  # two heights between vertices, each with some of SIGMA


def test_counts_are_of_all_points_and_samples(found):
    assert (found.to_mesh[:, 1].sum(axis=-1) == POINTS).all()
    assert (found.to_points[:, 1].sum(axis=-1) == 2 * 2000).all()


def test_pieces_and_open_edges(found):
    assert found.pieces.tolist() == [1, 1, 1, 1, 2]
    assert found.open_edges[0] == 0 < found.open_edges[3]


def test_the_truth_comes_first_and_every_fault_behind_it(found):
    ranks = verdict([found], NAMES, 0)
    assert NAMES[ranks.order[0]] == "exact" and ranks.score[0] == 1
    assert ranks.low[0] == 1 and all(ranks.low[NAMES.index(name)] > 1 for name in ("large", "half", "two sheets"))
    assert NAMES[ranks.order[-1]] == "half"


def test_a_one_sided_distance_would_not_see_two_sheets(found):
    """What the second direction, and the other methods, are for."""
    held = means(found.to_mesh)
    assert held[4] <= held[0] * 1.001
    assert verdict([found], NAMES, 0).score[4] > 1.2


def test_equal_meshes_are_tied():
    same = evidence(scan(), [METHODS["exact"], METHODS["exact"], METHODS["large"]], 0)
    ranks = verdict([same], ["a", "b", "c"], 0)
    assert ranks.score[0] == ranks.score[1] == 1
    assert list(zip(ranks.low, ranks.high, strict=True)) == [(1, 2), (1, 2), (3, 3)]


def test_almost_equal_meshes_are_tied():
    close = evidence(scan(), [three(ball(1.0005)), three(ball(0.9995)), METHODS["large"]], 0)
    ranks = verdict([close], ["a", "b", "c"], 0)
    assert ranks.low.tolist() == [1, 1, 3] and ranks.high.tolist() == [2, 2, 3]


def test_methods_of_one_family_do_not_vote_for_each_other():
    """Three that share a fault against two that are right: as three families they would be the majority."""
    wrong = [three(ball(1.03)), three(ball(1.03)), three(ball(1.03))]
    of_all = evidence(scan(), [*wrong, METHODS["exact"], BUMPY], 0)
    apart = verdict([of_all], ["a", "a", "a", "b", "c"], 0)
    assert apart.order[0] == 3
    voting = verdict([of_all], list("abcde"), 0)
    assert voting.criteria[0, 2] < apart.criteria[0, 2]


def test_a_family_has_one_vote_however_many_of_it_are_asked():
    """To ask for the same mesh under two depths changes nothing for the others."""
    names = ("large", "exact", "two sheets")
    plain = verdict([evidence(scan(), [METHODS[name] for name in names], 0)], list("abc"), 0)
    names = ("large", "large", "large", "exact", "two sheets")
    often = verdict([evidence(scan(), [METHODS[name] for name in names], 0)], list("aaabc"), 0)
    assert often.score[[0, 3, 4]] == pytest.approx(plain.score)


def test_one_family_alone_is_ranked_too(found):
    ranks = verdict([found], ["poisson"] * 5, 0)
    assert NAMES[ranks.order[0]] == "exact" and np.isfinite(ranks.score).all()


def test_several_scans_count_alike():
    """A scan ten times as bad does not decide alone, and the same scan twice says what it says once."""
    one = evidence(scan(), [METHODS["exact"], METHODS["large"], BUMPY], 0)
    once, twice = verdict([one], list("abc"), 0), verdict([one, one], list("abc"), 0)
    assert twice.score == pytest.approx(once.score) and twice.criteria == pytest.approx(once.criteria)
    other = evidence(scan(), [METHODS["large"], METHODS["exact"], BUMPY], 0)
    both = verdict([one, other], list("abc"), 0)
    assert both.score[0] == pytest.approx(both.score[1], rel=1e-9)
    assert both.low[0] == both.low[1]


def test_the_same_seed_gives_the_same_answer(found):
    again = evidence(scan(), list(METHODS.values()), 0)
    assert (again.apart == found.apart).all() and (again.to_points == found.to_points).all()
    first, second = verdict([found], NAMES, 3), verdict([again], NAMES, 3)
    assert (first.score == second.score).all() and (first.low == second.low).all() and (first.high == second.high).all()


# -- holes -------------------------------------------------------------------------------------------------------------

CAP = 0.6  # radians: what a scan of a ball with a hole leaves out


def punched(radius=1.0):
    """A ball without the cap: what a method makes that fills nothing."""
    mesh = ball(radius)
    return trimesh.Trimesh(mesh.vertices, mesh.faces[ball().triangles_center[:, 2] < np.cos(CAP)], process=False)


PUNCHED = punched()


def with_hole():
    points = on_ball(4 * POINTS)
    return scan(points[points[:, 2] < np.cos(CAP) * np.linalg.norm(points, axis=1)], 3 * POINTS // 2)


def without(mesh, cloud, removed):
    """The mesh without what lies nearest to removed points: how a method that fills nothing sees the rest."""
    _, nearest = cKDTree(cloud.points).query(mesh.triangles_center)
    return trimesh.Trimesh(mesh.vertices, mesh.faces[~removed[nearest]], process=False)


def test_the_share_in_holes_is_estimated():
    holey = with_hole()
    found = gaps_of(holey, [ball(), PUNCHED], ["fills", "does not"], 0)
    true = (1 - np.cos(CAP)) / 2 / 2  # of the ball; the mean over both meshes
    assert 0.5 * true < found.hidden < true  # the rim has points near it
    assert 0.3 * CAP < found.radius <= 0.3
    alone = gaps_of(holey, [ball(), ball(), ball(), PUNCHED], ["fills"] * 3 + ["does not"], 0)
    assert alone.hidden == pytest.approx(found.hidden)  # a family counts once


def test_a_complete_scan_has_no_gaps():
    assert gaps_of(scan(), [ball(), ball(1.005)], ["a", "b"], 0) is None


def test_gaps_are_balls_that_take_a_seventh_of_the_points():
    holey = with_hole()
    found = gaps_of(holey, [ball(), PUNCHED], ["fills", "does not"], 0)
    share = found.removed.mean()
    assert 0.15 <= share < 0.25 and len(found.rest(holey)) == (~found.removed).sum()
    again = gaps_of(holey, [ball(), PUNCHED], ["fills", "does not"], 0)
    assert (again.removed == found.removed).all()
    assert not (gaps_of(holey, [ball(), PUNCHED], ["fills", "does not"], 1).removed == found.removed).all()


def test_more_than_half_of_the_points_are_never_cut():
    plane = np.column_stack([generator(5).uniform(-0.05, 0.05, size=(300, 2)), np.zeros(300)])
    tiny = scan(plane)
    found = gaps_of(tiny, [ball(), ball()], ["a", "b"], 0)  # nothing that was made is near the points
    assert found.removed.mean() <= 0.5


def test_distances_across_a_gap_have_their_closed_forms():
    """Points of a ball of radius 1, removed above a height, to a ball 0.1 larger; and to one that has nothing there."""
    whole = scan(on_ball(POINTS, sigma=0))
    removed = whole.cloud.points[:, 2] > 0.5
    gaps = Gaps(0.25, 0.3, removed)
    large, half = ball(1.1), trimesh.Trimesh(ball().vertices, ball().faces[ball().triangles_center[:, 2] < 0])
    found = evidence(whole, [three(ball()), three(ball())], 0, gaps, [large, half])
    gap = means(found.gap_to_mesh)
    assert gap[0] == pytest.approx(0.1, rel=0.03)
    height = np.linspace(0.5, 1, 10_000)  # uniform over the cap; the rim of the half ball is at height 0
    assert gap[1] == pytest.approx(np.hypot(1 - np.sqrt(1 - height**2), height).mean(), rel=0.05)
    assert (found.gap_to_mesh[:, 1].sum(axis=-1) == removed.sum()).all()
    assert means(found.gap_to_points)[0] == pytest.approx(0.1, abs=0.02)
    assert (found.gap_to_points[1] == found.gap_to_mesh[1]).all()  # no sample is there: not zero, which would flatter


def test_who_fills_holes_comes_first_where_there_are_some():
    """To points near the holes all are alike, and a mesh without the holes has less of which no point is near."""
    holey = with_hole()
    meshes, names = [ball(), ball(1.002), PUNCHED, punched(1.002)], ["fills", "fills too", "does not", "neither"]
    gaps = gaps_of(holey, meshes, names, 0)
    filled = [*meshes[:2], *(without(mesh, holey.cloud, gaps.removed) for mesh in meshes[2:])]
    threes = [three(mesh) for mesh in meshes]
    blind = verdict([evidence(holey, threes, 0)], names, 0)
    seeing = verdict([evidence(holey, threes, 0, gaps, filled)], names, 0)
    assert set(blind.order[:2]) == {2, 3} and set(seeing.order[:2]) == {0, 1}
    assert seeing.criteria[0, -1] < seeing.criteria[2, -1] and (blind.criteria[:, -1] == 0).all()


# -- the scan ----------------------------------------------------------------------------------------------------------


def test_halves_have_every_point_once():
    whole = scan()
    both = np.concatenate([whole.half(0).points, whole.half(1).points])
    assert sorted(map(tuple, both)) == sorted(map(tuple, whole.cloud.points))
    assert abs(len(whole.half(0)) - len(whole.half(1))) <= 1


def test_a_subsample_is_random_repeatable_and_keeps_normals():
    points = on_ball(POINTS, sigma=0)
    some = scan(points, 500, normals=points)
    assert len(some.cloud) == 500 and some.total == POINTS
    assert some.cloud.normals == pytest.approx(some.cloud.points)
    assert (scan(points, 500).cloud.points == some.cloud.points).all()
    assert not np.array_equal(scan(points, 500, seed=1).cloud.points, some.cloud.points)
    assert abs(some.cloud.points.mean(axis=0)).max() < 0.1  # not a corner of the file


@pytest.mark.parametrize("sigma", (0.01, 0.02))
def test_the_noise_is_measured(sigma):
    whole = scan(on_ball(POINTS, sigma))
    assert whole.state.noise * whole.spacing == pytest.approx(sigma, rel=0.2)
    assert whole.state.outliers == 0


def test_outliers_are_counted_and_judge_nobody():
    far = generator(1).uniform(-1, 1, size=(100, 3)) * 3
    far = far[np.linalg.norm(far, axis=1) > 1.5]
    whole = scan(np.concatenate([on_ball(POINTS), far]))
    assert whole.state.outliers * len(whole.cloud) == pytest.approx(len(far), abs=5)
    with_them = evidence(whole, [METHODS["exact"], METHODS["large"]], 0)
    assert means(with_them.to_mesh)[0] == pytest.approx(SIGMA * np.sqrt(2 / np.pi), rel=0.1)


def test_points_that_coincide_count_once():
    points = on_ball(POINTS)
    assert len(scan(np.concatenate([points, points])).cloud) == POINTS


def test_too_few_points_are_refused():
    with pytest.raises(BadInput, match=r"ball.ply: 50 different points; .* 100 at least"):
        scan(np.repeat(on_ball(50), 4, axis=0))
