"""Plants one mistake after another in a room of the code, and prints those that the room's tests do not notice.

    python scripts/mutants.py ranking                              # 100 mutants of bench/ranking
    python scripts/mutants.py engine --sample 0 --minutes 60       # all mutants of bench/engine, for an hour at most
    python scripts/mutants.py ranking --files statistics.py places.py --sample 0    # all mutants of two files
    python scripts/mutants.py ranking --again printed.txt          # the survivors of a run that was printed there
    python scripts/mutants.py ranking --list                       # what would be planted, and nothing run

A mutant is one change: another comparison or arithmetic operator, `and` for `or`, a number plus one (from 100 on twice
the number), the other truth value, a condition negated, the branches of a conditional swapped, a statement removed on
which no name depends. A mutant is killed when a test fails, or takes far longer.

All mutants are written into a copy of the checkout at once, each behind a switch: a limit of the process (of POSIX
message queues, which nobody uses), which all that it starts inherits, whatever becomes of the environment. So the
tests are imported once, and each mutant is tried in a fork of that process. First, all tests of the room run without
any: they have to pass, and record which mutants each of them reaches, in its own process or another. A mutant is tried
with the tests that reach it: those of its file's name, then the others, the quickest first. One that is reached while
modules are imported is tried in a process that imports them anew, with all tests that reach anything of its file.

Only those that survive all are printed, with file, line and change. Survivors that change nothing that anybody can see
are to be expected: a larger buffer, an equivalent bound. mutmut and cosmic-ray have no sample by seed and no budget,
and do not remove statements.
"""

from __future__ import annotations

import argparse
import ast
import ctypes
import importlib
import itertools
import json
import os
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple, NoReturn

import psutil

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
HARMFUL = ("os.kill", "os.killpg", "os.sched_setaffinity")  # with the number of another process, such as that of init
REMOVED = (ast.Expr, ast.AugAssign, ast.Raise, ast.Delete)
WARM = (  # libraries of the code and plugins of pytest, and nothing of ours
    *("pytest", "hypothesis", "pytest_benchmark.plugin", "xdist.plugin"),
    *("hydra", "numpy", "pandas", "pyarrow.parquet", "rich", "scipy.stats", "trimesh"),
)
SLOWER = 5.0  # a mutant whose tests take so many times as long hangs
GRACE = 20.0  # seconds on top, for a machine that others use
OFF, TRACING, FIRST = 0, 1, 2  # the switch: no mutant; none, and what is reached is written down; mutant 0, 1, ...
UNSEEN = "  (no test reaches it)"
PASSED = 77  # the exit code where all tests have passed: 0 is also that of a mutant that ends the process
OVER = 124  # the exit code of a process that was ended, as of timeout(1)
SWITCH = '''"""Which mutant is on."""
import os, resource
now, seen = resource.getrlimit(resource.RLIMIT_MSGQUEUE)[0], set()
def at(number):
    if now == {tracing}:
        key = number, os.environ.get("PYTEST_CURRENT_TEST") or current()
        if key not in seen:
            seen.add(key)
            with open({reached!r}, "ab", buffering=0) as file:
                file.write(f"{{key[0]}} {{key[1]}}\\n".encode())
    return number + {first} == now
def current():
    if os.path.exists({test!r}):
        with open({test!r}) as file:
            return file.read()
    return ""
'''


class Mutant(NamedTuple):
    """One change of a file."""

    file: str  # below the checkout
    line: int
    what: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.what}"


# -- planting ----------------------------------------------------------------------------------------------------------


def mutants_of(path: Path) -> list[Mutant]:
    """All mutants of a file, in the order of its lines."""
    source = path.read_text()
    return [
        Mutant(str(path.relative_to(ROOT)), node.lineno, f"{_short(ast.get_source_segment(source, node))}  ->  {new}")
        for node, new in _changes(ast.parse(source))
    ]


def planted(source: str, first: int) -> str:
    """The module with all its mutants, numbered from ``first`` on; ``_planted(i)`` is whether the i-th is on."""
    tree = ast.parse(source)
    choices: dict[ast.AST, list[tuple[int, ast.AST]]] = defaultdict(list)
    for number, (node, new) in enumerate(_changes(tree), first):
        other = ast.parse(new).body[0] if isinstance(node, ast.stmt) else ast.parse(new, mode="eval").body
        choices[node].append((number, other))
    tree = _Planter(choices).visit(tree)
    place = 1 if ast.get_docstring(tree) is not None else 0
    while isinstance(tree.body[place], ast.ImportFrom) and tree.body[place].module == "__future__":
        place += 1
    tree.body.insert(place, ast.parse("from bench._planted import at as _planted").body[0])
    return ast.unparse(ast.fix_missing_locations(tree))


