"""A cell that does nothing, for measuring what surrounds it."""

from dataclasses import dataclass
from itertools import count

from bench import PointCloud, Shape, register


@register("method")
@dataclass(frozen=True)
class Nothing:
    """Returns its input."""

    def denoise(self, cloud, run):
        return cloud


@register("dataset")
@dataclass(frozen=True)
class TinyBalls:
    """Balls of 42 vertices."""

    def shapes(self, split):
        for index in count():
            yield Shape(f"ball-{split}-{index}", self.mesh)

    def mesh(self):
        from trimesh.creation import icosphere

        return icosphere(subdivisions=1)


@register("sensor")
@dataclass(frozen=True)
class TinySamples:
    """A hundred points."""

    def sense(self, shape, rng):
        return PointCloud(*shape.surface.sample(100, rng))


@register("metric", version=1)
@dataclass(frozen=True)
class TinyScore:
    """Mean distance from the origin."""

    def score(self, output, case):
        return {"tiny_score": float(abs(output.points).mean())}
