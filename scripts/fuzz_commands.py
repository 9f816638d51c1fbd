#!/usr/bin/env python
"""Call damaged command lines, and count what becomes of them: each is refused in words, or does what it says.

usage: python scripts/fuzz_commands.py [--lines 500] [--seed 0] [--all]

Each line is a right one with one to three mutations, called in a forked process up to the point where it would start
another one, such as that of a method. The exit code is 1 when any ended with a traceback, with an exit code that has no
meaning, without a word, with escapes for the terminal, or not within 5 seconds of the processor (30 by the clock). The
shortest line of each such kind is printed; --all prints every line and its outcome. A seed gives the same lines again.
"""

import argparse
import importlib
import os
import random
import re
import resource
import shlex
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

SECONDS, WALL, MEANT = 5, 30.0, (0, 1, 3, 130)
CELL = "task=denoise dataset=bumps sensor=samples sensor.count=100 method=jet metric=[p2f_mean] cases=1 seed=0"
RIGHT = f"""
plan {CELL} results=results
plan -m method=jet,rimls dataset=bumps,cad seed=0,1,2 cases=2 task=denoise
plan -m method=poisson method.depth=7,8 limit.seconds=60 limit.memory_gb=4 threads=2
run experiment=demo results=results --cfg job
run -m experiment=no_such_table,demo rerun=failed
plan task=denoise method=jet method.k=24 outputs=all profile=quick split=test
plan task=reconstruct method=poisson convention=mpu device=cpu verbose=true hydra/launcher=joblib
run {CELL} results=results --cfg job
run {CELL} results=results --no-leaderboard
run -m method=jet,rimls task=denoise dataset=bumps seed=range(3) cases=1
leaderboard results --task denoise --metric p2f_mean --by tag --level 0.9
leaderboard results --format csv --pareto p2f_mean,seconds --equal 0.05 --no-index
leaderboard results other --agreement real --split test --across sensor
leaderboard --convention mpu --published table_4_1
leaderboard results --best --preset mine --split train --by sensor --level 0.9
leaderboard results --columns rank,p2f_mean,seconds --names identity=Ours --digits 2 --intervals below -o board.tex
leaderboard results --by case,task --order given --method identity --format latex --wide --cite --caption x --label y
worst identity results --order score --count 3 --metric p2f_mean --format csv
why 0123456789ab results=results --source
why 0123 dataset.path=folder
reproduce 0123456789ab results=results --rtol 1e-6
list methods
list method poisson --json
list datasets
score mesh.obj cloud.xyz --metric p2f_mean,chamfer_l1_mean --samples 50 --seed 1
score cloud.xyz mesh.obj --convention mpu --json
apply method=poisson cloud.xyz out.ply method.depth=5 seed=1 threads=1
apply method=jet task=denoise cloud.xyz out.xyz normals=estimate limit.seconds=20
check poisson_9 jet
check fscore metric.t=0.02 limit.seconds=10
new method my_method --folder folder
train method=mpu training=quick results=results --save mine.safetensors --half
train method=mpu dataset=files dataset.path=folder training.seconds=5 --export-examples a.safetensors
fetch real dataset.path=folder
run --help
--version
""".strip().splitlines()
WORDS = """
??? null None true [] {} {a:1} [1,2 'x "x $ ${ ${oc.env:NOTHING} ${hydra.runtime.cwd} ${seed} ${method} ~ ~/x nan inf -1
-0 1e400 1e-400 0x10 1_000 ² ٣ é /dev/null /dev/zero . .. /etc/passwd ../../etc/passwd choice(1,2) range(0) range(1e9)
range(0,1,0) interval(0,1) glob(*) sort(1) shuffle(1) = == a=b=c =x x= ~method ~metric +seed=1 ++seed=1 ~seed ~task
hydra=1 hydra.mode=MULTIRUN hydra/sweeper=x --help --cfg -m -- - --plugin --json --x=1
"""
ODD = WORDS.split()
ODD += ["", " ", "\t", "\n", "a b", "a\nb", "\x1b[2J\x1b]0;x\x07", "\x9b31m", "\udcff", "\u202eabc", "\U0001f600"]
ODD += ["9" * 30, "9" * 5000, "-" * 300, "x" * 300, "/".join(["y" * 200] * 25), "," * 300]
ODD += [letter * 500 for letter in "[{(!"]


def mutated(count: int, seed: int):
    """So many damaged lines, as lists of words."""
    rng = random.Random(seed)
    for _ in range(count):
        words = rng.choice(RIGHT).split()
        for _ in range(rng.choice((1, 1, 2, 3))):
            words = _mutation(words, rng)
        yield words


def _mutation(words: list[str], rng: random.Random) -> list[str]:
    if not words:
        return [rng.choice(ODD)]
    command = rng.random() < 0.95  # mostly stays as it is
    odd = rng.choice(ODD)
    if command and len(words) > 1:
        return [words[0], *_mutation_of(words[1:], odd, rng)]
    return _mutation_of(words, odd, rng)


