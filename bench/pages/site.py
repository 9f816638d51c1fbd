"""The page as a folder: an index, and a page for each task, dataset and method, for any static host or the disk.

::

    FOLDER/index.html                    everything
    FOLDER/task|dataset|method/NAME.html the part about one of them
    FOLDER/assets/                       the script and the licences, once
    FOLDER/data/*.js, geometry/*.js      what the pages show, as scripts: pages from the disk may read nothing else
    FOLDER/site.json                     the written files, so that stale ones are removed next time

All tables come from one computation over all rows: a method's page has its ranks among all methods.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import UsageError
from ..results.files import write_atomically
from ..results.kept_outputs import file_name
from .assemble import NO_SCRIPT, built, encoded, head, policy
from .encoding import script_json

MANIFEST = "site.json"
KINDS = ("task", "dataset", "method")
ASSETS = ("page.js", "LICENCES.txt")
LOADER = (
    "for (const source of ADDRESSES) document.body.append("
    "Object.assign(document.createElement('script'), { src: source, async: false }));"
)
Data = dict[str, Any]


def site(data: Mapping[str, Any], geometry: Mapping[str, bytes]) -> dict[str, str]:
    """The files of the folder.

    Parameters
    ----------
    data : mapping
        Of :func:`bench.pages.data.page_data`, with its scenes.
    geometry : mapping of str to bytes
        The shapes that the scenes name.

    Returns
    -------
    dict of str to str
        By path, relative to the folder, with ``/``.
    """
    pages = list(_pages(data))
    links = [{"kind": kind, "name": name, "href": path} for kind, name, path, _ in pages]
    files = {f"assets/{name}": built(name) for name in ASSETS}
    for kind, name, path, content in pages:
        up = "../" * path.count("/")
        stored = f"data/{'index' if kind == 'index' else path.removesuffix('.html').replace('/', '-')}.js"
        title = str(data["title"]) if kind == "index" else f"{name} · {data['title']}"
        there = {"root": up, "pages": links, "kind": kind, "name": name}
        files[path] = _html(title, up, stored)
        folder = script_json(f"{up}geometry/")
        files[stored] = (
            f"detailbenchGeometryFolder = {folder};\n"
            f"detailbenchData = {script_json(content | {'title': title, 'site': there})};\n"
        )
    for name, shape in geometry.items():
        files[f"geometry/{name}.js"] = (
            f"(globalThis.detailbenchGeometry ??= {{}})[{script_json(name)}] = {script_json(encoded(shape))};\n"
        )
    return files


def _html(title: str, up: str, stored: str) -> str:
    """A page: its only script loads the others, so that its rule can name the digest of that one.

    A rule with addresses would not work: browsers disagree on their meaning for pages from the disk.
    """
    addresses = script_json([f"{up}{stored}", f"{up}assets/page.js"])
    script = LOADER.replace("ADDRESSES", addresses)
    return (
        f"{head(title, policy(script, may_load=True))}<style>{built('page.css')}</style>\n</head>\n<body>\n{NO_SCRIPT}"
        f"<script>{script}</script>\n</body>\n</html>\n"
    )


def _pages(data: Mapping[str, Any]) -> Iterator[tuple[str, str, str, Data]]:
    """Kind, name, path and data of each page."""
    yield "index", str(data["title"]), "index.html", dict(data)
    for kind in KINDS:
        column = data["cases"]["columns"].get(kind)
        values = _values(column)
        names = sorted(set(values))
        for name in names if kind == "method" or len(names) > 1 else ():
            path = f"{kind}/{file_name(name, '.html')}"
            yield kind, name, path, _narrowed(data, kind, name, [i for i, v in enumerate(values) if v == name])


def _values(column: Any) -> list[str]:
    return [column["values"][code] for code in column["codes"]] if isinstance(column, dict) else []


def _narrowed(data: Mapping[str, Any], kind: str, name: str, rows: list[int]) -> Data:
    """The part about one task, dataset or method: its rows, and the tables that it is in."""
    place = {old: new for new, old in enumerate(rows)}
    groups = [group for group in data["groups"] if _concerns(group, kind, name)]
    ways = [way for way in data["ways"] if any(group["by"] == way["name"] for group in groups)]
    cases = data["cases"]
    columns = {key: _taken(column, rows) for key, column in cases["columns"].items()}
    known = set(_values(columns["cell"]))
    finished = sorted(filter(None, _values(columns.get("finished"))))
    about = dict(data["about"]) | {
        "rows": len(rows),
        "solved": sum(status == "ok" for status in _values(columns["status"])),
        "cells": len(known),
        "methods": len(set(zip(_values(columns["method"]), _values(columns["variant"]), strict=True))),
        "datasets": len(set(_values(columns["dataset"]))),
        "shapes": len(set(zip(*(_values(columns[key]) for key in ("dataset", "split", "case")), strict=True))),
        "first": finished[0] if finished else "",
        "last": finished[-1] if finished else "",
    }
    return dict(data) | {
        "about": about,
        "ways": ways,
        "groups": groups,
        "focus": name if kind == "method" else "",
        "cases": cases
        | {
            "columns": columns,
            "count": len(rows),
            "cells": {cell: told for cell, told in cases["cells"].items() if cell in known},
        },
        "failures": [one for one in data["failures"] if one[kind] == name],
        "traces": [trace | {"row": place[trace["row"]]} for trace in data["traces"] if trace["row"] in place],
        "scenes": [scene for scene in data["scenes"] if kind == "method" or scene.get(kind) == name],
        "published": data["published"] if kind == "method" else [],
    }


def _concerns(group: Mapping[str, Any], kind: str, name: str) -> bool:
    """Whether a table belongs to a task or a dataset (pooled ones do not), or contains a method."""
    if kind == "method":
        return any(one["method"] == name for one in group["contenders"])
    # A table by tag over several datasets is named by its tag alone.
    return group[kind] == name


def _taken(column: Any, rows: list[int]) -> Any:
    take: Callable[[list], list] = lambda values: [values[row] for row in rows]  # noqa: E731
    if not isinstance(column, dict):
        return take(column)
    codes = take(column["codes"])
    kept = {code: place for place, code in enumerate(dict.fromkeys(codes))}
    return {"values": [column["values"][code] for code in kept], "codes": [kept[code] for code in codes]}


def write_site(folder: Path, files: Mapping[str, str]) -> None:
    """Write the files, and remove those of an earlier site in the folder that are no longer part of it.

    Raises
    ------
    UsageError
        If the folder holds anything but a site.
    """
    earlier = earlier_files(folder)
    for name, content in files.items():
        write_atomically(folder / name, content.encode())
    write_atomically(folder / MANIFEST, (json.dumps({"files": sorted(files)}, indent=1) + "\n").encode())
    for name in earlier - set(files):
        (folder / name).unlink(missing_ok=True)


def earlier_files(folder: Path) -> set[str]:
    """The files of the site that is in the folder; none if it is empty or missing."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--output {folder}: is a file; expected a folder")
    if not folder.is_dir() or not any(folder.iterdir()):
        return set()
    try:
        names = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(
            f"--output {folder}: the folder is not empty and holds no site of detailbench (no {MANIFEST} that can be "
            "read); name another folder"
        ) from error
    # A manifest may be somebody else's: only files that this module writes are removed.
    tops = ("assets", "data", "geometry", *KINDS)
    parts = {str(name): PurePosixPath(str(name)).parts for name in names}
    return {name for name, path in parts.items() if len(path) == 2 and path[0] in tops and path[1] != ".."}
