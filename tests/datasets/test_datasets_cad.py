"""Parts: closed manifolds of one component with the stated genus."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from bench import generator
from bench.datasets.cad import Cad
from bench.datasets.solids.parts import KINDS

SHAPES = [*islice(Cad().shapes("test"), 3 * len(KINDS))]


def digest(shapes) -> str:
    total = hashlib.sha256()
    for shape in shapes:
        total.update(shape.mesh.vertices.tobytes() + shape.mesh.faces.tobytes())
    return total.hexdigest()


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_a_part_has_the_stated_properties(shape):
    mesh = shape.mesh
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert mesh.body_count == 1
    assert (2 - mesh.euler_number) // 2 == shape.info["genus"]
    assert np.unique(np.asarray(mesh.vertices), axis=0).shape == mesh.vertices.shape  # manifold even as a triangle soup
    sharp = mesh.face_adjacency_angles > np.radians(60)
    assert sharp.sum() > 10 and "sharp" in shape.traits.tags
    assert shape.traits.genus == shape.info["genus"]
    assert shape.tags == (shape.info["kind"],)


@pytest.mark.parametrize("kind", KINDS)
def test_the_stated_measures_of_a_part(kind):
    """The stated size is the diagonal of the box, and no wall that a ray crosses is thinner than stated."""
    for index in range(3):
        rng = generator("measures", kind, index)
        part = KINDS[kind](rng)
        solid = part.build()
        box = np.array(solid.bounding_box()).reshape(2, 3)
        assert np.linalg.norm(box[1] - box[0]) == pytest.approx(part.size, rel=0.02)
        assert 1.2 < part.size < 4
        assert part.thinnest > 0.01 * part.size
        assert solid.genus() == part.genus


@pytest.mark.parametrize("kind", KINDS)
def test_no_wall_is_thinner_than_stated(kind):
    """Rays into the solid from its surface do not leave it before the stated thickness."""
    import open3d as o3d

    for shape in islice(Cad(kind=kind).shapes("test"), 2):
        mesh = shape.mesh
        diagonal = KINDS[kind](generator("cad", "test", int(shape.id.split("-")[2]))).size
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32))
        points, normals = shape.surface.sample(4000, generator(0))
        start = points - 1e-4 * normals
        hits = scene.cast_rays(np.hstack([start, -normals]).astype(np.float32))["t_hit"].numpy() + 1e-4
        # A few rays near corners cross a thinner wedge.
        assert np.quantile(hits / diagonal, 0.03) > 0.9 * shape.info["thickness"]
        assert np.quantile(hits / diagonal, 0.03) > 0.01


def test_kinds_alternate():
    assert [shape.info["kind"] for shape in SHAPES[: len(KINDS)]] == list(KINDS)
    assert {tag for shape in SHAPES for tag in shape.traits.tags} >= {"sharp", "thin", "high_genus"}
    assert len({shape.id for shape in SHAPES}) == len(SHAPES)


def test_one_kind_alone():
    assert {shape.info["kind"] for shape in islice(Cad(kind="gear").shapes("test"), 3)} == {"gear"}
    with pytest.raises(ValueError, match="^kind: expected one of"):
        Cad(kind="spoon")


def test_shapes_are_bitwise_equal_in_repeated_calls_and_another_process():
    first = digest(SHAPES[:7])
    assert digest(islice(Cad().shapes("test"), 7)) == first
    script = (
        "import hashlib, sys\nfrom itertools import islice\nfrom bench.datasets.cad import Cad\n"
        "total = hashlib.sha256()\n"
        "for s in islice(Cad().shapes('test'), 7): total.update(s.mesh.vertices.tobytes() + s.mesh.faces.tobytes())\n"
        "sys.stdout.write(total.hexdigest())"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout == first


def test_splits_differ_and_parts_of_a_kind_differ():
    train = [*islice(Cad().shapes("train"), 7)]
    meshes = [shape.mesh.vertices.tobytes() for shape in train + SHAPES]
    assert len(set(meshes)) == len(meshes)


def test_parts_are_rotated():
    box = next(Cad(kind="block").shapes("test")).mesh
    assert np.abs(box.face_normals).max(axis=1).mean() < 0.99


def test_nothing_is_built_before_it_is_needed():
    script = (
        "import sys\nfrom itertools import islice\nfrom bench.datasets.cad import Cad\n"
        "list(islice(Cad().shapes('test'), 9))\nassert not {'manifold3d', 'trimesh', 'scipy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
