"""The files that ``detailbench new`` writes: templates with the names filled in."""

from __future__ import annotations

import ast
import re
from importlib.resources import files

from ..errors import UsageError

# Kind of plugin -> how a first run chooses one; each kind has a template of that name.
FIRST_RUNS = {
    "method": "task=denoise method=my_plugin dataset=bumps",
    "dataset": "dataset=my_plugin method=poisson",
    "sensor": "sensor=my_plugin method=poisson",
    "metric": "metric=[standard,my_plugin] method=poisson",
    "task": "task=my_plugin method=my_plugin_baseline dataset=bumps",
}


def template(name: str) -> str:
    """The text of the template ``name``: a kind of plugin, or ``test``."""
    return files(__package__).joinpath("templates", f"{name}.py").read_text(encoding="utf-8")


def plugin_and_test(kind: str, name: str) -> tuple[str, str]:
    """The texts of a new plugin and of its test.

    Parameters
    ----------
    kind : a key of :data:`FIRST_RUNS`
    name : str
        The plugin's name in snake case; its class has the same in camel case.

    Raises
    ------
    UsageError
        If the class would have the name of one that the template imports.
    """
    text = template(kind)
    imported = {
        alias.name for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    if class_name(name) in imported:
        raise UsageError(
            f"{name!r}: a {kind} of this name would have the class {class_name(name)}, a name that its file imports; "
            "choose another name"
        )
    return fill_in(text, name), fill_in(template("test"), name)


def first_run(kind: str, name: str) -> str:
    """The overrides of a first run with a new plugin."""
    return fill_in(FIRST_RUNS[kind], name)


def fill_in(text: str, name: str) -> str:
    """``text`` with a plugin's name in place of ``my_plugin``, and that of its class in place of ``MyPlugin``."""
    names = {"my_plugin": name, "MyPlugin": class_name(name)}
    return re.sub("my_plugin|MyPlugin", lambda found: names[found.group()], text)


def class_name(name: str) -> str:
    """``my_method`` -> ``MyMethod``."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))
