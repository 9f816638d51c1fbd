"""One file that holds everything: the data, the script, the style and the shapes."""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from .encoding import script_json


@cache
def built(name: str) -> str:
    """A file of the bundle that `bench/pages/web/build.mjs` makes."""
    return (resources.files(__package__) / "built" / name).read_text(encoding="utf-8")


def policy(script: str, *, may_load: bool = False) -> str:
    """The page's content security policy: this script only, no address except the page's own data.

    With ``may_load``, scripts added by this one run too; those in the text of the page do not.
    """
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    loads = " 'strict-dynamic'" if may_load else ""
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'{loads} 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
        "img-src data: blob:; worker-src blob:; connect-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def one_file(data: Mapping[str, Any], geometry: Mapping[str, bytes] | None = None) -> str:
    """The page as one file of HTML.

    Parameters
    ----------
    data : mapping
        Of :func:`bench.pages.data.page_data`.
    geometry : mapping of str to bytes, optional
        The shapes that the scenes of ``data`` name.
    """
    script = built("page.js")
    shapes = "".join(
        f'<script type="text/plain" id="geometry-{html.escape(name, quote=True)}">{encoded(content)}</script>\n'
        for name, content in (geometry or {}).items()
    )
    return (
        f"{head(str(data['title']), policy(script))}"
        f"<style>{built('page.css')}</style>\n</head>\n<body>\n{NO_SCRIPT}"
        f'<script type="application/json" id="detailbench-data">{script_json(data)}</script>\n'
        f"{shapes}"
        f'<script type="text/plain" id="detailbench-licences">{html.escape(built("LICENCES.txt"), quote=False)}'
        f"</script>\n<script>{script}</script>\n</body>\n</html>\n"
    )


NO_SCRIPT = "<noscript>This page shows its tables by a script, which this browser does not run.</noscript>\n"


def head(title: str, rule: str) -> str:
    """The beginning of a page, up to its styles."""
    meta = f'<meta http-equiv="Content-Security-Policy" content="{html.escape(rule)}">\n' if rule else ""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'{meta}<title>{html.escape(title)}</title>\n<link rel="icon" href="data:,">\n'
    )


def encoded(content: bytes) -> str:
    """Base64."""
    return base64.b64encode(content).decode("ascii")
