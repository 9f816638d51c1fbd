"""The narrow band: a fraction of the evaluations of the dense lattice, and little time besides them."""

import os
import time

import numpy as np
import pytest

from bench.methods.learned.meshing.marching import extract

SHORT = "DETAILBENCH_SHORT" in os.environ
RESOLUTION = 128 if SHORT else 256
LEAST = {"sphere": 4 if SHORT else 9, "torus": 6 if SHORT else 13}  # times fewer evaluations than on a dense lattice
OVERHEAD = 6e-6  # seconds per evaluation, besides the field; measured 0.8 to 3


def sphere(points):
    return np.linalg.norm(points - (0.05, -0.03, 0.02), axis=1) - 0.7


def torus(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.55, points[:, 2]) - 0.3


class Timed:
    """A field that counts evaluations and the seconds that they take."""

    def __init__(self, field):
        self.field, self.count, self.seconds = field, 0, 0.0

    def __call__(self, points):
        begin = time.process_time()
        values = self.field(points)
        self.seconds += time.process_time() - begin
        self.count += len(points)
        return values


@pytest.mark.parametrize("field", [sphere, torus])
def test_narrow_band(field, benchmark, capsys):
    timed = Timed(field)
    begin = time.process_time()
    mesh = benchmark.pedantic(extract, args=(timed,), kwargs={"resolution": RESOLUTION}, rounds=1)
    overhead = time.process_time() - begin - timed.seconds
    # What is saved is measured against the dense lattice about the surface alone, with no empty space around.
    dense = np.prod(mesh.extents / mesh.metadata["spacing"] + 1)
    with capsys.disabled():
        print(
            f"\n{field.__name__} at {RESOLUTION}: {timed.count:,} evaluations instead of {dense:,.0f}, "
            f"overhead {overhead:.2f} s, {overhead / timed.count * 1e6:.2f} us per evaluation"
        )
    benchmark.extra_info.update(evaluations=timed.count, overhead=overhead)
    assert mesh.is_watertight
    assert np.abs(field(mesh.vertices)).max() < mesh.metadata["spacing"] ** 2
    assert timed.count < dense / LEAST[field.__name__]
    assert overhead < OVERHEAD * timed.count
