"""Files as they should be committed: text ends with one line end, and nothing is large but the weights of networks.

    python scripts/file_checks.py FILE...

It prints a line for each file that is not so, and ends with exit code 1 if there are any. pre-commit calls it.
"""

from __future__ import annotations

import sys
from pathlib import Path

LARGEST = 1_500_000  # bytes; the largest picture of the documentation has 1.4 million
WEIGHTS = {"weights", "spheres"}  # folders of the networks that are shipped


def problem(path: Path) -> str:
    """What is wrong with a file, or nothing."""
    if path.is_symlink() or not path.is_file():
        return ""
    size = path.stat().st_size
    if size > LARGEST and not (path.suffix == ".safetensors" and path.parent.name in WEIGHTS):
        return f"{size:,} bytes; at most {LARGEST:,} are expected of all but {'/ and '.join(sorted(WEIGHTS))}/"
    data = path.read_bytes()
    if b"\0" in data or not data:
        return ""
    if not data.endswith(b"\n"):
        return "the last line has no end"
    return "empty lines at the end" if data.endswith((b"\n\n", b"\r\n\r\n")) else ""


if __name__ == "__main__":
    found = {name: said for name in sys.argv[1:] if (said := problem(Path(name)))}
    for name, said in found.items():
        print(f"{name}: {said}")
    sys.exit(bool(found))
