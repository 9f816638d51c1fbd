"""Pictures of kept outputs, without a display: one row per case, one column per method.

    detailbench run experiment=first_table results=results/first_table
    python docs/render.py results/first_table docs/outputs.png --dataset bumps,cad \\
        --method poisson,ball_pivoting,apss,rimls

(with pyvista, from the extra `render`)

takes the files that `outputs=first` or `outputs=all` kept. Colour is the distance to the reference, in its radii.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pyvista

from bench.geometry.files import load_cloud, load_mesh
from bench.geometry.mesh_surface import MeshSurface
from bench.store import Results


def distances(points: np.ndarray, reference) -> np.ndarray:
    """Distance of each point (n, 3) to the reference mesh."""
    closest, _ = MeshSurface(reference).closest(points)
    return np.linalg.norm(points - closest, axis=1)


def draw(plotter: pyvista.Plotter, path: Path, task: str, reference, title: str, limit: float) -> None:
    """One output in the current cell of the picture."""
    plotter.add_text(title, font_size=9, color="black")
    if task == "reconstruct":
        mesh = load_mesh(path)
        shape = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        values = distances(mesh.vertices, reference)
        style = {"smooth_shading": False}
    else:
        points = load_cloud(path).points
        shape, values = pyvista.PolyData(points), distances(points, reference)
        style = {"render_points_as_spheres": True, "point_size": 4}
    plotter.add_mesh(shape, scalars=values, cmap="YlOrRd", clim=(0, limit), show_scalar_bar=False, **style)
    plotter.camera_position = [(2.2, -2.8, 1.6), (0, 0, 0), (0, 0, 1)]


def main() -> None:
    """Read the rows, draw the kept outputs of one task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results")
    parser.add_argument("picture")
    parser.add_argument("--task", default="reconstruct")
    parser.add_argument("--dataset", default="", help="one, or several with commas")
    parser.add_argument("--method", default="", help="one, or several with commas")
    parser.add_argument("--limit", type=float, default=0.015, help="distance at the end of the colour scale")
    args = parser.parse_args()
    rows = Results(args.results).rows()
    rows = rows[(rows["task"] == args.task) & (rows["seed"] == 0) & (rows["output"].fillna("") != "")]
    if args.dataset:
        rows = rows[rows["dataset"].str.startswith(tuple(args.dataset.split(",")))]
    if args.method:
        rows = rows[rows["method"].isin(args.method.split(","))]
    cases = sorted({(d, c) for d, c in zip(rows["dataset"], rows["case"], strict=True)})
    methods = sorted(rows["method"].unique())
    plotter = pyvista.Plotter(
        off_screen=True, shape=(len(cases), len(methods)), window_size=(260 * len(methods), 260 * len(cases))
    )
    for i, (dataset, case) in enumerate(cases):
        for j, method in enumerate(methods):
            plotter.subplot(i, j)
            plotter.background_color = "white"
            kept = rows[(rows["dataset"] == dataset) & (rows["case"] == case) & (rows["method"] == method)]
            if kept.empty:
                plotter.add_text(f"{method}: nothing", font_size=9, color="black")
                continue
            path = Path(kept.iloc[0]["output"])
            name = dataset.partition("[")[0]
            reference = load_mesh(path.parent.parent / "references" / f"{name}-{case}.ply")
            draw(plotter, path, args.task, reference, f"{method}  {case}", args.limit)
    plotter.screenshot(args.picture)


if __name__ == "__main__":
    main()
