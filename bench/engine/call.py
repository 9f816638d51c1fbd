"""One measured call of a method, and one score of its output: for ``run``, ``apply``, ``check`` and ``score`` alike."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..contract.artefacts import Artefacts
from ..contract.case import Case
from ..contract.run import Run
from ..contract.shape import Shape
from ..errors import InvalidOutput
from ..geometry.cloud import PointCloud
from ..geometry.comparison import NeedsSurface
from ..notices import collected
from ..plan.choice import Choice
from .channel import Channel, plain
from .devices import make_context
from .meter import Meter
from .seeding import seed_globals

# -- the call ----------------------------------------------------------------------------------------------------------


@dataclass(eq=False)
class MeasuredCall:
    """One call of a method: prepared, seeded, measured, and its output validated.

    ``columns`` is empty until the method was called. Then, also when it raised, it has the meter's measurements, and
    the reports of the method: ``parameters``, ``active_parameters``, ``message``, ``true_distances``, ``trace`` and
    ``artefacts``. The channel receives the stages ``prepare`` and ``method``, and of every pause of the clock.
    """

    task: Choice
    method: Choice
    solver: Any  # the task, built
    inputs: Mapping[str, Any]  # the keyword arguments of the method's function
    seed: int  # of the global generators and of the Run
    spec: Mapping[str, Any]  # of the job: its ``threads``, and the ``seconds`` that are the method's limit
    meter: Meter  # its device is that of the method
    channel: Channel
    index: int = 0  # of the case, for the channel
    case: str = ""  # its id
    weights: Mapping[str, np.ndarray] | None = None  # of a learned method
    reference: Shape | None = None  # the shape to which run.true_distances measures
    trace_score: Callable[[Any], Mapping[str, Any]] | None = None  # of a valid output; None: traces are not scored
    store: tuple[Path, Path] | None = None  # where run.keep stores, and the folder to which listed paths are relative
    columns: dict[str, Any] = field(default_factory=dict, init=False)
    _trace: list[dict[str, Any]] = field(default_factory=list, init=False)
    _files: Artefacts | None = field(default=None, init=False)

    def __call__(self) -> Any:
        """The output of the method, validated.

        Raises
        ------
        InvalidOutput
            If it breaks a promise of the task. Exceptions of the method pass through.
        """
        output = self.solve()
        self.validate(output)
        return output

    def validate(self, output: Any) -> None:
        """Check that an output keeps the promises of the task, and is not too large to be scored."""
        most = self.spec.get("output_points", math.inf)
        for name in ("points", "vertices", "faces"):
            values: Any = getattr(output, name, None)
            if hasattr(values, "__len__") and len(values) > most:
                raise InvalidOutput(f"returned {len(values):,} {name}, more than limit.output_points={most}")
        self.solver.validate(output, self.inputs)

    def solve(self) -> Any:
        """The output of the method, not validated."""
        self.channel.enter("prepare", self.index)
        for plugin in self.method.parts:
            plugin.require()
        make_context(self.meter.device)
        method = self.method.build()
        if hasattr(method, "prepare"):  # for instance of weights: not part of the call, nor of its limit
            method.prepare()
        seed_globals(self.seed)
        run = self._new_run()
        self.channel.enter("method", self.index)
        notices: list[str] = []
        try:
            with self.meter:
                run._started = time.perf_counter()
                with collected() as notices:
                    return self.solver.solve(method, self.task.name, dict(self.inputs), run)
        finally:
            run.notes.extend(text for text in notices if text not in run.notes)
            self.columns |= self.meter.figures() | self._reported(run)

    def _new_run(self) -> Run:
        has_truth = self.reference is not None and len(self.reference.mesh.faces) > 0
        run = Run(
            seed=self.seed,
            device=self.meter.device,
            threads=self.spec["threads"],
            seconds=self.spec["seconds"],
            weights=self.weights,
            case=self.case,
            on_progress=lambda done, total: self.channel.send("progress", done=done, total=total),
            on_trace=self._add_trace if self.trace_score else None,
            on_keep=self._keep if self.store else None,
            on_distances=self._distances if has_truth else None,
            on_exchange=self._off_the_clock,
        )
        self._files = Artefacts(*self.store, run.note) if self.store else None
        return run

    def _reported(self, run: Run) -> dict[str, Any]:
        """The columns that the method reported through its run."""
        columns = {
            "parameters": None if run.parameters is None else int(run.parameters),
            "active_parameters": None if run.active_parameters is None else int(run.active_parameters),
            "message": "; ".join(run.notes),
            "true_distances": run.distances_given or None,
            "exchange_seconds": run.exchanged or None,
        }
        if run.peak_mb is not None:
            columns |= {"peak_rss_mb": float(run.peak_mb), "rss_before_mb": 0.0}
        if run.external:
            figures = ("seconds", "cpu_seconds", "peak_rss_mb", "rss_before_mb", "peak_device_mb", "exchange_seconds")
            columns |= dict.fromkeys(figures) | {"external": run.external, "reference_seconds": None}
        if self._trace:
            columns["trace"] = json.dumps(plain(self._trace))
        if self._files and self._files.paths:
            columns["artefacts"] = json.dumps(self._files.paths)
        return columns

    # -- off the clock -------------------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _off_the_clock(self) -> Iterator[None]:
        """Stop the clock and the limit of the call; the code inside has limit.setup_seconds."""
        self.channel.send("pause")
        try:
            with self.meter.paused():
                yield
        finally:
            self.channel.send("resume")

    def _add_trace(self, output: Any, seconds: float, keep: bool = False) -> None:
        """Score an intermediate result; store it too with ``keep``."""
        assert self.trace_score is not None
        with self._off_the_clock():
            entry: dict[str, Any] = {"seconds": seconds}
            try:
                output = output() if callable(output) else output
                self.validate(output)
                entry |= self.trace_score(output)
            except InvalidOutput as error:
                entry["message"] = str(error)
            else:
                if keep and self._files and (path := self._files.keep(f"trace-{len(self._trace):03d}", output)):
                    entry["artefact"] = path
            self._trace.append(entry)

    def _keep(self, name: str, value: Any) -> None:
        assert self._files is not None
        with self._off_the_clock():
            self._files.keep(name, value)

    def _distances(self, points: np.ndarray) -> np.ndarray:
        """Signed distances to the reference: papers sample them beforehand, so the method's time excludes them."""
        from ..geometry.signed_distance import signed_distances

        assert self.reference is not None
        with self._off_the_clock():
            return signed_distances(self.reference.mesh, points)


