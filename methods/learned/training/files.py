"""Fitted fields as safetensors files."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from bench import BadInput, Run

from .field import Field

SAME_BOX = 1e-4  # of the radius: boxes of points that differ by less count as the same


def save(field: Field, path: str | Path, method: str, form: dict[str, Any], points: np.ndarray) -> None:
    """Write the weights to a safetensors file, with the method's name, its parameters ``form``, and the box of the
    points (n, 3) that it was fitted to."""
    from safetensors.torch import save_file

    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in field.state_dict().items()}
    facts = {"format": "pt", "method": method, "form": json.dumps(form), "box": json.dumps(_box(points))}
    save_file(tensors, str(Path(path).expanduser()), facts)


def check_writable(path: str | Path) -> None:
    """Raise :class:`BadInput` if :func:`save` would fail: better before a training than after it."""
    path = Path(path).expanduser()
    if not path.parent.is_dir():
        raise BadInput(f"method.save={path}: there is no folder {path.parent}; create it first")
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise BadInput(f"method.save={path}: cannot be written; expected a file in a folder with write permission")


def saved_as(path: str | Path) -> tuple[str, dict[str, Any]]:
    """The method that saved a field, and its parameters.

    Raises
    ------
    BadInput
        Naming the file, if it cannot be read or was not written by :func:`save`.
    """
    facts = _facts(path)
    try:
        return facts["method"], json.loads(facts["form"])
    except (KeyError, ValueError) as error:
        raise BadInput(f"{path}: expected a field that a method saved (method.save=FILE), but found none") from error


def _facts(path: str | Path) -> dict[str, str]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(Path(path).expanduser()), "pt") as file:
            return file.metadata() or {}
    except (OSError, SafetensorError) as error:
        raise BadInput(f"{path}: expected a safetensors file that this method saved ({error})") from error


def check_saved(path: str | Path, method: str, form: dict[str, Any]) -> None:
    """Refuse a file saved by another method, or with other parameters: with another ``omega``, for example, the same
    weights are another function.

    Raises
    ------
    BadInput
        Naming the file and the parameters to use instead.
    """
    theirs, saved = saved_as(path)
    if theirs != method:
        raise BadInput(f"{path}: was saved by {theirs}, not by {method}; use method={theirs}")
    for name, here in json.loads(json.dumps(form)).items():
        there = saved.get(name, here)
        if there != here:
            raise BadInput(
                f"{path}: was saved with {name}={there}, but {name} is now {here}; use method.{name}={there}"
            )


def load(field: Field, path: str | Path) -> None:
    """Read weights that :func:`save` wrote into a field of the same form.

    Raises
    ------
    BadInput
        Naming the file, if it belongs to another network.
    """
    from safetensors.torch import load_file

    tensors = load_file(str(Path(path).expanduser()))
    mine = field.state_dict()
    differing = sorted(name for name in {*mine, *tensors} if _shape(mine, name) != _shape(tensors, name))
    if differing:
        name = differing[0]
        raise BadInput(
            f"{path}: belongs to another network: {name} is {_shape(tensors, name) or 'missing'} in the file and "
            f"{_shape(mine, name) or 'missing'} in the method; use the parameters that it was saved with"
        )
    field.load_state_dict(tensors)


def note_other_points(path: str | Path, points: np.ndarray, run: Run) -> None:
    """Note if a field is used with other points (n, 3) than those that it was fitted to.

    A field is defined in the frame of its points, in which the farthest is at radius 1. A cropped cloud has another
    frame, and a surface that is extracted in it is moved and scaled.
    """
    there, here = _facts(path).get("box"), _box(points)
    if there and (off := float(np.abs(np.subtract(json.loads(there), here)).max())) > SAME_BOX:
        run.note(
            f"{path} was fitted to other points: their boxes differ by {off:.2g} of the radius, and the surface "
            "is moved and scaled as much; use the points that it was fitted to, or train it further (method.steps)"
        )


def _box(points: np.ndarray) -> list[list[float]]:
    return [points.min(axis=0).tolist(), points.max(axis=0).tolist()]


def _shape(tensors: dict[str, Tensor], name: str) -> tuple[int, ...] | None:
    return tuple(tensors[name].shape) if name in tensors else None
