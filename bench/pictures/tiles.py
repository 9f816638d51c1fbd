"""Renders shapes without a display: one picture for each, all from the same camera and in the same light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MissingLibrary
from ..geometry.cloud import PointCloud
from ..installing import line_of_extra
from .camera import Camera, Window
from .colors import PLAIN, colors

if TYPE_CHECKING:
    from trimesh import Trimesh

FINER = 2  # pictures are rendered larger by this factor, and averaged
MOST_DISCS = 60_000  # of a cloud: more would overlap in a tile
CORNERS = 8  # of a disc
COVER = 0.75  # radius of a disc, in distances of neighbouring points
EDGES = {"show_edges": True, "edge_color": "#30343a", "edge_opacity": 0.4, "line_width": 0.4 * FINER}
FAR, NEAR = 0.62, 0.96  # brightness of points without normals at the far end and at the near one
SPHERE = 0.55  # the same of points without normals


@dataclass(frozen=True)
class Paint:
    """How a shape is coloured: by errors up to a limit, or plainly.

    Attributes
    ----------
    errors : (n,) array or None
        The distance of each vertex or point to the reference.
    limit : float
        The error at the end of the colour scale.
    edges : bool
        Whether the edges of a mesh are drawn.
    """

    errors: np.ndarray | None = None
    limit: float = 0.0
    edges: bool = False

    def rgb(self, count: int) -> np.ndarray:
        """The colour of each of ``count`` vertices, (n, 3) uint8."""
        if self.errors is None:
            return np.tile(np.array(PLAIN, dtype=np.uint8), (count, 1))
        return colors(self.errors, self.limit)


class Studio:
    """One renderer for all tiles of a figure; a context manager.

    Raises
    ------
    MissingLibrary
        When pyvista is not installed.
    """

    def __init__(self, camera: Camera):
        self.camera = camera
        self._pyvista = pyvista()
        self._plotter = self._pyvista.Plotter(off_screen=True, lighting="none")
        self._plotter.background_color = "white"
        self._plotter.enable_parallel_projection()
        for position, intensity in (((-1.0, 1.4, 2.2), 0.72), ((1.6, 0.1, 1.2), 0.26), ((0.0, -1.2, 1.0), 0.10)):
            light = self._pyvista.Light(position=position, intensity=intensity, light_type="camera light")
            self._plotter.add_light(light)
        self._plotter.show(auto_close=False)  # nothing is shown: without it, its pictures cannot be asked for

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._plotter.close()

    def pictures(
        self, shape: Trimesh | PointCloud, paint: Paint, views: Sequence[tuple[Window, tuple[int, int]]]
    ) -> list[np.ndarray]:
        """Pictures of one shape, of one or several windows.

        Parameters
        ----------
        shape : Trimesh or PointCloud
        paint : Paint
        views : sequence of (Window, (width, height))
            What is shown, and how many pixels the picture has; both have the same aspect.

        Returns
        -------
        list of (height, width, 3) uint8 arrays
        """
        self._plotter.clear_actors()
        self._add(shape, paint, max(size[0] / window.half[0] for window, size in views))
        return [self._shot(window, size) for window, size in views]

    def _add(self, shape: Trimesh | PointCloud, paint: Paint, scale: float) -> None:
        """Put a shape on the stage; ``scale`` is how many pixels a radius has, halved."""
        style: dict[str, Any] = {"rgb": True, "ambient": 0.38, "diffuse": 0.70, "specular": 0.0}
        if not isinstance(shape, PointCloud) and len(shape.faces):
            mesh = self._pyvista.make_tri_mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
            mesh["rgb"] = paint.rgb(len(shape.vertices))
            edges = EDGES if paint.edges else {}
            self._plotter.add_mesh(mesh, scalars="rgb", smooth_shading=False, **style, **edges)
            return
        cloud = shape if isinstance(shape, PointCloud) else PointCloud(shape.vertices)
        kept = shown_points(len(cloud))
        points, rgb = cloud.points[kept], paint.rgb(len(cloud))[kept]
        normals = None if cloud.normals is None else cloud.normals[kept]
        vertices, faces, owner = discs(points, normals, spacing(points), self.camera)
        mesh = self._pyvista.make_tri_mesh(vertices, faces)
        if normals is None:  # points without normals cannot be lit, so farther ones are darker
            style |= {"lighting": False}
            rgb = darkened(rgb, self.camera.project(points)[:, 2])
        mesh["rgb"] = rgb[owner]
        self._plotter.add_mesh(mesh, scalars="rgb", smooth_shading=False, **style)

    def _shot(self, window: Window, size: tuple[int, int]) -> np.ndarray:
        right, up, eye = self.camera.axes
        middle = window.center[0] * right + window.center[1] * up
        plotter = self._plotter
        plotter.render_window.SetSize(FINER * size[0], FINER * size[1])  # by itself: pyvista would render at once
        plotter.camera.focal_point, plotter.camera.position = middle, middle + 10 * eye
        plotter.camera.up, plotter.camera.parallel_scale = up, window.half[1]
        plotter.camera.clipping_range = (0.1, 20)
        plotter.render()
        large = np.asarray(plotter.image)[:, :, :3]
        parts = large.reshape(size[1], FINER, size[0], FINER, 3).astype(np.float32)
        return np.round(parts.mean(axis=(1, 3))).astype(np.uint8)


def darkened(rgb: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Colours (n, 3) that are darker the smaller ``depth`` (n,) is: far from the eye."""
    span = np.ptp(depth) if len(depth) else 0.0
    share = (depth - depth.min()) / span if span > 0 else np.ones(len(depth))
    return np.round(rgb * (FAR + (NEAR - FAR) * share)[:, None]).astype(np.uint8)


