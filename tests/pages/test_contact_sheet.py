"""Images of an input as one picture: which ones, how large, and within which room."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from pictured import stored
from PIL import Image

from bench import Views
from bench.pages import shapes
from bench.pages.contact_sheet import GAP, contact_sheet
from bench.pages.shapes import scenes
from bench.pictures.shapes import Item, case_shapes
from bench.plugins.registry import load_plugins

COLORS = np.array([[30, 60, 220], [220, 60, 30], [40, 200, 60], [230, 200, 40], [140, 40, 180]], dtype=np.uint8)


def views_of(count, height=40, width=60):
    """Images of one colour each."""
    images = np.broadcast_to(COLORS[np.arange(count) % 5][:, None, None], (count, height, width, 3)).copy()
    pose = np.hstack([np.eye(3), [[0.0], [0.0], [3.0]]])
    camera = np.array([[50.0, 0, width / 2], [0, 50, height / 2], [0, 0, 1]])
    return Views(images, np.ones((count, height, width), bool), np.repeat(pose[None], count, axis=0), camera)


def opened(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA")).astype(int)


def test_all_of_few_images_are_there_in_their_order_and_size():
    sheet = contact_sheet(views_of(3), 1e6)
    picture = opened(sheet.data)
    assert picture.shape == (2 * 40 + GAP, 2 * 60 + GAP, 4) and sheet.note == "3 images"
    corners = [(0, 0), (0, 60 + GAP), (40 + GAP, 0)]
    for (row, column), color in zip(corners, COLORS, strict=False):
        tile = picture[row + 10 : row + 30, column + 10 : column + 50]
        assert np.abs(tile[..., :3].mean(axis=(0, 1)) - color).max() < 16 and (tile[..., 3] == 255).all()
    assert (picture[60:, 80:, 3] == 0).all()  # there is no fourth one


def test_of_many_images_nine_are_there_evenly_spaced_and_smaller():
    sheet = contact_sheet(views_of(41, 300, 400), 1e6)
    picture = opened(sheet.data)
    assert picture.shape[:2] == (3 * 144 + 2 * GAP, 3 * 192 + 2 * GAP)
    assert sheet.note == "9 of 41 images, shown with 192 of 400 pixels across"
    for number in range(9):  # every fifth one has the first colour
        row, column = number // 3 * (144 + GAP), number % 3 * (192 + GAP)
        assert np.abs(picture[row + 72, column + 96, :3] - COLORS[0]).max() < 16


def test_the_room_is_kept():
    noise = np.random.default_rng(0).integers(0, 255, (12, 200, 200, 3), dtype=np.uint8)
    views = replace(views_of(12, 200, 200), images=noise)
    large = contact_sheet(views, 1e6)
    small = contact_sheet(views, len(large.data) - 1)
    assert len(small.data) < len(large.data) and "128 of 200" in small.note
    assert contact_sheet(views, 500) is None


@pytest.fixture
def with_views(tmp_path, monkeypatch):
    """Results whose input is images, and points to begin with."""
    load_plugins(())
    monkeypatch.setattr(shapes, "FEWEST", 400)
    results, _ = stored(tmp_path, ("poisson",), cases=2, dataset="cad")

    def made(folders, place, rows):
        found = case_shapes(folders, place, rows)
        (cloud,) = found.inputs
        images = Item("views", "input", views_of(7 if "-000" in place.case else 3), "")
        return replace(found, inputs=(images, replace(cloud, name="cloud")))

    monkeypatch.setattr(shapes, "case_shapes", made)
    return results


def test_a_scene_has_the_images_beside_the_shapes(with_views):
    shown, geometry = scenes(with_views, with_views.rows(), 400_000)
    panels = shown[0]["panels"]
    assert [(panel["name"], panel["kind"]) for panel in panels] == [
        ("views", "images"), ("cloud", "cloud"), ("poisson", "mesh"), ("reference", "mesh")
    ]  # fmt: skip
    assert panels[0]["note"] == "7 images" and geometry[panels[0]["geometry"]][8:12] == b"WEBP"
    assert shown[1]["panels"][0]["note"] == "3 images" and sum(map(len, geometry.values())) <= 400_000
    assert scenes(with_views, with_views.rows(), 400_000) == (shown, geometry)


def test_images_without_room_are_a_sentence(with_views, monkeypatch):
    monkeypatch.setattr(shapes, "OF_IMAGES", 1e-6)
    shown, _ = scenes(with_views, with_views.rows(), 400_000)
    panel = shown[0]["panels"][0]
    assert (panel["kind"], panel["geometry"]) == (None, None)
    assert panel["note"] == "7 images, which do not fit into the page"
