"""Write the inputs of cases to files, for code that runs elsewhere; `detailbench import` scores its outputs.

  detailbench inputs FOLDER dataset=bumps,cad sensor=noisy,scanned seed=0
  detailbench inputs FOLDER task=upsample task.ratio=4 dataset=knots cases=8
  detailbench inputs FOLDER experiment=breadth            the inputs of all its cells
  detailbench import FOLDER --method my_method results=results

FOLDER/manifest.json lists the cases: for each the file of its input (PLY, float64), the file that its output is to be
written to (PLY, OBJ, OFF or STL for meshes; PLY, XYZ, CSV or NPY for clouds), a seed, and numbers such as `ratio`.
Files are in the frame of the shape: its bounding box centred at the origin, its farthest vertex at radius 1; outputs
are to be in the same coordinates. The overrides are those of `detailbench run`; the method makes no difference.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..text import counted

PASSES_ON = True
MANIFEST = "manifest.json"
FORMAT = "detailbench inputs 1"
FRAME = "unit: the bounding box of the shape is centred at the origin, its farthest vertex is at radius 1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("folder", metavar="FOLDER", help="where the files are written; made where it is not there")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Compose the cells, write the inputs of each dataset, sensor and seed once, and the manifest."""
    from ..engine.exporting import export, group_of
    from ..plan.cell import not_planned
    from ..results.files import write_atomically

    plugins = load_plugins(args.plugin)
    folder = Path(args.folder).expanduser().absolute()
    known = _manifest_there(folder)
    refused: list[str] = []
    cells = cells_of(list(args.rest), refused)
    for line in not_planned(refused):
        print(f"not planned: {line}", file=sys.stderr)
    if not cells:
        raise UsageError("nothing to write: no combination of these overrides is a cell")
    for cell, settings in cells:
        cases = export(cell, folder, settings.limit, plugins)
        values = cell.to_json()
        values = {key: value for key, value in values.items() if key not in ("method", "training")}
        group = group_of(cell)
        known["groups"][group] = {"title": cell.title.replace(f" {cell.method.label} ", " "), "cell": values}
        known["cases"] = [case for case in known["cases"] if case["group"] != group] + cases
        print(f"{folder / group}: {counted(len(cases), 'case')}")
        write_atomically(folder / MANIFEST, json.dumps(known, indent=1).encode())
    print(
        f"{folder / MANIFEST}: write the outputs beside the inputs, then detailbench import {args.folder} --method NAME"
    )
    return 0


def cells_of(words: list[str], refused: list[str]) -> list[Any]:
    """The cells of an override list, each with its settings: of cells that differ only in the method, the first.

    Their device is the processor, which makes and scores their files; another one is the method's.
    """
    from dataclasses import replace

    from ..plan.cell import Cell
    from ..sweep.flags import only_overrides
    from ..sweep.overrides import check_jobs, checked
    from .plan import cells_of as planned

    overrides = only_overrides(words, "not an option of this command")
    if not any(word.startswith(("method=", "experiment=")) for word in overrides):
        overrides.append("method=identity")  # which solves whatever has a file for its input
    jobs = [job for request in checked(overrides, "inputs", multirun=True).parts() for job in request.jobs]
    check_jobs(jobs)
    found: dict[str, tuple[Cell, Any]] = {}
    for cell, settings, _ in planned(jobs, refused):
        values = cell.to_json()
        key = {name: values[name] for name in ("task", "dataset", "sensor", "seed", "split")}
        found.setdefault(json.dumps(key, sort_keys=True), (replace(cell, device="cpu"), settings))
    return list(found.values())


def _manifest_there(folder: Path) -> dict[str, Any]:
    """The manifest of a folder, to which groups are added; empty if there is none."""
    from .. import __version__

    if (folder / MANIFEST).exists():
        return read_manifest(folder) | {"detailbench": __version__}
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: is there and has no {MANIFEST}; expected a new folder, or one of this command")
    return {"format": FORMAT, "detailbench": __version__, "frame": FRAME, "groups": {}, "cases": []}


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder.

    Raises
    ------
    UsageError
        If there is none, or if it is damaged.
    """
    path = folder / MANIFEST
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        whole = found["format"] == FORMAT and all(
            case["group"] in found["groups"] and {"case", "input", "output"} <= case.keys() for case in found["cases"]
        )
        # Reads and writes stay below the folder, even if the manifest is not ours.
        inside = all(_is_inside(case[key]) for case in found["cases"] for key in ("input", "output"))
        cells = [group["cell"] for group in found["groups"].values()]
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file; expected a folder of `detailbench inputs FOLDER ...`") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path}: is not a manifest of `detailbench inputs` ({error}); write it again") from error
    if not whole or not inside or not all(isinstance(cell, dict) for cell in cells):
        raise UsageError(f"{path}: is not a manifest of `detailbench inputs` ({FORMAT}); write it again")
    return found


def _is_inside(name: str) -> bool:
    path = Path(name)
    return not path.is_absolute() and ".." not in path.parts
