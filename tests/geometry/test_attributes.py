"""Colours and scalars follow their points: to equal positions, row by row, or to the nearest point."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import trimesh

from bench import BadInput, PointCloud
from bench.geometry.attributes import carried, same_places
from bench.geometry.io.files import load_cloud, save
from bench.notices import collected

RNG = np.random.default_rng(0)
P = RNG.normal(size=(200, 3))
CLOUD = PointCloud(P, None, RNG.integers(0, 256, (200, 3)) / 255, {"intensity": RNG.normal(size=200), "t": P[:, 0]})


def same(cloud: PointCloud, other: PointCloud) -> bool:
    arrays, others = cloud.arrays(), other.arrays()
    return arrays.keys() == others.keys() and all(
        np.array_equal(arrays[name], others[name], equal_nan=True) for name in arrays
    )


def test_scalars_are_validated_frozen_and_copied_with_the_cloud():
    for again in (PointCloud.of(CLOUD.arrays()), pickle.loads(pickle.dumps(CLOUD)), copy.deepcopy(CLOUD)):
        assert same(again, CLOUD)
    with pytest.raises(ValueError, match="read-only"):
        CLOUD.scalars["t"][0] = 1
    with pytest.raises(TypeError):
        CLOUD.scalars["t"] = P[:, 0]
    with pytest.raises(BadInput, match=r"scalars\['t'\]: expected shape \(200,\), got \(3,\)"):
        PointCloud(P, scalars={"t": [1, 2, 3]})
    assert list(PointCloud(P).arrays()) == ["points"] and dict(PointCloud(P).scalars) == {}
    assert CLOUD.moved(2 * P).colors is CLOUD.colors  # frozen arrays are not copied
    assert np.array_equal(CLOUD.subset(P[:, 0] > 0).scalars["t"], P[P[:, 0] > 0, 0])


def test_equal_positions_match_a_loop():
    points = RNG.integers(0, 3, (40, 3)).astype(float)
    others = np.concatenate([points[RNG.permutation(40)[:30]], [[9, 9, 9], [-0.0, 0, 0]]])
    rows, found = same_places(points, others)
    places, taken = [tuple(p) for p in points], {}
    for k, place in enumerate(map(tuple, others + 0.0)):
        having = [row for row, p in enumerate(places) if p == place]
        nth = taken[place] = taken.get(place, -1) + 1
        assert found[k] == bool(having) and (not having or rows[k] == having[min(nth, len(having) - 1)])


def test_a_subset_keeps_all_attributes_without_a_notice():
    kept = RNG.permutation(200)[:150]
    with collected() as notices:
        assert same(carried(CLOUD, PointCloud(P[kept])), CLOUD.subset(kept))
    assert not notices


def test_moved_points_in_order_keep_their_rows():
    moved = P + 0.05 * RNG.normal(size=P.shape)
    with collected() as notices:
        assert same(carried(CLOUD, PointCloud(moved)), CLOUD.moved(moved))
    assert "row by row" in notices[0] and "intensity" in notices[0]


@pytest.mark.parametrize("count", [200, 300])
def test_points_in_another_order_take_the_attributes_of_the_nearest(count):
    source = RNG.integers(0, 200, count)
    moved = P[source] + 1e-6 * RNG.normal(size=(count, 3))
    with collected() as notices:
        assert same(carried(CLOUD, PointCloud(moved)), CLOUD.subset(source).moved(moved))
    assert "nearest" in notices[0]


def test_an_output_keeps_its_own_attributes():
    own = PointCloud(P, P / np.linalg.norm(P, axis=1, keepdims=True), np.zeros((200, 3)), {"t": np.ones(200)})
    out = carried(CLOUD, own)
    assert np.array_equal(out.colors, own.colors) and np.array_equal(out.scalars["t"], own.scalars["t"])
    assert np.array_equal(out.scalars["intensity"], CLOUD.scalars["intensity"]) and out.normals is not None


def test_a_mesh_whose_vertices_are_input_points_has_their_colours(tmp_path):
    hull = trimesh.convex.convex_hull(P)
    rows, found = same_places(P, hull.vertices)
    assert found.all()
    save(carried(CLOUD, trimesh.Trimesh(hull.vertices, hull.faces, process=False)), tmp_path / "hull.ply")
    assert np.array_equal(load_cloud(tmp_path / "hull.ply").colors, CLOUD.colors[rows])
    with collected() as notices:
        for suffix in (".off", ".stl", ".obj"):
            save(carried(CLOUD, trimesh.Trimesh(hull.vertices, hull.faces, process=False)), tmp_path / f"hull{suffix}")
    assert (
        ["OFF holds no colours" in notices[0], "STL holds no colours" in notices[1]]
        == [True, True]
        == [True] * len(notices)
    )
    assert np.abs(load_cloud(tmp_path / "hull.obj").colors - CLOUD.colors[rows]).max() < 1e-15
    moved = trimesh.Trimesh(hull.vertices * 1.1, hull.faces, process=False)
    assert carried(CLOUD, moved).visual.kind is None


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".asc", ".csv"])
@pytest.mark.parametrize("scale", [255, 65535, 0])
def test_text_files_keep_all_attributes_of_a_cloud(tmp_path, suffix, scale):
    colors = RNG.integers(0, scale + 1, (200, 3)) / scale if scale else RNG.random((200, 3))
    normals = P / np.linalg.norm(P, axis=1, keepdims=True)
    scalars = dict(CLOUD.scalars) | {
        "gps time": 3e8 + np.arange(200) / 7,
        "missing": np.where(P[:, 0] > 0, P[:, 0], np.nan),
    }
    cloud = PointCloud(P + 5e6, normals, colors, scalars)
    with collected() as notices:
        save(cloud, tmp_path / f"a{suffix}")
        again = load_cloud(tmp_path / f"a{suffix}")
    assert np.abs(again.normals - normals).max() < 1e-15, notices
    assert not notices
    renamed = {name.replace(" ", "_"): values for name, values in scalars.items()}
    assert same(again, PointCloud(cloud.points, again.normals, colors, renamed))
    bare = np.loadtxt(
        tmp_path / f"a{suffix}", delimiter="," if suffix == ".csv" else None, skiprows=int(suffix == ".csv")
    )
    assert bare.shape == (200, 13) and np.array_equal(bare[:, :3], cloud.points)
