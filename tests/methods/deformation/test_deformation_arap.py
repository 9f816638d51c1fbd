"""As-rigid-as-possible deformation."""

from __future__ import annotations

import numpy as np
import pytest
from registration_shapes import cloud_of, far_from, moved, stool, turn
from scipy.sparse import csr_array, diags_array
from scipy.spatial.transform import Rotation
from trimesh.creation import icosphere

from bench import Run
from bench.methods.deformation.arap import Arap
from bench.methods.deformation.registration.rotations import Rigidity, moved_rigidly
from bench.methods.deformation.registration.samples import Samples
from bench.methods.deformation.registration.solving import Factors
from bench.methods.deformation.registration.welded import Welded


def rigidity_of(source):
    welded = Welded(source, 0.1, 0.1)
    return welded, Rigidity(welded.vertices, *welded.links)


def neighbours(welded, i):
    """The weights and other vertices of all links at a vertex."""
    for (a, b), weight in zip(*welded.links, strict=True):
        if i in (a, b):
            yield weight, b if i == a else a


def test_a_rigid_motion_has_no_energy_even_with_parts_and_springs():
    welded, rigidity = rigidity_of(stool())
    assert len(welded.springs) > 10
    R = turn(130)
    there = welded.vertices @ R.T + (1, 2, 3)
    rotations = rigidity.rotations(there)
    np.testing.assert_allclose(rotations, np.broadcast_to(R, rotations.shape), atol=1e-9)
    assert rigidity.energy(there, rotations) < 1e-20
    # Vertices are in equilibrium: they solve the linear system.
    np.testing.assert_allclose(rigidity.right_side(rotations), welded.stiffness @ there, atol=1e-10)


def test_rotations_and_energy_match_a_plain_loop():
    welded, rigidity = rigidity_of(icosphere(subdivisions=1))
    rng = np.random.default_rng(0)
    there = welded.vertices @ turn(40).T + 0.3 * rng.normal(size=welded.vertices.shape)
    rotations, energy = rigidity.rotations(there), 0.0
    for i in range(len(there)):
        weights, others = zip(*neighbours(welded, i), strict=True)
        before, after = welded.vertices[i] - welded.vertices[list(others)], there[i] - there[list(others)]
        best, distance = Rotation.align_vectors(after, before, weights=weights)
        np.testing.assert_allclose(rotations[i], best.as_matrix(), atol=1e-8)
        energy += (np.array(weights) * ((after - before @ rotations[i].T) ** 2).sum(axis=1)).sum()
    assert rigidity.energy(there, rotations) == pytest.approx(energy, rel=1e-12)
    assert rigidity.energy(there, rotations) < rigidity.energy(there, np.broadcast_to(turn(40), rotations.shape))


def test_no_rotation_is_a_reflection():
    welded, rigidity = rigidity_of(stool())
    rotations = rigidity.rotations(welded.vertices * (-1, 1, 1))
    np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-9)
    flat = rigidity.rotations(welded.vertices * (1, 1, 0))  # a singular value is zero
    np.testing.assert_allclose(np.linalg.det(flat), 1, atol=1e-9)
    nothing = rigidity.rotations(np.zeros_like(welded.vertices))
    np.testing.assert_allclose(np.linalg.det(nothing), 1, atol=1e-9)


def test_the_right_side_is_half_the_derivative_of_the_energy():
    welded, rigidity = rigidity_of(icosphere(subdivisions=1))
    rng = np.random.default_rng(0)
    there, along = (welded.vertices + 0.1 * rng.normal(size=welded.vertices.shape) for _ in range(2))
    rotations = rigidity.rotations(there)
    slope = (rigidity.energy(there + 1e-6 * along, rotations) - rigidity.energy(there - 1e-6 * along, rotations)) / 2e-6
    gradient = 4 * (welded.stiffness @ there - rigidity.right_side(rotations))
    assert (gradient * along).sum() == pytest.approx(slope, rel=1e-7)


