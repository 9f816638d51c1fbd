"""The conformance kit of ``detailbench check``: tests a plugin against the contract, each trial in a child process.

A check *fails* when the plugin would corrupt a benchmark: another result with the same seed, a broken promise, a crash
or a hang, an unclear error on poor input. It *warns* where the engine protects the plugin anyway.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.case import Case
from ..contract.sensors import given_by, needs_a_source, noun_of, taken_by
from ..contract.shape import Shape
from ..contract.views import Views
from ..engine.isolate import Isolation
from ..errors import BadInput, DetailbenchError, InvalidOutput
from ..geometry.cloud import PointCloud
from ..plan.choice import Choice
from ..plan.limits import Limits
from ..plugins.registry import Plugin, registry
from ..plugins.schema import NAME_KEY, build, config_class, parameters
from ..plugins.weights import is_learned, load, shipped
from ..seeds import generator
from .dataset_checks import dataset_checks, digest_arrays, item_functions, items_trial
from .learning_checks import CASES, learn, learning_checks

LIMIT = Limits(seconds=300, memory_gb=4, setup_seconds=120)
POINTS = 2000  # of the toy cloud


@dataclass(frozen=True)
class Check:
    """One line of the report."""

    name: str
    verdict: str  # ok, warn or fail
    detail: str = ""


def check_plugin(
    plugin: Plugin, plugins: tuple[str, ...] = (), values: Mapping[str, Any] | None = None, limit: Limits = LIMIT
) -> Iterator[Check]:
    """All checks of one plugin, one after the other.

    Parameters
    ----------
    plugin : what to check
    plugins : the ``--plugin`` files that the children load
    values : parameters of the plugin other than its defaults
    limit : of each trial
    """
    parameters_hold = config_round_trip(plugin)
    yield parameters_hold
    if parameters_hold.verdict == "fail":  # every trial would report it again
        return
    with Isolation(plugin.requires, plugins) as isolation:
        trial = _Trials(plugin, isolation, dict(values or {}), limit)
        lacking = trial.run("require")
        if lacking["status"] == "skipped":
            yield Check("libraries", "warn", f"{lacking['message']}; no other check can run")
            return
        yield from {"method": method_checks, "dataset": _dataset_checks}.get(plugin.kind, simple_checks)(trial)


class _Trials:
    """Runs the trials of one plugin in children."""

    def __init__(self, plugin: Plugin, isolation: Isolation, values: dict[str, Any], limit: Limits):
        self.plugin, self.limit, self._isolation, self.values = plugin, limit, isolation, values
        self.weights = ""  # file of a learned method

    def run(self, trial: str, **arguments: Any) -> dict[str, Any]:
        plugin = {"kind": self.plugin.kind, "name": self.plugin.name, "values": self.values}
        asked = plugin | {"trial": trial, "weights": self.weights} | arguments
        return self._isolation.call("bench.authoring.conformance:attempt", asked, limit=self.limit)


def config_round_trip(plugin: Plugin) -> Check:
    """The parameters survive the round trip through a config and its YAML."""
    from omegaconf import OmegaConf

    name = "config round trip"
    try:
        node = OmegaConf.structured(config_class(plugin))
        again = OmegaConf.merge(node, OmegaConf.create(OmegaConf.to_yaml(node)))
        values: Any = OmegaConf.to_container(again, resolve=True)
        before, after = plugin.cls(), build(plugin, values)
    except (DetailbenchError, ValueError, TypeError) as error:
        return Check(name, "fail", str(error))
    if parameters(plugin, before) != parameters(plugin, after):
        return Check(name, "fail", f"defaults {parameters(plugin, before)} come back as {parameters(plugin, after)}")
    return Check(name, "ok", f"{len(values) - (NAME_KEY in values)} parameters")


# -- methods -----------------------------------------------------------------------------------------------------------

POOR_INPUTS = ("empty", "tiny", "nan", "duplicates")


def method_checks(trial: _Trials) -> Iterator[Check]:
    """A toy case per task, determinism, poor inputs where the input is a cloud, time."""
    made = build(trial.plugin, trial.values)  # with these parameters it may solve only some of its tasks
    tasks = [t for t in registry().names("task") if trial.plugin.solves(t) and callable(getattr(made, t, None))]
    if not tasks:
        yield Check("tasks", "fail", f"no function is named after a task ({', '.join(registry().names('task'))})")
        return
    yield Check("tasks", "ok", ", ".join(tasks))
    if not is_learned(trial.plugin):
        yield from task_checks(trial, tasks)
        return
    with tempfile.TemporaryDirectory(prefix="detailbench-") as folder:
        for line in learning_checks(trial.run, Path(folder)):
            yield Check(*line)
        usual = parameters(trial.plugin, build(trial.plugin, trial.values))
        path = shipped(trial.plugin, usual) or Path(folder) / "weights.safetensors"
        if path.is_file():
            trial.weights = str(path)
            yield from task_checks(trial, tasks)


def task_checks(trial: _Trials, tasks: list[str]) -> Iterator[Check]:
    """The trials for each task that a method solves."""
    for task in tasks:
        first = trial.run("solve", task=task, input="toy")
        if first["status"] == "no_toy":
            yield Check(f"{task}: toy case", "warn", first["message"])
            continue
        if first["status"] != "ok":
            yield Check(f"{task}: toy case", "fail", f"{first['status']}: {first['message']}")
            continue
        yield Check(f"{task}: toy case", "ok", f"{first['output']} in {first['seconds']:.3g} s")
        again = trial.run("solve", task=task, input="toy")
        yield _repeated(f"{task}: same seed, same result", first, again, trial.limit.seconds)
        if not first["cloud"]:
            continue
        bare = trial.run("solve", task=task, input="bare")
        yield _refusable(f"{task}: cloud without normals", bare, lenient=False)
        for poor in POOR_INPUTS:
            row = trial.run("solve", task=task, input=poor)
            yield _refusable(f"{task}: {poor} input", row, lenient=poor in ("empty", "nan"))


def _repeated(name: str, first: dict[str, Any], again: dict[str, Any], limit: float) -> Check:
    if again.get("digest") == first["digest"]:
        return Check(name, "ok", "two processes agree to the bit")
    hint = "draw from run.rng, and give libraries one thread or a seed"
    if first["seconds"] > limit / 3:
        hint += f"; if run.seconds_left() ended it after {first['seconds']:.3g} s, raise limit.seconds"
    return Check(name, "fail", hint)


def _refusable(name: str, row: dict[str, Any], lenient: bool) -> Check:
    """A valid result or a clear refusal pass; what the engine never passes to a method only warns."""
    if row["status"] == "ok":
        return Check(name, "ok", row["output"])
    if row["status"] == "refused":
        return Check(name, "ok", f"refused: {row['message']}")
    harmless = lenient and row["status"] in ("invalid", "error")
    hint = "; raise bench.BadInput with what was expected" if row["status"] in ("error", "invalid") else ""
    return Check(name, "warn" if harmless else "fail", f"{row['status']}: {row['message']}{hint}")


# -- datasets ----------------------------------------------------------------------------------------------------------


def _dataset_checks(trial: _Trials) -> Iterator[Check]:
    """The trials of a dataset: see :mod:`bench.authoring.dataset_checks`."""
    found = trial.run("functions")
    if found["status"] != "ok":
        yield Check("shapes", "fail", f"{found['status']}: {found['message']}")
        return
    for line in dataset_checks(trial.run, tuple(found["functions"])):
        yield Check(*line)


# -- sensors, metrics, tasks -------------------------------------------------------------------------------------------


def simple_checks(trial: _Trials) -> Iterator[Check]:
    """One trial that returns its own verdict, and determinism."""
    first, again = trial.run(trial.plugin.kind), trial.run(trial.plugin.kind)
    name = f"{trial.plugin.kind} on a toy"
    if first["status"] != "ok":
        yield Check(name, "fail", f"{first['status']}: {first['message']}")
        return
    yield Check(name, "ok", first["output"])
    yield Check("same seed, same result", "ok" if first["digest"] == again.get("digest") else "fail")


# -- what runs in the child --------------------------------------------------------------------------------------------


def attempt(spec: dict[str, Any], channel: Any) -> None:
    """One trial, in a child; its outcome is sent as a row."""
    from ..engine.channel import plain
    from ..engine.worker import failure

    asked = spec["arguments"]
    plugin = registry().find(asked["kind"], asked["name"])
    try:
        plugin.require()
        row = {"status": "ok", "message": ""} | _TRIALS[asked["trial"]](plugin, asked, spec, channel)
    except (BadInput, ValueError) as error:
        row = {"status": "refused", "message": f"{error}"}
    except BaseException as error:  # the boundary: the verdict is made of it
        row = failure(error, "method")
    channel.send("result", row=plain(row))


def toy_shape(seed: int = 0) -> Shape:
    """A closed bumpy ball of 1,280 faces, in the frame; each seed gives another."""
    from trimesh.creation import icosphere

    mesh = icosphere(subdivisions=3)
    x, y, z = mesh.vertices.T
    mesh.vertices *= (1 + 0.1 * np.sin((3 + seed) * x) * np.cos(4 * y) + 0.05 * z)[:, None]
    mesh.process(validate=False)
    shape, _ = Shape("toy", mesh, tags=("smooth",)).framed()
    return shape


def toy_cloud(kind: str, shape: Shape | None = None) -> PointCloud:
    """The toy cloud, or a poor one."""
    points, normals = (shape or toy_shape()).surface.sample(POINTS, generator("toy"))
    points = points + generator("toy noise").normal(scale=0.005, size=points.shape)
    if kind == "empty":
        return PointCloud(points[:0], normals[:0])
    if kind == "tiny":
        return PointCloud(points[:3], normals[:3])
    if kind == "nan":
        points[7] = np.nan
    if kind == "duplicates":
        points, normals = np.repeat(points[:200], 10, axis=0), np.repeat(normals[:200], 10, axis=0)
    return PointCloud(points, None if kind == "bare" else normals)


def toy_views() -> Views:
    """Six views of the unit ball in closed form, 48 x 48 pixels, lit from behind each camera."""
    size, distance = 48, 3.0
    axes = np.concatenate([np.eye(3), -np.eye(3)])  # where the cameras stand
    ups = np.roll(axes, 1, axis=0)
    rotations = np.stack([np.cross(ups, axes), -ups, -axes], axis=1)  # right, down, forward
    focal = size / 2 * np.sqrt(distance**2 - 1)  # the ball just fills the image
    x, y = np.meshgrid(*2 * [(np.arange(size) + 0.5 - size / 2) / focal])
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    length = (rays**2).sum(axis=-1)
    root = distance**2 - length * (distance**2 - 1)  # of |depth * ray - (0, 0, distance)| = 1
    depth = (distance - np.sqrt(np.maximum(root, 0))) / length
    facing = np.where(root > 0, distance - depth, 0)  # the normal's part towards the camera
    image = np.repeat(np.rint(255 * np.clip(facing, 0, 1)).astype(np.uint8)[..., None], 3, axis=-1)
    return Views(
        np.stack(6 * [image]),
        np.stack(6 * [root > 0]),
        np.concatenate([rotations, np.tile([[0.0], [0.0], [distance]], (6, 1, 1))], axis=2),
        np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]]),
        axes[:, None],
        np.ones((6, 1, 3)),
    )


def toy_ball() -> Shape:
    """The ball of :func:`toy_views`, as a mesh."""
    from trimesh.creation import icosphere

    return Shape("toy", icosphere(subdivisions=4), tags=("smooth",))


def toy_case(task: Any, kind: str) -> Case | None:
    """The toy case of a task: its own, or one of the toy cloud or views; None if there is none."""
    if hasattr(task, "toy"):
        return task.toy()
    takes = taken_by(task)
    if takes not in ("cloud", "views"):  # only its dataset or its sensors make such input
        return None
    sensed, shape = (toy_cloud(kind), toy_shape()) if takes == "cloud" else (toy_views(), toy_ball())
    try:
        return Case("toy", task.input(sensed), shape)
    except (AttributeError, TypeError):
        return None


def _solve(plugin: Plugin, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    from ..engine.call import MeasuredCall
    from ..engine.meter import Meter

    task = registry().find("task", asked["task"]).cls()
    case = toy_case(task, asked["input"])
    if case is None:
        return {"status": "no_toy", "message": "this task has no toy(), which makes a small case; try it in a run"}
    call = MeasuredCall(
        task=Choice("task", asked["task"]),
        method=Choice(plugin.kind, plugin.name, asked["values"]),
        solver=task,
        inputs=case.input,
        seed=0,
        spec=spec,
        meter=Meter(spec["memory_gb"], "cpu"),
        channel=channel,
        reference=case.reference,
        weights=load(asked["weights"]) if asked["weights"] else None,
    )
    output = call.solve()
    # Only a toy that was made here has poor variants.
    row = {"seconds": call.columns["seconds"], "cloud": taken_by(task) == "cloud" and not hasattr(task, "toy")}
    if asked["input"] == "empty" and isinstance(output, PointCloud) and not len(output):
        return row | {"output": "no output from an empty input", "digest": ""}
    task.validate(output, case.input)
    return row | {"output": repr(output).strip("<>"), "digest": digest_of(output)}


def _learn(plugin: Plugin, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    def toys(task: Any) -> list[Case]:
        if (toy := toy_case(task, "toy")) is None:
            return []
        shapes = [toy_shape(seed) for seed in range(CASES)]
        if hasattr(task, "toy") or taken_by(task) != "cloud":
            return [replace(toy, id=f"toy-{seed}", _cache={}) for seed in range(CASES)]
        return [
            Case(f"toy-{seed}", task.input(toy_cloud("toy", shape)), shape, seed=seed)
            for seed, shape in enumerate(shapes)
        ]

    return learn(plugin, asked, spec, toys)


def digest_of(value: Any) -> str:
    """Bitwise SHA-256 of the content of a result: its ``arrays()``, or the vertices and faces of a mesh."""
    if hasattr(value, "arrays"):
        arrays = value.arrays()
    else:
        arrays = {name: getattr(value, name, None) for name in ("vertices", "faces")}
    return digest_arrays({name: array for name, array in arrays.items() if array is not None})


def _functions(plugin: Plugin, asked: dict[str, Any], *rest: Any) -> dict[str, Any]:
    return {"functions": item_functions(build(plugin, asked["values"]))}


def _sensor(plugin: Plugin, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    from ..contract.task import validate_cloud

    sensor = build(plugin, asked["values"])
    gives, noun = given_by(plugin, sensor), noun_of(plugin, sensor)
    if not needs_a_source(plugin, sensor):
        shape = Shape("toy", toy_shape().mesh, scan=lambda: toy_cloud("oriented"))
        given = sensor.sense(shape, generator("check"))
    elif gives == "views":
        given = sensor.spoil(toy_views(), toy_ball(), generator("check"))
    else:
        return {"output": f"not tried: this check has no {gives} to degrade; try it in a chain", "digest": ""}
    if gives == "cloud":
        validate_cloud(given, "a PointCloud")
    elif noun is not None and not isinstance(given, noun):
        raise InvalidOutput(f"gives={gives!r} promises {noun.__name__}; got {type(given).__name__}")
    elif gives == "views" and not given.masks.any():
        raise InvalidOutput("no view shows the shape: all masks are empty")
    return {"output": repr(given), "digest": digest_of(given)}


def _metric(plugin: Plugin, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    """A perfect output must not score worse than a random one; in between, the order may vary by chance or design.

    (Noise spreads points more evenly, and the maximum of a few distances moves with the sample.)
    """
    from ..engine.call import score

    shape = toy_shape()
    case = Case("toy", {}, shape)
    kinds = plugin.options.get("outputs", ("mesh", "cloud"))
    ladder = [_spoiled(shape, kinds, amount) for amount in (0.0, 0.5)]
    choice = Choice(plugin.kind, plugin.name, asked["values"])
    scores = [score([choice], output, case).values for output in ladder]
    for key in scores[0]:
        direction = plugin.better(key)
        values = [s[key] for s in scores if key in s]
        if not np.isfinite(values).all():
            raise InvalidOutput(f"{key} is not finite: {values}")
        order = values if direction == "lower" else [-v for v in values]
        if direction != "reference" and order != sorted(order):
            raise InvalidOutput(f"{key} is better={direction}, but a perfect and a random output score {values}")
    words = ", ".join(f"{k}={v:.3g}" for k, v in scores[0].items())
    return {"output": f"perfect output: {words}", "digest": words}


def _spoiled(shape: Shape, kinds: tuple[str, ...], amount: float) -> Any:
    from trimesh import Trimesh

    rng = generator("spoil", int(1000 * amount))
    if "cloud" in kinds:
        points, normals = shape.surface.sample(POINTS, rng)
        noisy = normals + 4 * amount * rng.normal(size=normals.shape)
        noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
        return PointCloud(points + amount * rng.normal(size=points.shape), noisy)
    vertices = shape.mesh.vertices + amount * rng.normal(size=shape.mesh.vertices.shape)
    return Trimesh(vertices, shape.mesh.faces, process=False)


def _task(plugin: Plugin, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    """A task must refuse invalid output, and describe its toy case in finite numbers."""
    from ..engine.worker import conditions

    task = build(plugin, asked["values"])
    case = toy_case(task, "toy")
    words = f"promises {task.promise}"
    if case is None:
        return {"output": f"{words}; no toy()", "digest": ""}
    try:
        task.validate(None, dict(case.input))
    except InvalidOutput:
        pass
    else:
        raise InvalidOutput("validate(None, input) accepts None; raise bench.InvalidOutput with what was promised")
    told = conditions(task, case)
    if not np.isfinite(list(told.values())).all():
        raise InvalidOutput(f"describe(case) has values that are not finite: {told}")
    arguments = ", ".join(case.input)
    return {"output": f"{words}; input {arguments}", "digest": "".join(digest_of(v) for v in case.input.values())}


_TRIALS = {
    "require": lambda plugin, *rest: {},
    "solve": _solve,
    "learn": _learn,
    "functions": _functions,
    "items": items_trial,
    "sensor": _sensor,
    "metric": _metric,
    "task": _task,
}
