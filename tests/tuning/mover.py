"""A method whose best parameter is known, and a dataset of balls, which are made at once."""

from dataclasses import dataclass, field

from bench import PointCloud, Shape, register


@register("dataset")
@dataclass(frozen=True)
class Globes:
    """Balls of several radii, another one for each split and index."""

    def shapes(self, split):
        from trimesh.creation import icosphere

        for index in range(8):
            radius = 1 + 0.1 * index + (0.05 if split == "train" else 0)
            yield Shape(f"globe-{split}-{index}", icosphere(subdivisions=2, radius=radius))


@register("method")
@dataclass(frozen=True)
class Mover:
    """Moves all points by the distance of its parameter from 0.3."""

    shift: float = field(default=1.0, metadata={"range": (0.0, 2.0)})
    title: str = "x"

    def denoise(self, cloud, run):
        return PointCloud(cloud.points + abs(self.shift - 0.3), cloud.normals)
