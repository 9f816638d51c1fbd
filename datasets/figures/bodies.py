"""The body of the humanoids at rest: a smooth union of round cones and ellipsoids, meshed once as the template.

Round cones and the cubic smooth minimum are those of I. Quilez (iquilezles.org/articles/distfunctions, .../smin).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from .skeleton import ENDS, NAMES, REST
from .skinning import heat_weights

VERTICES = 7000  # approximate number in the template
STEP = 0.0075  # of the grid in metres, about the radius of a finger
_LOW, _HIGH = np.array([-0.7875 + 0.5 * STEP, -0.25, -0.03]), np.array([0.7875, 0.18, 1.80])

Field = Callable[[np.ndarray], np.ndarray]


def round_cone(a: object, b: object, start: float, end: float) -> Field:
    """The distance to the hull of two balls: radius ``start`` at ``a`` and ``end`` at ``b``."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    axis = b - a
    length2 = axis @ axis
    slope = start - end
    a2 = length2 - slope * slope

    def distance(x: np.ndarray) -> np.ndarray:
        offset = x - a
        y = offset @ axis
        z = y - length2
        across = offset * length2 - y[:, None] * axis
        x2 = np.einsum("ni,ni->n", across, across)
        y2, z2 = y * y * length2, z * z * length2
        k = np.sign(slope) * slope * slope * x2
        middle = (np.sqrt(np.maximum(x2 * a2 / length2, 0)) + y * slope) / length2 - start
        middle = np.where(np.sign(y) * a2 * y2 < k, np.sqrt(x2 + y2) / length2 - start, middle)
        return np.where(np.sign(z) * a2 * z2 > k, np.sqrt(x2 + z2) / length2 - end, middle)

    return distance


def ellipsoid(center: object, radii: object) -> Field:
    """The approximate distance to an ellipsoid along the axes."""
    center, radii = np.asarray(center, float), np.asarray(radii, float)

    def distance(x: np.ndarray) -> np.ndarray:
        scaled = (x - center) / radii
        k0 = np.linalg.norm(scaled, axis=1)
        k1 = np.linalg.norm(scaled / radii, axis=1)
        return k0 * (k0 - 1) / np.maximum(k1, 1e-9)

    return distance


def joined(blend: float, *fields: Field) -> Field:
    """The smooth union; surfaces nearer than ``blend`` merge."""

    def distance(x: np.ndarray) -> np.ndarray:
        total = fields[0](x)
        for other in fields[1:]:
            d = other(x)
            h = np.maximum(blend - np.abs(total - d), 0) / blend
            total = np.minimum(total, d) - h**3 * blend / 6
        return total

    return distance


def within(low: object, high: object, field: Field, margin: float = 0.09) -> Field:
    """``field`` in its box and ``margin`` around it; farther away the distance to the box, which saves time."""
    low, high = np.asarray(low, float), np.asarray(high, float)

    def distance(x: np.ndarray) -> np.ndarray:
        away = np.sqrt((np.maximum(np.maximum(low - x, x - high), 0) ** 2).sum(axis=1))
        near = away < margin
        away[near] = field(x[near])
        return away

    return distance


def carved(blend: float, body: Field, *hollows: Field) -> Field:
    """The smooth difference."""
    return lambda x: -joined(blend, lambda y: -body(y), *hollows)(x)


def _torso() -> Field:
    """Pelvis to neck, in the half x >= 0."""
    return joined(
        0.08,
        ellipsoid((0, 0.005, 0.96), (0.148, 0.105, 0.105)),
        ellipsoid((0.07, 0.05, 0.915), (0.085, 0.08, 0.085)),  # buttock
        ellipsoid((0, 0.0, 1.09), (0.13, 0.095, 0.13)),
        ellipsoid((0, 0.0, 1.27), (0.142, 0.098, 0.17)),
        ellipsoid((0.075, -0.045, 1.33), (0.078, 0.055, 0.062)),  # pectoral
        ellipsoid((0.075, 0.055, 1.36), (0.07, 0.045, 0.11)),  # shoulder blade
        round_cone((0.05, 0.02, 1.455), (0.165, 0.012, 1.42), 0.05, 0.058),  # collar to shoulder
        round_cone((0, 0.022, 1.44), (0, 0.004, 1.575), 0.062, 0.054),  # neck
        round_cone((0, 0.03, 1.53), (0.10, 0.025, 1.455), 0.035, 0.03),  # trapezius
    )


