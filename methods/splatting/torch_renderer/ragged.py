"""Lists of different lengths as flat tensors: split into parts that fit the memory, expanded, and summed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

STEPS = 2.0**40  # of the largest summand; fewer than 2^22 summands stay within 63 bits


def parts(counts: Tensor, limit: int) -> Iterator[slice]:
    """Ranges of lists with at most ``limit`` entries together; a longer list is a part of its own.

    Parameters
    ----------
    counts : (n,) int tensor
        Lengths of the lists.
    limit : int
    """
    ends = counts.cumsum(0).cpu().numpy()
    begin, done = 0, 0
    while begin < len(ends):
        end = max(int(np.searchsorted(ends, done + limit, side="right")), begin + 1)
        yield slice(begin, end)
        begin, done = end, int(ends[end - 1])


def spread(counts: Tensor) -> tuple[Tensor, Tensor]:
    """For each entry of all lists the number of its list, and its place there: (sum of counts,) int64 tensors."""
    total = int(counts.sum())
    numbers = torch.arange(len(counts), device=counts.device)
    which = torch.repeat_interleave(numbers, counts, output_size=total)
    first = (counts.cumsum(0) - counts).index_select(0, which)
    return which, torch.arange(total, device=counts.device) - first


def pick(numbers: Tensor, *tables: Tensor) -> tuple[Tensor, ...]:
    """Rows of tables: (m, ...) tensors. Many times faster than ``table[numbers]`` on the CPU."""
    return tuple(table.index_select(0, numbers) for table in tables)


def add_rows(into: Tensor, index: Tensor, values: Tensor, fixed: bool | None = None) -> None:
    """Add rows to those of ``into`` at ``index``; the result is deterministic.

    On CUDA, threads add in any order, and the last digits of a sum of floats depend on it. Sums of integers do not: the
    values of a column are summed as multiples of a small part of the largest.

    Parameters
    ----------
    into : (n, c) float64 tensor
    index : (m,) int64 tensor
    values : (m, c) float tensor
    fixed : bool, optional
        Whether to sum integers; by default on CUDA.
    """
    if not len(index):
        return
    if fixed is None:
        fixed = into.is_cuda
    if not fixed:
        into.index_add_(0, index, values.to(into))
        return
    step = values.abs().amax(0).to(into).clamp_min(1e-280) / STEPS
    for begin in range(0, len(index), 1 << 22):
        some = slice(begin, begin + (1 << 22))
        whole = torch.zeros(into.shape, dtype=torch.int64, device=into.device)
        whole.index_add_(0, index[some], (values[some].to(into) / step).round().long())
        into += whole * step