def test_the_rigid_motion_solves_the_procrustes_problem():
    source, rng = icosphere(subdivisions=1), np.random.default_rng(0)
    V = np.array(source.vertices)
    samples = Samples(V, np.array(source.faces), 100, rng)
    goals, weights = samples.matrix @ V @ turn(40).T + 0.1 * rng.normal(size=(100, 3)) + 1, rng.random(100)
    pull = samples.matrix.T @ diags_array(weights)
    found = moved_rigidly(V, csr_array(pull @ samples.matrix), pull @ goals)
    points = samples.matrix @ V
    center, goal = weights @ points / weights.sum(), weights @ goals / weights.sum()
    best = Rotation.align_vectors(goals - goal, points - center, weights=weights)[0]
    np.testing.assert_allclose(found, best.apply(V - center) + goal, atol=1e-9)


def test_each_local_and_each_global_step_lowers_the_energy():
    welded, rigidity = rigidity_of(icosphere(subdivisions=2))
    held = np.zeros(len(welded.vertices))
    held[[0, 5, 9]] = 100.0
    factors = Factors(welded.stiffness + np.diag(held))
    goal = welded.vertices @ turn(60).T * 1.2
    there = welded.vertices.copy()

    def total(vertices, rotations):  # the energy counts every link twice
        return rigidity.energy(vertices, rotations) / 2 + (held[:, None] * (vertices - goal) ** 2).sum()

    rotations, values = np.broadcast_to(np.eye(3), (len(there), 3, 3)), []
    for _ in range(15):
        values.append(total(there, rotations))
        rotations = rigidity.rotations(there)
        values.append(total(there, rotations))
        there = factors.solve(held[:, None] * goal + rigidity.right_side(rotations))
    assert (np.diff(values) <= 1e-9).all() and values[-1] < 0.1 * values[0]


def test_a_rigid_motion_of_parts_is_reached_without_strain():
    source = stool(rounds=2)
    wanted = moved(source, turn(12), (0.05, -0.03, 0.02))
    output = Arap(samples=1000, rounds=40, sliding=0.9).deform(source, cloud_of(wanted, 2000), Run(seed=0))
    np.testing.assert_array_equal(output.faces, source.faces)
    assert far_from(source, wanted) > 0.03 and np.linalg.norm(output.vertices - wanted.vertices, axis=1).max() < 0.01
    before, after = (mesh.vertices[source.edges_unique] for mesh in (source, output))
    ratio = np.linalg.norm(after[:, 0] - after[:, 1], axis=1) / np.linalg.norm(before[:, 0] - before[:, 1], axis=1)
    assert np.abs(ratio - 1).max() < 0.05


def test_a_stretched_target_is_reached_with_decreasing_stiffness():
    source = icosphere(subdivisions=3)
    wanted = moved(source, np.diag([1.2, 0.85, 1.0]))
    cloud = cloud_of(wanted, 3000)
    stiff, soft = (
        Arap(samples=2000, rounds=8, stiff=1.0, soft=soft).deform(source, cloud, Run(seed=0)) for soft in (1.0, 0.05)
    )
    assert far_from(soft, wanted) < 0.01 < far_from(stiff, wanted) < far_from(source, wanted)


def test_parts_stay_together():
    source = stool(rounds=2)
    wanted = moved(source, np.diag([1.25, 1.0, 0.85]))
    output = Arap(samples=2000, rounds=8).deform(source, cloud_of(wanted), Run(seed=0))
    # The tops of the legs stay within the board, between its lower and its upper side.
    count = len(source.vertices) // 3
    board, legs = output.vertices[:count], output.vertices[count:]
    tops = legs[source.vertices[count:, 2] > 0.3 - 1e-9]
    assert tops[:, 2].max() < board[:, 2].max() and tops[:, 2].min() > board[:, 2].min()
    assert far_from(output, wanted) < 0.5 * far_from(source, wanted)


def test_runs_are_repeatable_and_stop_at_the_time_limit():
    source, cloud = icosphere(subdivisions=2), cloud_of(moved(icosphere(2), np.diag([1.2, 1, 0.9])), 500)
    method = Arap(rounds=3, samples=300)
    first, again = (method.deform(source, cloud, Run(seed=1)).vertices for _ in range(2))
    np.testing.assert_array_equal(first, again)
    run = Run(seconds=0)
    np.testing.assert_array_equal(method.deform(source, cloud, run).vertices, source.vertices)
    assert run.notes == ["the time limit ended the rounds after 0 of 3"]


@pytest.mark.parametrize(("name", "value"), [("rounds", 0), ("turns", 0), ("stiff", 0), ("soft", -1), ("trim", 0)])
def test_parameters_are_checked(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        Arap(**{name: value})
