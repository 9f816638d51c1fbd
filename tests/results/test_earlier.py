"""Records of earlier versions: current where their digests stand for today's sources, and what is said where not."""

import json
import re
import shutil
from hashlib import sha256
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from conftest import TOYS
from test_current import cell, stored

from bench.plan.cell import Choice
from bench.plugins.registry import KINDS
from bench.results import earlier
from bench.results.current import Today
from bench.results.earlier import differences, earlier_digest, standing, told, translated
from bench.results.files import META_KEY
from bench.results.provenance import fingerprint, ingredients
from bench.results.store import Results

OLD, OLDER, NEW = "source of method identity", "source of task denoise", "package numpy"


@pytest.fixture
def known(monkeypatch):
    """A table in which two digests stand for today's ``identity``, and one for a source that was edited since."""
    now = ingredients(cell())
    table = {
        "method identity": {"a" * 16: now["source of method identity"], "b" * 16: now["source of method identity"]},
        "task denoise": {"c" * 16: "0" * 16},
    }
    monkeypatch.setattr(earlier, "table", lambda: table)
    return now


def test_the_shipped_table_is_well_formed():
    table = earlier.table()
    assert len(table) > 50
    digests = re.compile(r"[0-9a-f]{16}")
    for plugin, entries in table.items():
        kind, _, name = plugin.partition(" ")
        assert kind in KINDS and name.isidentifier() and entries
        assert all(digests.fullmatch(text) for pair in entries.items() for text in pair)
    assert earlier.TABLE.stat().st_size < 1 << 15


def test_digests_of_earlier_versions_stand_for_those_of_today(known):
    for before in "ab":
        then = known | {OLD: before * 16}
        assert translated(then, known) == known and differences(then, known) == []
    for before in ("d" * 16, None, 5):
        assert differences(known | {OLD: before}, known) == [f"{OLD} was edited"]
    # What is known of a source that was edited since says nothing of today's.
    assert differences(known | {OLDER: "c" * 16}, known) == [f"{OLDER} was edited"]
    assert differences(known | {OLD: "a" * 16, NEW: "0"}, known) == [f"{NEW}: 0 -> {known[NEW]}"]


def test_a_record_of_an_earlier_version_counts_where_there_is_none_of_today(tmp_path, known):
    results, one = Results(tmp_path), cell()
    mark = fingerprint(known)
    assert standing(results, one, known) == (mark, mark, ())
    edited = known | {OLD: "d" * 16}
    results.write(stored(one, edited, "2026-03-01T00:00:00+00:00", 3.0))
    assert standing(results, one, known) == (mark, mark, (f"{OLD} was edited",))
    for number, letter in enumerate("ab"):
        then = known | {OLD: letter * 16}
        results.write(stored(one, then, f"2026-01-0{number + 1}T00:00:00+00:00", float(number)))
        assert standing(results, one, known) == (mark, fingerprint(then), ())  # the newest of those that are current
        assert Today().is_current(results.meta(one.id, fingerprint(then)))
    # In tables it counts before the newer record of an edited source.
    assert set(results.rows()["score.p2f_mean"]) == {1.0}
    results.write(stored(one, known, "2025-01-01T00:00:00+00:00", 9.0))
    assert standing(results, one, known) == (mark, mark, ())


def test_a_cell_that_was_stored_before_a_metric_came_names_the_metric(tmp_path):
    results, fewer = Results(tmp_path), cell()
    one = type(fewer)(**{**vars(fewer), "metrics": (*fewer.metrics, Choice("metric", "topology", {}))})
    parts = ingredients(one)
    assert standing(results, one, parts).stale == ()
    results.write(stored(fewer, ingredients(fewer), "2026-01-01T00:00:00+00:00", 1.0))
    assert standing(results, one, parts).stale == ("metric topology was not scored",)
    assert standing(results, cell(seed=1), ingredients(cell(seed=1))).stale == ()


def test_what_is_said_is_one_line():
    assert told([]) == told([(), ()]) == ""
    assert told([("package numpy: 1 -> 2",)]) == (
        "1 cell has a stored result that is not current: package numpy: 1 -> 2. `detailbench why CELL` shows more"
    )
    many = [("a",), ("a", "b"), (), ("c",), ("d", "e")]
    assert told(many) == (
        "4 cells have stored results that are not current: a (2 cells); b; c; 2 more reasons. `detailbench why CELL` "
        "shows more"
    )
    assert told([["metric m was not scored"]] * 2) == (
        "2 cells have stored results that are not current: metric m was not scored (2 cells)"
    )


