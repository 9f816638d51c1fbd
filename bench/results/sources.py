"""Digests of the sources that a result depends on: of a plugin's file, and of what it imports.

The digest is over the content of the sources, not over their place. It covers the text of each file without blank lines
and import statements, which are replaced by what they import: for a file of our own a digest over that
file's text and the name, for a library the dotted name. So a file that is moved, with its import lines and those of
others changed to the new place, keeps its digest; one that imports ``f`` from another module with another text does
not. Imports under ``if TYPE_CHECKING`` do not count.

Our own are the files beside a plugin and in its package, and of ``bench`` the rooms in :data:`COUNTED`, which
define a case and the scoring of its output. The rest of ``bench`` (registry, messages, tables) changes no
result: imports from there count by name only.

This module needs only the standard library: ``scripts/earlier_sources.py`` loads it for older versions too.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import io
import os
import re
import time
import tokenize
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeGuard

BENCH = Path(__file__).resolve().parents[1]
COUNTED = ("geometry", "contract", "tasks", "seeds")  # rooms and modules of bench that results depend on
PLUGINS = ("methods", "datasets", "metrics")  # links to folders beside bench, in a checkout
HOLE = re.compile(rb"\0(\d+)\0")  # the place of a run of import statements; no source contains a NUL

TICK_NS = 1_000_000_000  # two edits within one tick of a file system's clock leave the same times

Stamp = tuple[int, int, int, int]  # size, time of edit, time of change and number of a file
Stamps = tuple[Stamp, ...]
Key = tuple[str, Stamp]  # a path, and the stamp of its file


class Import(NamedTuple):
    """One name that a file imports.

    Attributes
    ----------
    dotted : str
        As written: ``numpy.linalg``, ``..geometry.check:check_mesh``.
    name : str
        The name taken from ``target``; empty if the module itself is imported.
    bound : str
        The name it has in the file.
    target : str or None
        The file of our own that it comes from; None for a library and for the rest of ``bench``.
    files : tuple of str
        All files of our own that it reads: a package in addition to the module in it.
    """

    dotted: str
    name: str
    bound: str
    target: str | None
    files: tuple[str, ...]


class Source(NamedTuple):
    """One file, split into lines and imports.

    Attributes
    ----------
    lines : tuple of (bytes, bool)
        With a hole for each run of imports, and whether the line counts even if it is blank (inside a string).
    runs : tuple of tuple of Import
    bare : str
        Digest over the lines without the imports.
    """

    lines: tuple[tuple[bytes, bool], ...]
    runs: tuple[tuple[Import, ...], ...]
    bare: str


def source_digest(file: Path) -> str:
    """Sixteen hexadecimal digits over a plugin's file and what it imports of our own, wherever these files are.

    Every cell needs those of all its plugins, several times: the sources are read again only when one has changed.
    """
    known = _digests.get(str(file))
    if known is not None and stamps(known[0]) == known[1]:
        return known[2]
    keys = tuple(_keys(file))
    files, before = [path for path, _ in keys], tuple(stamp for _, stamp in keys)
    found = _digest(keys)
    if all(map(_is_settled, before)):
        _digests[str(file)] = (files, before, found)
    return found


_digests: dict[str, tuple[list[str], Stamps | None, str]] = {}  # the sources of a file, their stamps, their digest


def stamps(files: Iterable[str]) -> Stamps | None:
    """Size, times and number of each file: they change when it is edited or replaced. None if one is gone."""
    try:
        return tuple(map(_stamp, files))
    except OSError:
        return None


def _stamp(file: str) -> Stamp:
    stat = os.stat(file)
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


def _is_settled(stamp: Stamp) -> bool:
    """Whether a file's last change is old enough for another one to change its times."""
    return time.time_ns() - max(stamp[1], stamp[2]) > TICK_NS


def source_closure(file: Path) -> set[Path]:
    """``file`` and, transitively, what it imports from its own folder or package, or from :data:`COUNTED`."""
    return {Path(path) for path, _ in _keys(file)}


def _keys(file: Path) -> list[Key]:
    """The closure, by path; each file with its stamp."""
    known: dict[str, Key] = {}
    todo = [os.path.realpath(file)]
    while todo:
        path = todo.pop()
        if path in known:
            continue
        try:
            known[path] = (path, _stamp(path))
        except OSError:
            continue  # it was removed since it was found
        todo.extend(read for run in _source(known[path]).runs for found in run for read in found.files)
    return sorted(known.values())


