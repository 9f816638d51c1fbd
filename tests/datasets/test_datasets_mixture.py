"""Several datasets in one: their shapes alternate, under unique ids."""

from __future__ import annotations

import json
from itertools import islice

import numpy as np
import pytest
import trimesh

from bench.datasets.files import Files
from bench.datasets.mixture import Mixture
from bench.engine.memo import Memo, RememberedDataset
from bench.errors import UsageError
from bench.geometry.io.files import save
from bench.plan.cell import Cell
from bench.plugins.catalog import mesh_hash
from bench.plugins.registry import registry
from bench.plugins.schema import build
from bench.results import provenance
from bench.sweep.composition import compose

SPLITS = ("test", "train")


def mixture(*of):
    return build(registry().find("dataset", "mixture"), {"of": list(of)})


def family(name, **values):
    return build(registry().find("dataset", name), values)


def first(dataset, count, split="test"):
    return list(islice(dataset.shapes(split), count))


@pytest.fixture
def folder(tmp_path):
    for number in range(2):
        save(trimesh.creation.icosphere(1, radius=1 + number), tmp_path / f"scan{number}.ply")
    return tmp_path


@pytest.mark.parametrize("split", SPLITS)
def test_the_shapes_of_the_families_alternate(split):
    names = ["cad", "bumps", "furniture"]
    found = first(mixture(*names), 9, split)
    for position, name in enumerate(names):
        for mine, theirs in zip(found[position::3], first(family(name), 3, split), strict=True):
            assert mine.id == theirs.id  # so sensors draw the same noise
            assert (mine.tags, mine.exactness) == (theirs.tags, theirs.exactness)
            assert mine.info == {**theirs.info, "family": name}
            assert mesh_hash(mine.mesh) == mesh_hash(theirs.mesh)
            assert mine.is_exact == theirs.is_exact
            assert {k: v.tolist() for k, v in mine.attributes.items()} == {
                k: v.tolist() for k, v in theirs.attributes.items()
            }


def test_the_exact_surface_is_that_of_the_family():
    (mine,), (theirs,) = first(mixture("bumps"), 1), first(family("bumps"), 1)
    for a, b in zip(*(s.surface.sample(50, np.random.default_rng(1)) for s in (mine, theirs)), strict=True):
        assert np.array_equal(a, b)


def test_parameters_and_a_repeated_family():
    found = first(mixture({"cad": {"kind": "gear"}}, {"cad": {"kind": "plate"}}), 4)
    assert [s.id for s in found] == [
        "cad-test-000-gear",
        "cad.2-cad-test-000-plate",
        "cad-test-001-gear",
        "cad.2-cad-test-001-plate",
    ]
    assert [s.info["family"] for s in found] == ["cad", "cad.2"] * 2
    assert mesh_hash(found[3].mesh) == mesh_hash(first(family("cad", kind="plate"), 2)[1].mesh)


def test_an_exhausted_family_is_left_out(folder):
    mixed = mixture("cad", {"files": {"path": str(folder)}}, "furniture")
    names = [s.info["family"] for s in first(mixed, 10)]
    assert names == ["cad", "files", "furniture"] * 2 + ["cad", "furniture"] * 2
    assert [s.id for s in mixture({"files": {"path": str(folder)}}).shapes("test")] == ["files-scan0", "files-scan1"]


def test_ids_are_unique_whatever_the_ids_within_families(tmp_path):
    for name in ("a", "files-a", "files-files-a", "cad-test-000-plate"):
        save(trimesh.creation.icosphere(1), tmp_path / f"{name}.off")
    found = [s.id for s in first(mixture("cad", {"files": {"path": str(tmp_path)}}, {"mixture": {"of": ["cad"]}}), 12)]
    assert len(set(found)) == len(found)
    assert found[2].startswith("mixture-cad-test-000-")


def test_nothing_is_built_before_it_is_needed(monkeypatch):
    made = []
    shape = first(family("cad"), 1)[0]
    monkeypatch.setattr(type(shape), "mesh", property(lambda self: made.append(self.id)))
    first(mixture("cad", "furniture"), 6)
    assert made == []


