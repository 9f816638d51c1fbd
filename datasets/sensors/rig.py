"""A rig of cameras: images instead of points."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bench import BadInput, Shape, Views, register

from ..common.rotations import random_rotation
from .checks import expect, expect_choice, expect_count
from .scene import Scene, View, see
from .spoiling import random_directions
from .views import Pose, fibonacci_sphere, look_at, turntable

LATER = {"since": "0.2"}
LIGHTS = ("suns", "white")
PLACEMENTS = ("sphere", "random", "turntable")
NORMALS = ("flat", "smooth")
# Red, green and blue light from three sides: the colour of a pixel determines its normal.
COLORS = np.array([[0.9, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.9]])


@register("sensor", gives="views", requires=("open3d",))
@dataclass(frozen=True)
class Rig:
    """Images of the shape by pinhole cameras around it, with masks, cameras and lights.

    The cameras look at the middle of the shape. A ray is cast through the centre of every pixel; its first hit is
    shaded as a white diffuse surface, ``ambient + sum over lights of max(0, n . l) color``, clipped to 0..1 and rounded
    to 0..255, without shadows. The background is black. Each camera has its own lights. ``suns`` are three lights, red,
    green and blue (0.9 each), at right angles to each other, as in differentiable surface splatting (Yifan et al.
    2019): the first shines along the optical axis, the others from the sides, turned at random. ``white`` is one light
    of intensity ``1 - ambient`` from a random direction on the camera's side of the shape, uniform on that hemisphere.

    Lengths are relative to the bounding-sphere radius, which is 1 in the frame of a case.
    """

    views: int = 24  # number of cameras
    resolution: int = 256  # pixels along each side of the square images
    placement: Literal["sphere", "random", "turntable"] = "sphere"  # even (turned at random), random, or a ring about z
    elevation: float = 20.0  # of the turntable's ring, in degrees above the horizon
    distance: float = 3.0  # of the cameras from the middle of the shape; more than 1
    farthest: float = field(default=0.0, metadata=LATER)  # distances are drawn up to this; 0: all are `distance`
    field_of_view: float = 0.0  # degrees from the left to the right of an image; 0: the sphere just fills the nearest
    normals: Literal["flat", "smooth"] = "flat"  # of the triangles, or of the exact surface (slow), or interpolated
    ambient: float = 0.1  # light from everywhere, 0..1
    lights: Literal["suns", "white"] = field(default="suns", metadata=LATER)  # three coloured ones, or a white one

    def __post_init__(self) -> None:
        expect_count("views", self.views)
        expect_count("resolution", self.resolution, least=2)
        expect_choice("placement", self.placement, PLACEMENTS)
        expect(-90 <= self.elevation <= 90, "elevation", "-90 to 90", self.elevation)
        expect(1.01 <= self.distance < np.inf, "distance", "at least 1.01: outside the bounding sphere", self.distance)
        far = self.farthest == 0 or self.distance <= self.farthest < np.inf
        expect(far, "farthest", f"0, or at least distance, which is {self.distance}", self.farthest)
        expect(0 <= self.field_of_view < 180, "field_of_view", "0, or less than 180", self.field_of_view)
        expect_choice("normals", self.normals, NORMALS)
        expect(0 <= self.ambient <= 1, "ambient", "0 to 1", self.ambient)
        expect_choice("lights", self.lights, LIGHTS)

    def sense(self, shape: Shape, rng: np.random.Generator) -> Views:
        """The images of a shape.

        Raises
        ------
        BadInput
            If no camera sees the shape.
        """
        placing, lighting, moving = rng.spawn(3)
        scene = Scene(shape.mesh)
        poses = self._poses(scene, placing, moving)
        make = _suns if self.lights == "suns" else _white
        lights = np.stack([make(pose, lighting) for pose in poses])
        colors = COLORS if self.lights == "suns" else np.full((1, 3), 1 - self.ambient)
        focal = self._focal_length()
        images = np.zeros((self.views, self.resolution, self.resolution, 3), dtype=np.uint8)
        masks = np.zeros(images.shape[:3], dtype=bool)
        for pose, light, image, mask in zip(poses, lights, images, masks, strict=True):
            view = see(scene, pose, focal, self.resolution)
            image.reshape(-1, 3)[view.index] = self._shaded(view, light, colors, scene, shape)
            mask.reshape(-1)[view.index] = True
        if not masks.any():
            raise BadInput(f"sensor rig: no camera sees {shape.id}; try a higher resolution or a wider field_of_view")
        center = self.resolution / 2
        return Views(
            images,
            masks,
            np.stack([np.column_stack([pose.axes, -pose.axes @ pose.center]) for pose in poses]),
            np.array([[focal, 0, center], [0, focal, center], [0, 0, 1]]),
            lights,
            np.tile(colors, (self.views, 1, 1)),
            np.full((self.views, 3), self.ambient),
        )

    def _poses(self, scene: Scene, rng: np.random.Generator, moving: np.random.Generator) -> list[Pose]:
        """The cameras, all looking at the middle of the shape."""
        if self.placement == "turntable":
            directions = turntable(self.views, self.elevation, rng.uniform(0, 360))
        elif self.placement == "random":
            directions = random_directions(self.views, rng)
        else:
            directions = fibonacci_sphere(self.views) @ random_rotation(rng).T
        distances = np.full(self.views, self.distance)
        if self.farthest:
            distances = moving.uniform(self.distance, self.farthest, self.views)
        offsets = distances[:, None] * scene.radius * directions
        return [look_at(scene.center + offset, scene.center) for offset in offsets]

    def _focal_length(self) -> float:
        """In pixels."""
        half = np.radians(self.field_of_view) / 2 if self.field_of_view else np.arcsin(1 / self.distance)
        return float(self.resolution / 2 / np.tan(half))

    def _shaded(self, view: View, lights: np.ndarray, colors: np.ndarray, scene: Scene, shape: Shape) -> np.ndarray:
        """The colours (n, 3) uint8 of the pixels that show the shape."""
        flat = scene.normals[view.faces]
        normals = flat if self.normals == "flat" else _smooth(view, shape)
        behind = np.einsum("ni,ni->n", flat, view.points - view.pose.center) > 0
        normals = np.where(behind[:, None], -normals, normals)  # both sides of an open surface are lit
        shaded = self.ambient + np.maximum(normals @ lights.T, 0) @ colors
        return np.rint(255 * np.clip(shaded, 0, 1)).astype(np.uint8)


def _suns(pose: Pose, rng: np.random.Generator) -> np.ndarray:
    """Three directions towards lights, orthonormal rows: the first behind the camera, the others turned at random."""
    back = -pose.axes[2]
    side = np.cross(back + rng.random(3), back)
    side /= np.linalg.norm(side)
    return np.stack([back, side, np.cross(side, back)])


def _white(pose: Pose, rng: np.random.Generator) -> np.ndarray:
    """One direction towards a light, as a row: any of the hemisphere around the camera's."""
    directions = random_directions(1, rng)
    return directions if directions[0] @ pose.axes[2] <= 0 else -directions


def _smooth(view: View, shape: Shape) -> np.ndarray:
    """Normals (n, 3) of the exact surface if the dataset has it, else interpolated between those of vertices."""
    if shape.is_exact:
        return shape.surface.closest(view.points)[1]
    from trimesh.triangles import points_to_barycentric

    mesh = shape.mesh
    weights = points_to_barycentric(mesh.triangles[view.faces], view.points)
    normals = np.einsum("nk,nki->ni", weights, mesh.vertex_normals[mesh.faces[view.faces]])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
