"""The user's scans with their references: matched, listed, cropped, read, run, and rerun when a file changes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bench import BadInput, PointCloud, UsageError
from bench.contract.task import CaseRecipe
from bench.engine import call
from bench.geometry.cloud_surface import CloudSurface
from bench.geometry.io.files import CLOUD_READERS, save
from bench.plan.cell import Cell
from bench.plan.choice import Choice, NotSolved
from bench.plugins.registry import registry
from bench.results.provenance import fingerprint, ingredients
from bench.sweep.composition import resolved
from bench.sweep.overrides import check
from bench.sweep.request import Request
from bench.tasks.denoise import Denoise
from bench.tasks.upsample import Upsample

# By name: a plugin that is imported before all others are loaded does not count as an installed one.
Paired = registry().find("dataset", "paired").cls
Scan = registry().find("sensor", "scan").cls
NAMES = ("a", "b", "c")


def scan_of(mesh: trimesh.Trimesh, count: int) -> PointCloud:
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=3)
    return PointCloud(points, mesh.face_normals[faces], np.full((count, 3), 0.25))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Scans a, b and c with meshes and denser clouds as references, in millimetres, far from the origin."""
    for number, name in enumerate(NAMES):
        mesh = trimesh.creation.icosphere(1, radius=50 + number)
        mesh.vertices += (1000, 0, 0)
        for kind, geometry in (("mesh", mesh), ("cloud", scan_of(mesh, 400)), ("scans", scan_of(mesh, 100))):
            (tmp_path / kind).mkdir(exist_ok=True)
            file = {"mesh": f"{name}.off", "cloud": f"{name}.ply", "scans": f"{name}_noisy.ply"}[kind]
            save(geometry, tmp_path / kind / file)
    return tmp_path


def paired(folder: Path, **given) -> Paired:
    return Paired(**{"path": str(folder), "input": "scans/*_noisy.ply", "reference": "mesh/*.off", **given})


def matched(dataset: Paired, split: str = "test") -> list[tuple[str, str]]:
    return [(shape.info["scan"], shape.info["file"]) for shape in dataset.shapes(split)]


def recipes(dataset: Paired, task=None) -> Iterator[CaseRecipe]:
    return (task or Denoise()).recipes(dataset, Scan(), split="test", count=9, seed=0)


ALL = [(f"{name}_noisy.ply", f"{name}.off") for name in NAMES]


# --- matching of files ------------------------------------------------------------------------------------------------


def test_stars_match_names(folder):
    assert matched(paired(folder)) == ALL
    assert [shape.id for shape in paired(folder).shapes("test")] == list(NAMES)
    assert matched(paired(folder, input="scans/[ab]_noisy.ply", reference="mesh/a.off")) == [
        ALL[0],
        ("b_noisy.ply", "a.off"),
    ]


def test_names_match_where_folders_are_given(folder):
    for file in (folder / "scans").iterdir():
        file.rename(file.with_name(file.name.replace("_noisy", "")))
    assert matched(paired(folder, input="scans", reference="mesh")) == [(f"{n}.ply", f"{n}.off") for n in NAMES]
    assert matched(paired(folder, input="scans", reference="**/*.off")) == [(f"{n}.ply", f"{n}.off") for n in NAMES]


def test_other_and_hidden_files_beside_the_data_are_ignored(folder):
    for file in (folder / "scans").iterdir():
        file.rename(file.with_name(file.name.replace("_noisy", "")))
    for name in ("readme.txt", "._a.ply", ".hidden.ply"):
        (folder / "scans" / name).touch()
    assert matched(paired(folder, input="scans", reference="mesh")) == [(f"{n}.ply", f"{n}.off") for n in NAMES]


def test_without_a_common_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert matched(Paired(input="scans/*_noisy.ply", reference="mesh/*.off")) == ALL
    assert matched(Paired(input=str(folder / "scans/*_noisy.ply"), reference="mesh/*.off")) == ALL


def test_folders_may_be_matched(tmp_path):
    for name in NAMES:
        (tmp_path / name).mkdir()
        for file in ("scan.ply", "truth.ply"):
            save(scan_of(trimesh.creation.icosphere(1), 9), tmp_path / name / file)
    dataset = paired(tmp_path, input="*/scan.ply", reference="*/truth.ply")
    assert [pair.reference.parent.name for pair in dataset._named().values()] == list(NAMES) == list(dataset._named())


