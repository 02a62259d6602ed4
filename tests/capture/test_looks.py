"""Looks of a captured dataset: what is found, missed and reported falsely in drawn pictures."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pavetwin.capture.looks import looks_of
from pavetwin.capture.record import Record, truth_path
from pavetwin.capture.truth import LabelledObject
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.rle import encode
from scenes import drawn_detector

SIZE = (96, 96)
PIXEL_M = 0.005
HEIGHT_M = 10.0


def thing(
    number: int,
    kind: str,
    box: PixelBox,
    *,
    visible: float = 1.0,
    inside: float = 1.0,
    at: tuple[float, float] | None = None,
) -> LabelledObject:
    """A defect that fills a box; its centre lies there unless another pixel is given."""
    left, top, right, bottom = box
    mask = np.zeros(SIZE[::-1], dtype=np.bool_)
    mask[top:bottom, left:right] = True
    x, y = at or ((left + right) / 2, (top + bottom) / 2)
    area_px = (right - left) * (bottom - top)
    return LabelledObject(
        id=f"defect {number}",
        category=kind.replace("_", " ").title(),
        box=box,
        area_px=area_px,
        amodal_px=area_px,
        visible_fraction=visible,
        inside_fraction=inside,
        truncated=False,
        distance_m=HEIGHT_M,
        position_m=((x - SIZE[0] / 2) * PIXEL_M, -(y - SIZE[1] / 2) * PIXEL_M, 0.0),
        details={"class": kind, "severity": "low", "width_m": 0.01, "area_m2": area_px * PIXEL_M**2},
        ignored=None,
        mask=encode(mask),
    )


def dataset(
    folder: Path, drawn: list[tuple[str, PixelBox]], objects: list[LabelledObject], pitch_deg: float = -90.0
) -> Path:
    camera: dict[str, Any] = {
        "position_m": [0.0, 0.0, HEIGHT_M],
        "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
        "focal_px": HEIGHT_M / PIXEL_M,
        "frame_px": [200, 200],
        "corner_px": [52, 52],
        "gsd_mm": 1000 * PIXEL_M,
        "velocity_mps": [3.0, 4.0, 0.0],
        "exposure_s": 0.002,
        "pitch_deg": pitch_deg,
    }
    light = {"sun_elevation_deg": 40.0, "cloud_cover": 0.3}
    record = Record(0, "a", "train", ".png", SIZE, camera, light, {}, {}, tuple(objects))
    for path in (folder / record.image, folder / truth_path("train", "a")):
        path.parent.mkdir(parents=True)
    drawn_detector.drawn(SIZE, *drawn).save(folder / record.image)
    (folder / truth_path("train", "a")).write_bytes(record.as_bytes())
    (folder / "capture.yaml").write_text(yaml.safe_dump({"world": {"content_hash": "w", "defects_hash": "d"}}))
    return folder


HOLE, GHOST, CRACK = (10, 10, 40, 40), (60, 60, 90, 85), (50, 5, 90, 30)


def test_what_is_drawn_is_found_and_what_is_not_is_missed(tmp_path: Path) -> None:
    objects = [
        thing(3, "pothole", HOLE),
        thing(5, "crocodile_crack", CRACK),
        thing(7, "pothole", (0, 50, 20, 70), visible=0.3),
        thing(8, "pothole", (80, 40, 96, 50), at=(99.0, 45.0)),
        thing(9, "pothole", (0, 60, 20, 80), inside=0.9),
    ]
    folder = dataset(tmp_path / "set", [("pothole", HOLE), ("single_crack", GHOST)], objects)
    told: list[float] = []
    source = looks_of(folder, drawn_detector.FILE, 0.25, told.append)
    rows = source.looks.rows(named=True)
    assert [(row["group"], row["found"]) for row in rows] == [("w d 3", True), ("w d 5", False)], (
        "those that are hidden, cut by the border or have their centre outside are not looks"
    )
    hole = rows[0]
    assert hole["size_px"] == pytest.approx(30)
    assert hole["width_px"] == pytest.approx(2)
    assert hole["blur_px"] == pytest.approx(2)
    assert hole["inside_fraction"] == 1.0
    assert hole["off_centre"] == pytest.approx(23 / 48)
    assert (hole["sun_elevation_deg"], hole["clouds"]) == (40.0, 0.3)
    assert source.alarms.rows() == [(0, "single_crack", pytest.approx((30 * 25) ** 0.5, rel=0.1))]
    assert source.images["area_m2"].to_list() == pytest.approx([(96 * PIXEL_M) ** 2])
    assert told[-1] == 1.0


def test_a_dataset_without_pictures_from_above_and_a_damaged_one_are_told(tmp_path: Path) -> None:
    oblique = dataset(tmp_path / "oblique", [], [], pitch_deg=-30.0)
    with pytest.raises(PaveTwinError, match="has no image that looks straight down"):
        looks_of(oblique, drawn_detector.FILE, 0.25, lambda _: None)
    (oblique / "capture.yaml").write_text("world: 3")
    with pytest.raises(PaveTwinError, match=r"capture.yaml' is damaged"):
        looks_of(oblique, drawn_detector.FILE, 0.25, lambda _: None)
