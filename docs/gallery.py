"""Pictures of all shape families and of all sensors, without a display.

    python docs/gallery.py families docs/families.png
    python docs/gallery.py families docs/families_made.png --only parts assemblies wires cloth buildings
    python docs/gallery.py sensors docs/sensors.png --dataset smooth_csg

(with pyvista, from the extra `render`)

Families: half a row each, its first test shapes, with their kinds. Sensors: one shape as each of them sees it,
coloured by the distance to the surface; presets of sensors included.
"""

from __future__ import annotations

import argparse
from itertools import islice

import numpy as np
import pyvista

from bench import Frame, Shape, generator
from bench.geometry.mesh_surface import MeshSurface
from bench.plugins.presets import presets
from bench.plugins.registry import registry
from bench.plugins.schema import build

VIEW = [(2.1, -2.7, 1.7), (0, 0, 0), (0, 0, 1)]
SHAPES = 6
TILE = 220
SKIPPED = ("mpu_", "dss_", "idf_")  # presets that differ in the number of points and the noise alone


def polydata(shape: Shape) -> pyvista.PolyData:
    """A shape's mesh in the frame of a case."""
    mesh = shape.mesh
    vertices = Frame.of(mesh.vertices).apply(mesh.vertices)
    return pyvista.make_tri_mesh(vertices, np.asarray(mesh.faces))


def families(picture: str, only: list[str]) -> None:
    """A row of shapes for each family, or for each of those that are named."""
    plugins = [p for p in registry().all("dataset") if not hasattr(p.cls, "state")]
    plugins = [p for p in plugins if not only or p.name in only]
    rows = (len(plugins) + 1) // 2
    size = (2 * SHAPES * TILE, rows * TILE)
    plotter = pyvista.Plotter(off_screen=True, shape=(rows, 2 * SHAPES), window_size=size, border=False)
    for number, plugin in enumerate(plugins):
        for column, shape in enumerate(islice(plugin.cls().shapes("test"), SHAPES)):
            plotter.subplot(number // 2, column + SHAPES * (number % 2))
            kinds = [tag for tag in shape.tags if tag not in shape.traits.tags]
            label(plotter, (f"{plugin.name}\n" if column == 0 else "\n") + ", ".join(kinds))
            sharp = "sharp" in shape.traits.tags
            look = {"color": "#cfc7b8", "smooth_shading": not sharp, "split_sharp_edges": False}
            if shape.mesh.area < 0.01:  # a curve: a band without a width that could be seen
                look = {"color": "black", "style": "wireframe", "line_width": 2}
            plotter.add_mesh(polydata(shape), **look)
            plotter.camera_position = VIEW
            plotter.camera.zoom(0.85)  # room for the words
    save(plotter, picture)


def sensors(picture: str, dataset: str, index: int) -> None:
    """One shape under every sensor and preset."""
    shape = next(islice(registry().find("dataset", dataset).cls().shapes("test"), index, None))
    framed, _ = shape.framed()
    wanted = [(p.name, p, {}) for p in registry().all("sensor") if p.options.get("gives", "cloud") == "cloud"]
    for preset in presets("sensor").values():
        if not preset.name.startswith(SKIPPED):
            wanted.append((preset.name, registry().find("sensor", preset.plugin), preset.values))
    surface = MeshSurface(framed.mesh)
    columns = 7
    rows = -(-len(wanted) // columns)
    plotter = pyvista.Plotter(
        off_screen=True, shape=(rows, columns), window_size=(columns * TILE, rows * TILE), border=False
    )
    for number, (name, plugin, values) in enumerate(wanted):
        cloud = build(plugin, values).sense(framed, generator(0, "gallery"))
        distance = np.linalg.norm(cloud.points - surface.closest(cloud.points)[0], axis=1)
        plotter.subplot(number // columns, number % columns)
        label(plotter, f"{name}\n{len(cloud):,} points")
        plotter.add_mesh(
            pyvista.PolyData(cloud.points), scalars=distance, cmap="viridis", clim=(0, 0.03), show_scalar_bar=False,
            point_size=3, render_points_as_spheres=False,
        )  # fmt: skip
        plotter.camera_position = VIEW
    save(plotter, picture)


def label(plotter: pyvista.Plotter, text: str) -> None:
    """Two short lines at the top of the current tile."""
    plotter.add_text(text, position=(0.02, 0.85), viewport=True, font_size=7, color="black")


def save(plotter: pyvista.Plotter, picture: str) -> None:
    """Write the picture with few colours: it lives in the repository."""
    plotter.set_background("white")
    plotter.screenshot(picture)
    plotter.close()
    from PIL import Image

    Image.open(picture).convert("RGB").quantize(128).save(picture, optimize=True)


def main() -> None:
    """Draw one of the two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("families", "sensors"))
    parser.add_argument("picture")
    parser.add_argument("--dataset", default="smooth_csg", help="whose shape the sensors see")
    parser.add_argument("--index", type=int, default=0, help="which of its test shapes")
    parser.add_argument("--only", nargs="+", default=[], metavar="FAMILY", help="the families; all by default")
    args = parser.parse_args()
    if args.what == "families":
        families(args.picture, args.only)
    else:
        sensors(args.picture, args.dataset, args.index)


if __name__ == "__main__":
    main()
