"""Figures of stored results: what is on them, where, and in which colours."""

import re
import sys
import zlib
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pictured import PUSHED, stored

from bench import PointCloud
from bench.cli import main
from bench.errors import UsageError
from bench.pictures.camera import Camera, Window
from bench.pictures.chosen import chosen, renamed
from bench.pictures.colors import ERROR
from bench.pictures.errors import distances, weights
from bench.pictures.figure import Options, draw
from bench.pictures.printing import kind_of, width_of, wrapped
from bench.pictures.sheet import Layout, Tile, best_corner
from bench.pictures.tiles import Paint, Studio, darkened, discs, shown_points, spacing
from bench.pictures.zoom import visible, where_they_differ, zoom_of

SMALL = Layout(width=3.3, dpi=150)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return stored(tmp_path_factory.mktemp("figure"), failing=[("apss", 1)])[0]


@pytest.fixture(scope="module")
def sheet(kept):
    rows = chosen(kept.rows(), [kept], method="rimls,poisson,apss", case="1,0")
    options = Options(names={"rimls": "Ours & theirs"}, metrics=("p2f_mean",))
    return draw(rows, [kept], options, SMALL)


def texts(svg):
    """What is written on a figure, with its place."""
    found = re.findall(r'<text style="[^"]*"(?: x="([\d.-]+)" y="([\d.-]+)")?[^>]*>(.*?)</text>', svg, re.DOTALL)
    return [re.sub(r"<[^>]*>", " ", inner).strip().replace("&amp;", "&") for _, _, inner in found]


# --- the camera and the colours ---------------------------------------------------------------------------------------


def test_a_picture_shows_the_shape_where_the_camera_projects_it():
    mesh, camera = trimesh.creation.icosphere(3), Camera(20, 30)
    mesh.apply_scale([0.9, 0.5, 0.3])
    window, size = Window((0.1, -0.05), (1.2, 0.9)), (160, 120)
    cloud = PointCloud(mesh.vertices, mesh.vertex_normals)
    with Studio(camera) as studio:
        for shape in (mesh, cloud, mesh):
            (picture,) = studio.pictures(shape, Paint(), [(window, size)])
            assert picture.shape == (120, 160, 3)
            rows, columns = np.nonzero((picture < 240).any(axis=2))
            share = window.share(camera.project(mesh.vertices))
            expected = np.concatenate([share.min(axis=0) * size, share.max(axis=0) * size])
            found = [columns.min(), 120 - rows.max() - 1, columns.max() + 1, 120 - rows.min()]
            assert found == pytest.approx(expected, abs=2.5)


def test_a_constant_error_has_the_colour_of_its_place_on_the_scale():
    mesh = trimesh.creation.icosphere(3)
    window = Window((0.0, 0.0), (1.1, 1.1))
    with Studio(Camera()) as studio:
        for error, row in ((0.0, 0), (0.5, 128), (2.0, 255)):
            paint = Paint(np.full(len(mesh.vertices), error), 1.0)
            (picture,) = studio.pictures(mesh, paint, [(window, (100, 100))])
            middle = picture[45:55, 45:55].reshape(-1, 3).mean(axis=0)
            assert middle / middle.sum() == pytest.approx(ERROR[row] / ERROR[row].sum(), abs=0.045)


def test_discs_lie_across_the_normals_and_touch():
    rng = np.random.default_rng(0)
    points, normals = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for given, across in ((normals, normals), (None, np.tile(Camera().axes[2], (30, 1)))):
        vertices, faces, owner = discs(points, given, 0.1, Camera())
        away = vertices - points[owner]
        assert abs((away * across[owner]).sum(axis=1)).max() < 1e-12
        assert np.ptp(np.linalg.norm(away, axis=1)) < 1e-12
        assert (owner[faces] == owner[faces[:, :1]]).all() and len(faces) == 6 * 30
    dark = darkened(np.full((3, 3), 200, dtype=np.uint8), np.array([0.0, 1.0, 2.0]))
    assert (np.diff(dark.astype(int), axis=0) > 0).all() and dark.max() < 200
    grid = np.stack(np.meshgrid(*[np.arange(20) * 0.3] * 2, [0.0]), axis=-1).reshape(-1, 3)
    assert spacing(grid) == pytest.approx(0.3)
    assert len(shown_points(70_000)) == 60_000 and (np.diff(shown_points(70_000)) > 0).all()


# --- the place of insets ----------------------------------------------------------------------------------------------


