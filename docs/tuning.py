"""How parameters do on the train shapes, by the noise of the input.

    python docs/tuning.py rimls denoise filterscale=2 filterscale=3 filterscale=4 ''

Each further argument is a variant, ``key=value`` pairs separated by blanks; an empty one is the default. Shapes are the
first train shape of each of twelve families, sampled evenly (5,000 points with exact normals), with Gaussian noise of
0, 0.5, 1 and 2 % of the radius. For surfaces the figure is the exact two-way distance (the mean of output to reference
and reference to output) and the angle of the normals; where points are moved, the distance of the output to the
reference. Figures are geometric means over the shapes, so that each counts by ratio, whatever its scale.

The same choice as a sweep, with rows that are kept: ``detailbench run experiment=tune_METHOD``.
"""

from __future__ import annotations

import argparse
import time
from itertools import islice

import numpy as np
import yaml

from bench import PointCloud, Run, generator
from bench.geometry.mesh_surface import MeshSurface
from bench.plugins.registry import registry
from bench.plugins.schema import build

FAMILIES = "bumps,cad,superquadrics,supershapes,fbm,blobs,tpms,knots,smooth_csg,reliefs,branches,humanoids"
LEVELS = (0.0, 0.005, 0.01, 0.02)
SAMPLES = 10_000
RATIO = 4


def train_shape(family: str) -> tuple[MeshSurface, PointCloud, np.ndarray, np.ndarray]:
    """Reference mesh, clean input, and exact samples with normals of the first train shape."""
    dataset = build(registry().find("dataset", family), {})
    shape, _ = next(iter(islice(dataset.shapes("train"), 1))).framed()
    cloud = build(registry().find("sensor", "samples"), {"noise": 0.0}).sense(shape, generator(1, family, "input"))
    return MeshSurface(shape.mesh), cloud, *shape.surface.sample(SAMPLES, generator(1, family, "reference"))


def figures(
    output: object, reference: MeshSurface, samples: np.ndarray, normals: np.ndarray, task: str
) -> tuple[float, float]:
    """The distance (two-way for surfaces), and the mean angle of the normals in degrees (nan for points)."""
    if isinstance(output, PointCloud):
        return _distance(output.points, reference), np.nan
    surface = MeshSurface(output)
    points, _ = surface.sample(SAMPLES, generator(1, task, "output"))
    cosine = np.clip(np.abs(np.einsum("ni,ni->n", surface.closest(samples)[1], normals)), 0, 1)
    distance = (_distance(points, reference) + _distance(samples, surface)) / 2
    return distance, float(np.degrees(np.arccos(cosine)).mean())


def _distance(points: np.ndarray, surface: MeshSurface) -> float:
    return float(np.linalg.norm(surface.closest(points)[0] - points, axis=1).mean())


def parameters(text: str) -> dict[str, object]:
    """``"k=16 angle=20.0"`` as a mapping."""
    return {key: yaml.safe_load(value) for key, _, value in (word.partition("=") for word in text.split())}


def main() -> None:
    """Print a Markdown table: a line per variant, a column per level of noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("method")
    parser.add_argument("task", choices=("reconstruct", "denoise", "upsample"))
    parser.add_argument("variants", nargs="+")
    parser.add_argument("--families", default=FAMILIES)
    args = parser.parse_args()
    plugin = registry().find("method", args.method)
    scores: dict[str, list[np.ndarray]] = {variant: [] for variant in args.variants}
    for family in args.families.split(","):
        reference, clean, samples, normals = train_shape(family)
        for variant in args.variants:
            method, row = build(plugin, parameters(variant)), []
            for level in LEVELS:
                moved = clean.points + generator(2, family, "noise").normal(0, level, clean.points.shape)
                cloud, run, started = PointCloud(moved, clean.normals), Run(seed=3), time.process_time()
                if args.task == "upsample":
                    output = method.upsample(cloud, RATIO, run)
                else:
                    output = getattr(method, args.task)(cloud, run)
                seconds = time.process_time() - started
                row.append([*figures(output, reference, samples, normals, args.task), seconds])
            scores[variant].append(np.array(row))
    print("| method | task | variant | " + " | ".join(f"{100 * level:g} %" for level in LEVELS) + " | CPU s |")
    print("| --- | --- | --- |" + " --: |" * (len(LEVELS) + 1))
    for variant, rows in scores.items():
        table = np.array(rows)
        means = np.exp(np.log(np.maximum(table[..., :2], 1e-9)).mean(axis=0))
        cells = [f"{1e3 * d:.2f}" + ("" if np.isnan(a) else f" / {a:.1f}°") for d, a in means]
        name = variant or "(the defaults)"
        print(f"| {args.method} | {args.task} | {name} | {' | '.join(cells)} | {table[..., 2].mean():.2f} |")


if __name__ == "__main__":
    main()
