"""Colours of errors: from pale yellow (no error) over red to dark violet, evenly, for every kind of colour vision.

The map is matplotlib's ``magma`` (by N. Smith and S. van der Walt, CC0), from light to dark and without its darkest
eighth, where shading could not be seen. Equal steps look equally large, lightness falls all the way, so the order
survives a grey print and the common kinds of colour blindness.
"""

from __future__ import annotations

import numpy as np

_HEX = (
    "fcfdbffcfbbdfcfabcfcf8bafcf6b8fcf5b7fcf3b5fcf2b3fcf0b2fceeb0fcedaffdebadfdeaabfde8aafde6a8fde5a6fde3a5fde2a3"
    "fde0a2fddea0fddd9ffddb9dfdda9cfed89afed699fed597fed396fed294fed093fece91fecd90fecb8efec98dfec88bfec68afec589"
    "fec387fec186fec085febe83febd82febb81feb97ffeb87efeb67dfeb47cfeb37afeb179feb078feae77feac76feab74fea973fea772"
    "fea671fea470fea26ffea16efe9f6dfe9d6cfd9c6bfd9a6afd9969fd9768fd9567fd9466fd9266fc9065fc8f64fc8d63fc8b63fc8a62"
    "fc8861fb8661fb8560fb835ffb815ffa805efa7e5efa7c5ef97b5df9795df9775df8765cf8745cf7725cf7715cf66f5cf66d5cf56c5c"
    "f56a5cf4695cf4675cf3665cf3645cf2635df1615df0605df05e5eef5d5eee5b5eed5a5fec595feb5860eb5661ea5561e95462e85362"
    "e75163e55064e44f64e34e65e24d66e14c66e04b67df4a68dd4968dc4869db486ada476bd8466bd7456cd6446dd5446dd3436ed2426f"
    "d0416fcf4170ce4070cc3f71cb3f72ca3e72c83d73c73d73c53c74c43c75c33b75c13b76c03a76be3a77bd3977bb3878ba3878b93779"
    "b73779b63679b4367ab3367ab1357bb0357bae347bad347cac337caa337da9327da7327da6317da4317ea3307ea1307ea02f7f9f2f7f"
    "9d2f7f9c2e7f9a2e7f992d80972d80962c80952c80932b80922b80902a818f2a818e2a818c29818b2981892881882881872781852781"
    "8426818226818125818025827e24827d24827b23827a2382792282772281762181752081732081721f81701f816f1e816e1e816c1d81"
    "6b1d816a1c81681c81671b80651a80641a8063198061198060187f5f187f5d177f5c167f5b167e59157e58157e56147d55147d54137d"
    "52137c51127c4f127b4e117b4d117a4b117a4a1079481078471078451077440f76420f75410f743f0f733e0f723c0f713b0f6f390f6e"
    "38106d36106b35106a3310683210663011642f11632d11612c115f2a115d29115b28115926125625125424115222115021114e20114c"
    "1f114a1d11471c11451b1043"
)
ERROR = np.frombuffer(bytes.fromhex("".join(_HEX)), dtype=np.uint8).reshape(256, 3)  # row 0: no error; read only
PLAIN = (205, 210, 216)  # of shapes without error: inputs and references
# Okabe and Ito's eight colours, which are distinct under the common kinds of colour blindness; black comes last.
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")


def indices(values: np.ndarray, limit: float) -> np.ndarray:
    """The row of the map for each value: 0 for no error, 255 at the limit and beyond; (n,) uint8.

    Parameters
    ----------
    values : (n,) array
        Distances, 0 or more. Values that are not finite count as beyond the limit.
    limit : float
        The value at the end of the scale. 0 means that all are equal to the reference: then all is row 0.
    """
    values = np.asarray(values, dtype=np.float64)
    if not limit > 0:
        return np.zeros(len(values), dtype=np.uint8)
    share = np.nan_to_num(values / limit, nan=1.0, posinf=1.0, neginf=0.0)
    return np.round(np.clip(share, 0, 1) * 255).astype(np.uint8)


def colors(values: np.ndarray, limit: float) -> np.ndarray:
    """The colour of each value, (n, 3) uint8; see :func:`indices`."""
    return ERROR[indices(values, limit)]
