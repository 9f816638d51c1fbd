"""The shapes of a page: the cases with stored outputs, made small enough for the page, with their errors.

Errors are of the full outputs: distances are measured before a mesh is simplified, and each vertex that is shown has
the distance of the nearest vertex of the full one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..geometry.cloud import PointCloud
from ..notices import notice
from ..pictures.errors import common_limit, distances, weights
from ..pictures.labels import folder_of, labels
from ..pictures.shapes import CaseShapes, Item, case_shapes, places
from .contact_sheet import contact_sheet
from .packing import pack, quantised

if TYPE_CHECKING:
    import pandas as pd
    from trimesh import Trimesh

    from ..pictures.shapes import Place
    from ..results.store import Results

MOST = 40_000  # faces, or points, of a shape: more cost time in a browser, and show nothing more in a panel
FEWEST = 2_000  # of a shape still worth showing
BYTES_OF_FACE, BYTES_OF_POINT = 4.2, 8.0  # approximate size of a packed shape; measured
SPARE = 0.97  # of the budget, if a first packing missed it
ABOVE = 1.25  # times the cap that is expected: of the first simplification
TRIES = 5
OF_IMAGES = 0.25  # of the budget, for the images that are inputs


@dataclass(eq=False)
class _Panel:
    """A shape on its way into a page."""

    item: Item
    shape: Trimesh | PointCloud | None = None
    errors: np.ndarray | None = None  # (n,) shares of the limit
    full: int = 0  # faces or points of the full shape
    picture: bytes = b""  # where it shows images: a file of them

    @property
    def is_mesh(self) -> bool:
        return self.shape is not None and not isinstance(self.shape, PointCloud)

    @property
    def size(self) -> int:
        """Faces of a mesh, points of a cloud."""
        if self.shape is None:
            return 0
        return len(self.shape) if isinstance(self.shape, PointCloud) else len(self.shape.faces)

    @property
    def amount(self) -> tuple[int, float]:
        """Its size, and about how many bytes each face or point takes."""
        return self.size, BYTES_OF_FACE if self.is_mesh else BYTES_OF_POINT


class Track(Protocol):
    """Shows progress."""

    def __call__(self, items: Sequence[Any], text: str) -> Iterable[Any]:
        """The same items one by one, under the progress title ``text``."""


def untracked(items: Sequence[Any], text: str) -> Iterable[Any]:
    """No progress."""
    return items


def scenes(
    results: Results | Sequence[Results], rows: pd.DataFrame, budget_bytes: int, track: Track = untracked
) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    """The cases of some rows with stored outputs, as scenes for the viewer of the page.

    If not all cases fit, the first ones of each dataset and sensor are used; a notice reports how many are left out.

    Parameters
    ----------
    results : Results or sequence of Results
        The folders of the rows.
    rows : DataFrame
        As returned by :meth:`bench.results.store.Results.rows`.
    budget_bytes : int
        All packed shapes together take no more. In base64 they are a third larger.
    track : Track
        Where progress is shown.

    Returns
    -------
    scenes : list of dict
        ``id``, ``title``, ``unit``, ``limit`` (the distance at the end of the colour scale, 0 where nothing differs
        from the reference), ``task``, ``dataset``, ``sensor``, ``split``, ``seed``, ``case``, and ``panels``: dicts
        with ``name``, ``role`` (``input``, ``output`` or ``reference``), ``kind`` (``mesh``, ``cloud``, ``images`` or
        None), ``geometry`` (an ID, or None where there is nothing to show but the note) and ``note``. Empty where no
        output is kept.
    geometry : dict of str to bytes
        The packed shapes (:mod:`bench.pages.packing`) by ID, and the images of inputs as files. Equal ones are there
        once.
    """
    folders = list(results) if isinstance(results, Sequence) else [results]
    found = _fitting(_cases(folders, rows), budget_bytes)
    named = [field for field in ("task", "split", "seed") if len({getattr(place, field) for place, _ in found}) > 1]
    most = _first_cap([part for _, part in found], budget_bytes)
    room = OF_IMAGES * budget_bytes / max(1, len(found))
    made = [
        _scene(place, case_shapes(folders, place, part), most, named, room)
        for place, part in track(found, "reading and simplifying")
    ]
    every = [panel for _, panels in made for panel in panels]
    pictures = {id(panel): _Packed(panel.picture, 0) for panel in every if panel.picture}
    packed = pictures | _packed(every, budget_bytes - sum(len(one.data) for one in pictures.values()), track)
    geometry: dict[str, Any] = {}
    shown = []
    for scene, panels in made:
        data = [packed.get(id(panel)) for panel in panels]
        if None in [one for one, panel in zip(data, panels, strict=True) if panel.shape is not None]:
            continue  # the budget is too small for it
        geometry |= {_name(one.data): one.data for one in data if one}
        shown.append(scene | {"panels": [_panel(*pair) for pair in zip(panels, data, strict=True)]})
    return shown, geometry


# -- which cases -------------------------------------------------------------------------------------------------------


def _cases(folders: Sequence[Results], rows: pd.DataFrame) -> list[tuple[Place, pd.DataFrame]]:
    """The cases with a stored output, each with the rows that have one or failed."""
    if not len(rows):
        return []
    rows = rows.reset_index(drop=True)
    rows = rows.assign(label=labels(rows), __kept=[_is_kept(folders, row) for row in rows.to_dict("records")])
    found = []
    for place, part in places(rows):
        failed = ~part["status"].isin(["ok", "skipped"])
        if part["__kept"].any():
            part = part[part["__kept"] | failed].sort_values("label", kind="stable")
            found.append((place, part.drop(columns="__kept")))
    return found


def _is_kept(folders: Sequence[Results], row: Mapping[str, Any]) -> bool:
    folder = folder_of(folders, row) if row.get("output") else None
    return folder is not None and folder.output_of(row) is not None


def _fitting(cases: list[tuple[Place, pd.DataFrame]], budget: int) -> list[tuple[Place, pd.DataFrame]]:
    """As many cases as the budget has room for: the first of each dataset and sensor, then the second, and so on."""
    turns: dict[tuple[str, str, str], int] = {}
    order = []
    for number, (place, part) in enumerate(cases):
        turn = turns[place[:3]] = turns.get(place[:3], -1) + 1
        order.append((turn, number, len(part) + 2))
    room, chosen = budget / (FEWEST * BYTES_OF_FACE), []
    for _, number, shapes in sorted(order):
        if shapes > room:
            break
        room -= shapes
        chosen.append(number)
    if left_out := len(cases) - len(chosen):
        what = "case with kept outputs does" if left_out == 1 else "cases with kept outputs do"
        notice(f"3-D view: {left_out} {what} not fit into {budget / 1e6:.3g} MB of shapes")
    return sorted((cases[number] for number in chosen), key=lambda case: (*map(str, case[0][:4]), *case[0][4:]))


# -- what is in a case -------------------------------------------------------------------------------------------------


def _scene(
    place: Place, shapes: CaseShapes, most: int, named: Sequence[str], room: float
) -> tuple[dict[str, Any], list[_Panel]]:
    """The description of a scene's case, with the ``named`` fields in its title, and panels with at most so many faces.

    Images that are inputs take at most ``room`` bytes.
    """
    panels = [_Panel(item) for item in shapes.items]
    reference = shapes.reference.shape
    measured: dict[int, np.ndarray] = {}
    for number, item in enumerate(shapes.items):
        if _is_compared(item) and reference is not None:
            measured[number] = distances(item.shape, reference)
    outputs = [number for number in measured if shapes.items[number].role == "output"]
    limit = common_limit((measured[n], weights(shapes.items[n].shape)) for n in outputs)
    for number, panel in enumerate(panels):
        if _can_be_shown(panel.item.shape):
            panel.shape, panel.full = panel.item.shape, _Panel(panel.item, panel.item.shape).size
            if number in measured and limit > 0:
                panel.errors = np.minimum(measured[number] / limit, 1)
            panels[number] = _smaller(panel, most)
        elif panel.item.shape is not None:
            panels[number] = _of_images(panel.item, room / len(shapes.inputs))
        panels[number].item = _without_shape(panels[number].item)  # the full one is not needed any more
    said = place._asdict()
    more = [f"seed {place.seed}" if field == "seed" else getattr(place, field) for field in named]
    title = " · ".join(filter(None, [place.case, place.sensor, *more]))
    name = hashlib.sha256("\n".join(map(str, place)).encode("utf-8", "replace")).hexdigest()[:12]
    return {"id": name, "title": title, "unit": shapes.unit, "limit": limit, **said}, panels


def _can_be_shown(shape: Any) -> bool:
    return isinstance(shape, PointCloud) or (hasattr(shape, "vertices") and hasattr(shape, "faces"))


def _is_compared(item: Item) -> bool:
    """Outputs are compared with the reference, and so are inputs that are points: they show the noise of the input."""
    return _can_be_shown(item.shape) and (
        item.role == "output" or (item.role == "input" and isinstance(item.shape, PointCloud))
    )


def _of_images(item: Item, room: float) -> _Panel:
    """A panel of images that are an input, in at most ``room`` bytes."""
    sheet = contact_sheet(item.shape, room)
    said = f"{len(item.shape)} images, which do not fit into the page" if sheet is None else sheet.note
    note = "; ".join(filter(None, [item.note, said]))
    return _Panel(Item(item.name, item.role, None, note, item.row), picture=b"" if sheet is None else sheet.data)


def _without_shape(item: Item) -> Item:
    return Item(item.name, item.role, None, item.note, item.row)


# -- fewer faces -------------------------------------------------------------------------------------------------------


def _smaller(panel: _Panel, cap: int) -> _Panel:
    """The panel with at most ``cap`` faces or points; each has the error of the nearest one before."""
    from ..geometry.neighbours import OrderedPoints
    from ..geometry.simplify import simplify

    if panel.shape is None or panel.size <= cap:
        return panel
    if isinstance(panel.shape, PointCloud):
        kept = np.linspace(0, panel.size - 1, cap).astype(np.int64)
        normals = panel.shape.normals
        cloud = PointCloud(panel.shape.points[kept], None if normals is None else normals[kept])
        return _Panel(panel.item, cloud, None if panel.errors is None else panel.errors[kept], panel.full)
    shape = simplify(panel.shape, max(cap, 4))
    errors = panel.errors
    if errors is not None:
        before = OrderedPoints(np.asarray(panel.shape.vertices))
        errors = errors[OrderedPoints(np.asarray(shape.vertices)).nearest_in(before).index]
    return _Panel(panel.item, shape, errors, panel.full)


@dataclass(frozen=True)
class _Packed:
    data: bytes
    size: int  # faces or points


def _packed(panels: Iterable[_Panel], budget: int, track: Track) -> dict[int, _Packed]:
    """The containers of all panels with a shape by the panel's ``id``: together, each counted once, within the budget.

    Shapes with many faces lose some, down to a number that is the same for all. Where even the fewest faces are too
    many, the last panels have none.
    """
    panels = [panel for panel in panels if panel.shape is not None]
    cap = _cap([panel.amount for panel in panels], budget)
    packed: dict[int, _Packed] = {}
    for _ in range(TRIES):
        for panel in track(panels, "packing"):
            before = packed.get(id(panel))
            if before is None or before.size > cap:
                small = _smaller(panel, max(cap, FEWEST))
                packed[id(panel)] = _Packed(_pack(small), small.size)
        total = sum(map(len, {one.data for one in packed.values()}))
        if total <= budget or cap <= FEWEST:
            break
        cap = int(cap * SPARE * budget / total)
    kept, room, seen = {}, budget, set()
    for key, one in packed.items():
        room -= 0 if one.data in seen else len(one.data)
        seen.add(one.data)
        if room >= 0:
            kept[key] = one
    return kept


def _cap(amounts: Sequence[tuple[int, float]], budget: int) -> int:
    """How many faces or points a shape may have so that all together take about the budget.

    ``amounts`` are pairs of a size and the bytes of one.
    """
    low, high = FEWEST, MOST
    while low < high:
        middle = (low + high + 1) // 2
        fits = sum(min(size, middle) * each for size, each in amounts) <= budget
        low, high = (middle, high) if fits else (low, middle - 1)
    return low


def _first_cap(parts: Sequence[pd.DataFrame], budget: int) -> int:
    """A cap estimated from the rows, slightly above what will fit: a large mesh is simplified only once."""
    amounts = []
    for part in parts:
        kept = part[part["status"] == "ok"]
        faces, points = kept["output_faces"].fillna(0), kept["output_points"].fillna(0)
        sizes = [
            (int(f), BYTES_OF_FACE) if f > 0 else (int(p), BYTES_OF_POINT) for f, p in zip(faces, points, strict=True)
        ]
        amounts += [*sizes, *[max(sizes)] * 2]  # the input and the reference, as large as the largest output
    return min(MOST, int(ABOVE * _cap(amounts, budget)))


def _pack(panel: _Panel) -> bytes:
    shape = panel.shape
    assert shape is not None
    if isinstance(shape, PointCloud):
        return pack(quantised(shape.points, None, panel.errors, shape.normals))
    return pack(quantised(shape.vertices, shape.faces, panel.errors))


def _panel(panel: _Panel, packed: _Packed | None) -> dict[str, Any]:
    """The description of a panel for the page."""
    notes = [panel.item.note] if panel.item.note else []
    if packed is not None and packed.size < panel.full:
        what = "faces" if panel.is_mesh else "points"
        scored = f"; scores are of {'the full mesh' if panel.is_mesh else 'all points'}" * (panel.item.role == "output")
        notes.append(f"shown with {packed.size:,} of {panel.full:,} {what}{scored}")
    return {
        "name": panel.item.name,
        "role": panel.item.role,
        "kind": None if packed is None else "images" if panel.picture else "mesh" if panel.is_mesh else "cloud",
        "geometry": None if packed is None else _name(packed.data),
        "note": "; ".join(notes),
    }


def _name(data: bytes) -> str:
    """The ID of a packed shape: equal ones have the same."""
    return hashlib.sha256(data).hexdigest()[:16]
