"""Images of superpixels (Achanta et al. 2012): each region has the mean of its colours."""

from __future__ import annotations

import numpy as np


def superpixels(image: np.ndarray, segments: int = 150, compactness: float = 20.0) -> np.ndarray:
    """The image with the mean colours of about ``segments`` regions.

    Parameters
    ----------
    image : (h, w, 3) array from 0 to 1
    segments : int
    compactness : float
        Larger makes regions rounder, smaller makes their colours more uniform.

    Returns
    -------
    (h, w, 3) float64 array
    """
    from skimage.segmentation import slic

    labels = slic(
        image,
        n_segments=segments,
        compactness=compactness,
        enforce_connectivity=False,
        start_label=0,
        channel_axis=-1,
    )
    count = np.bincount(labels.ravel()).clip(min=1)
    means = np.column_stack(
        [np.bincount(labels.ravel(), image[..., c].ravel(), minlength=len(count)) / count for c in range(3)]
    )
    return means[labels]
