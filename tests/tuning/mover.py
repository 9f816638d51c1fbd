"""A method whose best parameter is known."""

from dataclasses import dataclass, field

from bench import PointCloud, register


@register("method")
@dataclass(frozen=True)
class Mover:
    """Moves all points by the distance of its parameter from 0.3."""

    shift: float = field(default=1.0, metadata={"range": (0.0, 2.0)})
    title: str = "x"

    def denoise(self, cloud, run):
        return PointCloud(cloud.points + abs(self.shift - 0.3), cloud.normals)
