"""By what the ground resolution of cut-outs and of road pictures is known."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    write_description,
)
from pavetwin.training.datasets.compositing import road_gsd_mm
from pavetwin.training.datasets.cutouts import cut_out_all
from pavetwin.training.datasets.report import Report
from pavetwin.training.datasets.road import road_mask
from scenes.photographs import pavement

SIZE = (320, 240)
CAR: PixelBox = (100, 100, 160, 124)
"""4.5 m and 1.8 m at 75 mm a pixel."""
PEOPLE: tuple[PixelBox, ...] = ((40, 60, 54, 70), (240, 180, 254, 190), (40, 200, 54, 210))
"""0.5 m and 0.35 m at 35 mm a pixel; plausible at 75 too, as 1.05 m and 0.75 m."""


def outlined(category: str, box: PixelBox) -> Annotation:
    left, top, right, bottom = box
    return Annotation(category, box, outline=((left, top), (right, top), (right, bottom), (left, bottom)))


def street(*annotations: Annotation, line_px: int = 0) -> UInt8Array:
    """Grey road with what is labelled in red, and a lane line down its right side."""
    drawn = Image.fromarray(pavement(SIZE))
    pen = ImageDraw.Draw(drawn)
    for each in annotations:
        pen.rectangle((each.box[0], each.box[1], each.box[2] - 1, each.box[3] - 1), fill=(190, 30, 35))
    if line_px:
        pen.rectangle((280, 20, 280 + line_px - 1, 220), fill=(210, 210, 210))
    return np.array(drawn)


def image_of(*annotations: Annotation, gsd_mm: float | None = None) -> AnnotatedImage:
    return AnnotatedImage("a", ".jpg", SIZE, "films", "a.jpg", "films:one", gsd_mm, annotations=annotations)


@pytest.mark.parametrize(("labelled", "expected_mm"), [("both", 75.0), ("people", 35.4)])
def test_a_scene_has_the_ground_resolution_of_its_vehicles_else_of_its_people(
    tmp_path: Path, labelled: str, expected_mm: float
) -> None:
    """Although it shows more people: those stand in any posture, vehicles are of one size."""
    people = [outlined("Person", box) for box in PEOPLE]
    annotations = (*people, outlined("Car", CAR)) if labelled == "both" else tuple(people)
    for folder in ("Annotations", "JPEGImages", "CutOuts"):
        (tmp_path / folder).mkdir()
    image = image_of(*annotations)
    Image.fromarray(street(*annotations)).save(tmp_path / "JPEGImages" / image.picture, quality=95)
    annotation_path(tmp_path, image.name).write_bytes(as_xml(image))
    write_description(tmp_path, {"complete": True})
    found = cut_out_all(tmp_path, tmp_path, tmp_path, ("films",), Report(), lambda _share, _what: None)
    assert len(found) == len(annotations)
    assert {scene for scene, _ in found} == {"films:one"}
    assert [each.gsd_mm for _, each in found] == [pytest.approx(expected_mm, rel=0.1)] * len(found)


def test_a_road_picture_has_the_stated_one_else_that_of_its_vehicles_else_that_of_its_lane_lines() -> None:
    car = outlined("Car", CAR)
    picture = street(car, line_px=10)
    road = road_mask(picture)
    assert road_gsd_mm(image_of(car, gsd_mm=20), picture, road) == 20
    assert road_gsd_mm(image_of(car), picture, road) == pytest.approx(75, rel=0.06)
    assert road_gsd_mm(image_of(outlined("Person", PEOPLE[0]), car), street(car), road) == pytest.approx(75, rel=0.06)
    assert road_gsd_mm(image_of(), picture, road) == pytest.approx(15, rel=0.1)
    assert road_gsd_mm(image_of(), street(), road) is None
