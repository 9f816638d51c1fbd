"""The checks of ``detailbench check`` for a dataset: ids, determinism, exact surfaces, attributes, pairs, splits."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any

import numpy as np

from ..contract.shape import PoseTransfer, Shape, ShapePair
from ..errors import BadInput, InvalidOutput, UsageError
from ..plugins.schema import build

LISTED = 16  # items of a split whose ids are checked, without making them
MADE = 3  # of these, how many are made
SAID = 3  # complaints of one kind that are printed
EXACT = ("analytic", "implicit", "parametric")  # exactness that promises a surface beyond the mesh
DIGITS = 6  # of a coordinate that count where two shapes are compared by content

Line = tuple[str, str, str]  # name, verdict (ok, warn, fail), detail: as in bench.authoring.conformance.Check
Run = Callable[..., dict[str, Any]]


# -- the verdicts, in the process of the command -----------------------------------------------------------------------


def dataset_checks(run: Run, functions: tuple[str, ...]) -> Iterator[Line]:
    """The lines of the report on a dataset.

    Parameters
    ----------
    run : runs one trial in a child process: ``run("items", function="shapes", split="test", deep=True)``
    functions : of the dataset, that give the items of a split: ``shapes``, ``pairs``, ...
    """
    if not functions:
        yield "shapes", "fail", "a dataset needs a function shapes(split), or pairs(split)"
    for function in functions:
        test = run("items", function=function, split="test", deep=True)
        if test["status"] != "ok":
            yield function, "warn" if test["status"] == "refused" else "fail", test["message"]
            continue
        yield function, "ok", test["output"]
        again = run("items", function=function, split="test", deep=False)
        same = all(test[key] == again.get(key) for key in ("ids", "digests"))
        yield f"same {function} every time", "ok" if same else "fail", "" if same else "draw from bench.generator(...)"
        yield from _findings(function, "", test)
        yield from _train(run, function, test)


def _train(run: Run, function: str, test: dict[str, Any]) -> Iterator[Line]:
    train = run("items", function=function, split="train", deep=True)
    name = f"train split of {function}"
    if train["status"] != "ok":
        yield name, "warn" if train["status"] == "refused" else "fail", train["message"]
        return
    yield from _findings(function, " of the train split", train)
    shared = [f"both splits have the id {id}" for id in test["ids"] if id in train["ids"]]
    meshes = {digest: name for name, digest in _own_meshes(train).items()}
    shared += [f"{n} and {meshes[d]} have the same mesh" for n, d in _own_meshes(test).items() if d in meshes]
    yield name, "fail" if shared else "ok", _joined(shared) or "no id and no mesh of the test split is in it"


def _own_meshes(row: dict[str, Any]) -> dict[str, str]:
    """The digests of the meshes of a split by name, except for a template shared by all its pairs."""
    items = row["contents"]
    common = set.intersection(*(set(meshes.values()) for meshes in items.values())) if len(items) > 1 else set()
    if any(common.issuperset(meshes.values()) for meshes in items.values()):  # nothing would remain
        common = set()
    return {f"{i} {n}".strip(): d for i, meshes in items.items() for n, d in meshes.items() if d not in common}


def _findings(function: str, where: str, row: dict[str, Any]) -> Iterator[Line]:
    """A line for each property checked: the complaints about it, or what was found."""
    for what, (seen, complaints) in row["findings"].items():
        if seen or complaints:
            about = what if function == "shapes" else f"{function}: {what}"
            yield f"{about}{where}", "fail" if complaints else "ok", _joined(complaints) or seen


def _joined(complaints: list[str]) -> str:
    more = f"; and {len(complaints) - SAID} more" if len(complaints) > SAID else ""
    return "; ".join(complaints[:SAID]) + more


# -- the trial, in a child ---------------------------------------------------------------------------------------------


def item_functions(dataset: Any) -> tuple[str, ...]:
    """The functions of a dataset that take a split alone, ``shapes`` first: ``("shapes", "pairs", "transfers")``."""
    found = []
    for name in dir(dataset):
        function = None if name.startswith("_") or name in ("check", "count") else getattr(dataset, name, None)
        if callable(function) and list(inspect.signature(function).parameters) == ["split"]:
            found.append(name)
    return tuple(sorted(found, key=lambda name: (name != "shapes", name)))


def items_trial(plugin: Any, asked: dict[str, Any], spec: dict[str, Any], channel: Any) -> dict[str, Any]:
    """The first items of a split: what they are, and their faults.

    Returns
    -------
    dict
        ``output`` in words; ``ids``; ``digests`` of everything made, to the bit; ``contents``: for each id the
        digests of its meshes, which are invariant to place, size and order; ``findings``: what was
        checked (only where ``deep``), what was found, and a list of complaints.
    """
    try:
        items = list(islice(getattr(build(plugin, asked["values"]), asked["function"])(asked["split"]), LISTED))
    except UsageError as error:
        return {"status": "refused", "message": str(error)}
    if not items:
        raise BadInput(f"no {asked['function']} in the split {asked['split']!r}")
    ids = [_checked_id(item) for item in items]
    if len(set(ids)) < len(ids):
        raise InvalidOutput(f"two {asked['function']} have one id: {max(ids, key=ids.count)!r}")
    found = _Findings()
    for index, item in enumerate(items[:MADE]):
        channel.enter("case", index)
        found.add(item, asked["deep"], first=index == 0)
    return {"output": "; ".join(found.words), "ids": ids, "digests": found.digests} | {
        "contents": found.contents,
        "findings": found.seen(),
    }


def _checked_id(item: Any) -> str:
    id = getattr(item, "id", None)
    if not isinstance(id, str) or not re.fullmatch(r"[\w.+-]+", id):
        raise InvalidOutput(
            f"the id {id!r} of a {type(item).__name__} is not a valid file name; use letters, digits and ._+-"
        )
    return id


class _Findings:
    """What the checks find in the items that are made."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.digests: list[str] = []
        self.contents: dict[str, dict[str, str]] = {}
        self.exact: list[str] = []  # ids of shapes whose surface was compared with their mesh
        self.named: set[str] = set()  # of attributes
        self.complaints: dict[str, list[str]] = {"surface and mesh": [], "attributes": [], "correspondence": []}
        self.corresponding = 0

    def add(self, item: Any, deep: bool, first: bool) -> None:
        """Make one item; ``deep``: check all of it too (surfaces of a pair only for the first)."""
        shapes = {"": item} if isinstance(item, Shape) else shapes_of(item)
        if not shapes:
            raise InvalidOutput(f"{item!r}: expected a Shape, or an object with an id and Shapes in its attributes")
        self.contents[item.id] = {}
        for name, shape in shapes.items():
            framed, _ = shape.framed()
            self.digests.append(digest_arrays({**_arrays(shape.mesh), **_attributes(shape)}))
            self.contents[item.id][name] = content_digest(framed.mesh)
            self.named |= set(_attributes(shape))
            if deep:
                self.complaints["attributes"] += attribute_complaints(shape)
                if first or isinstance(item, Shape):
                    self._compare(framed)
        counts = " and ".join(str(n) for n in sorted({len(shape.mesh.vertices) for shape in shapes.values()}))
        names = "" if isinstance(item, Shape) else f"{', '.join(shapes)}: "
        self.words.append(f"{item.id} ({names}{counts} vertices)")
        if deep and not isinstance(item, Shape) and getattr(item, "corresponding", True):
            self.corresponding += isinstance(item, ShapePair)
            self.complaints["correspondence"] += correspondence_complaints(item, shapes)

    def _compare(self, shape: Shape) -> None:
        from .agreement import disagreements

        mesh, complaints = shape.mesh, []
        if mesh.is_watertight and mesh.volume < 0:
            complaints.append("the mesh's faces look inwards")
        if shape.is_exact:
            self.exact.append(shape.id)
            complaints += disagreements(mesh, shape.surface)
        elif shape.exactness in EXACT:
            complaints.append(f"exactness={shape.exactness!r} claims more than the mesh, but surface= is missing")
        self.complaints["surface and mesh"] += [f"{shape.id}: {complaint}" for complaint in complaints]

    def seen(self) -> dict[str, tuple[str, list[str]]]:
        """What was checked, in words, and the complaints."""
        words = {
            "surface and mesh": f"{len(self.exact)} agree" if self.exact else "",
            "attributes": ", ".join(sorted(self.named)),
            "correspondence": f"{self.corresponding} pairs have the same faces" if self.corresponding else "",
        }
        return {what: (words[what], complaints) for what, complaints in self.complaints.items()}


