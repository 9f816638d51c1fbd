"""Pictures of the fields inside IDF: slices of its base, its displacement and their composition.

    detailbench apply method=idf scan.ply mesh.ply method.save=field.safetensors
    python docs/field_slices.py field.safetensors slices.png

(with matplotlib, which comes with the extra `render`)

Zero levels are black; the dashed line in the last two pictures is that of the base. ``--axis z --at 0`` says where the
slice lies, in the frame in which the farthest point is at radius 1. A field with one network (siren) has one picture.
"""

from __future__ import annotations

import argparse

import matplotlib
import numpy as np
import torch

from bench.methods.implicit.fields.displaced_field import DisplacedField
from bench.methods.learned.training import files
from bench.methods.learned.training.field import PART, Field
from bench.plugins.registry import registry

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def slice_points(axis: str, at: float, side: int) -> np.ndarray:
    """Points (side * side, 3) of a plane through the box [-1, 1]^3."""
    u = np.linspace(-1, 1, side)
    across, up = np.meshgrid(u, u)
    planes = {"x": (at, across, up), "y": (across, at, up), "z": (across, up, at)}
    return np.stack(np.broadcast_arrays(*planes[axis]), axis=-1).reshape(-1, 3)


def pictures(field: Field, points: np.ndarray) -> dict[str, np.ndarray]:
    """The values to draw, by title."""
    if not isinstance(field, DisplacedField):
        return {"field f": field.values(points)}
    x = torch.as_tensor(points, dtype=torch.float32)
    base, displacement = (torch.cat(part).numpy() for part in zip(*map(field.parts, x.split(PART)), strict=True))
    return {"base f": base, "displacement d": displacement, "composition f^": field.values(points)}


def draw(values: dict[str, np.ndarray], path: str) -> None:
    """One picture beside the other."""
    figure, axes = plt.subplots(1, len(values), figsize=(5 * len(values), 4.4), squeeze=False, layout="constrained")
    base = next(iter(values.values()))
    for axis, (title, value) in zip(axes[0], values.items(), strict=True):
        image = value.reshape(round(len(value) ** 0.5), -1)
        most = max(np.abs(image).max(), 1e-12)
        shown = axis.imshow(image, origin="lower", extent=(-1, 1, -1, 1), cmap="RdBu_r", vmin=-most, vmax=most)
        outline = image if "displacement" not in title else base.reshape(image.shape)
        grid = np.linspace(-1, 1, len(image))
        axis.contour(grid, grid, outline, levels=[0], colors="black", linewidths=0.8)
        if value is not base:
            axis.contour(
                grid, grid, base.reshape(image.shape), levels=[0], colors="black", linewidths=0.6, linestyles="--"
            )
        axis.set_title(title)
        axis.set_xticks([])
        axis.set_yticks([])
        figure.colorbar(shown, ax=axis, shrink=0.8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("field", help="a .safetensors file that idf or siren saved")
    parser.add_argument("picture", help="the PNG to write")
    parser.add_argument("--axis", choices="xyz", default="z", help="the slice is across this axis")
    parser.add_argument("--at", type=float, default=0.0, help="where")
    parser.add_argument("--side", type=int, default=400, help="pixels")
    args = parser.parse_args()
    name, form = files.saved_as(args.field)
    method = registry().find("method", name).cls(**form, load=args.field)
    field = method.field(torch.Generator().manual_seed(0))
    files.load(field, args.field)
    draw(pictures(field, slice_points(args.axis, args.at, args.side)), args.picture)
    print(f"{args.picture}: {name}, across {args.axis} at {args.at:g}")


if __name__ == "__main__":
    main()
