"""GPUs: named, found, claimed and measured each by its own number. No GPU is needed: a stand-in plays torch.cuda."""

import errno
import math
import os
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from conftest import TOYS, WORDS

from bench.cli import main
from bench.engine import affinity, devices, forkserver
from bench.engine.meter import Meter
from bench.errors import UsageError
from bench.plan.devices import check_name
from bench.plugins.registry import registry


class Cuda:
    """What torch.cuda is asked, in order; ``gpus`` of them, each with its own peak of memory."""

    def __init__(self, gpus: int):
        self.gpus, self.asked, self.current = gpus, [], 0

    def is_available(self):
        return self.gpus > 0

    def device_count(self):
        return self.gpus

    def set_device(self, index):
        self.current = index

    def synchronize(self, device):
        self.asked.append(("synchronize", device))

    def reset_peak_memory_stats(self, device):
        self.asked.append(("reset", device))

    def max_memory_allocated(self, device):
        self.asked.append(("peak", device))
        return (1 + devices.index_of(device)) * 2**20


@pytest.fixture
def torch(monkeypatch, tmp_path):
    def make(gpus: int):
        cuda = Cuda(gpus)
        zeros = lambda size, device: cuda.asked.append(("zeros", device))  # noqa: E731
        fake = SimpleNamespace(cuda=cuda, zeros=zeros, __version__="9.9", __spec__=None)
        monkeypatch.setitem(sys.modules, "torch", fake)
        return cuda

    monkeypatch.setattr(affinity.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    return make


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "device",
    ["gpu", "cuda:", "cuda:x", "cuda:-1", "cuda:1:2", "CUDA", "", "cpu:0", "cuda:01", "cuda:\N{FULLWIDTH DIGIT ONE}"],
)
def test_what_is_no_name_of_a_device(torch, device):
    torch(2)
    for check in (check_name, devices.check_device):  # the second also of a name that no cell has
        with pytest.raises(UsageError, match="expected cpu, cuda or cuda:N"):
            check(device)


def test_a_device_must_be_there(torch):
    for device in ("cpu", "cuda", "cuda:0", "cuda:12"):
        check_name(device)
    torch(2)
    for device in ("cpu", "cuda", "cuda:0", "cuda:1"):
        devices.check_device(device)
    for device in ("cuda:2", "cuda:99"):
        with pytest.raises(UsageError, match=f"{device}: torch sees no such GPU.* machine; expected cuda:0, cuda:1"):
            devices.check_device(device)
    torch(0)
    devices.check_device("cpu")
    with pytest.raises(UsageError, match=r"device=cuda: torch 9\.9 sees no GPU on this machine; use device=cpu"):
        devices.check_device("cuda")


def test_without_torch_it_names_the_library_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(UsageError, match="install it with"):
        devices.check_device("cuda")


