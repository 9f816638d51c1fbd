"""Outputs that were made elsewhere, as a method: they are read from files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import BadInput, InvalidOutput, PointCloud, Run, register

from .exchange import TASKS, OnlyAs, read_output

if TYPE_CHECKING:
    from trimesh import Trimesh

MANIFEST = "manifest.json"
SUFFIXES = {
    "reconstruct": (".ply", ".obj", ".off", ".stl"),
    **dict.fromkeys(("denoise", "upsample"), (".ply", ".xyz", ".txt", ".csv", ".pcd", ".npy", ".off", ".obj")),
}


@register("method")
@dataclass(frozen=True)
class Imported:
    """Hands on what somebody else made of the inputs that ``detailbench inputs`` wrote: see ``detailbench import``.

    It reports neither time nor memory. A result depends on the files of the outputs: if one is added, removed or
    changed, the cases are scored again.
    """

    called = "name"

    name: str = ""  # of the method that made the outputs
    folder: str = ""  # the folder with the manifest
    group: str = ""  # which inputs of the manifest: those of one dataset, sensor and seed

    def expect(self, task: str) -> None:
        """Raise :class:`AttributeError` for a task whose inputs are not written to files."""
        if task not in TASKS:
            raise AttributeError(f"imported: outputs of the task {task} cannot be imported")

    def reads(self) -> Iterator[Path]:
        """The existing outputs."""
        if not self.folder:
            return
        for entry in self._entries.values():
            yield from self._found(Path(self.folder, str(entry.get("output", ""))))

    # -- the tasks -------------------------------------------------------------------------------------------------

    @OnlyAs
    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The points of the file."""
        return self._output("denoise", cloud, run)

    @OnlyAs
    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """The points of the file."""
        return self._output("upsample", cloud, run)

    @OnlyAs
    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The mesh of the file."""
        return self._output("reconstruct", cloud, run)

    # -- files -----------------------------------------------------------------------------------------------------

    @cached_property
    def _entries(self) -> Mapping[str, Mapping[str, Any]]:
        """The cases of the group, by id."""
        path = Path(self.folder, MANIFEST)
        try:
            cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
            return {str(case["case"]): case for case in cases if case["group"] == self.group}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInput(f"{path}: is not a manifest of detailbench inputs ({error!r})") from error

    @staticmethod
    def _found(path: Path) -> list[Path]:
        """The files of one output; the suffix may differ from that in the manifest."""
        suffixes = {suffix for of in SUFFIXES.values() for suffix in of}
        return [found for suffix in sorted(suffixes) if (found := path.with_name(path.stem + suffix)).is_file()]

    def _output(self, task: str, cloud: PointCloud, run: Run) -> Any:
        if not self.folder or run.case not in self._entries:
            raise BadInput("imported: has no output for this case; use detailbench import FOLDER --method NAME")
        entry = self._entries[run.case]
        run.external = f"results of {self.name}, imported on {datetime.now(UTC):%Y-%m-%d}"
        run.note(f"external: {run.external}")
        self._check_input(cloud, Path(self.folder, str(entry["input"])))
        name = str(entry["output"])
        found = [path for path in self._found(Path(self.folder, name)) if path.suffix in SUFFIXES[task]]
        if len(found) > 1:
            raise InvalidOutput(f"there are {len(found)} outputs {', '.join(p.name for p in found)}; expected one")
        if not found:
            raise InvalidOutput(f"there is no output {name} (or {' '.join(SUFFIXES[task][1:])})")
        return read_output(found[0], task, cloud, found[0].relative_to(self.folder).as_posix())

    @staticmethod
    def _check_input(cloud: PointCloud, path: Path) -> None:
        """Check that the output was made from this input: the dataset or the sensor may have been edited since."""
        from bench.geometry.io.files import load_cloud

        if path.is_file() and not np.array_equal(load_cloud(path).points, cloud.points):
            raise BadInput(
                f"the input {path.name} no longer matches this case: the dataset, the sensor or the file was edited. "
                "Write the inputs again, and make the outputs again from them"
            )
