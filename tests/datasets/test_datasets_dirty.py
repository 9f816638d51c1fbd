"""Dirty meshes: the defects are present, the surface is unchanged, and pairs still correspond."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from bench import generator
from bench.datasets.common.dirt import KINDS, make_dirt
from bench.datasets.dirty import Dirty
from bench.datasets.mixture import Mixture
from bench.datasets.sensors.samples import Samples
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.topology import count_topology
from bench.geometry.used import is_used
from bench.plugins.registry import registry
from bench.plugins.schema import build

OF = [{"cad": {"kind": "bracket"}}, "knots"]


def dirty(**values):
    return build(registry().find("dataset", "dirty"), {"of": OF, **values})


@pytest.fixture(scope="module")
def both():
    """Clean and dirty shapes, framed."""
    clean = islice(Mixture(of=OF).shapes("test"), 2)
    return [(a.framed()[0], b.framed()[0]) for a, b in zip(clean, dirty(share=0.02).shapes("test"), strict=False)]


def test_a_sensor_gives_the_cloud_of_the_clean_shape(both):
    """A method gets the same input, so differences between scores come from the metrics."""
    for clean, soiled in both:
        assert (clean.id, clean.tags, clean.exactness) == (soiled.id, soiled.tags, soiled.exactness)
        assert len(soiled.mesh.faces) > len(clean.mesh.faces)
        for sampling in ("uniform", "poisson_disk"):
            one, other = (Samples(count=500, sampling=sampling).sense(s, generator(1)) for s in (clean, soiled))
            assert np.allclose(one.points, other.points, atol=1e-12)
            assert np.allclose(one.normals, other.normals, atol=1e-9)


def test_the_faces_cover_the_same_points(both):
    for clean, soiled in both:
        for one, other in ((clean, soiled), (soiled, clean)):
            points = np.concatenate([MeshSurface(one.mesh).sample(2000, generator(2))[0], one.mesh.triangles_center])
            assert MeshSurface(other.mesh).project(points).distance.max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_dirt_alone_has_its_stated_effect(kind, both):
    mesh = both[1][0].mesh  # smooth and closed, with small faces
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    before = count_topology(vertices, faces)
    dirt = make_dirt(vertices, faces, (kind,), 0.02, generator("dirt", kind))
    soiled, counts = dirt.vertices(vertices), count_topology(dirt.vertices(vertices), dirt.faces)
    more = len(dirt.faces) - len(faces)
    area = np.linalg.norm(np.cross(*(soiled[dirt.faces[:, k]] - soiled[dirt.faces[:, 0]] for k in (1, 2))), axis=1) / 2
    assert np.array_equal(soiled[: len(vertices)], vertices)
    if kind == "unreferenced":
        stray = ~is_used(type(mesh)(soiled, dirt.faces, process=False))
        assert stray.sum() == round(0.02 * len(vertices)) and counts == before
        assert np.ptp(soiled, axis=0).min() > 5 * np.ptp(vertices, axis=0).max()
    elif kind == "duplicates":
        assert area.sum() == pytest.approx(1.02 * mesh.area, rel=0.005) and not counts.watertight
    elif kind == "t_junctions":
        assert counts.boundary_edges == 3 * more > 0 and area.sum() == pytest.approx(mesh.area)
    elif kind == "flipped":
        turned = (dirt.faces != faces).any(axis=1)
        assert area[turned].sum() == pytest.approx(0.02 * mesh.area, rel=0.1)
        assert counts.flipped_faces == turned.sum() and more == 0
    elif kind == "unwelded":
        edges = np.sort(np.concatenate([dirt.faces[:, [0, 1]], dirt.faces[:, [1, 2]], dirt.faces[:, [2, 0]]]), axis=1)
        single = np.unique(edges, axis=0, return_counts=True)[1] == 1
        assert single.sum() > 20 and single.sum() % 2 == 0 and more == 0  # two sides of each crack,
        assert counts == before  # whose width is zero
    else:
        assert (area == 0).sum() == more == round(0.02 * len(faces))


def test_dirt_is_repeatable_and_differs_between_splits():
    first, again, train = (next(dirty().shapes(split)).mesh for split in ("test", "test", "train"))
    assert first.vertices.tobytes() == again.vertices.tobytes() and first.faces.tobytes() == again.faces.tobytes()
    assert first.faces.tobytes() != train.faces.tobytes()


def test_corresponding_pairs_still_correspond_and_attributes_follow():
    pair = next(dirty(of=["furniture"], share=0.05).pairs("test"))
    clean = next(Mixture(of=["furniture"]).pairs("test"))
    assert np.array_equal(pair.source.mesh.faces, pair.target.mesh.faces)
    assert pair.landmarks == clean.landmarks and pair.corresponding
    for soiled, other in ((pair.source, clean.source), (pair.target, clean.target)):
        assert np.array_equal(soiled.mesh.vertices[: len(other.mesh.vertices)], other.mesh.vertices)
        parts, closest = soiled.attributes["part"], MeshSurface(other.mesh)
        assert len(parts) == len(soiled.mesh.faces)
        sound = soiled.mesh.area_faces > 0
        near = closest.project(soiled.mesh.triangles_center[sound])
        same = other.attributes["part"][near.faces] == parts[sound]
        assert near.distance.max() < 1e-9 and same.mean() > 0.95  # parts overlap where they are joined


def test_wrong_parameters_are_named():
    with pytest.raises(ValueError, match="^dirt: expected some of"):
        Dirty(of=["cad"], dirt=["dust"])
    with pytest.raises(ValueError, match="^share: expected"):
        Dirty(of=["cad"], share=0)
    assert not hasattr(Dirty(of=["cad"]), "pairs")
