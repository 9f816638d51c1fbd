"""LaTeX tables are compiled: no error, and nothing wider than a column or a page."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from boards import row, rows

from bench.ranking.by_case import by_case
from bench.ranking.leaderboard import leaderboard
from bench.ranking.overview import overview
from bench.ranking.report import in_format, render
from bench.ranking.report.case_tables import case_tables
from bench.ranking.report.citing import cited, key_of
from bench.ranking.report.latex import COLUMN, latex, wrapped
from bench.ranking.report.look import INTERVALS, Look
from bench.ranking.report.table import TIED, Cell, Metric, Table
from bench.ranking.report.titles import in_words
from bench.ranking.report.widths import width_of

METRICS = {"surface_distance_mean": 3e-3, "chamfer_l1_mean": 6e-3, "hausdorff": 0.05, "normal_angle_deg": 8.0}
METHODS = [("poisson", ""), ("ball_pivoting", "radii=[1, 2, 4],weld=0.1"), ("idf", "omega=30"), ("apss", "reach=0")]


@pytest.fixture(scope="module")
def frame():
    """Four methods, one of them with a failure, on two datasets with two sensors."""
    rng = np.random.default_rng(0)
    records = []
    for k, (method, variant) in enumerate(METHODS):
        for dataset in ("bumps", "cad[max_degree=20,holes=True]"):
            for sensor in ("noisy", "scanned"):
                for i, case in enumerate(["plate-with_holes", "bracket", "torus_knot", "chain"]):
                    where = {"dataset": dataset, "sensor": sensor, "variant": variant, "case_index": i}
                    scores = {m: size * (1 + 0.2 * k) * rng.lognormal(0, 0.2) for m, size in METRICS.items()}
                    failed = method == "apss" and case == "chain"
                    worst = dict.fromkeys(METRICS, 1.0)
                    record = row(method, case, 0, None if failed else scores, dict.fromkeys(METRICS, 1e-4), worst=worst)
                    records.append(record | where)
    return rows(*records)


@pytest.fixture(scope="module")
def texts(frame):
    """All kinds of tables that the docs show: for a column, and for a page."""
    return {wide: tables_of(frame, wide) for wide in (False, True)}


def tables_of(frame, wide):
    board, pooled = leaderboard(frame), leaderboard(frame, by="task")
    columns = ("rank", "surface_distance_mean", "normal_angle_deg", "seconds")
    looks = [Look(intervals=style, wide=wide) for style in INTERVALS]
    looks.append(Look(columns=columns, names={"idf": "Ours", "surface_distance_mean": "CD"}, digits=2, wide=wide))
    looks.append(Look(columns=columns, intervals="below", cite=True, wide=wide, caption=r"Ours, $x^2$.", label="tab:x"))
    found = [render(pooled, "latex", rows=frame, look=look) for look in looks]
    found.append(render(board, "latex", rows=frame, look=Look(wide=wide)))
    found.append(render(overview(frame, "sensor"), "latex", look=Look(wide=wide)))
    look = Look(wide=wide)
    return [*found, in_format(case_tables(*by_case(frame, by="task"), look), "latex", look)]


@pytest.mark.parametrize(("options", "wide"), [("", False), ("[twocolumn]", False), ("", True), ("[twocolumn]", True)])
def test_tables_fit_one_column_and_two(texts, tmp_path, options, wide):
    latex = shutil.which("pdflatex")
    assert latex, "pdflatex is missing: install the Debian packages texlive-latex-base and texlive-latex-recommended"
    body = "\n\\clearpage\n".join(texts[wide])
    (tmp_path / "t.tex").write_text(
        rf"\documentclass{options}{{article}}\usepackage{{booktabs}}\begin{{document}}{body}\end{{document}}"
    )
    done = subprocess.run(
        [latex, "-interaction=nonstopmode", "-halt-on-error", "t.tex"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-2000:]
    log = (tmp_path / "t.log").read_text(errors="replace")
    assert not re.findall(r"Overfull \\hbox.*", log) and not re.findall(r"^! .*", log, re.MULTILINE)
    assert (tmp_path / "t.pdf").stat().st_size > 10_000


def test_the_file_holds_ascii_and_booktabs_only(texts):
    for text in texts[False]:
        assert text.isascii() and text.startswith("% needs \\usepackage{booktabs}")
        assert set(re.findall(r"\\(\w*rule)\b", text)) == {"toprule", "midrule", "bottomrule"}


def test_titles_in_words_with_their_direction(frame):
    text = render(leaderboard(frame, by="task"), "latex", look=Look(columns=("normal_angle_deg",)))
    head = text[: text.index(r"\midrule")]
    assert (
        "Normal angle" in head and r"(deg) $\downarrow$" in head and "Reconstruct: all datasets, all sensors." in text
    )
    assert in_words("p2f_mean") == "P2F mean" and in_words("fscore@0.01") == "F-score 0.01"


def test_names_digits_order_label_and_caption(frame):
    look = Look(
        columns=("hausdorff", "rank"),
        names={"poisson": "Poisson", "idf": "Ours"},
        digits=3,
        intervals="none",
        order="given",
        methods=("idf", "poisson"),
        label="tab:mine",
        caption=r"A \emph{caption}.",
    )
    frame = frame[frame["method"].isin(["poisson", "idf"])]
    text = render(leaderboard(frame, by="task"), "latex", look=look)
    lines = [line.split(" & ") for line in text.splitlines() if line.endswith(r"\\")]
    assert [line[0] for line in lines[-3:]] == ["Ours", "Poisson", "floor / reference"]
    assert [line[-1].removesuffix(r" \\") for line in lines[-4:-1]] == ["rank", "2", "1"]
    numbers = [re.search(r"[\d.]+", line[1])[0] for line in lines[-3:]]
    assert all(re.fullmatch(r"\d+\.\d{3}", number) for number in numbers)
    means = frame.groupby("method")["score.hausdorff"].mean() * 1e3
    assert [float(n) for n in numbers[:2]] == pytest.approx([means["idf"], means["poisson"]], abs=6e-4)
    assert r"\label{tab:mine}" in text and r"\caption{A \emph{caption}.}" in text


def test_bold_is_the_best_mean_and_a_sign_the_tie(frame):
    rng = np.random.default_rng(1)
    cases = [f"s{i}" for i in range(8)]
    luck = rng.lognormal(0, 0.3, 8)
    factors = {"a": np.ones(8), "b": rng.lognormal(0.03, 0.3, 8), "c": np.full(8, 4.0), "d": np.full(8, 9.0)}
    made = rows(
        *(row(m, c, 0, {"d": luck[i] * f[i]}) for m, f in factors.items() for i, c in enumerate(cases)),
    )
    board = leaderboard(made)
    means = made.groupby("method")["score.d"].mean().sort_values()
    best, second = means.index[:2]
    assert set(means.index[:2]) == {"a", "b"} and board["rank_low"].tolist() == [1, 1, 3, 4]
    place = dict(zip(board["method"], board["place"], strict=True))
    assert place == {best: "best", second: "tied second", "c": "", "d": ""}
    text = render(board, "latex")
    for method, sign in {best: r"\textbf{", second: r"\underline{"}.items():
        assert any(line.startswith(method) and sign in line for line in text.splitlines())
    assert any(line.startswith(second) and r"$^\approx$" in line for line in text.splitlines())
    assert "Bold: the best mean" in text and r"$^\approx$: tied for first" in text
    plain = render(board, "markdown")
    assert re.search(rf"^\| {best} \| 1-2 \| \*\*", plain, re.M) and plain.count(TIED) == 2
    assert "*: the best mean" in render(board) and "Underlined: the second" in render(board, color=True)
    csv = render(board, "csv").splitlines()
    assert csv[0].endswith(",place") and [line.rpartition(",")[2] for line in csv[1:]] == board["place"].tolist()


def test_the_same_printed_mean_is_the_best_twice():
    made = rows(*(row(m, c, 0, {"d": d}) for m, d in (("a", 1.0), ("b", 1.0001), ("c", 2.0)) for c in "abcdef"))
    text = render(leaderboard(made), "markdown", look=Look(digits=1))
    assert text.count("**1.0") == 2 and "*2.0" not in text


def test_a_line_breaks_where_it_is_too_wide():
    assert wrapped("poisson (depth=9, trim=0.1)", 60) == ["poisson", "(depth=9,", "trim=0.1)"]
    assert width_of(r"\textbf{12}") > width_of("12") and width_of(r"a\_b") < width_of(r"a\textbackslash{}b") < COLUMN


def by_hand(*cells, **options):
    column = Metric("hausdorff", "lower", -3, tuple(map(Cell, cells)), floor="0.1")
    lines = {"methods": ("a", "b_c"), "plugins": ("poisson", "gone")}
    return Table("reconstruct", "bumps", "", "test", metrics=(column,), **lines | options)


def tabular(text):
    return text[text.index(r"\begin{tabular}") : text.index(r"\end{tabular}")].splitlines()


def test_each_cell_stands_in_its_column():
    table = by_hand("-0.5", "-", ranks=("1-2", "2"), solved=("4/4", "3/4"))
    assert tabular(latex([table])) == [
        r"\begin{tabular}{@{}llrr@{}}",
        r"\toprule",
        r" &  & Hausdorff &  \\",
        r"method & rank & $\downarrow$ ($10^{-3}$) & solved \\",
        r"\midrule",
        r"a & 1--2 & $-$0.5 & 4/4 \\",
        r"b\_c & 2 & -- & 3/4 \\",
        r"\midrule",
        r"floor / reference &  & 0.1 &  \\",
        r"\bottomrule",
    ]
    assert r"a & $-$0.5 [$-$1.0, 2.0] \\" in tabular(latex([by_hand("-0.5 [-1.0, 2.0]", "3.0")]))
    without = replace(table, metrics=(replace(table.metrics[0], floor=""),))
    assert tabular(latex([without])).count(r"\midrule") == 1


def test_methods_are_cited_and_other_lines_stay():
    """Lines of cases and of settings are no methods."""
    for plugins, name in ((("poisson", "gone"), r"a \cite{kazhdan2013}"), ((), "a")):
        lines = tabular(latex([by_hand("1.0", "2.0", plugins=plugins)], Look(cite=True)))
        assert [line.partition(" & ")[0] for line in lines[-5:-3]] == [name, r"b\_c"]
    assert cited("identity") == ""


def test_notes_for_readers_stand_below_and_others_in_comments():
    """A name that is shortened is one that readers cannot know."""
    text = latex([by_hand("1.0", "2.0", notes=("a…: a long name", "for authors"))])
    comments = [line for line in text.splitlines() if line.startswith("% ")]
    assert r"a\dots{}: a long name" in text and comments[1:] == ["% for authors"]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("Kazhdan and Hoppe 2013", "kazhdan2013"),
        ("after Jakab et al. 2021", "jakab2021"),
        ("See Kazhdan 2006", "kazhdan2006"),
        ("ours", ""),
        ("2013", ""),
        ("Kazhdan", ""),
    ],
)
def test_keys_of_what_is_cited(text, key):
    assert key_of(text) == key
