"""Normals of the user's files through the command line: a few bad ones, none oriented, and those not to be used."""

import numpy as np
import pytest

IDENTITY = ("apply", "threads=1", "method=identity", "task=denoise")


@pytest.fixture
def sphere():
    """Random points of the unit sphere: their own normals."""
    points = np.random.default_rng(0).normal(size=(600, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def write(shell, name, points, normals):
    np.savetxt(shell.work / name, np.hstack([points, normals]), fmt="%.17g")


def test_apply_fills_a_bad_normal_and_reports_it(shell, sphere):
    normals = sphere.copy()
    normals[5] = 0
    write(shell, "scan.xyz", sphere, normals)
    done = shell.call(*IDENTITY, "scan.xyz", "out.xyz")
    assert done.returncode == 0, done.stderr
    note = "identity: note: scan.xyz: 1 of 600 normals have no direction; those of the nearest points are used instead"
    assert done.stdout.splitlines()[-1] == note
    written = np.loadtxt(shell.work / "out.xyz")[:, 3:]
    assert np.allclose(np.delete(written, 5, axis=0), np.delete(sphere, 5, axis=0))
    assert written[5] @ sphere[5] > 0.9


def test_apply_notices_normals_that_are_not_oriented_and_takes_none_where_told(shell, sphere):
    signs = np.where(np.random.default_rng(1).random(600) < 0.5, -1, 1)[:, None]
    write(shell, "scan.xyz", sphere, signs * sphere)
    done = shell.call(*IDENTITY, "scan.xyz", "out.xyz")
    assert "of the normals point opposite to their neighbours" in done.stdout and "add normals=estimate" in done.stdout
    done = shell.call(*IDENTITY, "normals=estimate", "scan.xyz", "out.xyz")
    assert done.returncode == 0, done.stderr
    assert "scan.xyz (600 points) -> out.xyz (600 points)" in done.stdout and "note" not in done.stdout
    write(shell, "good.xyz", sphere, sphere)
    done = shell.call(*IDENTITY, "normals=file", "good.xyz", "out.xyz")
    assert "600 points with normals" in done.stdout and "note" not in done.stdout


def test_normals_from_elsewhere_are_refused(shell, sphere):
    write(shell, "scan.xyz", sphere, sphere)
    done = shell.call(*IDENTITY, "normals=estimated", "scan.xyz", "out.xyz")
    assert done.returncode == 1
    assert "normals=estimated: expected one of file, estimate. Did you mean 'estimate'?" in done.stderr


def test_score_says_what_was_amiss_with_a_file(shell, sphere):
    write(shell, "truth.xyz", sphere, sphere)
    write(shell, "out.xyz", sphere, np.where(np.arange(600)[:, None] < 400, 0, sphere))
    done = shell.call("score", "out.xyz", "truth.xyz", "--metric", "chamfer_l1_mean")
    assert done.returncode == 0, done.stderr
    note = "note: out.xyz: 400 of 600 normals have no direction; all normals are left out"
    assert done.stderr.splitlines() == [note]
