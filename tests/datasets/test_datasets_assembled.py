"""Families assembled from parts: fractals, furniture, humanoids and scenes."""

from __future__ import annotations

import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from bench.datasets import fractals, furniture, humanoids, scenes
from bench.datasets.figures import poses, skeleton, skinning
from bench.datasets.figures.bodies import body, template
from bench.datasets.figures.builds import Build, shaped
from bench.datasets.solids import furniture_parts
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology

FAMILIES = {
    "fractals": fractals.Fractals(),
    "furniture": furniture.Furniture(),
    "humanoids": humanoids.Humanoids(),
    "scenes": scenes.Scenes(),
}
SHAPES = [shape for family in FAMILIES.values() for shape in islice(family.shapes("test"), 8)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.id)
def test_a_shape_has_the_stated_properties(shape):
    mesh, info = shape.mesh, shape.info
    counts = count_topology(mesh.vertices, mesh.faces)
    assert counts.watertight and counts.boundary_edges == 0
    assert (counts.components, counts.genus) == (info.get("components", 1), info["genus"])
    assert mesh.is_winding_consistent and mesh.volume > 0
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert mesh.area_faces.min() > 1e-12
    found = shape.traits
    assert ("high_genus" in found.tags) == (info["genus"] >= 10)
    if "gap" in info and info["gap"] > 0.035:  # of the diagonal, about two radii: more than the threshold of the tag
        assert "near_contact" not in found.tags
    if "sharp" in found.tags:
        assert (mesh.face_adjacency_angles > np.radians(30)).sum() > 10
        assert "smooth" not in found.tags
    assert shape.tags == (info.get("kind") or info.get("category") or info["pose"],)


@pytest.mark.parametrize("name", FAMILIES)
def test_shapes_are_repeatable_and_splits_differ(name):
    family = FAMILIES[name]
    first, again = (next(family.shapes("test")).mesh for _ in range(2))
    assert first.vertices.tobytes() == again.vertices.tobytes() and first.faces.tobytes() == again.faces.tobytes()
    assert first.vertices.tobytes() != next(family.shapes("train")).mesh.vertices.tobytes()


def test_listing_builds_nothing():
    script = (
        "import sys\nfrom itertools import islice\n"
        "from bench.datasets import fractals, furniture, humanoids, scenes\n"
        "for family in (fractals.Fractals, furniture.Furniture, humanoids.Humanoids, scenes.Scenes):\n"
        "    list(islice(family().shapes('test'), 8))\n"
        "list(islice(humanoids.Humanoids().pairs('test'), 4)), list(islice(furniture.Furniture().pairs('test'), 4))\n"
        "list(islice(humanoids.Humanoids().transfers('test'), 4))\n"
        "assert not {'manifold3d', 'trimesh', 'scipy', 'open3d', 'skimage'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.parametrize(
    "make",
    [
        lambda: fractals.Fractals(kind="snail"),
        lambda: furniture.Furniture(category="sofa"),
        lambda: humanoids.Humanoids(jitter=-1),
        lambda: humanoids.Humanoids(variety=2),
        lambda: scenes.Scenes(gap_low=0.5),
        lambda: scenes.Scenes(gap_high=0.5),
        lambda: scenes.Scenes(kind="room"),
    ],
)
def test_wrong_parameters_are_named(make):
    with pytest.raises(ValueError, match=r"^(kind|category|jitter|variety|gap_low|gap_high): expected"):
        make()


# -- fractals ----------------------------------------------------------------------------------------------------------