class _Planter(ast.NodeTransformer):
    """Puts a choice in the place of each node that has mutants."""

    def __init__(self, choices: dict[ast.AST, list[tuple[int, ast.AST]]]):
        self.choices = choices

    def visit(self, node: ast.AST) -> ast.AST:
        others = self.choices.get(node, ())
        chosen: Any = self.generic_visit(node)
        for number, other in others:
            test = ast.Call(ast.Name("_planted", ast.Load()), [ast.Constant(number)], [])
            chosen = ast.If(test, [other], [chosen]) if isinstance(node, ast.stmt) else ast.IfExp(test, other, chosen)
        return chosen


def _short(text: str | None) -> str:
    text = " ".join((text or "").split())
    return text if len(text) < 100 else f"{text[:97]}..."


def _changes(tree: ast.AST) -> list[tuple[Any, str]]:
    """Each node that is replaced, and the text in its place; in the order of the lines."""
    found = {(n.lineno, n.col_offset, n.end_lineno, n.end_col_offset, new): n for n, new in _each_change(tree)}
    return [(node, key[-1]) for key, node in sorted(found.items(), key=lambda item: item[0])]


def _each_change(tree: ast.AST) -> Iterator[tuple[Any, str]]:
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
            yield node, repr(node.value + (1 if abs(node.value) < 100 else node.value))
        elif isinstance(node, ast.Constant) and type(node.value) is bool:
            yield node, repr(not node.value)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """What is executed and is no declaration: without annotations, decorators and what only type checkers read."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "pattern"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
                continue
            if isinstance(child, ast.Call) and ast.unparse(child.func) in HARMFUL:
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


# -- processes ---------------------------------------------------------------------------------------------------------


def turn(switch: int) -> None:
    """Turn a mutant on, in this process and all that it starts."""
    resource.setrlimit(resource.RLIMIT_MSGQUEUE, (switch, resource.getrlimit(resource.RLIMIT_MSGQUEUE)[1]))
    if "bench._planted" in sys.modules:
        sys.modules["bench._planted"].now = switch


class Try(NamedTuple):
    """A mutant, what runs tests and returns the exit code, and after how many seconds that hangs."""

    number: int
    act: Callable[[], int]
    limit: float


def outcomes(tries: Iterable[Try], jobs: int, folder: Path) -> Iterator[tuple[int, int]]:
    """The numbers and exit codes of all tries, as they end."""
    coming, running = iter(tries), dict[int, int]()
    while True:
        while len(running) < jobs and (one := next(coming, None)):
            running[begin(one, folder / f"t{one.number}")] = one.number
        if not running:
            return
        process, status = os.wait()
        if process in running:
            number = running.pop(process)
            shutil.rmtree(folder / f"t{number}", ignore_errors=True)
            yield number, os.waitstatus_to_exitcode(status)


def begin(one: Try, folder: Path) -> int:
    """Start a try in a process below another, which ends it after the limit, and all that it has started."""
    if keeper := os.fork():
        return keeper
    code = 1
    try:
        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: processes without a parent become its own
        child = os.fork()
        if not child:
            os.setsid()
            folder.mkdir()
            os.environ |= {"TMPDIR": str(folder), "PYTEST_DEBUG_TEMPROOT": str(folder)}
            tempfile.tempdir = None
            redirect(os.devnull)
            turn(FIRST + one.number)
            end_with(lambda: one.act() or PASSED)
        end = time.monotonic() + one.limit
        while not (ended := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < end:
            time.sleep(0.01)
        code = os.waitstatus_to_exitcode(ended[1]) % 256 if ended[0] else OVER
        while children := psutil.Process().children():
            for process in children:
                process.kill()
                os.waitpid(process.pid, 0)
    finally:
        os._exit(code)


def redirect(printed: str | Path) -> None:
    """From here on nothing is read, and what is printed goes to a file."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for stream in (1, 2):
        os.dup2(os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)


def end_with(act: Callable[[], int]) -> NoReturn:
    """End this process with an exit code, and nothing else that was prepared for its end."""
    code = 1
    try:
        code = act()
    finally:
        sys.stdout.flush()
        os._exit(code)


# -- trying ------------------------------------------------------------------------------------------------------------