def test_torch_is_not_imported_for_the_processor():
    code = (
        "import sys; from bench.engine import devices\ndevices.check_device('cpu'); devices.make_context('cpu')\n"
        "with devices.claim_device('cpu') as device: assert device == 'cpu'\nassert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# -- clock and memory --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("device", ["cuda", "cuda:0", "cuda:1"])
def test_the_meter_asks_its_own_device_and_waits_for_it_before_and_after(torch, device):
    cuda = torch(2)
    meter = Meter(4, device)
    with meter:
        cuda.asked.append("the call")
        with meter.paused():
            cuda.asked.append("a trace")
    assert {entry[1] for entry in cuda.asked if isinstance(entry, tuple)} == {device}
    call, trace = cuda.asked.index("the call"), cuda.asked.index("a trace")
    assert ("synchronize", device) in cuda.asked[:call]  # nothing from before is on the clock
    assert cuda.asked[call - 1] == ("reset", device)  # and the peak begins with the call
    assert cuda.asked[call + 1 : trace] == [("synchronize", device), ("peak", device)]
    assert cuda.asked[-2:] == [("synchronize", device), ("peak", device)]
    assert meter.figures()["peak_device_mb"] == 1 + devices.index_of(device)


def test_the_peak_of_an_earlier_call_is_forgotten(torch):
    cuda = torch(1)
    meter = Meter(4, "cuda")
    for peak in (8, 3):
        cuda.max_memory_allocated = lambda device, peak=peak: peak * 2**20
        with meter:
            pass
        assert meter.figures()["peak_device_mb"] == peak
    with Meter(4, "cpu") as cpu:
        pass
    assert math.isnan(cpu.figures()["peak_device_mb"])


def test_a_call_that_its_gpu_does_not_begin_has_no_figures_of_the_one_before(torch):
    cuda = torch(1)
    meter = Meter(4, "cuda")
    with meter:
        time.sleep(0.01)

    def fail(device):
        raise RuntimeError("an illegal memory access was encountered")

    cuda.synchronize = fail
    with pytest.raises(RuntimeError), meter:
        raise AssertionError("it began")
    figures = meter.figures()
    assert figures["seconds"] == figures["cpu_seconds"] == 0 and math.isnan(figures["peak_device_mb"])
    assert figures["peak_rss_mb"] == figures["rss_before_mb"] > 1


def test_a_context_is_made_on_the_device_itself(torch):
    cuda = torch(3)
    devices.make_context("cpu")
    assert cuda.asked == []
    devices.make_context("cuda:2")
    assert cuda.current == 2 and cuda.asked == [("zeros", "cuda:2"), ("synchronize", "cuda:2")]


# -- claims ------------------------------------------------------------------------------------------------------------


def test_two_cells_never_hold_one_gpu(torch):
    torch(2)
    with devices.claim_device("cuda") as first, devices.claim_device("cuda") as second:
        assert (first, second) == ("cuda", "cuda:1")
        looks = []

        def alive():
            looks.append(1)
            if len(looks) == 3:
                raise TimeoutError

        for device in ("cuda", "cuda:0", "cuda:1"):
            looks.clear()
            with pytest.raises(TimeoutError), devices.claim_device(device, alive):
                raise AssertionError("it was given twice")
    with devices.claim_device("cuda:1") as free:
        assert free == "cuda:1"
        with devices.claim_device("cuda") as other:
            assert other == "cuda"


@pytest.mark.parametrize("device", ["cpu", "cuda", "cuda:1"])
@pytest.mark.parametrize("is_installed", [True, False])
def test_nobody_waits_for_a_gpu_that_is_not_there(torch, monkeypatch, tmp_path, device, is_installed):
    """Nothing is held: the worker reports what is missing."""
    torch(0) if is_installed else monkeypatch.setitem(sys.modules, "torch", None)
    with devices.claim_device(device) as first, devices.claim_device(device, pytest.fail) as second:
        assert first == second == device
    assert list(tmp_path.iterdir()) == []


def test_who_waits_gets_the_gpu_when_it_is_free(torch):
    torch(1)
    got = []

    def wait():
        with devices.claim_device("cuda:0") as device:
            got.append(device)

    with devices.claim_device("cuda"):
        other = threading.Thread(target=wait)
        other.start()
        time.sleep(0.5)
        assert got == []
    other.join(timeout=10)
    assert got == ["cuda:0"]


def test_a_gpu_is_the_same_under_any_number(torch, monkeypatch):
    """The first that one process sees may be the second of another."""

    def stop():
        raise TimeoutError

    torch(1)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1")
    with devices.claim_device("cuda"):
        torch(2)
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0,1")
        with devices.claim_device("cuda") as other:
            assert other == "cuda"
            with pytest.raises(TimeoutError), devices.claim_device("cuda:1", stop):
                raise AssertionError("it was given twice")


def test_a_lock_reaches_no_file_through_a_link_and_is_shared_with_nobody_else(tmp_path, monkeypatch):
    monkeypatch.setattr(affinity.tempfile, "gettempdir", lambda: str(tmp_path))
    precious = tmp_path / "precious"
    precious.write_text("keep me")
    folder = tmp_path / f"detailbench-cpus-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    for name in ("gpu-0", *map(str, affinity.available())):
        (folder / name).symlink_to(precious)
    with affinity.hold("gpu-0") as held, affinity.claim(1) as cpus:
        assert held and cpus == affinity.available()[:1]  # unlocked, as where there can be no locks
    assert precious.read_text() == "keep me"
    assert folder.stat().st_mode & 0o777 == 0o700
    for name in os.listdir(folder):
        (folder / name).unlink()
    with affinity.claim(1) as mine, affinity.claim(1) as others:
        assert mine != others or len(affinity.available()) == 1


def test_cells_at_once_hold_different_processors_as_long_as_there_are_enough(tmp_path, monkeypatch):
    monkeypatch.setattr(affinity.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(affinity, "available", lambda: [0, 2, 5, 7, 8])
    with affinity.claim(2) as first:
        assert first == [0, 2]
        with affinity.claim(1) as second:
            assert second == [5]
            with affinity.claim(3) as third, affinity.claim(2) as fourth:
                assert third == [7, 8, 0]  # two are free, and one is shared
                assert fourth == [0, 2]  # none is free
        with affinity.claim(1) as again:
            assert again == [5]  # what has ended holds none
    with affinity.claim(9) as every:
        assert every == [0, 2, 5, 7, 8]


def test_a_folder_on_a_file_system_without_locks_gives_all_processors_to_everybody(tmp_path, monkeypatch):
    monkeypatch.setattr(affinity.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(affinity, "available", lambda: [0, 2])

    def refused(*_):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(affinity.fcntl, "flock", refused)
    with affinity.claim(1) as first, affinity.claim(1) as second:
        assert first == second == [0]


def test_the_processors_are_those_of_this_process_or_all_where_a_system_does_not_say(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", {0: {5, 3}}.__getitem__)
    assert affinity.available() == [3, 5]
    monkeypatch.delattr(os, "sched_getaffinity")
    for count, found in ((3, [0, 1, 2]), (None, [0])):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        assert affinity.available() == found


# -- commands ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def said(shell, plugin_file, monkeypatch, capsys):
    """What a command says in this process, which has torch: its exit code, and both channels."""
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    monkeypatch.chdir(shell.work)
    monkeypatch.setattr(forkserver, "prestart", lambda threads: None)  # for nothing will be run
    monkeypatch.setattr(registry(), "broken", [])  # no warnings about what other tests of this process have loaded
    plugin_file(TOYS)
    return lambda *words, **_: (main(list(map(str, words))), *capsys.readouterr())


def test_a_gpu_that_is_not_there_stops_a_sweep_before_anything_is_written(shell, said):
    code, _, why = shell.run("method=fine", "device=cpu,cuda:7", launcher="joblib", act=said)
    assert code == 1
    assert len(why.splitlines()) == 1 and "sees no GPU on this machine" in why, why
    assert not shell.results.exists()


def test_what_a_launcher_runs_elsewhere_is_checked_there():
    from bench.sweep.request import Request

    for launcher, here in {"basic": True, "joblib": True, "submitit_local": True, "submitit_slurm": False}.items():
        assert Request.of(["method=jet", f"hydra/launcher={launcher}"]).runs_here == here
    assert Request.of(["method=jet"]).runs_here
    assert Request.of(["method=jet", "device=cpu,cuda:1", "seed=1,2"]).devices == ["cpu", "cuda:1"]
    assert Request.of(["method=jet"]).devices == []


def test_plan_why_and_run_agree_on_rows_of_a_gpu_that_was_not_there(shell, said):
    """As earlier versions stored them: failed in the plan of the cases, with the fingerprint of today."""
    from dataclasses import replace

    from bench.plan.cell import Cell
    from bench.results.provenance import fingerprint, ingredients
    from bench.results.store import Record, Results

    assert shell.run("method=fine", sweep=False).returncode == 0
    results = Results(shell.results)
    path = shell.files()[0]
    stored = results.read(*path.stem.split("-"))
    cell = replace(Cell.from_json(stored.meta["cell"]), device="cuda")
    mark = fingerprint(ingredients(cell))
    meta = stored.meta | {"cell_id": cell.id, "cell": cell.to_json(), "fingerprint": mark}
    failed = {"cell": cell.id, "fingerprint": mark, "device": "cuda", "status": "error", "stage": "plan"}
    rows = [row | failed | {"message": "device=cuda: torch sees no GPU"} for row in stored.rows]
    results.write(Record(cell.id, mark, meta | {"ingredients": ingredients(cell)}, rows))

    words = ("--plugin", TOYS, *WORDS, "method=fine", "device=cuda", f"results={shell.results}")
    (plan, planned, why_not), (run, _, refused) = said("plan", *words), said("run", *words)
    assert "0/2  failed" in planned and "2 to do" in planned, planned
    assert plan == run == 1
    assert why_not == refused and "sees no GPU" in refused, refused
    _, why, _ = said("why", cell.id, f"results={shell.results}", "--plugin", TOYS)
    assert "a run would repeat 2 of 2 cases" in why
    assert "cannot be done here: device=cuda" in why
    # What is finished is shown on any machine.
    results.write(Record(cell.id, mark, meta | {"ingredients": ingredients(cell)}, [
        row | {"cell": cell.id, "fingerprint": mark, "device": "cuda"} for row in stored.rows
    ]))  # fmt: skip
    done = shell.call("run", *words)
    assert done.returncode == 0 and "0 run, 2 cached" in done.stderr, done.stderr
    assert (
        "it would not be run again" in shell.call("why", cell.id, f"results={shell.results}", "--plugin", TOYS).stdout
    )
