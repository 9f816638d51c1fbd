"""The page in a browser: what it shows, what its link restores, and that foreign text stays text."""

from __future__ import annotations

import copy
import csv
import io
import re

import pytest
from made_results import HOSTILE, METHODS
from PIL import ImageColor

from bench.pages.assemble import one_file

ALL_VIEWS = ("board", "cost", "traces", "cases", "duels", "slices", "failures", "about")


def texts(page, selector):
    return [text.strip() for text in page.locator(selector).all_inner_texts()]


def methods(page):
    return texts(page, "main tbody tr th[scope=row]:nth-child(2)")


def saved(page, name, within="main"):
    """What a button saves."""
    with page.expect_download() as download:
        page.locator(within).get_by_role("button", name=name, exact=True).first.click()
    return download.value.path().read_text(encoding="utf-8")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_view_opens_without_an_error_or_a_request(visit, small_page, scheme):
    page = visit(small_page, color_scheme=scheme)
    tabs = texts(page, "[role=tab]")
    assert len(tabs) == len(ALL_VIEWS)
    for view in ALL_VIEWS:
        page.locator(f"#tab-{view}").click()
        assert page.locator(f"#tab-{view}").get_attribute("aria-selected") == "true"
        assert page.locator("main h2").count() >= 1
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_page_is_as_wide_as_a_telephone(visit, small_page):
    page = visit(small_page, viewport={"width": 400, "height": 800})
    for view in ALL_VIEWS:
        page.locator(f"#tab-{view}").click()
        assert page.evaluate("document.documentElement.scrollWidth") <= 400, view


def test_the_table_has_the_numbers_of_the_leaderboard(visit, small_page, small_data):
    page = visit(small_page)
    metric = small_data["groups"][0]["metrics"][0]
    assert methods(page) == metric["labels"]
    assert texts(page, "main tbody td:nth-child(3)") == metric["texts"]
    assert texts(page, "main tbody tr > :first-child") == metric["ranks"]
    assert metric["heading"] in texts(page, "main thead th")[2]


def test_a_click_on_a_heading_sorts(visit, small_page, small_data):
    page = visit(small_page)
    metric = small_data["groups"][0]["metrics"][0]
    by_time = [name for _, name in sorted(zip(metric["seconds_median"], metric["labels"], strict=True))]
    button = page.locator("th[data-id=seconds] button")
    button.click()
    assert methods(page) == by_time
    assert page.locator("th[data-id=seconds]").get_attribute("aria-sort") == "ascending"
    button.click()
    assert methods(page) == by_time[::-1]
    assert page.locator("th[data-id=seconds]").get_attribute("aria-sort") == "descending"
    button.click()
    assert methods(page) == metric["labels"]


def test_filters_leave_the_rows_that_they_name(visit, small_page):
    page = visit(small_page, "#view=cases")
    assert page.locator("main tbody tr.opens").count() == 80
    page.get_by_label("Filter by status").select_option("error")
    assert page.locator("main tbody tr.opens").count() == 4
    page.get_by_label("Filter by dataset").select_option("cad")
    assert page.get_by_role("status").inner_text() == "2 of 80 rows"
    page.get_by_label("Filter by status").select_option("")
    page.get_by_label("Filter rows").fill("rimls")
    assert page.get_by_role("status").inner_text() == "8 of 80 rows"


def test_the_link_restores_view_table_metric_order_and_filters(visit, small_page):
    page = visit(small_page)
    page.locator("#choose-by").select_option("dataset")
    page.locator("#choose-group").select_option(label="cad · all sensors")
    page.locator("#choose-metric").select_option("fscore@0.01")
    page.locator("th[data-id=peak_mb] button").click()
    page.get_by_label("Filter rows").fill("o")
    there = page.evaluate("location.hash")
    again = visit(small_page, there)
    assert again.locator("main").inner_html() == page.locator("main").inner_html()
    assert again.get_by_label("Filter rows").input_value() == "o"
    assert again.locator("#choose-metric").input_value() == "fscore@0.01"
    assert again.locator("h2").inner_text() == "reconstruct · cad · all sensors"


def test_a_broken_link_shows_the_page_all_the_same(visit, small_page):
    page = visit(small_page, "#view=nothing&by=x&group=%F0&metric=<img>&sort=-none&case=999&viewer={")
    assert methods(page)
    other = visit(small_page, "#view=cases&case=-1&f.method=nobody&sort=")
    assert other.locator("main td.empty").count() == 1


