"""The front door: ``detailbench COMMAND ...``, the same as ``python -m bench``.

Exit codes: 0 all well; 1 a usage or configuration error, or results that cannot be written; 3 finished, but some
cells did not solve all their cases (or a check did not pass); 130 interrupted by Ctrl-C, 143 by SIGTERM and 129 by
SIGHUP.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import functools
import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import DetailbenchError, Terminated, code_of, did_you_mean
from .notices import show_as_lines
from .safe_path import isolate_imports
from .text import counted, shortened, shown_streams

if TYPE_CHECKING:
    from .results.store import Results

# Name -> one line. The module is imported when its command is called: help and listings stay quick.
COMMANDS = {
    "run": "run one cell, or a sweep with -m, and print the leaderboard",
    "plan": "what a run would do: cells, what is finished already, how long the rest may take",
    "list": "tasks, datasets, sensors, methods and metrics, and plugins that are broken",
    "fetch": "download the data of a dataset that is not procedural",
    "leaderboard": "rank finished results: terminal, Markdown, LaTeX or CSV",
    "figure": "a figure of saved outputs for a paper: PDF, SVG or PNG",
    "compare": "compare two results, old and new: what got worse, failed or is slower",
    "inputs": "write the inputs of cases to files, for code that runs elsewhere",
    "import": "score outputs that were made elsewhere",
    "report": "results as one page for a browser: tables, charts, cases, shapes",
    "site": "results as a folder of pages for a static host",
    "plot": "a plot of scores for a paper, with its numbers as CSV",
    "worst": "the worst cases of a method, and what they share",
    "train": "train a learned method, and save its weights",
    "tune": "search for good parameters of a method on train shapes, and write a preset",
    "apply": "apply one method to one file, or to many",
    "recommend": "rank methods for a scan, without ground truth",
    "score": "score an output file against its reference file",
    "check": "check that a plugin keeps the contract",
    "new": "write a new plugin and its test",
    "why": "what changed between a stored result and today",
    "reproduce": "run a stored cell again and compare",
    "completion": "a script that lets bash, zsh or fish complete commands, options, names and parameters",
}
EXIT_CODES = """exit codes: 0 success, 1 usage or configuration error, 3 finished but not everything was solved,
130 interrupted (143 by SIGTERM, 129 by SIGHUP)"""

# Commands that read the user's own config files, where a name may exist in two places.
READ_CONFIGS = [
    "run",
    "plan",
    "list",
    "leaderboard",
    "report",
    "site",
    "worst",
    "train",
    "tune",
    "apply",
    "check",
    "inputs",
]
MOST_NAMES = 5  # that a warning about duplicate names lists
MOST_NAME = 500  # characters of a file's name in a message


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """argparse ends with 2; our code for a usage error is 1."""
        print(f"error: {message}\n{self.format_usage().strip()}\nMore: {self.prog} --help", file=sys.stderr)
        raise SystemExit(1)


def parser_for(command: str) -> argparse.ArgumentParser:
    """The parser of one command; its help is the docstring of the command's module."""
    module = importlib.import_module(f".commands.{command}", __package__)
    parser = _Parser(
        prog=f"detailbench {command}",
        description=module.__doc__,
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    module.add_arguments(parser)
    return parser


def usage() -> str:
    """What ``detailbench --help`` prints."""
    from . import __version__

    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            f"detailbench {__version__}: an honest benchmark for geometry processing",
            "",
            "usage: detailbench COMMAND [--plugin FILE] ...",
            "",
            *lines,
            "",
            "`detailbench COMMAND --help` describes a command; --plugin FILE adds a plugin file to any command.",
            EXIT_CODES,
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    isolate_imports()
    arguments = list(sys.argv[1:] if argv is None else argv)
    open_streams()
    show_as_lines()
    with shown_streams():
        return _ended(arguments)


def _ended(arguments: list[str]) -> int:
    """Run one command until it ends, in any way; the exit code."""
    try:
        os.getcwd()
        with signals_interrupt():
            with reader_may_leave():
                return _main(arguments)
            return 0
    except DetailbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as error:
        print("interrupted", file=sys.stderr)
        return code_of(error)
    except OSError as error:
        if error.filename is not None:  # a file of the arguments: name too long, no permission, disk full
            print(f"error: {shortened(str(error.filename), MOST_NAME)}: {error.strerror}", file=sys.stderr)
            return 1
        if isinstance(error, FileNotFoundError):
            where = "the working folder no longer exists; change to another folder, then run this again"
            print(f"error: {where}", file=sys.stderr)
            return 1
        if error.errno not in CANNOT_PRINT:
            raise
        reason = f"{error.strerror}; finished cells are stored; `detailbench leaderboard DIR` shows them"
        print(f"error: cannot write to the standard output: {reason}", file=sys.stderr)
        forget_output()
        return 1


# Errors of printing to standard output: a full disk, a closed stream, a terminal that is gone.
CANNOT_PRINT = (errno.ENOSPC, errno.EBADF, errno.EIO, errno.EDQUOT, errno.EFBIG)


def open_streams() -> None:
    """Make all three standard streams writable, or fail with a message.

    One that is closed (``>&-``) is None in Python, and its descriptor would become that of the next file.
    """
    for name, fd, mode in (("stdin", 0, os.O_RDONLY), ("stdout", 1, os.O_RDONLY), ("stderr", 2, os.O_WRONLY)):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, mode)  # standard output stays unwritable, as if still closed
            if opened != fd and not _is_open(fd):
                os.dup2(opened, fd)
                os.close(opened)
                opened = fd
            os.set_inheritable(opened, opened == fd)
            setattr(sys, name, open(opened, "r" if fd == 0 else "w", closefd=False))  # noqa: SIM115  to the end
    for name in ("write", "flush"):  # a message that cannot be shown does not end the command
        setattr(sys.stderr, name, _quiet(getattr(sys.stderr, name)))
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what the terminal's encoding lacks is shown as \\udcff, not as a traceback
            stream.reconfigure(errors="backslashreplace")


