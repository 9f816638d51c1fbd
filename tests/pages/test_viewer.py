"""The 3-D view in headless Chromium: what is on the screen, how it moves, and that a link restores it.

The view is mounted from the committed bundle, in a page of its own without results. Pixels are those of screenshots.
"""

from __future__ import annotations

import base64
import io
import json
import re

import numpy as np
import pytest
import trimesh
from PIL import Image

from bench.pages.assemble import built
from bench.pages.packing import pack, quantised, unpack
from bench.pictures.colors import ERROR, PLAIN

SIZES = [(820, 820), (400, 2600)]  # all panels are within the window
PAGE = """<!DOCTYPE html><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>view</title>
<link rel="icon" href="data:,"><style>:root { color-scheme: light dark; --paper: #fff; --ink: #111; --line: #ccc }
@media (prefers-color-scheme: dark) { :root { --paper: #14171b; --ink: #e7eaee; --line: #363d46 } }
body { background: var(--paper); color: var(--ink) }</style><main><p id="view"></p></main>
%s<script>%s</script><script>
const element = document.getElementById("view"), scene = %s;
window.states = [];
window.again = (state) => { window.viewer?.dispose();
  window.viewer = detailbenchViewer.mount(element, scene, state, (now) => states.push(now)); return viewer.ready; };
again(JSON.parse(decodeURIComponent(location.hash.slice(1)) || "null"));
</script>"""
BOXES = """[...document.querySelectorAll(".dbv-panel:not([hidden]) .dbv-view")].map((view) => {
const box = view.getBoundingClientRect(); return [box.x, box.y, box.right, box.bottom]; })"""
HOSTILE = "<img src=x onerror='window.hacked = 1'></script>"


def shapes():
    """A ball with errors, a ball without, a cloud with normals, an open half ball, and a torus of two components."""
    ball = trimesh.creation.icosphere(3, radius=0.9)
    share = (ball.vertices[:, 2] + 0.9) / 1.8
    half = ball.faces[(ball.vertices[ball.faces][:, :, 1] > 0).all(axis=1)]
    rings = trimesh.util.concatenate([trimesh.creation.torus(0.6, 0.2), trimesh.creation.torus(0.6, 0.1)])
    return {
        "a1": quantised(ball.vertices, ball.faces, share),
        "b2": quantised(ball.vertices, ball.faces),
        "c3": quantised(ball.vertices, None, share, ball.vertices / 0.9),
        "d4": quantised(ball.vertices, half, share),
        "e5": quantised(rings.vertices, rings.faces, np.full(len(rings.vertices), 0.5)),
    }


def panel(name, role, kind, geometry, note=""):
    return {"name": name, "role": role, "kind": kind, "geometry": geometry, "note": note}


SCENE = {
    "id": "scene",
    "title": "a scene",
    "unit": "radii of the reference",
    "limit": 0.02,
    "panels": [
        panel("input", "input", "cloud", "c3"),
        panel("mine", "output", "mesh", "a1", "shown with 5,120 of 10,240 faces"),
        panel("half", "output", "mesh", "d4"),
        panel(HOSTILE, "output", None, None, f"error: {HOSTILE}"),
        panel("reference", "reference", "mesh", "b2"),
    ],
}


@pytest.fixture(scope="module")
def packed():
    return shapes()


@pytest.fixture(scope="module")
def stored(packed):
    return "".join(
        f'<script type="text/plain" id="geometry-{name}">{base64.b64encode(pack(shape)).decode()}</script>'
        for name, shape in packed.items()
    )


@pytest.fixture
def opened(visit, tmp_path, stored):
    def open_view(state=None, scene=SCENE, **options):
        script = built("page.js")
        path = tmp_path / "view.html"
        path.write_text(PAGE % (stored, script, json.dumps(scene).replace("<", "\\u003c")), encoding="utf-8")
        options = {"viewport": {"width": SIZES[0][0], "height": SIZES[0][1]}} | options
        page = visit(path, "" if state is None else f"#{json.dumps(state)}", **options)
        page.evaluate("viewer.ready")
        settle(page)
        return page

    return open_view


