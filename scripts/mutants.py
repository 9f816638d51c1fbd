"""Plants one mistake after another in a room of the code, and prints those that the room's tests do not notice.

    python scripts/mutants.py ranking                              # 50 mutants of bench/ranking, a quarter of an hour
    python scripts/mutants.py engine --sample 200 --seed 3 --minutes 60
    python scripts/mutants.py ranking --files statistics.py places.py --sample 0    # all mutants of two files
    python scripts/mutants.py ranking --list                       # what would be planted, and nothing run

A mutant is one change: another comparison or arithmetic operator, `and` for `or`, a number plus one, the other truth
value, a condition negated, the branches of a conditional swapped, a statement removed on which no name depends. The
room's tests run on a copy of the checkout; they pass there before anything is planted. A mutant is killed when a test
fails, or takes far longer.

What each test reaches is traced first: a mutant is tried with the tests that reach its line, the quickest first, and
then, where none of them fails, with all of the room, for lines may be reached in child processes. Only those that
survive all are printed, with file, line and change. Survivors that change nothing that anybody can see are to be
expected: a larger buffer, an equivalent bound. mutmut and cosmic-ray have no sample by seed and no budget, and do not
remove statements.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PLACES = {"", str(ROOT), str(ROOT / "scripts")}  # where modules of ours would be found
COPIED = ("bench", "methods", "datasets", "metrics", "conf", "tests", "scripts", "docs", "pyproject.toml", "README.md")
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
REMOVED = (ast.Expr, ast.AugAssign, ast.Raise, ast.Delete)
WARM = (  # libraries of the code and plugins of pytest, and nothing of ours
    *("pytest", "hypothesis", "pytest_benchmark.plugin", "xdist.plugin"),
    *("hydra", "numpy", "pandas", "pyarrow.parquet", "rich", "scipy.stats", "trimesh"),
)
SLOWER = 5.0  # a mutant whose tests take so many times as long hangs
GRACE = 20.0  # seconds on top, for a machine that others use


class Mutant(NamedTuple):
    """One change of a file."""

    file: str  # below the checkout
    line: int
    start: int  # bytes
    end: int
    new: str
    what: str


# -- planting ----------------------------------------------------------------------------------------------------------


def mutants_of(path: Path) -> list[Mutant]:
    """All mutants of a file, in the order of its lines."""
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, new in _changes(ast.parse(source)):
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        old = source[start:end].decode()
        what = f"{_short(old)}  ->  {_short(new)}"
        found.append(Mutant(str(path.relative_to(ROOT)), node.lineno, start, end, new, what))
    return sorted(set(found), key=lambda mutant: (mutant.start, mutant.end, mutant.new))


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) < 100 else f"{text[:97]}..."


def _changes(tree: ast.AST) -> Iterator[tuple[Any, str]]:
    """Each node that is replaced, and the text in its place."""
    for node in _code(tree):
        if (isinstance(node, REMOVED) and not _is_text(node)) or _replaces(node):
            yield node, "pass"
        elif isinstance(node, ast.Continue | ast.Break):
            yield node, "break" if isinstance(node, ast.Continue) else "continue"
        elif isinstance(node, ast.If | ast.While) and not _is_text(node.test):
            yield node.test, f"(not ({ast.unparse(node.test)}))"
        elif isinstance(node, ast.IfExp):
            yield node, f"({ast.unparse(ast.IfExp(node.test, node.orelse, node.body))})"
        elif isinstance(node, ast.Compare):
            for index, operator in enumerate(node.ops):
                others = [*node.ops[:index], OPERATORS[type(operator)](), *node.ops[index + 1 :]]
                yield node, f"({ast.unparse(ast.Compare(node.left, others, node.comparators))})"
        elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _is_text(node):
            yield node, f"({ast.unparse(ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right))})"
        elif isinstance(node, ast.BoolOp):
            yield node, f"({ast.unparse(ast.BoolOp(OPERATORS[type(node.op)](), node.values))})"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            yield node, f"({ast.unparse(node.operand)})"
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield node, repr(node.value + 1)
        elif isinstance(node, ast.Constant) and type(node.value) is bool:
            yield node, repr(not node.value)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """What is executed and is no declaration: without annotations, decorators and what only type checkers read."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
                continue
            yield child
            yield from _code(child)


