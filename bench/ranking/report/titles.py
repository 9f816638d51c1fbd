"""Names of metrics as a paper prints them."""

from __future__ import annotations

import re

_WORDS = {
    "l1": "L1",
    "l2": "L2",
    "p2f": "P2F",
    "p2m": "P2M",
    "s2f": "S2F",
    "iou": "IoU",
    "dtu": "DTU",
    "fscore": "F-score",
    "sq": "squared",
    "deg": "(deg)",
    "chamfer": "Chamfer",
    "hausdorff": "Hausdorff",
    "seconds": "seconds",
}


def in_words(name: str) -> str:
    """``surface_distance_mean`` -> ``Surface distance mean``; a title that is in words already stays as it is.

    Example
    -------
    >>> in_words("fscore@0.01"), in_words("chamfer_l1_mean"), in_words("CD (1e-3)")
    ('F-score 0.01', 'Chamfer L1 mean', 'CD (1e-3)')
    """
    if not re.fullmatch(r"[a-z0-9_]+(@[\w.]+)?", name):
        return name
    stem, _, threshold = name.partition("@")
    words = [_WORDS.get(word, word) for word in stem.split("_") if word] or [stem]
    first = words[0] if len(name) < 3 else words[0][:1].upper() + words[0][1:]
    return " ".join(filter(None, [first, *words[1:], threshold]))
