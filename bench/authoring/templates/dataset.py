"""MyPlugin: say in a line what the shapes are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

from bench import Shape, generator, register

if TYPE_CHECKING:  # heavy libraries are imported where they are used
    from trimesh import Trimesh


@register("dataset")
@dataclass(frozen=True)
class MyPlugin:
    """Balls with one bump each (replace this by your shapes)."""

    height: float = 0.3  # of the bump, relative to the ball's radius

    def shapes(self, split: str) -> Iterator[Shape]:
        """Endlessly many: the engine takes as many as `cases` says."""
        # A shape depends on its split and index alone, and no shape is in both splits.
        for index in count():
            yield Shape(
                id=f"my_plugin-{split}-{index:03d}",
                mesh=partial(self._mesh, split, index),  # made when it is needed
                tags=("ball",),  # what kind of thing it is
            )

    def _mesh(self, split: str, index: int) -> Trimesh:
        import numpy as np
        from trimesh.creation import icosphere

        rng = generator("my_plugin", split, index)
        mesh = icosphere(subdivisions=5)
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        mesh.vertices *= 1 + self.height * np.exp(-8 * (1 - mesh.vertices @ towards))[:, None]
        return mesh
