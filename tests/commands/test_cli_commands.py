"""The commands do what their help says: list, plan, why, reproduce, apply, new, check, and what they leave behind."""

from __future__ import annotations

import json
import re
import sys

import numpy as np
import pytest
from conftest import TOYS

from bench import Frame
from bench.contract.ball_views import views_of_a_ball
from bench.contract.image_folders.writing import save_views_as_transforms
from bench.geometry.io.files import load_mesh

COMMANDS = ("run", "plan", "list", "leaderboard", "apply", "check", "new", "why", "reproduce")


@pytest.fixture(scope="module")
def finished(shells):
    """A small finished sweep, and what running it printed."""
    shell = shells("finished")
    done = shell.run("method=fine,identity", "seed=0,1", board=True)
    assert done.returncode == 0, done.stderr
    return shell, done


# -- the front door ----------------------------------------------------------------------------------------------------


def test_help_names_every_command_and_the_exit_codes(shell):
    done = shell.call("--help")
    assert done.returncode == 0
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", done.stdout, re.MULTILINE)
    assert re.search(r"0 .*1 .*3 .*130", done.stdout, re.DOTALL)
    assert shell.call("--version").stdout.split()[0] == "detailbench"
    assert shell.call().returncode == 1


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_a_help_of_its_own(shell, command):
    done = shell.call(command, "--help")
    assert done.returncode == 0, done.stderr
    assert f"detailbench {command}" in done.stdout
    assert "--plugin" in done.stdout or command in ("new", "leaderboard")
    assert not done.stderr


def test_python_m_bench_is_the_same(shell):
    module = [sys.executable, "-m", "bench"]
    assert shell.call("--help", command=module).stdout == shell.call("--help").stdout
    done = shell.run("method=fine", sweep=False, command=module)
    assert done.returncode == 0, done.stderr
    assert (shell.rows()["status"] == "ok").all()


# -- run and plan ------------------------------------------------------------------------------------------------------


def test_a_clean_run_leaves_results_and_nothing_else(finished):
    shell, done = finished
    assert list(shell.work.iterdir()) == []
    below = {path.name for path in shell.results.iterdir()}
    assert below <= {"cells", ".cache", ".locks", ".index", ".sweeps", ".partial"}
    for folder in (".sweeps", ".partial"):
        assert not list(shell.results.glob(f"{folder}/*"))
    assert len(shell.files()) == 4
    assert "Traceback" not in done.stderr
    assert not shell.left_over()
    assert "fine" in done.stdout
    assert "identity" in done.stdout


def test_one_results_folder_relative_to_where_one_is(shell):
    assert shell.run("method=fine", "results=here", sweep=False).returncode == 0
    assert {path.name for path in shell.work.iterdir()} == {"here"}
    assert shell.run("method=fine", "results=here", sweep=False, launcher="joblib").returncode == 0
    assert len(shell.calls()) == 2


def test_plan_knows_what_is_finished_and_runs_nothing(finished):
    shell, _ = finished
    calls = shell.calls()
    act = lambda command, *words, **options: shell.call("plan", *words, **options)  # noqa: E731
    done = shell.run("method=fine,identity", "seed=0,1,2", act=act)
    assert done.returncode == 0, done.stderr
    assert "6 cells, 12 cases, 8 finished, 4 to do" in done.stdout
    assert len(re.findall(r"2/2 +finished", done.stdout)) == 4
    assert len(re.findall(r"0/2 +new", done.stdout)) == 2
    assert shell.calls() == calls
    planned = set(re.findall(r"^([0-9a-f]{12}) ", done.stdout, re.MULTILINE))
    assert set(shell.rows()["cell"]) <= planned  # the ids are those that the run uses


def test_an_experiment_that_is_a_sweep_takes_several_values(shell):
    words = ("experiment=demo", "task=denoise", "method=noise,identity", "dataset=cad", "metric=[p2f_mean]", "cases=1")
    done = shell.call("plan", *words)
    assert done.returncode == 0, done.stderr
    assert "2 cells, 2 cases" in done.stdout
    done = shell.call("run", *words)
    assert done.returncode == 0, done.stderr
    assert "2 cells, 2/2 cases solved" in done.stderr