def test_the_digest_of_earlier_versions_is_over_names_and_bytes(tmp_path):
    """By its definition: SHA-256 over name, NUL, content, NUL of each file, by path."""
    plugin, helper = tmp_path / "plugin.py", tmp_path / "helper.py"
    plugin.write_bytes(b"if TYPE_CHECKING:\n    from helper import f\n")
    helper.write_bytes(b"# caf\xe9\n")
    total = sha256()
    for file in (helper, plugin):
        total.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    assert earlier_digest(plugin) == total.hexdigest()[:16]


# -- through the commands ----------------------------------------------------------------------------------------------


def age(file: Path, plugin: Path, **more) -> str:
    """Rewrite a record as an earlier version would have stored it; its fingerprint."""
    table = pq.read_table(file)
    meta = json.loads(table.schema.metadata[META_KEY])
    of_file = [
        f"source of {name}" for name, facts in meta["provenance"]["plugins"].items() if facts["file"] == str(plugin)
    ]
    parts = meta["ingredients"] | {k: earlier_digest(plugin) for k in of_file if k in meta["ingredients"]} | more
    mark = fingerprint(parts)
    meta |= {"ingredients": parts, "fingerprint": mark}
    place = table.column_names.index("fingerprint")
    table = table.set_column(place, "fingerprint", [[mark] * len(table)])
    table = table.replace_schema_metadata({META_KEY: json.dumps(meta).encode()})
    file.unlink()
    pq.write_table(table, file.with_name(f"{file.stem.partition('-')[0]}-{mark}.parquet"))
    return mark


def test_a_folder_of_an_earlier_version_is_gone_on_with(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,)}
    first = shell.run("method=fine", "cases=3", board=True, **words)
    (file,) = shell.files()
    today = file.stem.partition("-")[2]
    mark = age(file, toys)
    assert mark != today

    def plan(*more):
        return shell.run(
            "method=fine", "cases=3", *more, act=lambda _, *rest: shell.call("plan", *rest), **words
        ).stdout

    assert "3 cases, 3 finished, 0 to do" in plan() and "not current" not in plan()
    again = shell.run("method=fine", "cases=3", board=True, **words)
    assert "0 run, 3 cached" in again.stderr and "not current" not in again.stderr
    assert again.stdout == first.stdout
    id = shell.rows()["cell"].iloc[0]
    why = shell.call("why", id, f"results={shell.results}", "--plugin", toys).stdout
    assert "it would not be run again" in why
    # What is missing is added under today's fingerprint, with the rows that were there.
    assert "no outputs" in plan("outputs=first")
    more = shell.run("method=fine", "cases=3", "outputs=first", **words)
    assert "1 run (1 of them again, for their outputs), 2 cached" in more.stderr
    assert len(shell.calls()) == 4 and len(shell.files()) == 2
    assert set(shell.rows()["fingerprint"]) == {today} and len(shell.rows()) == 3
    record = Results(shell.results).read(id, today)
    assert record and fingerprint(record.meta["ingredients"]) == today
    assert "0 run, 3 cached" in shell.run("method=fine", "cases=3", "outputs=first", **words).stderr


def test_what_cannot_be_current_is_reported_in_one_line(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,)}
    shell.run("method=fine", **words)
    (file,) = shell.files()
    age(file, toys, **{"content of w (read by method fine)": "0"})
    line = "1 cell has a stored result that is not current: content of w (read by method fine) is no longer read. "
    plan = shell.run("method=fine", act=lambda _, *rest: shell.call("plan", *rest), **words)
    assert sum(line in text for text in plan.stdout.splitlines()) == 1 and "changed" in plan.stdout
    id = shell.rows()["cell"].iloc[0]
    why = shell.call("why", id, f"results={shell.results}", "--plugin", toys).stdout
    assert sum("is no longer read" in text for text in why.splitlines()) == 1 and "not current" in why
    done = shell.run("method=fine", **words)
    assert sum(line in text for text in done.stderr.splitlines()) == 1 and "2 run" in done.stderr
    assert "not current" not in shell.run("method=fine", **words).stderr
