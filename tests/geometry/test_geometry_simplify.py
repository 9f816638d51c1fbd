"""Simplified meshes against closed forms: flat parts lose nothing, a sphere the height of its chords."""

import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.geometry.io.files import load_cloud, save
from bench.geometry.nearest_colors import with_nearest_colors
from bench.geometry.plain_mesh import plain_mesh
from bench.geometry.simplify import mesh_distance, simplify
from bench.geometry.topology import count_topology, pieces
from bench.notices import collected


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_a_box_far_from_the_origin_loses_nothing(rng):
    box = trimesh.creation.box((3, 2, 1)).subdivide().subdivide()
    far = plain_mesh(box.vertices + (5e5, 5e6, 300), box.faces)
    fewer = simplify(far, 14)
    assert len(fewer.faces) == 14 and count_topology(fewer.vertices, fewer.faces).watertight
    assert abs(fewer.volume - 6) < 1e-3
    distance = mesh_distance(far, fewer, rng)
    assert distance.largest < 1e-6 and abs(distance.diagonal - np.sqrt(14)) < 1e-6


def test_a_mesh_with_few_enough_faces_stays_the_same():
    ball = trimesh.creation.icosphere(2)
    assert simplify(ball, len(ball.faces)) is ball


def test_the_boundary_of_an_open_sheet_stays(rng):
    grid = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
    sheet = plain_mesh(grid.vertices, grid.faces[grid.face_normals[:, 2] > 0.9])
    fewer = simplify(sheet, 10)
    assert len(fewer.faces) <= 10 and abs(fewer.area - 1) < 1e-9


def test_distances_of_two_spheres_and_of_a_spike(rng):
    inner, outer = trimesh.creation.icosphere(5), trimesh.creation.icosphere(5, radius=1.25)
    distance = mesh_distance(inner, outer, rng)
    assert abs(distance.rms - 0.25) < 1e-3 and abs(distance.largest - 0.25) < 1e-3
    spiked = plain_mesh(inner.vertices, inner.faces)
    spiked.vertices[7] *= 2  # too thin to be sampled
    assert abs(mesh_distance(inner, spiked, rng).largest - 1) < 1e-3


def test_pieces_are_connected_through_vertices():
    ball = trimesh.creation.icosphere(1)
    two = trimesh.util.concatenate([ball, ball.copy().apply_translation([3, 0, 0])])
    assert pieces(two.faces) == 2 and pieces(two.faces + 5) == 2 and pieces(np.empty((0, 3), int)) == 0


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_vertices_take_the_colours_of_the_nearest_points_and_keep_them_in_files(suffix, rng, tmp_path):
    points = rng.normal(size=(200, 3))
    cloud = PointCloud(points, colors=np.rint(255 * rng.random((200, 3))) / 255)
    ball = trimesh.creation.icosphere(1)
    nearest = np.linalg.norm(ball.vertices[:, None] - points, axis=2).argmin(axis=1)
    save(with_nearest_colors(ball, cloud), tmp_path / f"mesh{suffix}")
    if suffix == ".glb":
        back = trimesh.load(tmp_path / "mesh.glb", force="mesh").visual.vertex_colors[:, :3] / 255
    else:
        back = load_cloud(tmp_path / f"mesh{suffix}").colors
    assert np.abs(back - cloud.colors[nearest]).max() < 1e-4
    dense = with_nearest_colors(PointCloud(points + 1e-6, points), cloud)
    assert np.array_equal(dense.colors, cloud.colors) and dense.normals is not None


def test_a_file_format_without_colours_is_reported(tmp_path):
    colored = with_nearest_colors(trimesh.creation.icosphere(1), PointCloud(np.eye(3), colors=np.eye(3)))
    with collected() as notices:
        save(colored, tmp_path / "mesh.stl")
        save(colored, tmp_path / "mesh.off")
    assert [n.partition(" holds")[0] for n in notices] == ["STL", "OFF"]
