"""The widths of pieces of LaTeX, summed up by hand, and titles in words."""

import pytest

from bench.ranking.report.latex import escape
from bench.ranking.report.titles import in_words
from bench.ranking.report.widths import widest, width_of

POWER = 0.72 * (2.9 + 4.3)  # a minus and a digit, raised


@pytest.mark.parametrize(
    ("latex", "points"),
    [
        ("", 0.0),
        ("12", 4.3 + 4.3),
        ("a b", 4.3 + 2.4 + 4.8),
        (r"\textbf{12}", 1.16 * (4.3 + 4.3)),
        (r"\underline{12}", 4.3 + 4.3),
        (r"{\scriptsize [1]}", 2.4 + 4.3 + 2.4),
        (r"$10^{-3}$", 4.3 + 4.3 + POWER),
        (r"1$^\dagger$", 4.3 + POWER),
        (r"\textbf{1}$^\approx$$^\dagger$", 1.16 * 4.3 + 2 * POWER),
        (r"1 $\pm$ 2", 4.3 + 2.4 + 8.5 + 2.4 + 4.3),
        (r"d $\downarrow$", 4.8 + 2.4 + 8.5),
        (r"d $\rightarrow$ $\uparrow$", 4.8 + 2.4 + 8.5 + 2.4 + 8.5),
        ("é", 8.5),
        (r"a\textless{}b", 4.3 + 8.7 + 4.8),
        (r"a \cite{kazhdan2013}", 4.3 + 2.4 + 2.4 + 4.3 + 4.3 + 2.4),
        (escape("a_b"), 4.3 + 3.4 + 4.8),
        (escape("${1}"), 4 * 4.3),  # they are printed, unlike those of LaTeX
        (escape("#%&"), 7.1 + 7.1 + 6.6),
    ],
)
def test_a_width_is_that_of_its_letters_and_signs(latex, points):
    assert width_of(latex) == pytest.approx(1.02 * points, abs=0.006)
    assert widest(["", latex]) == width_of(latex)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("d", "d"),
        ("cd", "cd"),  # a symbol rather than a word
        ("rms", "Rms"),
        ("iou", "IoU"),
        ("chamfer_l2_sum", "Chamfer L2 sum"),
        ("normal_angle_deg", "Normal angle (deg)"),
        ("fscore@0.01", "F-score 0.01"),
        ("CD (1e-3)", "CD (1e-3)"),
        ("_", "_"),
    ],
)
def test_titles_in_words(name, words):
    assert in_words(name) == words
