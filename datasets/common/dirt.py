"""Defects of real-world meshes, added to a clean mesh without moving its surface.

Every kind of defect keeps the set of points that the faces cover, to the last digit except at the middles of edges. So
the truth stays known, and distance scores must not change.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

Kind = Literal["unreferenced", "duplicates", "t_junctions", "flipped", "unwelded", "degenerate"]
KINDS: tuple[Kind, ...] = ("unreferenced", "duplicates", "t_junctions", "flipped", "unwelded", "degenerate")
FAR = 10.0  # half the size of the box in which unreferenced vertices lie, in boxes of the mesh
PATCHES = 2  # of faces that are doubled, flipped or cut loose
PATCHED = ("duplicates", "flipped", "unwelded")


class Dirt(NamedTuple):
    """The description of a dirty mesh, valid for every mesh with the same faces."""

    parents: np.ndarray  # (v, 2): each vertex is the mean of two clean ones; the first are the clean ones themselves
    stray: np.ndarray  # (v, 3): its offset from there, in boxes of the mesh
    faces: np.ndarray  # (f, 3)
    origin: np.ndarray  # (f,): the clean face that each comes from

    def vertices(self, clean: np.ndarray) -> np.ndarray:
        """The vertices (v, 3) of the dirty mesh, from those of the clean one."""
        return self.of_vertices(clean) + self.stray * np.linalg.norm(np.ptp(clean, axis=0))

    def of_vertices(self, values: np.ndarray) -> np.ndarray:
        """Values at the vertices, from those at the clean vertices; of two labels the first."""
        if values.dtype.kind != "f":
            return values[self.parents[:, 0]]
        return (values[self.parents[:, 0]] + values[self.parents[:, 1]]) / 2

    def spread(self, values: np.ndarray, vertices: int, faces: int) -> np.ndarray:
        """An attribute for the dirty mesh, from that of the clean one; ``vertices`` and ``faces`` are its counts."""
        if len(values) == vertices:
            return self.of_vertices(values)
        return values[self.origin] if len(values) == faces else values


def make_dirt(
    vertices: np.ndarray, faces: np.ndarray, kinds: tuple[str, ...], share: float, rng: np.random.Generator
) -> Dirt:
    """Defects of each of ``kinds``.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    kinds : of :data:`KINDS`
    share : float
        For each kind that affects patches of faces, the share of the area; for the others, of the faces or vertices,
        at least one. A mesh gets no patches if all its faces are larger than a patch.
    rng : numpy Generator
        Each kind has its own stream, so its draws do not depend on the others.
    """
    streams = dict(zip(KINDS, rng.spawn(len(KINDS)), strict=True))
    dirt = Dirt(np.repeat(np.arange(len(vertices))[:, None], 2, axis=1), np.zeros((len(vertices), 3)),
                np.asarray(faces, dtype=np.int64), np.arange(len(faces)))  # fmt: skip
    areas = np.linalg.norm(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1)
    for kind in ("t_junctions", "unwelded", "flipped", "duplicates", "degenerate", "unreferenced"):
        if kind not in kinds:
            continue
        count = max(1, round(share * len(faces)))
        if kind in PATCHED:
            patches = [_patch(faces, areas, share / PATCHES, streams[kind]) for _ in range(PATCHES)]
            dirt = {"duplicates": _doubled, "flipped": _flipped, "unwelded": _unwelded}[kind](dirt, patches)
        elif kind == "t_junctions":
            dirt = _t_junctions(dirt, vertices, count, streams[kind])
        elif kind == "degenerate":
            rows = streams[kind].integers(len(faces), size=count)
            dirt = _more(dirt, faces[rows][:, [0, 1, 0]], rows)
        else:
            dirt = _unreferenced(dirt, max(1, round(share * len(vertices))), streams[kind])
    return dirt


def _patch(faces: np.ndarray, areas: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Faces (k,) around a random one that cover a share of the area."""
    small = np.flatnonzero((areas > 0) & (areas <= share * areas.sum()))
    if not len(small):
        return small
    chosen = np.zeros(len(faces), dtype=bool)
    chosen[rng.choice(small)] = True
    while True:
        near = np.zeros(faces.max() + 1, dtype=bool)
        near[faces[chosen]] = True
        ring = np.flatnonzero(near[faces].any(axis=1) & ~chosen)
        fits = ring[np.cumsum(areas[ring]) <= share * areas.sum() - areas[chosen].sum()]
        if not len(fits):
            return np.flatnonzero(chosen)
        chosen[fits] = True


