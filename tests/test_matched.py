"""Photographs with their ground resolution and subject, and whether a frame shows its damage."""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from gallery.matched import SEEN, darkness, photographs, stored
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile
from scipy.fft import dctn

from pavetwin.training.datasets.sources.base import source_of
from scenes.photographs import pavement

COARSE = 40
"""Steps of the table of quality 75 that are large beside those of quality 95."""

CRACK = np.array([[100.0, 200.0], [400.0, 202.0], [400.0, 208.0], [100.0, 206.0]])
"""Outline of a crack in a frame of 512 pixels."""


def test_a_large_photograph_is_cut_into_parts_around_its_labels(tmp_path: Path) -> None:
    whole = pavement((1280, 960))
    whole[450:800, 950:970] = 215
    Image.fromarray(whole).save(tmp_path / "a.png")
    objects = [("Alligator crack", (900, 640, 980, 700)), ("Transverse crack", (930, 650, 990, 690)),
               ("Pothole", (10, 20, 60, 70))]  # fmt: skip
    text = "".join(
        f"<object><name>{name}</name><bndbox><xmin>{b[0]}</xmin><ymin>{b[1]}</ymin><xmax>{b[2]}</xmax>"
        f"<ymax>{b[3]}</ymax></bndbox></object>"
        for name, b in objects
    )
    (tmp_path / "a_annotation.xml").write_text(f"<annotation>{text}</annotation>")
    source = source_of("uav-pdd2023")[1]
    parts = list(photographs(tmp_path, [tmp_path / "a.png"], source=source, gsd_m=None, line_m=0.2))
    assert [(part.kind, part.has_line) for part in parts] == [("crocodile_crack", True), ("pothole", False)]
    assert [part.picture.size for part in parts] == [(512, 512)] * 2
    assert parts[0].gsd_m == pytest.approx(0.010, rel=0.06)


def road(depth: float, width_px: int = 2, row: int = 204) -> Image.Image:
    """Pavement with a crack `depth` grey levels darker across it."""
    large = pavement((512, 512)).astype(float)
    crack = np.zeros((512, 512))
    cv2.line(crack, (100, row), (400, row), 1.0, width_px)
    return Image.fromarray(np.clip(large - depth * crack[..., None], 0, 255).astype(np.uint8))


def test_a_crack_is_seen_by_its_depth_of_grey() -> None:
    none, faint, dark = (darkness(road(depth), CRACK) for depth in (0, 4, 50))
    assert none == pytest.approx(1.0, abs=0.15)
    assert none < faint < SEEN < dark


def test_what_is_dark_beside_the_damage_does_not_count() -> None:
    assert darkness(road(50, row=219), CRACK) < 1.0


def test_damage_outside_the_frame_is_not_seen() -> None:
    assert darkness(road(50), CRACK + 600) == 0.0


def off_steps(picture: Image.Image, table: np.ndarray) -> float:
    """How far the coefficients of its blocks are from multiples of a table's coarse steps, × these: 0.25 by chance."""
    lightness = np.asarray(picture.convert("YCbCr"), dtype=float)[..., 0] - 128
    rows, columns = lightness.shape
    blocks = lightness.reshape(rows // 8, 8, columns // 8, 8).transpose(0, 2, 1, 3)
    steps = dctn(blocks, axes=(2, 3), norm="ortho")[..., table >= COARSE] / table[table >= COARSE]
    return float(np.abs(steps - np.round(steps)).mean())


def test_a_frame_is_stored_at_both_qualities_of_the_photographs() -> None:
    """The steps of quality 75 show, blurred by those of quality 95, which come last."""
    frame = Image.fromarray(np.random.default_rng(1).normal(128, 35, (128, 128)).clip(0, 255).astype(np.uint8))
    file = BytesIO()
    frame.save(file, "JPEG", quality=75)
    file.seek(0)
    table = np.array(JpegImageFile(file).quantization[0]).reshape(8, 8)
    assert off_steps(frame, table) == pytest.approx(0.25, abs=0.02)
    last = off_steps(stored(frame.convert("RGB")), table)
    assert 1.5 * off_steps(Image.open(file), table) < last < 0.05
