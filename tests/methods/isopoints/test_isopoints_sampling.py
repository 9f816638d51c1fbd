"""Iso-points on closed forms, and their stages against naive loops."""

import math

import numpy as np
import pytest
import torch

from bench.methods.isopoints.sampling.extraction import Extraction, NoLevel, extract
from bench.methods.isopoints.sampling.fields import ByAutograd, differentiable
from bench.methods.isopoints.sampling.neighbours import nearest
from bench.methods.isopoints.sampling.projection import clipped, project
from bench.methods.isopoints.sampling.resampling import Resampling, resample
from bench.methods.isopoints.sampling.thinning import thinned
from bench.methods.isopoints.sampling.upsampling import candidates, upsample
from bench.methods.isopoints.sampling.wlop import wlop


def sphere(x):
    return torch.linalg.vector_norm(x, dim=1) - 0.8


def torus(x):
    return ((torch.linalg.vector_norm(x[:, :2], dim=1) - 0.7).square() + x[:, 2].square()).sqrt() - 0.25


def cube(x):
    """A cube of side 1 with edges rounded by 0.02."""
    outside = x.abs() - 0.48
    return torch.linalg.vector_norm(outside.clamp(min=0), dim=1) + outside.amax(1).clamp(max=0) - 0.02


def random_points(count, seed=0):
    return torch.rand(count, 3, generator=torch.Generator().manual_seed(seed)) * 2 - 1


def variation(points):
    """The coefficient of variation of the distances to the nearest point."""
    distances = nearest(points, 1).distances[:, 0]
    return float(distances.std() / distances.mean())


@pytest.mark.parametrize("function", [sphere, torus])
def test_points_arrive_in_ten_steps(function):
    result = project(ByAutograd(function), random_points(2000))
    assert result.values.abs().max() <= 1e-5
    assert torch.equal(function(result.points), result.values)
    assert torch.allclose(torch.linalg.vector_norm(result.gradients, dim=1), torch.ones(2000), atol=1e-5)


def test_steps_are_at_most_as_long_as_allowed():
    """A point at distance d from a sphere takes ceil(d / longest) steps, along the ray from the centre."""
    start = torch.tensor([[1.15, 0.0, 0.0], [0.0, 0.84, 0.0]])
    for steps, left in ((1, 0.25), (3, 0.05), (4, 0.0)):
        result = project(ByAutograd(sphere), start, steps=steps)
        assert result.points[0].tolist() == pytest.approx([0.8 + left, 0, 0], abs=1e-6)
        assert result.points[1].tolist() == pytest.approx([0, 0.8, 0], abs=1e-6)
    lengths = torch.linalg.vector_norm(clipped(random_points(50), 0.3), dim=1)
    assert lengths.max() <= 0.3 + 1e-6 and lengths.min() < 0.3
    assert torch.equal(clipped(torch.zeros(1, 3), 0.3), torch.zeros(1, 3))


def test_points_on_the_surface_are_not_evaluated_again():
    seen = []

    def counted(x):
        seen.append(len(x))
        return sphere(x)

    on, off = torch.tensor([[0.8, 0.0, 0.0]]), torch.tensor([[0.0, 0.85, 0.0], [0.0, 0.0, 1.05]])
    result = project(ByAutograd(counted), torch.cat([on, off]))
    assert seen == [3, 2, 1, 1]  # one step from a distance of 0.05, three from 0.25
    assert result.evaluations == sum(seen)
    assert torch.equal(result.points[:1], on)


def test_a_field_without_a_gradient_gives_finite_points():
    result = project(ByAutograd(lambda x: 0 * x.sum(1) + 1), random_points(20))
    assert torch.isfinite(result.points).all() and (result.values == 1).all()


def test_nearest_by_naive_loops():
    points = random_points(60)
    points[7] = points[3]  # coincident points
    squared = (points[:, None] - points).square().sum(2).fill_diagonal_(math.inf)
    near = nearest(points, 5)
    assert torch.allclose(near.distances, squared.topk(5, largest=False).values.sqrt(), atol=1e-6)
    assert not (near.rows == torch.arange(60)[:, None]).any()
    assert near.rows[7, 0] == 3 and near.rows[3, 0] == 7
    assert nearest(points[:3], 9).rows.shape == (3, 2)


@pytest.mark.parametrize("function", [sphere, torus])
@pytest.mark.parametrize("count", [500, 2000])
def test_three_rounds_space_points_evenly(function, count):
    starts = random_points(4 * count)
    on = project(ByAutograd(function), starts).points[:count]
    assert variation(on) > 0.5  # random points: 0.52
    for rounds in (1, 3):
        iso = extract(ByAutograd(function), on, Extraction(count, rounds=rounds))
        assert len(iso.points) == count and function(iso.points).abs().max() <= 1e-5
        assert variation(iso.points) < 0.2


def test_the_average_spreads_points_better_than_the_sum():
    """Eq. 4.7 with the constants of the thesis: see `resample`."""
    on = project(ByAutograd(sphere), random_points(4000)).at(slice(1000))
    before = variation(on.points)
    thesis = resample(ByAutograd(sphere), on, Resampling(10, neighbours=8, bandwidth=16)).points
    released = resample(ByAutograd(sphere), on, Resampling(10, neighbours=8, bandwidth=1, rule="offsets")).points
    ours = resample(ByAutograd(sphere), on, Resampling(10)).points
    assert variation(ours) < variation(thesis) < variation(released) < before


