"""``detailbench score``: two files, on the spot."""

import json

import numpy as np
import pytest
import trimesh
from scipy.io import savemat

from bench import PointCloud, generator
from bench.cli import main
from bench.geometry.io.files import save

FEW = ("--samples", "2000")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A ball of radius 50 far from the origin, the same 2 % larger, and clouds of both."""
    folder = tmp_path_factory.mktemp("files")
    ball = trimesh.creation.icosphere(3)
    place = lambda scale: trimesh.Trimesh(ball.vertices * 50 * scale + [100, 200, 300], ball.faces, process=False)  # noqa: E731
    save(place(1), folder / "reference.ply")
    save(place(1.02), folder / "output.obj")
    points = generator(0).normal(size=(1500, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    save(PointCloud(points * 51 + [100, 200, 300], points), folder / "cloud.ply")
    save(PointCloud(points[:700] * 50 + [100, 200, 300]), folder / "scan.xyz")
    return folder


def scored(capsys, *words):
    assert main(["score", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_table_with_floors(files, capsys):
    assert main(["score", str(files / "output.obj"), str(files / "reference.ply"), *FEW]) == 0
    text = capsys.readouterr().out
    assert "1,280 faces" in text and "1 is 50 in the files' coordinates" in text and "2,000 points" in text
    for key in ("chamfer_l2_sum", "p2f_mean", "fscore@0.01", "watertight"):
        assert key in text


def test_lengths_are_in_radii_of_the_reference(files, capsys):
    found = scored(capsys, files / "output.obj", files / "reference.ply", "--metric", "p2f_mean,s2f", *FEW)
    assert found["scores"]["p2f_mean"] == pytest.approx(0.02, rel=0.01)
    assert found["scores"]["s2f_max"] == pytest.approx(0.02, rel=0.01)
    assert found["floors"]["p2f_mean"] < 1e-12
    assert found["frame"] == {"center": pytest.approx([100, 200, 300]), "radius": pytest.approx(50)}
    assert found["better"] == dict.fromkeys(("p2f_mean", "s2f_mean", "s2f_rms", "s2f_max"), "lower")


def test_seed_and_samples(files, capsys):
    words = (files / "output.obj", files / "reference.ply", "--metric", "chamfer_l1_mean")
    first, again, other = (scored(capsys, *words, *FEW, "--seed", seed)["scores"] for seed in (0, 0, 1))
    assert first == again != other
    more = scored(capsys, *words, "--samples", 20_000)
    assert more["floors"]["chamfer_l1_mean"] == pytest.approx(0.5 * np.sqrt(4 * np.pi / 20_000), rel=0.03)


def test_everything_there_is(files, capsys):
    mesh = scored(capsys, files / "output.obj", files / "reference.ply", "--metric", "full", "--samples", 500)
    assert mesh["scores"]["iou"] == pytest.approx(1.02**-3, abs=0.01)
    assert set(mesh["left_out"]) == {
        "cot_laplacian",
        "dtu_distances",
        "even_distances",
        "mirror_chamfer_l2_sum",
        "projected_uniformity",
        "spacing_variation",
        "uniformity",
    }
    cloud = scored(capsys, files / "cloud.ply", files / "reference.ply", "--metric", "full", "--samples", 500)
    assert cloud["scores"]["normal_cosine_oriented"] > 0.98
    assert {"iou", "topology", "s2f"} <= set(cloud["left_out"])


def test_a_cloud_as_reference(files, capsys):
    found = scored(capsys, files / "cloud.ply", files / "scan.xyz", "--metric", "standard,coverage,directed")
    # The scan is a part of the cloud on a smaller sphere: every one of its points is 0.02 from its twin.
    assert found["scores"]["to_output_p50"] == pytest.approx(0.02, rel=0.02)
    assert found["floors"] == {}
    assert found["left_out"]["p2f_mean"] == found["left_out"]["coverage"] == "needs a reference that is a mesh"
    assert scored(capsys, files / "scan.xyz", files / "scan.xyz", "--metric", "hausdorff")["scores"] == {"hausdorff": 0}


def test_a_convention(files, capsys):
    words = (files / "cloud.ply", files / "reference.ply")
    found = scored(capsys, *words, "--convention", "dss", *FEW)
    plain = scored(capsys, *words, "--metric", "box_scaled_distances", *FEW)
    assert found["scores"]["CD (1e-4)"] == pytest.approx(176400 * plain["scores"]["chamfer_l2_sum_by_diagonal"])
    assert found["floors"]["HD (1e-3)"] == pytest.approx(17640 * plain["floors"]["hausdorff_sq_sum_by_diagonal"])
    assert main(["score", *map(str, words), "--convention", "dss", *FEW]) == 0
    shown = capsys.readouterr().out
    assert "CD (1e-4) = 176400 x chamfer_l2_sum_by_diagonal" in shown
    assert max(map(len, shown.split("convention dss")[1].splitlines())) <= 100


def test_the_source_of_a_deformation(files, capsys):
    words = (files / "output.obj", files / "reference.ply", "--metric", "cot_laplacian")
    found = scored(capsys, *words, "--source", files / "reference.ply")
    # |L v| / A is 2 on the unit sphere, and the output is 2 % larger.
    assert found["scores"]["cot_laplacian_per_area"] == pytest.approx(0.04, rel=0.02)
    assert main(["score", *map(str, words)]) == 1
    assert "cot_laplacian does not apply to these two" in capsys.readouterr().err


def test_other_coordinates_are_noticed(files, capsys):
    points = generator(1).normal(size=(50, 3))
    save(PointCloud(points), files / "elsewhere.ply")
    words = [str(files / "elsewhere.ply"), str(files / "reference.ply"), "--metric", "hausdorff", *FEW]
    assert main(["score", *words]) == 0
    assert "do not overlap; are they in the same coordinates?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "output, reference, words, message",
    [
        ("missing.ply", "reference.ply", (), "missing.ply: no such file"),
        ("empty.ply", "reference.ply", (), "empty.ply: is empty"),
        ("output.obj", "flat.obj", (), "flat.obj: all 1 faces are degenerate"),
        ("output.obj", "reference.ply", ("--metric", "p2f_men"), "Did you mean 'p2f_mean'"),
        ("output.obj", "reference.ply", ("--metric", ","), "--metric ',': expected a name"),
        ("output.obj", "reference.ply", ("--convention", "dsss"), "Did you mean 'dss'"),
        ("output.obj", "reference.ply", ("--convention", "dss", "--metric", "iou"), "the convention dss says which"),
        ("output.obj", "reference.ply", ("--samples", "0"), "--samples 0: expected at least 1"),
        ("output.obj", "reference.ply", ("--seed", "-1"), "--seed -1: expected at least 0"),
        ("output.obj", "reference.ply", ("--source", "scan.xyz"), "scan.xyz"),
        (
            "scan.xyz",
            "reference.ply",
            ("--metric", "iou,s2f"),
            "iou does not score a cloud; s2f does not score a cloud",
        ),
    ],
)
def test_errors_name_what_is_wrong(files, capsys, output, reference, words, message):
    (files / "empty.ply").write_bytes(b"")
    (files / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    words = [str(files / word) if word == "scan.xyz" else word for word in words]
    assert main(["score", str(files / output), str(files / reference), *words]) == 1
    assert message in capsys.readouterr().err


def test_lengths_in_the_units_of_the_files(files, capsys):
    """Radius 2: lengths are twice those in radii, squares four times, shares and angles the same; floors go along."""
    words = ("sphere2.ply", "sphere2_moved.ply")
    ball = trimesh.creation.icosphere(3, radius=2)
    save(ball, files / words[0])
    save(trimesh.Trimesh(ball.vertices * (1.02, 1, 1), ball.faces, process=False), files / words[1])
    metrics = ["--metric", "chamfer_l1_mean,chamfer_l2_sum,fscore,normal_angle_deg,hausdorff", "--samples", "500"]
    found = {}
    for units in ("radius", "file"):
        assert main(["score", str(files / words[1]), str(files / words[0]), *metrics, "--units", units, "--json"]) == 0
        found[units] = json.loads(capsys.readouterr().out)
    assert [found[units]["units"] for units in found] == ["radius", "file"]
    factors = {"chamfer_l1_mean": 2, "chamfer_l2_sum": 4, "hausdorff": 2}
    for part in ("scores", "floors"):
        for key, value in found["radius"][part].items():
            assert found["file"][part][key] == pytest.approx(factors.get(key, 1) * value, rel=1e-12), key
    assert main(["score", str(files / words[1]), str(files / words[0]), *metrics, "--units", "file"]) == 0
    assert "Lengths are in the units of the files" in capsys.readouterr().out


def test_a_convention_has_its_own_units(files, capsys):
    assert main(["score", "a.ply", "b.ply", "--convention", "mpu", "--units", "file"]) == 1
    assert "the convention mpu says which units" in capsys.readouterr().err


def test_other_units_are_noticed(files, capsys):
    save(trimesh.creation.icosphere(2), files / "m.ply")
    save(trimesh.creation.icosphere(2, radius=1000), files / "mm.ply")
    assert main(["score", str(files / "m.ply"), str(files / "mm.ply"), "--metric", "hausdorff", "--samples", "99"]) == 0
    assert "1,000 times as large" in (err := capsys.readouterr().err) and "(millimetres against metres?)" in err


def test_the_distances_of_dtu(files, capsys):
    points = generator("dtu").uniform(0, 40, (400, 3))
    save(PointCloud(points), files / "stl.ply")
    save(PointCloud(points + (0.5, 0, 0)), files / "mvs.ply")
    savemat(
        files / "ObsMask1_10.mat", {"ObsMask": np.ones((5, 5, 5), np.uint8), "BB": [[0.0] * 3, [40.0] * 3], "Res": 10.0}
    )
    savemat(files / "Plane1.mat", {"P": [[0.0], [0.0], [1.0], [-20.0]]})
    words = ["score", str(files / "mvs.ply"), str(files / "stl.ply"), "--convention", "dtu_mm"]
    seen = ["--mask", str(files / "ObsMask1_10.mat"), "--plane", str(files / "Plane1.mat")]
    assert main([*words, *seen, "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)["scores"]
    assert scores["Acc. median (mm)"] == pytest.approx(0.5, abs=0.01) and scores["Overall (mm)"] == pytest.approx(
        0.5, abs=0.02
    )
    assert main(words) == 1
    assert "the reference has no observation mask" in capsys.readouterr().err