def test_numbers_match_with_and_without_zeros(tmp_path):
    for name in ("in/scan24_x.ply", "in/scan105_x.ply", "ref/stl024_total.ply", "ref/stl105_total.ply"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    dataset = paired(tmp_path, input="in/scan*_x.ply", reference="ref/stl*_total.ply")
    assert matched(dataset) == [("scan105_x.ply", "stl105_total.ply"), ("scan24_x.ply", "stl024_total.ply")]


def test_the_last_stars_are_matched_where_one_pattern_has_more(tmp_path):
    for name in ("scan/x/a.ply", "scan/y/b.ply", "mesh/a.ply", "mesh/b.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    dataset = paired(tmp_path, input="scan/*/*.ply", reference="mesh/*.ply")
    assert matched(dataset) == [("a.ply", "a.ply"), ("b.ply", "b.ply")]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"input": ""}, "dataset.input is empty; expected a point cloud"),
        ({"reference": ""}, "dataset.reference is empty; expected a mesh or a point cloud"),
        ({"path": "nowhere"}, r"dataset.path=nowhere: no such folder; expected one that holds scans/\*_noisy.ply"),
        ({"input": "scan/*.ply"}, r"scan/\*.ply \(in dataset.path=.*no file matches.*the folder should hold"),
        ({"reference": "mesh/[ab].off"}, r"1 of 3 scans have no reference \(c_noisy.ply\).*test_names=FILE"),
        ({"reference": "mesh/[a].off"}, r"2 of 3 scans have no reference \(b_noisy.ply, c_noisy.ply\)"),
        ({"reference": "**/*.off"}, "two files match it as its reference"),
    ],
)
def test_mismatched_patterns_are_refused(folder, given, says):
    if "**" in given.get("reference", ""):
        (folder / "mesh" / "more").mkdir()
        (folder / "mesh" / "more" / "a.off").touch()
    with pytest.raises(UsageError, match=says):
        list(paired(folder, **given).shapes("test"))


