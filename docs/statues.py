"""A picture of statues: some of each kind, from two sides, without a display.

    python docs/statues.py docs/statues.png

(with pyvista, from the extra `render`)
"""

from __future__ import annotations

import argparse
from itertools import islice

import numpy as np
import pyvista

from bench import Frame
from bench.datasets.statues import KINDS, Statues

SIDES = ((0.15, -1.0, 0.1), (0.9, -0.8, 0.25))
TILE = 300
COUNT = 3  # of each kind


def shaded(normals: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of a matt surface seen from ``side``, lit from the left above and weakly from the right."""
    across = np.cross([0, 0, 1], side)
    across /= np.linalg.norm(across)
    up = np.cross(side, across)
    light = np.full(len(normals), 0.16)
    for weight, direction in ((0.68, side - across + 1.2 * up), (0.2, 0.6 * side + 1.2 * across + 0.2 * up)):
        light += weight * np.clip(normals @ (direction / np.linalg.norm(direction)), 0, 1)
    return (np.clip(light, 0, 1)[:, None] * [246, 238, 224]).astype(np.uint8)


def main() -> None:
    """Draw a row for each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture")
    args = parser.parse_args()
    shape = (len(KINDS), COUNT * len(SIDES))
    size = (shape[1] * TILE, shape[0] * TILE)
    plotter = pyvista.Plotter(off_screen=True, shape=shape, window_size=size, border=False)
    for row, kind in enumerate(KINDS):
        for number, statue in enumerate(islice(Statues(kind=kind).shapes("test"), COUNT)):
            mesh = statue.mesh
            vertices, normals = Frame.of(mesh.vertices).apply(mesh.vertices), np.asarray(mesh.vertex_normals)
            for column, side in enumerate(SIDES):
                side = np.array(side) / np.linalg.norm(side)
                drawn = pyvista.make_tri_mesh(vertices, np.asarray(mesh.faces))
                drawn["colour"] = shaded(normals, side)
                plotter.subplot(row, number * len(SIDES) + column)
                plotter.add_mesh(drawn, scalars="colour", rgb=True, lighting=False)
                plotter.camera_position = [tuple(4 * side), (0, 0, 0), (0, 0, 1)]
                plotter.enable_parallel_projection()
                plotter.camera.parallel_scale = 1.02
    plotter.set_background("white")
    plotter.screenshot(args.picture)
    plotter.close()
    from PIL import Image

    Image.open(args.picture).convert("RGB").quantize(128).save(args.picture, optimize=True)


if __name__ == "__main__":
    main()