def test_a_move_matches_the_equation():
    points = torch.nn.functional.normalize(random_points(40), dim=1) * 0.8
    how = Resampling(1, neighbours=6, bandwidth=7)
    unit = float(torch.linalg.vector_norm(points.amax(0) - points.amin(0))) / 40
    moved = []
    for q in points:
        order = torch.linalg.vector_norm(points - q, dim=1).argsort()[1:7]
        weights = [math.exp(-float((points[i] - q).square().sum()) / (7 * unit)) for i in order]
        r = sum(
            w * (points[i] - q) / torch.linalg.vector_norm(points[i] - q) for w, i in zip(weights, order, strict=True)
        )
        moved.append(q - math.sqrt(unit) * r / sum(weights))
    wanted = torch.nn.functional.normalize(torch.stack(moved), dim=1) * 0.8
    assert torch.allclose(
        resample(ByAutograd(sphere), project(ByAutograd(sphere), points), how).points, wanted, atol=2e-5
    )


@pytest.mark.parametrize("edges", [None, 0.0, 3.0])
def test_candidates_by_naive_loops(edges):
    points = torch.nn.functional.normalize(random_points(30), dim=1)
    normals = None if edges is None else points
    found = candidates(points, normals, edges or 0.0, neighbours=5)
    near = nearest(points, 5).rows
    for k in range(30):
        best = []
        for i in near[k]:
            place = (2 * points[k] + points[i]) / 3
            m = place if edges is None else (points[k] + points[i]) / 2
            others = [k, *near[k].tolist()]
            if edges is None:
                b = min(float(torch.linalg.vector_norm(m - points[j])) for j in others)
            else:
                tangential = [
                    float((m - points[j]).square().sum() - (m - points[j]).dot(normals[j]).square()) for j in others
                ]
                b = math.sqrt((2 - float(normals[k].dot(normals[i]))) ** edges * max(0, min(tangential)))
            best.append((b, place))
        priority, place = max(best, key=lambda pair: pair[0])
        assert float(found.priority[k]) == pytest.approx(priority, abs=1e-5)
        assert torch.allclose(found.places[k], place, atol=1e-6)


def test_points_are_inserted_in_sparse_regions():
    """One half of a sphere has a quarter of the density of the other: most new points go there; old ones stay."""
    on = project(ByAutograd(sphere), random_points(9000)).points
    upper, lower = on[on[:, 2] > 0], on[on[:, 2] < 0]
    uneven = torch.cat([upper[thinned(upper, 100)], lower[thinned(lower, 400)]])
    iso = upsample(ByAutograd(sphere), project(ByAutograd(sphere), uneven), 700)
    assert torch.equal(iso.points[:500], uneven)
    assert sphere(iso.points).abs().max() <= 1e-5
    assert (iso.points[500:, 2] > 0).float().mean() > 0.9


def test_density_at_edges_grows_with_the_parameter():
    field, shares = ByAutograd(cube), []
    for edges in (None, 2.0, 8.0):
        iso = extract(field, random_points(2000), Extraction(1500, edges=edges))
        near_edge = (iso.points.abs() > 0.45).sum(1) >= 2
        shares.append(float(near_edge.float().mean()))
        assert cube(iso.points).abs().max() <= 1e-5
    assert shares[0] < shares[1] < shares[2], shares


def test_thinning_leaves_an_even_subset():
    on = project(ByAutograd(sphere), random_points(2000)).points
    rows = thinned(on, 500)
    assert len(rows) == 500 and torch.equal(rows, rows.unique())
    assert variation(on[rows]) < 0.25 < variation(on[:500])
    assert torch.equal(thinned(on, 5000), torch.arange(2000))


def test_wlop_is_nearer_to_the_surface_than_its_cloud():
    rng = torch.Generator().manual_seed(1)
    cloud = project(ByAutograd(sphere), random_points(4000)).points + 0.02 * torch.randn(4000, 3, generator=rng)
    points = wlop(cloud, 500)
    assert points.shape == (500, 3)
    assert sphere(points).abs().mean() < 0.4 * sphere(cloud).abs().mean()
    assert variation(points) < 0.45 < variation(cloud[:500])


def test_a_missing_zero_level_is_reported():
    with pytest.raises(NoLevel, match="0 of 50 points have found the zero level"):
        extract(ByAutograd(lambda x: x.square().sum(1) + 1), random_points(50), Extraction(50))


def test_networks_report_their_own_gradients():
    from bench.methods.learned.networks.sine_network import SineNetwork

    network = SineNetwork(15.0, hidden_layers=1, width=16, generator=torch.Generator().manual_seed(0))
    holder = type("Holder", (), {"network": network})()
    assert differentiable(network) is network and differentiable(holder) is network
    x = random_points(9)
    for ours, theirs in zip(ByAutograd(network).value_and_gradient(x), network.value_and_gradient(x), strict=True):
        assert np.allclose(ours.detach(), theirs.detach(), atol=1e-5)
