"""Prints the floor plan of the package from its imports: rooms, floors, arrows and circles.

    python scripts/house.py            # the summary, and the rooms floor by floor
    python scripts/house.py --arrows   # every arrow, with the imports that make it

A room is a folder of modules; a module that lies directly in ``bench/`` is a room of its own. An arrow leads from a
room to another one that it imports, inside functions too; imports for type checkers alone do not count. A circle is a
set of rooms that reach each other. A room stands one floor above the highest room that it imports; the rooms of a
circle share a floor.
"""

from __future__ import annotations

import argparse
import ast
import functools
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
WRITTEN_OUT = "bench/authoring/templates"  # files that `detailbench new` writes: data, and no part of the package
FOLDERS = {"bench": "bench", "methods": "bench.methods", "datasets": "bench.datasets", "metrics": "bench.metrics"}


class House(NamedTuple):
    """The rooms and what ties them."""

    arrows: Mapping[str, Mapping[str, tuple[str, ...]]]  # room -> imported room -> "module imports module"
    circles: tuple[tuple[str, ...], ...]
    floors: tuple[tuple[str, ...], ...]  # rooms by floor, from the ground

    @property
    def rooms(self) -> int:
        """How many rooms there are."""
        return len(self.arrows)

    @property
    def arrow_count(self) -> int:
        """How many arrows there are."""
        return sum(map(len, self.arrows.values()))


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Dotted name -> file of every module of the package; of a package its ``__init__``."""
    found = {}
    for top, package in FOLDERS.items():
        for file in sorted((root / top).rglob("*.py")):
            if file.is_relative_to(root / WRITTEN_OUT):
                continue
            parts = file.relative_to(root / top).with_suffix("").parts
            if top == "bench" and parts[0] in {*FOLDERS, "conf"}:
                continue  # a link to a plugin folder, which has an entry of its own
            found[".".join((package, *(part for part in parts if part != "__init__")))] = file
    return found


def imports(file: Path, package: str) -> Iterator[str]:
    """Full names of all that a file imports, inside functions too; what only type checkers see is left out."""
    yield from _imports(file.read_text(encoding="utf-8"), package)


@functools.cache  # a plan asks for each module a few times
def _imports(text: str, package: str) -> tuple[str, ...]:
    found = []
    for node in _statements(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = parts[: len(parts) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            found += [f"{module}.{alias.name}" for alias in node.names]
    return tuple(found)


def _statements(block: ast.AST) -> Iterator[ast.AST]:
    """All statements within one, at any depth; expressions, which hold none, are most of a tree and not looked at."""
    types = isinstance(block, ast.If) and any(
        getattr(part, "id", "") == "TYPE_CHECKING" for part in ast.walk(block.test)
    )
    for field in ("orelse",) if types else ("body", "orelse", "handlers", "finalbody", "cases"):
        for statement in getattr(block, field, ()):
            yield statement
            yield from _statements(statement)


def imports_of_modules(known: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Pairs of modules of the package: the one that imports, and the one that is imported."""
    for name, file in known.items():
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        for imported in imports(file, package):
            while imported and imported not in known:
                imported = imported.rpartition(".")[0]
            if imported and imported != name:
                yield name, imported


def room_of(module: str, known: Mapping[str, Path]) -> str:
    """The room that a module is in: ``bench.ranking.selection`` -> ``bench.ranking``, ``bench.errors`` -> itself."""
    if known[module].name == "__init__.py":
        return module
    room = module.rpartition(".")[0]
    return module if room == "bench" else room


def house(root: Path = ROOT) -> House:
    """The floor plan of the tree below ``root``."""
    known = modules(root)
    inside = {room_of(module, known) for module in known if known[module].name != "__init__.py"}
    arrows: dict[str, dict[str, list[str]]] = {room: {} for room in sorted(inside)}
    for importer, imported in imports_of_modules(known):
        here, there = room_of(importer, known), room_of(imported, known)
        if here in inside and there in inside and here != there:  # empty packages are no rooms
            arrows[here].setdefault(there, []).append(f"{importer} imports {imported}")
    told = {a: {b: tuple(sorted(set(why))) for b, why in sorted(others.items())} for a, others in arrows.items()}
    groups = _circles(told)
    return House(told, tuple(group for group in groups if len(group) > 1), _floors(told, groups))


def _circles(arrows: Mapping[str, Mapping[str, object]]) -> list[tuple[str, ...]]:
    """The sets of rooms that reach each other, by Tarjan's algorithm; most have one room."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[tuple[str, ...]] = []

    def visit(room: str) -> None:
        index[room] = low[room] = len(index)
        stack.append(room)
        for other in arrows[room]:
            if other not in index:
                visit(other)
                low[room] = min(low[room], low[other])
            elif other in stack:
                low[room] = min(low[room], index[other])
        if low[room] == index[room]:
            at = stack.index(room)
            found.append(tuple(sorted(stack[at:])))
            del stack[at:]

    for room in arrows:
        if room not in index:
            visit(room)
    return found


def _floors(arrows: Mapping[str, Mapping[str, object]], groups: list[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    group_of = {room: group for group in groups for room in group}
    below = {group: {group_of[b] for a in group for b in arrows[a]} - {group} for group in groups}
    floor: dict[tuple[str, ...], int] = {}
    for group in TopologicalSorter(below).static_order():
        floor[group] = 1 + max((floor[other] for other in below[group]), default=-1)
    top = max(floor.values(), default=-1)
    return tuple(
        tuple(sorted(room for group, number in floor.items() if number == wanted for room in group))
        for wanted in range(top + 1)
    )


def circles_of_modules(root: Path = ROOT) -> list[tuple[str, ...]]:
    """The sets of modules that import each other, inside functions too."""
    arrows: dict[str, dict[str, None]] = {name: {} for name in modules(root)}
    for importer, imported in imports_of_modules(modules(root)):
        arrows[importer][imported] = None
    try:
        tuple(TopologicalSorter(arrows).static_order())
    except CycleError:
        return [group for group in _circles(arrows) if len(group) > 1]
    return []


def main() -> None:
    """Print the plan."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arrows", action="store_true", help="print every arrow, with the imports that make it")
    options = parser.parse_args()
    plan = house()
    print(
        f"{plan.rooms} rooms on {len(plan.floors)} floors, {plan.arrow_count} arrows, {len(plan.circles)} circles of "
        f"rooms, {len(circles_of_modules())} circles of modules"
    )
    for number, rooms in reversed(list(enumerate(plan.floors))):
        print(f"  floor {number}: {', '.join(rooms)}")
    for circle in plan.circles:
        print(f"  circle: {', '.join(circle)}")
    if options.arrows:
        for room, others in plan.arrows.items():
            for other, why in others.items():
                print(f"  {room} -> {other}: {'; '.join(why)}")


if __name__ == "__main__":
    main()
