"""Every convention prints what its paper's formula says, in the paper's units, and changes no cell's identity."""

import igl
import numpy as np
import pandas as pd
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import Case, PointCloud, Shape, UsageError, generator
from bench.cli import main
from bench.commands.leaderboard import show
from bench.commands.score import _of_convention, in_convention, score
from bench.geometry.comparison import compare, set_samples
from bench.geometry.reference_sample import POISSON_DISK
from bench.geometry.triangles import point_triangle_distance
from bench.plan.cell import Cell, check_root
from bench.plugins.registry import registry
from bench.ranking.conventions import convention_names, load_convention
from bench.ranking.leaderboard import COLUMNS
from bench.ranking.report import FORMATS, render
from bench.sweep.composition import compose
from bench.sweep.overrides import check
from bench.sweep.request import Request

NAMES = (
    "cages",
    "dsr_benchmark",
    "dss",
    "dtu",
    "dtu_mm",
    "idf",
    "iso_points",
    "mpu",
    "occupancy_networks",
    "points2surf",
    "pu_gan",
    "score_denoise",
)
PERCENT = ("0.4", "0.6", "0.8", "1.0", "1.2")
BOX = trimesh.creation.box(extents=(2, 1, 1))  # a longest edge of 2, a diagonal of sqrt 6


def moved_box(shift=0.2):
    return trimesh.Trimesh(BOX.vertices + [shift, 0, 0], BOX.faces, process=False)


def noisy_cloud(n=300):
    points, normals = Shape("box", BOX).surface.sample(n, generator("cloud"))
    tilted = normals + 0.3 * generator("tilt").normal(size=points.shape)
    noise = 0.05 * generator("noise").normal(size=points.shape)
    return PointCloud(points + noise + [0.1, 0, 0], tilted / np.linalg.norm(tilted, axis=1, keepdims=True))


def printed(name, output, source=None):
    """What a convention prints of an output against the box, the case, and the convention."""
    seen = {
        "obs_mask": np.ones((9, 9, 9), bool),
        "obs_box": np.array([[-2.0] * 3, [2.0] * 3]),
        "obs_step": np.array([0.5]),
    }
    case = Case("box", {"source": source} if source is not None else {}, Shape("box", BOX, attributes=seen))
    set_samples(case, 1500)
    convention = load_convention(name)
    scores, _ = score(case, output, _of_convention(convention))
    return {title: s.value for title, s in in_convention(convention, scores).items()}, case


def directed(P, Q):
    """By scipy's tree: distances and partners, both ways."""
    (f, at_q), (b, at_p) = cKDTree(Q).query(P), cKDTree(P).query(Q)
    return f, b, at_q, at_p


def own_sphere(P):
    P = P - P.mean(axis=0)
    return P / np.sqrt((P**2).sum(axis=1).max())


def test_there_are_these():
    assert convention_names() == sorted(NAMES)
    with pytest.raises(UsageError, match="Did you mean 'mpu'"):
        load_convention("mup")


@pytest.mark.parametrize("name", NAMES)
def test_a_convention_is_whole(name):
    convention = load_convention(name)
    assert convention.name == name and convention.paper and convention.code and convention.differs
    assert convention.prints.endswith(".") and len(convention.prints) < 320
    assert len(set(convention.digits)) == len(convention.columns)
    assert all(registry().find("metric", metric) for metric in convention.metrics)
    shown, _ = printed(name, moved_box(), source=moved_box(0))
    cloud, _ = printed(name, noisy_cloud(2000))
    assert {*shown, *cloud} == {column.title for column in convention.columns}
    assert all(column.factor > 0 for column in convention.columns)


# -- the formulas ------------------------------------------------------------------------------------------------------


def test_mpu_and_pu_gan():
    output = noisy_cloud()
    found, case = printed("mpu", output)
    truth = compare(output, case, len(output), POISSON_DISK).reference_points
    assert len(truth) == len(output)
    f, b, _, _ = directed(own_sphere(output.points), own_sphere(truth))
    in_frame = directed(output.points, truth)
    to_faces = np.sqrt(
        igl.point_mesh_squared_distance(output.points.copy(), np.array(BOX.vertices), np.array(BOX.faces))[0]
    )
    expected = {
        "CD (1e-3)": 1e3 * ((f**2).mean() + (b**2).mean()),
        "HD (1e-3)": 1e3 * (f.max() ** 2 + b.max() ** 2),
        "P2F (1e-3)": 1e3 * to_faces.mean(),
        "P2F std (1e-3)": 1e3 * to_faces.std(),
        "CD in the frame (1e-3)": 1e3 * sum((d**2).mean() for d in in_frame[:2]),
        "HD in the frame (1e-3)": 1e3 * sum(d.max() ** 2 for d in in_frame[:2]),
    }
    assert found == pytest.approx(expected, rel=1e-9)
    gan, _ = printed("pu_gan", noisy_cloud(2000))
    assert [key for key in gan if key not in found] == [f"uniformity {p} % (1e-3)" for p in PERCENT]


