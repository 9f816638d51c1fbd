"""The callback of Hydra between the jobs of a sweep."""

from __future__ import annotations

from typing import Any

from hydra.experimental.callback import Callback


class ForgetConfigs(Callback):
    """Drops the config of an ended job: Hydra holds return values until the sweep ends, 0.1 MB a job."""

    def on_job_end(self, config: Any, job_return: Any, **kwargs: Any) -> None:
        """Nothing reads them afterwards: a record has everything about its cell."""
        job_return.cfg = job_return.hydra_cfg = None