def test_the_genus_of_the_menger_sponge():
    """The closed form against a naive count of blocks, sides, edges and corners (Euler)."""
    for level in (1, 2):
        n = 3**level
        digits = [[i // 3**k % 3 for k in range(level)] for i in range(n)]
        cells = [
            (i, j, k)
            for i in range(n)
            for j in range(n)
            for k in range(n)
            if all((a == 1) + (b == 1) + (c == 1) < 2 for a, b, c in zip(digits[i], digits[j], digits[k], strict=True))
        ]
        # A block covers 27 cells of the doubled grid; the Euler characteristic is an alternating sum over them.
        solid = {
            (2 * i + a, 2 * j + b, 2 * k + c) for i, j, k in cells for a in range(3) for b in range(3) for c in range(3)
        }
        euler = sum((-1) ** (x % 2 + y % 2 + z % 2) for x, y, z in solid)
        assert len(cells) == 20**level and fractals.menger_genus(level) == 1 - euler
    assert fractals.menger_genus(3) == 1409


def test_a_twisted_koch_prism_does_not_cross_itself():
    """The others are made by boolean operations or from whole blocks, and cannot cross themselves."""
    small = (s for s in fractals.Fractals(kind="koch").shapes("test") if s.info["level"] == 2)
    for shape in islice(small, 2):
        assert not self_intersecting_faces(shape.mesh.vertices, shape.mesh.faces).any()


def test_kinds_of_fractals_alternate_and_are_rotated():
    shapes = SHAPES[:4]
    assert [shape.info["kind"] for shape in shapes] == list(fractals.KINDS)
    assert all(np.abs(shape.mesh.face_normals).max(axis=1).mean() < 0.99 for shape in shapes)


# -- furniture ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("category", furniture_parts.CATEGORIES)
def test_the_stated_genus_of_furniture_and_its_labels(category):
    for shape in islice(furniture.Furniture(category=category).shapes("train"), 6):
        counts = count_topology(shape.mesh.vertices, shape.mesh.faces)
        assert (counts.components, counts.genus) == (1, shape.info["genus"]), shape.id
        labels = shape.attributes["part"]
        assert labels.shape == (len(shape.mesh.faces),)
        assert set(labels) == set(range(len(shape.info["parts"])))


@pytest.mark.parametrize("category", furniture_parts.CATEGORIES)
def test_all_shapes_of_a_category_have_the_same_faces(category):
    pairs = [*islice(furniture.Furniture(category=category).pairs("test"), 3)]
    faces = pairs[0].source.mesh.faces
    for pair in pairs:
        assert pair.landmarks == pairs[0].landmarks and len(pair.landmarks) >= 8
        for shape in (pair.source, pair.target):
            assert (shape.mesh.faces == faces).all()
            counts = count_topology(shape.mesh.vertices, shape.mesh.faces)
            assert counts == (len(shape.info["parts"]), 0, 0, True, 0)
            assert shape.mesh.volume > 0
            feet = [shape.mesh.vertices[v] for name, v in pair.landmarks.items() if name.endswith("foot")]
            assert len(feet) == 4 and np.allclose(np.array(feet)[:, 2], 0, atol=0.01)
            lefts = [shape.mesh.vertices[v, 0] for name, v in pair.landmarks.items() if "left" in name]
            assert min(lefts) > 0
        assert not np.allclose(pair.source.mesh.vertices, pair.target.mesh.vertices)


# -- humanoids ---------------------------------------------------------------------------------------------------------


def test_the_template_is_on_the_implicit_body():
    V, F = template()
    assert 6_800 < len(V) < 7_200 and np.abs(body()(V)).max() < 2e-4
    assert count_topology(V, F) == (1, 0, 0, True, 0)
    assert not self_intersecting_faces(V, F).any()


def test_weights_are_a_smooth_partition_of_unity():
    V, F = template()
    W = humanoids.skin()
    assert W.min() >= 0 and np.allclose(W.sum(axis=1), 1)
    assert W.max(axis=0).min() > 0.25  # all vertices of the pelvis are shared with spine or thighs
    edges = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]])
    assert np.abs(W[edges[:, 0]] - W[edges[:, 1]]).max() < 0.9
    hand = humanoids.Landmarks()["left_hand"]
    assert W[hand, [n.startswith("right") for n in skeleton.NAMES]].sum() < 1e-3


def test_weights_do_not_depend_on_rounding():
    """Processors round differently, and vertices at a joint are equally near to two bones."""
    V, F = template()
    noise = 1e-12 * np.random.default_rng(0).normal(size=V.shape)
    W = skinning.heat_weights(V + noise, F, skeleton.REST, skeleton.ENDS)
    assert np.abs(W - humanoids.skin()).max() < 2e-4  # weights below 1e-4 are set to zero


def test_skinning_with_one_rigid_motion_is_that_motion():
    rng = np.random.default_rng(0)
    V, W = rng.normal(size=(50, 3)), rng.dirichlet(np.ones(4), size=50)
    R, t = skeleton.rotation_about(rng.normal(size=3), 2.5), rng.normal(size=3)
    posed = skinning.dual_quaternion_skinning(V, W, np.tile(R, (4, 1, 1)), np.tile(t, (4, 1)))
    assert np.allclose(posed, V @ R.T + t)


