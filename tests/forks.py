"""Answers command lines, given as JSON, one after the other, each in a fork that has its imports already.

Prints the list of (exit code, standard output, standard error).
"""

from __future__ import annotations

import json
import os
import sys
import tempfile

from bench import cli


def answer(words: list[str]) -> tuple[int, str, str]:
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = os.fork()
        if not child:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            sys.argv = ["detailbench", *words]
            sys.exit(cli.main())
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        for file in (out, err):
            file.seek(0)
        return code, out.read(), err.read()


if __name__ == "__main__":
    import hydra.main  # noqa: F401
    import pandas  # noqa: F401

    import bench.commands.run
    import bench.runner
    import bench.sweep  # noqa: F401

    print(json.dumps([answer(json.loads(line)) for line in sys.argv[1:]]))
