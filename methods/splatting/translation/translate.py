"""Application of the network to an image."""

from __future__ import annotations

import numpy as np
import torch

from .generator import Generator


def translated(image: np.ndarray, network: Generator, device: str = "cpu") -> np.ndarray:
    """The output of a network for an image.

    Parameters
    ----------
    image : (h, w, 3) array
        0 in the background.
    network : Generator
        On the device.
    device : str

    Returns
    -------
    (h, w, 3) float64 array
        Each channel is clamped to the least and the largest value of the drawn pixels of the input.
    """
    covered = (image > 0).any(axis=2)
    if not covered.any():
        return np.array(image, dtype=np.float64)
    given = torch.from_numpy(np.ascontiguousarray(image, dtype=np.float32)).to(device)
    with torch.no_grad():
        made = network(given.permute(2, 0, 1)[None].contiguous(memory_format=torch.channels_last))
    made = made[0].permute(1, 2, 0).cpu().numpy().astype(np.float64)
    colors = image[covered]
    return np.clip(made, colors.min(axis=0), colors.max(axis=0))