def test_keys_walk_through_tabs_and_cases(visit, small_page):
    page = visit(small_page)
    page.locator("#tab-board").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.id") == "tab-cost"
    page.keyboard.press("End")
    assert page.locator("#tab-about").get_attribute("aria-selected") == "true"
    page.locator("#tab-cases").click()
    page.locator("main tr.opens[tabindex='0']").focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert page.locator("tr.selected").count() == 1 and page.locator("tr.details").count() == 1
    assert "case=1" in page.evaluate("location.hash")
    assert page.evaluate("document.activeElement.classList.contains('selected')")
    page.keyboard.press("Enter")
    assert page.locator("tr.details").count() == 0


def test_foreign_text_stays_text(visit, small_page, small_data):
    raw = small_page.read_text(encoding="utf-8")
    assert raw.count("</script>") == raw.count("<script")
    page = visit(small_page, "#view=failures")
    assert texts(page, ".failure > pre")[0] == HOSTILE.strip()
    assert page.title() == small_data["title"] and texts(page, "h1") == [small_data["title"]]
    assert page.locator("main img, main script, h1 b").count() == 0
    assert page.evaluate("window.hacked") is None
    assert texts(page, ".command code")[0] == small_data["failures"][0]["command"]


def test_the_browser_runs_no_other_script(window, small_page, tmp_path):
    """Even where markup got into the page, its own rule would not let it run."""
    spoiled = tmp_path / "spoiled.html"
    text = small_page.read_text(encoding="utf-8")
    spoiled.write_text(text.replace("<body>", "<body><script>window.hacked = 1</script>", 1), encoding="utf-8")
    page = window()
    page.goto(f"file://{spoiled}")
    page.wait_for_selector("main h2")
    assert page.evaluate("window.hacked") is None


def test_tables_are_saved_as_csv(visit, small_page, small_data):
    page = visit(small_page)
    lines = list(csv.DictReader(io.StringIO(saved(page, "CSV"))))
    metric = small_data["groups"][0]["metrics"][0]
    assert [line["method"] for line in lines] == metric["labels"]
    assert [float(line[metric["name"]]) for line in lines] == metric["mean"]
    assert [int(line["rank_low"]) for line in lines] == metric["rank_low"]
    page.locator("#tab-cases").click()
    lines = list(csv.DictReader(io.StringIO(saved(page, "CSV"))))
    assert len(lines) == 80 and {line["method"] for line in lines} == set(METHODS)
    assert [line["message"] for line in lines if line["status"] == "error"] == [HOSTILE] * 4


@pytest.mark.parametrize("view", ["cost", "traces", "duels", "slices"])
def test_charts_are_saved_as_pictures_that_stand_alone(visit, small_page, view, tmp_path):
    page = visit(small_page, f"#view={view}")
    text = saved(page, "SVG", "main figure >> nth=-1")
    assert "var(" not in text
    alone = tmp_path / "chart.svg"
    alone.write_text(text, encoding="utf-8")
    shown = seen_alone(visit(alone, shows="svg text"))
    assert shown["text"] >= 4 and shown["colors"] >= 2


def test_the_matrix_of_wins_is_saved_as_a_picture_of_its_table(visit, small_page, tmp_path):
    page = visit(small_page, "#view=duels")
    before = page.locator("main svg").count()
    text = saved(page, "SVG", "main figure >> nth=0")
    assert "var(" not in text and "color-mix" not in text and page.locator("main svg").count() == before
    alone = tmp_path / "wins.svg"
    alone.write_text(text, encoding="utf-8")
    names = texts(page, "table.matrix tbody th")
    rows = page.locator("table.matrix td.win").evaluate_all(
        "tds => tds.map(td => [...td.children].map(e => e.innerText))"
    )
    colors = page.locator("table.matrix td.win").evaluate_all(
        "tds => tds.map(td => getComputedStyle(td).backgroundColor)"
    )
    other = visit(alone, shows="svg text")
    found = other.locator("text").evaluate_all("all => all.map((e) => e.textContent)")
    assert found[0].endswith("row better than column")
    assert sorted(found[1:]) == sorted([*names, *names, *(part for row in rows for part in row)])
    boxes = other.locator("text").evaluate_all(
        "all => all.map((e) => { const b = e.getBoundingClientRect(); return b.right; })"
    )
    assert max(boxes) <= other.evaluate("document.documentElement.getBoundingClientRect().right")
    fills = other.locator("rect").evaluate_all("all => all.map((e) => e.style.fill + e.style.fillOpacity)")
    assert len(fills) == len(names) ** 2 and len(set(fills)) == len(set(colors)) + 1  # and the diagonal


