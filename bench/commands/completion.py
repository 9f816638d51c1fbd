"""Print a script that lets a shell complete commands, options, names of plugins and presets, and their parameters.

  eval "$(detailbench completion bash)"      for this shell; in ~/.bashrc for all
  eval "$(detailbench completion zsh)"       in ~/.zshrc, after compinit
  detailbench completion fish | source       in ~/.config/fish/config.fish

Names come from the listing that the last command cached, and from ./conf: no plugin is imported, and no file that
--plugin names is run.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from .. import cli
from ..cli import COMMANDS
from ..plugins.kept import keep_json, kept_json

PASSES_ON = True  # the words to complete may look like options

BASH = """_detailbench() {
    COMPREPLY=()
    local word
    while IFS= read -r word; do COMPREPLY+=("$word"); done < <(
        BENCH_LINE="$COMP_LINE" BENCH_POINT="$COMP_POINT" BENCH_BREAKS="$COMP_WORDBREAKS" \\
            "${COMP_WORDS[0]/#\\~/$HOME}" completion words 2>/dev/null)
}
complete -o nospace -o default -F _detailbench detailbench
"""
ZSH = """#compdef detailbench
_detailbench() {
    local word
    local -a whole begun
    while IFS= read -r word; do
        if [[ $word == *' ' ]]; then whole+=("${word% }"); else begun+=("$word"); fi
    done < <("${words[1]/#\\~/$HOME}" completion words "${(@)words[2,CURRENT]}" 2>/dev/null)
    if (( $#whole + $#begun == 0 )); then
        compset -P '*='
        _files
        return
    fi
    (( $#whole )) && compadd -Q -- $whole
    (( $#begun )) && compadd -Q -S '' -- $begun
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
compdef _detailbench detailbench
"""
FISH = """function __detailbench_words
    set -l words (commandline -opc) (commandline -ct)
    command $words[1] completion words $words[2..-1] 2>/dev/null | string trim --right
end
complete -c detailbench -f -n 'count (__detailbench_words) >/dev/null' -a '(__detailbench_words)'
"""
SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}

TAKE_OVERRIDES = ("run", "plan", "train", "tune", "apply", "check", "fetch")
TAKE_OVERRIDES = ("run", "plan", "train", "apply", "check", "fetch", "inputs")
KINDS = ("task", "dataset", "sensor", "method", "metric")
KEY_VALUES = {
    "split": ("test", "train"),
    "outputs": ("none", "first", "all"),
    "rerun": ("never", "failed", "always"),
    "device": ("cpu", "cuda"),
    "verbose": ("true", "false"),
    "training.weights": ("auto", "trained", "shipped"),
    "hydra/launcher": ("basic", "joblib", "submitit_local", "submitit_slurm", "ray"),
}
PRIVATE = ("plugins", "config_dirs", "session", "published", "sizes")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "shell", choices=[*SCRIPTS, "words"], help="the shell whose script is printed; the scripts call `words`"
    )
    parser.add_argument("words", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    """Print the script, or the candidates for the last word, one on a line."""
    if args.shell in SCRIPTS:
        print(SCRIPTS[args.shell], end="")
        return 0
    line = os.environ.get("BENCH_LINE")  # not bash's own variables, which a wrapper would not pass on
    words = args.words if line is None else words_of(line, os.environ.get("BENCH_POINT", ""))[1:]
    found = completions(words or [""])
    if line is not None:
        found = behind_breaks(found, words[-1] if words else "", os.environ.get("BENCH_BREAKS", ""))
    print("\n".join(found))
    return 0


def words_of(line: str, point: str) -> list[str]:
    """The words of a line of bash up to the cursor, the last of which is to be completed; quotes are removed."""
    line = line[: int(point)] if point.isdecimal() else line
    words = [re.sub(r"[\"']", "", word) for word in re.findall(r"(?:[^\s\"']|\"[^\"]*(?:\"|$)|'[^']*(?:'|$))+", line)]
    return [*words, ""] if not words or line[-1:].isspace() else words


def behind_breaks(found: Iterable[str], word: str, breaks: str) -> list[str]:
    """The completions as bash expects them: without the part of the word up to its last word break."""
    begin = max((word.rfind(letter) + 1 for letter in breaks), default=0)
    return [text[begin:] for text in found]


def completions(words: Sequence[str]) -> list[str]:
    """The candidates for the last word; a complete one ends with a blank."""
    *before, word = words
    if not before:
        return _matching([f"{name} " for name in (*COMMANDS, "--help", "--version")], word)
    command, *before = before
    if command not in COMMANDS:
        return []
    options = options_of(command)
    last = before[-1] if before else ""
    if last in options and (values := options[last]) is not None:
        return _matching([f"{value} " for value in values or _values_of_option(last)], word)
    if word.startswith("-"):
        return _matching([f"{option} " for option in options], word)
    if "=" in word and command in TAKE_OVERRIDES:
        return _values(word, before)
    found = _words_of_command(command, [w for w in before if not w.startswith("-")])
    if command in TAKE_OVERRIDES:
        found += _keys(word, before)
    return _matching(found, word)


def _matching(words: Iterable[str], begin: str) -> list[str]:
    return [word for word in dict.fromkeys(words) if word.startswith(begin)]


def options_of(command: str) -> dict[str, list[str] | None]:
    """The options of a command; with the values each accepts: an empty list for any, None for a flag.

    They are cached between calls: importing a command may take longer than a user waits for a completion.
    """
    file = Path(__file__).with_name(f"{command}.py")
    files = [*sorted(file.parent.glob(f"{command}*.py")), Path(cli.__file__)]  # options may have a separate file
    stamp = [str(file), *(path.stat().st_mtime_ns for path in files)]
    kept = kept_json("options") or {}
    if kept.get(command, {}).get("stamp") != stamp:
        options = {
            name: [str(choice) for choice in action.choices or ()] if action.nargs != 0 else None
            for action in cli.parser_for(command)._actions
            for name in action.option_strings
        }
        kept[command] = {"stamp": stamp, "options": options}
        keep_json("options", kept)
    return kept[command]["options"]


def _values_of_option(option: str) -> list[str]:
    from ..plugins import config_files

    group = {"--convention": "convention", "--published": "experiment"}.get(option)
    if group:
        return list(config_files.files(group))
    kind = option.removeprefix("--")
    return _names(kind) if kind in KINDS else []


def _words_of_command(command: str, before: Sequence[str]) -> list[str]:
    """Candidates other than overrides."""
    from ..plugins.config_files import GROUPS

    if command == "list":
        groups = [*KINDS, "experiment", "convention", "profile", "training", "preset"]
        if not before:
            return [f"{group}s " for group in groups]
        group = before[0].removesuffix("s")
        names = [n for kind in GROUPS for n in _names(kind)] if group == "preset" else _names(group)
        return [f"{name} " for name in names] if len(before) == 1 else []
    if command == "new" and not before:
        return [f"{kind} " for kind in KINDS]
    if command == "plot" and not before:
        from ..pictures.plots.kinds import KINDS as PLOTS

        return [f"{kind} " for kind in PLOTS]
    if command == "check":
        return [f"{name} " for kind in KINDS for name in _names(kind)]
    if command == "worst" and not before:
        return [f"{name} " for name in _names("method")]
    if command == "fetch":
        return [f"{name} " for name in _names("dataset")]
    if command == "completion" and not before:
        return [f"{shell} " for shell in SCRIPTS]
    return ["results="] if command in ("why", "reproduce") else []


def _names(group: str) -> list[str]:
    """The names in a group: plugins, presets and other files."""
    from ..plugins import config_files
    from ..plugins.listing import names_as_kept

    plugins = names_as_kept()["plugins"].get(group, []) if group in KINDS else []
    sets = ["full"] if group == "metric" else []
    return sorted({*(facts["name"] for facts in plugins), *config_files.files(group), *sets})


def _keys(word: str, before: Sequence[str]) -> list[str]:
    """Keys of a run, or, behind a dot, those below one: parameters of the chosen plugins."""
    from ..plugins.config_files import GROUPS

    head, dot, _ = word.partition(".")
    if not dot:
        nested = ("method.", "sensor.", "dataset.", "task.", "metric.", "training.", "limit.")
        keys = [key for key in fields_in("plan/keys.py", "Base") if key not in (*GROUPS, *PRIVATE, "limit")]
        return [*(f"{group}=" for group in GROUPS), *(f"{key}=" for key in keys), *nested, "hydra/launcher="]
    if head in ("limit", "training"):
        of = ("plan/limits.py", "Limits") if head == "limit" else ("plan/training.py", "TrainingKeys")
        return [f"{head}.{key}=" for key in fields_in(*of)]
    return [f"{key}=" for key in _parameters(head, before)]


def fields_in(module: str, cls: str) -> list[str]:
    """The fields of a dataclass of ours, from its source: importing it takes longer."""
    tree = ast.parse(Path(__file__).parents[1].joinpath(module).read_text(encoding="utf-8"))
    (found,) = (node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == cls)
    return [n.target.id for n in found.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]


def _parameters(kind: str, before: Sequence[str]) -> dict[str, Any]:
    """The parameters of the plugins of a kind in the words, with their facts: only those common to all."""
    from ..plugins.listing import names_as_kept

    if kind not in KINDS:
        return {}
    found = names_as_kept()
    plugins = {facts["name"]: facts["parameters"] for facts in found["plugins"][kind]}
    behind = {preset["name"]: preset["plugin"] for preset in found["presets"][kind]}
    said = [word.partition("=")[2] for word in before if word.startswith(f"{kind}=")]
    names = re.findall(r"\w+", said[-1] if said else _default(kind))
    behind |= {name: plugin for name in names if (plugin := _plugin_of_own(kind, name)) and name not in plugins}
    chosen = [behind.get(name, name) for name in names if behind.get(name, name) in plugins]
    if kind == "metric":
        return {f"metric.{name}.{key}": facts for name, keys in plugins.items() for key, facts in keys.items()}
    shared = set.intersection(*(set(plugins[name]) for name in chosen)) if chosen else set()
    return {f"{kind}.{key}": facts for key, facts in (plugins[chosen[0]].items() if chosen else ()) if key in shared}


def _plugin_of_own(kind: str, name: str) -> str:
    """The plugin named by a preset of the user; reading the file as YAML takes longer."""
    from ..plugins import config_files

    file = config_files.file_of(kind, name)
    found = re.search(r"^defaults:\s*(?:\[|-)\s*(\w+)", file.text(), re.MULTILINE) if file else None
    return found[1] if found and file and file.folder.origin != config_files.OURS else ""


def _default(kind: str) -> str:
    """The plugin that the main config chooses."""
    from ..plugins.config_files import our_folder

    text = Path(our_folder(), "config.yaml").read_text(encoding="utf-8")
    found = re.search(rf"^  - {kind}: (\w+)", text, re.MULTILINE)
    return found[1] if found else ""


def _values(word: str, before: Sequence[str]) -> list[str]:
    """Values for ``key=value``, of which a list or a sweep may have several: only the last one is completed."""
    from ..plugins.config_files import GROUPS

    key = word.partition("=")[0]
    begin = max(word.rfind(letter) + 1 for letter in "=,[")
    done = set(re.split(r"[=,\[]", word[:begin]))
    name = key.lstrip("+~")
    if name in GROUPS:
        values = _names(name)
    elif name in KEY_VALUES:
        values = list(KEY_VALUES[name])
    else:
        values = _parameters(name.partition(".")[0], before).get(name, {}).get("choices", [])
    end = "" if "[" in word else " "
    return _matching([f"{word[:begin]}{value}{end}" for value in values if value not in done], word)
