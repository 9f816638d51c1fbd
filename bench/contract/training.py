"""The training data of a learned method: :class:`TrainingData`.

A learned method has, besides the functions named after tasks, the two functions of :class:`Learned`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from .case import Case
from .shape import Shape
from .task import CaseRecipe

if TYPE_CHECKING:
    from .run import Run


class Learned(Protocol):
    """The additional contract of learned methods.

    Attributes
    ----------
    trained_by : tuple of str
        The parameters that the weights depend on. All others may be changed without retraining.
    examples_by : tuple of str, optional
        Those of them that the examples depend on; all of ``trained_by`` if omitted. Variants of a method
        that share them share their examples.
    """

    trained_by: ClassVar[tuple[str, ...]]

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """What the method is trained on, as arrays. Called on the CPU; cached by hash."""
        ...

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights. It imports numpy and torch alone, resumes from ``run.resumed`` if that is given, and ends
        before ``run.seconds_left()`` runs out, with its best state."""
        ...


@dataclass(frozen=True, eq=False)
class TrainingData:
    """The cases that a learned method is trained on: those of its task, of shapes of the train split alone.

    Attributes
    ----------
    count : int
        How many cases there are; fewer where the dataset has fewer shapes.
    seed : int
        Of the training; the sensor's noise depends on it.
    """

    recipes: Callable[[], Iterator[CaseRecipe]]
    sensor: Callable[[str | Mapping[str, Any]], Any]  # builds another sensor by its name, or by a preset's
    count: int = 0
    seed: int = 0
    on_case: Callable[[Case], None] = lambda case: None

    @property
    def cases(self) -> Iterator[Case]:
        """The cases, each made on demand; every loop over them gives equal ones."""
        for recipe in self.recipes():
            case = recipe.build()
            self.on_case(case)
            yield case

    def sense(self, case: Case, sensor: str | Mapping[str, Any], rng: np.random.Generator) -> Any:
        """The output of another sensor for the shape of a case.

        Parameters
        ----------
        case : one of :attr:`cases`
        sensor : str or mapping
            The name of a sensor or of a preset, or ``{name: {parameter: value}}``.
        rng : numpy generator
        """
        return self.sensor(sensor).sense(case.reference, rng)


def content_digest(shape: Shape) -> str:
    """A digest over the mesh of a shape in its frame, which identifies a shape under any name."""
    total = hashlib.blake2b(digest_size=8)
    for array in (np.asarray(shape.mesh.vertices, dtype=np.float64), np.asarray(shape.mesh.faces, dtype=np.int64)):
        total.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return total.hexdigest()
