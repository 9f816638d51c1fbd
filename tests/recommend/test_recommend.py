"""``detailbench recommend``: candidates, the command as a user calls it, failing methods, messages."""

import json
import shlex
from types import SimpleNamespace

import numpy as np
import pytest

from bench import generator
from bench.cli import main
from bench.errors import DetailbenchError, UsageError
from bench.recommend.candidates import DEFAULT, candidates, parts
from bench.recommend.priors import distance, nearest, priors
from bench.recommend.recommendation import recommend
from bench.recommend.scan import State
from bench.recommend.table import table
from bench.recommend.trials import Setup, Trial

TOYS = '''
from dataclasses import dataclass

import trimesh

from bench import BadInput, register


@register("method")
@dataclass(frozen=True)
class WrappedBall:
    """The ball that the points lie on, of another radius."""

    radius: float = 1.0  # in radii of the scan

    def reconstruct(self, cloud, run):
        ball = trimesh.creation.icosphere(3, self.radius)
        return trimesh.Trimesh(ball.vertices, ball.faces, process=False)


@register("method")
@dataclass(frozen=True)
class GivesUp:
    """Fails on every cloud."""

    def reconstruct(self, cloud, run):
        raise BadInput("these points are not for me")


@register("method")
@dataclass(frozen=True)
class Needle:
    """One triangle without an area."""

    def reconstruct(self, cloud, run):
        return trimesh.Trimesh(cloud.points[[0, 1, 1]], [[0, 1, 2]], process=False)
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    (folder / "toys.py").write_text(TOYS)
    points = generator(0).normal(size=(900, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # The farthest point of an exact ball is at radius 1 in the frame, wherever the ball is.
    np.savetxt(folder / "my scan.xyz", 50 * points + [100, 200, 300])
    np.savetxt(folder / "few.xyz", points[:40])
    return folder


@pytest.fixture(scope="module")
def found(folder):
    """One run that all tests read: of methods one is right, one too large, one rough, and two fail."""
    from contextlib import redirect_stdout
    from io import StringIO

    scan, toys = str(folder / "my scan.xyz"), str(folder / "toys.py")
    methods = "wrapped_ball[radius=1.1],gives_up,needle,wrapped_ball,alpha_shape"
    with redirect_stdout(StringIO()) as out:
        assert main(["recommend", scan, "--plugin", toys, "--methods", methods, "--json", "--points", "600"]) == 0
    return json.loads(out.getvalue())


def test_the_right_surface_comes_first(found):
    assert [entry["method"] for entry in found["ranking"]][0] == "wrapped_ball"
    assert found["ranking"][0]["score"] == 1 and found["tied_for_first"][0] == "wrapped_ball"
    rank = {entry["method"]: entry["rank"] for entry in found["ranking"]}
    assert rank["wrapped_ball[radius=1.1]"][0] > 1


def test_a_method_that_fails_reports_why(found):
    assert found["failed"].keys() == {"gives_up", "needle"}
    assert found["failed"]["gives_up"] == "error: these points are not for me"
    assert (
        found["failed"]["needle"].startswith("invalid: promised a trimesh.Trimesh")
        and "area" in found["failed"]["needle"]
    )


def test_the_state_of_the_scan_is_reported(found):
    (scan,) = found["scans"]
    assert scan["points"] == 900 and scan["tried"] == 600 and scan["normals"] == 0
    assert scan["radius"] == pytest.approx(50, rel=0.01)
    assert scan["noise"] < 0.3 and scan["outliers"] == 0


def test_the_command_line_can_be_pasted(found, folder):
    words = shlex.split(found["ranking"][-1]["command"])
    assert words[:2] == ["detailbench", "apply"] and words[-2] == str(folder / "my scan.xyz")
    assert "method.radius=1.1" in words or "method=alpha_shape" in words


def test_figures_of_every_method_are_finite(found):
    for entry in found["ranking"]:
        values = [entry[key] for key in ("to_mesh", "to_points", "others", "halves", "seconds", "peak_mb")]
        assert np.isfinite(values).all() and min(values) >= 0


# -- in process, with trials that are made up --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made_up():
    """Two scans of a ball and three candidates; the second fails on the second scan."""
    import test_evidence as known

    scans = [known.scan(), known.scan(known.on_ball(1500, seed=4))]
    chosen = candidates("poisson,apss,rimls", "reconstruct")

    def trials(clouds, chosen, setup, on_done):
        good = [Trial(known.METHODS[name], "", 1.0, 100.0) for name in ("large", "exact", "bumpy")]
        second = [good[0], good[1], Trial(None, "timeout: stopped after 30 s (limit.seconds=30)")]
        return [good, second]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.recommend.recommendation.trials", trials)
        return SimpleNamespace(scans=scans, chosen=chosen, found=recommend(scans, chosen, Setup()))


def test_a_method_that_fails_on_one_of_the_scans_has_no_rank(made_up):
    assert [c.label for _, c in made_up.found.ranked] == ["apss", "poisson"]
    assert made_up.found.failed == {"rimls": "timeout: stopped after 30 s (limit.seconds=30)"}


def test_the_table_says_who_is_first_why_and_how_to_apply_it(made_up):
    text = table(made_up.found)
    assert "First: apss" in text and "no rank: rimls: timeout" in text
    assert "detailbench apply method=apss task=reconstruct ball.ply OUT.ply" in text
    assert "sensor" in text and "2,000 points" in text and "1,500 points" in text
    assert max(map(len, text.splitlines())) <= 140


def test_one_method_that_is_left_is_no_ranking(made_up, monkeypatch):
    failing = [[Trial(None, "oom: past the memory limit")] * 3] * 2
    monkeypatch.setattr("bench.recommend.recommendation.trials", lambda *args: failing)
    with pytest.raises(DetailbenchError, match=r"0 of 3 methods solved .* poisson: oom: past the memory limit"):
        recommend(made_up.scans, made_up.chosen, Setup())


# -- candidates --------------------------------------------------------------------------------------------------------


def test_all_that_are_tried_by_default_are_there():
    chosen = candidates(DEFAULT, "reconstruct")
    assert len(chosen) >= 11 and [c.label for c in chosen] == list(parts(DEFAULT))
    assert {"poisson", "apss", "alpha_wrap", "chain"} <= {c.choice.name for c in chosen}


def test_parameters_in_brackets():
    first, second = candidates("poisson[depth=6,trim=0.1], chain[steps=[{wlop: {radius: 3.0}},poisson]]", "reconstruct")
    assert first.choice.parameters["depth"] == 6 and first.choice.parameters["trim"] == 0.1
    assert first.overrides == ("method=poisson", "method.depth=6", "method.trim=0.1")
    assert second.choice.name == "chain" and len(second.choice.parameters["steps"]) == 2
    assert "'method.steps=[{wlop: {radius: 3.0}},poisson]'" in second.command("reconstruct", "a b.ply", "OUT.ply")


def test_a_learned_step_comes_with_its_weights():
    learned, plain = candidates("chain[steps=[pointcleannet,poisson]],poisson", "reconstruct")
    assert learned.weights.endswith(".safetensors") and plain.weights == ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("poisson", "at least two methods"),
        ("", "at least two methods"),
        ("poisson,poisson[depth=8]", "are the same"),
        ("poisson,poisson[depth=6", "unbalanced brackets"),
        ("poisson,apss]", "unbalanced brackets"),
        ("poisson,poisson[6]", r"expected NAME or NAME\[key=value,...\]"),
        ("poisson,poisson[depth=6]x", r"expected NAME or NAME\[key=value,...\]"),
        ("poisson,poison", "Did you mean"),
        ("poisson,poisson[dept=6]", "depth"),
        ("poisson,poisson[depth=99]", "depth"),
        ("poisson,jet", "does not solve reconstruct"),
    ],
)
def test_candidates_that_make_no_sense(text, said):
    with pytest.raises(UsageError, match=said):
        candidates(text, "reconstruct")


# -- priors and messages -----------------------------------------------------------------------------------------------


def test_a_state_like_a_sensors_finds_this_sensor():
    assert {"clean", "noisy", "scanned", "outliers"} <= {prior.sensor for prior in priors()}
    for prior in priors():
        assert nearest(prior.state) == prior and distance(prior.state, prior.state) == 0
        assert list(prior.errors.values()) == sorted(prior.errors.values())
    dirty = State(noise=0.3, outliers=0.08, density_variation=0.9, normals=0, contradicting=0)
    assert nearest(dirty).sensor == "outliers"


def test_the_table_of_priors_is_made_of_results(tmp_path):
    import pandas as pd
    import recommend_priors

    rows = [
        {"sensor": "clean", "method": m, "dataset": d, "case": "a", "score.surface_distance_mean": e}
        for d, factor in (("x", 1), ("y", 3))
        for m, e in (("identity", 0.0), ("apss", 2e-3 * factor), ("poisson", 1e-3 * factor))
    ]
    state = State(0.1, 0.0, 0.2, 1.0, 0.0)
    (line,) = recommend_priors.table(pd.DataFrame(rows), {"clean": state})
    assert line["errors"] == {"poisson": 2.0, "apss": 4.0} and list(line["errors"]) == ["poisson", "apss"]
    assert line["shapes"] == 2 and line["state"] == state._asdict()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing.ply", "--methods", "poisson,apss"], "nothing.ply: no such file"),
        (["few.xyz", "--methods", "poisson,apss"], "few.xyz: 40 different points; a recommendation needs 100 at least"),
        (["few.xyz", "--points", "50"], "--points 50: expected 0 for all, or at least 200"),
        (["few.xyz", "--limit", "0"], "--limit 0: expected seconds above 0"),
        (["few.xyz", "--memory", "-1"], "--memory -1: expected gigabytes above 0"),
        (["few.xyz", "--jobs", "-1"], "--jobs -1: expected at least 1"),
        (["few.xyz", "--seed", "-1"], "--seed -1: expected at least 0"),
        (["few.xyz", "--methods", "poisson"], "expected at least two methods"),
    ],
)
def test_mistakes_are_reported_in_one_line(folder, capsys, monkeypatch, words, said):
    monkeypatch.chdir(folder)
    assert main(["recommend", *words]) == 1
    (err,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: plugin ")]
    assert said in err and err.startswith("error: ")


# -- the study ---------------------------------------------------------------------------------------------------------


def test_the_study_counts_what_is_wrong():
    import recommend_study

    def row(errors):
        entries = [
            {"method": m, "score": s, "rank": r} for m, s, r in (("a", 1, [1, 2]), ("b", 2, [1, 2]), ("c", 3, [3, 3]))
        ]
        return {"ranking": entries, "truth": dict(zip("abc", errors, strict=True))}

    right, wrong = (recommend_study.verdicts(row(errors)) for errors in ((1, 2, 3), (3, 2, 1)))
    assert right["rho"] == pytest.approx(1) and right["first"] == 1 and right["excess"] == 1 and right["tied"] == 2
    assert right["sure"] == 2 and right["wrong"] == 0
    assert wrong["rho"] == pytest.approx(-1) and wrong["first"] == 3 and wrong["excess"] == 3
    assert wrong["wrong"] == wrong["clearly"] == 2
