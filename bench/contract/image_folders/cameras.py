"""Camera matrices of other programs to extrinsics ``[R | t]`` and intrinsics ``K`` with the axes of OpenCV."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput

LARGEST = 1e15  # number in a camera file: products and powers stay finite; a larger one means a damaged file
LOOSE = 1e-2  # tolerance of a rotation in a file, which may be rounded


def nearest_rotation(matrix: np.ndarray, where: str) -> np.ndarray:
    """The rotation (3, 3) nearest to a matrix that is one up to scale and rounding.

    Raises
    ------
    BadInput
        If it is mirrored or sheared; ``where`` names it.
    """
    determinant = np.linalg.det(matrix)
    scaled = matrix / max(abs(determinant), 1e-300) ** (1 / 3)
    if not determinant > 0 or np.abs(scaled @ scaled.T - np.eye(3)).max() > LOOSE:
        what = "is mirrored (its determinant is negative)" if determinant < 0 else "is not a rotation"
        raise BadInput(f"{where}: {what}; expected a rotation, up to a scale: three axes at right angles, right-handed")
    u, _, v = np.linalg.svd(scaled)
    return u @ v


def from_opengl(matrix: np.ndarray, where: str) -> np.ndarray:
    """Extrinsics (3, 4) from a camera-to-world matrix (3, 4) or (4, 4) with x to the right, y up and z backward."""
    rotation = nearest_rotation(matrix[:3, :3], where) * [1, -1, -1]
    return np.column_stack([rotation.T, -rotation.T @ matrix[:3, 3]])


def to_opengl(extrinsics: np.ndarray) -> np.ndarray:
    """The inverse of :func:`from_opengl`: a (4, 4) array."""
    matrix = np.eye(4)
    matrix[:3, :3] = extrinsics[:, :3].T * [1, -1, -1]
    matrix[:3, 3] = -extrinsics[:, :3].T @ extrinsics[:, 3]
    return matrix


def from_quaternion(quaternion: np.ndarray, shift: np.ndarray, where: str) -> np.ndarray:
    """Extrinsics (3, 4) from a world-to-camera quaternion (w, x, y, z) and translation, as COLMAP has them."""
    from scipy.spatial.transform import Rotation

    if not 0.5 < np.linalg.norm(quaternion) < 2:
        raise BadInput(f"{where}: expected a quaternion QW QX QY QZ of length 1, got {quaternion.tolist()}")
    return np.column_stack([Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), shift])


def decomposed(projection: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsics (3, 3) and extrinsics (3, 4) of a projection ``s K [R | t]`` (3, 4), of any scale s but 0.

    The left part M of the projection is factorised as M = K R with K upper triangular (RQ decomposition). Of the signs
    that leave the product as it is, those with a positive diagonal of K are taken, and s has the sign of det M, so
    that det R = 1: points in front of the camera have a positive depth.
    """
    from scipy.linalg import rq

    determinant = np.linalg.det(projection[:, :3])
    if not abs(determinant) > 1e-12 * np.abs(projection[:, :3]).max() ** 3:
        raise BadInput(f"{where}: expected a projection K [R | t]; its left 3 x 3 part cannot be inverted")
    projection = projection * np.sign(determinant)
    upper, rotation = rq(projection[:, :3])
    signs = np.sign(np.diag(upper))
    upper, rotation = upper * signs, rotation * signs[:, None]
    shift = np.linalg.solve(upper, projection[:, 3])
    intrinsics = np.triu(upper / upper[2, 2])
    if abs(intrinsics[0, 1]) < 1e-6 * intrinsics[0, 0]:
        intrinsics[0, 1] = 0.0  # rounding, no skew
    return intrinsics, np.column_stack([nearest_rotation(rotation, where), shift])
