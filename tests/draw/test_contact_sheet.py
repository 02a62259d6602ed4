"""Contact sheets: what is written on them has room."""

import numpy as np
from PIL import Image

from pavetwin.arrays import BoolArray
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned
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
