"""For the tests of plugins: one call that holds a plugin file against the contract."""

from __future__ import annotations

from pathlib import Path

from .authoring.conformance import check_plugin
from .plugins.registry import KINDS, registry


def assert_conforms(file: str | Path) -> None:
    """Fail with every failed check of the plugins in ``file``, as ``detailbench check FILE`` would.

    Example
    -------
    ``def test_contract(): assert_conforms(Path(__file__).with_name("my_method.py"))``
    """
    path = Path(file).resolve()
    found = registry()
    found.load_file(path)
    broken = [b.reason for b in found.broken if b.file == path]
    assert not broken, f"{path} cannot be imported: {broken[0]}"
    plugins = [p for kind in KINDS for p in found.all(kind) if p.file == path]
    assert plugins, f"{path} registers no plugin"
    failed = [
        f"{plugin.kind} {plugin.name}: {check.name}: {check.detail}"
        for plugin in plugins
        for check in check_plugin(plugin, (str(path),))
        if check.verdict == "fail"
    ]
    assert not failed, "\n".join(failed)