def pyvista() -> Any:
    """The module, set up without a display: VTK warns that it found none, but renders anyway."""
    try:
        import pyvista as module
        from vtkmodules.vtkCommonCore import vtkLogger
    except ImportError as error:
        raise MissingLibrary("pyvista", line_of_extra("render")) from error
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    return module


def shown_points(count: int) -> np.ndarray:
    """Which of ``count`` points are drawn: all, or a fixed random subset."""
    if count <= MOST_DISCS:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, MOST_DISCS, replace=False))


def spacing(points: np.ndarray) -> float:
    """The median distance of points (n, 3) to their nearest neighbour, in their unit; 0.02 if there is none."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return 0.02
    some = points[:: max(1, len(points) // 5000)]
    near = cKDTree(points).query(some, k=2)[0][:, 1]
    near = near[near > 0]
    return float(np.median(near)) if len(near) else 0.02


def discs(
    points: np.ndarray, normals: np.ndarray | None, distance: float, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A small disc in place of each point, across its normal, or across the view without normals.

    Parameters
    ----------
    points, normals : (n, 3) arrays, or None for the normals
    distance : float
        Of neighbouring points: the discs are as large as to nearly close the surface.
    camera : Camera

    Returns
    -------
    vertices : (8 n, 3) array
    faces : (6 n, 3) array
    owner : (8 n,) array
        The point of each vertex.
    """
    right, up, eye = camera.axes
    n = len(points)
    if normals is None:
        first, second, radius = np.tile(right, (n, 1)), np.tile(up, (n, 1)), SPHERE * distance
    else:
        helper = np.where(abs(normals @ eye)[:, None] > 0.9, right, eye)
        first = np.cross(normals, helper)
        first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
        second, radius = np.cross(normals, first), COVER * distance
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    vertices = (points[:, None] + radius * ring).reshape(-1, 3)
    fan = np.array([[0, i, i + 1] for i in range(1, CORNERS - 1)])
    faces = (fan[None] + CORNERS * np.arange(n)[:, None, None]).reshape(-1, 3)
    return vertices, faces, np.repeat(np.arange(n), CORNERS)