def _head() -> Field:
    skull = joined(
        0.035,
        ellipsoid((0, 0.0, 1.672), (0.077, 0.097, 0.088)),
        ellipsoid((0, -0.038, 1.625), (0.06, 0.06, 0.085)),  # face
        round_cone((0, -0.082, 1.557), (0.045, -0.02, 1.585), 0.021, 0.024),  # chin and jaw
        round_cone((0, -0.092, 1.672), (0.045, -0.075, 1.67), 0.012, 0.011),  # brow
        ellipsoid((0.038, -0.072, 1.628), (0.02, 0.014, 0.018)),  # cheek bone
    )
    eyes = ellipsoid((0.033, -0.108, 1.651), (0.017, 0.016, 0.012))
    skull = carved(0.02, skull, eyes)
    skull = joined(0.01, skull, ellipsoid((0.032, -0.083, 1.651), (0.014, 0.012, 0.012)))
    nose = round_cone((0, -0.092, 1.658), (0, -0.116, 1.612), 0.007, 0.0125)
    nostril = ellipsoid((0.011, -0.105, 1.608), (0.009, 0.011, 0.008))
    lips = joined(
        0.008,
        round_cone((0, -0.099, 1.588), (0.021, -0.086, 1.585), 0.0075, 0.004),
        round_cone((0, -0.097, 1.577), (0.017, -0.087, 1.581), 0.008, 0.004),
    )
    ear = ellipsoid((0.079, 0.012, 1.64), (0.011, 0.02, 0.032))
    return joined(0.012, joined(0.018, skull, nose, nostril, ear), lips)


def _hand() -> Field:
    """The left hand, its palm towards the thigh and its thumb to the front."""
    wrist, knuckles = REST[NAMES.index("left_wrist")], REST[NAMES.index("left_fingers")]
    along = (ENDS[NAMES.index("left_fingers")] - knuckles) / 0.08
    front = np.array([0.0, -1.0, 0.0])
    inner = np.cross(along, front)  # the side of the palm
    inner *= np.sign(-inner[2])
    spread = np.array([1.5, 0.5, -0.5, -1.5])
    roots = [
        knuckles + front * 0.0215 * s + along * r for s, r in zip(spread, (0.0, 0.006, 0.002, -0.009), strict=True)
    ]
    palm = [round_cone(wrist + front * 0.009 * s, root, 0.019, 0.0135) for s, root in zip(spread, roots, strict=True)]
    fingers = []
    for s, root, length in zip(spread, roots, (0.073, 0.082, 0.076, 0.06), strict=True):
        tip = root + length * (along + front * 0.13 * s + inner * 0.12)
        fingers.append(round_cone(root, tip, 0.0108, 0.0086))
    thumb_root = wrist + along * 0.025 + front * 0.022 + inner * 0.008
    thumb_bend = thumb_root + 0.042 * (0.72 * along + 0.62 * front + 0.28 * inner)
    thumb_tip = thumb_bend + 0.042 * (0.86 * along + 0.46 * front + 0.1 * inner)
    thumb = joined(
        0.01, round_cone(thumb_root, thumb_bend, 0.018, 0.0125), round_cone(thumb_bend, thumb_tip, 0.0125, 0.0095)
    )
    return joined(0.012, joined(0.02, *palm), joined(0.008, *fingers), thumb)


def _arm() -> Field:
    shoulder, elbow, wrist = (REST[NAMES.index(f"left_{name}")] for name in ("shoulder", "elbow", "wrist"))
    upper, fore = elbow - shoulder, wrist - elbow
    back = np.array([0.0, 1.0, 0.0])
    return joined(
        0.045,
        round_cone(shoulder + (0.0, 0, -0.002), shoulder + 0.45 * upper, 0.058, 0.044),  # deltoid
        round_cone(shoulder + 0.3 * upper - 0.012 * back, shoulder + 0.75 * upper - 0.012 * back, 0.038, 0.034),
        round_cone(shoulder + 0.25 * upper + 0.014 * back, shoulder + 0.7 * upper + 0.014 * back, 0.039, 0.033),
        round_cone(shoulder + 0.6 * upper, elbow, 0.037, 0.037),
        round_cone(elbow + 0.05 * fore, elbow + 0.4 * fore, 0.038, 0.040),
        round_cone(elbow + 0.4 * fore, wrist, 0.037, 0.024),
    )


def _leg() -> Field:
    hip, knee, ankle, toes = (REST[NAMES.index(f"left_{name}")] for name in ("hip", "knee", "ankle", "toes"))
    thigh, shin = knee - hip, ankle - knee
    front = np.array([0.0, -1.0, 0.0])
    leg = joined(
        0.06,
        round_cone(hip + (0.003, 0, -0.01), hip + 0.6 * thigh, 0.088, 0.067),
        round_cone(hip + 0.2 * thigh + 0.015 * front, hip + 0.8 * thigh + 0.014 * front, 0.066, 0.05),  # quadriceps
        round_cone(hip + 0.6 * thigh, knee, 0.062, 0.05),
        round_cone(knee, knee + 0.35 * shin, 0.047, 0.047),
        round_cone(knee + 0.12 * shin - 0.02 * front, knee + 0.45 * shin - 0.018 * front, 0.042, 0.043),  # calf
        round_cone(knee + 0.35 * shin, ankle, 0.045, 0.035),
    )
    tip = ENDS[NAMES.index("left_toes")]
    foot = joined(
        0.035,
        round_cone(ankle + (0, 0.032, -0.05), ankle + (0, 0.012, -0.02), 0.032, 0.033),  # heel
        round_cone(ankle + (0, -0.01, -0.01), toes + (0, 0.01, 0.018), 0.036, 0.026),  # instep
        round_cone(ankle + (0, 0.02, -0.055), toes + (-0.015, 0, 0.003), 0.026, 0.027),
        round_cone(ankle + (0.012, 0.02, -0.055), toes + (0.022, 0.012, 0.0), 0.025, 0.024),
        round_cone(toes + (-0.018, 0, 0.001), tip + (-0.024, -0.012, 0.001), 0.024, 0.018),
        round_cone(toes + (0.02, 0.01, -0.002), tip + (0.022, 0.018, -0.003), 0.021, 0.015),
        round_cone(toes, tip + (0.0, 0.0, 0.0), 0.023, 0.017),
    )
    return joined(0.03, leg, foot)


