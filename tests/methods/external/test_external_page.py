"""The examples of docs/external.md work as printed."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

from bench import PointCloud, Run
from bench.methods.external.external import PLACES, External

TEXT = (Path(__file__).resolve().parents[3] / "docs" / "external.md").read_text(encoding="utf-8")
PRESETS = [yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)]
SCRIPT, READER = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def parameters(preset):
    return {key: value for key, value in preset.items() if key != "defaults"}


def test_the_script_works_as_described(tmp_path):
    (tmp_path / "smooth.py").write_text(SCRIPT)
    (preset,) = (p for p in PRESETS if p["name"] == "my_smooth")
    values = parameters(preset) | {"cwd": str(tmp_path)}
    values["command"] = values["command"].replace("python3", sys.executable)  # this one has numpy
    points = np.random.default_rng(0).uniform(size=(200, 3))
    output = External(**values).denoise(PointCloud(points), Run())
    nearest = cKDTree(points).query(points, k=16)[1]
    np.testing.assert_allclose(output.points, points[nearest].mean(axis=1), atol=1e-12)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset["name"])
def test_presets_have_valid_parameters(preset, monkeypatch):
    monkeypatch.setattr(External, "_find", lambda self, program, parameter: program)  # not installed here
    External(**parameters(preset))


def test_the_commands_of_containers_can_be_split_and_filled_in():
    commands = re.findall(r"^    (?:version_)?command: (.*)$", TEXT, re.MULTILINE)
    assert len(commands) == 4
    for command in commands:
        filled = [word.format_map(dict.fromkeys(PLACES, "x")) for word in shlex.split(command)]
        assert "{input}" not in " ".join(filled)


def test_every_parameter_and_placeholder_is_on_the_page():
    code = set(re.findall(r"\w+", " ".join(re.findall(r"`[^`\n]+`", re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL)))))
    assert {*External.__dataclass_fields__, *PLACES} <= code


def test_the_reader_of_the_manifest_runs(tmp_path):
    (tmp_path / "manifest.json").write_text('{"cases": [{"input": "a", "output": "b"}]}')
    solved = []
    exec(READER.replace('"FOLDER"', repr(str(tmp_path))), {"solve": lambda *paths: solved.append(paths)})
    assert solved == [(tmp_path / "a", tmp_path / "b")]