def _digest(keys: tuple[Key, ...]) -> str:
    sources = {key[0]: _source(key) for key in keys}
    texts = {_rendered(source, sources) for source in sources.values()} - {b""}
    total = hashlib.sha256()
    for one in sorted(hashlib.sha256(text).digest() for text in texts):
        total.update(one)
    return total.hexdigest()[:16]


def _rendered(source: Source, others: dict[str, Source] | None) -> bytes:
    """The text of a file, with its imports replaced by what they import; without them if ``others`` is None."""

    def fill(hole: re.Match[bytes]) -> bytes:
        if others is None:
            return b""
        return "\n".join(sorted({_brought(one, others) for one in source.runs[int(hole[1])]})).encode()

    filled = ((HOLE.sub(fill, line), counts) for line, counts in source.lines)
    return b"\n".join(line for line, counts in filled if counts or line.strip())


def _brought(one: Import, others: dict[str, Source]) -> str:
    known = others.get(one.target or "")
    what = f"{known.bare}:{one.name}" if known else one.dotted
    return f"{what} as {one.bound}"


# -- one file ----------------------------------------------------------------------------------------------------------


def _source(key: Key) -> Source:
    """A split file; read again if it changed just now, since another change may not show in its times."""
    return _known_source(*key) if _is_settled(key[1]) else _known_source.__wrapped__(*key)


@functools.lru_cache(maxsize=4096)
def _known_source(path: str, _: Stamp) -> Source:
    try:
        raw = Path(path).read_bytes()
    except OSError:
        raw = b""
    try:
        text = _decoded(raw).replace("\r\n", "\n").replace("\r", "\n")
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # not Python, or another version: every byte counts, and no import is known
        return Source(((raw, True),), (), hashlib.sha256(raw).hexdigest())
    lines = text.encode().split(b"\n")
    runs = list(_runs(tree.body))
    nodes = list(_walk(tree))
    hidden = list(_for_type_checkers(nodes))
    if os.path.basename(path) == "__init__.py" and _is_hollow(tree):
        hidden += [node for node in tree.body if isinstance(node, ast.Expr)]
    inside = _lines_of_strings(nodes)
    for node, hole in sorted(_cuts(runs, hidden), key=lambda cut: (cut[0].lineno, cut[0].col_offset), reverse=True):
        _cut(lines, node, hole)
        inside -= set(range(node.lineno, _end(node) + 1))
    kept = tuple((line, number in inside) for number, line in enumerate(lines, 1))
    found = tuple(tuple(one for node in run for one in _imports(node, path)) for run in runs)
    made = Source(kept, found, "")
    return made._replace(bare=hashlib.sha256(_rendered(made, None)).hexdigest())


def _decoded(raw: bytes) -> str:
    encoding, _ = tokenize.detect_encoding(io.BytesIO(raw).readline)
    return raw.decode(encoding)


def _end(node: ast.stmt | ast.expr) -> int:
    """The number of its last line, which every parsed node has."""
    return node.end_lineno or node.lineno


def _is_type_checking(node: ast.AST) -> TypeGuard[ast.If]:
    test = getattr(node, "test", None)
    return isinstance(node, ast.If) and "TYPE_CHECKING" in (getattr(test, "id", ""), getattr(test, "attr", ""))


def _for_type_checkers(nodes: Iterable[ast.AST]) -> Iterator[ast.stmt]:
    """The code for type checkers only: a whole ``if``, or its first branch if it has another."""
    for node in nodes:
        if _is_type_checking(node):
            yield from node.body if node.orelse else [node]


def _walk(tree: ast.AST) -> Iterator[ast.AST]:
    """Every node outside f-strings, whose inner positions differ between versions of Python."""
    todo = [tree]
    while todo:
        node = todo.pop()
        yield node
        if not isinstance(node, ast.JoinedStr):
            todo.extend(ast.iter_child_nodes(node))


def _runs(body: Sequence[ast.stmt]) -> Iterator[list[ast.stmt]]:
    """Import statements that follow each other, in every block: their order changes nothing."""
    run: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            run.append(node)
            continue
        if _is_type_checking(node) and not node.orelse:
            continue
        if run:
            yield run
            run = []
        for name, inner in ast.iter_fields(node):
            if _is_type_checking(node) and name == "body":
                continue
            if isinstance(inner, list) and inner and isinstance(inner[0], ast.stmt):
                yield from _runs(inner)
            elif name in ("handlers", "cases"):
                for part in inner:
                    yield from _runs(part.body)
    if run:
        yield run


