"""Views to a folder of images with a ``transforms.json``."""

from __future__ import annotations

import json
from pathlib import Path

from ...errors import BadInput
from ..views import Views
from .cameras import to_opengl


def save_views_as_transforms(views: Views, folder: str | Path) -> None:
    """Write ``images/000.png``, ``masks/000.png`` and so on, and ``transforms.json`` with the cameras.

    instant-ngp, nerfstudio and ``detailbench apply task=multiview`` read such a folder. Lights are not stored.

    Raises
    ------
    BadInput
        If a camera has skew, which the format cannot store.
    """
    from PIL import Image

    if views.intrinsics[:, 0, 1].any():
        raise BadInput(f"{folder}: transforms.json cannot store the skew of a camera; expected intrinsics without skew")
    folder = Path(folder)
    frames = []
    for view in range(len(views)):
        names = {"file_path": f"images/{view:03d}.png", "mask_path": f"masks/{view:03d}.png"}
        for name, pixels in zip(names.values(), (views.images[view], views.masks[view]), strict=True):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(folder / name)
        (fx, _, cx), (_, fy, cy), _ = views.intrinsics[view].tolist()
        pose = to_opengl(views.extrinsics[view]).tolist()
        frames.append(names | {"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "transform_matrix": pose})
    content = {"w": views.width, "h": views.height, "camera_model": "PINHOLE", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