def body() -> Field:
    """A function that is negative inside the body at rest, about the signed distance in metres."""
    torso = within((0, -0.12, 0.82), (0.25, 0.15, 1.6), _torso())
    head = within((0, -0.14, 1.5), (0.1, 0.12, 1.77), _head())
    leg = within((0.0, -0.22, 0.0), (0.22, 0.14, 1.02), _leg())
    arm = within((0.1, -0.08, 1.02), (0.6, 0.1, 1.51), _arm())
    hand = within((0.53, -0.15, 0.9), (0.73, 0.08, 1.1), _hand())
    half = joined(0.03, joined(0.05, joined(0.04, torso, head), leg), joined(0.012, arm, hand))
    # Left and right merge smoothly: |x| without its kink.
    return lambda x: half(np.column_stack([np.sqrt(x[:, 0] ** 2 + 0.004**2), x[:, 1], x[:, 2]]))


@cache
def template() -> tuple[np.ndarray, np.ndarray]:
    """The vertices (v, 3) and faces (f, 3) of the body at rest; made at first use, always the same.

    Marching cubes on a fine grid, thinned by edge collapses under the quadric error, then relaxed along the surface.
    """
    from skimage.measure import marching_cubes

    field = body()
    V, F, _, _ = marching_cubes(_sampled(field), 0.0, spacing=(STEP,) * 3)
    V, F = thinned(V.astype(np.float64) + _LOW, F.astype(np.int64), 2 * VERTICES)
    for _ in range(4):
        V = _relaxed(V, F, field)
    V = _projected(field, _projected(field, V))
    V.setflags(write=False)
    F.setflags(write=False)
    return V, F


@cache
def skin() -> np.ndarray:
    """The skinning weights (v, joints) of the template."""
    V, F = template()
    W = heat_weights(V, F, REST, ENDS)
    W.setflags(write=False)
    return W


def _sampled(field: Field) -> np.ndarray:
    """The field on the grid, exact near the surface only; the body is symmetric, so one half is evaluated."""
    block = 5
    counts = np.ceil((_HIGH - _LOW) / (STEP * block)).astype(int)
    counts[0] = round(_HIGH[0] / STEP / block)
    low = np.array([STEP / 2, *_LOW[1:]])
    coarse = field(low + (np.indices(counts).reshape(3, -1).T * block + (block - 1) / 2) * STEP)
    volume = coarse.reshape(counts)
    for axis in range(3):
        volume = np.repeat(volume, block, axis)
    near = np.abs(coarse) < 1.25 * block * STEP * np.sqrt(3) / 2
    corners = np.indices(counts).reshape(3, -1).T[near] * block
    index = (corners[:, None] + np.indices((block,) * 3).reshape(3, -1).T).reshape(-1, 3)
    for part in np.array_split(index, max(1, len(index) // 30_000)):
        volume[tuple(part.T)] = field(low + part * STEP)
    return np.concatenate([volume[::-1], volume])


def thinned(V: np.ndarray, F: np.ndarray, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """A mesh with ``faces`` faces, by edge collapses under the quadric error."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(V), o3d.utility.Vector3iVector(F))
    mesh = mesh.simplify_quadric_decimation(faces)
    return np.array(mesh.vertices), np.array(mesh.triangles, dtype=np.int64)


def _relaxed(V: np.ndarray, F: np.ndarray, field: Field) -> np.ndarray:
    """Each vertex moved towards the mean of its neighbours, only along the surface."""
    from scipy.sparse import coo_array
    from trimesh import Trimesh

    i, j = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]).T
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(V), len(V))).tocsr()
    step = 0.4 * (graph @ V / graph.sum(axis=1)[:, None] - V)
    normal = np.array(Trimesh(V, F, process=False).vertex_normals)
    step -= np.einsum("ni,ni->n", step, normal)[:, None] * normal
    return V + step - 0.8 * field(V + step)[:, None] * normal


def _projected(field: Field, V: np.ndarray) -> np.ndarray:
    """One Newton step onto the surface."""
    value, step = field(V), 1e-6
    gradient = np.column_stack([field(V + step * e) - value for e in np.eye(3)]) / step
    return V - (value / np.maximum((gradient**2).sum(axis=1), 0.25))[:, None] * gradient
