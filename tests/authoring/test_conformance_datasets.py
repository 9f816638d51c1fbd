"""What the conformance kit says of datasets that break one promise each, and of those that break none."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import Shape, ShapePair, register
from bench.authoring.dataset_checks import content_digest, dataset_checks, item_functions, items_trial
from bench.geometry.mesh_surface import MeshSurface
from bench.plugins.registry import registry
from bench.plugins.schema import build

FAULTS = {
    # the fault: the line of the report that fails, and what it says
    "large surface": ("surface and mesh", "surface.sample: 100 % of its points are off the mesh"),
    "large surface of pairs": ("pairs: surface and mesh", "a-source: surface.sample: 100 %"),
    "no surface": ("surface and mesh", "exactness='parametric' claims more than the mesh, but surface= is missing"),
    "faces inwards": ("surface and mesh", "the mesh's faces look inwards"),
    "moody mesh": ("same shapes every time", "draw from bench.generator"),
    "moody attribute": ("same shapes every time", "draw from bench.generator"),
    "moody pairs": ("same pairs every time", "draw from bench.generator"),
    "rows": ("attributes", r"height has the shape (7,); expected a row per vertex (162) or face (320)"),
    "nan": ("attributes", "height has values that are NaN or infinite"),
    "objects": ("attributes", "height has the type object; expected numbers or strings"),
    "no mapping": ("attributes", "attributes are a list; expected a mapping"),
    "shared id": ("train split of shapes", "both splits have the id one-0"),
    "shared mesh": ("train split of shapes", "test-0 and train-0 have the same mesh"),
    "shared pair": ("train split of pairs", "a target and b source have the same mesh"),
    "other faces": ("pairs: correspondence", "as many faces, but not the same"),
    "other counts": ("pairs: correspondence", "source has 162 vertices and 320 faces, target has 42 vertices and 80"),
    "other attributes": ("pairs: correspondence", "have other attributes: ['height'] and []"),
    "landmark": ("pairs: correspondence", "the landmark tip is 999; expected a vertex, 0 to 161"),
    "id twice": ("shapes", "two shapes have one id: 'twin'"),
    "bad id": ("shapes", "the id 'a/b' of a Shape is not a valid file name"),
    "pair id twice": ("pairs", "two pairs have one id: 'a'"),
}


def lump(seed, subdivisions=2):
    """A body of 162 vertices that no other seed has."""
    mesh = icosphere(subdivisions)
    wave = np.random.default_rng(seed).normal(size=3)
    vertices = mesh.vertices * (1 + 0.2 * np.sin(mesh.vertices @ wave + seed))[:, None]
    return Trimesh(vertices, mesh.faces, process=False)


@dataclass
class Known:
    """The mesh as what a dataset knows exactly, times a factor."""

    mesh: Trimesh
    scale: float = 1.0

    def sample(self, number, rng):
        points, normals = MeshSurface(self.mesh).sample(number, rng)
        return self.scale * points, normals

    def closest(self, points):
        closest, normals = MeshSurface(self.mesh).closest(points / self.scale)
        return self.scale * closest, normals


def luck():
    return int.from_bytes(os.urandom(4), "big")


@register("dataset", name="one_fault")
@dataclass(frozen=True)
class OneFault:
    """Breaks one promise."""

    fault: str = ""
    of: int = 0  # how many shapes; 0 for no end

    def _shape(self, id, seed, pair=False):
        fault = self.fault
        mesh = lump(luck() if fault == ("moody pairs" if pair else "moody mesh") else seed)
        if fault == "faces inwards":
            mesh.invert()
        attributes: Any = {"height": mesh.vertices[:, 2].copy(), "side": np.arange(len(mesh.faces)) % 2}
        height = {"rows": np.ones(7), "nan": np.full(162, np.nan), "objects": np.full(162, None)}
        attributes["height"] = height.get(fault, attributes["height"] * (luck() if fault == "moody attribute" else 1))
        exact = fault in ("", "large surface", "large surface of pairs")  # to compare takes a fifth of a second
        large = fault == ("large surface of pairs" if pair else "large surface")
        return Shape(
            id,
            mesh,
            surface=Known(mesh, 1.5 if large else 1.0) if exact else None,
            exactness="parametric" if exact or fault == "no surface" else "mesh",
            attributes=[1] if fault == "no mapping" else attributes,
        )

    def shapes(self, split: str):
        for index in range(self.of) if self.of else count():
            seed = index + (100 if split == "train" else 0)
            id = {"shared id": f"one-{index}", "id twice": "twin", "bad id": "a/b"}.get(self.fault, f"{split}-{index}")
            shape = self._shape(id, seed)
            if self.fault == "shared mesh" and split == "train":  # elsewhere, larger, and in another order
                mesh, order = lump(index), np.random.default_rng(0).permutation(162)
                shape = shape.replace_mesh(
                    Trimesh(3 * mesh.vertices[order] + 5, np.argsort(order)[mesh.faces], process=False)
                )
                shape._attributes = {}
            yield shape

    def pairs(self, split: str):
        first = "a" if split == "test" else "b"
        for index in range(2):
            seeds = [1000 + index, 2000 + index] if split == "test" else [3000 + index, 4000 + index]
            if self.fault == "shared pair" and split == "train":
                seeds = [2000 + index, 4000 + index]
            id = first if index == 0 or self.fault == "pair id twice" else first + first
            source, target = (
                self._shape(f"{id}-{name}", seed, pair=True)
                for name, seed in zip(("source", "target"), seeds, strict=True)
            )
            if self.fault == "other faces":
                target = target.replace_mesh(Trimesh(target.mesh.vertices, target.mesh.faces[::-1], process=False))
            if self.fault == "other counts":
                target = Shape(target.id, lump(seeds[1], 1))
            if self.fault == "other attributes":
                source, target = (Shape(s.id, s.mesh, attributes=a) for s, a in ((source, HEIGHT), (target, {})))
            yield ShapePair(id, source, target, {"tip": 999 if self.fault == "landmark" else 3})


HEIGHT = {"height": np.ones(162)}


class Channel:
    def enter(self, *stage):
        pass


def report(**values):
    """The lines on the dataset, with its trials in this process."""
    plugin = registry().find("dataset", values.pop("name", "one_fault"))

    def run(trial, **asked):
        assert trial == "items"
        try:
            row = {"status": "ok", "message": ""} | items_trial(plugin, {"values": values, **asked}, {}, Channel())
        except Exception as error:
            row = {"status": "invalid", "message": str(error)}
        return row

    return list(dataset_checks(run, item_functions(build(plugin, values))))


def test_a_dataset_without_fault_passes_and_says_what_was_looked_at():
    lines = {name: (verdict, detail) for name, verdict, detail in report()}
    assert {verdict for verdict, _ in lines.values()} == {"ok"}
    assert lines["surface and mesh"][1] == lines["surface and mesh of the train split"][1] == "3 agree"
    assert lines["attributes"][1] == "height, side"
    assert lines["pairs: correspondence"][1] == "2 pairs have the same faces"
    assert lines["pairs"][1] == "a (source, target: 162 vertices); aa (source, target: 162 vertices)"


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_fails_its_line_and_is_reported(fault):
    name, words = FAULTS[fault]
    failed = {line: detail for line, verdict, detail in report(fault=fault) if verdict == "fail"}
    assert words in failed.pop(name)
    assert all(name in line or line.startswith(("pairs", "same", "train")) for line in failed), failed


def test_a_split_without_shapes_is_a_warning():
    lines = {name: (verdict, detail) for name, verdict, detail in report(name="files", path=os.devnull)}
    assert lines["shapes"][0] == "warn" and "holds no mesh file" in lines["shapes"][1]


def test_files_without_train_meshes_pass_with_a_warning_that_advises_what_to_do(tmp_path):
    lump(1).export(tmp_path / "a.ply")
    lines = {name: (verdict, detail) for name, verdict, detail in report(name="files", path=str(tmp_path))}
    assert lines["shapes"][0] == "ok"
    assert lines["train split of shapes"][0] == "warn" and "train_path" in lines["train split of shapes"][1]


@dataclass(frozen=True)
class Triple:
    """What a task over three shapes may be given: a template that all have, a pose of it, and another body."""

    id: str
    template: Shape
    posed: Shape
    body: Shape


@register("dataset", name="triples")
@dataclass(frozen=True)
class Triples:
    """Other items than shapes and pairs; all share one template."""

    leak: bool = False

    def triples(self, split: str):
        for index in range(2):
            seed = 2 * index + (100 if split == "train" and not self.leak else 0)
            shapes = (Shape("t", lump(9)), Shape("p", lump(10 + seed)), Shape("b", lump(11 + seed)))
            yield Triple(f"{split}-{index}", *shapes)

    def check(self, split: str):
        """No items, although it takes a split."""


@pytest.mark.parametrize("leak", [False, True])
def test_other_items_are_looked_at_too_and_may_share_a_template(leak):
    lines = {name: (verdict, detail) for name, verdict, detail in report(name="triples", leak=leak)}
    assert lines["triples"] == (
        "ok",
        "test-0 (template, posed, body: 162 vertices); test-1 (template, posed, body: 162 vertices)",
    )
    verdict, detail = lines["train split of triples"]
    assert (verdict == "fail") == leak
    assert not leak or "test-0 posed and train-0 posed have the same mesh" in detail


def test_a_dataset_of_nothing_is_told_what_it_needs():
    assert list(dataset_checks(None, ())) == [
        ("shapes", "fail", "a dataset needs a function shapes(split), or pairs(split)")
    ]


def test_rows_may_belong_to_the_columns_of_another_attribute():
    """The joints of a skeleton: a row for each column of the skinning weights."""
    from bench.authoring.dataset_checks import attribute_complaints

    mesh = lump(0)
    weights, joints = np.ones((162, 5)) / 5, np.zeros((5, 3))
    assert attribute_complaints(Shape("body", mesh, attributes={"weights": weights, "joints": joints})) == []
    assert attribute_complaints(Shape("body", mesh, attributes={"weights": weights, "joints": joints[1:]}))
    assert attribute_complaints(Shape("body", mesh, attributes={"joints": joints}))


def test_the_content_of_a_mesh_is_free_of_place_size_and_order():
    mesh, order = lump(4), np.random.default_rng(1).permutation(162)
    moved = Trimesh(7 * mesh.vertices[order] - 3, np.argsort(order)[mesh.faces], process=False)
    framed = [Shape("x", m).framed()[0].mesh for m in (mesh, moved, lump(5))]
    digests = [content_digest(m) for m in framed]
    assert digests[0] == digests[1] != digests[2]


def test_what_a_pair_promises_is_a_copy_away_from_failing():
    """The pair of the dataset without fault, with one index exchanged."""
    from bench.authoring.dataset_checks import correspondence_complaints, shapes_of

    pair = next(OneFault().pairs("test"))
    assert correspondence_complaints(pair, shapes_of(pair)) == []
    faces = pair.target.mesh.faces.copy()
    faces[0] = faces[0][[1, 2, 0]]
    other = replace(pair, target=pair.target.replace_mesh(Trimesh(pair.target.mesh.vertices, faces, process=False)))
    assert "not the same" in correspondence_complaints(other, shapes_of(other))[0]