@pytest.mark.parametrize("words", [("method=fine",), ("experiment=demo",), ("method=fine", "--resolve")])
def test_a_config_is_shown_and_nothing_is_run(shell, words):
    done = shell.run(*words, "threads=3", "--cfg", "job", sweep=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert {"threads: 3", "cases: 2", "session: none"} <= set(done.stdout.splitlines())
    assert not shell.results.exists()
    assert not list(shell.work.iterdir())


@pytest.mark.parametrize("flag", ["--hydra-help", "--info"])
def test_hydra_tells_of_itself(shell, flag):
    done = shell.call("run", flag)
    assert done.returncode == 0, done.stderr
    assert "Hydra" in done.stdout or "hydra" in done.stdout
    assert not list(shell.work.iterdir())


def test_a_glob_is_all_methods_of_that_name(shell):
    words = ("method=glob(id*tity)", "method.nothing=1")
    assert "identity has no parameter 'nothing'" in shell.run(*words).stderr
    done = shell.run("method=glob(fin*)", "cases=1")
    assert done.returncode == 0, done.stderr
    assert set(shell.rows()["method"]) == {"fine"}


def test_a_sweep_over_methods_takes_a_parameter_that_the_default_method_lacks(shell):
    done = shell.run("method=jet,bilateral", "method.k=9", "sensor=samples", "sensor.count=300", "cases=1")
    assert done.returncode == 0, done.stderr
    assert set(shell.rows()[["method", "variant"]].itertuples(index=False, name=None)) == {
        ("jet", "k=9"),
        ("bilateral", "k=9"),
    }


def test_a_method_that_does_not_solve_the_task(shell):
    done = shell.run("method=fine", "task=reconstruct", sweep=False)
    assert done.returncode == 1
    assert "fine does not solve reconstruct: it solves denoise" in done.stderr
    assert "identity" in done.stderr
    assert "Traceback" not in done.stderr


def test_methods_get_the_same_cases_and_seeds_others(finished):
    """And launchers all get the same rows: see test_faults_methods.py."""
    rows = finished[0].rows()
    assert len(rows) == 8
    assert rows["score.spread"].nunique() == 4  # two seeds, two cases; both methods return the cloud
    assert (rows.groupby(["seed", "case"])["score.spread"].nunique() == 1).all()


# -- list --------------------------------------------------------------------------------------------------------------


def test_list_as_text_and_as_json(shell):
    done = shell.call("list", "--plugin", TOYS)
    assert done.returncode == 0
    for word in ("tasks", "datasets", "sensors", "methods", "metrics", "fine", "ball", "dots", "spread", "identity"):
        assert re.search(rf"\b{word}\b", done.stdout)
    listing = json.loads(shell.call("list", "--json", "--plugin", TOYS).stdout)
    (fine,) = (m for m in listing["method"] if m["name"] == "fine")
    assert fine["tasks"] == ["denoise"]
    assert fine["parameters"]["take"] == {"default": 0.0, "help": "seconds"}
    assert fine["file"] == str(TOYS)
    assert listing["broken"] == []
    one = shell.call("list", "method", "fine", "--plugin", TOYS)
    assert "method.take=0.0  seconds" in one.stdout
    assert json.loads(shell.call("list", "datasets", "--json").stdout).keys() == {"dataset", "broken"}


def test_the_listing_shows_what_is_missing(shell):
    done = shell.call("list", "methods", "--plugin", TOYS, "--plugin", TOYS.with_name("misbehaving.py"))
    (line,) = (line for line in done.stdout.splitlines() if "declared_missing" in line and "undeclared" not in line)
    assert "pip install no_such_library_declared" in line


# -- why and reproduce -------------------------------------------------------------------------------------------------


def test_why_and_reproduce_a_stored_cell(finished):
    shell, _ = finished
    cell = shell.rows(method="identity", seed=1)["cell"].iloc[0]
    why = shell.call("why", cell, f"results={shell.results}", "--plugin", TOYS)
    assert why.returncode == 0, why.stderr
    assert "identity seed=1" in why.stdout
    assert "2/2 solved" in why.stdout
    assert "current:" in why.stdout
    files = {path: path.read_bytes() for path in shell.files()}
    again = shell.call("reproduce", cell, f"results={shell.results}", "--plugin", TOYS)
    assert again.returncode == 0, again.stderr
    assert "reproduced: every status and score agrees" in again.stdout
    assert {path: path.read_bytes() for path in shell.files()} == files
    assert list(shell.work.iterdir()) == []
    assert not shell.left_over()


def test_reproduce_tells_a_method_that_draws_from_nowhere(shell):
    plugin = shell.folder / "moody.py"
    plugin.write_text(
        "from dataclasses import dataclass\nimport os\nimport numpy as np\nfrom bench import PointCloud, register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Moody:\n    'Another result every time.'\n"
        "    def denoise(self, cloud, run):\n"
        "        rng = np.random.default_rng(int.from_bytes(os.urandom(8), 'big'))\n"
        "        return PointCloud(cloud.points + rng.normal(size=cloud.points.shape))\n"
    )
    shell.run("method=moody", sweep=False, plugins=(TOYS, plugin))
    plugins = ("--plugin", TOYS, "--plugin", plugin)
    again = shell.call("reproduce", shell.rows()["cell"].iloc[0], f"results={shell.results}", *plugins)
    assert again.returncode == 3
    assert re.search(r"ball-test-000: spread was [\d.]+, is [\d.]+", again.stdout)
    assert "2 differences" in again.stdout
    check = shell.call("check", plugin)
    assert check.returncode == 3
    assert re.search(r"FAIL  denoise: same seed, same result", check.stdout)


# -- apply -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def cloud_file(shell):
    """Two hundred points far from the origin."""
    points = np.random.default_rng(3).normal(scale=20.0, size=(200, 3)) + (1000.0, 0.0, -50.0)
    np.savetxt(shell.work / "scan.xyz", points, fmt="%.17g")
    return points


def test_apply_writes_in_the_coordinates_of_the_input(shell, cloud_file):
    done = shell.call("apply", "--plugin", TOYS, "method=fine", "scan.xyz", "clean.xyz")
    assert done.returncode == 0, done.stderr
    assert "200 points" in done.stdout
    assert np.allclose(np.loadtxt(shell.work / "clean.xyz")[:, :3], cloud_file, rtol=1e-6)
    assert {p.name for p in shell.work.iterdir()} == {"scan.xyz", "clean.xyz"}
    assert not shell.left_over()


def test_apply_asks_for_the_task_where_it_is_open(shell, cloud_file):
    done = shell.apply("method=identity", "scan.xyz", "clean.xyz")
    assert done.returncode == 1
    assert "task=denoise" in done.stderr
    assert "task=upsample" in done.stderr and "task=reconstruct" not in done.stderr
    mesh = shell.apply("method=identity", "scan.xyz", "mesh.ply")
    assert mesh.returncode == 0 and "faces" in mesh.stdout, mesh.stderr
    assert mesh.stderr == "task=reconstruct; identity also solves task=denoise or task=upsample\n"
    given = shell.apply("method=identity", "task=denoise", "scan.xyz", "clean.ply")
    assert given.returncode == 0, given.stderr
    assert (shell.work / "clean.ply").read_bytes().startswith(b"ply")
    # A parameter that one of the tasks has says which is meant.
    dense = shell.apply("method=identity", "scan.xyz", "dense.ply", "task.ratio=2")
    assert dense.returncode == 0 and "400 points" in dense.stdout, dense.stderr
    wrong = shell.apply("method=identity", "task=denoise", "scan.xyz", "dense.ply", "task.ratio=2")
    assert wrong.returncode == 1 and "task denoise has no parameter 'ratio'" in wrong.stderr


NOTING = '''
from dataclasses import dataclass
from bench import register

@register("method")
@dataclass(frozen=True)
class Noting:
    """Has something to say."""

    fails: bool = False

    def denoise(self, cloud, run):
        run.note("half as many")
        run.note("half as far")
        if self.fails:
            raise ArithmeticError("no pivot")
        return cloud
'''


def test_what_a_method_notes_is_shown_where_it_is_applied_and_below_leaderboards(shell, cloud_file):
    plugin = shell.folder / "noting.py"
    plugin.write_text(NOTING)
    done = shell.apply("--plugin", plugin, "method=noting", "scan.xyz", "clean.xyz")
    assert done.stdout.splitlines()[-1] == "noting: note: half as many; half as far"
    done = shell.run("method=noting", "method.fails=false,true", plugins=(TOYS, plugin), board=True)
    messages = dict(shell.rows()[["status", "message"]].itertuples(index=False))
    noted = "half as many; half as far"
    assert messages == {"ok": noted, "error": f"ArithmeticError: no pivot (note: {noted})"}
    told = done.stdout.partition("Solved, with a note")[2].splitlines()[1]
    assert told.startswith("  noting: ") and told.endswith(": half as many; half as far")


LIMITED = '''
from dataclasses import dataclass
from bench import register

@register("method")
@dataclass(frozen=True)
class Limited:
    """Tells its limit."""

    def denoise(self, cloud, run):
        run.note(f"{run.seconds:g} s")
        return cloud
'''


def test_a_limit_of_apply_is_that_one_and_no_other(shell, cloud_file):
    """A file of one's own may take a day; a word on memory does not bring in the benchmark's minute."""
    plugin = shell.folder / "limited.py"
    plugin.write_text(LIMITED)
    for words, seconds in ((), 86400), (("limit.memory_gb=2",), 86400), (("limit.seconds=30",), 30):
        done = shell.apply("--plugin", plugin, "method=limited", *words, "scan.xyz", "clean.xyz")
        assert done.stdout.splitlines()[-1] == f"limited: note: {seconds} s"


def test_what_was_noted_is_made_again_under_a_larger_limit(shell):
    """What was left out for want of time may fit now."""
    plugin = shell.folder / "limited.py"
    plugin.write_text(LIMITED)
    for seconds, message in (20, "20 s"), (10, "20 s"), (30, "30 s"):
        done = shell.run("method=limited", f"limit.seconds={seconds}", plugins=(TOYS, plugin))
        assert done.returncode == 0, done.stderr
        assert set(shell.rows()["message"]) == {message}


def test_apply_says_that_there_is_no_gpu(shell, cloud_file, monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    done = shell.apply("method=siren", "scan.xyz", "mesh.ply", "device=cuda")
    assert done.returncode == 1
    assert "device=cuda: torch" in done.stderr and "sees no GPU on this machine; use device=cpu" in done.stderr


BAD_METHODS = {
    "raises_always": ("raise ArithmeticError('no pivot')", "ArithmeticError: no pivot"),
    "dies": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed: killed by SIGSEGV"),
    "hangs": ("while True: pass", "timeout: stopped after 1 s"),
    "returns_none": ("return None", "invalid: promised a PointCloud"),
    "eats": ("return bytearray(64 << 30)", "oom: "),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_METHODS)
def test_apply_survives_a_bad_method_with_one_message(shell, cloud_file, name):
    body, message = BAD_METHODS[name]
    plugin = shell.folder / "bad.py"
    plugin.write_text(
        "from dataclasses import dataclass\nfrom bench import register\n"
        f"@register('method', name='{name}')\n@dataclass(frozen=True)\nclass Bad:\n    'Bad.'\n"
        f"    def denoise(self, cloud, run):\n        {body}\n"
    )
    limits = ("limit.seconds=1", "limit.memory_gb=1")
    done = shell.apply("--plugin", plugin, f"method={name}", "scan.xyz", "clean.xyz", *limits)
    assert done.returncode == 1
    assert f"error: {name}: {message}" in done.stderr
    assert not (shell.work / "clean.xyz").exists()
    assert not shell.left_over()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("method=identity", "task=denoise", "gone.xyz", "out.xyz"), ("gone.xyz", "no such file")),
        (("method=identity", "task=denoise", "scan.xyz", "gone/out.xyz"), ("gone",)),
        (("method=identity", "task=denoise", "scan.xyz", "out.docx"), ("out.docx", ".docx")),
        (("method=identity", "task=denoise", "empty.xyz", "out.xyz"), ("empty.xyz",)),
        (("method=identity", "task=denoise", "text.ply", "out.xyz"), ("text.ply",)),
        (("method=identity", "task=denoise", "two.xyz", "out.xyz"), ("two.xyz", "3")),
        (("method=identity", "task=denoise", "nan.xyz", "out.xyz"), ("nan.xyz", "NaN")),
        (("method=identity", "task=denoise", "scan.xyz", "scan.xyz", "out.xyz"), ("one input file",)),
    ],
)
def test_apply_refuses_poor_files_by_name(shell, cloud_file, words, said):
    (shell.work / "empty.xyz").write_text("")
    (shell.work / "text.ply").write_text("once upon a time\n")
    (shell.work / "two.xyz").write_text("0 0 0\n1 1 1\n")
    (shell.work / "nan.xyz").write_text("nan 0 0\n" * 4)
    done = shell.apply(*words)
    assert done.returncode == 1, done.stdout
    assert "Traceback" not in done.stderr, done.stderr
    for word in said:
        assert word in done.stderr
    assert not list(shell.work.glob("out.*"))


