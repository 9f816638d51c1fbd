"""Folders of images with cameras in the layouts of other programs come back as the views they were written from."""

import json

import numpy as np
import pytest
from layouts import CENTER, RADIUS, ball, opengl, pictures, write_blender, write_colmap, write_dtu
from PIL import Image

from bench import BadInput, Frame, PointCloud, UsageError
from bench.contract.image_folders.reading import read_views
from bench.contract.image_folders.writing import save_views_as_transforms
from bench.contract.views_file import load_views, save_views
from bench.notices import collected
from bench.tasks.multiview import Multiview

BALL = ball()


def in_world(views, frame):
    """The cameras of views back in the coordinates of the files."""
    return views.in_frame(Frame(tuple(-np.array(frame.center) / frame.radius), 1 / frame.radius))


def assert_same(views, frame, expected, pixels=True):
    found = in_world(views, frame)
    np.testing.assert_allclose(found.extrinsics, expected.extrinsics, atol=1e-6)
    np.testing.assert_allclose(found.intrinsics, expected.intrinsics, atol=1e-6)
    if pixels:
        np.testing.assert_array_equal(found.images, expected.images)
        np.testing.assert_array_equal(found.masks, expected.masks)


def write_ours(views, folder):
    save_views_as_transforms(views, folder)
    return folder / "transforms.json"


@pytest.mark.parametrize("write", [write_ours, write_blender, write_dtu, write_colmap])
def test_every_layout_comes_back(tmp_path, write):
    file = write(BALL, tmp_path)
    for path in (tmp_path, file):
        assert_same(*read_views(path), BALL)


@pytest.mark.parametrize("write", [write_ours, write_blender, write_colmap])
def test_the_estimated_ball_holds_the_shape(tmp_path, write):
    write(ball(24, 96), tmp_path)
    views, frame = read_views(tmp_path)
    offset = np.linalg.norm(np.array(frame.center) - CENTER)
    assert offset + RADIUS <= frame.radius < 1.15 * RADIUS
    assert views.project(np.zeros((1, 3)))[1].min() > 0


def test_the_ball_of_scale_mat_is_taken(tmp_path):
    write_dtu(BALL, tmp_path)
    frame = read_views(tmp_path)[1]
    assert frame.radius == pytest.approx(1.2 * RADIUS) and frame.center == pytest.approx(CENTER)
    (tmp_path / "other").mkdir()
    write_dtu(BALL, tmp_path / "other", scale=False)
    frame = read_views(tmp_path / "other")[1]
    assert frame.radius < 1.25 * RADIUS and np.linalg.norm(np.array(frame.center) - CENTER) < 0.1 * RADIUS


def test_the_task_reads_a_folder_and_brings_the_output_back(tmp_path):
    write_colmap(ball(12, 96), tmp_path)
    task = Multiview(max_pixels=48)
    input, frame = task.read([str(tmp_path)])
    views = input["views"]
    assert (views.width, views.height) == (48, 48)
    # The middle of a mask, lifted to the depth of the centre, is the centre in the coordinates of the files.
    row, column = np.argwhere(views.masks[3]).mean(axis=0) + 0.5
    depth = views.project(frame.apply(CENTER[None]))[1][3, 0]
    middle = views.unproject(3, np.array([column, row]), depth)
    np.testing.assert_allclose(task.restore(PointCloud(middle[None]), frame).points[0], CENTER, atol=0.05 * RADIUS)


