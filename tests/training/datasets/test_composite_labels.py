"""What a composite shows of a road's labels, and where objects stand: damage, a labelled person, a narrow road."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from PIL import Image

from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    read_description,
    read_image,
)
from pavetwin.training.datasets.compositing import CompositeSettings, CompositeSummary, compose
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from scenes.photographs import pavement, voc, with_car, yolo

SIZE = (320, 240)
GSD_MM = 60.0
GAP_M = 0.9
"""15 pixels."""

ROAD = (75, 30, 245, 210)
"""Of the narrow roads: three cars of 75 × 30 pixels fit, but seldom at once."""

PERSON = Annotation("Person", (0, 0, 95, 240))
HIDES = Annotation(None, (225, 0, 320, 240), ignored="class 'Block crack'")
HOLES = tuple(
    Annotation("Pothole", (left, top, left + 12, top + 12)) for left in range(60, 260, 16) for top in range(60, 180, 16)
)


@pytest.fixture(scope="module")
def composed(tmp_path_factory: pytest.TempPathFactory) -> CompositeSummary:
    """Six cars, and four roads each full of potholes, between a person and an ignored region, and narrow."""
    folder = tmp_path_factory.mktemp("labels")
    for number in range(6):
        x, y = 60 + 28 * number, 60 + 17 * number
        cars = folder / "cars"
        cars.mkdir(exist_ok=True)
        Image.fromarray(with_car(pavement(SIZE, 20 + number), (x, y), 60)).save(cars / f"film{number}-0.png")
        yolo(cars / f"film{number}-0.txt", f"0 {x / 320} {y / 240} 0.1875 0.1")
    mask = np.zeros(SIZE[::-1], dtype=np.uint8)
    mask[ROAD[1] : ROAD[3], ROAD[0] : ROAD[2]] = 255
    for path in (folder / "roads", folder / "masks"):
        path.mkdir()
    for number in range(12):
        Image.fromarray(pavement(SIZE, number, 100 + 5 * number)).save(folder / "roads" / f"{number:02}.png")
        voc(folder / "roads" / f"{number:02}.xml", [("PH", (61, 61, 72, 72))], SIZE)
        Image.fromarray(mask if number >= 8 else np.full_like(mask, 255)).save(
            folder / "masks" / f"uapd-{number:02}.png"
        )
    sets = []
    for name, inner, gsd_mm in (("uav-cars", "cars", None), ("uapd", "roads", GSD_MM)):
        source = source_of(name)[1].model_copy(update={"gsd_mm": gsd_mm})
        sets.append(import_source(name, source, folder / inner, folder / f"{inner}-set", size=ImageSize()).folder)
    whole = merge(sets, folder / "all").folder
    for number in range(8):
        path = annotation_path(whole, f"uapd-{number:02}")
        labels = HOLES if number < 4 else (PERSON, HIDES)
        path.write_bytes(as_xml(replace(read_image(path), annotations=labels)))
    settings = CompositeSettings(
        objects=("uav-cars",), roads=("uapd",), share=100, gap_m=GAP_M, road_masks=folder / "masks"
    )
    return compose(whole, folder / "out", settings, shares=(1.0, 0.0, 0.0))


def scenes(composed: CompositeSummary, numbers: range) -> list[AnnotatedImage]:
    paths = [annotation_path(composed.folder, f"uapd-{number:02}-composite") for number in numbers]
    return [read_image(path) for path in paths if path.is_file()]


def cars(image: AnnotatedImage) -> list[shapely.Geometry]:
    """The cars that were put on it, as polygons in pixels."""
    assert image.size_px == SIZE
    return [shapely.make_valid(shapely.Polygon(each.outline)) for each in image.labelled if each.category == "Car"]


def test_damage_under_a_car_loses_its_label_by_the_share_that_is_visible(composed: CompositeSummary) -> None:
    seen = {"labelled": 0, "cut": 0, "ignored": 0, "gone": 0}
    for image in scenes(composed, range(4)):
        over = shapely.union_all(cars(image))
        left = {each.box: each for each in image.annotations if each.category == "Pothole"}
        for hole in HOLES:
            whole = shapely.box(*hole.box)
            share = 1 - whole.intersection(over).area / whole.area
            within = [each for box, each in left.items() if whole.covers(shapely.box(*box))]
            told = "gone" if not within else "labelled" if within[0].ignored is None else within[0].ignored
            assert told == ("gone" if share < 0.05 else "covered" if share < 0.6 else "labelled"), (hole.box, share)
            seen["ignored" if told == "covered" else "cut" if told == "labelled" and share < 1 else told] += 1
    assert min(seen.values()) >= 5, seen


def test_no_car_stands_on_a_person_or_where_something_may_that_is_ignored(composed: CompositeSummary) -> None:
    images = scenes(composed, range(4, 8))
    assert len(images) == 4
    for image in images:
        assert image.annotations[:2] == (PERSON, HIDES)
        for car in cars(image):
            for each in (PERSON, HIDES):
                # Distances of pixels are those of their middles.
                assert car.distance(shapely.box(*each.box)) >= 1000 * GAP_M / GSD_MM - 1


def test_cars_on_a_narrow_road_keep_their_distance_to_its_edge_and_each_other(composed: CompositeSummary) -> None:
    images = scenes(composed, range(8, 12))
    apart = [one.distance(other) for each in images for at, one in enumerate(cars(each)) for other in cars(each)[:at]]
    assert len(apart) >= 2
    assert min(apart) >= 1000 * GAP_M / GSD_MM - 1
    edge = shapely.box(*ROAD).exterior
    assert min(car.distance(edge) for each in images for car in cars(each)) >= 1000 * GAP_M / GSD_MM - 1
    assert sum(each.count for each in composed.report if each.text == "no free place on its road") >= 1
    assert read_description(composed.folder)["settings"]["gap_m"] == GAP_M
