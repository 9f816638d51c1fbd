"""The base of all methods that train one field for one case, and extract its surface by marching cubes."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import Frame, Run, snake_case

if TYPE_CHECKING:
    import torch
    from trimesh import Trimesh

    from ..training.field import Field
    from ..training.loop import Sampling

ENDLESS = 10**9  # steps: the clock ends the training


@dataclass(frozen=True)
class Trained:
    """Trains a field in a frame of radius 1, and extracts its zero level.

    A method defines :meth:`field`, and sets its training by the defaults of its parameters.
    """

    free_on_load: ClassVar[tuple[str, ...]] = ()  # own parameters that may differ from those of a loaded field
    begin_on_load: ClassVar[float] = 0.0  # progress of the schedule at which the training of a loaded field starts
    sine_sphere: ClassVar[bool] = False  # whether a sine network (omega, hidden_layers, width) starts as a sphere

    steps: int = 500  # of training, at most
    seconds: float = 0.0  # train for this time by the clock, with as many steps as it allows; 0 to count steps
    learning_rate: float = 1e-4  # of Adam
    betas: tuple[float, float] = (0.9, 0.999)  # of Adam: decay rates of its two moving averages
    resolution: int = 256  # samples of the marching cubes along the shortest axis, 16 to 1024
    traces: int = 0  # number of intermediate results, for error against time
    save: str = ""  # write the fitted field to this .safetensors file; of several cases, each over the one before
    load: str = ""  # start from the field in this file; with steps=0 it is extracted unchanged

    def __post_init__(self) -> None:
        if self.steps < (0 if self.load else 1):
            raise ValueError(f"steps: expected at least 1 (or 0 with load), got {self.steps}")
        at_least(self, seconds=0, traces=0)
        positive(self, "learning_rate")
        check_betas(self.betas)
        if not 16 <= self.resolution <= 1024:
            raise ValueError(f"resolution: expected 16 to 1024, got {self.resolution}")

    def prepare(self) -> None:
        """Make and cache the initial sphere of a sine network, once, off the clock."""
        if self.sine_sphere and self.first_sphere:
            from ..networks.sphere import keep

            method: Any = self  # it has the parameters of a sine network
            keep(method.omega, method.hidden_layers, method.width, self.first_sphere)

    # -- what a method adds ----------------------------------------------------------------------------------------

    def field(self, generator: torch.Generator) -> Field:
        """The field before the training, on the CPU, with weights drawn from ``generator``."""
        raise NotImplementedError

    def training(self) -> dict[str, Any]:
        """Settings of :class:`~..training.settings.Training` that are not among the parameters above."""
        return {}

    # -- what they share -------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The plugin's."""
        return snake_case(type(self).__name__)

    @property
    def first_sphere(self) -> float:
        """The radius of the initial sphere of a network: 0 if weights are loaded, so that it need not be made."""
        method: Any = self
        return 0.0 if self.load else method.sphere  # a parameter of the methods that use this

    def form(self) -> dict[str, Any]:
        """The parameters of this method that must match those of a loaded field: they determine its function."""
        others = {"batch", *(field.name for field in fields(Trained)), *self.free_on_load}
        return {name: getattr(self, name) for name in inspect.get_annotations(type(self)) if name not in others}

    @property
    def trains(self) -> bool:
        """Whether any training steps are planned."""
        return self.steps > 0 or self.seconds > 0

    def first_weights(self, run: Run) -> torch.Generator:
        """The generator of the initial weights, on the CPU."""
        import torch

        return torch.Generator().manual_seed(int(run.rng.integers(2**62)))

    def check_files(self) -> None:
        """Check the files to load and to save before the work starts."""
        from ..training import files

        if self.load:
            files.check_saved(self.load, self.name, self.form())
        if self.save:
            files.check_writable(self.save)

    def train(self, field: Field, sampler: Callable[[], Sampling], points: np.ndarray, frame: Frame, run: Run) -> None:
        """Load, train and save a field, as set by the parameters.

        Parameters
        ----------
        field : Field
            On the run's device; is changed.
        sampler : function without arguments
            Makes the sampler of the steps.
        points : (n, 3) array
            In the frame, near the surface: used to estimate the time of its extraction.
        frame : Frame
            From the input's coordinates.
        run : Run
        """
        import torch

        from ..training import files
        from ..training.loop import fit
        from ..training.settings import Training
        from ..training.stages import note_shortage, reserve

        run.parameters = field.count()
        run.active_parameters = field.count_active(torch.as_tensor(points, dtype=torch.float32))
        if self.load:
            files.load(field, self.load)
            if not self.trains:
                files.note_other_points(self.load, points, run)
        if self.trains:
            drawn = sampler()
            left = run.seconds_left() - reserve(field, points, self.resolution, run)
            training = Training(
                steps=ENDLESS if self.seconds else self.steps,
                seconds=min(self.seconds or math.inf, max(left, 0.1)),
                learning_rate=self.learning_rate,
                traces=self.traces + 1 if self.traces else 0,  # the last one would be the result
                begin=self.begin_on_load if self.load else 0.0,
                **({"betas": self.betas} | self.training()),
            )
            coarse = max(16, self.resolution // 2)
            done = fit(field, drawn, run, training, lambda: run.trace(lambda: self.extract(field, frame, coarse)))
            note_shortage(run, done.steps, self.steps, training.seconds, self.seconds)
            if self.load and not done.improved:
                run.note(f"{done.steps:,} further steps did not improve the field of {self.load}; it is unchanged")
        if self.save:
            files.save(field, self.save, self.name, self.form(), points)

    def extract_in_time(self, field: Field, frame: Frame, run: Run) -> Trimesh:
        """The zero level, in the coordinates of the input; coarser if the run's time is too short."""
        from ..training.stages import in_time

        return in_time(lambda seconds: self.extract(field, frame, self.resolution, seconds), run)

    def extract(self, field: Field, frame: Frame, resolution: int, seconds: float = math.inf) -> Trimesh:
        """The zero level of a field, in the coordinates of the input; coarser if it would exceed ``seconds``."""
        from ..meshing.marching import REACH, extract

        mesh = extract(field.values, resolution=resolution, domain=(-REACH, REACH), seconds=seconds)
        mesh.vertices = frame.invert(mesh.vertices)
        return mesh


def at_least(method: Any, **bounds: float) -> None:
    """Raise ValueError unless each of these parameters of a method is at least its bound."""
    for name, least in bounds.items():
        if not getattr(method, name) >= least:
            raise ValueError(f"{name}: expected at least {least}, got {getattr(method, name)}")


def positive(method: Any, *names: str) -> None:
    """Raise ValueError unless parameters of a method are more than 0."""
    for name in names:
        if not getattr(method, name) > 0:
            raise ValueError(f"{name}: expected more than 0, got {getattr(method, name)}")


def check_betas(betas: tuple[float, ...]) -> None:
    """Raise ValueError unless they are valid for Adam."""
    if len(betas) != 2 or not all(0 <= beta < 1 for beta in betas):
        raise ValueError(f"betas: expected two numbers from 0 to below 1, got {betas}")
