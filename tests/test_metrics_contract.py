"""What every metric that is shipped promises: names, keys, kinds of output, floors, light imports."""

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape
from bench.registry import registry

KINDS = {
    "chamfer_l2_sum": ("lower", {"mesh", "cloud"}, {"chamfer_l2_sum"}),
    "chamfer_l1_mean": ("lower", {"mesh", "cloud"}, {"chamfer_l1_mean"}),
    "hausdorff": ("lower", {"mesh", "cloud"}, {"hausdorff"}),
    "p2f_mean": ("lower", {"mesh", "cloud"}, {"p2f_mean"}),
    "normal_angle_deg": ("lower", {"mesh", "cloud"}, {"normal_angle_deg"}),
    "fscore": ("higher", {"mesh", "cloud"}, {"fscore@0.01", "precision@0.01", "recall@0.01"}),
    "topology": ("reference", {"mesh"}, {"components", "genus", "boundary_edges", "watertight"}),
}


@pytest.fixture(scope="module")
def case():
    return Case("case", {}, Shape("case", trimesh.creation.icosphere(3)))


def scores(output, case, kind):
    plugins = [registry().find("metric", name) for name in KINDS]
    return {p.name: p.cls().score(output, case) for p in plugins if kind in p.options["outputs"]}


@pytest.mark.parametrize("name", KINDS)
def test_registered_as_promised(name):
    better, outputs, keys = KINDS[name]
    plugin = registry().find("metric", name)
    assert plugin.version == 1 and plugin.options["floor"] is True
    assert set(plugin.options["outputs"]) == outputs
    assert {plugin.better(key) for key in keys} == {better}


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_keys_and_values(kind, case):
    output = {"mesh": trimesh.creation.box(), "cloud": PointCloud(np.eye(3), np.eye(3))}[kind]
    for candidate in (output, case.perfect(output)):
        found = scores(candidate, case, kind)
        assert set(found) == {name for name, (_, outputs, _) in KINDS.items() if kind in outputs}
        for name, values in found.items():
            assert set(values) == KINDS[name][2]
            assert all(type(value) is float and np.isfinite(value) for value in values.values())


def test_equal_seeds_give_equal_scores(case):
    again = Case("case", {}, Shape("case", trimesh.creation.icosphere(3)))
    assert scores(trimesh.creation.box(), again, "mesh") == scores(trimesh.creation.box(), case, "mesh")


def test_topology_of_the_reference_is_its_floor(case):
    found = registry().find("metric", "topology").cls().score(case.perfect(trimesh.creation.box()), case)
    assert found == {"components": 1, "genus": 0, "boundary_edges": 0, "watertight": 1}


def test_genus_is_left_out_where_it_is_not_defined(case):
    fin = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False
    )
    found = registry().find("metric", "topology").cls().score(fin, case)
    assert found == {"components": 1, "boundary_edges": 6, "watertight": 0}


def test_importing_the_metrics_loads_no_heavy_library():
    code = (
        "import sys, pkgutil, importlib, bench.metrics as m, bench.geometry.comparison\n"
        "[importlib.import_module('bench.metrics.' + x.name) for x in pkgutil.iter_modules(m.__path__)]\n"
        "print([x for x in ('trimesh', 'scipy', 'igl', 'pykdtree', 'open3d', 'pandas') if x in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
