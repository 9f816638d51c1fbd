"""Folders of images in the layouts of other programs, written from views with known cameras."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from bench import Frame, Views
from bench.contract.ball_views import views_of_a_ball

CENTER, RADIUS = np.array([10.0, -4.0, 2.0]), 3.0


def ball(count: int = 12, pixels: int = 64) -> Views:
    """Images of a ball of radius 3 at (10, -4, 2), with cameras in those coordinates and another K for each."""
    views = views_of_a_ball(count, pixels).in_frame(Frame(tuple(-CENTER / RADIUS), 1 / RADIUS))
    return Views(views.images, views.masks, views.extrinsics, views.intrinsics)


def pictures(folder: Path, arrays: np.ndarray, digits: int = 3, ending: str = "png") -> None:
    folder.mkdir(parents=True)
    for place, array in enumerate(arrays):
        Image.fromarray(array).save(folder / f"{place:0{digits}d}.{ending}")


def opengl(views: Views, view: int) -> list[list[float]]:
    """Camera to world with x right, y up, z backward, column by column."""
    rotation = views.extrinsics[view, :, :3]
    right, down, forward = rotation
    columns = [right, -down, -forward, views.centers[view]]
    return np.vstack([np.column_stack(columns), [0, 0, 0, 1]]).tolist()


def write_blender(views: Views, folder: Path) -> Path:
    """As Blender's synthetic set: camera_angle_x, names without endings, RGBA."""
    alpha = np.where(views.masks, 255, 0).astype(np.uint8)
    pictures(folder / "train", np.concatenate([views.images, alpha[..., None]], axis=-1))
    angle = 2 * np.arctan(views.width / 2 / views.intrinsics[0, 0, 0])
    frames = [{"file_path": f"./train/{v:03d}", "transform_matrix": opengl(views, v)} for v in range(len(views))]
    content = {"camera_angle_x": angle, "frames": frames}
    (folder / "transforms_train.json").write_text(json.dumps(content))
    return folder / "transforms_train.json"


def write_dtu(views: Views, folder: Path, scale: bool = True) -> Path:
    """As DTU in IDR and NeuS: cameras_sphere.npz, image/000000.png, mask/000.png in RGB."""
    pictures(folder / "image", views.images, digits=6)
    pictures(folder / "mask", np.repeat(255 * views.masks[..., None].astype(np.uint8), 3, axis=-1))
    arrays = {}
    for view in range(len(views)):
        by_centers = views.intrinsics[view] - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        factor = (-1) ** view * (view + 1)  # projections have no scale
        arrays[f"world_mat_{view}"] = np.vstack([factor * by_centers @ views.extrinsics[view], [0, 0, 0, 1]])
        if scale:
            turn = Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix()
            arrays[f"scale_mat_{view}"] = np.eye(4)
            arrays[f"scale_mat_{view}"][:3] = np.column_stack([1.2 * RADIUS * turn, CENTER])
    np.savez(folder / "cameras_sphere.npz", **arrays)
    return folder / "cameras_sphere.npz"


def write_colmap(views: Views, folder: Path, model: str = "PINHOLE", extra: tuple[float, ...] = ()) -> Path:
    """As COLMAP's text model in sparse/0, with images in images/ and masks in masks/NAME.png.png."""
    pictures(folder / "images", views.images)
    pictures(folder / "masks", 255 * views.masks.astype(np.uint8), ending="png.png")
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    (fx, _, cx), (_, fy, cy), _ = views.intrinsics[0]
    focal = (fx,) if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL") else (fx, fy)
    numbers = " ".join(repr(float(n)) for n in (*focal, cx, cy, *extra))
    (sparse / "cameras.txt").write_text(f"# a comment\n7 {model} {views.width} {views.height} {numbers}\n")
    lines = ["# two lines for each image"]
    for view, extrinsics in reversed(list(enumerate(views.extrinsics))):
        quaternion = Rotation.from_matrix(extrinsics[:, :3]).as_quat(scalar_first=True)
        numbers = " ".join(repr(float(n)) for n in (*quaternion, *extrinsics[:, 3]))
        lines += [f"{view + 1} {numbers} 7 {view:03d}.png", "1.5 2.5 -1 3.5 4.5 11" if view % 2 else ""]
    (sparse / "images.txt").write_text("\n".join(lines) + "\n")
    return sparse / "cameras.txt"
