r"""Keys of BibTeX for methods, made from their declared citations: ``Kazhdan and Hoppe 2013`` -> ``kazhdan2013``."""

from __future__ import annotations

import re

from ...plugins.registry import registry

SMALL = ("after", "baseline", "with", "see", "and", "of")


def cited(plugin: str) -> str:
    r"""``\cite{kazhdan2013}``; empty for a method without a citation, or one not installed."""
    if plugin not in registry().names("method"):
        return ""
    return rf"\cite{{{found}}}" if (found := key_of(registry().find("method", plugin).cite)) else ""


def key_of(text: str) -> str:
    """The first author and the year, as ``kazhdan2013``; empty without a year.

    Example
    -------
    >>> key_of("after Jakab et al. 2021"), key_of("van Gelder 1994"), key_of("")
    ('jakab2021', 'gelder1994', '')
    """
    year = re.search(r"\b(?:19|20)\d\d\b", text)
    names = [word for word in re.findall(r"[A-Z][\w'-]+", text[: year.start()]) if year] if year else []
    names = [name for name in names if name.lower() not in SMALL]
    return re.sub(r"[^a-z0-9]", "", names[0].lower()) + year[0] if names and year else ""
