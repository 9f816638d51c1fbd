"""Score an output file against its reference file.

  detailbench score output.ply reference.ply
  detailbench score clean.xyz scan.ply --metric p2f_mean,chamfer_l1_mean
  detailbench score output.ply reference.ply --convention mpu
  detailbench score output.ply reference.ply --units file
  detailbench score output.ply reference.ply --save errors.ply --limit 0.5
  detailbench score mvs024.ply stl024_total.ply --convention dtu_mm --mask ObsMask24_10.mat --plane Plane24.mat
  detailbench score deformed.obj target.obj --source rest.obj --metric cot_laplacian

OUTPUT and REFERENCE are meshes or point clouds (PLY, OBJ, STL, OFF, GLB, XYZ, ...) in the same coordinates. Both are
scaled to the frame of the reference, whose bounding box is centred at the origin and whose farthest vertex is at radius
1; the output is not normalised by itself. A reference that is a cloud is used as it is: metrics that need a surface are
left out.

--metric takes names from `detailbench list metrics` and sets of them (standard, full); --convention takes a paper's
columns.
The floor is the score of a perfect output: the reference itself, or a fresh sample of it as large as the output.
--units file prints lengths in the units of the files, millimetres say, and squares of lengths in their squares.

--save FILE.ply writes the output with the distance of each vertex, or point, to the reference: as the property
`distance`, in the units of the files, and as colours from light (0) to dark (--limit and beyond; by default 98 % of the
surface is below it). MeshLab and CloudCompare open it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument
from ..errors import DetailbenchError, MissingLibrary, UsageError, did_you_mean
from ..geometry.extents import unlike
from ..notices import collected
from ..plan.choice import Choice
from ..plugins.metric_sets import metric_set
from ..plugins.registry import load_plugins, registry
from ..ranking.conventions import Convention, load_convention
from ..ranking.report.score_table import Score, score_table, words

if TYPE_CHECKING:
    import numpy as np
    from trimesh import Trimesh

    from ..contract.case import Case
    from ..geometry.cloud import PointCloud

DEFAULT = "standard"
UNITS = ("radius", "file")  # of the reference's bounding sphere, or those of the files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("output", metavar="OUTPUT", help="the file to score")
    parser.add_argument("reference", metavar="REFERENCE", help="the truth")
    parser.add_argument("--metric", metavar="NAMES", help=f"metrics or sets of them, with commas (default: {DEFAULT})")
    parser.add_argument("--convention", metavar="NAME", help="print the columns of a paper in its units")
    parser.add_argument("--source", metavar="FILE", help="the mesh that OUTPUT was deformed from, for cot_laplacian")
    parser.add_argument("--units", choices=UNITS, default="radius", help="of lengths (default: radius)")
    parser.add_argument("--mask", metavar="FILE", help="observation mask of DTU, for dtu_distances")
    parser.add_argument("--plane", metavar="FILE", help="ground plane of DTU, for dtu_distances")
    parser.add_argument("--seed", type=int, default=0, help="of the samples (default: 0)")
    parser.add_argument("--samples", type=int, help="points drawn from each surface (default: 100,000)")
    parser.add_argument("--save", metavar="FILE.ply", help="write OUTPUT with its distances to REFERENCE, coloured")
    parser.add_argument("--limit", type=float, help="of the colours of --save, in the units of the files")
    parser.add_argument("--json", action="store_true", help="print JSON, in full precision")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Read, score, print."""
    load_plugins(args.plugin)
    _check_save(args)
    if args.samples is not None and args.samples < 1:
        raise UsageError(f"--samples {args.samples}: expected at least 1")
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed}: expected at least 0")
    if args.metric and args.convention:
        raise UsageError(f"--metric {args.metric}: the convention {args.convention} says which metrics it needs")
    if args.units != "radius" and args.convention:
        raise UsageError(f"--units {args.units}: the convention {args.convention} says which units its columns have")
    convention = load_convention(args.convention) if args.convention else None
    chosen = _of_convention(convention) if convention else _of_names(args.metric or DEFAULT)
    with collected() as notices:
        seen = _observed(args.mask, args.plane)
        case, output = read(
            args.output, args.reference, seed=args.seed, samples=args.samples, source=args.source, attributes=seen
        )
    _show(notices)
    if hint := unlike(_points(output), args.output, _points(case.reference.mesh), args.reference):
        print(f"warning: {hint}", file=sys.stderr)
    with collected() as said:
        scores, left_out = score(case, output, chosen)
    _show(said)
    if convention:
        scores = in_convention(convention, scores)
    in_files = all(choice.plugin.options.get("length") == "file" for choice in chosen)
    if args.units == "file":
        scores = in_units_of_files(scores, case.frame.radius)
    errors = save(args, case, output) if args.save else None
    if args.json:
        print(json.dumps(as_json(args, case, scores, left_out) | ({"errors": errors} if errors else {}), indent=2))
    else:
        print(f"{args.output} ({words(output)}) against {args.reference} ({words(case.reference.mesh)})\n")
        print(
            score_table(
                scores,
                case,
                case.compare(output).samples,
                left_out,
                convention,
                units="file" if in_files else args.units,
            )
        )
        if errors:
            print(_scale(errors))
    return 0