# -- the score ---------------------------------------------------------------------------------------------------------


NEEDS_MESH = "needs a reference that is a mesh"


class Scores(NamedTuple):
    """The metrics of one output: scores, floors if any, and the direction of each score."""

    values: dict[str, float]
    floors: dict[str, float]
    directions: dict[str, str]  # lower, higher or reference
    left_out: dict[str, str]  # metrics without a score, and their reasons, if given

    @property
    def columns(self) -> dict[str, float]:
        """``score.<key>`` and ``floor.<key>``."""
        return {f"score.{k}": v for k, v in self.values.items()} | {f"floor.{k}": v for k, v in self.floors.items()}


def score(
    metrics: Iterable[Choice],
    output: Any,
    case: Case,
    *,
    floors: bool = True,
    keys: Mapping[str, str] | None = None,
) -> Scores:
    """Score an output against the reference of a case.

    Parameters
    ----------
    metrics : metrics that score this kind of output
    output : PointCloud or mesh, in the frame of the case
    case : its seed and id seed the samples
    floors : whether to score the perfect output too, with the metrics that have a floor; never where the reference is
        a cloud
    keys : fingerprints under which floors are cached, see :func:`bench.results.provenance.memory_keys`; only needed
        for a case that has a cache

    Raises
    ------
    Exception
        Whatever a metric raises, with a note that names the metric.
    """
    found = Scores({}, {}, {}, {})
    of_points = case.reference.cloud is not None
    floors = floors and not of_points  # a reference cloud has no second perfect sample
    for choice in metrics:
        metric, plugin = choice.build(), choice.plugin
        try:
            scores = metric.score(output, case)
            if not scores:
                found.left_out[choice.name] = metric.why_not(output, case) if hasattr(metric, "why_not") else ""
            perfect = floor(choice, metric, output, case, keys) if floors and plugin.options.get("floor") else {}
        except NeedsSurface:
            found.left_out[choice.name] = NEEDS_MESH
            continue
        except Exception as error:
            error.add_note(f"while scoring {choice.name}")
            raise
        if of_points and (own := {key for key in scores if plugin.better(key) == "reference"}):
            scores = {key: value for key, value in scores.items() if key not in own}
            found.left_out[choice.name] = NEEDS_MESH
        found.values.update({key: float(value) for key, value in scores.items()})
        found.floors.update(perfect)
        found.directions.update({key: plugin.better(key) for key in scores})
    return found


def floor(
    choice: Choice, metric: Any, output: Any, case: Case, keys: Mapping[str, str] | None = None
) -> dict[str, float]:
    """The score of a perfect output of this type and count: the same for all methods with as many points or faces.

    A metric may look at the input of the case, so each sensor has floors of its own. One that takes another output for
    perfect than the case does, as evenly spread points where its ground truth is such, has ``perfect(output, case)``.
    """
    kind = f"{len(output)} points" if isinstance(output, PointCloud) else "mesh"

    def scored() -> dict[str, np.ndarray]:
        perfect = metric.perfect(output, case) if hasattr(metric, "perfect") else case.perfect(output)
        return {key: np.asarray(value) for key, value in metric.score(perfect, case).items()}

    keys = keys or {}
    name = f"floor of {choice.name} {keys.get(f'metric {choice.name}')} for {kind} from {keys.get('sensor')}"
    return {key: float(value) for key, value in case.remember(name, scored).items()}