def test_dss():
    found, case = printed("dss", noisy_cloud())
    f, b, _, _ = directed(noisy_cloud().points, case.compare(BOX).reference_points)
    expected = {
        "CD (1e-4)": 1e4 * 4.2**2 / 6 * ((f**2).mean() + (b**2).mean()),
        "HD (1e-3)": 1e3 * 4.2**2 / 6 * (f.max() ** 2 + b.max() ** 2),
    }
    assert found == pytest.approx(expected, rel=1e-9)


def test_idf():
    output = noisy_cloud()
    found, case = printed("idf", output)
    pair = case.compare(output)
    f, b, at_q, at_p = directed(output.points, pair.reference_points)
    forward = (1 - (output.normals * pair.reference_normals[at_q]).sum(axis=1)) / 2
    backward = (1 - (pair.reference_normals * output.normals[at_p]).sum(axis=1)) / 2
    expected = {
        "CD (1e-3)": 1e3 * (f.mean() + b.mean()),
        "normal distance (1e-2)": 1e2 * (forward.mean() + backward.mean()),
    }
    assert found == pytest.approx(expected, rel=1e-9)


def test_iso_points():
    output = noisy_cloud()
    found, case = printed("iso_points", output)
    pair = compare(output, case, 50_000)
    assert len(pair.reference_points) == 50_000
    f, b, at_q, at_p = directed(output.points, pair.reference_points)
    forward = 1 - np.abs((output.normals * pair.reference_normals[at_q]).sum(axis=1))
    backward = 1 - np.abs((pair.reference_normals * output.normals[at_p]).sum(axis=1))
    expected = {
        "CD position (1e-4)": 1e4 * ((f**2).mean() + (b**2).mean()),
        "CD normal (1e-1)": 10 * (forward.mean() + backward.mean()),
    }
    assert found == pytest.approx(expected, rel=1e-9)


def test_cages():
    source = trimesh.creation.box(extents=(1, 1, 2))
    output = trimesh.Trimesh(source.vertices * [1.5, 1, 1] + [4, 0, 0], source.faces, process=False)
    found, case = printed("cages", output, source)
    pair = compare(output, case, 5000)
    assert len(pair.output_points) == len(pair.reference_points) == 5000
    # Half of the reference's longest edge is 1, and both are centred by their own boxes.
    f, b, _, _ = directed(pair.output_points - [4, 0, 0], pair.reference_points)
    L = igl.cotmatrix(np.array(source.vertices), np.array(source.faces))
    change = np.linalg.norm(L @ source.vertices, axis=1) - np.linalg.norm(L @ output.vertices, axis=1)
    expected = {"CD (1e-2)": 1e2 * ((f**2).mean() + (b**2).mean()), "CotLap (1e-3)": 1e3 * np.abs(change).mean()}
    assert found == pytest.approx(expected, rel=1e-9)


def test_score_denoise():
    output = noisy_cloud()
    found, case = printed("score_denoise", output)
    n = len(output)
    f, b, _, _ = directed(output.points, compare(output, case, n, POISSON_DISK).reference_points)
    table = [point_triangle_distance(output.points, np.broadcast_to(t, (n, 3, 3))) for t in BOX.triangles]
    expected = {
        "CD (1e-4)": 1e4 * ((f**2).mean() + (b**2).mean()),
        "P2M (1e-4)": 1e4 * ((np.min(table, axis=0) ** 2).mean() + (np.min(table, axis=1) ** 2).mean()),
    }
    assert found == pytest.approx(expected, rel=1e-9)


def test_occupancy_networks_and_dsr_benchmark():
    output = moved_box(0.5)  # half of the longest edge's half: 1.5 of 2.5 are common
    found, case = printed("occupancy_networks", output)
    pair = case.compare(output)
    f, b, at_q, at_p = directed(pair.output_points, pair.reference_points)
    N, M = pair.output_normals, pair.reference_normals
    consistency = (np.abs((N * M[at_q]).sum(axis=1)).mean() + np.abs((M * N[at_p]).sum(axis=1)).mean()) / 2
    assert found["IoU"] == pytest.approx(0.6, abs=0.01)
    assert found["Chamfer-L1"] == pytest.approx(10 * (f.mean() + b.mean()) / 2 / 2, rel=1e-9)
    assert found["normal consistency"] == pytest.approx(consistency, rel=1e-9)
    survey, _ = printed("dsr_benchmark", output)
    expected = {
        "IoU (%)": 100 * found["IoU"],
        "CD (%)": 100 * (f.mean() + b.mean()) / 2 / np.sqrt(6),
        "HD (%)": 100 * max(f.max(), b.max()) / np.sqrt(6),
        "NC (%)": 100 * consistency,
        "components": 1,
        "boundary edges": 0,
    }
    assert survey == pytest.approx(expected, rel=1e-9)