# -- what to score with ------------------------------------------------------------------------------------------------


def _of_names(names: str) -> list[Choice]:
    """The metrics of a list of names; ``standard`` and ``full`` stand for the metrics in them."""
    wanted: list[str] = []
    for name in filter(None, map(str.strip, names.split(","))):
        wanted.extend(metric_set(name) or [name])
    if not wanted:
        raise UsageError(f"--metric {names!r}: expected a name. {did_you_mean('', registry().names('metric'))}")
    return [Choice.of("metric", {"_name_": name}) for name in dict.fromkeys(wanted)]


def _of_convention(convention: Convention) -> list[Choice]:
    return [Choice.of("metric", {"_name_": name}) for name in convention.metrics]


# -- files -------------------------------------------------------------------------------------------------------------


def read(
    output: str,
    reference: str,
    *,
    seed: int = 0,
    samples: int | None = None,
    source: str | None = None,
    attributes: dict[str, np.ndarray] | None = None,
) -> tuple[Case, PointCloud | Trimesh]:
    """The case that two files make, and the output in its frame."""
    from ..contract.case import Case
    from ..contract.shape import Shape
    from ..geometry.comparison import set_samples
    from ..geometry.io.files import load_mesh

    truth, result = load(reference), load(output)
    shape, frame = Shape(reference, truth, attributes=attributes).framed()
    inputs = {"source": _moved(load_mesh(source), frame)} if source else {}
    case = Case(Path(reference).stem, inputs, shape, frame, seed)
    if samples:
        set_samples(case, samples)
    return case, _moved(result, frame)


def _observed(mask: str | None, plane: str | None) -> dict[str, np.ndarray]:
    """A DTU mask and a ground plane from their files, as attributes of the reference."""
    from ..geometry.io.dtu import load_mask, load_plane

    return (load_mask(mask) if mask else {}) | (load_plane(plane) if plane else {})


def load(path: str) -> PointCloud | Trimesh:
    """A file as a mesh if it has faces, otherwise as a point cloud.

    Raises
    ------
    BadInput
        Naming the file and what was expected of it.
    """
    from ..geometry.io.files import load_geometry

    return load_geometry(path)


def _show(notices: list[str]) -> None:
    for text in notices:
        print(f"note: {text}", file=sys.stderr)


def _points(geometry: PointCloud | Trimesh) -> np.ndarray:
    from ..geometry.cloud import PointCloud
    from ..geometry.used import used_vertices

    return geometry.points if isinstance(geometry, PointCloud) else used_vertices(geometry)


def _moved(geometry: PointCloud | Trimesh, frame: Any) -> PointCloud | Trimesh:
    from trimesh import Trimesh

    from ..geometry.cloud import PointCloud

    if isinstance(geometry, PointCloud):
        return PointCloud(frame.apply(geometry.points), geometry.normals)
    return Trimesh(frame.apply(geometry.vertices), geometry.faces, process=False)


# -- scoring -----------------------------------------------------------------------------------------------------------


