"""A slow, plain reference for the surface splatting renderer: one loop over pixels, one over splats.

It follows the equations of the thesis one by one and shares no code with the renderer. Every case of the backward pass
is one small function. All computation is in double precision.

Camera: ``P = R p + t``; X to the right, Y down, Z forward. A point projects to the column ``u = (fx X + s Y) / Z + cx``
and the row ``v = fy Y / Z + cy``. The pixel of row i and column j is sampled at its centre, ``(j + 0.5, i + 0.5)``.

Shapes: N splats, C channels, H rows and W columns. A pixel's list has one entry ``(k, depth, rho)`` for each splat k
that covers it, the nearest first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Look:
    """A camera: intrinsics (3, 3), extrinsics (3, 4) from world to camera, and the size of the image in pixels."""

    intrinsics: np.ndarray
    extrinsics: np.ndarray
    width: int
    height: int


@dataclass(frozen=True)
class How:
    """The settings of the renderer."""

    cutoff: float = 1.0  # C of Eq. 3.7
    blur: float = 1.0  # standard deviation of the low-pass filter of Eq. 3.6, in pixels
    depth_limit: float = 0.05  # T: splats at most this far behind the first one are blended with it
    layers: int = 5  # K: entries of a pixel's list
    cull: bool = True  # omit splats that show their back; otherwise flip them
    grazing: float = 0.05  # least cosine between the normal and the direction to the camera
    near: float = 1e-3  # splats at this depth or nearer are not drawn
    epsilon: float = 0.01  # of Eq. 3.12, in square pixels
    occlusion: bool = True  # give hidden splats a gradient along the viewing direction


@dataclass(frozen=True)
class Splat:
    """One rendered splat, in camera coordinates."""

    P: np.ndarray  # (3,) position
    n: np.ndarray  # (3,) unit normal, towards the camera
    sigma: float  # standard deviation in the tangent plane
    x: np.ndarray  # (2,) projected position: column, row
    S: np.ndarray  # (2, 2) covariance in the image, J V J^T + blur^2 I
    M: np.ndarray  # (2, 2) inverse of S
    jac: float  # |J|, ratio of areas from the tangent plane to the image
    peak: float  # q_k, the weight of Eq. 3.6 at the centre
    radius: float  # largest half extent of the bounding box of the covered ellipse


@dataclass(frozen=True)
class Change:
    """What happens at a pixel when the visibility of one splat changes there."""

    new: np.ndarray  # (C,) value of the pixel after the change
    xy: np.ndarray  # (2,) gradient in the image for a unit change of the loss
    z: float  # gradient along the depth for a unit change of the loss
    sign: float  # of the "rbf" gradient: 1 where the splat appears, -1 where it disappears, 0 for no gradient


# Camera


def parts_of(intrinsics):
    """fx, fy, s, cx, cy of the intrinsics (3, 3)."""
    return intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 1], intrinsics[0, 2], intrinsics[1, 2]


def project(P, look):
    """Column and row (2,) of a point P (3,) in camera coordinates."""
    fx, fy, s, cx, cy = parts_of(look.intrinsics)
    X, Y, Z = P
    return np.array([(fx * X + s * Y) / Z + cx, fy * Y / Z + cy])


def projection_derivative(P, look):
    """Derivative A (2, 3) of the projection at P (3,)."""
    fx, fy, s, _, _ = parts_of(look.intrinsics)
    X, Y, Z = P
    return np.array([[fx / Z, s / Z, -(fx * X + s * Y) / Z**2], [0.0, fy / Z, -fy * Y / Z**2]])


def ray_of(pixel, look):
    """The ray (3,), with third component 1, of the points that project to the pixel (2,)."""
    fx, fy, s, cx, cy = parts_of(look.intrinsics)
    y = (pixel[1] - cy) / fy
    return np.array([(pixel[0] - cx - s * y) / fx, y, 1.0])


def centre_of(i, j):
    """The sampling position of the pixel of row i and column j: column, row (2,)."""
    return np.array([j + 0.5, i + 0.5])


# Splats


def splats(points, normals, sigma, look, how):
    """A list of N splats, None where a splat is not rendered.

    points and unit normals (N, 3) are in world coordinates; sigma is one number or (N,).
    """
    points = np.asarray(points, dtype=np.float64)
    normals = np.asarray(normals, dtype=np.float64)
    sigma = np.broadcast_to(np.asarray(sigma, dtype=np.float64), len(points))
    R, t = look.extrinsics[:, :3], look.extrinsics[:, 3]
    return [splat(R @ points[k] + t, R @ normals[k], float(sigma[k]), look, how) for k in range(len(points))]


def splat(P, n, sigma, look, how):
    """One splat of the position and unit normal P, n (3,) in camera coordinates, None where not rendered; Eq. 3.6."""
    fx, fy, _, _, _ = parts_of(look.intrinsics)
    Z = P[2]
    if not how.near < Z:
        return None
    facing = -(n @ P) / np.linalg.norm(P)
    if facing < 0 and not how.cull:
        n, facing = -n, -facing
    if facing < how.grazing:
        return None
    x = project(P, look)
    if not near_image(x, look):
        return None
    A = projection_derivative(P, look)
    S = sigma**2 * A @ (np.eye(3) - np.outer(n, n)) @ A.T + how.blur**2 * np.eye(2)
    jac = fx * fy * abs(n @ P) / Z**3
    peak = jac / (2 * math.pi * math.sqrt(np.linalg.det(S)))
    radius = math.sqrt(2 * how.cutoff * max(S[0, 0], S[1, 1]))
    return Splat(P=P, n=n, sigma=sigma, x=x, S=S, M=np.linalg.inv(S), jac=jac, peak=peak, radius=radius)


def near_image(x, look):
    """Whether the position x (2,) lies in the image enlarged by half its size on each side."""
    W, H = look.width, look.height
    return -W / 2 <= x[0] <= 3 * W / 2 and -H / 2 <= x[1] <= 3 * H / 2


def beta_at(splat, pixel):
    """Half the squared distance of the pixel (2,) from the centre, in standard deviations: the exponent of Eq. 3.6.

    The factor 1/2, which Eq. 3.4 lacks, makes it the exponent of a normal distribution. The matrix is the inverse of
    the covariance, which Eq. 3.7 prints without the inverse.
    """
    d = pixel - splat.x
    return 0.5 * (d @ splat.M @ d)


def covers(splat, pixel, how):
    """Whether the pixel (2,) lies in the ellipse of the splat, the first line of Eq. 3.7."""
    return beta_at(splat, pixel) <= how.cutoff


def rho_bar(splat, pixel):
    """Weight of the splat at the pixel (2,), Eq. 3.6."""
    return splat.peak * math.exp(-beta_at(splat, pixel))


def depth_at(splat, pixel, look, how):
    """Depth of the tangent plane at the pixel (2,), kept within the reach of the splat.

    Where the pixel sees the plane beyond its horizon, or behind the camera, it is the farthest depth of the splat.
    """
    Z = splat.P[2]
    reach = splat.sigma * math.sqrt(2 * how.cutoff)
    ray = ray_of(pixel, look)
    towards_plane, along_ray = splat.n @ splat.P, splat.n @ ray
    if along_ray == 0 or np.sign(along_ray) != np.sign(towards_plane):
        return Z + reach
    return min(max(towards_plane / along_ray, Z - reach), Z + reach)


# Pixels


def lists(splats, look, how):
    """The list of every pixel, a dict from (i, j): the entries (k, depth, rho) of the K nearest covering splats.

    Entries are sorted by depth, those of equal depth by k. The list of an uncovered pixel is empty.
    """
    found = {}
    for i in range(look.height):
        for j in range(look.width):
            pixel = centre_of(i, j)
            entries = []
            for k, splat in enumerate(splats):
                if splat is not None and covers(splat, pixel, how):
                    entries.append((k, depth_at(splat, pixel, look, how), rho_bar(splat, pixel)))
            entries.sort(key=lambda entry: (entry[1], entry[0]))
            found[i, j] = entries[: how.layers]
    return found


def front_of(entries, how):
    """The visible entries of a list, Eq. 3.9: those at most T behind the first."""
    return [entry for entry in entries if entry[1] - entries[0][1] <= how.depth_limit]


def first_depth(entries):
    """Depth of the first entry, infinite where the list is empty."""
    return entries[0][1] if entries else math.inf


def blend(entries, attributes):
    """Value (C,) of a pixel that shows these entries, Eq. 3.8; 0 where there are none. attributes: (N, C)."""
    if not entries:
        return np.zeros(attributes.shape[1])
    weighted = sum(rho * attributes[k] for k, _, rho in entries)
    return weighted / sum(rho for _, _, rho in entries)


def image(lists, attributes, look, how):
    """The image (H, W, C) of attributes (N, C): Eq. 3.8 with the weights of Eq. 3.7, on a background of 0."""
    attributes = np.asarray(attributes, dtype=np.float64)
    picture = np.zeros((look.height, look.width, attributes.shape[1]))
    for (i, j), entries in lists.items():
        picture[i, j] = blend(front_of(entries, how), attributes)
    return picture


# Backward


def attribute_gradient(lists, grad_image, count, how):
    """Gradient (N, C) of the loss with respect to the attributes of N = count splats, the derivative of Eq. 3.8.

    grad_image (H, W, C) is the gradient of the loss with respect to the image. It is the first term of Eq. 3.10 and
    Eq. 3.11.
    """
    gradient = np.zeros((count, grad_image.shape[2]))
    for (i, j), entries in lists.items():
        front = front_of(entries, how)
        total = sum(rho for _, _, rho in front)
        for k, _, rho in front:
            gradient[k] += rho / total * grad_image[i, j]
    return gradient


def guard(v, e):
    """The number v moved away from 0 by e, so that its inverse stays finite."""
    return v + e if v >= 0 else v - e


def pixel_size(splat, look):
    """Length that projects to one pixel at the depth of the splat."""
    fx, fy, _, _, _ = parts_of(look.intrinsics)
    return splat.P[2] / math.sqrt(fx * fy)


def move_to(d, how):
    """Gradient (2,) of a move by d (2,) that makes a splat visible, the first line of Eq. 3.12."""
    return d / (d @ d + how.epsilon)


def case_a(k, splat, pixel, entries, attributes, look, how):
    """The splat is not in the list of the pixel (2,), and not occluded there: it moves in the image to the pixel.

    The new value, Eq. 3.8, adds the splat with the weight of its centre and leaves out what it would hide.
    """
    Z = splat.P[2]
    beside = [entry for entry in front_of(entries, how) if entry[1] - how.depth_limit <= Z]
    new = blend([*beside, (k, Z, splat.peak)], attributes)
    return Change(new=new, xy=move_to(pixel - splat.x, how), z=0.0, sign=1.0)


def case_b(k, splat, pixel, entries, attributes, look, how):
    """The splat is not in the list of the pixel (2,), and others occlude it there: it moves to the pixel and forward.

    The new value, Eq. 3.8, adds the splat with the weight of its centre. Eq. 3.12 takes the move in space: its length
    in the image is turned into one at the depth of the splat.
    """
    Z = splat.P[2]
    d = pixel - splat.x
    new = blend([*front_of(entries, how), (k, Z, splat.peak)], attributes)
    z = 0.0
    if how.occlusion:
        px = pixel_size(splat, look)
        dz = first_depth(entries) - Z
        z = dz / ((d @ d) * px**2 + dz**2 + how.epsilon * px**2)
    return Change(new=new, xy=move_to(d, how), z=z, sign=1.0)


def case_c(k, splat, pixel, entries, attributes, look, how):
    """The splat is visible at the pixel (2,): it leaves it in the image, the second line of Eq. 3.12.

    The new value, Eq. 3.8, is without the splat. Where nothing else is visible it shows the next layer of the list:
    what lies at most T behind the first of the entries that remain.
    """
    rest = [entry for entry in front_of(entries, how) if entry[0] != k]
    if not rest:
        rest = front_of([entry for entry in entries if entry[0] != k], how)
    d = pixel - splat.x
    s = math.sqrt(d @ d + how.epsilon)
    r = splat.radius
    # A move of s + r along d / s takes the centre past the pixel; one of s - r, below 0, takes it back.
    xy = d * (1 / guard(s * (s + r), how.epsilon) + 1 / guard(s * (s - r), how.epsilon))
    return Change(new=blend(rest, attributes), xy=xy, z=0.0, sign=-1.0)


def case_d(k, splat, pixel, entries, attributes, look, how):
    """The splat covers the pixel (2,) behind what is visible there: it moves forward, in depth only.

    The thesis counts it in its case (b), the first line of Eq. 3.12. The new value, Eq. 3.8, adds the splat with its
    weight at the pixel.
    """
    (hidden,) = [entry for entry in entries if entry[0] == k]
    new = blend([*front_of(entries, how), hidden], attributes)
    z = 0.0
    if how.occlusion:
        ez = math.sqrt(how.epsilon) * pixel_size(splat, look)
        z = 1 / guard(first_depth(entries) - hidden[1], ez)
    return Change(new=new, xy=np.zeros(2), z=z, sign=0.0)


def case_of(k, splat, entries, how):
    """The one of the functions above for the splat k at a pixel with these entries."""
    if k in [entry[0] for entry in front_of(entries, how)]:
        return case_c
    if k in [entry[0] for entry in entries]:
        return case_d
    if splat.P[2] - first_depth(entries) <= how.depth_limit:
        return case_a
    return case_b


def rbf_slope(splat, pixel):
    """Gradient (2,) of exp(-beta) for a move of the splat in the image: the derivative of Eq. 3.6 over its peak."""
    return math.exp(-beta_at(splat, pixel)) * (splat.M @ (pixel - splat.x))


def screen_gradients(k, splat, pixel, entries, attributes, g, look, how):
    """Gradients (3,) of one splat from one pixel, "dss" and "rbf": two components in the image, one in depth.

    g (C,) is the gradient of the loss with respect to the value of the pixel. A change that does not lower the loss
    gives 0, Eq. 3.13.
    """
    change = case_of(k, splat, entries, how)(k, splat, pixel, entries, attributes, look, how)
    dL = float(g @ (change.new - blend(front_of(entries, how), attributes)))
    if not dL < 0:
        return np.zeros((2, 3))
    return dL * np.array([[*change.xy, change.z], [*(change.sign * rbf_slope(splat, pixel)), 0.0]])


def to_camera(splat, screen, look):
    """Gradient (3,) in camera coordinates of a screen gradient (3,), by the chain rule at a fixed depth."""
    fx, fy, s, _, _ = parts_of(look.intrinsics)
    gx, gy, gz = screen
    Z = splat.P[2]
    return np.array([gx * fx / Z, (gx * s + gy * fy) / Z, gz])


def position_gradients(splats, lists, attributes, grad_image, look, how):
    """Gradients (N, 3) of the loss with respect to the positions, in world coordinates: the last term of Eq. 3.11.

    attributes (N, C); grad_image (H, W, C) is the gradient of the loss with respect to the image. The kind "dss" is
    the visibility gradient of Eq. 3.12 and Eq. 3.13; "rbf" takes the slope of the Gaussian of Eq. 3.6 in its place.
    """
    attributes = np.asarray(attributes, dtype=np.float64)
    R = look.extrinsics[:, :3]
    gradients = np.zeros((2, len(splats), 3))
    for k, splat in enumerate(splats):
        if splat is None:
            continue
        screen = np.zeros((2, 3))
        for (i, j), entries in lists.items():
            g = grad_image[i, j]
            if np.any(g != 0):
                screen += screen_gradients(k, splat, centre_of(i, j), entries, attributes, g, look, how)
        for kind in range(2):
            gradients[kind, k] = R.T @ to_camera(splat, screen[kind], look)
    return dict(zip(("dss", "rbf"), gradients, strict=True))