def test_points2surf():
    output = moved_box()
    found, case = printed("points2surf", output)
    pair = compare(output, case, 10_000)
    f, b, _, _ = directed(pair.output_points, pair.reference_points)
    assert len(f) == len(b) == 10_000
    even, uniform = found["Chamfer (1e-2)"], found["Chamfer of uniform samples (1e-2)"]
    assert uniform == pytest.approx(100 * (f.mean() + b.mean()) / 2, rel=1e-9)  # the longest edge is 2
    assert 0.9 * uniform < even < uniform  # samples without close pairs


# -- tables ------------------------------------------------------------------------------------------------------------


def board(**scores):
    """A leaderboard of two methods with given means, the second twice as bad."""
    lines = []
    for key, mean in scores.items():
        for rank, method in enumerate(("good", "bad"), 1):
            line = dict.fromkeys(COLUMNS[: COLUMNS.index("front")], "x") | {
                "method": method,
                "variant": "",
                "metric": key,
                "better": "lower",
            }
            numbers = {"mean": rank * mean, "ci_low": rank * mean / 2, "ci_high": rank * mean * 2, "floor": mean / 4}
            rest = {"rank_low": rank, "rank_high": rank, "solved": 3, "planned": 3}
            lines.append(line | numbers | rest | {"seconds_median": 1.0, "peak_rss_mb": 10.0, "true_distances": 0})
    return pd.DataFrame(lines)


def test_view_scales_renames_and_orders():
    made = load_convention("mpu").view(board(p2f_mean=0.002, other=5.0, own_sphere_chamfer_l2_sum=0.0004))
    assert made["metric"].tolist() == ["CD (1e-3)"] * 2 + ["P2F (1e-3)"] * 2
    assert made["mean"].tolist() == pytest.approx([0.4, 0.8, 2, 4])
    assert made["ci_high"].tolist() == pytest.approx([0.8, 1.6, 4, 8])
    assert made["floor"].tolist() == pytest.approx([0.1, 0.1, 0.5, 0.5])
    assert made["rank_low"].tolist() == [1, 2, 1, 2]


def test_view_keeps_the_order_of_tables_and_lines_without_a_score():
    """A table without a sensor, as of results that have none, and one in which nothing was solved."""
    first = board(other=5.0, p2f_mean=0.002).assign(dataset="z", sensor=np.nan)
    failed = board(**{"": np.nan}).assign(dataset="b")
    whole = pd.concat([first, failed, board(p2f_mean=0.001).assign(dataset="a")], ignore_index=True)
    whole.attrs["level"] = 0.9
    made = load_convention("mpu").view(whole)
    assert made["dataset"].tolist() == ["z", "z", "b", "b", "a", "a"]
    assert made["metric"].tolist() == ["P2F (1e-3)"] * 2 + [""] * 2 + ["P2F (1e-3)"] * 2
    assert made["mean"].tolist() == pytest.approx([2.0, 4.0, np.nan, np.nan, 1.0, 2.0], nan_ok=True)
    assert made.index.tolist() == list(range(6)) and made.attrs == {"level": 0.9}
    none = load_convention("mpu").view(board(other=1.0))
    assert not len(none) and list(none) == list(whole)


def test_with_a_number_of_samples_a_score_stands_in_its_column_and_the_formula_shows_it():
    """profile=paper of the thesis's tables has 5 million; the usual score goes first where results have both."""
    idf = load_convention("idf")
    few, many = "chamfer_l1_sum@1000", "chamfer_l1_sum@5000000"
    found = idf.of([few, many, "other"])
    assert found.scores([few, many]) == [many]
    assert f"CD (1e-3) = 1000 x {many}." in found.notes(["CD (1e-3)"])
    assert found.view(board(**{many: 0.002}))["mean"].tolist() == pytest.approx([2.0, 4.0])
    assert idf.of([few, "chamfer_l1_sum"]) == idf.of([]) == idf


