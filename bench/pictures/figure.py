"""A figure of results: rows of cases, columns of the input, the methods and the reference, one colour scale."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from ..geometry.cloud import PointCloud
from ..ranking.report.numbers import plain, unit_exponent
from .camera import Camera, Window
from .chosen import case_names
from .errors import common_limit, distances, positions, weights
from .shapes import UNIT, CaseShapes, Item, case_shapes, places
from .sheet import Layout, Sheet, Tile
from .tiles import MOST_DISCS, Paint, Studio
from .zoom import RADIUS, Zoom, where_they_differ

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Results

ASPECTS = (0.55, 1.25)  # of a tile: height by width
REACH = 1.3  # times the window of the reference: outputs are shown up to there
SAMPLES = 6000  # of a reference, among which the place of an inset is searched
NEIGHBOURS = 25  # for estimating normals if the surfaces of clouds are shown


@dataclass(frozen=True)
class Options:
    """The look of a figure.

    Attributes
    ----------
    names : mapping
        The titles of columns that differ from the names of their methods.
    metrics : tuple of str
        Scores beneath each tile.
    limit : float or None
        The error at the end of the colour scale, in radii; a high quantile of all shown errors if None.
    insets : bool
    zoom : Zoom or None
        The place of insets; where methods differ most if None.
    edges : bool
        Draw the edges of meshes.
    surfaces : bool
        Show the screened Poisson surface of clouds that methods return.
    """

    camera: Camera = Camera()
    names: Mapping[str, str] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()
    limit: float | None = None
    insets: bool = True
    zoom: Zoom | None = None
    edges: bool = False
    surfaces: bool = False


@dataclass
class _Row:
    """A case, and its data needed before anything is drawn."""

    shapes: CaseShapes
    errors: list[np.ndarray | None]  # of each output
    window: Window
    zoom: Zoom | None = None


def draw(rows: pd.DataFrame, folders: Sequence[Results], options: Options, layout: Layout) -> Sheet:
    """The figure of some results.

    Parameters
    ----------
    rows : DataFrame
        As returned by :func:`bench.pictures.chosen.chosen`.
    folders : sequence of Results
        Where they are from.
    options : Options
    layout : Layout
        The size of the figure.

    Raises
    ------
    MissingLibrary
        When pyvista is not installed.
    """
    labels = list(dict.fromkeys(rows["label"]))
    names = case_names(rows)
    cases = [_row(case_shapes(folders, place, part), labels, options) for place, part in places(rows)]
    limit = options.limit or _limit(cases)
    if options.insets:
        for case in cases:
            case.zoom = options.zoom or _where(case, options.camera, limit)
    inputs = list(dict.fromkeys(item.name for case in cases for item in case.shapes.inputs))
    titles = [*inputs, *(options.names.get(name, name) for name in labels), "reference"]
    exponents = {metric: unit_exponent(rows[f"score.{metric}"].astype(float)) for metric in options.metrics}
    layout = layout.for_tiles(titles, [_aspect(case.window) for case in cases], len(options.metrics))
    with Studio(options.camera) as studio:
        tiles = [_tiles(case, inputs, labels, studio, limit, options, layout, exponents) for case in cases]
    return Sheet(
        titles=titles,
        rows=[names[tuple(case.shapes.place)] for case in cases],
        tiles=tiles,
        limit=limit,
        unit=UNIT,
        scores=[(metric, exponents[metric], _direction(rows, metric)) for metric in options.metrics],
        zooms=[case.zoom for case in cases],
        layout=layout,
    )


def _row(shapes: CaseShapes, labels: Sequence[str], options: Options) -> _Row:
    """A case with an output, or a note, for each label, and their errors."""
    of = {item.name: item for item in shapes.outputs}
    outputs = tuple(of.get(name, Item(name, "output", None, "not run on this case")) for name in labels)
    if options.surfaces:
        outputs = tuple(map(_surface, outputs))
    shapes, reference = replace(shapes, outputs=outputs), shapes.reference.shape
    errors = [None if item.shape is None or reference is None else distances(item.shape, reference) for item in outputs]
    first = reference if reference is not None else next((i.shape for i in outputs if i.shape is not None), None)
    shown = [] if first is None else [_extent(first)]
    shown += [_extent(item.shape) for item in shapes.inputs if len(shapes.inputs) > 1 and hasattr(item.shape, "faces")]
    window = options.camera.window(shown)
    shown += [_near(_extent(item.shape), options.camera, window) for item in outputs if item.shape is not None]
    return _Row(shapes, errors, options.camera.window(shown))


def _near(points: np.ndarray, camera: Camera, window: Window) -> np.ndarray:
    """Those of (n, 3) points that are not far outside of a window: distant points would make everything else small."""
    away = abs(window.share(camera.project(points)) - 0.5).max(axis=1, initial=0)
    return points[away * camera.zoom <= REACH / 2]


def _extent(shape: Any) -> np.ndarray:
    from ..geometry.used import used_vertices

    return shape.points if isinstance(shape, PointCloud) or not len(shape.faces) else used_vertices(shape)


def _surface(item: Item) -> Item:
    """The screened Poisson surface (depth 9) of a cloud, with normals estimated of 25 neighbours."""
    if not isinstance(item.shape, PointCloud):
        return item
    from ..contract.run import Run
    from ..geometry.normals import oriented_normals
    from ..plugins.registry import registry

    points = item.shape.points
    cloud = PointCloud(points, oriented_normals(points, NEIGHBOURS))
    return replace(item, shape=registry().find("method", "poisson").cls(depth=9).reconstruct(cloud, run=Run()))


def _limit(cases: Sequence[_Row]) -> float:
    pairs = [
        (errors, weights(item.shape))
        for case in cases
        for item, errors in zip(case.shapes.outputs, case.errors, strict=True)
        if errors is not None
    ]
    return common_limit(pairs)


def _where(case: _Row, camera: Camera, limit: float) -> Zoom | None:
    """The place of a case's insets."""
    reference = case.shapes.reference.shape
    if reference is None or isinstance(reference, PointCloud) or not len(reference.faces):
        return None
    from ..geometry.mesh_surface import MeshSurface

    outputs = [
        (np.asarray(positions(item.shape)), errors)
        for item, errors in zip(case.shapes.outputs, case.errors, strict=True)
        if errors is not None
    ]
    sample = MeshSurface(reference).sample(SAMPLES, np.random.default_rng(0))
    return where_they_differ(sample, outputs, camera, limit, RADIUS)


