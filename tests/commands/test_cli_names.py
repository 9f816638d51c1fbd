"""Wrong words on the command line: exit code 1, one message with the nearest right name, no traceback, nothing run."""

from __future__ import annotations

import pytest
from conftest import TOYS

RUN = ("run", "--plugin", str(TOYS), "task=denoise", "dataset=ball", "sensor=dots", "metric=[spread]", "cases=2")
FINE = (*RUN, "method=fine")
SWEEP = ("run", "-m", *RUN[1:])

# what is typed: what the message must say
WRONG = {
    "method": ((*RUN, "method=fin"), ("no method is called 'fin'", "'fine'")),
    "method in a sweep": ((*SWEEP, "method=fine,identiy"), ("no method is called 'identiy'", "'identity'")),
    "method of no resemblance": ((*RUN, "method=xyzzy"), ("no method is called 'xyzzy'", "Known: advancing_front")),
    "dataset": ((*FINE, "dataset=bal"), ("no dataset is called 'bal'", "'ball'")),
    "sensor": ((*FINE, "sensor=dot"), ("no sensor is called 'dot'", "'dots'")),
    "task": ((*FINE, "task=denoize"), ("no task is called 'denoize'", "'denoise'")),
    "metric": ((*FINE, "metric=[spred]"), ("no metric is called 'spred'", "'spread'")),
    "profile": ((*FINE, "profile=quik"), ("no profile is called 'quik'", "'quick'")),
    "no convention": ((*FINE, "convention=null"), ("convention=null: leave it out", "~convention")),
    "experiment": ((*FINE, "experiment=nope"), ("no experiment is called 'nope'",)),
    "key": ((*FINE, "sed=1"), ("there is no key 'sed'", "'seed'")),
    "key of the limits": ((*FINE, "limit.second=1"), ("there is no key 'limit.second'", "'limit.seconds'")),
    "parameter": ((*FINE, "method.tak=1"), ("fine has no parameter 'tak'", "'method.take'")),
    "key of the run": ((*FINE, "dataset.split=train"), ("ball has no parameter 'split'", "use split=...")),
    "parameter of a dataset": ((*FINE, "dataset.strech=1"), ("ball has no parameter 'strech'", "'dataset.stretch'")),
    "parameter of a metric": ((*FINE, "metric.spread.bins=1"), ("spread has no parameter 'bins'",)),
    "type of a key": ((*FINE, "seed=x"), ("seed", "'x'", "Integer")),
    "type of a key in a sweep": ((*SWEEP, "seed=1,x"), ("seed", "'x'", "Integer")),
    "type of a number in a sweep": ((*SWEEP, "seed=1,2,1.5"), ("seed", "'1.5'", "Integer")),
    "type of a limit in a sweep": ((*SWEEP, "limit.seconds=5,soon"), ("limit.seconds", "'soon'", "Float")),
    "added parameter": ((*FINE, "+method.typo=3"), ("fine has no parameter 'typo'", "take")),
    "added parameter of a dataset": ((*FINE, "+dataset.typo=3"), ("ball has no parameter 'typo'", "stretch")),
    "forced parameter": ((*FINE, "++method.typo=3"), ("fine has no parameter 'typo'", "take")),
    "added key": ((*FINE, "+typo=3"), ("there is no key 'typo'",)),
    "forced key": ((*FINE, "++limit.typo=3"), ("there is no key 'limit.typo'",)),
    "deleted method": ((*FINE, "~method"), ("method",)),
    "deleted parameter": ((*FINE, "~method.take"), ("method.take",)),
    "text for a number": ((*FINE, "method.take=soon"), ("take", "soon")),
    "fraction for a count": ((*FINE, "method.salt=1.5"), ("salt", "1.5")),
    "text for the seed": ((*FINE, "seed=one"), ("seed", "one")),
    "value that the plugin refuses": ((*FINE, "sensor.jitter=-1"), ("jitter: expected 0 or more, got -1",)),
    "negative count": ((*FINE, "cases=-1"), ("cases",)),
    "no cases": ((*FINE, "cases=0"), ("cases",)),
    "no threads": ((*FINE, "threads=0"), ("threads",)),
    "negative seed": ((*FINE, "seed=-1"), ("seed",)),
    "limit of nothing": ((*FINE, "limit.seconds=0"), ("limit.seconds", "more than 0")),
    "one of three": ((*FINE, "rerun=fail"), ("rerun=fail", "'failed'")),
    "one of three more": ((*FINE, "outputs=frist"), ("outputs=frist", "'first'")),
    "split": ((*FINE, "split=tset"), ("split", "test")),
    "device": ((*FINE, "device=gpu"), ("device", "cuda")),
    "sweep without -m": ((*RUN, "method=fine,identity"), ("add -m",)),
    "glob of no resemblance": ((*SWEEP, "method=glob(zz*)"), ("method=glob(zz*)", "no method matches", "identity")),
    "glob of values": ((*SWEEP, "method=fine", "seed=glob(*)"), ("seed=glob(*)", "list the values of seed")),
    "interval": ((*SWEEP, "method=fine", "seed=interval(0,1)"), ("seed=interval(0,1)", "range(")),
    "plan of an interval": (("plan", *SWEEP[1:], "seed=interval(0,1)"), ("seed=interval(0,1)", "range(")),
    "method of a package": ((*FINE, "method@x=fine"), ("method@x",)),
    "no key at all": ((*FINE, "poisson"), ("poisson", "key=value")),
    "no sensor": ((*FINE, "sensor=null"), ("sensor",)),
    "key without a value": ((*RUN, "method="), ("method",)),
    "metric that does not score this": ((*FINE, "metric=[topology]"), ("metric", "scores a cloud")),
    "unknown command": (("rum",), ("no command 'rum'", "'run'")),
    "unknown flag": ((*FINE, "--frobnicate"), ("--frobnicate",)),
    "misspelt flag": ((*FINE, "--multirum"), ("--multirum",)),
    "unknown flag of another command": (("list", "--jsn"), ("--jsn",)),
    "flag without its value": (("list", "--plugin"), ("--plugin",)),
    "flag of Hydra with a wrong value": ((*FINE, "--cfg", "jobs"), ("--cfg jobs", "job, hydra, all")),
    "flag of Hydra without its value": ((*FINE, "--cfg"), ("--cfg:", "job, hydra, all")),
    "flag of Hydra with one too many": ((*FINE, "--cfg", "job", "--resolve=1"), ("--resolve=1", "no value")),
    "flags of Hydra that do not go together": ((*FINE, "--cfg", "job", "--info"), ("--cfg --info", "one of")),
    "flag of Hydra that needs another": ((*FINE, "--resolve"), ("--resolve", "--cfg")),
    "config of a sweep": ((*SWEEP, "method=fine", "--cfg", "job"), ("--cfg", "leave out -m")),
    "config of several values": ((*RUN, "method=fine,identity", "--cfg", "job"), ("method=fine,identity",)),
    "plan with a flag of Hydra": (("plan", *FINE[1:], "--cfg", "job"), ("--cfg", "detailbench run --cfg job")),
    "plugin file that is not there": ((*FINE, "--plugin", "gone.py"), ("gone.py", "no such file")),
    "plugin that is no Python file": ((*FINE, "--plugin", "/etc/hostname"), ("/etc/hostname", ".py")),
    "unknown kind": (("list", "metods"), ("'metods'", "'methods'")),
    "unknown plugin of a kind": (("list", "method", "identiy"), ("'identiy'", "'identity'")),
    "cell that is not there": (("why", "abc", "results=nowhere"), ("nowhere", "no results")),
    "wrong word for the folder": (("why", "abc", "result=x"), ("result=x", "results=DIR")),
    "reproduce without results": (("reproduce", "abc", "results=nowhere"), ("nowhere", "no results")),
    "new of no kind": (("new", "metod", "mine"), ("'metod'", "'method'")),
    "new without a name": (("new", "method"), ("name",)),
    "new with a name that is none": (("new", "method", "9 lives"), ("letter first",)),
    "new with a name that is taken": (("new", "method", "identity"), ("identity", "already")),
    "check of nothing known": (("check", "identiy"), ("'identiy'", "'identity'")),
    "check of a file without plugins": (("check", __file__), ("registers no plugin",)),
    "check with a wrong parameter": (("check", *FINE[1:3], "fine", "method.tak=1"), ("no parameter 'tak'", "take")),
    "check with a value that is refused": (("check", "siren", "method.batch=0"), ("batch: expected at least 1",)),
    "check with a key of another kind": (("check", "identity", "dataset.count=1"), ("dataset.count=1", "method.PARAM")),
    "check of nothing but a parameter": (("check", "method.take=1"), ("name a plugin",)),
    "leaderboard of nothing": (("leaderboard", "nowhere"), ("nowhere", "no such folder")),
    "apply without a method": (("apply", "a.ply", "b.ply"), ("method=NAME",)),
    "apply of a wrong method": (("apply", "method=identiy", "a.ply", "b.ply"), ("'identiy'", "'identity'")),
    "apply without files": (("apply", "method=identity"), ("INPUT and an OUTPUT",)),
    "apply to a file that is not there": (
        ("apply", "method=identity", "task=denoise", "a.ply", "b.ply"),
        ("a.ply", "no such file"),
    ),
    "plan with a typo": (("plan", *FINE[1:], "+method.typo=3"), ("fine has no parameter 'typo'",)),
    "plan of a sweep without -m": (("plan", *RUN[1:], "method=fine,identity"), ("add -m",)),
}  # fmt: skip


@pytest.fixture(scope="module")
def there(shells):
    """Where all of them are said."""
    return shells("wrong")


@pytest.mark.parametrize("what", WRONG)
def test_wrong_arguments_get_one_message_with_the_right_ones(there, what):
    done = there.call(*WRONG[what][0])
    assert done.returncode == 1, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    assert "HYDRA_FULL_ERROR" not in done.stderr
    assert "append" not in done.stderr  # Hydra's advice to add unknown keys with +
    for word in WRONG[what][1]:
        assert word in done.stderr
    assert len(done.stderr.strip().splitlines()) <= 4


def test_wrong_arguments_run_nothing_and_write_nothing(there):
    """Of all that was said before this test."""
    assert there.calls() == []
    assert list(there.work.rglob("*.parquet")) == []
    assert {p.name for p in there.work.iterdir()} <= {"results"}  # never outputs/ or multirun/
    assert not there.left_over()
