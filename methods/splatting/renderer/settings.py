"""Settings of the renderer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Gradient = Literal["dss", "rbf"]


@dataclass(frozen=True)
class Drawing:
    """Settings of the renderer; lengths are in the unit of the points unless stated otherwise.

    Parameters
    ----------
    cutoff : float
        C of Eq. 3.7: a splat covers the pixels with d^T M d / 2 <= C.
    blur : float
        Standard deviation of the low-pass filter, in pixels.
    depth_limit : float
        T: splats this far behind the front of a pixel are hidden there. (Thesis: 1 % of the diagonal of the box.)
    layers : int
        K: the number of nearest splats stored for a pixel.
    cull : bool
        Points whose normals point away are not drawn; without it, all are visible from both sides.
    grazing : float
        A point is drawn if the cosine of the angle between its normal and the direction to the camera is at least
        this.
    near : float
        Points nearer to the plane of the camera are not drawn.
    epsilon : float
        Of Eq. 3.12, in square pixels (as released; thesis: 1e-5).
    gradient : "dss" or "rbf"
        Of positions: by the change of visibility (Eq. 3.12), or by the derivative of the Gaussian (figure 3.18).
    occlusion : bool
        Hidden points are also moved to the front.
    weights : bool
        Positions and normals also get the derivative of the weights (d rho of Eq. 3.10 and 3.11), which the
        released code omits.
    opening : float
        Pixels are grouped into blocks for splats whose distance is at least this times the size of the block;
        0 treats every pixel separately.
    window : float
        Pixels farther from a splat than this, in columns or rows, do not affect it; 0 for no limit. (Released:
        64, shrinking to 16.)
    """

    cutoff: float = 1.0
    blur: float = 1.0
    depth_limit: float = 0.05
    layers: int = 5
    cull: bool = True
    grazing: float = 0.05
    near: float = 1e-3
    epsilon: float = 0.01
    gradient: Gradient = "dss"
    occlusion: bool = True
    weights: bool = False
    opening: float = 2.0
    window: float = 0.0

    def __post_init__(self) -> None:
        for name in ("cutoff", "depth_limit", "near", "epsilon"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        for name in ("blur", "opening", "window"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if self.layers < 1:
            raise ValueError(f"layers: expected at least 1, got {self.layers}")
        if not 0 < self.grazing < 1:
            raise ValueError(f"grazing: expected a number between 0 and 1, got {self.grazing}")
        if self.gradient not in ("dss", "rbf"):
            raise ValueError(f"gradient: expected dss or rbf, got {self.gradient!r}")
