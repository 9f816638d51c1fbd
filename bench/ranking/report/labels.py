"""The label of a line of a table: the method, its parameters, and how it was run if that differs in the table."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any


def label(method: str, variant: str, setup: str = "") -> str:
    """``poisson (depth=9, trim=0.1)``, ``poisson (depth=9) · cuda, 2 threads``."""
    name = f"{method} ({', '.join(part.strip() for part in variant.split(','))})" if variant else method
    return with_setup(name, setup)


def with_setup(name: str, setup: str) -> str:
    """A method's name, and how it was run: ``idf_30 · cuda``."""
    return f"{name} · {setup}" if setup else name


def shown_setup(lines: Collection[Mapping[str, Any]]) -> tuple[str, ...]:
    """Which of device, threads and host belong to the labels of a table's lines.

    The device and the number of threads if the table has more than one; the host if one method, otherwise the
    same, was run on several machines and has a line for each.
    """
    shown = [name for name in ("device", "threads") if len({line[name] for line in lines}) > 1]
    scored = [tuple(line[name] for name in ("metric", "method", "variant", "threads", "device")) for line in lines]
    if len(set(scored)) < len(scored):
        shown.append("host")
    return tuple(shown)


def setup(line: Mapping[str, Any], shown: Iterable[str]) -> str:
    """``cuda, 2 threads, host name``: the parts of a line that are shown."""
    threads = f"{line['threads']} thread{'s' if line['threads'] != 1 else ''}"
    words = {"device": line["device"], "threads": threads, "host": f"host {line['host']}"}
    return ", ".join(words[name] for name in shown)


def hosts_note(lines: Iterable[Mapping[str, Any]], shown: Iterable[str]) -> list[str]:
    """A note if the results of a table are from several machines, and its labels do not show it."""
    hosts = sorted({name for line in lines for name in str(line["host"]).split(", ")})
    if len(hosts) < 2 or "host" in shown:
        return []
    return [f"run on {len(hosts)} machines ({', '.join(hosts)}): compare seconds and memory with care."]
