"""Plugins that do next to nothing, and the config of a cell of them."""

from dataclasses import dataclass

from bench import PointCloud, Shape, register


@register("method", name="provenance_method")
@dataclass(frozen=True)
class Method:
    """Keeps the cloud."""

    depth: int = 8

    def denoise(self, cloud, run):
        return cloud


@register("dataset", name="provenance_dataset")
@dataclass(frozen=True)
class Dataset:
    """Has a state."""

    content: str = "one"

    def shapes(self, split):
        yield Shape("x", None)

    def state(self):
        return {"x.ply": self.content}


@register("sensor", name="provenance_sensor")
@dataclass(frozen=True)
class Sensor:
    """Sees nothing."""

    def sense(self, shape, rng):
        return PointCloud([])


@register("metric", name="provenance_metric", version=1)
@dataclass(frozen=True)
class Metric:
    """Scores nothing."""

    def score(self, output, case):
        return {}


def node(kind, name, **values):
    return {"_name_": name, **values}


def config(**changes):
    values = {
        "task": node("task", "denoise"),
        "dataset": node("dataset", "provenance_dataset"),
        "sensor": node("sensor", "provenance_sensor"),
        "method": node("method", "provenance_method"),
        "metric": {"provenance_metric": node("metric", "provenance_metric")},
        "seed": 0,
        "split": "test",
        "cases": 4,
        "threads": 1,
        "device": "cpu",
    }
    return values | changes
