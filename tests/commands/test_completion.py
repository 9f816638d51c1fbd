"""Shell completion: what it offers, that it agrees with the parsers and the plugins, and that bash takes it."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench import cli
from bench.commands import completion
from bench.commands.completion import BASH, SCRIPTS, behind_breaks, completions, options_of, words_of
from bench.plan.keys import Base
from bench.plugins.listing import listing
from bench.plugins.registry import registry

BREAKS = " \t\n\"'><=;|&(:"


@pytest.fixture(scope="module", autouse=True)
def fresh():
    """The listing as it is now: completion takes the one that is kept."""
    listing()


def test_the_script_of_each_shell_is_printed_and_asks_this_command(capsys):
    for shell, script in SCRIPTS.items():
        assert cli.main(["completion", shell]) == 0
        assert capsys.readouterr().out == script and "completion words" in script


def test_the_kinds_of_plots_are_completed():
    assert completions(["plot", "pr"]) == ["profile "]
    assert "bars " not in completions(["plot", "bars", ""])


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_options_are_those_of_the_parser(command):
    help_of = cli.parser_for(command).format_help()
    found = options_of(command)
    assert found == options_of(command) and "--help" in found
    assert all(name in help_of for name in found)
    assert set(completions([command, "--"])) == {f"{name} " for name in found if name.startswith("--")}


def test_options_of_a_changed_command_are_looked_up_again(monkeypatch):
    options_of("list")
    monkeypatch.setattr(cli, "parser_for", lambda command: argparse.ArgumentParser(prog=command))
    assert "--json" in options_of("list")
    monkeypatch.setattr(completion, "kept_json", lambda name: {"list": {"stamp": "old", "options": {}}})
    monkeypatch.setattr(completion, "keep_json", lambda name, value: None)
    assert set(options_of("list")) == {"-h", "--help"}


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("lea", {"leaderboard "}),
        ("run method=poi", {"method=poisson ", "method=poisson_9 ", "method=points2surf "}),
        ("run -m method=poisson,ri", {"method=poisson,rimls "}),
        ("run method=poisson method.de", {"method.depth="}),
        ("run method=poisson_9 method.de", {"method.depth="}),
        ("run method.de", {"method.depth="}),  # of the default method
        ("run -m method=poisson,rimls method.dep", set()),
        ("plan dataset=bum", {"dataset=bumps "}),
        ("run metric=[standard,haus", {"metric=[standard,hausdorff", "metric=[standard,hausdorff_sq_sum"}),
        ("run metric.fscore.", {"metric.fscore.t="}),
        ("run method=poisson method.linear_fit=", {"method.linear_fit=true ", "method.linear_fit=false "}),
        ("run split=", {"split=test ", "split=train "}),
        ("run limit.se", {"limit.seconds=", "limit.setup_seconds="}),
        ("run experiment=fir", {"experiment=first_table "}),
        ("leaderboard results --convention id", {"idf "}),
        ("leaderboard --format late", {"latex "}),
        ("list experiments dem", {"demo "}),
        ("list sens", {"sensors "}),
        ("list sensor nois", {"noisy "}),
        ("check poisso", {"poisson ", "poisson_9 "}),
        ("new da", {"dataset "}),
        ("completion f", {"fish "}),
        ("nothing me", set()),
        ("apply method=poisson scan.", set()),  # the shell completes files
    ],
)
def test_what_may_stand_there(line, wanted):
    found = set(completions(words_of(f"detailbench {line}", "")[1:]))
    assert wanted <= found
    begins = {text for text in found if text.startswith(line.split()[-1])}
    assert found == begins
    if not wanted:
        assert not found


def test_values_of_few_are_those_of_the_types():
    """Each parameter with a Literal type is completed with what the plugin takes."""
    (method,) = (facts for facts in listing()["plugins"]["method"] if facts["name"] == "idf")
    literal = {name: p["choices"] for name, p in method["parameters"].items() if "choices" in p}
    assert literal
    for name, values in literal.items():
        found = completions(["run", "method=idf", f"method.{name}="])
        assert found == [f"method.{name}={value} " for value in values]


def test_keys_are_those_of_a_run():
    keys = {word.removesuffix("=") for word in completions(["run", ""]) if word.endswith("=")}
    assert keys >= {f.name for f in dataclasses.fields(Base)} - {"limit", *completion.PRIVATE}
    assert not keys & set(completion.PRIVATE)


def test_names_of_ones_own_are_completed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("conf/method").mkdir(parents=True)
    Path("conf/method/finest.yaml").write_text("# Fine.\ndefaults: [poisson]\ndepth: 11\n")
    assert completions(["run", "method=fin"]) == ["method=finest "]
    assert completions(["run", "method=finest", "method.dep"]) == ["method.depth="]


def test_bash_wants_what_stands_behind_the_last_break_of_a_word():
    assert behind_breaks(["method=poisson "], "method=poi", BREAKS) == ["poisson "]
    assert behind_breaks(["method=poisson "], "method=poi", " \t") == ["method=poisson "]
    assert words_of("detailbench run 'a b' method=x ", "31") == ["detailbench", "run", "a b", "method=x", ""]
    assert words_of("detailbench run method=x more", "24") == ["detailbench", "run", "method=x"]


def test_no_plugin_is_imported_and_the_answer_is_quick():
    """Less work than starting Python ten times over: a person waits for it at each press of the key."""
    program = (
        "import sys; from bench.commands.completion import completions; completions(['run', 'method=poi']); "
        "completions(['run', '--']); print([m for m in sys.modules if m in ('numpy', 'hydra', 'omegaconf', 'yaml')])"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "[]\n"


def test_bash_completes_with_the_script(tmp_path):
    """The words that bash itself would put in, after it has read the script."""
    assert shutil.which("bash")
    command = tmp_path / "detailbench"
    command.write_text(f'#!/bin/bash\nexec "{sys.executable}" -m bench "$@"\n')
    command.chmod(0o755)
    ask = (
        f'{BASH}\nCOMP_LINE="{command} run method=poiss"; COMP_POINT=${{#COMP_LINE}}; COMP_CWORD=4\n'
        f'COMP_WORDS=("{command}" run method = poiss); _detailbench; printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True)
    assert done.stdout.splitlines() == ["poisson ", "poisson_9 "] and done.stderr == ""
    assert registry().find("method", "poisson")
