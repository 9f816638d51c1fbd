import numpy as np
import pytest

from bench.errors import UsageError
from bench.pictures.camera import Camera, Window


def test_the_axes_are_a_right_handed_frame_and_look_where_they_say():
    for camera in (Camera(), Camera(10, 80), Camera(30, -20, up="y"), Camera(30, -20, up="x"), Camera(0, 90)):
        assert camera.axes @ camera.axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(camera.axes) == pytest.approx(1)
    assert Camera(0, 0).axes[2] == pytest.approx([1, 0, 0])  # from the side of +x
    assert Camera(90, 0).axes[2] == pytest.approx([0, 1, 0])
    assert Camera(-90, 0).axes == pytest.approx(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), abs=1e-12)
    assert Camera(0, 90).axes[2] == pytest.approx([0, 0, 1])
    assert Camera(20, 0, up="y").axes[1] == pytest.approx([0, 1, 0])


def test_a_window_holds_all_points_and_keeps_its_middle():
    points = np.random.default_rng(0).normal(size=(200, 3))
    camera = Camera(33, 12)
    window = camera.window([points[:50], points[50:]])
    share = window.share(camera.project(points))
    assert share.min() > 0 and share.max() < 1
    assert share.min(axis=0) + share.max(axis=0) == pytest.approx(1)
    for aspect in (0.3, 1.0, 2.5):
        wide = window.with_aspect(aspect)
        assert wide.half[1] / wide.half[0] == pytest.approx(aspect) and wide.center == window.center
        assert wide.half[0] >= window.half[0] - 1e-12 and wide.half[1] >= window.half[1] - 1e-12
    assert Camera(33, 12, 2).window([points]).half == pytest.approx(np.array(window.half) / 2)
    assert camera.window([]) == Window((0, 0), (1, 1))


def test_the_words_of_a_camera():
    assert Camera.of("30,10") == Camera(30, 10) and Camera.of("30,-10,2", "y") == Camera(30, -10, 2, "y")
    assert Camera.of(None) == Camera()
    for text in ("30", "30,10,0", "a,b", "30,91", "1,2,3,4", "nan,2"):
        with pytest.raises(UsageError, match="AZIMUTH,ELEVATION"):
            Camera.of(text)
