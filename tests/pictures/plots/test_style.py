"""How plots look: nothing overlaps, every line is distinct, names are text."""

import itertools
import re

import numpy as np
import pytest
from plotted import METHODS, made_rows, scores
from scipy.optimize import minimize

from bench.cli import main
from bench.pictures.plots.kinds import KINDS, Options, plot
from bench.pictures.plots.style import Box, chart, looks, names_at_points, spread
from bench.pictures.printing import saved
from bench.results.store import Record, Results


def test_places_are_apart_in_order_and_near_where_they_should_be():
    rng = np.random.default_rng(0)
    for n in (1, 2, 5, 9):
        wanted = rng.uniform(0, 1, n)
        found = spread(wanted, 0.08, 0.0, 1.0)
        assert (np.argsort(found, kind="stable") == np.argsort(wanted, kind="stable")).all()
        assert (np.diff(np.sort(found)) >= 0.08 - 1e-12).all() and found.min() >= 0 and found.max() <= 1
        order = np.sort(wanted)
        rules = [{"type": "ineq", "fun": lambda x, i=i: x[i + 1] - x[i] - 0.08} for i in range(n - 1)]
        best = minimize(lambda x, o=order: ((x - o) ** 2).sum(), order, bounds=[(0, 1)] * n, constraints=rules).fun
        assert ((np.sort(found) - order) ** 2).sum() <= best + 1e-3
    assert np.diff(spread(np.zeros(9), 0.5, 0, 1)) == pytest.approx(1 / 8)
    assert len(spread(np.zeros(0), 1, 0, 1)) == 0


def test_names_hide_neither_points_nor_each_other():
    figure, axes = chart(3.3, 2.4)
    rng = np.random.default_rng(1)
    points = {f"method_{i}": tuple(rng.uniform(0, 1, 2)) for i in range(10)}
    axes.plot(*np.array(list(points.values())).T, "o")
    axes.margins(0.15)
    boxes = names_at_points(axes, points, {name: name for name in points})
    for a, b in itertools.combinations(boxes, 2):
        assert a.overlap(b) < 1e-9
    size = np.array(axes.get_window_extent().size) / figure.dpi
    for x, y in points.values():
        at = axes.transAxes.inverted().transform(axes.transData.transform((x, y))) * size
        assert sum(box.overlap(Box(at[0] - 0.02, at[1] - 0.02, at[0] + 0.02, at[1] + 0.02)) for box in boxes) < 1e-9


def test_every_method_has_a_look_of_its_own_also_in_grey():
    found = looks([str(i) for i in range(60)])
    assert len(set(map(str, found.values()))) == 60
    few = list(looks([str(i) for i in range(6)]).values())
    assert len({look.marker for look in few}) == 6 and len({str(look.line) for look in few}) == 6


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"noise"}))
def test_all_kinds_are_drawn_inside_the_figure_with_text_as_text(kind):
    made = plot(kind, scores(names="apss=A long name of a method"), Options(size=(3.3, None)))
    made.figure.canvas.draw()
    box, (width, height) = made.figure.get_tightbbox(), made.figure.get_size_inches()
    assert box.x0 >= -0.02 and box.y0 >= -0.02 and box.x1 <= width + 0.02 and box.y1 <= height + 0.02
    svg = saved(made.figure, "svg", 300).decode()
    written = " ".join(re.findall(r"<text[^>]*>(.*?)</text>", svg, re.DOTALL))
    assert "A long name of a method" in written and "rimls" in written


def test_a_pdf_has_text_as_text_and_is_the_same_every_time():
    figure = plot("pareto", scores(), Options()).figure
    pdf = saved(figure, "pdf", 300)
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf
    assert pdf == saved(figure, "pdf", 300)


def stored_rows(folder):
    results = Results(folder)
    rows = made_rows(sensors=("noisy",))
    for number, (_, part) in enumerate(rows.groupby("method")):
        cell, mark = f"ab{number:010d}", "f" * 16
        lines = [line | {"cell": cell, "fingerprint": mark} for line in part.to_dict("records")]
        meta = {"cell_id": cell, "fingerprint": mark, "planned": len(lines), "finished": lines[0]["finished"]}
        results.write(Record(cell, mark, meta, lines))
    return results


def test_the_command_writes_the_plot_and_its_numbers(tmp_path, capsys):
    import pandas as pd

    results = stored_rows(tmp_path / "results")
    target = tmp_path / "ranks.svg"
    words = [str(results.folder), "-o", str(target), "--metric", "p2f_mean"]
    assert main(["plot", "difference", *words, "--names", "jet=Jets", "--height", "2in"]) == 0
    table = pd.read_csv(tmp_path / "ranks.csv")
    assert sorted(table["method"]) == sorted(METHODS) and "Jets" in set(table["title"])
    assert "Jets" in target.read_text()
    assert "critical difference" in capsys.readouterr().out
    before = target.read_bytes()
    assert main(["plot", "difference", *words, "--names", "jet=Jets", "--height", "2in"]) == 0
    assert target.read_bytes() == before


def test_mistakes_are_answered_with_a_message(tmp_path, capsys):
    folder = str(stored_rows(tmp_path / "results").folder)
    for words, message in (
        (["bars", folder, "--x", "sensor.noise"], "plot noise"),
        (["bars", folder, "-o", str(tmp_path / "plot.doc")], ".pdf, .svg or .png"),
        (["bars", folder, "--height", "tall"], "--height tall"),
        (["noise", folder, "--metric", "p2f_mean"], "--x"),
        (["bars", folder], "--metric"),
        (["pie", folder], "pie"),
    ):
        try:
            code = main(["plot", *words])
        except SystemExit as ended:
            code = ended.code
        assert code == 1
        assert message in capsys.readouterr().err
