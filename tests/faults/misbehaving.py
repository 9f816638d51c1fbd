"""The bad methods: each does its mischief at the case of index 1. Loaded beside ``toys.py``."""

from __future__ import annotations

import ctypes
import mmap
import os
import re
import resource
import signal
import stat
import subprocess
import sys
import threading
import time

import numpy as np
from toys import BEHAVED, bad

from bench import PointCloud

ENDLESS = 100_000  # seconds


# -- error and crashed -------------------------------------------------------------------------------------------------


@bad
def raises(cloud, run):
    raise ArithmeticError("the matrix is singular")


@bad
def says_too_much(cloud, run):
    raise ArithmeticError("on and on " * 20_000)


@bad
def exits(cloud, run):
    sys.exit(3)


@bad
def interrupts(cloud, run):
    raise KeyboardInterrupt


@bad
def os_exits(cloud, run):
    os._exit(9)


@bad
def segfaults(cloud, run):
    ctypes.string_at(0)


@bad
def aborts(cloud, run):
    os.abort()


@bad
def killed(cloud, run):
    os.kill(os.getpid(), signal.SIGKILL)


@bad
def kills_its_group(cloud, run):
    os.killpg(0, signal.SIGKILL)


class Silent(Exception):
    """Cannot be shown."""

    def __str__(self):
        raise RuntimeError


@bad
def raises_what_cannot_be_shown(cloud, run):
    raise Silent


@bad
def says_far_too_much(cloud, run):
    raise ArithmeticError("x" * 50_000_000)


@bad
def closes_what_it_finds(cloud, run):
    os.closerange(3, 256)
    return BEHAVED


def write_to_pipes(text: bytes) -> None:
    """Write to every pipe that is open, as to standard output."""
    for fd in map(int, os.listdir("/proc/self/fd")):
        try:
            if fd > 2 and stat.S_ISFIFO(os.fstat(fd).st_mode):
                os.write(fd, text)
        except OSError:
            continue


@bad
def writes_to_all_pipes(cloud, run):
    write_to_pipes(b"hello\n")
    return BEHAVED


@bad
def forges_a_row(cloud, run):
    write_to_pipes(b'{"event": "row", "row": {"case": "best", "case_index": 7, "status": "ok"}}\n')
    return BEHAVED


@bad
def says_it_is_done(cloud, run):
    write_to_pipes(b'{"event": "done"}\n')
    time.sleep(ENDLESS)


@bad
def floods_its_pipe(cloud, run):
    block = b"x" * (1 << 20)
    for _ in range(1 << 10):
        write_to_pipes(block)


@bad
def stops_its_server(cloud, run):
    os.kill(os.getppid(), signal.SIGSTOP)
    return BEHAVED


# -- timeout -----------------------------------------------------------------------------------------------------------


@bad
def loops(cloud, run):
    while True:
        pass


@bad
def ignores_sigterm(cloud, run):
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    while True:
        try:
            time.sleep(ENDLESS)
        except BaseException:
            continue


@bad
def sleeps_in_c(cloud, run):
    ctypes.PyDLL(None).sleep(ENDLESS)  # holds the interpreter's lock: no Python code runs, no signal handler either


@bad
def matches_for_ever(cloud, run):
    re.match(r"(a+)+$", "a" * 60 + "b")


@bad
def stops_its_server_and_sleeps(cloud, run):
    os.kill(os.getppid(), signal.SIGSTOP)
    time.sleep(ENDLESS)


@bad
def leaves_a_child_and_loops(cloud, run):
    subprocess.Popen(["sleep", str(ENDLESS)])
    while True:
        pass


@bad
def leaves_a_daemon_and_loops(cloud, run):
    daemon()
    while True:
        pass


# -- ok, but with something left behind --------------------------------------------------------------------------------


@bad
def leaves_a_child(cloud, run):
    subprocess.Popen(["sleep", str(ENDLESS)])
    return BEHAVED


@bad
def leaves_a_session(cloud, run):
    subprocess.Popen(["sleep", str(ENDLESS)], start_new_session=True)
    return BEHAVED


@bad
def leaves_a_daemon(cloud, run):
    daemon()
    return BEHAVED


@bad
def forks_and_returns_twice(cloud, run):
    os.fork()
    return BEHAVED


def daemon() -> None:
    """Fork twice and leave the session, as daemons do; it holds every file descriptor that we have."""
    if os.fork():
        os.wait()
        return
    os.setsid()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if os.fork():
        os._exit(0)
    while True:
        time.sleep(ENDLESS)


@bad
def leaves_its_process_changed(cloud, run):
    """The next case cannot be made within such a limit, nor found from such a folder."""
    resource.setrlimit(resource.RLIMIT_AS, (1 << 28, 1 << 28))
    os.chdir("/")
    return BEHAVED


@bad
def leaves_a_busy_thread(cloud, run):
    def compute():
        while True:
            sum(range(1000))

    threading.Thread(target=compute, daemon=True).start()
    return BEHAVED


# -- oom ---------------------------------------------------------------------------------------------------------------


@bad
def allocates_untouched(cloud, run):
    return bytearray(8 << 30)


@bad
def allocates_with_numpy(cloud, run):
    return np.ones(1 << 30)


@bad
def grows_a_list(cloud, run):
    blocks = []
    while True:
        blocks.append(bytes([len(blocks) % 251]) * (1 << 20))


@bad
def grows_shared_memory(cloud, run):
    # Counted by no rlimit: only a look at the resident memory finds it.
    block, ones = mmap.mmap(-1, 4 << 30), bytes([1]) * (1 << 20)
    for start in range(0, 4 << 30, len(ones)):
        block[start : start + len(ones)] = ones
    return BEHAVED


@bad
def lets_a_child_allocate(cloud, run):
    code = "import mmap\nblock = mmap.mmap(-1, 4 << 30)\nfor page in range(0, 4 << 30, 4096): block[page] = 1"
    subprocess.run([sys.executable, "-c", code], check=True)
    return BEHAVED


# -- invalid -----------------------------------------------------------------------------------------------------------


@bad
def returns_nan(cloud, run):
    points = cloud.points.copy()
    points[3] = np.nan
    return PointCloud(points)


@bad
def returns_no_points(cloud, run):
    return PointCloud(cloud.points[:0])


@bad
def returns_too_many_points(cloud, run):
    return PointCloud(np.ones((1001, 3)))


@bad
def returns_an_array(cloud, run):
    return cloud.points


@bad
def returns_nothing(cloud, run):
    return None


@bad(task="upsample")
def wrong_count(cloud, run):
    return PointCloud(np.repeat(cloud.points, 2, axis=0))


@bad(task="reconstruct")
def no_faces(cloud, run):
    from trimesh import Trimesh

    return Trimesh(cloud.points, np.empty((0, 3), int), process=False)


@bad(task="reconstruct")
def infinite_vertices(cloud, run):
    from trimesh.creation import icosphere

    mesh = icosphere(subdivisions=1)
    mesh.vertices[0] = np.inf
    return mesh


# -- skipped -----------------------------------------------------------------------------------------------------------


@bad(requires=("no_such_library_declared",))
def declared_missing(cloud, run):
    return BEHAVED


@bad
def undeclared_missing(cloud, run):
    import no_such_library_undeclared  # noqa: F401

    return BEHAVED