def test_curves_are_called_as_in_the_tables_and_begin_with_what_ranks(visit, small_data, tmp_path):
    data = copy.deepcopy(small_data)
    columns = data["cases"]["columns"]
    values = {
        key: [columns[key]["values"][code] for code in columns[key]["codes"]] for key in ("method", "dataset", "sensor")
    }
    rows = list(zip(values["method"], values["dataset"], values["sensor"], strict=True))
    place = rows[0][1:]
    scores = {"boundary_edges": [9.0, 3.0], "surface_distance_mean": [0.2, 0.1], "chamfer_l1_mean": [0.4, 0.2]}
    data["traces"] = [
        {"row": rows.index((name, *place)), "seconds": [1.0, end], "scores": scores}
        for name, end in (("apss", 2.0), ("poisson", 3.0))
    ]
    for one in (one for group in data["groups"] for one in group["contenders"] if one["method"] == "apss"):
        one["label"] = "a preset"
    path = tmp_path / "page.html"
    path.write_text(one_file(data), encoding="utf-8")
    page = visit(path, "#view=traces")
    assert texts(page, "#choose-metric option") == ["surface_distance_mean", "chamfer_l1_mean", "boundary_edges"]
    assert page.locator("figcaption .title").inner_text() == "surface_distance_mean ↓ over time"
    labels = page.locator("main figure svg text", has_text=re.compile("^(a preset|poisson)$"))
    assert sorted(labels.all_text_contents()) == ["a preset", "poisson"]
    right = page.locator("main figure .scroll").evaluate("e => e.getBoundingClientRect().right")
    assert all(label.bounding_box()["x"] + label.bounding_box()["width"] <= right for label in labels.all())


def seen_alone(page):
    """What a browser makes of a picture: how many texts, and how many colours of lines and marks."""
    return page.evaluate(
        """() => ({
            text: document.querySelectorAll('text').length,
            colors: new Set(
                [...document.querySelectorAll('path, line, circle, g')].map((e) => getComputedStyle(e).stroke)
            ).size,
        })"""
    )


def luminance(color):
    """Relative luminance, as WCAG 2 defines it."""
    parts = [value / 255 for value in ImageColor.getrgb(color)[:3]]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_and_marks_have_enough_contrast(visit, small_page, scheme):
    page = visit(small_page, color_scheme=scheme)
    names = ["ink", "soft", "paper", "shade", "accent", "good", "bad", *(f"m{i}" for i in range(7))]
    values = page.evaluate(
        "names => names.map((n) => getComputedStyle(document.documentElement).getPropertyValue('--' + n).trim())", names
    )
    light = {name: luminance(value) for name, value in zip(names, values, strict=True)}

    def contrast(a, b):
        low, high = sorted((light[a], light[b]))
        return (high + 0.05) / (low + 0.05)

    assert min(contrast(name, "paper") for name in ("ink", "soft", "accent", "good", "bad")) >= 4.5
    assert min(contrast(name, "shade") for name in ("ink", "soft")) >= 4.5
    assert min(contrast(f"m{i}", "paper") for i in range(7)) >= 2.9  # lines and marks: WCAG asks for 3


def test_the_switch_changes_the_theme(visit, small_page):
    page = visit(small_page, color_scheme="light")
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.get_by_role("button", name="Dark", exact=True).click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != before
    page.get_by_role("button", name="Light", exact=True).click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == before


def test_the_front_is_of_methods_that_none_beats_in_both(visit, small_page, small_data):
    page = visit(small_page, "#view=cost")
    metric = small_data["groups"][0]["metrics"][0]
    points = list(zip(metric["seconds_median"], metric["mean"], metric["labels"], strict=True))
    wanted = {c for a, b, c in points if not any(x < a and y < b for x, y, _ in points)}
    lines = list(csv.DictReader(io.StringIO(saved(page, "CSV"))))
    assert {line["method"] for line in lines if line["front"] == "1"} == wanted


def test_a_case_says_all_that_is_known_of_it(visit, small_page, small_data):
    row = next(i for i, code in enumerate(small_data["cases"]["columns"]["status"]["codes"]) if code == 0)
    page = visit(small_page, f"#view=cases&case={row}")
    shown = page.locator("tr.details").inner_text()
    for words in ("method parameters", "60 s, 4 GB", "fscore@0.01", "detailbench reproduce", "MB at its peak"):
        assert words in shown
