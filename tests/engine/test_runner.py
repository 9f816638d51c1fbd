"""What the runner does between a cell and its workers: which servers it keeps, and how often it tries again."""

from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from toy_cells import config

from bench.engine import runner
from bench.engine.forkserver import CannotStart, ServerDied
from bench.engine.watch import Death
from bench.errors import UsageError
from bench.plan.cell import Cell, Settings
from bench.results.store import Record, Results

# -- servers that have loaded what was edited since --------------------------------------------------------------------


class Loaded:
    """A fork server that remembers what the plugin files said when it loaded them."""

    def __init__(self, threads):
        self.closed = False

    def load(self, preload, plugins):
        self.preload, self.sources = preload, {name: Path(name).read_text() for name in plugins}

    def close(self):
        self.closed = True


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two plugin files, ``a`` and ``b``, and no server."""
    monkeypatch.setattr(runner, "take_prestarted", Loaded)
    monkeypatch.setattr(runner, "_servers", {})
    monkeypatch.setattr(runner, "_sources", {})
    for name in "ab":
        (tmp_path / f"{name}.py").write_text(f"{name} = 1\n")
    return {name: tmp_path / f"{name}.py" for name in "ab"}


def server_of(files, *names, requires=(), loaded="ab"):
    """The server for a cell whose method is the first of these plugins; ``loaded`` are given as ``--plugin``."""
    parts = [SimpleNamespace(file=files[name], requires=requires) for name in names]
    choices = [SimpleNamespace(parts=[part]) for part in parts]
    cell = SimpleNamespace(choices=choices, method=choices[0], threads=1)
    return runner.server_for(cell, Settings(plugins=tuple(str(files[name]) for name in loaded)))


def test_a_plugin_that_is_edited_again_is_loaded_again(files):
    first = server_of(files, "a", "b")
    assert server_of(files, "a", "b") is first
    for edit in ("a = 22\n", "a = 333\n"):
        files["a"].write_text(edit)
        other = server_of(files, "a", "b")
        assert other.sources[str(files["a"])] == edit and first.closed
    assert server_of(files, "b", "a") is other
    files["b"].write_text("b = 22\n")
    assert server_of(files, "a", "b").sources[str(files["b"])] == "b = 22\n"


def test_a_plugin_that_came_with_the_installation_is_loaded_again_too(files):
    first = server_of(files, "a", loaded=())
    files["a"].write_text("a = 22\n")
    assert server_of(files, "a", loaded=()) is not first and first.closed


@pytest.mark.parametrize("error", [ServerDied, CannotStart])
def test_a_server_that_cannot_load_is_closed_and_the_next_cell_gets_another(files, monkeypatch, error):
    class Fails(Loaded):
        def load(self, preload, plugins):
            failed.append(self)
            raise error("no libGL")

    failed = []
    monkeypatch.setattr(runner, "take_prestarted", Fails)
    with pytest.raises(error, match="no libGL"):
        server_of(files, "a")
    assert [server.closed for server in failed] == [True]
    monkeypatch.setattr(runner, "take_prestarted", Loaded)
    assert isinstance(server_of(files, "a"), Loaded)


def test_the_plugin_of_a_later_cell_is_loaded_again_if_it_was_edited_before_that(files):
    first = server_of(files, "a")
    files["b"].write_text("b = 22\n")
    assert server_of(files, "a") is first  # it is nothing to this cell: b may not even be whole yet
    assert server_of(files, "b").sources[str(files["b"])] == "b = 22\n" and first.closed


def test_the_server_that_was_not_used_for_longest_is_ended_first(files):
    servers = [server_of(files, "a", requires=(str(i),)) for i in range(runner.MAX_SERVERS)]
    assert server_of(files, "a", requires=("0",)) is servers[0]
    server_of(files, "a", requires=("one more",))
    assert [server.closed for server in servers] == [False, True] + [False] * (runner.MAX_SERVERS - 2)


# -- workers that die --------------------------------------------------------------------------------------------------


class Job(runner._Job):
    """The cases of a cell, of which nothing is stored, and workers that end as they are told."""

    def __init__(self, *ends, cases=2):
        self.ids, self.rows, self.ends = [f"case {i}" for i in range(cases)], {}, list(ends)
        self.cell = SimpleNamespace(planned=cases)
        self.reporter = runner.Silent()

    def work(self, cpus):
        end = self.ends.pop(0)
        if isinstance(end, Exception):
            raise end
        return end

    def keep(self, row):
        self.rows[row["case_index"]] = row


def death(index, with_server=False):
    return Death("crashed", "killed", index, "method", 1.0, "", with_server)


def test_what_cannot_start_is_tried_three_times_and_is_no_result():
    job = Job(CannotStart("no memory"), CannotStart("no memory"), None)
    job.run([0])
    assert job.ends == []
    job = Job(*[CannotStart("no memory")] * 3, None)
    with pytest.raises(CannotStart):
        job.run([0])
    assert job.ends == [None] and job.rows == {}


def test_a_library_that_ends_its_process_is_the_result_after_three_tries():
    job = Job(ServerDied("gone"), ServerDied("gone"), None)
    job.run([0])
    assert job.rows == {}
    job = Job(*[ServerDied("gone; it was loading torch")] * 3, None)
    job.run([0])
    assert job.ends == [None] and [row["stage"] for row in job.rows.values()] == ["start", "start"]
    assert {row["message"] for row in job.rows.values()} == {"gone; it was loading torch"}


def test_a_case_whose_server_was_killed_is_tried_once_more(monkeypatch):
    forgotten = []
    monkeypatch.setattr(runner, "forget_servers", lambda: forgotten.append(len(job.ends)))
    job = Job(death(0, with_server=True), death(0, with_server=True), death(1, with_server=True), None)
    job.run([0])
    assert list(job.rows) == [0] and job.ends == [] and forgotten == [3, 2, 1]


@pytest.mark.parametrize(("stage", "seconds"), [("method", 1.5), ("case", None), ("score", None)])
def test_only_the_seconds_of_the_method_are_told_of_a_death(stage, seconds):
    found = runner.of_death(Death("timeout", "too long", 0, stage, 1.5, "its last words"))
    assert (found["seconds"], found["traceback"]) == (seconds, "its last words")
    assert 1.5 <= (datetime.now(UTC) - datetime.fromisoformat(found["started"])).total_seconds() < 10


def test_workers_that_die_between_their_cases_for_ever_are_given_up():
    job = Job(death(0), *[death(0)] * 4, None)
    job.run([0])
    assert job.ends == [None] and list(job.rows) == [0, 1] and job.rows[1]["message"] == "killed"


def test_worst_scores_are_asked_for_once_and_where_they_are_missing(monkeypatch, tmp_path):
    monkeypatch.setattr(runner, "memory_keys", lambda cell: {})
    job = Job(cases=4)
    job.cell = SimpleNamespace(to_json=dict, threads=1)
    job.settings, job.results, job.weights = Settings(), SimpleNamespace(folder=tmp_path), {}
    job.device, job.mark, job.scored = "cpu", "mark", {1}
    there, missing = {"status": "ok", "worst.x": 2.0}, {"status": "ok", "worst.x": None}
    job.rows = {2: missing, 1: missing, 0: there}
    spec = job.spec([3])
    assert (spec["done"], spec["owed"], spec["cpus"]) == ([0, 1, 2], [2], [3])


@pytest.fixture
def workers(monkeypatch):
    """A job whose workers do, one after the other, what a list of functions says, and end as these return."""

    class Told:
        def __init__(self, server, spec, limit, hear, *_):
            pass

        def watch(self):
            return left.pop(0)(job)

    def start(*functions):
        left[:] = functions
        return job

    left, job = [], Job(cases=3)
    job.settings, job.alive, job.spec, job.left = Settings(), None, lambda cpus: {}, left
    monkeypatch.setattr(runner, "server_for", lambda cell, settings: None)
    monkeypatch.setattr(runner, "Worker", Told)
    return start


def solves(*indices, replace=False):
    def watch(job):
        for kind, values in (("begin", {"stage": "plan", "index": -1}), ("cases", {"ids": job.ids})):
            job.hear({"event": kind, **values})
        for index in indices:
            job.hear({"event": "begin", "stage": "case", "index": index})
            job.hear({"event": "row", "row": {"case": job.ids[index], "case_index": index}})
        if replace:
            job.hear({"event": "replace"})

    return watch


def test_a_worker_that_a_method_has_changed_gets_a_successor_as_long_as_that_helps(workers):
    job = workers(solves(0, replace=True), solves(1, 2))
    assert runner._Job.work(job, [0]) is None and job.left == []
    job.rows = {}
    job = workers(solves(0, replace=True), solves(replace=True), solves(1, 2))
    death = runner._Job.work(job, [0])
    assert (death.status, death.index) == ("crashed", 1) and "before the case was done" in death.message
    assert len(job.left) == 1
    job.rows = {}
    job = workers(
        solves(0, replace=True), solves(1), solves(2)
    )  # it says that it is done, as a method can, and asks for none
    assert runner._Job.work(job, [0]).index == 2 and len(job.left) == 1


def test_a_worker_that_ends_before_it_began_is_reported_with_its_last_line(workers):
    said = "Traceback:\nImportError: no numpy"
    job = workers(lambda job: Death("crashed", "ended with exit status 70", -1, "start", 0.1, said))
    with pytest.raises(CannotStart, match=r"exit status 70; ImportError: no numpy\. No result was stored"):
        runner._Job.work(job, [0])


def test_a_server_that_ends_at_the_fork_is_no_result_and_all_are_started_anew(workers, files):
    def ends(job):
        raise ServerDied("the fork server ended unexpectedly")

    server = runner.take_prestarted(1)
    runner._servers["the key of a cell"] = server
    with pytest.raises(CannotStart, match=r"the fork server ended unexpectedly\. No result was stored"):
        runner._Job.work(workers(ends), [0])
    assert server.closed and runner._servers == {}


# -- outputs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("outputs", "wanted"), [("none", []), ("first", ["first"]), ("all", ["first", "second"])])
def test_a_solved_case_lacks_the_output_that_is_asked_for_and_not_there(tmp_path, outputs, wanted):
    (tmp_path / "outputs").mkdir()
    (tmp_path / "outputs" / "there.ply").touch()
    row = {"case_index": 1, "status": "ok", "output": "outputs/gone.ply"}
    rows = {
        "first": row | {"case_index": 0},
        "second": row,
        "failed": row | {"case_index": 0, "status": "timeout"},
        "there": row | {"case_index": 0, "output": "outputs/there.ply"},
    }
    results, settings = SimpleNamespace(folder=tmp_path), Settings(outputs=outputs)
    assert [name for name in rows if runner.lacks_output(results, rows[name], settings)] == wanted


@pytest.mark.parametrize(
    ("settings", "again"),
    [
        ({"outputs": "all"}, {0, 1}),
        ({"outputs": "first"}, {0}),
        ({"outputs": "none"}, set()),
        ({"rerun": "always"}, set()),
    ],
)
def test_what_is_run_again_only_for_its_output_is_told_apart_from_what_is_run_again_anyway(
    tmp_path, monkeypatch, settings, again
):
    row = {"status": "ok", "output": None}
    monkeypatch.setattr(runner, "finished_rows", lambda *_: ({i: row | {"case_index": i} for i in range(2)}, None))
    settings = Settings(**{"outputs": "all"} | settings)
    assert runner._without_output(SimpleNamespace(folder=tmp_path), None, "mark", settings) == again


def test_the_references_of_stored_outputs_stay_known_when_further_cases_are_run():
    stored = Record("cell", "mark", {"references": {"a": "a.ply", "b": "b.ply"}}, [])
    rows = [
        {"case": "b", "reference": "new.ply"},
        {"case": "c", "reference": "c.ply"},
        {"case": "d", "reference": None},
    ]
    assert runner._references(stored, rows) == {"a": "a.ply", "b": "new.ply", "c": "c.ply"}
    assert [*rows[0]] == ["case"]  # it is no column
    assert runner._references(None, [{"case": "a"}]) == runner._references(Record("", "", {}, []), []) == {}


# -- rows --------------------------------------------------------------------------------------------------------------


def test_every_row_is_stored_and_shown_as_soon_as_it_is_there(workers):
    job = workers(solves(0, 1, 2))
    job.keep, job.weights, job.constants, job.mark, job.scored = partial(runner._Job.keep, job), {}, {}, "mark", set()
    job.cell = SimpleNamespace(id="cell", planned=3)
    stored, shown = [], []
    job.results = SimpleNamespace(add_partial=lambda cell, mark, row: stored.append((cell, mark, row["case"])))
    job.reporter = SimpleNamespace(event=lambda event: shown.append((event["event"], len(stored))))
    assert runner._Job.work(job, [0]) is None
    assert stored == [("cell", "mark", f"case {i}") for i in range(3)]
    assert [count for kind, count in shown if kind == "kept"] == [1, 2, 3]


def test_a_dataset_without_shapes_in_the_split_is_an_error_and_no_result(tmp_path, monkeypatch):
    monkeypatch.setattr(runner._Job, "run", lambda job, cpus: None)
    cell = Cell.from_config(config())
    with pytest.raises(UsageError, match="dataset provenance_dataset has no shapes in the split 'test'"):
        runner.run_cell(cell, Settings(results=str(tmp_path)))
    assert Results(tmp_path).records(cell.id) == []
