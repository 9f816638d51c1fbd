"""Pictures of surface splatting: how a pixel pulls at a point, and points on their way to the images.

    python docs/splats.py pull docs/splats_pull.png
    python docs/splats.py film docs/splats_teapot.png --dataset teapots --method dss --points 1000
    python docs/splats.py film docs/splats_square.png --method dss_square --start square --views 1

`pull` draws and prints figure 3.18: the gradient of one point by one pixel, for five widths of its Gaussian, by
visibility and by the derivative of the Gaussian, and how many steps each needs to reach the pixel. `film` fits a method
to images and draws every few of its clouds as one of the images shows it: drawn, its residual, and the points alone; a
name that ends with `.gif` becomes a film. It prints how much of the silhouettes is covered.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from bench import PointCloud, Run, generator
from bench.geometry.spacing import mean_spacing
from bench.methods.splatting.fitting.views import Gallery
from bench.methods.splatting.renderer.camera import Camera
from bench.methods.splatting.renderer.drawn import draw
from bench.methods.splatting.renderer.settings import Drawing
from bench.plugins.presets import presets
from bench.plugins.registry import registry
from bench.plugins.schema import build
from bench.tasks.fit_shape import FitShape

PIXELS, DEPTH, FOCAL = 128, 4.0, 100.0
SIGMAS = (0.5, 1.0, 2.0, 4.0, 8.0)  # pixels


def one_point(column: float, sigma: float, gradient: str, target: int) -> tuple[float, float]:
    """The gradient of a white point's column by one pixel that wants to be white, and how bright it is."""
    camera = Camera.looking_at(np.array([0, 0, -DEPTH]), np.zeros(3), np.array([0, -1.0, 0]), FOCAL, PIXELS, PIXELS)
    place = np.array([[(column - PIXELS / 2) * DEPTH / FOCAL, 0.5 * DEPTH / FOCAL, 0.0]])
    how = Drawing(gradient=gradient, opening=0.0, blur=1e-3)
    normal, white = np.array([[0, 0, -1.0]]), np.ones((1, 1))
    drawn = draw(place, normal, white, sigma * DEPTH / FOCAL, camera, how, 1)
    slope = np.zeros((PIXELS, PIXELS, 1))
    slope[PIXELS // 2, target] = -1.0
    across = drawn.position_gradient(slope)[0] @ camera.rotation.T * DEPTH / FOCAL
    return float(across[0]), float(drawn.image[PIXELS // 2, target, 0])


def steps_to_reach(start: float, sigma: float, gradient: str, target: int, rate: float = 4.0, most: int = 500) -> int:
    """Steps of a descent, of at most two pixels each, until the point covers the pixel; ``most`` if it does not."""
    column = start
    for step in range(most):
        slope, bright = one_point(column, sigma, gradient, target)
        if bright > 0.5:
            return step
        column -= np.clip(rate * slope, -2, 2)
    return most


def pull(picture: Path) -> None:
    """Figure 3.18."""
    target, far = 20, np.arange(25.5, 100.5, 1.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    print(f"{'gradient':10}{'sigma':>7}{'at 10 px':>12}{'at 40 px':>12}{'steps from 40 px':>18}")
    for axes, gradient in ((left, "dss"), (right, "rbf")):
        lines = []
        for sigma in SIGMAS:
            line = np.array([abs(one_point(column, sigma, gradient, target)[0]) for column in far])
            lines.append(line)
            axes.semilogy(far - target - 0.5, np.where(line > 0, line, np.nan), label=f"sigma {sigma:g} px")
            near, away = line[np.searchsorted(far, target + 10.5)], line[np.searchsorted(far, target + 40.5)]
            steps = steps_to_reach(target + 40.5, sigma, gradient, target)
            print(f"{gradient:10}{sigma:7g}{near:12.3g}{away:12.3g}{steps if steps < 500 else 'never':>18}")
        beyond = np.array(lines)[:, far - target > np.sqrt(2) * max(SIGMAS) + 1]
        low, high = beyond.min(axis=0), beyond.max(axis=0)
        ratio = np.divide(high, low, out=np.full_like(high, np.inf), where=low > 0)
        print(f"{gradient}: largest over smallest gradient among the widths, over all distances: {ratio.max():.7g}")
        axes.set(title=gradient, xlabel="pixels from the point", ylabel="size of the gradient", ylim=(1e-12, 2))
        axes.legend()
    figure.savefig(picture, dpi=110)


def configured(kind: str, name: str, **values):
    """A plugin by its name, or that of a preset."""
    preset = presets(kind).get(name)
    plugin = registry().find(kind, preset.plugin if preset else name)
    return build(plugin, (dict(preset.values) if preset else {}) | values)


def film(args: argparse.Namespace) -> None:
    """Points on their way."""
    dataset = configured("dataset", args.dataset)
    shape = next(s for n, s in enumerate(dataset.shapes("train")) if n == args.shape).framed()[0]
    views = configured("sensor", "rig", resolution=args.pixels, views=args.views).sense(shape, generator(0, "film"))
    given = FitShape(start=args.start, points=args.points, size=args.size).input(views)
    clouds: list[PointCloud] = [given["cloud"]]

    def keep(cloud, *_, **__) -> None:
        clouds.append(cloud() if callable(cloud) else cloud)

    run = Run(threads=args.threads, seed=1, on_trace=keep)
    method = configured(
        "method", args.method, **{name: float(value) for name, value in (part.split("=") for part in args.set)}
    )
    clouds.append(method.fit_shape(run=run, **given))
    gallery = Gallery.of(views, Drawing(), args.threads)
    sigma = 0.8 * mean_spacing(given["cloud"].points)
    chosen = np.unique(np.linspace(0, len(clouds) - 1, args.columns).round().astype(int))
    frames = [frame(gallery, views, clouds[number], sigma, args.view) for number in chosen]
    for number in (0, len(clouds) - 1):
        inside, beside = coverage(gallery, views, clouds[number], sigma)
        print(f"cloud {number}: {inside:.1%} of the silhouettes covered; of what is drawn, {beside:.1%} beside them")
    if args.picture.suffix == ".gif":
        from PIL import Image

        images = [Image.fromarray(np.concatenate([views.images[args.view], *each], axis=1)) for each in frames]
        images[0].save(args.picture, save_all=True, append_images=images[1:], duration=400, loop=0)
        return
    wanted = np.concatenate(
        [views.images[args.view], np.zeros_like(views.images[args.view]), np.zeros_like(views.images[args.view])]
    )
    plt.imsave(args.picture, np.concatenate([wanted, *(np.concatenate(each) for each in frames)], axis=1))


def frame(gallery: Gallery, views, cloud: PointCloud, sigma: float, view: int) -> list[np.ndarray]:
    """What one view shows of a cloud: drawn, what is wrong, and its points; (h, w, 3) uint8 arrays."""
    points, normals = cloud.points, cloud.normals
    dots = np.zeros_like(views.images[view])
    pixels, _ = views.project(points)
    columns, rows = np.floor(pixels[view]).astype(int).T
    inside = (columns >= 0) & (columns < views.width) & (rows >= 0) & (rows < views.height)
    dots[views.masks[view]] = 70
    dots[rows[inside], columns[inside]] = 255
    if normals is None:
        return [dots, dots, dots]
    drawn = gallery.draw(points, normals, sigma, view).image.clip(0, 1)
    image = (255 * drawn).astype(np.uint8)
    return [image, (255 * np.abs(drawn - gallery.wanted[view])).astype(np.uint8), dots]


def coverage(gallery: Gallery, views, cloud: PointCloud, sigma: float) -> tuple[float, float]:
    """How much of the silhouettes the points cover, and how much of what they cover is beside them."""
    if cloud.normals is None:
        return np.nan, np.nan
    drawn = np.array(
        [gallery.draw(cloud.points, cloud.normals, sigma, view).covered for view in range(len(gallery.cameras))]
    )
    return (drawn & views.masks).sum() / views.masks.sum(), (drawn & ~views.masks).sum() / max(drawn.sum(), 1)


def main() -> None:
    """Which picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("pull").add_argument("picture", type=Path)
    films = kinds.add_parser("film")
    films.add_argument("picture", type=Path)
    films.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of the method")
    for name, default in (("dataset", "teapots"), ("method", "dss"), ("start", "sphere")):
        films.add_argument(f"--{name}", default=default)
    numbers = {"view": 0, "shape": 0, "points": 1000, "pixels": 128, "views": 24, "columns": 7, "threads": 1}
    for name, number in numbers.items():
        films.add_argument(f"--{name}", type=int, default=number)
    films.add_argument("--size", type=float, default=0.7)
    args = parser.parse_args()
    if args.kind == "pull":
        pull(args.picture)
    else:
        film(args)


if __name__ == "__main__":
    main()
