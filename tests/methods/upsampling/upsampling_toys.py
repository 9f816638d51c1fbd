"""Shared by the tests of learned upsamplers: two toy shapes, and methods that learn in seconds."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import trimesh

from bench import Case, PointCloud, Run, Shape, TrainingData

BOX = trimesh.creation.box((1.1, 1.0, 0.9))
BALL = trimesh.creation.icosphere(3)


def shape(mesh: trimesh.Trimesh, exactness: str = "polyhedron") -> Shape:
    return Shape("toy", mesh, exactness=exactness)


def toy_case(name: str, mesh: trimesh.Trimesh, count: int) -> Case:
    points = mesh.sample(count, seed=len(name))
    return Case(name, {"cloud": PointCloud(np.asarray(points))}, shape(mesh))


def toy_data(count: int = 60) -> TrainingData:
    """A box and a ball, with uniform clouds."""
    cases = [toy_case("box", BOX, count), toy_case("ball", BALL, count)]

    def recipes():
        return iter([SimpleNamespace(build=lambda case=case: case) for case in cases])

    return TrainingData(recipes=recipes, sensor=lambda item: None, count=len(cases))


def upsampled(method, weights, points, ratio):
    run = Run(seed=0)
    run.weights = weights
    output = method.upsample(PointCloud(points), ratio, run).points
    assert run.parameters
    return output


def tiny_clouds():
    rng = np.random.default_rng(5)
    ball = rng.normal(size=(40, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    return {
        "two points": ball[:2],
        "three points": ball[:3],
        "seven points": ball[:7],
        "fewer than a patch": ball[:20],
        "two places": np.repeat(ball[:2], 15, axis=0),
        "each point twice": np.repeat(ball[:20], 2, axis=0),
        "on a line": np.linspace(0, 1, 25)[:, None] * [1.0, 2.0, 3.0],
    }
