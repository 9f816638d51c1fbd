"""Notices: collected by whoever asks for them, otherwise one plain line."""

from __future__ import annotations

import warnings

import pytest

from bench.notices import InputWarning, collected, notice, show_as_lines


def test_notices_are_collected_once_each_and_by_the_innermost():
    with collected() as outer:
        notice("a")
        notice("a")
        with collected() as inner:
            notice("b")
        notice("c")
    assert (outer, inner) == (["a", "c"], ["b"])
    with pytest.warns(InputWarning, match="^d$"):
        notice("d")


def test_a_notice_that_nobody_collects_is_one_line(monkeypatch):
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)  # and back
    show_as_lines()
    show_as_lines()
    assert warnings.formatwarning("a.ply: is odd", InputWarning, "x.py", 3) == "note: a.ply: is odd\n"
    assert warnings.formatwarning("other", RuntimeWarning, "x.py", 3).startswith("x.py:3: RuntimeWarning: other")