def _is_open(fd: int) -> bool:
    try:
        os.fstat(fd)
    except OSError:
        return False
    return True


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    if hasattr(function, "__wrapped__"):
        return function

    @functools.wraps(function)
    def attempt(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except OSError:
            return 0

    return attempt


@contextlib.contextmanager
def signals_interrupt() -> Iterator[None]:
    """Inside, SIGTERM and SIGHUP are like Ctrl-C, unless they are ignored (``nohup``) or handled by others."""
    numbers = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) == signal.SIG_DFL]

    def interrupt(number: int, frame: object) -> None:
        for n in numbers:  # one signal is enough: the command is already ending
            signal.signal(n, signal.SIG_IGN)
        raise Terminated(number)

    if threading.current_thread() is not threading.main_thread():
        numbers = []
    for number in numbers:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def forget_output() -> None:
    """Discard what is still to be printed, without an error at the end of the process."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


@contextlib.contextmanager
def reader_may_leave() -> Iterator[None]:
    """``detailbench list | head`` is no error: output is discarded once nobody reads it."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        forget_output()


def warn_of_damaged(*opened: Results) -> None:
    """Report which files of results were left out or set aside since the last report."""
    for results in opened:
        while results.damaged:
            print(f"warning: {results.damaged.pop(0)}", file=sys.stderr)


def _main(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if arguments else 1
    if arguments[0] in ("-V", "--version"):
        from . import __version__

        print(f"detailbench {__version__}")
        return 0
    command = arguments[0]
    if command not in COMMANDS:
        print(f"error: there is no command {command!r}. {did_you_mean(command, COMMANDS)}", file=sys.stderr)
        return 1
    parser = parser_for(command)
    module = importlib.import_module(f".commands.{command}", __package__)
    if getattr(module, "PASSES_ON", False):  # what the parser does not know is Hydra's
        args, rest = parser.parse_known_args(arguments[1:])
        args.rest = rest
    if getattr(module, "PASSES_ON", False):  # arguments unknown to the parser are Hydra's
        args, args.rest = parser.parse_known_args(arguments[1:])
    else:
        args = parser.parse_intermixed_args(arguments[1:])
    if hasattr(args, "config_dir"):
        from .plugins import config_files

        config_files.use(args.config_dir)
        if command in READ_CONFIGS and len(config_files.folders()) > 1:
            _warn_of_names()
    return module.run(args)


def _warn_of_names() -> None:
    """Warn which file counts where a name exists in two places."""
    from .plugins.presets import warnings

    lines = warnings()
    for line in lines[:MOST_NAMES]:
        print(f"warning: {line}", file=sys.stderr)
    if len(lines) > MOST_NAMES:
        print(f"warning: {counted(len(lines) - MOST_NAMES, 'more name')}, each defined in two files", file=sys.stderr)


def add_plugin_argument(parser: argparse.ArgumentParser) -> None:
    """``--plugin FILE`` and ``--config-dir DIR``, the same in every command."""
    parser.add_argument("--plugin", metavar="FILE", action="append", default=[], help="also load the plugins in FILE")
    parser.add_argument(
        "--config-dir",
        metavar="DIR",
        action="append",
        default=[],
        help="also read experiments, conventions and presets in DIR, as in ./conf (DIR/experiment/NAME.yaml)",
    )


if __name__ == "__main__":
    sys.exit(main())