@pytest.mark.parametrize("output", ["out.docx", "out", "/proc/out.xyz"])
def test_apply_refuses_an_output_that_cannot_be_written_before_it_is_made(shell, cloud_file, output):
    before = sorted(shell.work.iterdir())
    done = shell.apply("--plugin", TOYS, "method=fine", "scan.xyz", output)
    assert done.returncode == 1
    assert done.stderr.startswith((f"error: {output}: ", f"error: fine: {output}: "))
    assert shell.calls() == []
    assert sorted(shell.work.iterdir()) == before


# -- new and check -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["method", "dataset", "sensor", "metric", "task"])
def test_a_new_plugin_passes_its_check_and_runs_at_once(shell, kind):
    done = shell.call("new", kind, "my_thing")
    assert done.returncode == 0, done.stderr
    assert {p.name for p in shell.work.iterdir()} == {"my_thing.py", "test_my_thing.py"}
    check = shell.call("check", "my_thing.py")
    assert check.returncode == 0, check.stdout
    assert "FAIL" not in check.stdout
    assert re.search(r"\b0 failed", check.stdout)
    choice = {"metric": "metric=[my_thing]"}.get(kind, f"{kind}=my_thing")
    method = {"method": (), "task": ("method=my_thing_baseline",)}.get(kind, ("method=fine",))
    ran = shell.run(choice, *method, sweep=False, plugins=(TOYS, shell.work / "my_thing.py"))
    assert ran.returncode == 0, ran.stderr
    assert (shell.rows()["status"] == "ok").all()
    again = shell.call("new", kind, "my_thing")
    assert again.returncode == 1
    assert "exists; nothing was written" in again.stderr


