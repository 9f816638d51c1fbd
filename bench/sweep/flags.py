"""The flags of Hydra that ``detailbench run`` knows: they show a config, or Hydra itself, and run nothing."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import UsageError, did_you_mean
from .quoting import quoted_files

OURS = ("-m", "--multirun", "--plugin", "--no-leaderboard", "--help")
SHOW = ("--cfg", "--info", "--hydra-help")  # what is shown; the other flags say how
# What may stand behind each: a choice, anything, or nothing.
VALUES: dict[str, tuple[str, ...] | None] = {
    "--cfg": ("job", "hydra", "all"),
    "--info": ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath"),
    "--hydra-help": (),
    "--resolve": (),
    "--package": None,
}


def split_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The overrides among the words of a command line, and the flags that Hydra knows, with their values.

    Names of files among the overrides are quoted where Hydra needs it.

    Raises
    ------
    UsageError
        For any other flag, with the nearest right one, for a value that a flag cannot have, and for flags that do not
        go together.
    """
    overrides, flags = [], {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        flag, equals, value = word.partition("=")
        if not word.startswith("-"):
            overrides.append(word)
            continue
        if flag not in VALUES:
            raise UsageError(f"unknown option {word!r}. {did_you_mean(flag, (*OURS, *VALUES))}")
        if not equals and VALUES[flag] != () and rest and not rest[0].startswith("-") and "=" not in rest[0]:
            value = rest.pop(0)
        flags[flag] = value or ("all" if flag == "--info" else "")
        _check_value(flag, flags[flag])
    if flags and sum(flag in SHOW for flag in flags) != 1:
        raise UsageError(f"{' '.join(flags)}: expected one of {', '.join(SHOW)}, and with --cfg --resolve or --package")
    return quoted_files(overrides), [part for flag, value in flags.items() for part in (flag, value) if part]


def _check_value(flag: str, value: str) -> None:
    choices = VALUES[flag]
    if choices is None:
        if not value:
            raise UsageError(f"{flag}: expected a value, for instance {flag} method")
    elif not choices:
        if value:
            raise UsageError(f"{flag}={value}: this flag has no value")
    elif value not in choices:
        raise UsageError(f"{' '.join([flag, value]).strip()}: expected one of {', '.join(choices)}")
