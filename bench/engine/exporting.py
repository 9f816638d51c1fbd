"""The inputs of cells as files, for code that runs elsewhere.

::

    FOLDER/manifest.json              the outputs to make and their inputs, see docs/external.md
    FOLDER/GROUP/inputs/CASE.ply      the inputs of one dataset, sensor and seed
    FOLDER/GROUP/outputs/             the folder for the outputs, under the same names
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import DetailbenchError
from ..geometry.cloud import PointCloud
from ..plan.cell import Cell
from ..plan.limits import Limits
from ..results.files import write_atomically
from ..results.kept_outputs import file_name
from ..results.provenance import memory_keys
from ..seeds import generator
from .isolate import Isolation

if TYPE_CHECKING:
    from .channel import Channel

CASES = ".cases.json"  # the list of files that a worker wrote, for the runner


def group_of(cell: Cell) -> str:
    """The name of the folder of a cell's inputs."""
    parts = (cell.task.label, cell.dataset.label, cell.sensor.label, cell.split, f"seed{cell.seed}")
    return file_name("-".join(part for part in parts if part not in ("none", "test")), "")


def export(cell: Cell, folder: Path, limit: Limits, plugins: tuple[str, ...] = ()) -> list[dict[str, Any]]:
    """Write the inputs of a cell's cases, in a child process.

    Returns
    -------
    list of dict
        The entry of each case in the manifest.

    Raises
    ------
    DetailbenchError
        If a case cannot be made, or its input is not a cloud.
    """
    group = group_of(cell)
    (folder / group / "outputs").mkdir(parents=True, exist_ok=True)
    arguments = {
        "cell": cell.to_json(),
        "folder": str(folder),
        "group": group,
        "keys": memory_keys(cell),
    }
    with Isolation(plugins=plugins, threads=cell.threads) as isolation:
        row = isolation.call("bench.engine.exporting:write", arguments, limit=limit)
    if row["status"] != "ok":
        raise DetailbenchError(f"{cell.title}: {row['message']}")
    listed = folder / group / CASES
    cases = json.loads(listed.read_text(encoding="utf-8"))
    listed.unlink()
    return cases


def write(spec: Mapping[str, Any], channel: Channel) -> None:
    """The worker's side."""
    from ..text import bounded
    from .channel import plain
    from .worker import failure

    try:
        _write(spec, channel)
        row: dict[str, Any] = {"status": "ok"}
    except BaseException as error:  # the boundary: shown as one message
        row = {"stage": channel.stage} | failure(error, channel.stage)
    channel.send("result", row=plain(bounded(row)))


def _write(spec: Mapping[str, Any], channel: Channel) -> None:
    from .worker import Session

    asked = spec["arguments"]
    folder, group = Path(asked["folder"]), asked["group"]
    # The cases are made as a run makes them; they are not cached.
    job = {"cell": asked["cell"], "keys": asked["keys"], "cache_gb": 0, "cache": str(folder / ".cache")}
    session = Session({**spec, **job, "done": [], "owed": []}, channel)
    channel.enter("plan", -1)
    _, recipes = session.plan()
    cases = []
    for index, recipe in enumerate(recipes):
        channel.enter("case", index)
        cases.append(_written(session.made(recipe), session.cell, folder, group))
    write_atomically(folder / group / CASES, json.dumps(cases).encode())


def _written(case: Any, cell: Cell, folder: Path, group: str) -> dict[str, Any]:
    """Write the input of one case; its entry in the manifest."""
    from ..geometry.io.files import save

    clouds = {name: value for name, value in case.input.items() if isinstance(value, PointCloud)}
    numbers = {name: value for name, value in case.input.items() if isinstance(value, (int, float))}
    if len(clouds) != 1 or len(clouds) + len(numbers) < len(case.input):
        raise DetailbenchError(
            f"task {cell.task.label}: its input is not a single point cloud; only point clouds are written to files"
        )
    (cloud,) = clouds.values()
    name = file_name(case.id)
    save(PointCloud(cloud.points, cloud.normals), folder / group / "inputs" / name)
    return {
        "case": case.id,
        "group": group,
        "input": f"{group}/inputs/{name}",
        "output": f"{group}/outputs/{name}",
        "points": len(cloud),
        "normals": cloud.normals is not None,
        "seed": int(generator(cell.seed, case.id, "run").integers(2**31)),
        **numbers,
    }
