"""Chains of methods match their steps, keep exact counts, pass on reports of steps, and refuse mistakes early."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from bench import BadInput, InvalidOutput, MissingLibrary, PointCloud, Run, UsageError
from bench.methods.classical.statistical_outlier import StatisticalOutlier
from bench.methods.composed.chain import Chain
from bench.methods.pseudo.identity import Identity
from bench.methods.pseudo.noise import Noise
from bench.plan.choice import Choice
from bench.plugins.registry import Plugin, registry
from bench.plugins.schema import build, defaults
from bench.tasks.denoise import Denoise
from bench.tasks.reconstruct import Reconstruct
from bench.tasks.upsample import Upsample

TASKS = ("denoise", "upsample", "reconstruct")
OUTLIERS = {"statistical_outlier": {"k": 4, "threshold": 1.0}}


@pytest.fixture
def ball():
    points = np.random.default_rng(0).standard_normal((400, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return PointCloud(points, normals=points)


# The runs and instances of the probes, in the order of their calls.
SEEN: list[Run] = []


@dataclass(frozen=True)
class Probe:
    """A method that follows its parameters."""

    keep_every: int = 1  # returns every n-th point
    offered: tuple[int, ...] | None = None
    extra: int = 0  # number of excess points
    parameters: int | None = None
    active: int | None = None
    file: Path | None = None

    @property
    def ratios(self):
        if self.offered is None:
            raise AttributeError("any")
        return self.offered

    def prepare(self):
        SEEN.append(self)

    def _report(self, run):
        SEEN.append(run)
        run.parameters, run.active_parameters = self.parameters, self.active
        run.note("all is well")
        run.keep("cage", PointCloud(np.zeros((1, 3))))
        run.progress(1, 2)

    def denoise(self, cloud, run):
        self._report(run)
        run.trace(cloud)
        return PointCloud(cloud.points[:: self.keep_every])

    def upsample(self, cloud, ratio, run):
        self._report(run)
        run.trace(lambda: PointCloud(np.repeat(cloud.points, ratio, axis=0)))
        repeated = np.repeat(cloud.points, ratio, axis=0)
        return PointCloud(np.concatenate([repeated, repeated[: self.extra]]))


@dataclass(frozen=True)
class Learner(Probe):
    """A probe with weights."""

    def fit(self, examples, run):
        return {}


@pytest.fixture(autouse=True)
def probes(monkeypatch):
    SEEN.clear()
    plugins = {
        name: Plugin("method", name, cls, Path(__file__), "test", requires=requires)
        for name, cls, requires in (
            ("probe", Probe, ()),
            ("learner", Learner, ()),
            ("bare", type("Bare", (Probe,), {}), ("no_such_library",)),
        )
    }
    for name, plugin in plugins.items():
        monkeypatch.setitem(registry()._plugins["method"], name, plugin)


def solvable(chain):
    return [task for task in TASKS if hasattr(chain, task)]


# -- tasks of a chain --------------------------------------------------------------------------------------------------


def test_a_chain_solves_what_its_last_step_solves():
    assert solvable(Chain()) == list(TASKS)
    assert solvable(Chain(steps=("jet", "poisson"))) == ["upsample", "reconstruct"]
    assert solvable(Chain(steps=("jet", "ear"))) == ["upsample"]
    assert solvable(Chain(steps=("jet", "jet"))) == ["denoise"]
    assert [task for task in TASKS if registry().find("method", "chain").solves(task)] == list(TASKS)
    with pytest.raises(AttributeError, match="its last step, ear, does not solve reconstruct"):
        _ = Chain(steps=("jet", "ear")).reconstruct


def test_a_chain_matches_its_steps(ball):
    chain, run = Chain(steps=(OUTLIERS, "identity")), Run(seed=3)
    clean = StatisticalOutlier(k=4, threshold=1.0).denoise(ball, Run())
    assert len(clean) < len(ball)
    assert np.array_equal(chain.denoise(ball, run).points, clean.points)
    mesh = chain.reconstruct(ball, run)
    assert np.array_equal(mesh.vertices, Identity().reconstruct(clean, Run()).vertices)
    for task, output in ((Denoise(), chain.denoise(ball, run)), (Reconstruct(), mesh)):
        task.validate(output, task.input(ball))


def test_each_step_has_its_own_generator(ball):
    """The draws of the last step depend on the seed and not on the draws of the first."""
    same = [Chain(steps=(first, "noise")).denoise(ball, Run(seed=1)).points for first in ("identity", "noise")]
    assert np.array_equal(*same)
    assert not np.array_equal(same[0], Chain(steps=("identity", "noise")).denoise(ball, Run(seed=2)).points)
    assert not np.array_equal(same[0], Noise().denoise(ball, Run(seed=1)).points)
    Chain(steps=("probe", "probe")).denoise(ball, Run(seed=1, threads=2, seconds=50))
    first, second = SEEN
    assert first.seed != second.seed and first.threads == 2 and 0 < second.seconds <= first.seconds <= 50


# -- counts ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 2, 3, 7])
@pytest.mark.parametrize("ratio", [1, 4])
def test_upsampling_returns_the_exact_number_of_points(ball, every, ratio):
    chain = Chain(steps=({"probe": {"keep_every": every}}, "probe"))
    output = chain.upsample(ball, ratio, Run())
    Upsample(ratio=ratio).validate(output, Upsample(ratio=ratio).input(ball))


def test_attributes_are_thinned_with_their_points(ball):
    chain = Chain(steps=(OUTLIERS, "identity"))
    output = chain.upsample(ball, 2, Run())
    assert len(output) == 800 and np.array_equal(output.points, output.normals)


def test_the_last_step_gets_a_ratio_that_it_supports(ball):
    chain = Chain(steps=({"probe": {"keep_every": 2}}, {"probe": {"offered": [2, 4, 16]}}))
    assert len(chain.upsample(ball, 3, Run())) == 1200  # 6 would do, 16 it has
    with pytest.raises(InvalidOutput, match=re.escape("got 200 of 400 points, and must return 9 x 400: this needs a")):
        chain.upsample(ball, 9, Run())


def test_too_few_points_are_an_error_of_the_last_step(ball):
    broken = Chain(steps=({"probe": {"keep_every": 500}}, "empty"))
    with pytest.raises(InvalidOutput, match="step 2 of the chain, empty; got no points"):
        broken.upsample(ball, 4, Run())
    with pytest.raises(InvalidOutput, match="step 1 of the chain, empty; got no points"):
        Chain(steps=("empty", "identity")).upsample(ball, 4, Run())


# -- reports through the run -------------------------------------------------------------------------------------------


def test_notes_progress_traces_artefacts_and_parameters_pass_through(ball):
    kept, shown, traces = {}, [], []
    run = Run(
        on_keep=lambda name, value: kept.update({name: value}),
        on_progress=lambda done, total: shown.append(done / total),
        on_trace=lambda output, seconds, **more: traces.append(output() if callable(output) else output),
    )
    steps = ({"probe": {"keep_every": 3, "parameters": 5}}, {"probe": {"parameters": 70, "active": 20}})
    Chain(steps=steps).upsample(ball, 2, run)
    assert run.parameters == 75 and run.active_parameters == 25
    assert run.notes == ["probe: all is well"] * 2
    assert list(kept) == ["1-cage", "1-probe", "2-cage"] and len(kept["1-probe"]) == 134
    assert shown == [0.25, 0.5, 0.75, 1.0]
    assert [len(trace) for trace in traces] == [800]  # of the last step only, with the exact number


def test_only_a_learned_step_gets_weights(ball):
    weights = {"a": np.zeros(3)}
    Chain(steps=("probe", {"chain": {"steps": ["learner"]}})).upsample(ball, 2, Run(weights=weights))
    assert [run.weights for run in SEEN] == [None, weights]


def test_steps_share_the_truth_and_the_paused_clock_of_the_chain(ball):
    run = Run(on_distances=lambda points: np.zeros(len(points)))
    with Chain(steps=("probe",))._step(1, run) as own:
        assert own.has_truth and len(own.true_distances(np.zeros((5, 3)))) == 5
    assert run.distances_given == 5 and run._paused > 0


def test_an_error_names_its_step(ball):
    with pytest.raises(BadInput) as raised:
        Chain(steps=("identity", OUTLIERS)).denoise(PointCloud(np.empty((0, 3))), Run())
    assert raised.value.__notes__ == ["in step 1 of the chain, identity"]


# -- calls by the engine -----------------------------------------------------------------------------------------------


def test_steps_are_prepared_and_libraries_checked_before_the_clock_starts():
    Chain(steps=("probe", {"chain": {"steps": ["probe"]}})).prepare()
    assert len(SEEN) == 2
    with pytest.raises(MissingLibrary, match="no_such_library"):
        Chain(steps=("probe", "bare")).prepare()


def test_a_chain_names_its_plugins_steps_and_files(tmp_path):
    file = tmp_path / "cage.ply"
    file.write_text("")
    inner = {"chain": {"steps": ["jet", {"probe": {"file": str(file)}}]}}
    chain = Chain(steps=("wlop", inner))
    assert [plugin.name for plugin in chain.plugins] == ["wlop", "chain", "jet", "probe"]
    assert [name for name, _ in chain.steps_chosen] == ["wlop", "jet", "probe"]
    assert chain.steps_chosen[0][1] == defaults(registry().find("method", "wlop"))
    assert list(chain.reads()) == [file]
    choice = Choice.of("method", {"_name_": "chain", "steps": ["jet", {"wlop": {"radius": 3.0}}]})
    assert [plugin.name for plugin in choice.parts] == ["chain", "jet", "wlop"]
    assert choice.label == "chain[steps=jet+wlop(radius=3)]"


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ((), "expected at least one"),
        ("wlop", r"expected a list, got 'wlop'; write \[wlop\]"),
        (("wlp", "poisson"), "number 1.*Did you mean 'wlop'"),
        (("wlop", {"poisson": {"dept": 3}}), "number 2.*Did you mean 'depth'"),
        (("wlop", {"poisson": {"depth": -3}}), "number 2.*depth"),
        (("poisson", "wlop"), "number 1, poisson, does not solve denoise"),
        (("jet", "ear", "poisson"), "number 2, ear, does not solve denoise"),
    ],
)
def test_wrong_steps_are_refused_when_the_chain_is_made(steps, message):
    with pytest.raises(ValueError, match=message):
        Chain(steps=steps)
    if not isinstance(steps, str):
        with pytest.raises(UsageError, match=message):
            build(registry().find("method", "chain"), {"steps": list(steps)})


def test_a_step_may_be_a_chain(ball):
    nested = Chain(steps=({"chain": {"steps": [OUTLIERS, "identity"]}}, "identity"))
    flat = replace(nested, steps=(OUTLIERS, "identity", "identity"))
    assert np.array_equal(nested.denoise(ball, Run()).points, flat.denoise(ball, Run()).points)


# -- a mesh of fewer faces ---------------------------------------------------------------------------------------------


def test_a_mesh_is_simplified_and_a_note_reports_the_error(ball):
    whole = Chain(steps=(OUTLIERS, "identity")).reconstruct(ball, Run())
    traces = []
    run = Run(on_trace=lambda output, seconds, **more: traces.append(output))
    chain = Chain(steps=(OUTLIERS, "identity"), faces=200)
    fewer = chain.reconstruct(ball, run)
    assert len(whole.faces) > 200 >= len(fewer.faces)
    Reconstruct().validate(fewer, Reconstruct().input(ball))
    assert run.notes == [note for note in run.notes if note.startswith(f"reduced from {len(whole.faces):,} to ")]
    assert "at a distance of rms" in run.notes[0]
    run = Run()
    same = Chain(steps=(OUTLIERS, "identity"), faces=10**6).reconstruct(ball, run)
    assert np.array_equal(same.faces, whole.faces) and run.notes == []
    assert solvable(chain) == ["reconstruct"]
    assert Choice.of("method", {"_name_": "chain", "faces": 200}).label == "chain[faces=200]"


@pytest.mark.parametrize(
    ("steps", "faces", "message"),
    [
        (("identity",), 3, "expected 0, which keeps all, or at least 4, got 3"),
        (("identity",), -1, "expected 0"),
        (("jet",), 100, "the last step, jet, gives no mesh to reduce"),
    ],
)
def test_invalid_numbers_of_faces_are_refused(steps, faces, message):
    with pytest.raises(ValueError, match=message):
        Chain(steps=steps, faces=faces)