@pytest.mark.parametrize("split", SPLITS)
def test_pairs_are_those_of_families_with_pairs(split):
    found = list(islice(mixture("cad", "reliefs", "furniture").pairs(split), 4))
    theirs = [list(islice(family(name).pairs(split), 2)) for name in ("reliefs", "furniture")]
    for mine, pair in zip(found, [theirs[0][0], theirs[1][0], theirs[0][1], theirs[1][1]], strict=True):
        assert (mine.id, dict(mine.landmarks)) == (pair.id, dict(pair.landmarks))
        assert [mine.source.id, mine.target.id] == [pair.source.id, pair.target.id]
        assert sorted(mine.source.attributes) == sorted(pair.source.attributes)
    assert mesh_hash(found[1].target.mesh) == mesh_hash(theirs[1][0].target.mesh)
    assert not hasattr(mixture("cad", "bumps"), "pairs")


def test_the_state_is_that_of_the_files_and_absent_without_files(folder):
    assert not hasattr(mixture("cad"), "state")
    mixed = mixture("cad", {"files": {"path": str(folder)}})
    assert mixed.state() == {f"files: {key}": value for key, value in Files(str(folder)).state().items()}


def cell(*overrides):
    from omegaconf import OmegaConf

    return Cell.from_config(OmegaConf.to_container(compose(["dataset=mixture", *overrides])))


def test_the_fingerprint_covers_the_families_and_the_files(folder, monkeypatch):
    words = f"dataset.of=[{{files:{{path:'{folder}'}}}},{{mixture:{{of:[cad]}}}}]"
    one = cell(words)
    assert [p.name for p in one.dataset.parts] == ["mixture", "files", "mixture", "cad"]
    assert Cell.from_json(json.loads(json.dumps(one.to_json()))) == one
    before, keys = provenance.ingredients(one), provenance.memory_keys(one)
    save(trimesh.creation.icosphere(1, radius=5), folder / "scan0.ply")
    assert [k for k, v in provenance.ingredients(one).items() if before[k] != v] == ["file files: scan0 (scan0.ply)"]
    assert provenance.memory_keys(one)["dataset"] != keys["dataset"]
    real = provenance.source_digest
    monkeypatch.setattr(provenance, "source_digest", lambda file: real(file) + ("x" if file.stem == "cad" else ""))
    assert provenance.ingredients(one)["source of dataset cad"] == before["source of dataset cad"] + "x"


def test_the_memo_of_a_sweep_caches_the_meshes(tmp_path):
    remembered = RememberedDataset(mixture("cad", "furniture"), Memo(tmp_path, "key"))
    meshes = [mesh_hash(s.mesh) for s in islice(remembered.shapes("test"), 4)]
    assert len(list(tmp_path.glob("*/*.npz"))) == 4
    assert meshes == [mesh_hash(s.mesh) for s in islice(remembered.shapes("test"), 4)]
    assert meshes == [mesh_hash(s.mesh) for s in first(mixture("cad", "furniture"), 4)]


@pytest.mark.parametrize(
    ("of", "words"),
    [
        ([], "of: expected at least one dataset"),
        (["cda"], "of: number 1: no dataset is called 'cda'.*'cad'"),
        (["cad", {"cad": {"knid": "gear"}}], "of: number 2: dataset cad has no parameter 'knid'.*'kind'"),
        (["cad", {"cad": {"kind": "gaer"}}], "of: number 2: dataset.kind=gaer: expected one of .*'gear'"),
        ([{"cad": 3}], "of: the parameters of cad are 3"),
        ([{"cad": {}, "bumps": {}}], "of: number 1 is .*expected a name or"),
        ([3], r"dataset\.of\[0\]=3: expected a text"),
    ],
)
def test_errors_name_the_entry_of_the_mixture(of, words):
    with pytest.raises(UsageError, match=words):
        mixture(*of)


def test_the_check_of_a_part_runs_when_a_cell_is_planned(folder):
    with pytest.raises(UsageError, match="dataset.path=gone: no such file"):
        cell("dataset.of=[cad,{files:{path:gone}}]")
    files = f"dataset.of=[cad,{{files:{{path:'{folder}',train_share:0.0}}}}]"
    with pytest.raises(UsageError, match="split=train has no meshes"):
        cell(files, "split=train")
    assert cell(files).dataset.build() == Mixture(["cad", {"files": {"path": str(folder), "train_share": 0.0}}])
