"""Calls in a child process with limits, for the commands that are not a sweep: ``apply`` and ``check``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..plan.limits import Limits
from .affinity import claim
from .devices import claim_device
from .forkserver import take_prestarted
from .runner import of_death
from .watch import Worker


class Isolation:
    """A fork server for single calls.

    Example
    -------
    ``with Isolation(("open3d",)) as isolation: row = isolation.call("bench.engine.application:call", {...})``
    """

    def __init__(self, preload: tuple[str, ...] = (), plugins: tuple[str, ...] = (), threads: int = 1):
        self.threads = threads
        self._server = take_prestarted(threads)
        self._server.load(preload, plugins)

    def __enter__(self) -> Isolation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """End the server and all its descendants."""
        self._server.close()

    def call(
        self,
        function: str,
        arguments: Mapping[str, Any],
        *,
        limit: Limits = Limits(),  # noqa: B008
        on_event: Callable[[dict[str, Any]], None] = lambda event: None,
        verbose: bool = False,
    ) -> dict[str, Any]:
        """Call ``module:name`` as ``name(spec, channel)`` in a worker.

        Returns
        -------
        dict
            The ``row`` of the ``result`` event that it sent, or, if it died before, the columns that describe how.
        """
        result: dict[str, Any] = {}

        def hear(event: dict[str, Any]) -> None:
            if event["event"] == "result":
                result.update(event["row"])
            on_event(event)

        with claim_device(arguments.get("device", "cpu")) as device, claim(self.threads) as cpus:
            spec = {
                "function": function,
                "arguments": {**arguments, **({"device": device} if "device" in arguments else {})},
                "cpus": cpus,
                "threads": self.threads,
                "seconds": limit.seconds,
                "memory_gb": limit.memory_gb,
            }
            death = Worker(self._server, spec, limit, hear, verbose=verbose).watch()
        if death is not None:
            return of_death(death)
        return result or {"status": "crashed", "message": "its worker ended before it was done"}