def _aspect(window: Window) -> float:
    return float(np.clip(window.half[1] / window.half[0], *ASPECTS))


def _tiles(
    case: _Row,
    inputs: Sequence[str],
    labels: Sequence[str],
    studio: Studio,
    limit: float,
    options: Options,
    layout: Layout,
    exponents: Mapping[str, int],
) -> list[Tile]:
    """One row of tiles."""
    size = layout.pixels(_aspect(case.window))
    window = case.window.with_aspect(size[1] / size[0])
    views = [(window, size)]
    if case.zoom is not None:
        views.append((case.zoom.window(options.camera), layout.inset_pixels))
    given = {item.name: item for item in case.shapes.inputs}
    items = [given.get(name, Item(name, "input", None, "none")) for name in inputs]
    errors = [None] * len(items)
    items, errors = [*items, *case.shapes.outputs, case.shapes.reference], [*errors, *case.errors, None]
    best = {metric: _best(case.shapes.outputs, metric) for metric in exponents}
    tiles = []
    for item, error in zip(items, errors, strict=True):
        scores = _scores(item, exponents, best) if item.role == "output" else ()
        if item.shape is None or not isinstance(item.shape, PointCloud) and not hasattr(item.shape, "faces"):
            tiles.append(_of_images(item) if item.shape is not None else Tile(None, note=item.note, scores=scores))
            continue
        if not len(positions(item.shape)):
            tiles.append(Tile(None, note="has no points", scores=scores))
            continue
        paint = Paint(error, limit, options.edges)
        pictures = studio.pictures(item.shape, paint, views)
        region = None
        if case.zoom is not None:
            region = (window.share(options.camera.project(np.array([case.zoom.center])))[0], _half(case.zoom, window))
        inset = pictures[1] if len(pictures) > 1 else None
        tiles.append(Tile(pictures[0], inset, region, _note(item), scores))
    return tiles


def _half(zoom: Zoom, window: Window) -> tuple[float, float]:
    """Half the width and height of a zoomed region, as shares of the window."""
    return zoom.radius / (2 * window.half[0]), zoom.radius / (2 * window.half[1])


def _of_images(item: Item) -> Tile:
    """Images that are an input: the first four, as a square."""
    images = np.asarray(item.shape.images)
    shown = images[:: max(1, len(images) // 4)][:4]
    if len(shown) == 4:
        picture = np.concatenate([np.concatenate(list(shown[i : i + 2]), axis=1) for i in (0, 2)], axis=0)
    else:
        picture = shown[0]
    return Tile(picture, is_photo=True, caption=f"{len(shown) if len(shown) == 4 else 1} of {len(images)} images")


def _note(item: Item) -> str:
    if item.note:
        return item.note
    count = len(item.shape) if isinstance(item.shape, PointCloud) else 0
    return f"{MOST_DISCS:,} of {count:,} points are drawn" if count > MOST_DISCS else ""


def _direction(rows: pd.DataFrame, metric: str) -> str:
    for text in rows["directions"]:
        if isinstance(text, str) and metric in (known := json.loads(text)):
            return known[metric]
    return ""


def _value(item: Item, metric: str) -> float:
    value = item.row.get(f"score.{metric}")
    return math.nan if value is None or item.row.get("status") != "ok" else float(value)


def _best(outputs: Sequence[Item], metric: str) -> float:
    """The best score of a case; NaN if no direction is better."""
    values = [v for v in (_value(item, metric) for item in outputs) if math.isfinite(v)]
    stored = (i.row.get("directions") for i in outputs)
    known: dict[str, str] = next((json.loads(text) for text in stored if isinstance(text, str)), {})
    choose = {"lower": min, "higher": max}.get(known.get(metric, ""))
    return choose(values) if choose and len(values) > 1 else math.nan


def _scores(item: Item, exponents: Mapping[str, int], best: Mapping[str, float]) -> tuple[tuple[str, bool], ...]:
    """The text beneath a tile: each score, and whether it is the best of its row."""
    values = {metric: _value(item, metric) for metric in exponents}
    return tuple((plain(values[m], exponents[m]), values[m] == best[m]) for m in exponents)


def check_metrics(names: Sequence[str], rows: pd.DataFrame) -> None:
    """Raise :class:`UsageError` for a metric that no row has."""
    from ..ranking.selection import matching, metrics_of

    for name in names:
        if len(matching("metric", [name], metrics_of(rows))) != 1:
            raise UsageError(f"--metric {name}: names several scores; choose one")
