"""Pictures of kept outputs, without a display: a row for each case; the reference, then a column for each method.

    detailbench run experiment=first_table results=results/first_table
    python docs/render.py results/first_table docs/outputs.png --dataset bumps,cad \\
        --method poisson,ball_pivoting,apss,rimls

(with pyvista, from the extra `render`)

takes the files that `outputs=first` or `outputs=all` kept. Colour is the distance to the reference, in its radii. A
method with several sets of parameters has a column for each. `--surfaces` shows, of clouds, the screened Poisson
surface that they give with normals estimated of 25 neighbours, as figures 3.7 to 3.9 of the thesis do.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyvista

from bench import PointCloud, Run
from bench.geometry.io.files import load_cloud, load_mesh
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.normals import oriented_normals
from bench.plugins.registry import registry
from bench.results.store import Results


def distances(points: np.ndarray, reference) -> np.ndarray:
    """Distance of each point (n, 3) to the reference mesh."""
    closest, _ = MeshSurface(reference).closest(points)
    return np.linalg.norm(points - closest, axis=1)


def surface_of(path: Path):
    """The screened Poisson surface (depth 9) of a cloud, with normals estimated of 25 neighbours."""
    points = load_cloud(path).points
    cloud = PointCloud(points, oriented_normals(points, 25))
    return registry().find("method", "poisson").cls(depth=9).reconstruct(cloud, run=Run())


def draw(plotter: pyvista.Plotter, path: Path, kind: str, reference, title: str, limit: float) -> None:
    """One output, of a kind ``mesh``, ``cloud`` or ``surface`` (of a cloud), in the current cell of the picture."""
    plotter.add_text(title, font_size=7, color="black")
    if kind != "cloud":
        mesh = load_mesh(path) if kind == "mesh" else surface_of(path)
        shape = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        values = distances(mesh.vertices, reference)
        style = {"smooth_shading": False}
    else:
        points = load_cloud(path).points
        shape, values = pyvista.PolyData(points), distances(points, reference)
        style = {"render_points_as_spheres": True, "point_size": 4}
    plotter.add_mesh(shape, scalars=values, cmap="YlOrRd", clim=(0, limit), show_scalar_bar=False, **style)
    plotter.camera_position = [(2.2, -2.8, 1.6), (0, 0, 0), (0, 0, 1)]


def labels(rows: pd.DataFrame) -> pd.Series:
    """For each row the method, and line by line what tells it from other rows: its settings, its task's, its sensor."""
    settings = rows["variant"].fillna("").map(lambda text: re.findall(r"\w+=(?:\[[^]]*\]|[^,]*)", text))
    common = {method: set.intersection(*map(set, group)) for method, group in settings.groupby(rows["method"])}
    found = []
    for own, row in zip(settings, rows.to_dict("records"), strict=True):
        lines = [row["method"], *(part for part in own if part not in common[row["method"]])]
        lines += [row["task"].partition("[")[2].rstrip("]")] if "[" in row["task"] else []
        lines += [row["sensor"]] if rows["sensor"].nunique() > 1 else []
        found.append("\n".join(lines))
    return pd.Series(found, rows.index)


def main() -> None:
    """Read the rows, draw the kept outputs of one task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results")
    parser.add_argument("picture")
    parser.add_argument("--task", default="", help="needed where outputs of several tasks were kept")
    parser.add_argument("--dataset", default="", help="one, or several with commas")
    parser.add_argument("--method", default="", help="one, or several with commas")
    parser.add_argument("--case", default="", help="parts of the names of cases, with commas")
    parser.add_argument("--surfaces", action="store_true", help="of clouds: show the surfaces that they give")
    parser.add_argument("--limit", type=float, default=0.015, help="distance at the end of the colour scale")
    args = parser.parse_args()
    results = Results(args.results)
    rows = results.rows()
    rows = rows[(rows["output"].fillna("") != "") & (rows["seed"] == 0)]
    rows = rows.assign(output=[results.output_of(row) for row in rows.to_dict("records")])
    rows = rows[rows["output"].notna()]
    kinds = rows["task"].str.partition("[")[0]
    tasks = [args.task] if args.task else sorted(set(kinds))
    if len(tasks) > 1:
        parser.error(f"{args.results} has outputs of {', '.join(tasks)}: choose one with --task")
    rows = rows[kinds.isin(tasks)]
    if args.dataset:
        rows = rows[rows["dataset"].str.startswith(tuple(args.dataset.split(",")))]
    if args.method:
        rows = rows[rows["method"].isin(args.method.split(","))]
    rows = rows[[any(part in case for part in args.case.split(",")) for case in rows["case"]]]
    if rows.empty:
        parser.error(f"{args.results} has no such outputs; expected a folder that a run with outputs=all wrote")
    rows = rows.assign(label=labels(rows))
    cases = sorted({(d, c) for d, c in zip(rows["dataset"], rows["case"], strict=True)})
    columns = sorted(rows["label"].unique())
    kind = registry().find("task", tasks[0]).cls.output
    kind = "surface" if kind == "cloud" and args.surfaces else kind
    plotter = pyvista.Plotter(
        off_screen=True, shape=(len(cases), 1 + len(columns)), window_size=(260 * (1 + len(columns)), 260 * len(cases))
    )
    for i, (dataset, case) in enumerate(cases):
        of_case = rows[(rows["dataset"] == dataset) & (rows["case"] == case)]
        here = of_case.set_index("label")["output"]
        path = next(filter(None, map(results.reference_of, of_case.to_dict("records"))), None)
        if path is None:
            parser.error(f"{results.folder}: the reference of {case} is not below outputs/references")
        reference = load_mesh(path)
        plotter.subplot(i, 0)
        draw(plotter, path, "mesh", reference, case, args.limit)
        for j, name in enumerate(columns, 1):
            plotter.subplot(i, j)
            if name in here:
                draw(plotter, here[[name]].iloc[0], kind, reference, name, args.limit)
            else:
                plotter.add_text(f"{name}: nothing", font_size=7, color="black")
    plotter.background_color = "white"
    plotter.screenshot(args.picture)


if __name__ == "__main__":
    main()
