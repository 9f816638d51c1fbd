"""Point clouds side by side, as small balls: how evenly they are spread.

    detailbench inputs iso task=upsample dataset=blobs sensor=poisson_disk sensor.count=1000 cases=1
    cp iso/*/inputs/blobs-test-000.ply scan.ply
    detailbench apply task=reconstruct method=siren method.save=field.safetensors scan.ply mesh.ply
    detailbench apply task=denoise method=iso_points method.load=field.safetensors scan.ply iso_1.ply
    detailbench apply task=upsample task.ratio=4 method=iso_points method.load=field.safetensors scan.ply iso_4.ply
    detailbench apply task=upsample task.ratio=16 method=iso_points method.load=field.safetensors scan.ply iso_16.ply
    python docs/iso_points.py iso_1.ply iso_4.ply iso_16.ply docs/iso_points.png

(with pyvista, from the extra `render`)
"""

from __future__ import annotations

import argparse

import numpy as np
import pyvista

from bench import Frame
from bench.geometry.io.files import load_cloud

VIEW = [(2.1, -2.7, 1.7), (0, 0, 0), (0, 0, 1)]
TILE = 460


def main() -> None:
    """Draw a tile for each cloud."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clouds", nargs="+")
    parser.add_argument("picture")
    args = parser.parse_args()
    size = (TILE * len(args.clouds), TILE)
    plotter = pyvista.Plotter(off_screen=True, shape=(1, len(args.clouds)), window_size=size, border=False)
    for column, path in enumerate(args.clouds):
        points = load_cloud(path).points
        points = Frame.of(points).apply(points)
        ball = pyvista.Sphere(radius=0.35 * np.sqrt(4 / len(points)), theta_resolution=12, phi_resolution=12)
        plotter.subplot(0, column)
        plotter.add_mesh(pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False), color="#7f8c9b")
        plotter.add_text(f"{len(points):,} points", font_size=9, color="black", position="upper_left")
        plotter.camera_position = VIEW
        plotter.camera.zoom(1.2)
    plotter.set_background("white")
    plotter.screenshot(args.picture)


if __name__ == "__main__":
    main()
