"""Surfaces in GIFTI, the XML format of neuroimaging (gifti.projects.nitrc.org, version 1.0)."""

from __future__ import annotations

import base64
import binascii
import gzip
import zlib
from xml.etree import ElementTree

import numpy as np

from bench import BadInput

TYPES = {"NIFTI_TYPE_FLOAT32": "f4", "NIFTI_TYPE_INT32": "i4", "NIFTI_TYPE_FLOAT64": "f8"}
ORDERS = {"LittleEndian": "<", "BigEndian": ">"}


def read_surface(data: bytes, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) float64 and triangles (f, 3) int64 of a ``.gii`` or ``.gii.gz`` file.

    Parameters
    ----------
    data : bytes
        The content of a trusted file: the XML parser expands the entities that a file defines.
    name : str
        For messages.

    Raises
    ------
    BadInput
        If the file is damaged, holds no surface, or has an encoding other than base64 with zlib.
    """
    try:
        text = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        arrays = {array.get("Intent"): _array(array) for array in ElementTree.fromstring(text).iter("DataArray")}
        vertices, faces = arrays["NIFTI_INTENT_POINTSET"], arrays["NIFTI_INTENT_TRIANGLE"]
    except (OSError, EOFError, ElementTree.ParseError, KeyError, ValueError, zlib.error, binascii.Error) as error:
        what = f"{type(error).__name__}: {error}"
        raise BadInput(f"{name}: cannot be read as a GIFTI surface ({what}); fetch it again") from None
    if faces.min(initial=0) < 0 or faces.max(initial=-1) >= len(vertices):
        raise BadInput(f"{name}: faces refer to vertices that do not exist; fetch it again")
    return vertices.astype(np.float64), faces.astype(np.int64)


def _array(array: ElementTree.Element) -> np.ndarray:
    """One table of the file."""
    if array.get("Encoding") != "GZipBase64Binary" or array.get("ArrayIndexingOrder") != "RowMajorOrder":
        raise ValueError(f"encoding {array.get('Encoding')}, {array.get('ArrayIndexingOrder')}")
    kind = ORDERS[array.get("Endian", "")] + TYPES[array.get("DataType", "")]
    shape = [int(array.get(f"Dim{i}", "")) for i in range(int(array.get("Dimensionality", "")))]
    content = zlib.decompress(base64.b64decode(array.findtext("Data", ""), validate=False))
    return np.frombuffer(content, kind).reshape(shape)
