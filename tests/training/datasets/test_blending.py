"""Labels under pasted objects, and labels of these objects."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from pavetwin.labels.boxes import of_mask
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    read_description,
    read_image,
)
from pavetwin.labels.outlines import filled
from pavetwin.training.datasets.augmenting import ImageChange, changed, changed_picture
from pavetwin.training.datasets.blending import covered, pasted
from pavetwin.training.datasets.compositing import CompositeSettings, CompositeSummary, compose
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from scenes.photographs import pavement, voc, with_car, yolo

COVERED_SIZE = (120, 90)


@st.composite
def masks(draw: st.DrawFn) -> np.ndarray:
    """(90, 120) A rectangle, an ellipse, or both apart from each other."""
    drawn = Image.new("1", COVERED_SIZE)
    pen = ImageDraw.Draw(drawn)
    for shape in draw(st.sampled_from([(pen.rectangle,), (pen.ellipse,), (pen.rectangle, pen.ellipse)])):
        left, top = draw(st.integers(20, 80)), draw(st.integers(20, 60))
        shape((left, top, left + draw(st.integers(3, 20)), top + draw(st.integers(3, 10))), fill=1)
    return np.array(drawn)


CHANGES = st.builds(ImageChange, st.booleans(), st.floats(-15, 15).map(lambda angle: round(angle, 1)))


@settings(max_examples=60, deadline=None)
@given(masks(), CHANGES)
def test_box_and_outline_enclose_what_is_painted_however_it_is_turned(mask: np.ndarray, change: ImageChange) -> None:
    label = pasted(mask, "Car", "c")
    image = AnnotatedImage("a", ".jpg", COVERED_SIZE, "s", "a.jpg", "s:a", annotations=(label,))
    picture = np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, axis=2)
    # Bilinear between whole pixels: a pixel that is lighter has its middle in the mask.
    painted = changed_picture(picture, change)[..., 0]
    shown = painted > 150
    copy = changed(image, change, "b")
    (found,) = copy.annotations
    left, top, right, bottom = of_mask(shown) or (0, 0, 0, 0)
    assert found.box[0] <= left
    assert found.box[1] <= top
    assert found.box[2] >= right
    assert found.box[3] >= bottom
    assert found.outline is not None
    told = filled(np.array(found.outline), copy.size_px)
    # Where a corner points inwards, a quarter of the brightness is left.
    assert told[painted > 200].all()
    assert not told[painted < 55].any()
    if change.rotation_deg == 0:
        assert found.box == (left, top, right, bottom)
        assert (told == shown).all()


@pytest.mark.parametrize("outline", [None, ((20.0, 30.0), (120.0, 30.0), (120.0, 40.0), (20.0, 40.0))])
@pytest.mark.parametrize("reason", [None, "hidden"])
def test_what_is_left_of_a_label_depends_on_the_share_that_is_visible(
    outline: tuple[tuple[float, float], ...] | None, reason: str | None
) -> None:
    """60 % keep it, below that it is ignored, below 5 % it is gone; the box is that of what is visible."""
    label = Annotation("Pothole", (20, 30, 120, 40), reason, outline)
    for visible, expected in ((100, reason), (61, reason), (60, reason), (59, "covered"), (5, "covered")):
        over = np.zeros((90, 140), dtype=bool)
        over[:, 20 + visible :] = True
        left = covered(label, over, (140, 90))
        assert left is not None
        assert (left.box, left.ignored) == ((20, 30, 20 + visible, 40), reason or expected)
        assert (left.outline is None) == (outline is None)
        if left.outline is not None:
            assert max(x for x, _ in left.outline) == 20 + visible
    over[:, 24:] = True
    assert covered(label, over, (140, 90)) is None


def test_of_an_outline_that_no_pixel_lies_in_the_box_counts() -> None:
    hair = Annotation("Single Crack", (10, 0, 11, 80), outline=((10.1, 0.0), (10.2, 0.0), (10.2, 80.0), (10.1, 80.0)))
    over = np.ones((90, 120), dtype=bool)
    assert covered(hair, over, COVERED_SIZE) is None


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
