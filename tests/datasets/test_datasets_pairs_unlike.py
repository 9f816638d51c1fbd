"""Pairs without correspondence: furniture with different parts, and vases."""

from itertools import islice

import numpy as np
import pytest

from bench.datasets.furniture import Furniture
from bench.datasets.solids.furniture_parts import CATEGORIES, bar_grid
from bench.datasets.vases import Vases
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology

PAIRS = {category: list(islice(Furniture(category, same_parts=False).pairs("test"), 2)) for category in CATEGORIES}
VASES = list(islice(Vases(columns=32).pairs("test"), 4))
furniture_pairs = pytest.mark.parametrize("pair", [p for pairs in PAIRS.values() for p in pairs], ids=lambda p: p.id)
vase_pairs = pytest.mark.parametrize("pair", VASES, ids=lambda p: p.id)

DATASETS = {
    "furniture": lambda: Furniture(same_parts=False),
    "chairs": lambda: Furniture("chair", same_parts=False),
    "vases": lambda: Vases(columns=32),
}


@pytest.mark.parametrize("name", DATASETS)
def test_pairs_are_repeatable_and_splits_differ(name):
    first, again, train = (next(DATASETS[name]().pairs(split)) for split in ("test", "test", "train"))
    assert first.id == again.id != train.id and not first.corresponding and not first.landmarks
    for side in ("source", "target"):
        mesh, same, other = (getattr(pair, side).mesh for pair in (first, again, train))
        assert mesh.vertices.tobytes() == same.vertices.tobytes() and mesh.faces.tobytes() == same.faces.tobytes()
        assert mesh.vertices.tobytes() != other.vertices.tobytes()


@pytest.mark.parametrize("name", DATASETS)
def test_ids_are_unique_and_shapes_differ(name):
    pairs = list(islice(DATASETS[name]().pairs("test"), 3))
    shapes = [shape for pair in pairs for shape in (pair.source, pair.target)]
    assert len({pair.id for pair in pairs}) == 3 and len({shape.id for shape in shapes}) == 6
    assert len({shape.mesh.vertices.tobytes() for shape in shapes}) == 6


# -- furniture ---------------------------------------------------------------------------------------------------------


def used_parts(shape):
    return sorted(shape.info["parts"])


@furniture_pairs
def test_the_two_pieces_share_a_category_but_not_all_parts(pair):
    assert pair.source.tags == pair.target.tags == (pair.source.info["category"],)
    assert used_parts(pair.source) != used_parts(pair.target)
    optional = ("slat", "arm", "stretcher", "board", "divider", "back panel")
    for name in set(used_parts(pair.source)) ^ set(used_parts(pair.target)):
        assert any(word in name for word in optional), name


@furniture_pairs
def test_a_source_is_made_of_closed_parts_and_a_target_is_a_union(pair):
    source, target = pair.source, pair.target
    parts = len(source.info["parts"])
    assert count_topology(source.mesh.vertices, source.mesh.faces) == (parts, 0, 0, True, 0)
    assert len(source.mesh.faces) == parts * len(bar_grid()[1])
    counts = count_topology(target.mesh.vertices, target.mesh.faces)
    assert (counts.components, counts.genus, counts.watertight) == (1, target.info["genus"], True)
    for shape in (source, target):
        assert shape.mesh.volume > 0 and shape.mesh.is_winding_consistent
        labels = shape.attributes["part"]
        assert labels.shape == (len(shape.mesh.faces),) and set(labels) == set(range(len(shape.info["parts"])))
    assert not self_intersecting_faces(target.mesh.vertices, target.mesh.faces).any()


@furniture_pairs
def test_both_stand_upright_on_their_legs(pair):
    for shape in (pair.source, pair.target):
        V, F = shape.mesh.vertices, shape.mesh.faces
        assert V[:, 2].min() == pytest.approx(0, abs=0.01)
        names = np.array(shape.info["parts"])[shape.attributes["part"]]
        on_the_floor = {str(name) for name in names[(V[F, 2] < 0.02).all(axis=1)]}
        assert len(on_the_floor) == 4 and all(name.endswith(("leg", "foot")) for name in on_the_floor)
        # The legs are at the four corners: left is x > 0, front is y < 0.
        for name in on_the_floor:
            middle = V[F[names == name]].reshape(-1, 3).mean(axis=0)
            assert (middle[0] > 0) == ("left" in name) and (middle[1] < 0) == ("front" in name)
        # The back of a chair is behind its seat, and nothing is above the top of a table.
        if shape.tags == ("chair",):
            assert V[V[:, 2] > V[:, 2].max() - 0.05, 1].min() > 0
        if shape.tags == ("table",):
            assert set(names[(V[F, 2] > V[:, 2].max() - 1e-6).all(axis=1)]) == {"top"}


@furniture_pairs
def test_a_stated_mirror_symmetry_holds(pair):
    for shape in (pair.source, pair.target):
        if "mirror x" not in shape.info["symmetry"]:
            assert shape.tags == ("shelf",)
            continue
        points, _ = shape.surface.sample(2000, np.random.default_rng(0))
        image, _ = shape.surface.closest(points * (-1, 1, 1))
        assert np.abs(image - points * (-1, 1, 1)).max() < 1e-9


# -- vases -------------------------------------------------------------------------------------------------------------


@vase_pairs
def test_vases_are_closed_vessels_of_genus_0(pair):
    for shape in (pair.source, pair.target):
        counts = count_topology(shape.mesh.vertices, shape.mesh.faces)
        assert counts == (1, 0, 0, True, 0) and shape.info["genus"] == 0
        assert shape.mesh.volume > 0 and shape.mesh.is_winding_consistent
        assert shape.info["wall"] > 0
        # Closed but hollow: the wall is a small part of the volume of the hull.
        assert shape.mesh.volume < 0.5 * shape.mesh.convex_hull.volume


@vase_pairs
def test_vases_stand_on_a_foot_and_open_upward(pair):
    for shape in (pair.source, pair.target):
        V = shape.mesh.vertices
        low, high, wall = V[:, 2].min(), V[:, 2].max(), shape.info["wall"]
        radius = np.linalg.norm(V[:, :2], axis=1)
        # The axis is z: it crosses the foot, and nothing above it.
        on_axis = V[radius < 0.02 * radius.max()]
        assert len(on_axis) and on_axis[:, 2].max() < low + 3 * wall + 0.05 * (high - low)
        rim = V[V[:, 2] > high - 0.1 * wall]
        assert np.abs(rim[:, :2].mean(axis=0)).max() < 0.05 and np.linalg.norm(rim[:, :2], axis=1).min() > 0.05


def test_kinds_and_sections_of_the_two_vases_are_drawn_independently():
    pairs = list(islice(Vases(columns=32).pairs("train"), 60))  # no mesh is built
    for key, count in (("kind", 4), ("section", 3)):
        seen = [(pair.source.info[key], pair.target.info[key]) for pair in pairs]
        assert len({source for source, _ in seen}) == len({target for _, target in seen}) == count
        equal = sum(source == target for source, target in seen)
        assert 0.4 * 60 / count < equal < 2 * 60 / count
    shares = [shape.info["thickness"] for pair in pairs for shape in (pair.source, pair.target)]
    assert 0.008 * 0.8 < min(shares) < 0.012 and 0.03 < max(shares) < 0.045 * 1.2
