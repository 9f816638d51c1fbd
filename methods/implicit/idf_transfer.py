"""Transferable implicit displacement fields: the details of one shape on the base of another."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from bench import Run, register
from bench.geometry.check import check_mesh

from ..learned.fitting.trained import ENDLESS, at_least, check_betas, positive
from ..learned.networks.shipped import spheres_read
from .fitting.weights import OrientedWeights

if TYPE_CHECKING:
    from pathlib import Path

    import torch
    from trimesh import Trimesh

    from ..learned.networks.sine_network import SineNetwork
    from ..learned.training.loop import Fit
    from ..learned.training.stages import Stages
    from .fields.descriptor import Cloud
    from .fields.transfer_field import TransferField
    from .fitting.oriented_samples import Samples

SHARES = (0.2, 0.2, 0.6)  # of the time: for the source's base, the target's base, and the displacement


@register("method", cite="Wang et al. 2022", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class IdfTransfer(OrientedWeights):
    """Transferable implicit displacement: conditioned on a descriptor of the base, not on coordinates (Eq. 4.5).

    1. A smooth sine network is fitted to the source's base, or to the source itself if no base is given: a low
       frequency keeps it from learning the details. 2. Likewise one to the target's base. 3. The displacement between
       the first and the source is learned as a function T(phi(x), f(x)) of the base's descriptor and distance.
       4. With the target's base instead of the source's, the same T gives the details there.

    The thesis does 2 after 3, which only affects traces, which are transfers here. Its second scenario
    has a target with its own details; the task's target is always a base.

    Choices where thesis and released code differ, or neither specifies them:

    * FiLM sin((w + w/2 gamma)(Wh + b) + beta) of the code, see :class:`film.FilmNetwork`; f-bar = tanh(f/nu) of the
      thesis (the code has tanh(0.8 f/nu), with the same nu in chi); the condition is phi and the base's normal, as in
      the code, and only phi with ``normals=False``.
    * In the released code the encoder's input is the *detailed* source during training, and the bare base in the
      transfer: the descriptor may learn to use details that are then missing. Here it is the base in both, namely
      samples moved onto the fitted base, with its normals, which are available without a given base, too;
      ``cloud=detailed`` is as released.
    * The code adds noise at every encoding, so its transfer is random. Here, only during training.
    * Four sine layers make the base, as the code does, and 28,417 parameters; the thesis names three
      (``hidden_layers=2``, 19,105).
    * Lengths are relative to the farthest point, about 1, where the code has boxes with a side of 0.9: its alpha of
      0.1 is about 0.2 here, and its nu of 0.05 (vase) or 0.2 (shorts) 0.1 or 0.4. By default both are measured: alpha
      from the largest distance of the source to its fitted base, because a smaller alpha cuts details off, and
      with a wide nu and small details f-bar is nearly constant.
    * The loss is Eq. 4.4 with the thesis's weights for fitting one shape; the released ones (for the
      shorts 500, 5, 0.1 and 100, for the vase 200, 10, 1 and 50) let f^ fade around the surface, which T can do since
      f is its input, and learn little else for long. Likewise a base's error adds to that of the transfer, so the
      surface has more weight than in the released fits; and Adam's betas there, 0.1 and 0.9, gave the bases a quarter
      more error after 1,000 steps.
    * All rates fall to a tenth in the last fifth; the released ones are constant. A released base uses twice as many
      points per step as its displacement, here both use ``batch``.

    The released training is 24,000 steps at a rate of 1e-4. The defaults are for two processor cores: a FiLM network
    of a third of the frequency, with a stronger initial mapping, learns details of some five periods around a body
    in a few hundred steps (measured on ``reliefs``, train), but not those of eighteen periods: the
    U-Net, whose input are normals, varies slowly at first. Figure 4.11: ``mapping=False``, ``context=normal``; figure
    4.12: ``scale_f=False``. The plane of features of the thesis's faces (128^2, from the front) is not implemented.
    """

    steps: int = 400  # of the displacement's training (released: 24,000)
    base_steps: int = 700  # of the training of each base (released: 12,000)
    seconds: float = 0.0  # train for this time by the clock, all networks together; 0 to count steps
    batch: int = 512  # surface points of a step; as many near the surface are added (released: 2,048)
    learning_rate: float = 5e-4  # of Adam, of the displacement (released: 1e-4)
    base_rate: float = 1e-3  # of Adam, of the bases (released: 1e-4)
    betas: tuple[float, float] = (0.9, 0.99)  # of Adam: decay rates of its two moving averages (released: 0.1, 0.9)
    base_loss: tuple[float, ...] = (1000.0, 50.0, 5.0, 40.0)  # Eq. 4.4's four for the bases (released: 100, 50, 2, 50)
    spread: float = 0.0  # of points near the surface, from it; 0 for nu (released: 0.1 in boxes of side 0.9)
    resolution: int = 128  # samples of the marching cubes along the shortest axis, 16 to 1024
    traces: int = 0  # number of intermediate results, for error against time
    omega: float = 5.0  # frequency of the bases
    hidden_layers: int = 3  # sine layers of a base after the first
    width: int = 96  # of all layers
    sphere: float = 0.5  # radius of the initial sphere of the bases; 0 for random weights
    alpha: float = 0.0  # largest displacement, relative to the radius; 0 for 1.5 times the source's from its base
    nu: float = 0.0  # distance to the base at which the displacement is halved; 0 for twice alpha
    mapping: bool = True  # condition by FiLM through a mapping network; without it, all are inputs side by side
    context: Literal["grid", "normal"] = "grid"  # descriptor: features of a U-Net, or only the base's normal
    scale_f: bool = True  # condition the displacement on tanh(f/nu) rather than f
    normals: bool = True  # condition on the base's normal as well as on the features
    omega_detail: float = 10.0  # frequency of the displacement's sine layers (released: 30)
    gain: float = 1.0  # of the mapping network's initial last weights (released: 0.25)
    cloud: Literal["base", "detailed"] = "base"  # the encoder's input from the source (released: detailed)
    points: int = 3000  # of the encoder's input
    cells: int = 32  # of the features' grid along each side, a multiple of 4
    noise: float = 0.005  # of the encoder's points and normals during training
    every: int = 2  # the encoder and the U-Net run, and learn, in one of this many steps (released: 1)

    def __post_init__(self) -> None:
        self.check_weights()
        at_least(self, steps=1, base_steps=1, batch=1, points=1, every=1, hidden_layers=1, width=1)
        positive(self, "learning_rate", "base_rate", "omega", "omega_detail", "gain")
        at_least(self, seconds=0, traces=0, alpha=0, nu=0, noise=0, sphere=0, spread=0)
        check_betas(self.betas)
        if len(self.base_loss) != 4 or not all(weight >= 0 for weight in self.base_loss):
            raise ValueError(f"base_loss: expected four weights of at least 0, got {self.base_loss}")
        if not 16 <= self.resolution <= 1024:
            raise ValueError(f"resolution: expected 16 to 1024, got {self.resolution}")
        if self.cells < 8 or self.cells % 4:
            raise ValueError(f"cells: expected a multiple of 4 from 8 on, got {self.cells}")

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.sphere)

    def prepare(self) -> None:
        """Make and cache the initial sphere of the bases, once, off the clock."""
        from ..learned.networks.sphere import keep

        if self.sphere:
            keep(self.omega, self.hidden_layers, self.width, self.sphere)

    def detail_transfer(self, source: Trimesh, source_base: Trimesh | None, target_base: Trimesh, run: Run) -> Trimesh:
        """The zero level of the target's base, displaced like the source from its base."""
        import torch

        from ..learned.meshing.marching import extract
        from ..learned.training.loop import fit
        from ..learned.training.settings import Training
        from ..learned.training.stages import Stages, in_time, note_shortage, reserve
        from .fields.transfer_field import NearSampler
        from .fitting.oriented_samples import cloud_of, frame_of, on_base, samples

        torch.set_num_threads(run.threads)
        for mesh, name in ((source, "source"), (source_base, "source_base"), (target_base, "target_base")):
            if mesh is not None:
                check_mesh(mesh, f"idf_transfer, {name}")
        frame = frame_of(source, source_base, target_base)
        weights = torch.Generator().manual_seed(int(run.rng.integers(2**62)))
        draws = run.torch_generator()
        detailed, theirs_known = (samples(mesh, frame, run.rng) for mesh in (source, target_base))
        ours_known = detailed if source_base is None else samples(source_base, frame, run.rng)
        stages = Stages(run, self.seconds, SHARES)

        ours, of_ours = self._base(ours_known, weights, draws, stages)
        theirs, of_theirs = self._base(theirs_known, weights, draws, stages)
        seen = cloud_of(detailed if self.cloud == "detailed" else ours_known, run.device)
        seen = on_base(ours, seen) if self.cloud == "base" else seen
        target = on_base(theirs, cloud_of(theirs_known, run.device))
        field = self._field(ours, seen, detailed, weights, draws)
        run.parameters = field.count()

        def transferred(resolution: int, seconds: float = math.inf) -> Trimesh:
            mesh = extract(field.onto(theirs, target).values, resolution=resolution, seconds=seconds)
            mesh.vertices = frame.invert(mesh.vertices)
            return mesh

        sampler = NearSampler(*detailed, self.batch, draws, spread=self.spread or field.nu)
        training = Training(
            steps=ENDLESS if self.seconds else self.steps,
            seconds=stages.next(reserve(field, theirs_known[0], self.resolution, run)),
            learning_rate=self.learning_rate,
            betas=self.betas,
            chunk=2 * self.batch,  # the descriptor runs once per step
            traces=self.traces + 1 if self.traces else 0,  # the last one would be the result
        )
        coarse = max(16, self.resolution // 2)
        done = fit(field, sampler, stages, training, lambda: run.trace(lambda: transferred(coarse)))
        steps = of_ours.steps + of_theirs.steps + done.steps
        left = run.elapsed() - stages.begin if stages.cut else math.inf
        note_shortage(run, steps, 2 * self.base_steps + self.steps, left, self.seconds)
        return in_time(lambda seconds: transferred(self.resolution, seconds), run)

    def _base(
        self, known: Samples, weights: torch.Generator, draws: torch.Generator, stages: Stages
    ) -> tuple[SineNetwork, Fit]:
        """A sine network fitted to samples of a base by Eq. 4.4, and the outcome of its training."""
        from ..learned.networks.sphere import begin_as_sphere
        from ..learned.training.batches import Sampler
        from ..learned.training.loop import fit
        from ..learned.training.settings import Training
        from .fields.sine_field import SineField
        from .losses.oriented import OrientedLoss

        form: dict[str, Any] = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": weights}
        field = SineField(OrientedLoss(*self.base_loss), self.omega, **form)
        begin_as_sphere(field.network, self.sphere)
        field = field.to(draws.device)
        training = Training(
            steps=ENDLESS if self.seconds else self.base_steps,
            seconds=stages.next(),
            learning_rate=self.base_rate,
            betas=self.betas,
        )
        done = fit(field, Sampler(*known, self.batch, draws), stages, training)
        return field.network.requires_grad_(False), done

    def _field(
        self, base: SineNetwork, seen: Cloud, detailed: Samples, weights: torch.Generator, draws: torch.Generator
    ) -> TransferField:
        """The source's field before the training of its displacement."""
        from ..learned.networks.film import FilmNetwork, JoinedNetwork
        from .fields.descriptor import Descriptor
        from .fields.transfer_field import TransferField
        from .fitting.oriented_samples import largest_distance

        descriptor = Descriptor(self.cells, generator=weights) if self.context == "grid" else None
        condition = (descriptor.channels if descriptor else 0) + 3 * (self.normals or descriptor is None)
        form: dict[str, Any] = {"width": self.width, "omega": self.omega_detail, "generator": weights}
        displacement: FilmNetwork | JoinedNetwork
        if self.mapping:
            displacement = FilmNetwork(condition, gain=self.gain, **form)
        else:
            displacement = JoinedNetwork(condition, **form)
        alpha = self.alpha or 1.5 * largest_distance(base, detailed)
        return TransferField(
            self.oriented_loss(),
            base,
            displacement,
            descriptor,
            seen,
            alpha=alpha,
            nu=self.nu or 2 * alpha,
            encoded=self.points,
            normal=self.normals,
            scale=self.scale_f,
            every=self.every,
            noise=self.noise,
            generator=draws,
        ).to(draws.device)
