"""The flags of Hydra that ``detailbench run`` knows: they show a config, or Hydra itself, and run nothing."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import UsageError, did_you_mean
from ..plan.keys import GROUPS

OURS = ("-m", "--multirun", "--plugin", "--config-dir", "--no-leaderboard", "--help")
# Flags of other Hydra applications, and their replacement here.
_CONFIGS = "experiments and presets of your own are found in ./conf and in --config-dir DIR (DIR/experiment/NAME.yaml)"
OTHERWISE = {
    "--config-path": _CONFIGS,
    "-cp": _CONFIGS,
    "--config-name": _CONFIGS,
    "-cn": _CONFIGS,
    "-cd": _CONFIGS,
    "--shell-completion": "detailbench completion bash (or zsh, fish) prints a script",
    "-sc": "detailbench completion bash (or zsh, fish) prints a script",
    "--run": "leave it out; -m is for sweeps",
    "--experimental-rerun": "detailbench reproduce CELL runs a stored cell again",
}
SHOW = ("--cfg", "--info", "--hydra-help")  # these select what is shown, the others how
# The value of each: a choice, anything, or none.
VALUES: dict[str, tuple[str, ...] | None] = {
    "--cfg": ("job", "hydra", "all"),
    "--info": ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath"),
    "--hydra-help": (),
    "--resolve": (),
    "--package": None,
}


def split_words(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The overrides among the arguments of a command line, and the flags of Hydra, each with its value.

    File names in the overrides are quoted where Hydra needs it.

    Raises
    ------
    UsageError
        For any other flag, with the nearest right one, for an invalid value of a flag, and for flags that do not
        go together.
    """
    from .quoting import quoted_files

    overrides: list[str] = []
    flags: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        flag, equals, value = word.partition("=")
        if not word.startswith("-"):
            overrides.append(_without_plus(word))
            continue
        if flag in OTHERWISE:
            raise UsageError(f"unknown option {word!r}: {OTHERWISE[flag]}")
        if flag not in VALUES:
            raise UsageError(f"unknown option {word!r}. {did_you_mean(flag, (*OURS, *VALUES))}")
        if not equals and VALUES[flag] != () and rest and not rest[0].startswith("-") and "=" not in rest[0]:
            value = rest.pop(0)
        flags[flag] = value or ("all" if flag == "--info" else "")
        _check_value(flag, flags[flag])
    if flags and sum(flag in SHOW for flag in flags) != 1:
        raise UsageError(f"{' '.join(flags)}: expected one of {', '.join(SHOW)}, and with --cfg --resolve or --package")
    return quoted_files(overrides), flags


def only_overrides(words: Sequence[str], instead: str) -> list[str]:
    """The overrides of a command that has no flags of Hydra; ``instead`` is the advice in the message about one.

    Raises
    ------
    UsageError
        For a flag.
    """
    overrides, flags = split_words(words)
    for flag in flags:
        raise UsageError(f"{flag}: {instead}")
    return overrides


def _without_plus(word: str) -> str:
    """``experiment=demo`` for ``+experiment=demo``, as in other applications of Hydra: here no group needs it."""
    return word[1:] if word.startswith("+") and word[1:].partition("=")[0] in GROUPS else word


def _check_value(flag: str, value: str) -> None:
    choices = VALUES[flag]
    if choices is None:
        if not value:
            raise UsageError(f"{flag}: expected a value, for instance {flag} method")
    elif not choices:
        if value:
            raise UsageError(f"{flag}={value}: this flag takes no value")
    elif value not in choices:
        raise UsageError(f"{' '.join([flag, value]).strip()}: expected one of {', '.join(choices)}")