def test_insets_show_where_methods_differ_and_what_can_be_seen():
    camera = Camera(0, 0)  # from +x
    points, faces = trimesh.sample.sample_surface(trimesh.creation.icosphere(4), 4000, seed=0)
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert (visible(points, normals, camera) == np.flatnonzero(normals[:, 0] > 0.6)).all()
    shade = np.vstack([points, points * 0.1 + [1.5, 0, 0]])  # a small ball in front of the middle
    seen = visible(shade, np.vstack([normals, normals]), camera)
    assert not (np.linalg.norm(shade[seen, 1:], axis=1)[seen < 4000] < 0.06).any()
    peak = np.array([0.8, 0.36, 0.48])
    far = np.linalg.norm(points - peak, axis=1)
    bad, behind = np.where(far < 0.2, 0.9, 0.1), np.where(points[:, 0] < -0.5, 0.9, 0.1)
    zoom = where_they_differ((points, normals), [(points, bad), (points, behind)], camera, 1.0)
    assert np.linalg.norm(np.array(zoom.center) - peak) < 0.2
    assert where_they_differ((points, normals), [(points, bad)], camera, 1.0) is None


def test_the_corner_of_insets_hides_least():
    white = np.full((100, 100, 3), 255, dtype=np.uint8)
    region = ((0.5, 0.5), (0.05, 0.05))
    low, high = slice(0, 40), slice(60, 100)
    for corner, (rows, columns) in enumerate([(high, low), (high, high), (low, low), (low, high)]):
        picture = np.zeros_like(white)
        picture[rows, columns] = 255
        assert best_corner([Tile(picture, white, region)], 1.0) == corner
    assert best_corner([Tile(white, white, ((0.9, 0.1), (0.05, 0.05)))], 1.0) != 1


# --- the sheet --------------------------------------------------------------------------------------------------------


def test_tiles_are_in_the_order_that_is_asked_for_and_none_is_blank(sheet, kept):
    assert sheet.titles == ["input", "Ours & theirs", "poisson", "apss", "reference"]
    ids = sorted(set(kept.rows()["case"]))
    assert sheet.rows == ids[::-1]
    for tiles in sheet.tiles:
        for title, tile in zip(sheet.titles, tiles, strict=True):
            if tile.picture is None:
                assert title == "apss" and tile.note == "error: ValueError: a wall of bricks"
            else:
                share = (tile.picture < 250).any(axis=2).mean()
                assert 0.2 < share < 0.95 and (tile.inset < 250).any(axis=2).mean() > 0.2
    shapes = {tile.picture.shape for tiles in sheet.tiles for tile in tiles if tile.picture is not None}
    assert len({shape[1] for shape in shapes}) == 1


def test_all_tiles_of_a_row_have_one_camera(sheet):
    """The outputs are the reference pushed outward by little: their outlines are its, a pixel wider."""
    for tiles in sheet.tiles:
        masks = [(tile.picture < 250).any(axis=2) for tile in tiles[1:] if tile.picture is not None]
        reference = masks[-1]
        for mask in masks[:-1]:
            assert (mask | reference).sum() - (mask & reference).sum() < 0.08 * reference.sum()
            for axis in (0, 1):
                spans = [np.flatnonzero(m.any(axis=axis))[[0, -1]] for m in (mask, reference)]
                assert np.subtract(*spans) == pytest.approx([0, 0], abs=3)


def test_a_row_shows_all_of_its_outputs_but_not_what_flies_away():
    from bench.pictures.figure import _near

    camera, window = Camera(), Window((0.0, 0.0), (1.0, 1.0))
    right, up, _ = camera.axes
    points = np.stack([right, 1.25 * up, 1.35 * up, -9 * right, 0.2 * right - 1.29 * up])
    assert np.array_equal(_near(points, camera, window), points[[0, 1, 4]])


def test_scores_have_one_unit_and_the_best_is_bold(sheet):
    ((metric, exponent, _),) = sheet.scores
    assert metric == "p2f_mean"
    for number, tiles in zip((2, 1), sheet.tiles, strict=True):
        for title, tile in zip(("rimls", "poisson", "apss"), tiles[1:4], strict=True):
            ((text, best),) = tile.scores
            if tile.note:
                assert (text, best) == ("-", False)
            else:
                assert float(text) * 10.0**exponent == pytest.approx(PUSHED[title] * number, rel=0.01)
    assert not tiles[0].scores and not tiles[-1].scores


def test_the_limit_is_a_high_quantile_of_all_that_is_shown(sheet, kept):
    from bench.pictures.shapes import case_shapes, places

    below, total = 0.0, 0.0
    for place, part in places(kept.rows()):
        shapes = case_shapes([kept], place, part)
        for item in shapes.outputs:
            if item.shape is not None:
                far = distances(item.shape, shapes.reference.shape)
                below += weights(item.shape)[far <= sheet.limit * (1 + 1e-6)].sum()  # limits are rounded to two digits
                total += 1
    assert 0.98 <= below / total <= 1


