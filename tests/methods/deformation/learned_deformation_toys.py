"""Shared by the tests of learned deformers: boxes and balls, examples of them, and interrupted trainings."""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from trainings import killed_and_resumed
from trimesh import Trimesh
from trimesh.creation import box, icosphere
from trimesh.util import concatenate

from bench import PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface

COUNT = 2048


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def number_of_parameters(network) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


def points(shape, seed: int = 0) -> torch.Tensor:
    """Uniform points of [-1, 1]^3."""
    return torch.rand(shape, generator=generator(seed)) * 2 - 1


def stool(width: float, height: float) -> Trimesh:
    """A board on two legs: separate closed boxes that overlap."""
    parts = [box((width, width, 0.2)).apply_translation((0, 0, height))]
    parts += [box((0.2, 0.2, height)).apply_translation((x * width / 3, 0, height / 2)) for x in (-1, 1)]
    mesh = concatenate(parts)
    for _ in range(2):
        mesh = mesh.subdivide()
    return Trimesh(mesh.vertices, mesh.faces, process=False)


@cache
def examples(pairs: int = 4) -> dict[str, np.ndarray]:
    """The training examples: stools of random sizes, each normalised by its box."""
    rng, stored, extents = np.random.default_rng(0), [], []
    for _ in range(2 * pairs):
        mesh = stool(*rng.uniform(0.6, 1.6, 2))
        low, high = mesh.bounds
        half = (high - low).max() / 2
        inside = (MeshSurface(mesh).sample(COUNT, rng)[0] - (low + high) / 2) / half
        stored.append(np.round(inside * 32767).astype(np.int16))
        extents.append(((high - low) / 2 / half).astype(np.float32))
    return {"points": np.array(stored).reshape(-1, 2, COUNT, 3), "extents": np.array(extents).reshape(-1, 2, 3)}


def assert_resumes(method, data, at: int = 1) -> None:
    """An interrupted training ends with the same weights as an uninterrupted one, bit for bit."""
    resumed = killed_and_resumed(method, data, at)
    whole = method.fit(data, Run(seed=3))
    assert whole.keys() == resumed.keys()
    assert all(np.array_equal(whole[name], resumed[name]) for name in whole)


def assert_learns(training, steps: int, share: float) -> None:
    """Steps on one batch reduce its loss below a share of the initial one."""
    losses = []
    for _ in range(steps):
        training.optimizer.zero_grad()
        loss = training.loss(0)
        loss.backward()
        training.optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < share * losses[0], losses


def assert_deforms(method, weights) -> None:
    """Faces stay, the frame does not matter, and unused and duplicate vertices are accepted."""
    source, cloud = stool(1.0, 1.0), MeshSurface(stool(1.4, 0.8)).sample(3000, np.random.default_rng(1))[0]
    vertices = np.concatenate([source.vertices, [[9.0, 0, 0]], source.vertices[:3]])
    faces = np.where(source.faces < 3, source.faces + len(source.vertices) + 1, source.faces)
    faces[::2] = source.faces[::2]
    source = Trimesh(vertices, np.concatenate([faces, [[0, 0, 1]]]), process=False)
    first = method.deform(source, PointCloud(cloud), Run(seed=1, weights=weights))
    assert np.array_equal(first.faces, source.faces) and np.isfinite(first.vertices).all()
    assert len(first.vertices) == len(source.vertices)
    np.testing.assert_allclose(first.vertices[-3:], first.vertices[:3])  # duplicates stay together
    moved = source.copy()
    moved.vertices = 3 * source.vertices - 5
    second = method.deform(moved, PointCloud(2 * cloud + 1), Run(seed=1, weights=weights))
    np.testing.assert_allclose(second.vertices, 2 * first.vertices + 1, atol=2e-3)
    as_mesh = method.deform(source, icosphere(2), Run(seed=1, weights=weights))
    assert np.array_equal(as_mesh.faces, source.faces) and np.isfinite(as_mesh.vertices).all()


def assert_refuses(cls, cases: dict) -> None:
    """Invalid parameters are refused, each with an error that names it."""
    for name, value in cases.items():
        try:
            cls(**{name: value})
        except ValueError as error:
            assert str(error).startswith(f"{name}: expected"), error
        else:
            raise AssertionError(f"{name}={value!r} was accepted")


SHARED_MISTAKES = {
    "points": 2000,
    "batch": 0,
    "steps": -1,
    "learning_rate": 0.0,
    "decay": 0.0,
    "scale": 1.0,
    "strangers": 1.5,
}