def _is_text(node: Any) -> bool:
    """A docstring, or a sum of texts: an operator there makes an error and shows nothing."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    return any(isinstance(n, ast.JoinedStr) or _is_str(n) for n in (getattr(node, k, None) for k in ("left", "right")))


def _is_str(node: Any) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _replaces(node: ast.AST) -> bool:
    """An assignment without which a name would not be missing, as far as its form says."""
    if not isinstance(node, ast.Assign):
        return False
    names = {n.id for target in node.targets for n in ast.walk(target) if isinstance(n, ast.Name)}
    return isinstance(node.targets[0], ast.Attribute | ast.Subscript) or any(
        isinstance(n, ast.Name) and n.id in names for n in ast.walk(node.value)
    )


# -- tracing: this file as a plugin of pytest --------------------------------------------------------------------------


class Tracer:
    """Which lines of the room each test file and each test reaches in this process, and how long it takes."""

    def __init__(self, folder: str, out: Path):
        self.folder, self.out, self.lines, self.seen = folder, out, set(), []

    def _call(self, frame: Any, event: str, arg: Any) -> Any:
        if not frame.f_code.co_filename.startswith(self.folder):
            return None
        return self._line

    def _line(self, frame: Any, event: str, arg: Any) -> Any:
        self.lines.add((frame.f_code.co_filename, frame.f_lineno))
        return self._line

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins."""
        self.lines, self.begun = set(), time.monotonic()
        threading.settrace(self._call)
        sys.settrace(self._call)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """A test has ended."""
        sys.settrace(None)
        lines = sorted((os.path.relpath(file, ROOT), line) for file, line in self.lines)
        self.seen.append((nodeid, time.monotonic() - self.begun, lines))

    def pytest_sessionfinish(self) -> None:
        """All have."""
        self.out.write_text(json.dumps(self.seen))


def pytest_configure(config: Any) -> None:
    """Trace, where the environment says what and where to."""
    if "MUTANTS_TRACE" in os.environ:
        folder, out = os.environ["MUTANTS_TRACE"].split(os.pathsep)
        config.pluginmanager.register(Tracer(folder, Path(out)))


# -- running -----------------------------------------------------------------------------------------------------------


