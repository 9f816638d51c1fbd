"""CGAL's advancing front, in a process of its own.

CGAL makes some of its choices in the order of memory addresses, so that the result depends on what the process did
before: on noisy points nearly every call chooses some other triangles. A new process that starts in the same way each
time always has the same memory layout.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys

import numpy as np


def advancing_front(points: np.ndarray, radius_ratio: float, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (v, 3) and triangles (f, 3) of the front through points (n, 3).

    Raises
    ------
    MemoryError, RuntimeError
        If the process ended without a result.
    """
    request = io.BytesIO()
    np.savez(request, points=points, radius_ratio=radius_ratio, beta=beta)
    # The folder, the environment and the random order of sets must be the same each time.
    environment = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-P", "-s", "-c", f"from {__name__} import main; main()"],
        input=request.getvalue(),
        capture_output=True,
        env={**environment, "PYTHONHASHSEED": "0"},
        cwd="/",
        check=False,
    )
    if done.returncode:
        printed = done.stderr.decode(errors="replace").strip()
        if "bad_alloc" in printed or "MemoryError" in printed:
            raise MemoryError(f"CGAL's advancing front ran out of memory: {printed[-500:]}")
        raise RuntimeError(f"CGAL's advancing front ended with exit status {done.returncode}: {printed[-2000:]}")
    mesh = np.load(io.BytesIO(done.stdout))
    return mesh["vertices"], mesh["faces"]


def main() -> None:
    """Read the points from the standard input, and write the mesh to the standard output."""
    from CGAL.CGAL_Advancing_front_surface_reconstruction import advancing_front_surface_reconstruction
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    from .point_sets import to_mesh, to_point_set

    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # the output of libraries goes to the standard error
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    polyhedron = Polyhedron_3()
    radius_ratio, beta = float(request["radius_ratio"]), float(request["beta"])
    advancing_front_surface_reconstruction(to_point_set(request["points"]), polyhedron, radius_ratio, beta)
    vertices, faces = to_mesh(polyhedron)
    with answer:
        np.savez(answer, vertices=vertices, faces=faces)
