"""The contract, and what only this plugin promises."""

from pathlib import Path

from bench.testing import assert_conforms


def test_it_keeps_the_contract() -> None:
    assert_conforms(Path(__file__).with_name("my_plugin.py"))