def shapes_of(item: Any) -> dict[str, Shape]:
    """The shapes in a pair, or in any other item with shapes, by attribute name."""
    names = [f.name for f in dataclasses.fields(item)] if dataclasses.is_dataclass(item) else []
    names = names or list(getattr(item, "_fields", vars(item) if hasattr(item, "__dict__") else ()))
    values = {name: getattr(item, name) for name in names}
    return {name: value for name, value in values.items() if isinstance(value, Shape)}


def _attributes(shape: Shape) -> Mapping[str, Any]:
    """The attributes; none if they are no mapping, which :func:`attribute_complaints` reports."""
    return shape.attributes if isinstance(shape.attributes, Mapping) else {}


def attribute_complaints(shape: Shape) -> list[str]:
    """What is wrong with the attributes of a shape.

    Each is an array, finite, with a row per vertex, per face, or per column of another one (the joints whose skinning
    weights are the columns of ``weights``).
    """
    attributes = shape.attributes
    if not isinstance(attributes, Mapping):
        return [f"{shape.id}: attributes are a {type(attributes).__name__}; expected a mapping of names to arrays"]
    arrays = {name: np.asarray(values) for name, values in attributes.items()}
    vertices, faces = len(shape.mesh.vertices), len(shape.mesh.faces)
    found = []
    for name, array in arrays.items():
        others = {a.shape[1] for n, a in arrays.items() if n != name and a.ndim == 2 and len(a) in (vertices, faces)}
        rows = len(array) if array.ndim else 0
        if not isinstance(name, str) or not name.isidentifier():
            found.append(f"the name {name!r} is not an identifier")
        elif array.dtype.kind not in "biufSU":
            found.append(f"{name} has the type {array.dtype}; expected numbers or strings")
        elif rows not in (vertices, faces) and rows not in others:
            found.append(
                f"{name} has the shape {array.shape}; expected a row per vertex ({vertices}) or face ({faces})"
            )
        elif array.dtype.kind == "f" and not np.isfinite(array).all():
            found.append(f"{name} has values that are NaN or infinite")
    return [f"{shape.id}: {complaint}" for complaint in found]