def _mutation_of(words: list[str], odd: str, rng: random.Random) -> list[str]:
    words, place = list(words), rng.randrange(len(words))
    kind = rng.randrange(9)
    if kind == 0:
        del words[place]
    elif kind == 1:
        words.insert(rng.randrange(len(words)), words[place])
    elif kind == 2:
        rng.shuffle(words)
    elif kind == 3:  # any word
        words.insert(place, odd)
    elif kind == 4:  # of another command
        words.append(rng.choice(rng.choice(RIGHT).split()))
    elif kind == 5:  # some letters are gone
        begin = rng.randint(0, len(words[place]))
        words[place] = words[place][:begin] + words[place][begin + rng.randint(1, 3) :]
    elif "=" in words[place] and kind < 8:  # another value
        words[place] = words[place].partition("=")[0] + "=" + odd
    else:  # another key, or word
        words[place] = odd + words[place][words[place].find("=") :] if "=" in words[place] else odd
    return [word.replace("\0", "") for word in words]


# -- calling -----------------------------------------------------------------------------------------------------------


def prepare(folder: Path) -> None:
    """The files that the lines name, in a folder that becomes the current one."""
    os.chdir(folder)
    Path("folder").mkdir()
    corners = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0.5)]
    Path("cloud.xyz").write_text("".join("{} {} {}\n".format(*corner) for corner in corners))
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    Path("mesh.obj").write_text("".join("v {} {} {}\n".format(*corner) for corner in corners[:4]) + faces)


def _in_child(words: list[str], folder: str) -> None:
    """Call the command in this process, which ends here."""
    os.setsid()
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    for number in (0, 1, 2):
        name = os.devnull if number == 0 else f"../printed-{number}"
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
    sys.stdout, sys.stderr = (os.fdopen(number, "w", encoding="utf-8") for number in (1, 2))
    code = 70
    try:
        from bench.cli import main
        from bench.engine import forkserver

        def start_process(*_):
            raise forkserver.CannotStart("no process is started here")

        forkserver.start_process = start_process
        code = main(words)
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def outcome(words: list[str], folder: Path) -> tuple[str, str]:
    """What became of a line, and what it printed."""
    pid = os.fork()
    if not pid:
        _in_child(words, str(folder))
    end = time.monotonic() + WALL
    while not (ended := os.waitpid(pid, os.WNOHANG))[0] and time.monotonic() < end:
        time.sleep(0.005)
    if not ended[0]:
        os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        return "hang", ""
    printed = "".join((folder.parent / f"printed-{n}").read_text(errors="replace") for n in (1, 2))
    code = os.waitstatus_to_exitcode(ended[1])
    if code == -signal.SIGXCPU:
        return "hang", printed
    if frames := re.findall(r'File "([^"]+)", line \d+, in (\w+)', printed):
        ours = [f"{Path(file).name}:{name}" for file, name in frames if "/bench/" in file]
        return f"traceback: {printed.strip().splitlines()[-1][:60]} in {ours[-1] if ours else frames[-1]}", printed
    if code not in MEANT:
        return f"exit code {code}", printed
    if not printed.strip() and code:
        return "no word", printed
    if re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", printed):
        return "control characters", printed
    return f"exit {code}", printed


def fuzz(lines, folder: Path, show: bool = False) -> tuple[Counter, dict[str, list[str]]]:
    """How often each outcome was met, and of each bad one the shortest line."""
    from bench.plugins.listing import listing
    from bench.plugins.registry import KINDS, registry
    from bench.sweep.composition import compose

    work = folder / "work"
    work.mkdir()
    prepare(work)
    listing()  # kept, as after the first start of any command
    [registry().all(kind) for kind in KINDS]
    compose([])
    for module in ("commands.plan", "commands.leaderboard", "sweep.launch", "ranking.leaderboard", "geometry.io.files"):
        importlib.import_module(f"bench.{module}")
    counts: Counter = Counter()
    kept: dict[str, list[str]] = {}
    for words in lines:
        found, printed = outcome(words, work)
        counts[found] += 1
        if show:
            print(f"{found}: {shown(words)}\n    {printed.strip()[:200]!r}", flush=True)
        shorter = found not in kept or len(shown(words)) < len(shown(kept[found]))
        if shorter and not re.fullmatch("exit [0-9]+", found):
            kept[found] = words
    return counts, kept


def shown(words: list[str]) -> str:
    """A line as it can be given to a shell; long words cut."""
    line = shlex.join(word if len(word) < 80 else f"{word[:20]}...({len(word)} letters)" for word in words)
    return line.encode("unicode_escape").decode()


def main() -> int:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--all", action="store_true")
    args = parser.parse_args()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        counts, kept = fuzz(mutated(args.lines, args.seed), Path(folder), args.all)
        os.chdir("/")
    for found, count in counts.most_common():
        print(f"{count:6,}  {found}")
    for found, words in sorted(kept.items()):
        print(f"{found}: detailbench {shown(words)}")
    print(f"{args.lines:,} lines in {time.monotonic() - begin:.0f} s")
    return 1 if kept else 0


if __name__ == "__main__":
    sys.exit(main())
