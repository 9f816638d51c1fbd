"""Errors that are meant to be read by the person at the keyboard.

Whatever derives from :class:`DetailbenchError` is shown as one clear message, never as a traceback: it names the
file or the parameter, says what was expected, and what to do.
"""

from __future__ import annotations

import difflib
import signal
from collections.abc import Iterable

from .text import cut

LONGEST = 4000  # characters of a message: a name on a command line, or a word of a damaged file, may have millions


class DetailbenchError(Exception):
    """Base of every error that is shown as a message, of a length that can be read."""

    def __str__(self) -> str:
        return cut(super().__str__(), LONGEST)


class Terminated(KeyboardInterrupt):
    """As Ctrl-C, by a signal: SIGTERM of a batch system, or SIGHUP of a terminal that was closed."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def code_of(error: KeyboardInterrupt) -> int:
    """The exit code of an interrupted command: 128 and the number of the signal, as shells have it."""
    return 128 + (error.number if isinstance(error, Terminated) else signal.SIGINT)


class UsageError(DetailbenchError):
    """A wrong command line, name, parameter or configuration (exit code 1)."""


class BadInput(DetailbenchError, ValueError):
    """Geometry or a file that cannot be used; the message names it and says what was expected."""


class MissingData(UsageError, BadInput):
    """Files of a dataset that are fetched at set-up are not there; ``fetch`` is the line that fetches them.

    Cells over them are not planned, and the rest of a sweep goes on.
    """

    def __init__(self, what: str, fetch: str):
        self.fetch = fetch
        super().__init__(f"{what}; fetch them with: {fetch}")


class InvalidOutput(DetailbenchError):
    """A method returned something other than its task promises (recorded as ``invalid``)."""


class PluginError(DetailbenchError):
    """A plugin that breaks the contract of :func:`bench.register`, or two with one name."""


class StoreError(DetailbenchError):
    """The results folder cannot be written or read (exit code 1)."""


class MissingLibrary(DetailbenchError, ImportError):
    """An optional library is not installed (recorded as ``skipped``); ``install`` is the line that installs it."""

    def __init__(self, library: str, install: str, reason: str = "is not installed"):
        self.library, self.install = library, install
        super().__init__(f"{library} {reason}; install it with: {install}")


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """A sentence that names the nearest of ``known``, or all of them when none is near."""
    known = sorted(known)
    known = list(dict.fromkeys(known))
    as_written = {name.lower(): name for name in known}
    near = [as_written[n] for n in difflib.get_close_matches(wrong.lower(), as_written, n=3, cutoff=0.6)]
    if near:
        return f"Did you mean {' or '.join(repr(n) for n in near)}?"
    if len(known) > 40:
        return f"Known: {', '.join(known[:30])} and {len(known) - 30} more."
    return f"Known: {', '.join(known)}." if known else "None is known."
