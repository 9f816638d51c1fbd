"""Errors of camera poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import Effect, Shape, Views, register

from .checks import expect, expect_length
from .spoiling import random_directions, seen_as
from .views import rotation_about


@register("sensor", gives="views")
@dataclass(frozen=True)
class CameraNoise(Effect[Views]):
    """Small errors of every camera's position and direction; images and masks stay as they are.

    Its centre is moved by independent Gaussians in x, y and z. It is then turned about its centre and a random axis,
    uniform on the sphere, by an angle that is Gaussian. Lights stay where they are in the world.
    """

    rotation: float = 0.5  # standard deviation of the angle, in degrees
    shift: float = 0.005  # standard deviation in x, y and z, relative to the bounding-sphere radius

    def __post_init__(self) -> None:
        expect(0 <= self.rotation <= 180, "rotation", "0 to 180", self.rotation)
        expect_length("shift", self.shift)

    def spoil(self, views: Views, shape: Shape, rng: np.random.Generator) -> Views:
        """The views with other cameras."""
        turning, moving = rng.spawn(2)
        axes = random_directions(len(views), turning)
        angles = np.radians(self.rotation) * turning.normal(size=len(views))
        centers = views.centers + self.shift * moving.normal(size=(len(views), 3))
        turns = np.stack([rotation_about(axis, angle) for axis, angle in zip(axes, angles, strict=True)])
        rotations = turns @ views.extrinsics[:, :, :3]
        shifts = -rotations @ centers[:, :, None]
        return seen_as(views, extrinsics=np.concatenate([rotations, shifts], axis=2))
