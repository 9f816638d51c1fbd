"""The worker's side: one candidate reconstructs a scan and its halves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..plan.choice import Choice

if TYPE_CHECKING:
    from ..engine.channel import Channel


def call(spec: Mapping[str, Any], channel: Channel) -> None:
    """Reconstruct every part that ``clouds`` holds and store the meshes; the row has the measurements of the first."""
    from ..engine.channel import plain
    from ..engine.worker import failure
    from ..text import bounded

    try:
        row = {"status": "ok", **_solved(spec, channel)}
    except BaseException as error:  # the boundary: shown in the line of this method
        row = {"stage": channel.stage} | failure(error, channel.stage)
    channel.send("result", row=plain(bounded(row)))


def _solved(spec: Mapping[str, Any], channel: Channel) -> dict[str, Any]:
    from ..engine.call import MeasuredCall
    from ..engine.meter import Meter
    from ..geometry.cloud import PointCloud
    from ..plugins.weights import load

    asked = spec["arguments"]
    task = Choice(**asked["task"])
    weights = load(asked["weights"]) if asked["weights"] else None
    meshes: dict[str, np.ndarray] = {}
    row: dict[str, Any] = {}  # of the whole scan, which comes first
    for index, path in enumerate(asked["clouds"]):
        channel.enter("case", index)
        with np.load(path) as arrays:
            cloud = PointCloud.of(arrays)
        call = MeasuredCall(
            task=task,
            method=Choice(**asked["method"]),
            solver=task.build(),
            inputs={"cloud": cloud},
            seed=asked["seed"],
            spec=spec,
            meter=Meter(spec["memory_gb"], "cpu"),
            channel=channel,
            index=index,
            weights=weights,
        )
        mesh = call()
        meshes |= {f"vertices{index}": np.asarray(mesh.vertices), f"faces{index}": np.asarray(mesh.faces)}
        row = row or {name: call.columns[name] for name in ("seconds", "peak_rss_mb", "message")}
    channel.enter("write", len(asked["clouds"]))
    named: dict[str, Any] = dict(meshes)
    np.savez(asked["output"], **named)
    return row