def test_folders_under_a_double_star_are_matched(tmp_path):
    for name in ("[1]/x/a/scan.ply", "[1]/x/a/truth.ply", "[1]/b/scan.ply", "[1]/b/truth.ply", "[1]/scan.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "[1]" / "truth.ply").touch()
    named = paired(tmp_path / "[1]", input="**/scan.ply", reference="**/truth.ply")._named().values()
    assert len(named) == 3 and all(pair.input.parent == pair.reference.parent for pair in named)


LAYOUTS = {
    "points2surf": (
        "04_pts/a.b_0.xyz.npy 04_pts/c.xyz.npy 03_meshes/a.b_0.ply 03_meshes/c.ply", ["a.b_0"],
    ),
    "pu1k": (
        "test/input_2048/input_2048/0269.37f2.xyz test/original_meshes/0269.37f2.off "
        "test/input_2048/input_2048/camel.xyz test/original_meshes/camel.off", ["0269.37f2", "camel"],
    ),
    "score_denoise": ("examples/PUNet_10000_poisson_0.02/duck.xyz PUNet/meshes/test/duck.off", ["duck"]),
    "srb": ("scans/dc.ply ground_truth/dc.xyz scans/lord_quas.ply ground_truth/lord_quas.xyz", ["dc", "lord_quas"]),
    "dsr_benchmark": ("scan_ply/with_normals/dc_4.ply scan_ply/with_normals/dc_0.ply mesh/dc.off", ["dc"]),
    "scut_real": ("in/deer_pcd.ply in/pig_pcd.ply gt/deer.xyz gt/pig.xyz", ["deer", "pig"]),
    "dtu": (
        "Points/furu/furu024_l3.ply Points/stl/stl024_total.ply ObsMask/ObsMask24_10.mat ObsMask/Plane24.mat", ["24"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_published_data(tmp_path, monkeypatch, layout):
    monkeypatch.setitem(CLOUD_READERS, ".npy", CLOUD_READERS.get(".npy"))
    names, ids = LAYOUTS[layout]
    with pytest.raises(UsageError, match=r"no file matches.*the folder should hold .*, "):
        planned(layout, tmp_path)
    for name in names.split():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "testset.txt").write_text("a.b_0\n")
    dataset = planned(layout, tmp_path)
    assert list(dataset._named()) == ids
    attributes = [set(pair.files) - {"scan", "reference"} for pair in dataset._named().values()]
    assert attributes[0] == ({"mask", "plane"} if layout == "dtu" else set())


def planned(layout: str, folder: Path):
    words = [f"dataset={layout}", f"dataset.path={folder}", "task=denoise", "method=identity"]
    return Cell.from_config(resolved(words)).dataset.made


# --- splits -----------------------------------------------------------------------------------------------------------


def test_lists_define_the_splits(folder):
    (folder / "test.txt").write_text("# comment\na_noisy\n\n")
    (folder / "train.txt").write_text("\ufeffb\nc_noisy.ply\n")
    both = paired(folder, test_names="test.txt", train_names="train.txt")
    assert matched(both) == ALL[:1] and matched(both, "train") == ALL[1:]
    assert (both.count("test"), both.count("train")) == (1, 2)
    assert matched(paired(folder, train_names="train.txt")) == ALL[:1]
    only = paired(folder, test_names="test.txt")
    assert matched(only) == ALL[:1] and only.count("train") == 0
    with pytest.raises(UsageError, match=r"split=train has none of the 1 pairs.*train_names=FILE"):
        only.check("train")
    # Only listed scans need a reference.
    assert matched(paired(folder, test_names="test.txt", reference="mesh/[a].off")) == ALL[:1]


def test_invalid_lists_are_refused(folder):
    (folder / "test.txt").write_text("a\nz\n")
    with pytest.raises(UsageError, match=r"test_names=test.txt: 1 of 2 names match no scan \(z\)"):
        paired(folder, test_names="test.txt").check()
    (folder / "train.txt").write_text("a\n")
    (folder / "test.txt").write_text("a\n")
    with pytest.raises(UsageError, match="a_noisy.ply: is in both lists"):
        paired(folder, test_names="test.txt", train_names="train.txt").check()
    with pytest.raises(UsageError, match="test_names=none.txt: cannot be read .*a text file with the name of one scan"):
        paired(folder, test_names="none.txt").check()


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_defines_the_pairs(folder, separator):
    rows = [
        ("scan", "reference", "split"),
        ("scans/a_noisy.ply", "mesh/c.off", ""),
        ("scans/b_noisy.ply", "mesh/a.off", "train"),
    ]
    (folder / "pairs.csv").write_text("\n".join(separator.join(row) for row in rows) + "\n# the rest\n\n")
    dataset = Paired(table=str(folder / "pairs.csv"))
    assert matched(dataset) == [("a_noisy.ply", "c.off")] and matched(dataset, "train") == [("b_noisy.ply", "a.off")]
    assert matched(Paired(path=str(folder), table="pairs.csv")) == matched(dataset)
    parts = ["scan (a_noisy.ply)", "reference (c.off)", "scan (b_noisy.ply)", "reference (a.off)"]
    assert [name.partition(" ")[2] for name in dataset.state()] == parts


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a.ply\n", "line 1 is 'a.ply'; expected one pair on each line"),
        ("# x\nscans/a_noisy.ply,mesh/a.off,val\n", "line 2 is 'scans/a_noisy.ply,mesh/a.off,val'; expected"),
        ("scans/a_noisy.ply,mesh/z.off\n", "line 1 names .*z.off, but there is no such file"),
        ("# nothing\n", "has no pairs"),
        (None, "cannot be read"),
    ],
)
def test_an_invalid_table_is_refused_with_its_line(folder, text, says):
    if text is not None:
        (folder / "pairs.csv").write_text(text)
    with pytest.raises(UsageError, match=says):
        Paired(table=str(folder / "pairs.csv")).check()


def test_a_table_excludes_patterns(folder):
    with pytest.raises(ValueError, match="table and input: give one of them"):
        Paired(table="pairs.csv", input="scans")


# --- cases ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", ["mesh/*.off", "cloud/*.ply"])
def test_the_scan_is_in_the_frame_of_the_reference_with_all_attributes(folder, reference):
    case = next(recipes(paired(folder, reference=reference))).build()
    cloud, truth = case.input["cloud"], case.reference
    assert np.linalg.norm(truth.mesh.vertices, axis=1).max() == pytest.approx(1)
    original = scan_of(trimesh.creation.icosphere(1, radius=50).apply_translation((1000, 0, 0)), 100)
    np.testing.assert_allclose(case.frame.invert(cloud.points), original.points, atol=1e-9)
    np.testing.assert_allclose(cloud.normals, original.normals, atol=1e-9)
    np.testing.assert_allclose(cloud.colors, original.colors, atol=0.01)
    assert (truth.cloud is None) == reference.endswith(".off")
    assert isinstance(truth.surface, CloudSurface) == (truth.cloud is not None) and not truth.is_exact


def test_scores_against_a_cloud_match_a_naive_search(folder):
    case = next(recipes(paired(folder, reference="cloud/*.ply"))).build()
    cloud = case.input["cloud"]
    metrics = [Choice.of("metric", {"_name_": name}) for name in ("p2f_mean", "chamfer_l1_mean", "iou")]
    found = call.score(metrics[:2], cloud, case)
    apart = np.linalg.norm(cloud.points[:, None] - case.reference.cloud.points, axis=2)
    by_hand = (apart.min(axis=0).mean() + apart.min(axis=1).mean()) / 2
    assert found.values == {"chamfer_l1_mean": pytest.approx(by_hand, rel=1e-9)}
    assert found.floors == {} and found.left_out == {"p2f_mean": "needs a reference that is a mesh"}
    mesh = trimesh.creation.icosphere(1)
    assert call.score(metrics[2:], mesh, case).left_out == {"iou": "needs a reference that is a mesh"}
    topology = Choice.of("metric", {"_name_": "topology"})  # its scores are compared with those of the reference
    for floors in (True, False):  # a trace is scored without
        found = call.score([topology], mesh, case, floors=floors)
        assert found == ({}, {}, {}, {"topology": "needs a reference that is a mesh"})


def test_the_ratio_of_upsampling_is_that_of_the_task(folder):
    case = next(recipes(paired(folder, reference="cloud/*.ply"), Upsample(ratio=4))).build()
    assert case.input["ratio"] * len(case.input["cloud"]) == len(case.reference.cloud)


def test_the_info_of_a_pair(folder):
    shape = next(paired(folder, units="mm", licence="CC BY 4.0").shapes("test"))
    assert shape.info == {"file": "a.off", "scan": "a_noisy.ply", "units": "mm", "licence": "CC BY 4.0"}


def test_scan_and_reference_are_cropped(folder):
    box = [1000.0, -100.0, -100.0, 1100.0, 100.0, 100.0]
    for reference in ("mesh/*.off", "cloud/*.ply"):
        shape = next(paired(folder, reference=reference, crop=box).shapes("test"))
        assert 0 < len(shape.scan) < 100 and shape.scan.points[:, 0].min() >= 1000 <= shape.mesh.vertices[:, 0].min()
        assert shape.scan.normals.shape == shape.scan.points.shape
    with pytest.raises(BadInput, match=r"a.off: has nothing within dataset.crop=.*it extends from \[950"):
        _ = next(paired(folder, crop=[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]).shapes("test")).mesh
    with pytest.raises(ValueError, match="crop: expected six numbers"):
        paired(folder, crop=[0.0, 1.0])


def test_a_damaged_file_fails_as_its_own_case(folder):
    (folder / "scans" / "b_noisy.ply").write_text("nothing")
    first, second, third = recipes(paired(folder))
    first.build(), third.build()
    with pytest.raises(BadInput, match="b_noisy.ply"):
        second.build()


def test_an_edited_file_is_a_changed_input(folder):
    before = paired(folder).state()
    assert len(before) == 6 and "b scan (b_noisy.ply)" in before
    save(scan_of(trimesh.creation.icosphere(1), 50), folder / "scans" / "b_noisy.ply")
    after = paired(folder).state()
    assert [name for name in before if before[name] != after[name]] == ["b scan (b_noisy.ply)"]


# --- cells ------------------------------------------------------------------------------------------------------------


def cell(folder: Path, *words: str) -> Cell:
    own = [f"dataset.path={folder}", "dataset.input='scans/*_noisy.ply'", "dataset.reference='cloud/*.ply'"]
    return Cell.from_config(resolved(["dataset=paired", *own, "task=denoise", "method=identity", *words]))


def test_the_sensor_is_the_scan_unless_an_effect_comes_after_it(folder):
    assert cell(folder).sensor == Choice.of("sensor", {"_name_": "scan"}) and cell(folder).planned == 3
    worse = cell(folder, "sensor=chain", "sensor.steps=[scan,{gaussian:{sigma:0.1}}]")
    (case, *_) = [
        r.build() for r in Denoise().recipes(worse.dataset.made, worse.sensor.made, split="test", count=1, seed=0)
    ]
    clean = next(recipes(worse.dataset.made)).build()
    moved = case.input["cloud"].points - clean.input["cloud"].points
    assert moved.std() == pytest.approx(0.1, rel=0.2)


def test_a_simulated_sensor_is_refused(folder):
    for words in (["sensor=noisy"], ["sensor=uniform"], ["sensor.count=100"]):
        with pytest.raises(NotSolved, match=r"dataset paired has its own scans.*dataset=files"):
            cell(folder, *words)
    with pytest.raises(UsageError, match=r"sensor=samples: dataset paired has its own scans: leave the sensor out"):
        check(Request.of(["dataset=paired", "sensor=samples"]))
    check(Request.of(["dataset=paired,bumps", "sensor=samples"], multirun=True))
    with pytest.raises(NotSolved, match="dataset bumps has none. Datasets with scans: .*paired"):
        Cell.from_config(resolved(["sensor=scan", "task=denoise", "method=identity"]))


def test_an_edited_file_changes_the_fingerprint(folder):
    before = fingerprint(ingredients(cell(folder)))
    assert fingerprint(ingredients(cell(folder))) == before
    save(scan_of(trimesh.creation.icosphere(1), 50), folder / "cloud" / "b.ply")
    assert fingerprint(ingredients(cell(folder))) != before


def test_a_run_is_stored_explained_and_reproduced(folder, shell):
    """The references are clouds: no floors, but worst scores; stored references are clouds with normals."""
    words = ["dataset=paired", f"dataset.path={folder}", "dataset.input=scans/*_noisy.ply", "task=denoise"]
    words += ["dataset.reference=cloud/*.ply", "method=identity", "outputs=first", "metric=[chamfer_l1_mean,p2f_mean]"]
    done = shell.call("run", *words, f"results={shell.results}")
    assert done.returncode == 0, done.stderr
    rows = shell.rows()
    assert list(rows["case"]) == list(NAMES) and set(rows["status"]) == {"ok"}
    assert set(rows["message"]) == {"no p2f_mean: needs a reference that is a mesh"}
    assert (rows["worst.chamfer_l1_mean"] > rows["score.chamfer_l1_mean"]).all()
    assert "floor.chamfer_l1_mean" not in rows or rows["floor.chamfer_l1_mean"].isna().all()
    (kept,) = shell.results.glob("outputs/references/*.ply")
    assert b"element face" not in kept.read_bytes()[:400] and b"nx" in kept.read_bytes()[:400]
    cell_id = rows["cell"][0]
    again = shell.call("reproduce", cell_id, f"results={shell.results}")
    assert "reproduced: every status and score agrees" in again.stdout, again.stdout + again.stderr
    save(scan_of(trimesh.creation.icosphere(1), 50), folder / "scans" / "b_noisy.ply")
    why = shell.call("why", cell_id, f"results={shell.results}")
    assert "file b scan (b_noisy.ply) has other content" in why.stdout, why.stdout + why.stderr


def test_messages_name_the_scan_and_failures_include_notes_of_its_reader(folder, shell):
    words = ["dataset=paired", f"dataset.path={folder}", "dataset.reference=mesh/*.off", "task=denoise"]
    missing = shell.call("run", *words, "method=identity", "dataset.input=none/*.ply", f"results={shell.results}")
    assert missing.stderr.startswith("error: denoise paired scan identity seed=0: "), missing.stderr
    points = scan_of(trimesh.creation.icosphere(1, radius=50), 2000).points + [500_000.0, 5_400_000.0, 350.0]
    np.savetxt(folder / "scans" / "a_noisy.xyz", points.astype(np.float32).astype(np.float64), "%.17g")
    words += ["dataset.input=scans/*_noisy.xyz", "method=external", "method.command='false {input} {output}'"]
    shell.call("run", *words, f"results={shell.results}")
    (row,) = shell.rows().to_dict("records")
    assert row["status"] == "error"
    assert "exit code 1" in row["message"] and "a_noisy.xyz: its coordinates have steps of" in row["message"]
