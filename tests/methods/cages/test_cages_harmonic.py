"""Harmonic coordinates: properties of all coordinates, and properties of these alone."""

import numpy as np
import pytest
import torch
from trimesh import Trimesh
from trimesh.creation import box

from bench import BadInput, Run
from bench.methods.cages.cage_per_pair import CagePerPair
from bench.methods.cages.coordinates.harmonic import HarmonicCoordinates
from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
from bench.methods.cages.meshes.round_cages import ball_cage
from bench.tasks.deform import Deform


def arch():
    """A cage in the shape of a U: two legs with a gap between them, on a bar."""
    outline = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], float)
    triangles = [(0, 1, 4), (0, 4, 5), (1, 2, 4), (2, 3, 4), (0, 5, 7), (5, 6, 7)]
    count = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(count, z)]) for z in (0.0, 1.0)])
    sides = [((i, (i + 1) % count), ((i + 1) % count + count, i + count)) for i in range(count)]
    faces = [t[::-1] for t in triangles] + [tuple(k + count for k in t) for t in triangles]
    faces += [(*low, high[0]) for low, high in sides] + [(low[0], *high) for low, high in sides]
    return vertices, np.array(faces)


@pytest.fixture(scope="module")
def ball():
    vertices, faces = ball_cage(1, 1.0)
    return vertices, faces, HarmonicCoordinates(vertices, faces, cells=8)


def test_coordinates_sum_to_one_and_reproduce_the_point(ball):
    vertices, _, coordinates = ball
    points = np.random.default_rng(0).uniform(-0.45, 0.45, (200, 3))
    weights = coordinates(points)
    assert weights.shape == (200, 42)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(weights @ vertices, points, atol=1e-9)


def test_on_the_cage_coordinates_are_barycentric(ball):
    vertices, faces, coordinates = ball
    np.testing.assert_allclose(coordinates(vertices), np.eye(42), atol=1e-9)
    middle = vertices[faces].mean(axis=1)
    wanted = np.zeros((len(faces), 42))
    wanted[np.arange(len(faces))[:, None], faces] = 1 / 3
    np.testing.assert_allclose(coordinates(middle), wanted, atol=0.02)


def test_coordinates_are_within_the_bounds_of_harmonic_functions():
    """In a box, weights are within the range on the cage, and at the centre all are of similar size."""
    cage = box((2, 2, 2))
    vertices, faces = np.array(cage.vertices), np.array(cage.faces)
    weights = HarmonicCoordinates(vertices, faces, cells=10)(np.random.default_rng(1).uniform(-0.7, 0.7, (300, 3)))
    assert weights.min() > -0.02  # harmonic functions lie between their values on the cage, except in flat tetrahedra
    centre = HarmonicCoordinates(vertices, faces, cells=10)(np.zeros((1, 3)))[0]
    np.testing.assert_allclose(centre.sum(), 1, atol=1e-9)
    assert centre.min() > 0.05 and centre.max() < 0.2


def test_points_across_a_gap_do_not_move():
    """One leg of an arch hardly depends on the end of the other; with mean value coordinates it does."""
    vertices, faces = arch()
    other = (vertices[:, 0] >= 2) & (vertices[:, 1] == 3)  # the end of the right leg
    point = np.array([[0.5, 2.5, 0.5]])
    harmonic = np.abs(HarmonicCoordinates(vertices, faces, cells=12)(point)[0, other]).sum()
    cage = torch.from_numpy(vertices)[None]
    mean_value = mean_value_coordinates(torch.from_numpy(point)[None], cage, faces)[0, 0].numpy()
    assert harmonic < 0.01 and np.abs(mean_value[other]).sum() > 0.01 > 1e4 * harmonic


def test_a_cage_that_is_not_closed_is_refused():
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1]])
    with pytest.raises(BadInput, match="closed"):
        HarmonicCoordinates(sheet, np.array([[0, 1, 2], [1, 3, 2]]))


def test_cage_per_pair_can_use_them():
    toy = Deform().toy()
    method = CagePerPair(coordinates="harmonic", points=128, steps=15)
    output = method.deform(**toy.input, run=Run())
    assert isinstance(output, Trimesh) and np.array_equal(output.faces, toy.input["source"].faces)
    apart = np.linalg.norm(output.vertices - toy.reference.mesh.vertices, axis=1).mean()
    assert apart < 0.8 * np.linalg.norm(toy.input["source"].vertices - toy.reference.mesh.vertices, axis=1).mean()
