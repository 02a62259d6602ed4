"""Contact sheets: what is written on them has room."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from pavetwin.arrays import BoolArray
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, cut_around
from pavetwin.labels.classes import colours

NAME = "pavetwin-town-s11-uav-10b71e3d-000031-composite-copy-07"
LABELS = "10 labels, 12 ignored"


def written(shown: Image.Image) -> BoolArray:
    """Columns that hold something darker than the paper."""
    grey = np.asarray(shown.convert("L")).astype(int)
    return np.array((grey < grey.max() - 30).any(axis=0))


def heading(name: str, right: str) -> BoolArray:
    return written(captioned(Image.new("RGB", (CELL_PX, 10), "white"), name, "", right).crop((0, 12, CELL_PX, 32)))


def test_a_long_name_ends_before_the_number_of_labels() -> None:
    begins = int(np.flatnonzero(heading("", LABELS))[0])
    assert not heading(NAME, LABELS)[begins - 12 : begins].any()
    # It is as long as there is room for, and a short one is whole.
    assert heading(NAME, LABELS)[begins - 40 : begins - 12].any()
    assert (heading("town-07", LABELS)[: begins - 12] == heading("town-07", "")[: begins - 12]).all()


def test_the_legend_ends_within_the_sheet() -> None:
    cells = [captioned(Image.new("RGB", (CELL_PX, 10), "white"), "a", "", "")] * 2
    sheet = assembled(cells, "two", colours(["Single Crack", "Crocodile Crack", "Pothole"]), ignored="ignored " * 6)
    assert sheet.width == 2 * CELL_PX + 18 + 2 * 36
    assert not written(sheet)[-20:].any()


@given(
    left=st.integers(-10, 290), top=st.integers(-10, 190), width=st.integers(6, 60), height=st.integers(6, 60),
    size_px=st.sampled_from([None, CELL_PX]),
)  # fmt: skip
def test_a_part_shows_its_box_where_stated(left: int, top: int, width: int, height: int, size_px: int | None) -> None:
    picture = Image.new("RGB", (300, 200), "#808080")
    picture.paste("#FF0000", (left, top, left + width, top + height))
    box = (float(left), float(top), float(left + width), float(top + height))
    part, edges = cut_around(picture, box, margin=1.6, least_px=40, size_px=size_px)
    assert part.width == part.height >= CELL_PX
    assert max(edges[2] - edges[0], edges[3] - edges[1]) <= part.width / 1.6 + 1
    inside = Image.new("L", part.size)
    ImageDraw.Draw(inside).rectangle(edges, fill=255)
    red = np.asarray(part).astype(int)[:, :, 0] > np.asarray(part).astype(int)[:, :, 1] + 128
    shown = red & (np.asarray(inside) == 0)
    assert shown.sum() < 4 * part.width, "no more than a seam of the object lies outside its box"
    seen = max(0, min(left + width, 300) - max(left, 0)) * max(0, min(top + height, 200) - max(top, 0))
    scale = (edges[2] - edges[0]) / width
    assert abs(red.sum() - seen * scale**2) < 6 * part.width
