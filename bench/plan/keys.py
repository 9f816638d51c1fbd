"""The keys of a run and their types."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .limits import Limits
from .training import TrainingKeys


@dataclass
class Base:
    """Every key of a run."""

    task: Any = None  # the groups come from the plugins
    dataset: Any = None
    sensor: Any = None
    method: Any = None
    metric: Any = None
    training: TrainingKeys = field(default_factory=TrainingKeys)  # source of the weights of learned methods
    seed: int = 0  # of the sensor's noise, the method and the metrics' samples
    split: str = "test"  # which shapes of the dataset: test or train
    cases: int = 4  # how many of them
    threads: int = 1  # processors per method call, pinned by affinity
    device: str = "cpu"  # cpu or cuda
    results: str = "results"  # folder of the results
    outputs: str = "none"  # which outputs to store as files: none, first (case of a cell) or all
    rerun: str = "never"  # run again although a result is current: never, failed or always
    profile: str = "quick"  # quick, study or paper
    convention: Any = None  # a paper's metrics and columns; no part of a cell's identity
    published: Any = (
        None  # of an experiment: the numbers of the paper's table that it reproduces (bench/ranking/published.py)
    )
    sizes: Any = None  # of an experiment: its values under each profile
    verbose: bool = False  # show what methods print
    limit: Limits = field(default_factory=Limits)
    plugins: list[str] = field(default_factory=list)  # set by --plugin
    config_dirs: list[str] = field(default_factory=list)  # set by --config-dir
    session: str = "none"  # set by the front door


GROUPS = ("task", "dataset", "sensor", "method", "metric", "training", "convention", "profile", "experiment")