def test_values_of_a_frame_go_before_those_of_all(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    file = tmp_path / "transforms.json"
    content = json.loads(file.read_text())
    content |= {"fl_x": 1.0, "fl_y": 2.0, "cx": 3.0, "camera_angle_x": 0.1}
    file.write_text(json.dumps(content))
    assert_same(*read_views(tmp_path), BALL)


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("masks", "{stem}.png"),
        ("mask", "{stem}.png"),
        ("masks", "{stem}.png.png"),
        ("mask", "{stem}.PNG"),
        ("masks", "{stem}.png.mask"),
        ("images", "{stem}_mask.png"),
    ],
)
def test_masks_are_found_by_name(tmp_path, folder, name):
    save_views_as_transforms(BALL, tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for frame in content["frames"]:
        del frame["mask_path"]
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    (tmp_path / "masks").rename(tmp_path / "old")
    (tmp_path / folder).mkdir(exist_ok=True)
    for file in (tmp_path / "old").iterdir():
        mask = Image.fromarray(np.asarray(Image.open(file)).astype(np.uint8))  # 0 and 1, as labels are stored
        mask.save(tmp_path / folder / name.format(stem=file.stem), format="png")
    assert_same(*read_views(tmp_path), BALL)


def test_a_smaller_copy_of_the_images_has_the_same_cameras(tmp_path):
    """nerfstudio keeps w and h of the large images where small copies are named; half of them are of half the size."""
    save_views_as_transforms(BALL, tmp_path)
    for place in range(5):
        for folder in ("images", "masks"):
            path = tmp_path / folder / f"{place:03d}.png"
            Image.open(path).convert("L" if folder == "masks" else "RGB").resize((32, 32)).save(path)
    views, frame = read_views(tmp_path)
    assert_same(views, frame, BALL, pixels=False)
    assert (views.masks != BALL.masks).mean() < 0.03
    np.testing.assert_array_equal(views.masks[5:], BALL.masks[5:])


def test_black_masks_are_left_out_and_reported(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    Image.new("L", (64, 64)).save(tmp_path / "masks/004.png")
    with collected() as notices:
        views, _ = read_views(tmp_path)
    assert len(views) == len(BALL) - 1 and "1 of 12 masks are black" in notices[0]


def test_the_first_of_two_files_of_cameras_is_taken_and_reported(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    np.savez(tmp_path / "cameras.npz", world_mat_0=np.eye(4))
    with collected() as notices:
        read_views(tmp_path)
    assert "transforms.json" in notices[0] and "cameras.npz" in notices[0]


def test_a_file_of_views_is_written_and_read(tmp_path):
    save_views(BALL, tmp_path / "views.npz")
    views, frame = read_views(tmp_path / "views.npz")
    assert frame == Frame()
    for name, array in load_views(str(tmp_path / "views.npz")).arrays().items():
        np.testing.assert_array_equal(array, getattr(BALL, name))
        np.testing.assert_array_equal(array, getattr(views, name))


# -- what cannot be read ----------------------------------------------------------------------------------------------


def test_opencv_matrices_in_transforms_are_refused(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])).tolist()
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(BadInput, match=r"transforms.json: the shape is behind 12 of 12 cameras.*OpenGL"):
        read_views(tmp_path)


def test_cameras_in_another_order_are_refused(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for frame in content["frames"]:  # each looks another way
        matrix = np.array(frame["transform_matrix"])
        matrix[:3, :3] = matrix[:3, :3] @ [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
        frame["transform_matrix"] = matrix.tolist()
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(BadInput, match="no point lies in all masks: cameras and masks disagree"):
        read_views(tmp_path)


def changed(**values):
    """A change to the first frame."""
    return lambda content: content["frames"][0].update(values)


def without(name):
    return lambda content: content["frames"][0].pop(name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("frames"), "expected a list `frames`"),
        (without("file_path"), r"frames\[0\]: expected a file_path"),
        (changed(file_path="images/no"), r"frames\[0\]: there is no image .*no; expected it there, or with"),
        (without("transform_matrix"), "has no transform_matrix"),
        (changed(transform_matrix=[[1, 2], [3, 4]]), r"expected a transform_matrix of 4 rows of 4.* shape \(2, 2\)"),
        (changed(transform_matrix=np.diag([1, 2, 3, 1]).tolist()), "transform_matrix: is not a rotation"),
        (changed(transform_matrix=np.diag([1, 1, -1, 1]).tolist()), "transform_matrix: is mirrored"),
        (changed(fl_x="wide"), "fl_x: expected a finite number of at most 1e.15, got 'wide'"),
        (changed(fl_x=-1), "expected fl_x above 0"),
        (changed(fl_x=0, fl_y=0), "has no focal length; expected fl_x"),
        (changed(k4=0.1), "camera model k4"),
        (changed(camera_model="OPENCV_FISHEYE"), "camera model OPENCV_FISHEYE: expected one of"),
        (changed(mask_path="masks/no.png"), "mask_path: there is no file .*no.png"),
        (changed(mask_path="transforms.json"), "cannot be read as an image"),
        (changed(w=80), "64 x 64 pixels, but its camera is for 80 x 64"),
    ],
)
def test_a_wrong_transforms_json_says_where_it_is_wrong(tmp_path, change, message):
    save_views_as_transforms(BALL, tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    change(content)
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(BadInput, match=message):
        read_views(tmp_path)


def test_missing_masks_say_where_they_were_looked_for(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for frame in content["frames"]:
        del frame["mask_path"]
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    (tmp_path / "masks").rename(tmp_path / "elsewhere")
    with pytest.raises(BadInput, match=r"a file 000.png or 000.png.png in one of .*/masks, .*/mask, .*mask_path in"):
        read_views(tmp_path)


def test_masks_of_the_background_are_refused(tmp_path):
    pictures(tmp_path / "m", 255 * (~BALL.masks).astype(np.uint8))
    save_views_as_transforms(BALL, tmp_path / "f")
    for file in (tmp_path / "m").iterdir():
        file.rename(tmp_path / "f/masks" / file.name)
    with pytest.raises(BadInput, match="12 of 12 masks cover all four corners.*inverted"):
        read_views(tmp_path / "f")


def test_other_wrong_pictures(tmp_path):
    save_views_as_transforms(BALL, tmp_path)
    Image.new("L", (32, 64)).save(tmp_path / "masks/001.png")
    with pytest.raises(BadInput, match=r"masks/001.png: has 32 x 64 pixels, its image .* has 64 x 64"):
        read_views(tmp_path)
    Image.new("RGB", (32, 64)).save(tmp_path / "images/001.png")
    with pytest.raises(BadInput, match=r"images/001.png: has 32 x 64 pixels, while most images have 64 x 64"):
        read_views(tmp_path)
    whole = (tmp_path / "images/000.png").read_bytes()
    (tmp_path / "images/001.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput, match=r"images/001.png: cannot be read as an image"):
        read_views(tmp_path)
    Image.fromarray(np.zeros((64, 64), np.uint16)).save(tmp_path / "images/001.png")
    with pytest.raises(BadInput, match=r"images/001.png: expected an image of 8 bits"):
        read_views(tmp_path)


def test_wrong_cameras_npz(tmp_path):
    file = write_dtu(BALL, tmp_path)
    arrays = dict(np.load(file))

    def refused(message, **changes):
        np.savez(file, **(arrays | changes))
        with pytest.raises(BadInput, match=message):
            read_views(tmp_path)

    refused("world_mat_3: expected 3 or 4 rows of 4 finite numbers", world_mat_3=np.eye(3))
    refused("world_mat_3: expected a projection K", world_mat_3=np.zeros((4, 4)))
    refused("world_mat_0: its focal length is 1 pixels.*camera_mat_i", world_mat_0=np.eye(4))
    refused("scale_mat_0: is not a rotation", **{f"scale_mat_{v}": np.diag([1, 2, 3, 1]) for v in range(12)})
    refused("expected one scale_mat for all", scale_mat_5=np.diag([2, 2, 2, 1]))
    refused("12 images, but .* has 13 cameras", world_mat_12=np.eye(4))
    away = np.eye(4)
    away[:3, 3] = 0, 50, 0
    refused("no point of the ball around .* lies in all masks", **{f"scale_mat_{v}": away for v in range(12)})
    (tmp_path / "mask/003.png").unlink()
    refused("has 11 masks for 12 images")
    file.write_bytes(b"PK\3\4 and no more")
    with pytest.raises(UsageError, match="expected an .npz file of views .* or of cameras"):
        read_views(tmp_path)


def test_wrong_colmap_models(tmp_path):
    cameras = write_colmap(BALL, tmp_path)
    images, good = cameras.with_name("images.txt"), cameras.read_text()

    def refused(message):
        with pytest.raises(BadInput, match=message):
            read_views(tmp_path)

    cameras.write_text(good.replace("PINHOLE", "OPENCV_FISHEYE"))
    refused("line 2: camera model OPENCV_FISHEYE: .*colmap image_undistorter")
    cameras.write_text(good.replace("PINHOLE", "OPENCV"))
    refused("expected WIDTH HEIGHT fx fy cx cy k1 k2 p1 p2 for the model OPENCV")
    cameras.write_text(good.replace("7 PINHOLE", "8 PINHOLE"))
    refused("there is no camera 7 in cameras.txt, only 8")
    cameras.write_text(good)
    lines = images.read_text().splitlines()
    images.write_text("\n".join(line for line in lines if line.endswith(".png")))  # without the lines of points
    refused("line 2: expected the points of the image above")
    images.write_text("\n".join(lines).replace("005.png", "fifty.png"))
    refused("there is no image .*fifty.png; expected the images in a folder `images`")
    images.write_text("# nothing\n")
    refused("lists no images")
    cameras.rename(cameras.with_suffix(".bin"))
    refused("binary COLMAP model; .*colmap model_converter --input_path .* --output_type TXT")


def test_paths_that_hold_no_views(tmp_path):
    with pytest.raises(BadInput, match="has no file of cameras; expected one of transforms.json"):
        read_views(tmp_path)
    (tmp_path / "a.ply").touch()
    with pytest.raises(BadInput, match=r"a.ply: expected views: a folder of images with cameras, or an .npz"):
        read_views(tmp_path / "a.ply")
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(BadInput, match="expected a JSON file of cameras"):
        read_views(tmp_path)


def test_matrices_by_column_are_those_of_the_writer(tmp_path):
    """The matrices of the tests and of the writer are made in two ways."""
    save_views_as_transforms(BALL, tmp_path)
    frames = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    for view, frame in enumerate(frames):
        np.testing.assert_allclose(frame["transform_matrix"], opengl(BALL, view), atol=1e-12)
