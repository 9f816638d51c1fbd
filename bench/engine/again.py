"""Some cases of a stored cell, run again with their outputs, into another folder: the stored record is not touched."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..plan.training import TRAINED
from ..results.recorded import writing_nothing
from .runner import run_cell

if TYPE_CHECKING:
    from ..plan.cell import Cell
    from ..results.recorded import Stored
    from ..results.store import Record, Results


def run_again(stored: Stored, folder: Path, cases: Collection[str], plugins: Sequence[str] = ()) -> Record:
    """Run these cases with the seed, the parameters and the limits of the record, and keep their outputs.

    Files that the cell would write elsewhere (``method.save=FILE``) are not written. Weights that were trained for
    the cell are used where its folder has them; otherwise they are trained again.

    Parameters
    ----------
    stored : Stored
    folder : Path
        Where the new record and the outputs go: a temporary folder.
    cases : collection of str
        Ids. The rows of all others are those of the record.
    plugins : sequence of str
        The plugin files that are loaded.
    """
    cell, _ = writing_nothing(stored.cell)
    _copy_weights(stored.results, folder, cell)
    known = {row["case_index"]: row for row in stored.shown.rows if row["case"] not in cases}
    settings = replace(stored.settings, results=str(folder), outputs="all", plugins=tuple(plugins))
    return run_cell(cell, settings, known=known).record


def _copy_weights(results: Results, folder: Path, cell: Cell) -> None:
    """Copy the weights trained for a cell to another folder."""
    from .training import WEIGHTS, folder_of, known_weights

    if cell.training is None or cell.training.weights != TRAINED or known_weights(results, cell.training) is None:
        return
    there = folder_of(results, cell.training)
    here = folder / there.relative_to(results.folder)
    here.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(there / WEIGHTS, here / WEIGHTS)