def _is_hollow(tree: ast.Module) -> bool:
    """Whether a file only imports, with or without a docstring: it adds nothing to the digest."""
    return all(
        isinstance(node, ast.Import | ast.ImportFrom)
        or _is_type_checking(node)
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str))
        for node in tree.body
    )


def _lines_of_strings(nodes: Iterable[ast.AST]) -> set[int]:
    """The numbers of the lines that are part of a string of several lines: there, blank lines count."""
    return {
        number
        for node in nodes
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))
        if _end(node) > node.lineno
        for number in range(node.lineno, _end(node) + 1)
    }


def _cuts(runs: Iterable[list[ast.stmt]], hidden: Iterable[ast.stmt]) -> Iterator[tuple[ast.stmt, bytes]]:
    """The statements to cut, and the replacement of each."""
    for number, run in enumerate(runs):
        for node in run:
            yield node, f"\0{number}\0".encode() if node is run[0] else b""
    for node in hidden:
        yield node, b""


def _cut(lines: list[bytes], node: ast.stmt, hole: bytes) -> None:
    """Cut a statement from the lines, whose number stays the same; columns are bytes of UTF-8."""
    first, last = node.lineno - 1, _end(node) - 1
    tail = lines[last][node.end_col_offset :]
    head = lines[first][: node.col_offset]
    for number in range(first, last + 1):
        lines[number] = b""
    lines[first] = head + hole + tail


# -- what an import means ----------------------------------------------------------------------------------------------


def _imports(node: ast.stmt, importer: str) -> Iterator[Import]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            found = _locate(importer, 0, alias.name)
            file = _file(found, importer)
            told = "bench:" + alias.name.rpartition(".")[2] if found and found[0] == BENCH and not file else alias.name
            yield Import(told, "", alias.asname or alias.name, file, (file,) if file else ())
        return
    assert isinstance(node, ast.ImportFrom)
    module = node.module or ""
    found = _locate(importer, node.level, module)
    package = _file(found, importer)
    for alias in node.names:
        if (module, alias.name) == ("typing", "TYPE_CHECKING"):
            continue
        inner = _file((found[0], (*found[1], alias.name)), importer) if found and alias.name != "*" else None
        if found and found[0] == BENCH and not package:
            told = f"bench:{alias.name}"
        else:
            told = f"{'.' * node.level}{module}:{alias.name}"
        files = tuple(file for file in (package, inner) if file)
        yield Import(told, "" if inner else alias.name, alias.asname or alias.name, inner or package, files)


def _locate(importer: str, level: int, module: str) -> tuple[Path, tuple[str, ...]] | None:
    """A folder, and the parts of a module's name below it; None for other modules."""
    here, parts = Path(importer).parent, tuple(module.split(".")) if module else ()
    package = _place_in(BENCH, here)
    if level:
        if package is None:
            return here.joinpath(*[".."] * (level - 1)), parts
        above = len(package) - (level - 1)
        return (BENCH, (*package[:above], *parts)) if above >= 0 else None
    if parts[0] == "bench":
        return BENCH, parts[1:]
    if not (here / "__init__.py").exists():
        return here, parts  # a plain script finds its neighbours by name
    if package is None:
        top = here
        while (top.parent / "__init__.py").exists():
            top = top.parent
        if parts[0] == top.name:
            return top.parent, parts
    return None


@functools.lru_cache(maxsize=1024)
def _place_in(bench: Path, folder: Path) -> tuple[str, ...] | None:
    """The package of a folder below ``bench``, also if it is reached by a link; None for other folders."""
    for name, real in _folders(bench):
        if folder == real or real in folder.parents:
            return (*((name,) if name else ()), *folder.relative_to(real).parts)
    return None


@functools.cache
def _folders(bench: Path) -> tuple[tuple[str, Path], ...]:
    return (*((name, (bench / name).resolve()) for name in PLUGINS), ("", bench.resolve()))


def _file(found: tuple[Path, tuple[str, ...]] | None, importer: str) -> str | None:
    """The file of a module, if it counts and is not the importer itself."""
    if found is None:
        return None
    folder, parts = found
    if folder == BENCH and not (parts and parts[0] in (*COUNTED, *PLUGINS)):
        return None
    stem = folder.joinpath(*parts)
    names = (stem.with_name(f"{stem.name}.py"), stem / "__init__.py") if parts else (stem / "__init__.py",)
    for candidate in names:
        if candidate.is_file() and (real := os.path.realpath(candidate)) != importer:
            return real
    return None
