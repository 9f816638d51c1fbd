"""Prior knowledge from other shapes: errors of methods on clouds with measures like those of this scan."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from .scan import State

TABLE = Path(__file__).with_name("priors.json")  # written by scripts/recommend_priors.py
# The typical difference of each measure between two rather unlike sensors. Normals depend on the
# shape more than on the sensor.
SCALES = State(noise=0.15, outliers=0.02, density_variation=0.2, normals=np.inf, contradicting=np.inf)


@dataclass(frozen=True)
class Prior:
    """One sensor of the benchmark.

    Attributes
    ----------
    sensor : str
    shapes : int
        The number of shapes that it scanned.
    metric : str
        The distance to the true surface that ``errors`` are means of.
    state : State
        The mean of the measures of the sensor's clouds.
    errors : mapping from methods, with their usual parameters, to thousandths of the radius, least first
    """

    sensor: str
    shapes: int
    metric: str
    state: State
    errors: dict[str, float]


@cache
def priors() -> tuple[Prior, ...]:
    """The table that comes with the package."""
    lines = json.loads(TABLE.read_text(encoding="utf-8"))
    return tuple(Prior(**line | {"state": State(**line["state"])}) for line in lines)


def nearest(state: State) -> Prior:
    """The sensor whose clouds are most like a scan of this state."""
    return min(priors(), key=lambda prior: distance(state, prior.state))


def distance(one: State, other: State) -> float:
    """The distance of two states: the root mean square difference of their measures, in units of :data:`SCALES`."""
    return float(np.sqrt(np.mean(((np.array(one) - np.array(other)) / np.array(SCALES)) ** 2)))
