import numpy as np

from bench.pictures.colors import ERROR, OKABE_ITO, colors, indices

# Linear RGB as a person without green (deuteranopia) or red cones (protanopia) sees it: Machado, Oliveira and
# Fernandes, IEEE TVCG 15 (2009), severity 1.
DEUTAN = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]])
PROTAN = np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]])


def linear(rgb):
    rgb = np.asarray(rgb, dtype=float) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(values):
    """CIELAB of linear sRGB."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = np.clip(values, 0, 1) @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / 3 / (6 / 29) ** 2 + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def test_lightness_falls_evenly_from_light_to_dark():
    lightness = lab(linear(ERROR))[:, 0]
    assert lightness[0] > 95 and 8 < lightness[-1] < 25
    coarse = lightness[::15]  # rows are rounded to whole bytes
    steps = -np.diff(coarse)
    assert steps.min() > 0.6 * steps.mean() and steps.max() < 1.4 * steps.mean()


def test_the_order_survives_colour_blindness():
    for matrix in (DEUTAN, PROTAN):
        lightness = lab(linear(ERROR) @ matrix.T)[::15, 0]
        assert (np.diff(lightness) < -2).all()


def test_the_ends_of_the_scale_and_what_is_beyond():
    assert indices(np.array([0.0, 0.5, 1.0, 2.0, np.inf, np.nan]), 1.0).tolist() == [0, 128, 255, 255, 255, 255]
    assert indices(np.array([0.0, 3.0]), 0.0).tolist() == [0, 0]
    assert (colors(np.array([0.0, 9.0]), 1.0) == ERROR[[0, 255]]).all()
    assert not ERROR.flags.writeable


def test_colours_of_lines_are_distinct_for_everybody():
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in OKABE_ITO])
    for matrix in (np.eye(3), DEUTAN, PROTAN):
        seen = lab(linear(rgb) @ matrix.T)
        apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)[np.triu_indices(len(rgb), 1)]
        assert apart.min() > 9
