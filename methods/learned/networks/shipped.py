"""The shipped sphere that a method reads, found without torch: results depend on the content of that file."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "spheres"


def sphere_file(omega: float, hidden_layers: int, width: int, radius: float) -> Path:
    """The path of the sphere of a sine network of this form, if it is shipped; :mod:`.sphere` writes it."""
    return FOLDER / f"omega{omega:g}-layers{hidden_layers}-width{width}-radius{radius:g}.safetensors"


def spheres_read(omega: float, hidden_layers: int, width: int, radius: float) -> tuple[Path, ...]:
    """That file, if it exists; none for a radius of 0, or for a form that is made when it is first needed."""
    file = sphere_file(omega, hidden_layers, width, radius)
    return (file,) if radius and file.is_file() else ()
