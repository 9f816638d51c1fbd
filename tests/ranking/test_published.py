"""A paper's own numbers beside ours."""

from dataclasses import replace

import pandas as pd
import pytest

from bench import PointCloud
from bench.errors import UsageError
from bench.plugins import config_files
from bench.plugins.presets import names
from bench.ranking import published
from bench.ranking.published import Line, Published, all_parameters, load_published
from bench.ranking.report import render

TABLES = [name for name in names("experiment") if published.has_published(name)]


@pytest.mark.parametrize("name", TABLES)
def test_every_table_names_columns_of_its_convention_and_methods_that_exist(name):
    """A number under a title that no column has would never be printed."""
    from bench.plugins.registry import registry
    from bench.plugins.schema import defaults
    from bench.ranking.conventions import load_convention

    table = load_published(name)
    titles = set(load_convention(table.convention).digits)
    assert table.lines
    for line in table.lines:
        assert set(line.values) <= titles
        assert set(line.parameters) <= set(defaults(registry().find("method", line.method)))


@pytest.mark.parametrize("name", TABLES)
def test_every_table_computes_the_scores_that_it_prints(name):
    """Otherwise a run ends after hours with results that its own table cannot show."""
    from omegaconf import OmegaConf

    from bench.authoring.conformance import toy_case
    from bench.geometry.comparison import set_samples
    from bench.plan.cell import Choice
    from bench.plugins.registry import registry
    from bench.ranking.conventions import load_convention
    from bench.sweep.composition import compose

    table = load_published(name)
    config = OmegaConf.to_container(compose([f"experiment={name}"]), resolve=True)
    task = registry().find("task", config["task"]["_name_"]).cls()
    case, scores = toy_case(task, "cloud"), {}
    set_samples(case, 500)
    output = case.input["source"] if task.output == "mesh" and "source" in case.input else case.reference.mesh
    if task.output == "cloud":
        output = PointCloud(case.reference.mesh.vertices, case.reference.mesh.vertex_normals)
    for metric, node in config["metric"].items():
        scores |= Choice.of("metric", node, metric).build().score(output, case)
    convention = load_convention(table.convention).of(scores)
    printed = {column.title for column in convention.columns if column.score in scores}
    assert {title for line in table.lines for title in line.values} <= printed


def test_a_line_is_found_by_its_parameters_given_or_default():
    """siren has omega 30 and three layers unless its variant says otherwise."""
    table = Published(
        "a paper",
        "paper",
        "idf",
        (Line({"CD": 2.0}, "siren", {"omega": 60.0}), Line({"CD": 3.0}, "siren", {"hidden_layers": 3})),
    )
    assert table.value("CD", "siren", "omega=60,seconds=45", "clean") == 2.0
    assert table.value("CD", "siren", "seconds=45", "clean") == 3.0
    assert table.value("CD", "siren", "hidden_layers=7", "clean") is None
    assert table.value("other", "siren", "", "clean") is None
    assert all_parameters("siren", "omega=60")["omega"] == "60"
    short, long = ({"betas": [0.1, 0.9]}, 1.0), ({"betas": [0.9, 0.99]}, 2.0)  # long: the default
    table = replace(table, lines=tuple(Line({"CD": cd}, "idf_transfer", given) for given, cd in (short, long)))
    assert table.value("CD", "idf_transfer", "steps=9,betas=[0.1, 0.9],every=1", "clean") == 1.0
    assert table.value("CD", "idf_transfer", "steps=9", "clean") == 2.0
    chained = "steps=smooth(sigma=0.1,times=2)+keep,last=1"
    assert all_parameters("not_installed", chained) == {"steps": "smooth(sigma=0.1,times=2)+keep", "last": "1"}


def test_a_line_may_be_of_one_sensor():
    """Rows of a table that differ in the input."""
    line = Line({"CD": 1.0}, "poisson", {}, sensor="idf_40k_002")
    assert line.is_of("poisson", {}, "idf_40k_002") and not line.is_of("poisson", {}, "clean")


def test_the_numbers_stand_beside_ours():
    """In a column of their own, empty where the paper has none."""
    from bench.ranking.conventions import load_convention

    common = {
        "task": "reconstruct",
        "dataset": "d",
        "sensor": "s",
        "better": "lower",
        "ci_low": 0.001,
        "ci_high": 0.003,
    }
    common |= {"metric": "chamfer_l1_sum", "mean": 0.002, "floor": 0.001, "solved": 1, "planned": 1}
    common |= {"seconds_median": 1.0, "peak_rss_mb": 1.0, "true_distances": 0, "variant": ""}
    board = pd.DataFrame(
        [common | {"method": m, "rank_low": i, "rank_high": i} for i, m in enumerate(("siren", "poisson"), 1)]
    )
    table = Published("somebody's table", "paper", "idf", (Line({"CD (1e-3)": 9.85}, "siren"),))
    text = render(board, "markdown", convention=load_convention("idf"), published=table)
    head, _, siren, poisson, *_ = [line for line in text.splitlines() if line.startswith("|")]
    column = [cell.strip() for cell in head.split("|")].index(next(c.strip() for c in head.split("|") if "paper" in c))
    assert siren.split("|")[column].strip() == "9.85" and poisson.split("|")[column].strip() == ""
    assert "paper: somebody's table." in text and "not among ours" not in text
    others = (
        Line({"CD (1e-3)": 1.35, "normal distance (1e-2)": 1.97}, "nglod", {"levels": 6}, name="NGLOD (LOD6)"),
        Line({"CD (1e-3)": 3.0}, "siren", {"omega": 60.0}),
        Line({"CD (1e-3)": 4.0}, "idf", sensor="other"),
    )
    table = replace(table, lines=(*table.lines, *others))
    text = render(board, "terminal", convention=load_convention("idf"), published=table)
    told = "NGLOD (LOD6): CD (1e-3) 1.35, normal distance (1e-2) 1.97; siren[omega=60]: CD (1e-3) 3.0"
    assert f"paper, not among ours: {told}." in " ".join(text.split())


def test_an_experiment_without_a_table_is_refused():
    """And the message names those that have one."""
    with pytest.raises(UsageError, match="repeats no paper's table; these do: .*table_4_1"):
        load_published("demo")
    with pytest.raises(UsageError, match="table_4_1"):
        load_published("table_4_11")


@pytest.mark.parametrize(
    ("text", "missing"),
    [
        ("{source: a paper, short: paper, convention: idf}", "lines"),
        ("{short: paper, convention: idf, lines: [{method: siren, values: {CD: 2}}]}", "source"),
        ("{source: a paper, short: paper, convention: idf, lines: [{method: siren}]}", "values"),
        ("{source: a paper, short: paper, convention: idf, lines: [{method: siren, value: {CD: 2}}]}", "value"),
    ],
)
def test_a_table_of_ones_own_that_lacks_something_is_refused_by_the_name_of_its_file(
    tmp_path, monkeypatch, text, missing
):
    file = tmp_path / "conf" / "experiment" / "mine.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(f"published: {text}\n")
    monkeypatch.chdir(tmp_path)
    config_files.use([])
    with pytest.raises(UsageError, match=rf"mine\.yaml: published: expected source, .*\(.*'{missing}'.*\)"):
        load_published("mine")