class Trial:
    """A copy of the checkout, and the tests of a room in it."""

    def __init__(self, copy: Path, tests: list[str], near: bool = False):
        self.copy, self.tests, self.near, self.seconds = copy, tests, near, 600.0
        self.reached: dict[tuple[str, int], list[tuple[float, str]]] = defaultdict(list)

    def trace(self, folder: str) -> float:
        """Run all tests once as the code is: how long they take. They have to pass."""
        out, begun = self.copy / "traced.json", time.monotonic()
        code, printed = self.run(self.tests, 3600, MUTANTS_TRACE=os.pathsep.join((str(self.copy / folder), str(out))))
        if code != 0:
            raise SystemExit(f"the tests fail before anything is planted:\n{printed[-3000:]}")
        for name, seconds, lines in json.loads(out.read_text()):
            for file, line in lines:
                self.reached[file, line].append((seconds, name))
        self.seconds = time.monotonic() - begun
        return self.seconds

    def run(self, tests: list[str], limit: float, **variables: str) -> tuple[int | None, str]:
        """The exit code of pytest, None after the limit; and what it printed.

        In a fork of this process, which has imported the libraries and nothing of ours.
        """
        words = ["-x", "-q", "-p", "mutants", "-p", "no:cacheprovider", *tests]
        with tempfile.TemporaryFile("w+") as printed:
            child = os.fork()
            if not child:
                self._become_pytest(words, printed.fileno(), variables)
            end = time.monotonic() + limit
            while not (ended := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < end:
                time.sleep(0.02)
            if not ended[0]:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
            printed.seek(0)
            return os.waitstatus_to_exitcode(ended[1]) if ended[0] else None, printed.read()

    def _become_pytest(self, words: list[str], printed: int, variables: dict[str, str]) -> None:
        os.setsid()
        for stream, file in ((0, os.open(os.devnull, os.O_RDONLY)), (1, printed), (2, printed)):
            os.dup2(file, stream)
        os.chdir(self.copy)
        places = [str(self.copy), str(self.copy / "scripts")]
        sys.path[:] = [*places, *(place for place in sys.path if place not in PLACES)]
        sys.dont_write_bytecode = True  # two changes of a file within one second have one date
        os.environ |= {"PYTHONPATH": os.pathsep.join(places), "PYTHONDONTWRITEBYTECODE": "1", **variables}
        import pytest

        code = 1
        try:
            code = int(pytest.main(words))
        finally:
            sys.stdout.flush()
            os._exit(code)

    def survives(self, mutant: Mutant) -> bool:
        """Whether no test notices the mutant."""
        path = self.copy / mutant.file
        before = path.read_bytes()
        path.write_bytes(before[: mutant.start] + mutant.new.encode() + before[mutant.end :])
        try:
            near = sorted(self.reached.get((mutant.file, mutant.line), ()))
            names = list(dict.fromkeys(name.partition("[")[0] for _, name in near))  # with all their parameters
            if names:
                usual = sum(seconds for seconds, _ in near)
                unseen = self.run(names, SLOWER * usual + GRACE)[0] == 0
                if self.near or not unseen:
                    return unseen
            return self.run(self.tests, SLOWER * self.seconds + GRACE)[0] == 0
        finally:
            path.write_bytes(before)


def copied(folder: Path) -> Path:
    """The checkout without what git ignores."""
    for name in COPIED:
        source, target = ROOT / name, folder / name
        if source.is_dir():
            shutil.copytree(source, target, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
        else:
            shutil.copy(source, target)
    return folder


def main(words: list[str] | None = None) -> int:
    """Plant, run and report; the exit code is 3 where mutants survive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("room", help="a folder of bench/")
    parser.add_argument("--files", nargs="*", help="only these files of the room")
    parser.add_argument("--lines", nargs=2, type=int, metavar=("FIRST", "LAST"), help="only mutants of these lines")
    parser.add_argument("--tests", nargs="*", help="instead of tests/ROOM")
    parser.add_argument("--sample", type=int, default=50, help="how many mutants, 0 for all (default 50)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument("--minutes", type=float, default=15.0, help="begin none after so many (default 15)")
    parser.add_argument("--near", action="store_true", help="a line that tests reach is tried with those alone")
    parser.add_argument("--list", action="store_true", help="print the mutants, and run nothing")
    options = parser.parse_args(words)
    room = ROOT / "bench" / options.room
    files = [path for path in sorted(room.glob("**/*.py")) if not options.files or path.name in options.files]
    first, last = options.lines or (0, 10**9)
    mutants = [mutant for path in files for mutant in mutants_of(path) if first <= mutant.line <= last]
    if not mutants:
        parser.error(f"nothing to change in {room}")
    count, end = len(mutants), time.monotonic() + 60 * options.minutes
    random.Random(options.seed).shuffle(mutants)
    mutants = mutants[: options.sample or count]
    if options.list:
        print(*(f"{mutant.file}:{mutant.line}: {mutant.what}" for mutant in mutants), sep="\n")
        return 0
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # forks are made of this process
    for name in WARM:
        importlib.import_module(name)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        trial = Trial(copied(Path(folder)), options.tests or [f"tests/{options.room}"], options.near)
        print(
            f"{count} mutants, {len(mutants)} in the sample; tests pass in {trial.trace(f'bench/{options.room}'):.0f} s"
        )
        return report(trial, mutants, end)


def report(trial: Trial, mutants: list[Mutant], end: float) -> int:
    """Try each, until time is over; print the survivors as they are found."""
    tried = survived = 0
    for mutant in mutants:
        if time.monotonic() > end:
            break
        tried += 1
        if trial.survives(mutant):
            survived += 1
            print(f"{mutant.file}:{mutant.line}: {mutant.what}", flush=True)
    print(f"{tried} of {len(mutants)} tried: {tried - survived} killed, {survived} survived")
    return 3 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
