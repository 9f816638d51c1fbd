"""Shapes in the page and the site: that they are found, drawn, linked from cases, and restored by the link."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

from bench.pages.assemble import one_file
from bench.pages.packing import pack, quantised
from bench.pages.site import site, write_site

SMALL = {"width": 700, "height": 600}  # of windows: a processor draws what is in them
PLACE = {"task": "reconstruct", "dataset": "cad", "sensor": "noisy", "split": "test", "seed": 0}


@pytest.fixture(scope="module")
def with_scenes(small_data):
    """The data with two scenes of a ball, and its shapes."""
    ball = trimesh.creation.icosphere(3, radius=0.9)
    share = (ball.vertices[:, 2] + 0.9) / 1.8
    geometry = {
        "a1": pack(quantised(ball.vertices, ball.faces, share)),
        "b2": pack(quantised(ball.vertices, ball.faces)),
    }
    panels = [
        {"name": "rimls", "role": "output", "kind": "mesh", "geometry": "a1", "note": ""},
        {"name": "reference", "role": "reference", "kind": "mesh", "geometry": "b2", "note": ""},
    ]
    made = [
        PLACE | {"id": f"s{i}", "title": f"cad-{i:03d} · noisy", "unit": "radii", "limit": 0.02, "panels": panels}
        | {"case": f"cad-{i:03d}"}
        for i in range(2)
    ]  # fmt: skip
    return small_data | {"scenes": made}, geometry


@pytest.fixture(scope="module")
def page_file(with_scenes, tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "page.html"
    path.write_text(one_file(*with_scenes), encoding="utf-8")
    return path


def colors(page):
    """How many colours the picture of the 3-D view has, as far as they clearly differ."""
    page.wait_for_timeout(600)
    picture = Image.open(io.BytesIO(page.locator(".viewer canvas").first.screenshot())).convert("RGB")
    return len(np.unique(np.asarray(picture).reshape(-1, 3) // 32, axis=0))


def test_a_page_of_one_file_draws_its_shapes(visit, page_file):
    page = visit(page_file, "#view=shapes", viewport=SMALL)
    assert colors(page) > 10
    assert page.locator("#choose-scene option").all_inner_texts() == ["cad-000 · noisy", "cad-001 · noisy"]


def test_a_case_leads_to_its_shapes(visit, page_file, with_scenes):
    columns = with_scenes[0]["cases"]["columns"]
    names, sensors = ([c["values"][k] for k in c["codes"]] for c in (columns["case"], columns["sensor"]))
    row = list(zip(names, sensors, strict=True)).index(("cad-001", "noisy"))
    other = list(zip(names, sensors, strict=True)).index(("cad-001", "scanned"))
    page = visit(page_file, f"#view=cases&case={row}", viewport=SMALL)
    page.get_by_role("link", name="Show the shapes").click()
    page.wait_for_selector(".viewer canvas")
    assert page.locator("#choose-scene").input_value() == "s1"
    assert visit(page_file, f"#view=cases&case={other}").get_by_role("link", name="Show the shapes").count() == 0


def test_the_link_restores_the_scene_and_the_camera(visit, page_file):
    page = visit(page_file, "#view=shapes", viewport=SMALL)
    page.locator("#choose-scene").select_option("s1")
    page.get_by_role("button", name="Plain").click()
    page.wait_for_timeout(500)  # the view says its state at most some times a second
    there = page.evaluate("location.hash")
    assert "scene=s1" in there and "viewer=" in there
    again = visit(page_file, there, viewport=SMALL)
    assert again.locator("#choose-scene").input_value() == "s1"
    assert again.get_by_role("button", name="Plain").get_attribute("aria-pressed") == "true"


def test_leaving_the_view_and_coming_back(visit, page_file):
    page = visit(page_file, "#view=shapes", viewport=SMALL)
    for _ in range(3):
        page.locator("#tab-board").click()
        page.locator("#tab-shapes").click()
    assert colors(page) > 10


def test_a_site_loads_its_shapes_when_they_are_looked_at(visit, with_scenes, tmp_path):
    write_site(tmp_path / "site", site(*with_scenes))
    page = visit(tmp_path / "site/dataset/cad.html", allowed=tmp_path / "site", viewport=SMALL)
    loaded = "performance.getEntriesByType('resource').filter((e) => e.name.includes('/geometry/')).length"
    assert page.evaluate(loaded) == 0
    page.locator("#tab-shapes").click()
    assert colors(page) > 10
    other = visit(tmp_path / "site/dataset/bumps.html", allowed=tmp_path / "site")
    assert other.locator("#tab-shapes").count() == 0