def _more(dirt: Dirt, faces: np.ndarray, origin: np.ndarray) -> Dirt:
    return dirt._replace(faces=np.concatenate([dirt.faces, faces]), origin=np.concatenate([dirt.origin, origin]))


def _copied(dirt: Dirt, used: np.ndarray) -> tuple[Dirt, np.ndarray]:
    """Copies of the vertices ``used``, and the index (v,) of each vertex's copy."""
    number = np.zeros(len(dirt.parents), dtype=np.int64)
    number[used] = len(dirt.parents) + np.arange(len(used))
    parents, stray = (np.concatenate([array, array[used]]) for array in (dirt.parents, dirt.stray))
    return dirt._replace(parents=parents, stray=stray), number


def _flipped(dirt: Dirt, patches: list[np.ndarray]) -> Dirt:
    """Patches whose faces are wound the other way."""
    rows = np.isin(dirt.origin, np.concatenate(patches))
    return dirt._replace(faces=np.where(rows[:, None], dirt.faces[:, ::-1], dirt.faces))


def _unwelded(dirt: Dirt, patches: list[np.ndarray]) -> Dirt:
    """Patches with their own vertices: cracks of zero width around them."""
    for patch in patches:
        rows = np.isin(dirt.origin, patch)
        dirt, number = _copied(dirt, np.unique(dirt.faces[rows]))
        dirt = dirt._replace(faces=np.where(rows[:, None], number[dirt.faces], dirt.faces))
    return dirt


def _doubled(dirt: Dirt, patches: list[np.ndarray]) -> Dirt:
    """Patches whose faces occur twice: in turn on the same vertices, and flipped on their own vertices."""
    for k, patch in enumerate(patches):
        rows = np.flatnonzero(np.isin(dirt.origin, patch))
        faces, origin = dirt.faces[rows], dirt.origin[rows]
        if k % 2:
            dirt, number = _copied(dirt, np.unique(faces))
            faces = number[faces][:, ::-1]
        dirt = _more(dirt, faces, origin)
    return dirt


def _t_junctions(dirt: Dirt, vertices: np.ndarray, count: int, rng: np.random.Generator) -> Dirt:
    """Faces that are divided at the middle of their longest edge, while the neighbour across it is not."""
    rows = rng.permutation(len(dirt.faces))[:count]
    corners = vertices[dirt.faces[rows]]
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).argmax(axis=1)
    a, b, c = (dirt.faces[rows, (longest + k) % 3] for k in range(3))
    # Of the two faces at an edge, only one is divided.
    _, first = np.unique(np.sort(np.stack([a, b]), axis=0), axis=1, return_index=True)
    rows, a, b, c = rows[first], a[first], b[first], c[first]
    middle = len(dirt.parents) + np.arange(len(rows))
    faces = dirt.faces.copy()
    faces[rows] = np.stack([a, middle, c], axis=1)
    dirt = dirt._replace(
        parents=np.concatenate([dirt.parents, np.stack([a, b], axis=1)]),
        stray=np.concatenate([dirt.stray, np.zeros((len(rows), 3))]),
        faces=faces,
    )
    return _more(dirt, np.stack([middle, b, c], axis=1), dirt.origin[rows])


def _unreferenced(dirt: Dirt, count: int, rng: np.random.Generator) -> Dirt:
    """Vertices that no face uses, anywhere around the mesh."""
    one = rng.integers(dirt.parents.max() + 1, size=count)
    stray = rng.uniform(-FAR, FAR, size=(count, 3))
    return dirt._replace(
        parents=np.concatenate([dirt.parents, np.stack([one, one], axis=1)]), stray=np.concatenate([dirt.stray, stray])
    )
