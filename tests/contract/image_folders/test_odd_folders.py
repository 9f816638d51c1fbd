"""Folders of images that are damaged, or ask too much: refused in one short message, at once."""

from __future__ import annotations

import io
import json
import os
import struct
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from layouts import ball, write_blender, write_dtu

from bench import BadInput, UsageError
from bench.contract.image_folders.reading import read_views

VIEWS = ball(4, 16)
LONG = "x" * 1_000_000


def refused(path: Path, *says: str) -> None:
    with warnings.catch_warnings(), pytest.raises((BadInput, UsageError)) as error:
        warnings.simplefilter("error", RuntimeWarning)
        read_views(path)
    message = str(error.value)
    assert str(path if path.is_dir() else path.parent) in message and len(message) < 1500, message
    for part in says:
        assert part in message


def frames(**entry) -> str:
    return json.dumps({"frames": [entry]})


TEXTS = {
    "brackets in brackets": "[" * 200_000,
    "objects in objects": '{"a":' * 200_000,
    "no text": "\0",
    "a long number": "1" * 5000,
    "a long name": frames(file_path=LONG),
    "a long path": frames(file_path="x/" * 100_000),
    "a name with NUL": frames(file_path="a\0b"),
    "half a letter": '{"frames": [{"file_path": "\\ud800"}]}',
    "a long model": frames(camera_model=LONG, file_path="a"),
    "a huge whole number": frames(k4=10**400, file_path="a"),
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_transforms_that_are_damaged(tmp_path, text):
    (tmp_path / "transforms.json").write_text(text)
    refused(tmp_path / "transforms.json", "expected")


@pytest.mark.parametrize("value", [10**400, 1e308, -1e200, float("nan"), "x" * 10_000, [1], True])
@pytest.mark.parametrize("key", ["fl_x", "camera_angle_x", "w", "cx", "p2"])
def test_numbers_of_cameras_that_are_none(tmp_path, key, value):
    file = write_blender(VIEWS, tmp_path)
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))
    refused(file, f"{key}: expected a finite number")


@pytest.mark.parametrize("key", ["fl_x", "camera_angle_x"])
def test_a_focal_length_of_nothing(tmp_path, key):
    file = write_blender(VIEWS, tmp_path)
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: 1e-308}))
    refused(file, "expected fl_x above 0, or camera_angle_x between 0 and pi")


@pytest.mark.parametrize("value", [1e308, -1e200, float("inf")])
def test_matrices_without_bounds(tmp_path, value):
    file = write_blender(VIEWS, tmp_path)
    content = json.loads(file.read_text())
    content["frames"][0]["transform_matrix"][1][3] = value
    file.write_text(json.dumps(content))
    refused(file, "transform_matrix: has numbers that are NaN, or larger than 1e+15")


@pytest.mark.parametrize("name", ["world_mat_0", "scale_mat_0", "scale_mat_1"])
@pytest.mark.parametrize(
    "matrix", [np.full((4, 4), 1e308), np.full((4, 4), np.nan), np.array("x"), np.eye(4).astype("c16"), np.eye(3)]
)
def test_arrays_that_are_no_matrices(tmp_path, name, matrix):
    file = write_dtu(VIEWS, tmp_path)
    np.savez(file, **{**np.load(file), name: matrix})
    refused(file, name)


def test_names_of_arrays_that_are_no_numbers(tmp_path):
    file = write_dtu(VIEWS, tmp_path)
    arrays = dict(np.load(file))
    sound = read_views(file)[0]
    np.savez(file, **arrays, **{"world_mat_²": np.eye(4), f"world_mat_{'9' * 5000}": np.eye(4)})
    assert np.array_equal(read_views(file)[0].extrinsics, sound.extrinsics)


def header(shape: tuple[int, ...]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize(
    "member", [header((10**12, 10**3)), b"\x93NUMPY\x01\x00\x06\x00((((((", b"\x93NUMPY\x01\x00" + b"(" * 9000]
)
def test_damaged_arrays_of_an_npz(tmp_path, member):
    with zipfile.ZipFile(tmp_path / "cameras.npz", "w") as file:
        file.writestr("world_mat_0.npy", member)
    refused(tmp_path / "cameras.npz", "expected an .npz file")


@pytest.mark.parametrize("name", ["transforms.json", "views.npz", "cameras.txt", "x"])
def test_a_pipe(tmp_path, name):
    os.mkfifo(tmp_path / name)
    refused(tmp_path / name, "is a pipe or a device")


def test_a_pipe_and_a_bomb_among_the_images(tmp_path):
    file = write_blender(VIEWS, tmp_path)
    picture = tmp_path / "train" / "000.png"
    data = picture.read_bytes()
    for damaged in (b"", data[:40], data[:16] + struct.pack(">II", 100_000, 100_000) + data[24:]):
        picture.write_bytes(damaged)
        refused(file, "cannot be read as an image")
    picture.unlink()
    os.mkfifo(picture)
    refused(file, "there is no image")


@pytest.mark.parametrize(
    ("camera", "image"),
    [
        (LONG, ""),
        (f"1 {LONG} 1 1 1", ""),
        ("1 PINHOLE 16 16 10 10 8 1e308", ""),
        ("1 PINHOLE 16 16 10 10 8 8", f"1 1 0 0 0 0 0 5 1 {LONG}\n"),
        ("1 PINHOLE 16 16 10 10 8 8", f"1 1 0 0 0 0 0 5 {'9' * 300_000} a.png\n"),
    ],
)
def test_a_model_of_colmap_with_endless_words(tmp_path, camera, image):
    (tmp_path / "cameras.txt").write_text(f"{camera}\n")
    (tmp_path / "images.txt").write_text(image)
    refused(tmp_path / "cameras.txt", "line 1")