def test_text_is_text_in_svg_and_pdf(sheet):
    svg = sheet.save("svg").decode()
    found = " ".join(texts(svg))
    for text in ("Ours & theirs", "poisson", "reference", f"≥ {sheet.limit:g}", "distance to the reference (radii)"):
        assert text in found
    assert "ValueError: a" in found and "p2f_mean" in found.replace("_ ", "_")
    pdf = sheet.save("pdf")
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf
    streams = [
        zlib.decompress(s) for s in re.findall(rb"/FlateDecode[^>]*>>\s*stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
    ]
    shown = b"".join(b"".join(re.findall(rb"\((.*?)\)", s)) for s in streams if b" Tf" in s).replace(b"\0", b"")
    assert b"poisson" in shown and b"reference" in shown
    assert pdf.count(b"/Subtype /Image") >= 18  # tiles are pictures
    assert sheet.save("pdf") == pdf and sheet.save("svg").decode() == svg


def test_foreign_text_stays_text(sheet):
    from xml.etree import ElementTree

    name, note = "cost $x^2$ <b>&\x1b[31m\udcff 形", "a\x00b\nsecond line </text>"
    tiles = [[Tile(None, note=note) for _ in sheet.titles]]
    hostile = replace(sheet, titles=[name] * len(sheet.titles), rows=[name], tiles=tiles)
    hostile = replace(hostile, layout=replace(sheet.layout, width=14, aspects=(1.0,)))
    root = ElementTree.fromstring(hostile.save("svg"))
    found = " ".join("".join(element.itertext()) for element in root.iter("{http://www.w3.org/2000/svg}text"))
    assert "$x^2$ <b>&\ufffd" in found and "a\ufffdb second" in found.replace("\n", " ")
    assert hostile.save("pdf") and hostile.save("png")


def test_a_png_has_300_dots_per_inch(sheet):
    import io

    from PIL import Image

    sheet = replace(sheet, layout=replace(sheet.layout, dpi=300))
    image = Image.open(io.BytesIO(sheet.save("png")))
    assert image.size[0] == pytest.approx(3.3 * 300, abs=1)
    assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)


def test_long_names_are_broken_and_shortened():
    assert wrapped("a_very_long_name of many words", 0.6, 7, 9)[0].startswith("a_")
    assert wrapped("word " * 50, 0.6, 7, 2)[-1].endswith("…")
    assert wrapped("short", 9, 7, 1) == ["short"]


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_command_writes_the_figure_and_says_what_is_on_it(kept, tmp_path, capsys):
    target = tmp_path / "figure.svg"
    words = ["figure", str(kept.folder), "-o", str(target), "--method", "poisson,rimls", "--limit", "0.02"]
    assert main([*words, "--width", "column", "--size", "60", "--no-insets", "--names", "poisson=Screened"]) == 0
    assert {"Screened", "rimls", "≥ 0.02"} <= set(texts(target.read_text()))
    said = capsys.readouterr().out
    assert "1 x 4 tiles" in said and "--limit 0.02" in said and "insets" not in said


def test_without_stored_outputs_the_figure_says_what_keeps_them(tmp_path, capsys):
    results, _ = stored(tmp_path / "results", methods=("poisson",), cases=1, keeps=False)
    assert main(["figure", str(results.folder), "-o", str(tmp_path / "f.png"), "--size", "40"]) == 0
    assert (
        "poisson: no output is saved; run it again with outputs=all, or draw it with `detailbench figure --recompute`"
        in capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("command", "library"), [("figure", "pyvista"), ("figure", "matplotlib"), ("plot bars", "matplotlib")]
)
def test_a_missing_library_is_named_with_the_line_that_installs_it(command, library, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, library, None)
    assert main([*command.split(), "nowhere"]) == 1
    said = capsys.readouterr().err
    assert f"{library} is not installed; install it with: pip install" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "poison"], "poisson"),
        (["--case", "7"], "--case 7"),
        (["--case", "nowhere"], "part of a case's name"),
        (["--limit", "-1"], "--limit"),
        (["--zoom", "1,2"], "X,Y,Z,R"),
        (["--camera", "1"], "AZIMUTH"),
        (["--names", "poisson"], "NAME=TITLE"),
        (["--names", "jet=Jet"], "not shown"),
        (["--metric", "nothing"], "nothing"),
        (["--width", "wide"], "--width wide"),
        (["--seed", "5"], "--seed 5"),
        (["--size", "3"], "--size 3"),
        (["-o", "figure.gif"], ".pdf, .svg or .png"),
        (["-o", "/nowhere/at/all.pdf"], "no folder"),
        (["--zoom", "0,0,0,1", "--no-insets"], "choose one"),
    ],
)
def test_mistakes_are_answered_with_a_message(kept, words, message, capsys):
    assert main(["figure", str(kept.folder), *words]) == 1
    assert message in capsys.readouterr().err


def test_names_widths_and_kinds():
    assert renamed("a=A, b (c=1)=B", ["a", "b (c=1)"]) == {"a": "A", "b (c=1)": "B"}
    assert width_of("84mm") == pytest.approx(3.307, abs=1e-3) and width_of("column") == 3.3 and width_of("7") == 7
    assert kind_of("a.PDF") == "pdf" and zoom_of("0,1,2,0.5").radius == 0.5
    with pytest.raises(UsageError):
        width_of("900in")