def test_a_new_plugin_s_own_test_passes(shell):
    shell.call("new", "method", "MyThing")
    done = shell.call("-q", "-p", "no:cacheprovider", "test_my_thing.py", command=[sys.executable, "-m", "pytest"])
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("task", "lambda", "word of the Python language"),
        ("sensor", "shape", "class Shape"),
        ("method", "2d", "letter first"),
    ],
)
def test_a_name_that_a_new_file_cannot_have_is_refused(shell, kind, name, words):
    done = shell.call("new", kind, name)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ") and words in done.stderr
    assert not list(shell.work.iterdir())


def test_check_judges_by_name_and_as_json(shell):
    done = shell.call("check", "identity", "--json")
    assert done.returncode == 0, done.stdout
    report = json.loads(done.stdout)
    assert {entry["verdict"] for entry in report} <= {"ok", "warn"}
    assert {entry["plugin"] for entry in report} == {"method identity"}


def test_check_takes_a_preset(shell):
    done = shell.call("check", "noisy", "--json")
    assert done.returncode == 0, done.stderr
    assert {entry["plugin"] for entry in json.loads(done.stdout)} == {"sensor noisy"}
    refused = shell.call("check", "noisy", "sensor.source.count=-1")
    assert refused.returncode == 1
    assert "sensor chain has no parameter 'source'" in refused.stderr  # of the plugin behind it
    assert "Did you mean 'noisy'" in shell.call("check", "nosiy").stderr


