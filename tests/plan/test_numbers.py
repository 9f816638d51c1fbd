"""The whole numbers of a run have ends, and a command that is beyond them is refused in words."""

import pytest
from toy_cells import config

from bench.cli import main
from bench.errors import UsageError
from bench.plan.cell import Cell, check_root
from bench.plan.numbers import WHOLE_NUMBERS
from bench.results.files import COLUMNS
from bench.seeds import seed_words

BEYOND = [
    (key, value) for key, (least, most) in WHOLE_NUMBERS.items() for value in (least - 1, most + 1, 10**24, -(2**63))
]


@pytest.mark.parametrize(("key", "value"), [*BEYOND, *((key, "???") for key in WHOLE_NUMBERS), ("seed", 1.5)])
def test_a_number_that_cannot_be_is_refused(key, value):
    with pytest.raises(UsageError, match=f"{key}=.*expected a whole number of at least"):
        Cell.from_config(config(**{key: value}))


@pytest.mark.parametrize(("key", "value"), [(key, end) for key, ends in WHOLE_NUMBERS.items() for end in ends])
def test_the_ends_can_be_requested(key, value):
    assert getattr(Cell.from_config(config(**{key: value})), key) == value
    assert COLUMNS.get(key, "int64") == "int64" and abs(value) < 2**63


def test_no_two_seeds_are_one():
    least, most = WHOLE_NUMBERS["seed"]
    assert seed_words(least, most) == [least, most]
    assert seed_words(most + 1) == [least]  # why there are no more


@pytest.mark.parametrize("key", ["seed", "split", "device"])
def test_a_value_that_is_left_open_is_asked_for(key):
    with pytest.raises(UsageError, match=rf"{key}=\?\?\?: expected a value"):
        check_root({key: "???", "limit": {}})
    with pytest.raises(UsageError, match=r"limit.seconds=\?\?\?: expected a value"):
        check_root({"limit": {"seconds": "???"}})


WORDS = ("task=denoise", "dataset=bumps", "sensor=samples", "method=jet")


@pytest.mark.parametrize(
    ("command", "word", "said"),
    [
        ("plan", "cases=1000000000", "cases=1000000000: expected a whole number of at least 1, at most 100000"),
        ("plan", "seed=-1", "seed=-1: expected a whole number of at least 0"),
        ("run", "seed=${oc.env:NO_SUCH_VARIABLE}", "NO_SUCH_VARIABLE"),
        ("plan", "seed=${oc.env:NO_SUCH_VARIABLE}", "NO_SUCH_VARIABLE"),
        ("plan", "hydra=1", "hydra=1: Hydra cannot use this"),
        ("run", "hydra=1", "hydra=1: Hydra cannot use this"),
        ("plan", "seed=" + "[" * 500 + "]" * 500, "nested too deeply"),
        ("plan", "x" * 100_000, "more characters"),
        ("plan", "method=" + "x" * 100_000, "more characters"),
        ("plan", "results=" + "x" * 300, "cannot be a folder: File name too long"),
        ("run", "results=" + "/".join(["x" * 200] * 25), "cannot be a folder: File name too long"),
    ],
)
def test_an_invalid_argument_is_refused_briefly(tmp_path, capsys, monkeypatch, command, word, said):
    monkeypatch.chdir(tmp_path)
    assert main([command, *WORDS, word]) == 1
    err = capsys.readouterr().err
    assert said in err and "Traceback" not in err
    assert len(err) < 5_000


def test_more_threads_than_processors_are_reported(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("bench.engine.affinity.available", lambda: [0, 1])
    assert main(["plan", *WORDS, "threads=2", f"results={tmp_path}"]) == 0
    assert "processors" not in capsys.readouterr().out
    assert main(["plan", *WORDS, "threads=3", f"results={tmp_path}"]) == 0
    assert "threads=3: only 2 processors are available" in capsys.readouterr().out