class Reach:
    """Which mutants each test reaches, and how long it takes."""

    def __init__(self, reached: str, seconds: dict[str, float]):
        self.seconds, self.tests, self.imported = seconds, defaultdict[int, set[str]](set), set[int]()
        of_file = defaultdict[str, set[str]](set)
        for name in seconds:
            of_file[name.partition("::")[0]].add(name)
        for line in reached.splitlines():
            number, _, test = line.partition(" ")
            name, _, phase = test.rpartition(" ")
            if not test:
                self.imported.add(int(number))
            elif phase == "(setup)":  # what it prepares may be for all tests of its file
                self.tests[int(number)] |= of_file[name.partition("::")[0]]
            else:
                self.tests[int(number)].add(name)

    def of(self, numbers: Iterable[int], file: str, seconds: float) -> list[str]:
        """The tests that reach any of these mutants of a file: those of its name, and others for so many seconds.

        The quickest first.
        """
        names = set().union(*(self.tests[number] for number in numbers))
        quickest = sorted(names, key=lambda name: (self.seconds[name], name))
        own = [name for name in quickest if f"/test_{Path(file).stem}" in name]
        others = [name for name in quickest if name not in own]
        sums = itertools.accumulate(self.seconds[name] for name in others)
        return [*own, *others[: sum(spent <= seconds for spent in sums)]]

    def limit(self, names: list[str]) -> float:
        """After how many seconds these tests hang."""
        return SLOWER * sum(self.seconds[name] for name in names) + GRACE


class Trial:
    """A copy of the checkout with all mutants, and the tests of a room in it."""

    def __init__(self, folder: Path, tests: Sequence[str], mutants: Sequence[Mutant], options: argparse.Namespace):
        self.folder, self.tests, self.mutants = folder, tests, mutants
        self.jobs, self.seconds, self.end = options.jobs, options.seconds, time.monotonic() + 60 * options.minutes
        self.copy, self.reached, self.test = copied(folder / "copy"), folder / "reached", folder / "test"
        first = dict[str, int]()
        for number, mutant in enumerate(mutants):
            first.setdefault(mutant.file, number)
        for file, number in first.items():
            path = self.copy / file
            path.write_text(planted(path.read_text(), number))
        self.reached.touch()
        switch = SWITCH.format(tracing=TRACING, first=FIRST, reached=str(self.reached), test=str(self.test))
        (self.copy / "bench" / "_planted.py").write_text(switch)

    def pytest(self, tests: Iterable[str], plugin: object = None) -> int:
        """Run pytest in this process, which has imported the libraries and nothing of ours."""
        os.chdir(self.copy)
        places = [str(self.copy), str(self.copy / "scripts")]
        sys.path[:] = [*places, *(place for place in sys.path if place not in PLACES)]
        os.environ["PYTHONPATH"] = os.pathsep.join(places)
        import pytest

        words = ["-x", "-q", "--capture=sys", "-p", "no:cacheprovider", *tests]  # no file that forks would share
        return int(pytest.main(words, plugins=[plugin] if plugin else []))

    def trace(self) -> Reach:
        """Run all tests without a mutant. They have to pass."""
        seconds, printed = self.folder / "seconds", self.folder / "printed"
        child = os.fork()
        if not child:
            redirect(printed)
            turn(TRACING)
            end_with(lambda: self.pytest(self.tests, Stopwatch(seconds, self.test)))
        if os.waitpid(child, 0)[1]:
            raise SystemExit(f"the tests fail before anything is planted:\n{printed.read_text()[-3000:]}")
        return Reach(self.reached.read_text(), json.loads(seconds.read_text()))

    def codes(self, numbers: Iterable[int], reach: Reach) -> Iterator[tuple[int, int]]:
        """Try mutants: the number and the exit code of each, as they come; PASSED is that of a survivor."""
        anew, there = list[int](), list[int]()
        for number in numbers:
            (anew if number in reach.imported else there).append(number)
        yield from self._in_forks(there, reach)
        yield from self.tried(anew, reach, self.pytest)

    def tried(self, numbers: list[int], reach: Reach, run: Callable[[list[str]], int]) -> Iterator[tuple[int, int]]:
        """The number and exit code of each as they end; none begins after the end of the time."""
        tries = (
            Try(number, lambda names=names: run(names) if names else 0, reach.limit(names))
            for number in numbers
            for names in [reach.of(self._near(number, reach), self.mutants[number].file, self.seconds)]
        )
        return outcomes(itertools.takewhile(lambda _: time.monotonic() < self.end, tries), self.jobs, self.folder)

    def _near(self, number: int, reach: Reach) -> list[int]:
        """The mutants whose tests try this one."""
        if number not in reach.imported:
            return [number]
        return [k for k, mutant in enumerate(self.mutants) if mutant.file == self.mutants[number].file]

    def _in_forks(self, numbers: list[int], reach: Reach) -> Iterator[tuple[int, int]]:
        source, sink = os.pipe()
        child = os.fork()
        if not child:
            redirect(os.devnull)
            turn(OFF)
            with open(sink, "w", buffering=1) as reports:
                end_with(lambda: self.pytest(self.tests, Forks(self, numbers, reach, reports)))
        os.close(sink)
        with open(source) as reports:
            for line in reports:
                number, code = map(int, line.split())
                yield number, code
        if os.waitpid(child, 0)[1]:
            raise SystemExit("the tests pass by themselves, and fail in a fork of a process that has collected them")


