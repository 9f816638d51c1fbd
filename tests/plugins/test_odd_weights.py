"""Files of weights that are damaged, or none: refused in one short message, at once, and nothing is unpickled."""

from __future__ import annotations

import json
import os
import struct

import numpy as np
import pytest

from bench import BadInput
from bench.plugins.registry import registry
from bench.plugins.schema import defaults
from bench.plugins.weights import as_bytes, as_stored, check_fits, content, facts_of, load

READERS = (facts_of, load, content)


def file_of(header: object) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text


def refused(path, read) -> str:
    with pytest.raises(BadInput) as error:
        read(path)
    message = str(error.value)
    assert message.count(str(path)) == 1 and len(message) < len(str(path)) + 500, message
    return message


DAMAGED = {
    "empty": b"",
    "short": b"\1\0\0",
    "a header without end": b"\xff" * 8,
    "brackets": file_of(b"[" * 200_000),
    "no text": file_of(b"\xff\xfe\xff\xfe"),
    "a long number": file_of(b"9" * 5000),
    "a pickle": b"\x80\x04\x95\x0b\0\0\0\0\0\0\0\x8c\x07os.exec\x94.",
}


@pytest.mark.parametrize("data", DAMAGED.values(), ids=DAMAGED)
@pytest.mark.parametrize("read", READERS)
def test_damaged_files(tmp_path, data, read):
    path = tmp_path / "w.safetensors"
    path.write_bytes(data)
    refused(path, read)


@pytest.mark.parametrize(
    ("kind", "shape"), [("F32", [3]), ("BF16", [4]), ("F8_E4M3", [8])], ids=["another shape", "bfloat16", "float8"]
)
@pytest.mark.parametrize("read", [load, as_stored])
def test_arrays_that_are_not_what_the_header_says_or_of_types_that_numpy_lacks(tmp_path, kind, shape, read):
    path = tmp_path / "w.safetensors"
    path.write_bytes(file_of({"a": {"dtype": kind, "shape": shape, "data_offsets": [0, 8]}}) + bytes(8))
    assert "expected a safetensors file of numpy's types" in refused(path, read)


def test_metadata_that_is_no_json(tmp_path):
    path = tmp_path / "w.safetensors"
    for value in ("[" * 100_000, "x" * 1_000_000, "9" * 5000):
        path.write_bytes(file_of({"__metadata__": {"method": value}}))
        assert "its header is damaged" in refused(path, facts_of)


@pytest.mark.parametrize("read", READERS)
def test_pipes_and_devices(tmp_path, read):
    os.mkfifo(tmp_path / "pipe.safetensors")
    (tmp_path / "zero.safetensors").symlink_to("/dev/zero")
    (tmp_path / "folder.safetensors").mkdir()
    for name in ("pipe", "zero", "folder"):
        assert "is a folder, a pipe or a device" in refused(tmp_path / f"{name}.safetensors", read)
    refused(tmp_path / "gone.safetensors", read)


def test_a_long_name_of_a_method_is_not_quoted(tmp_path):
    plugin, path = registry().find("method", "mpu"), tmp_path / "w.safetensors"
    for facts in ({"method": "m" * 1_000_000}, {"method": "mpu", "parameters": {"levels": "x" * 1_000_000}}):
        path.write_bytes(as_bytes({"a": np.zeros(2)}, facts))
        refused(path, lambda path: check_fits(plugin, defaults(plugin), path))
