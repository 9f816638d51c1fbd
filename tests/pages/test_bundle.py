"""The committed bundle is built from the committed sources; no Node is needed to see that."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import bench.pages

PAGES = Path(bench.pages.__file__).parent
WEB, BUILT = PAGES / "web", PAGES / "built"
ADVICE = "bench/pages/built is not built from bench/pages/web: run `npm ci && npm run build` there"


def digest_of_sources() -> str:
    """As build.mjs computes it."""
    files = [WEB / "build.mjs", WEB / "package.json", WEB / "package-lock.json"]
    files += [path for path in (WEB / "src").rglob("*") if path.is_file()]
    found = hashlib.sha256()
    for name in sorted(path.relative_to(WEB).as_posix() for path in files):
        found.update(name.encode() + b"\0" + (WEB / name).read_bytes() + b"\0")
    return found.hexdigest()


def test_the_bundle_is_built_from_the_sources():
    first = (BUILT / "page.js").read_text(encoding="utf-8").split("\n", 1)[0]
    (said,) = re.findall(r"sources sha256:([0-9a-f]{64})", first)
    assert said == digest_of_sources(), ADVICE


def test_no_text_of_the_bundle_ends_a_script_or_a_style():
    script = (BUILT / "page.js").read_text(encoding="utf-8").lower()
    assert "</script" not in script and "<!--" not in script
    assert "</style" not in (BUILT / "page.css").read_text(encoding="utf-8").lower()


def test_the_licences_name_every_bundled_dependency():
    text = (BUILT / "LICENCES.txt").read_text(encoding="utf-8")
    wanted = json.loads((WEB / "package.json").read_text())["dependencies"]
    lock = json.loads((WEB / "package-lock.json").read_text())["packages"]
    missing = [name for name, version in wanted.items() if f"{name} {version} (" not in text]
    assert missing == []
    permissive = {"MIT", "ISC", "BSD-3-Clause", "BSD-2-Clause", "Unlicense", "0BSD", "Apache-2.0"}
    named = re.findall(r"^(@?[\w./-]+) (\d[\w.-]*) \((.+)\)$", text, re.MULTILINE)
    assert {licence for _, _, licence in named} <= permissive
    assert all(lock[f"node_modules/{name}"]["version"] == version for name, version, _ in named)