@pytest.mark.parametrize("format", FORMATS)
def test_tables_are_in_the_papers_units(format):
    table = board(p2f_mean=0.002, own_sphere_chamfer_l2_sum=0.00041234)
    text = render(table, format, convention=load_convention("mpu"))
    assert (
        "CD (1e-3)" in text and "P2F (1e-3)" in text and "own_sphere_chamfer_l2_sum" not in text.split("convention")[0]
    )
    if format != "csv":
        assert "0.412" in text and "0.4123" not in text and "2.00" in text
        assert "Wang et al. 2019" in text and "no HD (1e-3)" in text.replace("\n", " ")


def test_results_without_the_scores_say_what_to_do():
    named = ("task", "dataset", "sensor", "method", "variant", "case", "host", "device", "fingerprint")
    whole = {"seed": [0], "threads": [1], "split": ["test"], "status": ["ok"], "tags": [""]}
    rows = pd.DataFrame({**dict.fromkeys(named, ["x"]), **whole, "score.p2f_mean": [0.1]})
    with pytest.raises(UsageError, match=r"convention=idf, or metric=\[chamfer_l1_sum,normal_cosine_distance\]"):
        show(rows, convention="idf")


# -- files -------------------------------------------------------------------------------------------------------------

OWN = """\
defaults: [{override /metric: [p2f_mean]}]
convention:
  name: own
  prints: P2F is a mean.
  paper: Own 2026
  code: own.py
  columns: [{title: P2F, score: p2f_mean}]
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Writes a convention into the working folder, and loads it."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "conf" / "convention"
    folder.mkdir(parents=True)

    def load(text, name="own"):
        (folder / f"{name}.yaml").write_text(text)
        return load_convention(name)

    return load


def test_what_differs_is_noted_where_anything_does(own):
    quiet, idf = own(OWN), load_convention("idf")
    assert f"What differs: {idf.differs}" in idf.notes(idf.digits)
    assert quiet.differs == "" and quiet.notes(["P2F"]) == (
        "convention own: P2F is a mean.",
        "P2F = 1 x p2f_mean.",
        "After Own 2026; own.py.",
    )


@pytest.mark.parametrize(
    ("part", "instead"),
    [
        ("override /metric: [p2f_mean]", "metric: p2f_mean"),
        ("  paper: Own 2026\n", ""),
        ("score: p2f_mean}", "key: p2f_mean}"),
    ],
)
def test_a_file_that_is_no_convention_says_what_one_is(own, part, instead):
    assert part in OWN
    with pytest.raises(UsageError, match=r"own.yaml: expected defaults with 'override /metric: \[NAMES\]'"):
        own(OWN.replace(part, instead))


# -- runs --------------------------------------------------------------------------------------------------------------


def cell(*words):
    from omegaconf import OmegaConf

    check(Request.of(words))
    values = OmegaConf.to_container(compose(["task=denoise", "method=identity", *words]), resolve=True)
    check_root(values)
    return Cell.from_config(values)


def test_a_convention_selects_its_metrics_and_is_no_part_of_the_cell():
    by_convention, names = cell("convention=mpu"), ["even_distances", "own_sphere_distances", "p2f_mean", "p2f_spread"]
    assert [m.name for m in by_convention.metrics] == names
    assert by_convention == cell(f"metric=[{','.join(names)}]")
    assert "convention" not in str(by_convention.to_json())
    # What the command line chooses besides goes first.
    assert [m.name for m in cell("convention=mpu", "metric=[p2f_mean]").metrics] == ["p2f_mean"]
    with pytest.raises(UsageError, match="no convention is called 'mpx'"):
        cell("convention=mpx")


def test_run_and_leaderboard_print_a_convention(shell, capsys):
    words = ("task=denoise", "dataset=bumps", "dataset.subdivisions=4", "method=identity", "cases=1", "convention=dss")
    done = shell.call("run", *words, f"results={shell.results}")
    assert done.returncode == 0, done.stderr
    assert "CD (1e-4)" in done.stdout and "convention dss" in done.stdout
    assert "chamfer_l2_sum_by_diagonal  " not in done.stdout
    assert main(["leaderboard", str(shell.results), "--convention", "dss", "--format", "csv"]) == 0
    by_option = capsys.readouterr().out
    assert "CD (1e-4)" in by_option and "HD (1e-3)" in by_option
    assert main(["leaderboard", str(shell.results), "convention=dss", "--format", "csv"]) == 0
    assert capsys.readouterr().out == by_option
    assert main(["leaderboard", str(shell.results), "--convention", "idf"]) == 1
    assert "convention idf prints chamfer_l1_sum" in capsys.readouterr().err
    assert main(["leaderboard", str(shell.results), "--convention", "dss", "--metric", "p2f_mean"]) == 1
