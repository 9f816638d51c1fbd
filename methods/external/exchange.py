"""Files exchanged with external programs; their outputs may be incomplete, or in other coordinates than the input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import BadInput, InvalidOutput, PointCloud
from bench.geometry.extents import unlike

if TYPE_CHECKING:
    from trimesh import Trimesh

TASKS = ("denoise", "upsample", "reconstruct")  # those whose only input to write to a file is a cloud


class OnlyAs:
    """A function of a method that an object has only if ``expect(task)`` does not raise AttributeError.

    The class always has it: whether a method solves a task depends on its parameters.
    """

    def __init__(self, function: Callable[..., Any]):
        self._function, self.__doc__ = function, function.__doc__

    def __get__(self, method: Any, owner: type) -> Callable[..., Any]:
        if method is None:
            return self._function
        method.expect(self._function.__name__)
        return self._function.__get__(method, owner)


def read_output(path: Path, task: str, cloud: PointCloud, name: str) -> PointCloud | Trimesh:
    """Read the output that an external program wrote for a task.

    Parameters
    ----------
    path : the file
    task : one of :data:`TASKS`: a mesh is expected for ``reconstruct``, points for the others
    cloud : the input; the output must be in its coordinates
    name : of the file, for messages

    Raises
    ------
    InvalidOutput
        If there is no such file, or if it is empty, damaged, without faces although a mesh is expected, or in
        coordinates of another size or place.
    """
    from bench.geometry.io.files import load_cloud, load_mesh
    from bench.geometry.used import used_vertices

    if not path.is_file():
        raise InvalidOutput(f"there is no output {name}")
    try:
        output = load_mesh(path) if task == "reconstruct" else load_cloud(path)
    except BadInput as error:
        raise InvalidOutput(str(error).replace(str(path), name)) from error
    points = output.points if isinstance(output, PointCloud) else used_vertices(output)
    check_place(np.asarray(points), cloud, name)
    return output


def check_place(points: np.ndarray, cloud: PointCloud, name: str) -> None:
    """Refuse points (n, 3) that cannot belong to an input: ten times as large or as small, or beside it.

    Raises
    ------
    InvalidOutput
        The message states how the two differ.
    """
    if said := unlike(points, name, cloud.points, "the input"):
        raise InvalidOutput(f"in another frame than the input: {said}")
