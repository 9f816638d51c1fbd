"""The tests of fetched data run where they were fetched (``make real``); no other test needs them."""

from bench.datasets.real import Real
from bench.errors import MissingData


def _why_not() -> str:
    try:
        Real().check()
    except MissingData as error:
        return str(error)
    return ""


collect_ignore = ["test_datasets_real_files.py"] if _why_not() else []


def pytest_report_header() -> str | None:
    """Say why they do not run."""
    return f"test_datasets_real_files.py is left out: {why}" if (why := _why_not()) else None
