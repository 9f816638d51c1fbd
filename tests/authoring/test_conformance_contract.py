"""``detailbench check``: parameters of every kind of plugin, and breaches of the contract as one message each."""

from __future__ import annotations

import re

import pytest

from bench.cli import main
from bench.commands.check import _own, settings
from bench.plugins.registry import registry

HEAD = "from dataclasses import dataclass, field\nfrom bench import register\n"
METHOD = """@register('method')
@dataclass(frozen=True)
class Mine:
    'A method.'
    {fields}
    def denoise(self, cloud, run): return cloud
"""
# A file, and what is said of it, with the line where that helps.
BREACHES = {
    "no default": (METHOD.format(fields="depth: int"), "parameter 'depth' needs a default, so that .*line 3"),
    "no default behind one": (
        METHOD.format(fields="a: int = 1\n    depth: int"),
        "every parameter needs a default; .*'depth' .*line 4",
    ),
    "mutable default": (METHOD.format(fields="a: list = []"), "mutable default .*use default_factory .*line 4"),
    "no dataclass": (METHOD.format(fields="a: int = 1").replace("@dataclass(frozen=True)\n", ""), "put @dataclass"),
    "no docstring": (METHOD.format(fields="a: int = 1").replace("'A method.'", ""), "give the class a docstring"),
    "no such kind": (METHOD.format(fields="a: int = 1").replace("'method'", "'metod'"), "Did you mean 'method'"),
    "type within a type": (
        METHOD.format(fields="a: list[complex] = field(default_factory=list)"),
        "method .*mine: parameter 'a': a config cannot hold the type <class 'complex'>",
    ),
    "type that is not there": (METHOD.format(fields="a: 'Nowhere' = 1"), "cannot be resolved .*'Nowhere'"),
    "default of another type": (
        METHOD.format(fields="a: int = '3'"),
        r"method\.a=3: expected a whole number \(int\), got the text '3'",
    ),
    "default refused": (
        METHOD.format(fields="a: int = 3\n    def __post_init__(self): raise ValueError('a: too many')"),
        "config round trip: a: too many",
    ),
    "no score": (METHOD.format(fields="a: int = 1").replace("'method'", "'metric'"), "a metric needs a function score"),
}  # fmt: skip


@pytest.fixture(scope="module")
def there(shells):
    """Where all of them are said."""
    return shells("contract")


@pytest.fixture(scope="module")
def failed(there):
    """The lines of the checks that failed, of each file."""
    names = {what: what.replace(" ", "_") for what in BREACHES}
    files = {what: there.work / f"{name}.py" for what, name in names.items()}
    for what, file in files.items():  # one name is registered once
        file.write_text((HEAD + BREACHES[what][0]).replace("Mine", f"{names[what].title()}Mine"))
    done = there.call("check", *files.values())
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    found, now = {what: [] for what in BREACHES}, ""
    for line in done.stdout.splitlines():
        now = next((what for what, file in files.items() if str(file) in line), now)
        if "FAIL" in line:
            found[now].append(line)
    return found


@pytest.mark.parametrize("what", BREACHES)
def test_a_breach_of_the_contract_is_one_message_without_a_traceback(failed, what):
    assert re.search(BREACHES[what][1], failed[what][0]), failed[what]


def test_an_error_of_the_plugin_s_own_has_the_traceback_that_begins_in_it(there):
    file = there.work / "own.py"
    file.write_text(HEAD + "def f():\n    raise RuntimeError('boom')\nf()\n")
    done = there.call("check", file)
    assert done.returncode == 3
    assert f"FAIL  {file}: RuntimeError: boom" in done.stdout
    lines = [line for line in done.stdout.splitlines() if line.startswith("  File")]
    assert lines == [f'  File "{file}", line 5, in <module>', f'  File "{file}", line 4, in f']


# -- parameters --------------------------------------------------------------------------------------------------------


def test_a_metric_and_a_task_take_their_parameters(there):
    words = ("fscore", "metric.fscore.t=0.05", "upsample", "task.ratio=3")
    done = there.call("check", *words)
    assert done.returncode == 0, done.stderr
    for seen in "fscore@0.05=", "exactly 3 x N points":
        assert seen in done.stdout


def test_the_name_of_a_metric_may_be_left_out():
    fscore, hausdorff = (registry().find("metric", name) for name in ("fscore", "hausdorff"))
    words = ["metric.t=0.05", "+metric.u=1", "metric.hausdorff.x=2", "sensor.count=7", "limit.seconds=3"]
    assert _own(words, fscore) == ["metric.fscore.t=0.05", "+metric.fscore.u=1"]
    assert _own(words[2:], hausdorff) == ["metric.hausdorff.x=2"]
    assert settings(fscore, "fscore", words[:1])[0] == {"_name_": "fscore", "t": 0.05}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fscore", "metric.t=far"), "metric.fscore.t=far: expected a number (float), got the text 'far'"),
        (("fscore", "metric.r=0.1"), "metric fscore has no parameter 'r'"),
        (("fscore", "metric.hausdorff.x=0.1"), "metric.hausdorff.x=0.1: expected limit.seconds=..., or a parameter"),
        (("gaussian", "sensor.unit=radiis"), "sensor.unit=radiis: expected one of radius, diagonal. Did you mean 'rad"),
        (("mixture", "dataset.of=[cda]"), "of: number 1: no dataset is called 'cda'"),
    ],
)
def test_a_parameter_that_is_wrong_is_reported_before_anything_is_tried(capsys, words, said):
    assert main(["check", *words]) == 1
    shown = capsys.readouterr()
    assert shown.out == "" and said in shown.err


LARGE = '''
from trimesh.creation import icosphere
from trimesh.transformations import quaternion_matrix
import itertools
import numpy as np
from bench import Shape

class Sphere:
    def __init__(self, radius): self.radius = radius
    def sample(self, count, rng):
        n = rng.normal(size=(count, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        return self.radius * n, n
    def closest(self, points):
        n = points / np.linalg.norm(points, axis=1, keepdims=True)
        return self.radius * n, n

@register("dataset")
@dataclass(frozen=True)
class Spheres:
    """Spheres."""
    larger: float = 1.0  # than the mesh

    def shapes(self, split):
        for index in itertools.count():
            n = index + (50 if split == "train" else 0)
            mesh = icosphere(2)
            mesh.apply_transform(quaternion_matrix(np.random.default_rng(n).normal(size=4)))
            yield Shape(f"{split}-{index}", mesh, surface=Sphere(self.larger), exactness="analytic")
'''


def test_a_dataset_whose_surface_is_half_as_large_again_fails(there):
    file = there.work / "spheres.py"
    file.write_text(HEAD + LARGE)
    done = there.call("check", file, "dataset.larger=1.5")
    assert done.returncode == 3, done.stdout + done.stderr
    for split in "", " of the train split":
        assert f"FAIL  surface and mesh{split}: " in done.stdout
    assert "100 % of its points are off the mesh, up to 0.5" in done.stdout