def test_skinning_of_a_vertex_of_one_bone_follows_that_bone():
    rotations = poses.joint_rotations(poses.KEYS["run"])
    turns, shifts = skeleton.forward(skeleton.REST, rotations)
    V, W = skeleton.ENDS, np.eye(len(skeleton.NAMES))
    expected = np.array([R @ x + t for R, x, t in zip(turns, V, shifts, strict=True)])
    assert np.allclose(skinning.dual_quaternion_skinning(V, W, turns, shifts), expected)


def test_the_rest_pose_is_the_template_and_joints_stay_connected():
    V, _ = template()
    still, joints = shaped(V, humanoids.skin(), Build())
    assert np.allclose(still, V) and np.allclose(joints, skeleton.REST)
    turns, shifts = skeleton.forward(joints, poses.joint_rotations(poses.KEYS["kick"]))
    for child, parent in enumerate(skeleton.PARENTS):
        if parent >= 0:  # both bones of a joint place it equally
            assert np.allclose(*(turns[j] @ joints[child] + shifts[j] for j in (child, parent)))


def test_knees_bend_backwards_and_elbows_forwards():
    for freedom, joint, bend in (("left_knee", "left_ankle", 1), ("right_elbow", "right_wrist", -1)):
        turns, shifts = skeleton.forward(skeleton.REST, poses.joint_rotations({freedom: 60}))
        j = skeleton.NAMES.index(joint)
        moved = turns[j] @ skeleton.REST[j] + shifts[j] - skeleton.REST[j]
        assert bend * moved[1] > 0.15


def test_key_poses_respect_the_limits_and_keep_bones_apart():
    for name, angles in poses.KEYS.items():
        for freedom, angle in angles.items():
            low, high = poses.FREEDOMS[freedom][2:]
            assert low <= angle <= high, (name, freedom)
        for seed in range(3):
            assert poses.clearance(poses.draw_pose(name, np.random.default_rng(seed))) > 0


@pytest.mark.parametrize("index", [5, 11, 51])  # squat, guard, run: calf and thigh, forearm and arm, hand and hip
def test_no_body_crosses_itself(index):
    shape = next(islice(FAMILIES["humanoids"].shapes("test"), index, None))
    assert not self_intersecting_faces(shape.mesh.vertices, shape.mesh.faces).any()


@pytest.mark.parametrize("build", [Build(), Build(bulk=1, muscle=1, arms=-1, legs=-1), Build(bulk=-1, arms=1, legs=1)])
def test_bent_limbs_of_any_thickness_do_not_cross_themselves(build):
    limits = poses.bend_limits([build])
    assert 70 < limits["left_elbow"] <= 106 and 80 < limits["right_knee"] <= 110
    for twist in (-50, 50):
        bent = limits | {"left_forearm_twist": twist, "left_leg_swing": 90, "left_leg_out": 24, "left_leg_twist": 15}
        mesh = humanoids.posed_body(build, poses.joint_rotations(bent))[0]
        bone = np.array(skeleton.NAMES)[humanoids.skin().argmax(axis=1)]
        for bones in (("left_shoulder", "left_elbow", "left_wrist"), ("left_hip", "left_knee", "left_ankle")):
            part = np.isin(bone, bones)[mesh.faces].all(axis=1)
            assert not self_intersecting_faces(mesh.vertices, mesh.faces[part]).any(), (bones, twist)


def test_pairs_and_transfers_share_faces_and_landmarks():
    faces = template()[1]
    for pair in islice(FAMILIES["humanoids"].pairs("test"), 2):
        assert (pair.source.mesh.faces == faces).all() and (pair.target.mesh.faces == faces).all()
        assert not np.allclose(pair.source.mesh.vertices, pair.target.mesh.vertices)
    marks, rest = pair.landmarks, template()[0]
    assert len(marks) > 15 and len(set(marks.values())) == len(marks)
    assert rest[marks["head_top"], 2] > 1.7 and rest[marks["left_toe"], 1] < -0.15
    assert rest[marks["left_hand"], 0] > 0.6 > -0.6 > rest[marks["right_hand"], 0]


