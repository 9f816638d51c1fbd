"""Shapes with detail on several scales, from several families."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench import Shape, register

from .bumps import Bumps
from .fbm import Fbm
from .fractals import Fractals
from .reliefs import Reliefs

FAMILIES = (Bumps, Fbm, Reliefs, Fractals)
TAG = "multiscale"


@register("dataset", requires=("igl", "scipy", "trimesh"))
@dataclass(frozen=True)
class Multiscale:
    """Shapes with detail on several scales: those tagged so of `bumps`, `fbm`, `reliefs` and `fractals`, in turn.

    What a method does with fine detail on a coarse shape, in one dataset: smooth and rough, carved and stacked. The
    shapes are those of their families, under their ids.
    """

    def shapes(self, split: str) -> Iterator[Shape]:
        """The shapes of a split, without end; ``train`` and ``test`` come from seeds that never meet."""
        families = [_tagged(family().shapes(split)) for family in FAMILIES]
        while True:
            for shapes in families:
                yield next(shapes)


def _tagged(shapes: Iterator[Shape]) -> Iterator[Shape]:
    return (shape for shape in shapes if TAG in shape.tags)
