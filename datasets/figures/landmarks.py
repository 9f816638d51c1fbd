"""Automatic landmarks of figures with one skeleton: where rays from the joints leave the figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from .skeleton import ENDS, NAMES, REST

if TYPE_CHECKING:
    from trimesh import Trimesh

REACH = 0.35  # metres: a surface farther from a joint does not belong to it
TILT = 0.013  # of the rays off the axes, so that none runs along an edge of a symmetric mesh
SIDES = ("front", "left", "back", "right")


class JointLandmarks(Mapping):
    """Named points of two figures at rest, found on first use.

    From each joint four rays go out across its bone; a landmark counts if both figures have it.

    Parameters
    ----------
    template, character : functions that return the mesh and its joints (joints, 3)
    """

    def __init__(
        self,
        template: Callable[[], tuple[Trimesh, np.ndarray]],
        character: Callable[[], tuple[Trimesh, np.ndarray]],
    ):
        self._figures = template, character
        self._places: dict[str, np.ndarray] | None = None

    def _known(self) -> dict[str, np.ndarray]:
        if self._places is None:
            one, other = (exits(*figure()) for figure in self._figures)
            self._places = {name: np.stack([one[name], other[name]]) for name in one if name in other}
        return self._places

    def __getitem__(self, name: str) -> np.ndarray:
        return self._known()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known())

    def __len__(self) -> int:
        return len(self._known())


@cache
def _directions() -> np.ndarray:
    """Unit vectors (joints, 4, 3) across the bones of the rest pose: front, left, back, right."""
    result = []
    for start, end in zip(REST, ENDS, strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        front = np.array([0.0, -1.0, 0.0]) if abs(along[1]) < 0.8 else np.array([0.0, 0.0, 1.0])
        front -= (front @ along) * along
        front /= np.linalg.norm(front)
        left = np.cross(along, front)
        left *= 1.0 if left[0] >= 0 else -1.0
        directions = np.array([front, left, -front, -left]) + TILT * along + TILT / 2 * np.array([left, front] * 2)
        result.append(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    return np.array(result)


def exits(mesh: Trimesh, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Where rays from the joints (joints, 3) of a figure at rest leave it, (3,) arrays by names like ``neck_front``.

    The figure may consist of closed parts that overlap: a ray leaves it where it has left all of them. Joints outside
    the figure, and rays that go too far, give no landmark.
    """
    from open3d.core import Tensor
    from open3d.t.geometry import RaycastingScene

    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    directions = _directions()
    rays = np.concatenate([np.repeat(joints, 4, axis=0), directions.reshape(-1, 3)], axis=1)
    scene = RaycastingScene(nthreads=1)
    scene.add_triangles(Tensor(vertices.astype(np.float32)), Tensor(faces.astype(np.uint32)))
    hits = scene.list_intersections(Tensor(rays.astype(np.float32)))
    ray, along, face = (hits[name].numpy() for name in ("ray_ids", "t_hit", "primitive_ids"))
    a, b, c = (vertices[faces[face, k]] for k in range(3))
    outwards = np.sign(np.einsum("ni,ni->n", np.cross(b - a, c - a), rays[ray, 3:]))
    places = {}
    for number in range(len(rays)):
        own = np.flatnonzero(ray == number)
        own = own[np.argsort(along[own], kind="stable")]
        left = outwards[own].sum() - np.cumsum(outwards[own])  # number of parts that the ray is still in after each hit
        last = np.flatnonzero(left == 0)
        if outwards[own].sum() > 0 and len(last) and along[own[last[0]]] < REACH:
            name = f"{NAMES[number // 4]}_{SIDES[number % 4]}"
            places[name] = rays[number, :3] + along[own[last[0]]].astype(float) * rays[number, 3:]
    return places