def correspondence_complaints(item: Any, shapes: Mapping[str, Shape]) -> list[str]:
    """What is wrong with the correspondence that a pair promises, and with landmarks, the vertices of each shape."""
    found = []
    meshes = {name: shape.mesh for name, shape in shapes.items()}
    if isinstance(item, ShapePair):
        counts = {name: (len(mesh.vertices), len(mesh.faces)) for name, mesh in meshes.items()}
        if len(set(counts.values())) > 1:
            words = ", ".join(f"{n} has {v} vertices and {f} faces" for n, (v, f) in counts.items())
            found.append(f"{words}; expected the same faces")
        elif not np.array_equal(meshes["source"].faces, meshes["target"].faces):
            found.append("source and target have as many faces, but not the same")
        rows = [{k: np.shape(v)[:1] for k, v in _attributes(shape).items()} for shape in shapes.values()]
        if rows[0] != rows[1]:
            found.append(f"source and target have other attributes: {sorted(rows[0])} and {sorted(rows[1])}")
    if isinstance(item, PoseTransfer):
        for one, other in (("template", "template_posed"), ("character", "character_posed")):
            if not np.array_equal(meshes[one].faces, meshes[other].faces):
                found.append(f"{one} and {other} have other faces; expected the same, in the same order")
        for name, places in item.landmarks.items():
            if np.shape(places) != (2, 3) or not np.isfinite(places).all():
                found.append(f"the landmark {name} is {places!r}; expected a place on template and character, (2, 3)")
        return [f"{item.id}: {complaint}" for complaint in found]
    count = min(len(mesh.vertices) for mesh in meshes.values())
    for name, vertex in dict(getattr(item, "landmarks", None) or {}).items():
        if not isinstance(vertex, (int, np.integer)) or not 0 <= vertex < count:
            found.append(f"the landmark {name} is {vertex!r}; expected a vertex, 0 to {count - 1}")
    return [f"{item.id}: {complaint}" for complaint in found]


def _arrays(mesh: Any) -> dict[str, np.ndarray]:
    return {"vertices": np.asarray(mesh.vertices), "faces": np.asarray(mesh.faces)}


def digest_arrays(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of named arrays, to the bit."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype} {array.shape}".encode() + array.tobytes())
    return total.hexdigest()


def content_digest(mesh: Any) -> str:
    """A digest of a framed mesh, invariant to its place, its size and the order of its vertices and faces."""
    rounded = np.round(np.asarray(mesh.triangles_center, dtype=np.float64), DIGITS) + 0.0  # + 0: minus zero is zero
    return digest_arrays({"faces": rounded[np.lexsort(rounded.T)]})
