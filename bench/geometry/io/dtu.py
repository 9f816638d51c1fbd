"""The observation masks and ground planes of the DTU data set (Aanaes et al. 2016), MATLAB files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import BadInput

MASK, LOW_HIGH, STEP, PLANE = "obs_mask", "obs_box", "obs_step", "ground_plane"  # names of the arrays


def load_mask(path: str | Path) -> dict[str, np.ndarray]:
    """An observation mask, ``ObsMask24_10.mat``: which cells of a grid were seen from enough sides.

    Returns
    -------
    dict
        ``obs_mask`` (x, y, z) bool; ``obs_box`` (2, 3), the centres of its first and last cell; ``obs_step``, the size
        of a cell, both in the units of the data (mm).

    Raises
    ------
    BadInput
        Naming the file and what was expected of it.
    """
    content = _load(path, ("ObsMask", "BB", "Res"), "an observation mask with ObsMask, BB and Res (ObsMask24_10.mat)")
    mask, box, step = content["ObsMask"], content["BB"], content["Res"]
    if mask.ndim != 3 or box.shape != (2, 3) or step.size != 1 or not step.item() > 0:
        raise BadInput(
            f"{path}: ObsMask has the shape {mask.shape}, BB {box.shape}, Res {step.shape}; expected three dimensions, "
            "(2, 3), and one number above 0"
        )
    return {MASK: mask.astype(bool), LOW_HIGH: box.astype(np.float64), STEP: step.astype(np.float64).reshape(1)}


def load_plane(path: str | Path) -> dict[str, np.ndarray]:
    """A ground plane, ``Plane24.mat``: four numbers P with ``P . (x, y, z, 1) > 0`` above the table.

    Returns
    -------
    dict
        ``ground_plane`` (4,), in the units of the data (mm).

    Raises
    ------
    BadInput
        Naming the file and what was expected of it.
    """
    plane = _load(path, ("P",), "a ground plane P (Plane24.mat)")["P"]
    if plane.size != 4:
        raise BadInput(f"{path}: P has the shape {plane.shape}; expected four numbers")
    return {PLANE: plane.astype(np.float64).reshape(4)}


def _load(path: str | Path, names: tuple[str, ...], expected: str) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path)
    except (OSError, ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise BadInput(f"{path}: cannot be read as a MATLAB file ({error}); expected {expected}") from error
    if missing := [name for name in names if name not in content]:
        raise BadInput(f"{path}: has no {', '.join(missing)}; expected {expected}")
    return {name: content[name] for name in names}
