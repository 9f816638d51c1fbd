"""The shapes of a case of stored results: its input, the output of each method, and the reference.

Everything is in the frame of the case: box centre of the reference at the origin, its farthest vertex at radius 1.
Outputs and references are read from the files that ``outputs=first`` or ``outputs=all`` stored; the input is made again
from the dataset, the sensor and the seed of the record, as ``detailbench reproduce`` does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from ..errors import DetailbenchError
from ..geometry.cloud import Frame, PointCloud
from .labels import folder_of, labels

if TYPE_CHECKING:
    import pandas as pd
    from trimesh import Trimesh

    from ..contract.case import Case
    from ..plan.cell import Cell
    from ..results.store import Record, Results

    Geometry = Trimesh | PointCloud

UNIT = "radii of the reference"
KEEP = "run it again with outputs=all, or draw it with `detailbench figure --recompute`"
PLACE = ["task", "dataset", "sensor", "split", "seed", "case"]


class Place(NamedTuple):
    """The keys of a case in the results."""

    task: str
    dataset: str
    sensor: str
    split: str
    seed: int
    case: str


@dataclass(frozen=True)
class Item:
    """One shape to show.

    Attributes
    ----------
    name : str
        ``input``, ``reference``, or the label of a method; of an input with several parts, the argument's name.
    role : str
    shape : Trimesh, PointCloud, Views or None
        In the frame of the case; None if there is nothing to show.
    note : str
        Why there is nothing to show, as a sentence; or a note on the shape.
    row : mapping
        The row of the results of an output; empty for the others.
    """

    name: str
    role: Literal["input", "output", "reference"]
    shape: Any = None
    note: str = ""
    row: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class CaseShapes:
    """The shapes of one case, all in its frame.

    Attributes
    ----------
    place : Place
    inputs : tuple of Item
        One or several, in the order of the arguments of the task.
    outputs : tuple of Item
        One for each method, in the order of the rows.
    reference : Item
    frame : Frame or None
        From the original coordinates to the frame of the case; None if the case cannot be made again.
    unit : str
        Of lengths in this frame.
    """

    place: Place
    inputs: tuple[Item, ...]
    outputs: tuple[Item, ...]
    reference: Item
    frame: Frame | None = None
    unit: str = UNIT

    @property
    def items(self) -> tuple[Item, ...]:
        """Input, outputs, reference: the order in which they are shown."""
        return (*self.inputs, *self.outputs, self.reference)


def places(rows: pd.DataFrame) -> Iterator[tuple[Place, pd.DataFrame]]:
    """The cases of some rows, in the order of their first rows, each with its rows."""
    for key, part in rows.groupby(PLACE, sort=False, dropna=False):
        task, dataset, sensor, split, seed, case = key
        yield Place(task, dataset, sensor, split, int(seed), case), part


def case_shapes(folders: Sequence[Results], place: Place, rows: pd.DataFrame) -> CaseShapes:
    """The shapes of one case.

    Parameters
    ----------
    folders : sequence of Results
        Where the rows are from.
    place : Place
    rows : DataFrame
        The rows of this case, as returned by :meth:`bench.results.store.Results.rows`: one output each. A column
        ``label`` names them; without it :func:`bench.pictures.labels.labels` does.

    Returns
    -------
    CaseShapes
        With a note in place of whatever is missing: nothing is raised for a missing file, a plugin that is not
        installed, or a case that cannot be made again.
    """
    names = list(rows["label"]) if "label" in rows else labels(rows)
    found = [(name, row, folder_of(folders, row)) for name, row in zip(names, rows.to_dict("records"), strict=True)]
    outputs = tuple(_output(name, row, results) for name, row, results in found)
    case, why = _first_case(found)
    reference = _reference(found, case, why)
    if case is None:
        return CaseShapes(place, (Item("input", "input", None, why),), outputs, reference)
    return CaseShapes(place, _inputs(case, found[0][1]), outputs, reference, case.frame)


def case_of(results: Results, row: Mapping[str, Any]) -> Case:
    """The case of a row, made again from its record.

    Raises
    ------
    DetailbenchError
        If its plugins are not loaded, its data are missing, or its dataset no longer has such a case.
    """
    from ..errors import UsageError
    from ..results.checks import lacks
    from ..results.recorded import Stored

    record: Record | None = results.read(row["cell"], row["fingerprint"])
    missing = ["a readable file"] if record is None else lacks(record.meta)
    if record is None or missing:
        raise UsageError(f"the record of cell {row['cell']} lacks {', '.join(missing)}")
    stored = Stored(results, [record], record, {})
    if stored.missing:
        raise UsageError(f"{', '.join(stored.missing)} is not loaded; name its file with --plugin FILE")
    cell = stored.cell
    dataset, sensor = _cached(cell, results)
    recipes = cell.task.build().recipes(dataset, sensor, split=cell.split, count=cell.cases, seed=cell.seed)
    for recipe in recipes:
        if recipe.id == row["case"]:
            return recipe.build()
    raise UsageError(f"dataset {cell.dataset.label} has no case {row['case']} today")


def _cached(cell: Cell, results: Results) -> tuple[Any, Any]:
    """The dataset and the sensor of a cell, which read the cache of the folder, as left by a run of today's sources.

    Meshes and scans cost more than everything else in a picture. Nothing is added to the cache.
    """
    from ..contract.sensors import gives_scans, noun_of
    from ..engine.memo import Memo, RememberedDataset, RememberedSensor
    from ..plan.cell import NO_SENSOR
    from ..results.provenance import memory_keys

    keys = memory_keys(cell)
    memo = Memo(results.folder / ".cache", keys["dataset"], writes=False)
    dataset = RememberedDataset(cell.dataset.build(), memo)
    if cell.sensor == NO_SENSOR:
        return dataset, None
    sensor = cell.sensor.build()
    noun = noun_of(cell.sensor.plugin, sensor)
    if noun is None or gives_scans(cell.sensor.plugin, sensor):  # as in a run: these are files already
        return dataset, sensor
    return dataset, RememberedSensor(sensor, memo.at("sensor", keys["sensor"]), noun)


def _first_case(found: Sequence[tuple[str, Mapping[str, Any], Results | None]]) -> tuple[Case | None, str]:
    """The case, made from the first record that allows it; or None, and why the last one does not."""
    why = "the record is not in these folders"
    tried = set()
    for _, row, results in found:
        if results is None or (results.folder, row["cell"], row["fingerprint"]) in tried:
            continue
        tried.add((results.folder, row["cell"], row["fingerprint"]))
        try:
            return case_of(results, row), ""
        except (DetailbenchError, OSError) as error:
            why = f"the input cannot be made again: {error}"
    return None, why


def _inputs(case: Case, row: Mapping[str, Any]) -> tuple[Item, ...]:
    """The parts of an input that can be shown."""
    shown = {name: value for name, value in case.input.items() if _is_shown(value)}
    if not shown:
        return (Item("input", "input", None, "an input of this kind cannot be shown"),)
    note = _edited(shown, row)
    if len(shown) == 1:
        return (Item("input", "input", next(iter(shown.values())), note),)
    return tuple(Item(name, "input", value, note) for name, value in shown.items())


def _edited(shown: Mapping[str, Any], row: Mapping[str, Any]) -> str:
    """A note if the input has another number of points than in the record."""
    then, cloud = row.get("input.points"), shown.get("cloud")
    if not isinstance(cloud, PointCloud) or then is None or then != then or int(then) == len(cloud):
        return ""
    return f"the input had {int(then):,} points when it was run, and has {len(cloud):,} with today's dataset or sensor"


def _is_shown(value: Any) -> bool:
    from ..contract.views import Views

    return isinstance(value, (PointCloud, Views)) or (hasattr(value, "vertices") and hasattr(value, "faces"))


def _output(name: str, row: Mapping[str, Any], results: Results | None) -> Item:
    """The stored output of a row, or why there is none."""
    if row["status"] != "ok":
        reason = str(row.get("message") or "").strip().partition("\n")[0]
        return Item(name, "output", None, f"{row['status']}: {reason}" if reason else row["status"], row)
    path = results.output_of(row) if results else None
    if path is None:
        return Item(name, "output", None, f"no output is saved; {KEEP}", row)
    try:
        return Item(name, "output", load(path), "", row)
    except (DetailbenchError, OSError) as error:
        return Item(name, "output", None, f"the output cannot be read: {error}", row)


def _reference(found: Sequence[tuple[str, Mapping[str, Any], Results | None]], case: Case | None, why: str) -> Item:
    """The reference of the outputs: the stored file, or that of the case if there is none."""
    for _, row, results in found:
        path = results.reference_of(row) if results else None
        if path is None:
            continue
        try:
            return Item("reference", "reference", load(path))
        except (DetailbenchError, OSError) as error:
            why = f"the reference cannot be read: {error}"
    if case is None:
        return Item("reference", "reference", None, why)
    shape = case.reference
    return Item("reference", "reference", shape.mesh if shape.cloud is None else shape.cloud)


def load(path: Path) -> Geometry:
    """A stored file: a mesh if it has faces, and a cloud otherwise.

    Raises
    ------
    BadInput
        If it cannot be read.
    """
    from ..geometry.io.files import load_cloud, load_mesh

    return load_mesh(path) if has_faces(path) else load_cloud(path)


def has_faces(path: Path) -> bool:
    """Whether the header of a PLY file announces faces."""
    with open(path, "rb") as file:
        header = file.read(1 << 16).partition(b"end_header")[0]
    words = [line.split() for line in header.splitlines()]
    return any(line[:2] == [b"element", b"face"] and line[2:] != [b"0"] for line in words)