@pytest.fixture(scope="module")
def transfers():
    return {t.character.tags[0]: t for t in islice(FAMILIES["humanoids"].transfers("test"), 4)}


def test_transfers_pose_another_figure(transfers):
    assert set(transfers) == {"body", "robot", "skeleton", "stout"}
    for kind, transfer in transfers.items():
        assert (transfer.template_posed.mesh.faces == transfer.template.mesh.faces).all()
        assert (transfer.character_posed.mesh.faces == transfer.character.mesh.faces).all()
        assert len(transfer.character.mesh.vertices) >= 5000  # enough for cotangent Laplacians
        assert transfer.character.mesh.is_watertight and transfer.character.mesh.volume > 0
        apart = transfer.character.mesh.vertices - transfer.character_posed.mesh.vertices
        assert np.linalg.norm(apart - apart.mean(axis=0), axis=1).mean() > 0.05, kind
        if kind != "body":
            assert len(transfer.character.mesh.faces) != len(template()[1])


@pytest.mark.parametrize("kind", ["robot", "skeleton"])
def test_rigid_parts_stay_rigid(transfers, kind):
    """Posing changes no edge length, and each part moves rigidly."""
    rest, posed = transfers[kind].character.mesh, transfers[kind].character_posed.mesh
    edges = rest.edges_unique
    lengths = [np.linalg.norm(m.vertices[edges[:, 0]] - m.vertices[edges[:, 1]], axis=1) for m in (rest, posed)]
    np.testing.assert_allclose(*lengths, atol=1e-9)
    assert rest.volume == pytest.approx(posed.volume, rel=1e-9)


def test_landmarks_are_where_rays_from_the_joints_leave_a_figure(transfers):
    from bench.geometry.mesh_surface import MeshSurface

    for kind, transfer in transfers.items():
        marks = transfer.landmarks
        assert len(marks) >= 83, kind  # as many as in the thesis
        places = np.array(list(marks.values()))
        for mesh, at in ((transfer.template.mesh, places[:, 0]), (transfer.character.mesh, places[:, 1])):
            assert MeshSurface(mesh).project(at).distance.max() < 1e-5, kind
        front, back = marks["head_front"], marks["head_back"]
        assert (front[:, 1] < back[:, 1] - 0.04).all() and (marks["left_knee_left"][:, 0] > 0.05).all()


def test_rays_leave_nested_and_overlapping_parts_together():
    """A ray leaves a ball within a block where it leaves the block, and overlapping balls where it leaves the last."""
    from trimesh.creation import box, icosphere

    from bench.datasets.figures.landmarks import exits

    block, ball = box((0.2, 0.2, 0.2)), icosphere(subdivisions=3, radius=0.05)
    far = icosphere(subdivisions=3, radius=0.05)
    far.apply_translation((0, -0.3, 0))  # ignored: behind a gap
    places = exits(block + ball + far, np.zeros((len(skeleton.NAMES), 3)))
    assert np.abs(places["spine_front"][1] + 0.1) < 1e-5 and np.abs(places["spine_left"][0] - 0.1) < 1e-5
    assert exits(far, np.zeros((len(skeleton.NAMES), 3))) == {}


def test_a_kind_of_character_can_be_chosen():
    kinds = [t.character.tags for t in islice(humanoids.Humanoids(characters="robot").transfers("train"), 3)]
    assert kinds == [("robot",)] * 3
    with pytest.raises(ValueError, match="characters: expected all, body"):
        humanoids.Humanoids(characters="cat")


# -- scenes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", scenes.KINDS)
def test_the_stated_gap_is_the_nearest_distance_between_solids(kind):
    import igl

    for shape in islice(scenes.Scenes(kind=kind).shapes("test"), 2):
        pieces = shape.mesh.split(only_watertight=False)
        nearest = np.inf
        for one in pieces:
            for other in pieces:
                if one is not other:
                    V, F = np.array(other.vertices), np.array(other.faces, dtype=np.int64)
                    nearest = min(nearest, igl.point_mesh_squared_distance(np.array(one.vertices), V, F)[0].min())
        assert np.sqrt(nearest) == pytest.approx(shape.info["gap"] * shape.info["size"], rel=0.01)