def test_check_with_other_parameters_and_limits(shell):
    done = shell.call("check", "--plugin", TOYS, "fine", "method.take=5", "limit.seconds=0.5")
    assert done.returncode == 3, done.stderr
    assert re.search(r"FAIL  denoise: toy case: timeout: .*limit.seconds=0.5", done.stdout)


def test_check_fails_a_method_that_crashes_or_breaks_its_promise(shell):
    plugin = shell.folder / "bad.py"
    plugin.write_text(
        "from dataclasses import dataclass\nimport os\nfrom bench import register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Dies:\n    'Dies.'\n"
        "    def denoise(self, cloud, run):\n        os.abort()\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Lies:\n    'Returns something else.'\n"
        "    def denoise(self, cloud, run):\n        return cloud.points\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Idles:\n    'Solves nothing.'\n"
    )
    done = shell.call("check", plugin)
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    dies, idles, lies = re.split(r"^method \w+ .*$", done.stdout, flags=re.MULTILINE)[1:]
    assert re.search(r"FAIL .*SIGABRT", dies)
    assert re.search(r"FAIL .*no function is named after a task", idles)
    assert re.search(r"FAIL .*promised a PointCloud", lies)
    assert not shell.left_over()


def test_apply_takes_a_folder_of_images(shell):
    """Triangles of random places in the ball that is estimated from the masks, in the coordinates of the cameras."""
    center, radius = np.array([10.0, -4.0, 2.0]), 3.0
    views = views_of_a_ball(12, 48).in_frame(Frame(tuple(-center / radius), 1 / radius))
    save_views_as_transforms(views, shell.work / "photos")
    done = shell.apply("method=noise", "photos", "mesh.ply", "task.max_pixels=40")
    assert done.returncode == 0, done.stderr
    assert "photos (Views(12 images of 40 x 40)) -> mesh.ply" in done.stdout
    distance = np.linalg.norm(load_mesh(shell.work / "mesh.ply").vertices - center, axis=1)
    assert 0.9 * radius < distance.max() < 1.4 * radius
    (shell.work / "photos/transforms.json").unlink()
    done = shell.apply("method=noise", "task=multiview", "photos", "mesh.ply")
    assert done.returncode == 1 and "photos: has no file of cameras; expected one of transforms.json" in done.stderr