class Stopwatch:
    """A plugin of pytest that writes down how long each test takes, and which test it is, for children without that."""

    def __init__(self, file: Path, test: Path):
        self.file, self.test, self.seconds = file, test, dict[str, float]()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins."""
        self.test.write_text(f"{nodeid} (call)")

    def pytest_runtest_logreport(self, report: Any) -> None:
        """A phase of a test has ended."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration

    def pytest_sessionfinish(self) -> None:
        """All have."""
        self.file.write_text(json.dumps(self.seconds))


class Forks:
    """A plugin of pytest that tries mutants in forks of the process, which has collected the tests, and runs none."""

    def __init__(self, trial: Trial, numbers: list[int], reach: Reach, reports: IO[str]):
        self.trial, self.numbers, self.reach, self.reports, self.failed = trial, numbers, reach, reports, False

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Remember a failure."""
        self.failed |= report.failed

    def pytest_runtestloop(self, session: Any) -> bool:
        """Instead of the tests."""
        self.items = {item.nodeid: item for item in session.items}
        control = Try(OFF - FIRST, lambda: self._run(list(self.items)), self.reach.limit(list(self.items)))
        if dict(outcomes([control], 1, self.trial.folder)) != {control.number: PASSED}:
            raise session.Failed("the tests fail in a fork, without a mutant")
        for number, code in self.trial.tried(self.numbers, self.reach, self._run):
            print(number, code, file=self.reports)
        return True

    def _run(self, names: list[str]) -> int:
        items = [self.items[name] for name in names]
        for item, following in itertools.zip_longest(items, items[1:]):
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self.failed:
                return 1
        return 0


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
    parser.add_argument("--again", type=Path, metavar="FILE", help="only the survivors that were printed in this file")
    parser.add_argument("--tests", nargs="*", help="instead of tests/ROOM")
    parser.add_argument("--sample", type=int, default=100, help="how many mutants, 0 for all (default 100)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument("--minutes", type=float, default=15.0, help="begin none after so many (default 15)")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="of other files' tests (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="how many are tried side by side (default 1)")
    parser.add_argument("--list", action="store_true", help="print the mutants, and run nothing")
    options = parser.parse_args(words)
    room = ROOT / "bench" / options.room
    files = [path for path in sorted(room.glob("**/*.py")) if not options.files or path.name in options.files]
    first, last = options.lines or (0, 10**9)
    mutants = [mutant for path in files for mutant in mutants_of(path)]
    numbers = [number for number, mutant in enumerate(mutants) if first <= mutant.line <= last]
    if options.again:
        printed = {line.partition(UNSEEN)[0] for line in options.again.read_text().splitlines()}
        numbers = [number for number in numbers if str(mutants[number]) in printed]
    if not numbers:
        parser.error(f"nothing to change in {room}")
    count = len(numbers)
    if options.sample:
        random.Random(options.seed).shuffle(numbers)
        numbers = numbers[: options.sample]
    if options.list:
        print(*(mutants[number] for number in numbers), sep="\n")
        return 0
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # forks are made of this process
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    for name in WARM:
        importlib.import_module(name)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        trial = Trial(Path(folder), options.tests or [f"tests/{options.room}"], mutants, options)
        begun = time.monotonic()
        reach = trial.trace()
        seconds = time.monotonic() - begun
        print(f"{count} mutants, {len(numbers)} in the sample; tests pass in {seconds:.0f} s", flush=True)
        return report(trial.codes(numbers, reach), mutants, reach, len(numbers))


def report(codes: Iterable[tuple[int, int]], mutants: Sequence[Mutant], reach: Reach, count: int) -> int:
    """Print the survivors as they are found."""
    tried = survived = 0
    for number, code in codes:
        tried += 1
        if code == PASSED:
            survived += 1
            print(f"{mutants[number]}{'' if number in reach.tests or number in reach.imported else UNSEEN}", flush=True)
    print(f"{tried} of {count} tried: {tried - survived} killed, {survived} survived")
    return 3 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
