"""The palette of a PNG: no colour of a map is lost in it."""

from pathlib import Path

import numpy as np
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.draw import style
from pavetwin.draw.style import with_palette


def opaque(rgb: UInt8Array) -> UInt8Array:
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), 255, np.uint8)], axis=-1)


def test_a_palette_keeps_large_areas_and_rare_colours() -> None:
    red, green = np.meshgrid(np.arange(256), np.arange(256))
    pixels = np.stack([red, green, 255 - red], axis=-1).astype(np.uint8)  # 65,536 colours, as edges make many
    pixels[:128] = (244, 241, 235)
    pixels[200, 7:9] = (0, 132, 0)  # a mark of two pixels, unlike all others
    drawn = with_palette(opaque(pixels))
    assert drawn.mode == "P"
    shown = np.asarray(drawn.convert("RGB")).astype(int)
    away = np.abs(shown - pixels).max(axis=-1)
    assert away[:128].max() <= 1
    assert away[200, 7:9].max() <= 16
    assert away.max() <= 16
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) <= 256


def test_few_colours_stay_as_they_are() -> None:
    pixels = np.zeros((4, 5, 3), dtype=np.uint8)
    pixels[1:3] = (255, 255, 255)
    pixels[0, 0] = (31, 58, 95)
    assert np.array_equal(np.asarray(with_palette(opaque(pixels)).convert("RGB")), pixels)


def test_a_figure_has_the_pixels_that_matplotlib_saves(tmp_path: Path) -> None:
    with style.styled():
        figure = style.new_figure(2.0, 1.0)
        axes = style.axes_in(figure, 0.2, 0.2, 1.6, 0.7)
        axes.plot([0, 1], [0, 1], color="#1F3A5F", alpha=0.5)
        figure.savefig(tmp_path / "whole.png", format="png", dpi=style.DPI)
    with Image.open(tmp_path / "whole.png") as saved:
        expected = np.asarray(with_palette(np.asarray(saved.convert("RGBA"))).convert("RGB"))
    style.save_figure(figure, tmp_path / "figure.png")
    with Image.open(tmp_path / "figure.png") as saved:
        assert np.array_equal(np.asarray(saved.convert("RGB")), expected)
