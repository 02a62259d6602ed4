"""The ground resolution of photographs that state none, from the painted lines in them."""

import cv2
import numpy as np
import pytest
from gallery.matched import photographs
from gallery.resolution import ground_resolution_m, painted_lines
from PIL import Image

from pavetwin.datasets.sources.base import source_of

WHITE, YELLOW = (225, 222, 215), (214, 160, 40)


def road(*lines: tuple[float, float, float, tuple[int, int, int]], length_px: float = 300.0) -> Image.Image:
    """Asphalt of 512 pixels with lines: column of the middle, width, degrees from upright, colour."""
    rng = np.random.default_rng(1)
    large = np.full((2048, 2048, 3), 120, np.uint8)
    for column, width_px, degrees, colour in lines:
        box = cv2.boxPoints(((4 * column, 1024.0), (4 * width_px - 1, 4 * length_px), degrees))
        cv2.fillPoly(large, [np.round(box).astype(np.int32)], colour)
    small = cv2.resize(large, (512, 512), interpolation=cv2.INTER_AREA).astype(float)
    return Image.fromarray(np.clip(small + rng.normal(0, 6, (512, 512, 1)), 0, 255).astype(np.uint8))


@pytest.mark.parametrize(("width_px", "degrees", "colour"), [(9, 0, WHITE), (30, 20, WHITE), (16, -35, YELLOW)])
def test_the_width_of_a_line_tells_the_ground_resolution(
    width_px: float, degrees: float, colour: tuple[int, int, int]
) -> None:
    found = ground_resolution_m(road((256, width_px, degrees, colour)))
    assert found == pytest.approx(0.15 / width_px, rel=0.06)


def test_bars_of_a_crossing_are_no_lines() -> None:
    bars = road(*((60 + 100 * k, 40.0, 0.0, WHITE) for k in range(5)))
    assert painted_lines(bars) == []


def test_yellow_lines_side_by_side_are_lines() -> None:
    double = road((200, 16, 0, YELLOW), (240, 16, 0, YELLOW))
    assert len(painted_lines(double)) == 2


def test_what_is_short_or_cut_off_by_the_border_tells_nothing() -> None:
    assert ground_resolution_m(road((256, 30, 0, WHITE), length_px=100)) is None
    assert ground_resolution_m(road((2, 30, 0, WHITE))) is None
    assert ground_resolution_m(road()) is None


def test_a_large_photograph_is_cut_into_parts_around_its_labels(tmp_path) -> None:
    whole = Image.new("RGB", (1280, 960), (120, 120, 120))
    whole.paste(road((256, 20, 0, WHITE)), (700, 400))
    whole.save(tmp_path / "a.png")
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
