"""What Hydra calls between the jobs of a sweep."""

from __future__ import annotations

from typing import Any

from hydra.experimental.callback import Callback


class ForgetConfigs(Callback):
    """Drops the config of a job that has ended: Hydra keeps what it returns until the sweep ends, 0.1 MB a job."""

    def on_job_end(self, config: Any, job_return: Any, **kwargs: Any) -> None:
        """Nothing after a job reads them: a record has all of its cell."""
        job_return.cfg = job_return.hydra_cfg = None
