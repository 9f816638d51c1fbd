"""Normals from winding number normal consistency (Lin, Shi and Liu 2024)."""

from __future__ import annotations

import numpy as np

from bench import Run

from .field import WindingField

INSIDE = 0.5  # the winding number of a point on the surface


def consistent_normals(field: WindingField, widths: np.ndarray, run: Run, share: float = 1.0) -> tuple[np.ndarray, int]:
    """Outward normals, up to a common sign.

    The moments m of the points start at 0. Each round takes one step of steepest descent, of the best length, on
    |A m - 1/2|^2, where A m are the winding numbers at the points (the system of parametric Gauss reconstruction); then
    each moment is turned against the gradient of its field, with its length unchanged.

    Parameters
    ----------
    field : WindingField of n points
    widths : (rounds,) array
        Of each round: pairs of points nearer to each other are ignored.
    run : Run
        Gives the time before each round, and receives the progress.
    share : float
        Of the time that is left at the beginning: no round except the first starts after it.

    Returns
    -------
    normals : (n, 3) array of unit length, or 0 where the field has no slope
    done : int
        The number of rounds.
    """
    moments = np.zeros((len(field), 3))
    normals, done, reserve = moments, 0, (1 - share) * run.seconds_left() if share < 1 else 0.0
    for width in widths:
        if done and (run.seconds_left() < reserve or not run.time_for_more()):
            break
        moments = moments + descent(field, moments, width)
        lengths = np.linalg.norm(moments, axis=1, keepdims=True)
        slopes = field.steepest(moments, width)
        steep = np.linalg.norm(slopes, axis=1, keepdims=True)
        normals = slopes / np.where(steep > 0, steep, 1)
        moments = lengths * normals
        done += 1
        run.progress(done, len(widths))
    return normals, done


def descent(field: WindingField, moments: np.ndarray, width: float) -> np.ndarray:
    """One step of steepest descent on |A m - 1/2|^2: the increment (n, 3) of the moments."""
    direction = field.adjoint(INSIDE - field.number(moments, width), width)
    change = field.number(direction, width)
    squared = float(change @ change)
    return direction * (float(np.sum(direction**2)) / squared if squared > 0 else 0.0)
