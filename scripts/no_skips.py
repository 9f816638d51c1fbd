"""A pytest plugin (``-p no_skips``): a run in which a test was skipped has failed.

A skipped test has shown nothing; on a machine that ``make setup`` prepared there is no reason to skip any.
"""

import pytest


def _skipped(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")  # None in the workers of pytest-xdist
    return len(reporter.stats.get("skipped", ())) if reporter else 0


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    """Turn a success with skipped tests into a failure."""
    if _skipped(session.config) and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter, config):
    """Say so."""
    if skipped := _skipped(config):
        terminalreporter.write_line(f"{skipped} skipped: counted as a failure", red=True)