def score(case: Case, output: PointCloud | Trimesh, metrics: list[Choice]) -> tuple[dict[str, Score], dict[str, str]]:
    """Every score that can be computed, and why the other metrics have none."""
    from ..engine import call

    kind = "mesh" if hasattr(output, "faces") else "cloud"
    scores: dict[str, Score] = {}
    left_out: dict[str, str] = {}
    for choice in metrics:
        plugin = choice.plugin
        if kind not in plugin.options.get("outputs", ("mesh", "cloud")):
            left_out[choice.name] = f"does not score a {kind}"
            continue
        try:
            plugin.require()
            found = call.score([choice], output, case)
        except MissingLibrary as error:
            left_out[choice.name] = str(error)
            continue
        if not found.values:
            left_out[choice.name] = found.left_out[choice.name] or "does not apply to these two"
        for key, value in found.values.items():
            scores[key] = Score(value, found.floors.get(key), found.directions[key], plugin.length(key))
    if not scores:
        raise DetailbenchError("; ".join(f"{name} {reason}" for name, reason in left_out.items()))
    return scores, left_out


def in_units_of_files(scores: dict[str, Score], radius: float) -> dict[str, Score]:
    """Lengths, and their powers, in the units of the files; ``radius``: of the reference, in these units."""
    return {
        key: s._replace(value=s.value * radius**s.length, floor=None if s.floor is None else s.floor * radius**s.length)
        for key, s in scores.items()
    }


def in_convention(convention: Convention, scores: dict[str, Score]) -> dict[str, Score]:
    """The columns of a convention, in its units."""
    shown = {}
    convention.scores(scores)
    for column in convention.columns:
        if column.score in scores:
            value, floor, better, _ = scores[column.score]
            floor = None if floor is None else floor * column.factor
            shown[column.title] = Score(value * column.factor, floor, better)
    return shown


# -- errors as a file --------------------------------------------------------------------------------------------------


def _check_save(args: argparse.Namespace) -> None:
    from ..pictures.error_file import check_error_file

    if args.limit is not None and not args.save:
        raise UsageError(f"--limit {args.limit:g}: is of the colours of --save FILE.ply, which is not given")
    if args.limit is not None and not (args.limit > 0 and math.isfinite(args.limit)):
        raise UsageError(f"--limit {args.limit:g}: expected a distance above 0, in the units of the files")
    if args.save:
        check_error_file(args.save)
        if any(Path(args.save).resolve() == Path(path).resolve() for path in (args.output, args.reference)):
            raise UsageError(f"--save {args.save}: is a file that is scored; expected another name")


def save(args: argparse.Namespace, case: Case, output: PointCloud | Trimesh) -> dict[str, Any]:
    """Write the output in its file's coordinates, with distances to the reference; return what the colours mean."""
    from ..pictures.error_file import save_errors
    from ..pictures.errors import common_limit, distances, weights

    truth = case.reference
    found = distances(output, truth.mesh if truth.cloud is None else truth.cloud) * case.frame.radius
    share = weights(output)
    limit = args.limit if args.limit is not None else common_limit([(found, share)])
    save_errors(load(args.output), found, limit, args.save)
    return {
        "file": args.save,
        "count": len(found),
        "limit": limit,
        "beyond": float(share[found > limit].sum()),
        "largest": float(found.max(initial=0)),
    }


def _scale(errors: dict[str, Any]) -> str:
    """What the colours of the file mean."""
    what = f"\n{errors['file']}: {errors['count']:,} distances to the reference, in the units of the files.\n"
    if not errors["limit"]:
        return f"{what}All are 0, so there is one colour."
    return (
        f"{what}Colours: light is 0, dark is {errors['limit']:.3g} (--limit) and beyond, where "
        f"{100 * errors['beyond']:.2g} % of the output are. The largest distance is {errors['largest']:.3g}."
    )


# -- printing ----------------------------------------------------------------------------------------------------------


def as_json(args: argparse.Namespace, case: Case, scores: dict[str, Score], left_out: dict[str, str]) -> dict[str, Any]:
    """All results as plain values; numbers that are not finite, which JSON lacks, as text."""
    return {
        "output": args.output,
        "reference": args.reference,
        "convention": args.convention,
        "units": args.units,
        "seed": args.seed,
        "frame": {"center": list(case.frame.center), "radius": case.frame.radius},
        "scores": {key: _finite(s.value) for key, s in scores.items()},
        "floors": {key: _finite(s.floor) for key, s in scores.items() if s.floor is not None},
        "better": {key: s.better for key, s in scores.items()},
        "left_out": left_out,
    }


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)
