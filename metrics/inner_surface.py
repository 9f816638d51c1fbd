"""Surface of an output that lies deep inside the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, generator, register
from bench.geometry.orientation import NoSides, oriented
from bench.geometry.sampling import sample_uniform
from bench.geometry.signed_distance import signed_distances
from bench.geometry.topology import Edges, components_of_faces, count_topology, distinct_positions, without_repeats

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, better="lower", outputs=("mesh",), floor=True, requires=("igl", "scipy"))
@dataclass(frozen=True)
class InnerSurface:
    """How much surface an output has deep inside the reference, and how many pieces of it stand alone there.

    Images do not show the inside of a shape, and a neural implicit may have any structure there (thesis, figure 4.20).
    ``inner_area`` is the area of the output that lies deeper than ``depth`` inside the reference, divided by the area
    of the reference: the share of uniform samples of the output with a signed distance below ``-depth``, times the
    area of the output. With n samples, a share p of them inside, its standard error is ``A sqrt(p (1 - p) / n)``, A the
    quotient of the areas. ``inner_components`` is the number of connected components (faces connected through edges,
    vertices at equal positions merged) all of whose vertices and samples lie that deep.

    Only where the reference is closed. Filled or missing parts are not measured here. A part of the surface that is
    more than ``depth`` too far inside counts in ``inner_area`` like a spurious structure; ``inner_components`` counts
    only structures that do not touch the surface.
    """

    depth: float = 0.02  # in frame units; parts less deep count as the surface itself, with its error
    samples: int = 20_000  # points on the output

    def __post_init__(self) -> None:
        if not self.depth >= 0:
            raise ValueError(f"depth: expected at least 0, got {self.depth}")
        if self.samples < 1:
            raise ValueError(f"samples: expected at least 1, got {self.samples}")

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``inner_area`` and ``inner_components``, or ``{}`` where the reference has no inside: see :meth:`why_not`."""
        if self.why_not(output, case):
            return {}
        if not output.area > 0:
            return {"inner_area": float("inf"), "inner_components": float("inf")}
        reference = case.reference.mesh
        points, faces = sample_uniform(output, self.samples, generator(case.seed, case.id, "inner_surface"))
        deep = signed_distances(reference, points) < -self.depth
        area = output.area * deep.mean() / reference.area
        return {"inner_area": float(area), "inner_components": float(self._pieces(output, reference, faces, deep))}

    def why_not(self, output: Trimesh, case: Case) -> str:
        """Why an output has no score."""
        if case.reference.cloud is not None:
            return "needs a reference that is a mesh"
        vertices, faces = np.asarray(case.reference.mesh.vertices), np.asarray(case.reference.mesh.faces)
        try:
            faces = oriented(vertices, faces)
        except NoSides as error:
            return f"the reference has no inside: {error}"
        if not count_topology(vertices, faces).watertight:
            return "the reference is not closed: it has edges that do not belong to exactly two faces"
        return ""

    def _pieces(self, output: Trimesh, reference: Trimesh, faces: np.ndarray, deep: np.ndarray) -> int:
        """How many components lie deep inside, given the faces (n,) of samples and whether these do."""
        vertices, corners = np.asarray(output.vertices), np.asarray(output.faces)
        position = distinct_positions(vertices)[corners]
        sound = without_repeats(position)
        count, parts = components_of_faces(int(sound.sum()), Edges(position[sound]))
        part = np.full(len(corners), count)  # faces that use a position twice belong to no component
        part[sound] = parts
        inside = np.ones(count + 1, dtype=bool)
        inside[part[faces[~deep]]] = False
        inside[count] = False
        left = np.flatnonzero(inside[part])  # all samples of these are deep, or they have none
        used = np.unique(corners[left])
        shallow = np.zeros(len(vertices), dtype=bool)
        shallow[used] = signed_distances(reference, vertices[used]) >= -self.depth
        inside[part[left[shallow[corners[left]].any(axis=1)]]] = False
        return int(inside.sum())
