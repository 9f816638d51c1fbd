"""Pictures of deformations: alignment against distortion, and source, cages, results and target side by side.

    detailbench run experiment=figure_5_6 results=results/figure_5_6
    python docs/cages.py front results/figure_5_6 docs/cages_front.png
    python docs/cages.py strips results/figure_5_6 docs/cages_strips.png --case 000,001
    python docs/cages.py bounds --category chair,table,shelf
    python docs/cages.py tightness results/table_5_1a

(`strips` with pyvista, from the extra `render`.) `front` draws each method by its means of two scores, with the Pareto
front (figure 5.6), and prints them. `strips` has a row for each case: the source (the output of `identity`), its cage
and the deformed cage where a method stored them, the result of each method, and the target. `bounds` prints what the
best affine map and the best cage of 42 vertices reach that know where each vertex belongs (pairs with the same parts).
`tightness` prints how the cages of table 5.1a lie around their vases: their volume, relative to that of the vase's
convex hull, and the negative coordinates of Eq. 5.4.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from bench.geometry.io.files import load_mesh
from bench.ranking.fronts import on_front
from bench.ranking.report.labels import label
from bench.results.store import Results

SCORES = ("recentred_chamfer_l2_sum@5000", "cot_laplacian_box")


def rows_of(folder: str) -> pd.DataFrame:
    """The solved cases, with a readable name of each method and its parameters."""
    rows = Results(folder).rows()
    rows = rows[rows["status"] == "ok"]
    own = ("," + rows["variant"].fillna("")).str.split(",weights=").str[0].str[1:]
    return rows.assign(line=[label(m, v) for m, v in zip(rows["method"], own, strict=True)])


def front(args: argparse.Namespace) -> None:
    """Figure 5.6."""
    rows = rows_of(args.results)
    rows = rows[~rows["method"].isin(["noise"])]
    means = rows.groupby("line")[[f"score.{name}" for name in (args.x, args.y)]].mean().dropna()
    chosen = means[on_front(means.to_numpy())].sort_values(means.columns[0])
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    axes.step(*chosen.to_numpy().T, where="post", color="tab:gray", linestyle="--", label="Pareto front")
    for name, (x, y) in means.iterrows():
        axes.scatter(x, y, color="tab:red" if name.startswith("neural_cages") else "tab:blue")
        axes.annotate(f" {name}", (x, y), fontsize=8)
    axes.set(xlabel=f"alignment: {args.x}", ylabel=f"distortion: {args.y}", xscale="log")
    axes.set_ylim(bottom=0, top=args.top)
    axes.legend()
    figure.savefig(args.picture, dpi=120)
    print(means.to_string(float_format=lambda value: f"{value:.4g}"))


def strips(args: argparse.Namespace) -> None:
    """A row for each case."""
    import pyvista

    results, rows = Results(args.results), rows_of(args.results)
    rows = rows[[any(part in case for part in args.case.split(",")) for case in rows["case"]]]
    names = [name for name in rows["line"].unique() if name not in ("identity", "noise")]
    names = args.method.split(",") if args.method else names
    caged = [name for name in names if name.startswith(("neural_cages", "character_cages", "cage_per_pair"))][:1]
    cages = [f"{what} {name}" for name in caged for what in ("cage of", "moved by")]
    columns = ["source", *cages, *names, "target"]
    cases = sorted(rows["case"].unique())
    size = (230 * len(columns), 230 * len(cases))
    plotter = pyvista.Plotter(off_screen=True, shape=(len(cases), len(columns)), window_size=size)
    for i, case in enumerate(cases):
        here = rows[rows["case"] == case].set_index("line")
        outputs = {name: results.output_of(dict(here.loc[name])) for name in here.index}
        folders = {name: Path(path).with_suffix("") for name, path in outputs.items() if path}
        paths = {"source": outputs.get("identity"), "target": results.reference_of(dict(here.iloc[0])), **outputs}
        for name in caged:
            if name in folders:
                paths |= {f"cage of {name}": folders[name] / "cage.ply"}
                paths |= {f"moved by {name}": folders[name] / "deformed_cage.ply"}
        for j, name in enumerate(columns):
            plotter.subplot(i, j)
            plotter.add_text(name if i == 0 else "", font_size=6, color="black")
            if (path := paths.get(name)) and Path(path).exists():
                mesh = load_mesh(path)
                shape = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
                color = {"source": "peru", "target": "yellowgreen"}.get(name, "black" if name in cages else "skyblue")
                plotter.add_mesh(shape, color=color, style="wireframe" if name in cages else "surface")
            away = 2.2 if name in cages else 1.0
            plotter.camera_position = [(2.2 * away, -2.8 * away, 1.6 * away), (0, 0, 0), (0, 0, 1)]
    plotter.background_color = "white"
    plotter.screenshot(args.picture)


def bounds(args: argparse.Namespace) -> None:
    """The scores of the best affine map, the best cage, and the target itself, by least squares over the vertices."""
    import torch

    from bench.datasets.furniture import Furniture
    from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
    from bench.methods.cages.meshes.round_cages import sphere_cage
    from bench.metrics.cot_laplacian import CotLaplacian
    from bench.metrics.recentred_chamfer_l2_sum import RecentredChamferL2Sum
    from bench.tasks.deform import Deform

    cage, faces = sphere_cage()
    lines = []
    for category in args.category.split(","):
        recipes = Deform().recipes(Furniture(category=category), None, split=args.split, count=args.cases, seed=0)
        for case in (recipe.build() for recipe in recipes):
            source, wanted = case.input["source"], np.asarray(case.reference.mesh.vertices)
            vertices = np.asarray(source.vertices)
            around = cage * np.ptp(vertices, axis=0) / 2  # the template, fitted to the source's box
            place, walls = (torch.from_numpy(array)[None] for array in (vertices, around))
            bases = {
                "best affine": np.column_stack([vertices, np.ones(len(vertices))]),
                "best cage of 42 vertices": mean_value_coordinates(place, walls, faces, 1)[0].numpy(),
            }
            places = {name: basis @ np.linalg.lstsq(basis, wanted, rcond=1e-6)[0] for name, basis in bases.items()}
            for name, moved in {"source": vertices, **places, "target": wanted}.items():
                output = source.copy()
                output.vertices = moved
                scores = RecentredChamferL2Sum().score(output, case) | CotLaplacian().score(output, case)
                lines.append({"category": category, "what": name} | {key: scores[key] for key in SCORES})
    means = pd.DataFrame(lines).groupby(["category", "what"], sort=False).mean()
    print(means.to_string(float_format=lambda value: f"{value:.4g}"))


def tightness(args: argparse.Namespace) -> None:
    """Volume and negative coordinates of the cages of vases."""
    import torch
    from scipy.spatial import ConvexHull

    from bench.datasets.vases import Vases
    from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
    from bench.tasks.deform import Deform

    results, rows = Results(args.results), rows_of(args.results)
    recipes = Deform().recipes(Vases(columns=64), None, split="test", count=rows["case"].nunique(), seed=0)
    lines = []
    for case in (recipe.build() for recipe in recipes):
        points = np.asarray(case.input["source"].vertices)
        for _, row in rows[rows["case"] == case.id].iterrows():
            cage = load_mesh(Path(results.output_of(dict(row))).with_suffix("") / "cage.ply")
            place, walls = (torch.from_numpy(np.asarray(array))[None] for array in (points, cage.vertices))
            negative = mean_value_coordinates(place, walls, cage.faces, 1)[0].numpy().clip(max=0)
            volume = ConvexHull(cage.vertices).volume / ConvexHull(points).volume
            facts = {"volume of the cage": volume, "Eq. 5.4": np.mean(negative**2), "negative": -negative.sum(1).mean()}
            lines.append({"method": row["line"]} | facts)
    print(pd.DataFrame(lines).groupby("method").mean().to_string(float_format=lambda value: f"{value:.2g}"))


def main() -> None:
    """Draw what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, function in (("front", front), ("strips", strips)):
        command = commands.add_parser(name)
        command.add_argument("results")
        command.add_argument("picture")
        command.set_defaults(function=function)
        if name == "front":
            command.add_argument("--x", default=SCORES[0], help="a score")
            command.add_argument("--y", default=SCORES[1], help="a score")
            command.add_argument("--top", type=float, help="end of the axis of the second score")
        else:
            command.add_argument("--case", default="", help="parts of the names of cases, with commas")
            command.add_argument("--method", default="", help="one, or several with commas")
    command = commands.add_parser("bounds")
    command.set_defaults(function=bounds)
    command.add_argument("--category", default="chair,table,shelf", help="of furniture, with commas")
    command.add_argument("--cases", type=int, default=8, help="pairs of each")
    command.add_argument("--split", default="test")
    command = commands.add_parser("tightness")
    command.set_defaults(function=tightness)
    command.add_argument("results")
    args = parser.parse_args()
    args.function(args)


if __name__ == "__main__":
    main()
