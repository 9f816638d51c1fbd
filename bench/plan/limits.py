"""The limits of a cell's child process."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Limits:
    """When a cell's child process is killed."""

    seconds: float = 60.0  # wall clock of one method call
    memory_gb: float = 4.0  # resident memory of the child and its children, and allocations of one call
    setup_seconds: float = 600.0  # wall clock for making one case, and for scoring one output
    output_points: int = 10_000_000  # points of one output, and faces
    train_memory_gb: float = 8.0  # memory of the process that trains a learned method; its time is training.seconds
    cache_gb: float = 2.0  # disk for the shapes, clouds and samples that cells share, in DIR/.cache; 0 for none