def settle(page):
    """Wait until what was asked for is on the screen."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def seen(page, which=None):
    """The pixels of the panels that are shown, without their frames: a list of (h, w, 3) arrays, or one of them."""
    settle(page)
    image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
    found = []
    for box in page.evaluate(BOXES):
        x, y, right, bottom = map(round, box)
        assert bottom <= len(image)
        found.append(image[y + 4 : bottom - 4, x + 4 : right - 4])
    return found if which is None else found[which]


def covered(pixels):
    """The share of the panel that is not its background, the colour of its corner."""
    return float((np.abs(pixels - pixels[0, 0]).max(axis=2) > 12).mean())


def drag(page, which, dx, dy, steps=4):
    box = page.locator(".dbv-panel:not([hidden]) .dbv-view").nth(which).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=steps)
    page.mouse.up()


def state(page):
    return page.evaluate("viewer.getState()")


def test_images_are_shown_as_a_picture_that_no_camera_turns(visit, tmp_path, packed):
    file = io.BytesIO()
    Image.new("RGB", (90, 60), (200, 40, 40)).save(file, "WEBP", quality=90)
    stored = "".join(
        f'<script type="text/plain" id="geometry-{name}">{base64.b64encode(data).decode()}</script>'
        for name, data in {"p1": file.getvalue(), "b2": pack(packed["b2"]), "p0": b"no picture"}.items()
    )
    panels = [panel("views", "input", "images", "p1", "9 of 48 images"), panel("mine", "output", "mesh", "b2"),
              panel("broken", "input", "images", "p0", "9 of 48 images")]  # fmt: skip
    scene = json.dumps(SCENE | {"panels": panels, "limit": 0})
    path = tmp_path / "view.html"
    path.write_text(PAGE % (stored, built("page.js"), scene), encoding="utf-8")
    page = visit(path)
    page.evaluate("viewer.ready")
    pictures = seen(page)
    red = (np.abs(pictures[0] - (200, 40, 40)).max(axis=2) < 12).mean()
    assert 0.5 < red < 0.72  # two thirds of a square, less the margin
    assert page.locator(".dbv-panel").nth(0).inner_text().split("\n") == ["views input", "9 of 48 images"]
    assert "cannot be shown" in page.locator(".dbv-panel").nth(2).inner_text()
    before = seen(page)
    drag(page, 0, 40, 10)
    assert state(page) == {} and np.array_equal(seen(page, 1), before[1])
    drag(page, 1, 40, 10)
    assert not np.array_equal(seen(page, 1), before[1]) and np.array_equal(seen(page, 0), before[0])


@pytest.mark.parametrize("size, scheme", [(SIZES[0], "light"), (SIZES[1], "dark")])
def test_every_panel_shows_its_shape_and_foreign_text_stays_text(opened, size, scheme):
    page = opened(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    shown = seen(page)
    shares = [covered(pixels) for pixels in shown]
    ball = np.pi / 4 * 0.85**2  # about: a ball of radius 0.9 seen from 4 away, by 30 degrees
    assert shares[1] == pytest.approx(ball, rel=0.15) and shares[4] == pytest.approx(ball, rel=0.15)
    assert 0.15 < shares[2] <= shares[1] and shares[0] > 0.3
    assert page.locator(".dbv-panel").nth(3).inner_text().count("<img src=x onerror=") == 2
    assert page.evaluate("window.hacked") is None and page.locator(".dbv img").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_colours_are_those_of_the_scale_and_the_scale_has_numbers_and_a_unit(opened):
    page = opened()
    mine, reference = seen(page, 1), seen(page, 4)
    column = mine[:, mine.shape[1] // 2]
    rows = np.flatnonzero(np.abs(column - column[0]).max(axis=1) > 12)
    lightness = column[rows].sum(axis=1)
    assert lightness[5] < lightness[-5] - 150  # dark at the top, where the error is large
    middle = column[rows[len(rows) // 2]]
    hue = ERROR.astype(float) / np.linalg.norm(ERROR.astype(float), axis=1, keepdims=True)
    row = int(np.argmax(hue @ (middle / np.linalg.norm(middle))))
    assert (
        60 < row < 200
    )  # in the middle of the ball the error is in the middle of the scale, up to the camera's height
    grey = reference[reference.shape[0] // 2, reference.shape[1] // 2]
    assert np.argmax(grey) == np.argmax(PLAIN) and np.ptp(grey) < 25
    text = page.locator(".dbv-scale").inner_text()
    assert "radii of the reference" in text and "≥ 0.02" in text and re.search(r"\b0\b", text)
    page.get_by_role("button", name="Plain").click()
    mine, reference = (seen(page, k)[:300, :300] for k in (1, 4))
    assert np.abs(mine - reference).mean() < 4  # the same ball in the same colour, up to a pixel


def test_a_drag_turns_all_linked_panels_and_one_that_is_not(opened):
    page = opened()
    before = seen(page)
    drag(page, 2, 120, 30)
    after = seen(page)
    moved = [np.abs(a - b).mean() for a, b in zip(before, after, strict=True)]
    assert moved[0] > 0.5 and moved[1] > 0.5 and moved[2] > 2 and moved[3] == 0
    assert list(state(page)) == ["camera"] and len(state(page)["camera"]) == 6
    page.get_by_label("Linked cameras").uncheck()
    before = seen(page)
    drag(page, 1, -90, 20)
    after = seen(page)
    moved = [np.abs(a - b).mean() for a, b in zip(before, after, strict=True)]
    assert moved[1] > 0.5 and moved[0] == moved[2] == moved[4] == 0
    page.get_by_label("Linked cameras").check()
    cameras = state(page)["camera"]
    assert len(cameras) == 6


def test_a_slice_hides_pixels_and_shows_the_inside(opened):
    page = opened({"mode": "plain"})
    blue = lambda pixels: ((pixels[..., 2] - pixels[..., 0]) > 25).mean()  # noqa: E731
    whole = seen(page, 1)
    page.get_by_label("Slice", exact=True).select_option("z")
    cut = seen(page, 1)
    assert covered(cut) < 0.9 * covered(whole) and blue(cut) > 0.1 > 0.01 > blue(whole)
    page.get_by_label("Place of the slice").fill("-1")
    assert covered(seen(page, 1)) < 0.01
    page.get_by_role("button", name="Other side").click()
    assert covered(seen(page, 1)) == pytest.approx(covered(whole), rel=0.03)
    assert state(page) == {"mode": "plain", "slice": ["z", -1, 1]}


def test_edges_and_points(opened):
    page = opened({"mode": "plain"})
    surface = seen(page, 4)
    page.get_by_role("button", name="With edges").click()
    edges = seen(page, 4)
    assert edges.mean() < surface.mean() - 3 and covered(edges) == pytest.approx(covered(surface), rel=0.03)
    page.get_by_role("button", name="Points", exact=True).click()
    assert covered(seen(page, 4)) > 0.2 and np.abs(seen(page, 4) - surface).mean() > 1


def test_keys_rotate_zoom_and_reset(opened):
    page = opened()
    view = page.locator(".dbv-view").nth(1)
    whole = covered(seen(page, 1))
    view.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowUp")
    yaw, pitch, distance, *target = state(page)["camera"]
    assert (distance, target) == (4, [0, 0, 0]) and (yaw, pitch) != (-0.9, 0.41)
    page.keyboard.press("-")
    page.keyboard.press("-")
    assert covered(seen(page, 1)) < whole
    page.keyboard.press("Shift+ArrowRight")
    assert state(page)["camera"][3:] != [0, 0, 0]
    page.keyboard.press("r")
    assert state(page) == {}
    page.get_by_role("button", name="Zoom in").click()
    assert state(page)["camera"][2] == pytest.approx(3.2)


def test_the_pointer_reads_the_distance_of_what_is_in_front(opened):
    page = opened()
    view = page.locator(".dbv-view").nth(1)
    here = view.locator(".dbv-here")
    view.hover()
    # The ball's point towards the camera, 0.41 above the plane: its height, as a share of the scale.
    assert float(here.inner_text()) == pytest.approx((0.9 * np.sin(0.41) + 0.9) / 1.8 * 0.02, rel=0.1)
    page.evaluate("viewer.setState({ slice: ['y', 0.3] })")
    view.hover(position={"x": 5, "y": 5})
    assert here.inner_text() == ""
    page.evaluate("viewer.setState({ camera: [0, 1.553, 4, 0, 0, 0] })")
    view.hover()
    assert here.inner_text() in ("≥ 0.02", "0.02")
    page.locator(".dbv-view").nth(4).hover()
    assert here.inner_text() == "" == page.locator(".dbv-here").nth(3).inner_text()  # the reference has no errors


def test_the_wheel_scrolls_the_page_until_a_panel_has_the_focus(opened):
    page = opened(viewport={"width": 700, "height": 500})
    view = page.locator(".dbv-view").first
    view.hover()
    page.mouse.wheel(0, 60)
    page.wait_for_function("scrollY > 0")
    assert state(page) == {}
    view.focus()
    view.hover()
    page.mouse.wheel(0, 100)
    page.wait_for_function("viewer.getState().camera?.[2] > 4")


def test_fingers_rotate_and_pinch(opened):
    page = opened()
    page.evaluate(
        """() => { const view = document.querySelector(".dbv-view");
        const send = (type, id, x, y) => view.dispatchEvent(
        new PointerEvent(type, { pointerId: id, pointerType: "touch", clientX: x, clientY: y, bubbles: true }));
        view.setPointerCapture = () => {};
        send("pointerdown", 1, 100, 100); send("pointermove", 1, 130, 100);
        send("pointerdown", 2, 230, 100); send("pointermove", 2, 330, 100);
        send("pointerup", 1, 130, 100); send("pointerup", 2, 330, 100); }"""
    )
    yaw, _, distance, *_ = state(page)["camera"]
    assert yaw == pytest.approx(-0.9 - 30 * 0.009, abs=2e-3) and distance == pytest.approx(2, abs=2e-3)


def test_a_state_is_short_and_restores_the_view(opened):
    given = {
        "camera": [0.4, 0.9, 3, 0.1, 0, -0.1], "mode": "plain", "style": "edges", "slice": ["x", 0.25],
        "hidden": [0, 3],
    }  # fmt: skip
    page = opened(given)
    assert state(page) == given
    first = seen(page)
    assert len(first) == 3
    page.evaluate("viewer.setState(null)")
    assert state(page) == {} and len(seen(page)) == 5
    page.evaluate("state => viewer.setState(state)", given)
    assert all(np.array_equal(a, b) for a, b in zip(first, seen(page), strict=True))
    assert page.evaluate("states") == []  # what the page sets is not reported back to it
    page.get_by_role("button", name="input").click()
    page.wait_for_function("states.length")
    assert page.evaluate("states") == [{**given, "hidden": [3]}]


def test_a_link_of_anybody_does_no_harm(opened):
    page = opened()
    for foreign in (
        [], 7, {"camera": [1, 2]}, {"camera": "x", "slice": ["w", 1], "hidden": 3, "style": {}, "mode": None},
        {"camera": [0, 99, -5, 1e9, 0, None]}, {"hidden": [0, 1, 2, 3, 4]}, {"linked": False, "camera": [[1], None]},
    ):  # fmt: skip
        page.evaluate("state => viewer.setState(state)", foreign)
        assert covered(seen(page, 1)) > 0.3, foreign
        kept = state(page)
        assert kept == {} or (not kept["linked"] and kept["camera"][1] == [-0.9, 0.41, 4, 0, 0, 0]), foreign
        page.evaluate("viewer.setState({ mode: 'plain' })")


def test_shapes_are_unpacked_as_python_does(opened, packed):
    page = opened()
    for name, shape in packed.items():
        found = page.evaluate(
            """async (id) => { const s = await detailbenchViewer.shapeOf(id);
            return { quantised: [...s.quantised], faces: s.faces && [...s.faces], errors: s.errors && [...s.errors],
                     normals: s.normals && [...s.normals], positions: [...s.positions] }; }""",
            name,
        )
        shape = unpack(pack(shape))
        assert found["quantised"] == shape.positions.ravel().tolist()
        assert found["faces"] == (None if shape.faces is None else shape.faces.ravel().tolist())
        assert found["errors"] == (None if shape.errors is None else shape.errors.tolist())
        assert np.allclose(np.reshape(found["positions"], (-1, 3)), shape.points, atol=1e-6)
        if shape.normals is not None:
            assert np.abs(np.reshape(found["normals"], (-1, 3)) - shape.points / 0.9).max() < 0.02


def test_it_draws_once_after_a_change_and_then_rests(opened):
    page = opened()
    page.evaluate("""() => { window.draws = 0; const old = WebGL2RenderingContext.prototype.clear;
        WebGL2RenderingContext.prototype.clear = function (...all) { draws++; return old.apply(this, all); };
        WebGL2RenderingContext.prototype.readPixels = () => { throw new Error("this stalls the GPU"); } }""")
    page.wait_for_timeout(300)
    assert page.evaluate("draws") == 0
    page.get_by_role("button", name="Zoom in").click()
    settle(page)
    page.wait_for_timeout(200)
    assert page.evaluate("draws") == 1


def test_a_shape_that_is_missing_or_damaged_gives_a_sentence(opened):
    panels = [panel("mine", "output", "mesh", "a1"), panel("none", "output", "mesh", "ff")]
    page = opened(scene={**SCENE, "panels": panels[:1]})
    page.evaluate("""() => { (globalThis.detailbenchGeometry ??= {}).ff = btoa("glTF is something else");
        viewer.dispose();
        window.viewer = detailbenchViewer.mount(element, { ...scene, panels: [...scene.panels,
        { name: "none", role: "output", kind: "mesh", geometry: "ff", note: "" }] }); return viewer.ready; }""")
    said = page.locator(".dbv-view").nth(1).inner_text()
    assert said == "This shape cannot be shown. The stored shape has another format than this page reads."
    assert covered(seen(page, 0)) > 0.3


def test_without_webgl_and_after_its_loss_there_is_a_sentence(opened):
    page = opened()
    page.evaluate("""() => { const canvas = document.querySelector(".dbv-canvas");
        window.lose = canvas.getContext("webgl2").getExtension("WEBGL_lose_context"); lose.loseContext(); }""")
    page.wait_for_function("document.querySelector('.dbv-say').textContent.includes('took this view away')")
    page.evaluate("lose.restoreContext()")
    page.wait_for_function("document.querySelector('.dbv-say').textContent === ''")
    assert covered(seen(page, 1)) > 0.3
    page.evaluate("HTMLCanvasElement.prototype.getContext = () => null")
    page.evaluate("again(null)")
    assert "needs WebGL 2, which this browser does not offer" in page.locator(".dbv").inner_text()


def test_the_page_and_pictures_have_the_same_colours():
    from pathlib import Path

    import bench.pages

    source = (Path(bench.pages.__file__).parent / "web/src/viewer/colors.js").read_text()
    assert "".join(re.findall(r'"([0-9a-f]+)"', source)) == ERROR.tobytes().hex()
    assert f"PLAIN = [{', '.join(map(str, PLAIN))}]" in source
