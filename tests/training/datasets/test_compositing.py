"""People and vehicles pasted on the roads of other images: plan, composites, and their splits."""

from collections import Counter, defaultdict
from collections.abc import Callable
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
    read_images,
    write_description,
)
from pavetwin.training.datasets import compositing
from pavetwin.training.datasets.compositing import CompositeSettings, CompositeSummary, compose, road_gsd_mm
from pavetwin.training.datasets.cutouts import cut_out_all
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.report import Report
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.road import road_mask
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.sources.pavetwin_capture import CaptureLayout
from pavetwin.training.datasets.splitting import split_dataset, split_names
from scenes.command_line import pavetwin, plain_refusal
from scenes.folders import digests
from scenes.photographs import pavement, voc, with_car, yolo

PLAN_SIZE = (320, 240)
CAR: PixelBox = (100, 100, 160, 124)
"""4.5 m and 1.8 m at 75 mm a pixel."""
PEOPLE: tuple[PixelBox, ...] = ((40, 60, 54, 70), (240, 180, 254, 190), (40, 200, 54, 210))
"""0.5 m and 0.35 m at 35 mm a pixel; plausible at 75 too, as 1.05 m and 0.75 m."""


def outlined(category: str, box: PixelBox) -> Annotation:
    left, top, right, bottom = box
    return Annotation(category, box, outline=((left, top), (right, top), (right, bottom), (left, bottom)))


def street(*annotations: Annotation, line_px: int = 0) -> UInt8Array:
    """Grey road with what is labelled in red, and a lane line down its right side."""
    drawn = Image.fromarray(pavement(PLAN_SIZE))
    pen = ImageDraw.Draw(drawn)
    for each in annotations:
        pen.rectangle((each.box[0], each.box[1], each.box[2] - 1, each.box[3] - 1), fill=(190, 30, 35))
    if line_px:
        pen.rectangle((280, 20, 280 + line_px - 1, 220), fill=(210, 210, 210))
    return np.array(drawn)


def image_of(*annotations: Annotation, gsd_mm: float | None = None) -> AnnotatedImage:
    return AnnotatedImage("a", ".jpg", PLAN_SIZE, "films", "a.jpg", "films:one", gsd_mm, annotations=annotations)


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


SIZE = (320, 240)
SETTINGS = CompositeSettings(objects=("uav-cars",), roads=("uapd",), share=100, gap_m=6)
ALL_TRAIN = (1.0, 0.0, 0.0)


def saved(path: Path, picture: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture).save(path, quality=95)
    return path


def imported(name: str, folder: Path, gsd_mm: float | None) -> Path:
    _, source = source_of(name)
    output = folder.parent / f"{folder.name}-set"
    import_source(name, source.model_copy(update={"gsd_mm": gsd_mm}), folder, output, size=ImageSize())
    return output


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pictures of one car each, whose ground resolution is not known, and four of cracks, with 60 mm a pixel."""
    folder = tmp_path_factory.mktemp("composite")
    for number in range(2):
        saved(folder / "cars" / f"film-{number}.jpg", with_car(pavement(SIZE, 9 + number), (150, 120), 60))
        yolo(folder / "cars" / f"film-{number}.txt", "0 0.46875 0.5 0.1875 0.1")
    for number in range(4):
        saved(folder / "roads" / f"{number}.jpg", pavement(SIZE, number, 100 + 10 * number))
        voc(folder / "roads" / f"{number}.xml", [("LC", (11, 1, 310, 240))], SIZE)
    return merge(
        [imported("uav-cars", folder / "cars", None), imported("uapd", folder / "roads", 60)], folder / "all"
    ).folder


@pytest.fixture(scope="module")
def composed(dataset: Path) -> CompositeSummary:
    return compose(dataset, dataset.parent / "composed", SETTINGS, shares=ALL_TRAIN)


def test_cars_stand_on_roads_as_large_as_they_are(dataset: Path, composed: CompositeSummary) -> None:
    images = {image.name: image for image in read_images(composed.folder)}
    originals = {image.name: image for image in read_images(dataset)}
    assert {name for name in images if not name.endswith("-composite")} == originals.keys()
    assert (composed.composites, composed.images, composed.cut_outs["Car"]) == (4, 10, 2)
    for name in originals:
        if not name.startswith("uapd"):
            continue
        image, road = images[f"{name}-composite"], originals[name]
        assert (image.group, image.gsd_mm, image.attributes["composite_of"]) == (road.group, 60, name)
        cars = [each for each in image.labelled if each.category == "Car"]
        assert 1 <= len(cars) <= 3
        shown = np.asarray(Image.open(composed.folder / "JPEGImages" / image.picture)).astype(int)
        before = np.asarray(Image.open(dataset / "JPEGImages" / road.picture)).astype(int)
        changed = np.abs(shown - before).sum(axis=2) > 90
        for car in cars:
            assert car.outline is not None
            corners = np.array(car.outline)
            longest = np.linalg.norm(corners[:, None] - corners[None], axis=2).max()
            # 4.5 m (and its diagonal) at 60 mm a pixel; the outermost pixels are cut off.
            assert longest == pytest.approx(4500 / 60, rel=0.12)
            left, top, right, bottom = car.box
            assert changed[top:bottom, left:right].mean() > 0.35
            changed[top:bottom, left:right] = False
        assert changed.mean() < 0.01


def test_resumed_or_again_it_is_the_same_bytes(dataset: Path, composed: CompositeSummary, tmp_path: Path) -> None:
    for _ in range(2):
        compose(dataset, tmp_path / "again", SETTINGS, shares=ALL_TRAIN)
        assert digests(tmp_path / "again") == digests(composed.folder)
        next((tmp_path / "again" / "Annotations").glob("*-composite.xml")).unlink()
        next((tmp_path / "again" / "CutOuts").glob("uav-cars-*.json")).unlink()
        (tmp_path / "again" / "Annotations" / "uapd-1.xml").unlink()
    # Findings of existing composites are reported again.
    assert any("no other Car fits" in each.text for each in composed.report)
    compose(dataset, tmp_path / "other", SETTINGS, seed=1, shares=ALL_TRAIN)
    assert digests(tmp_path / "other") != digests(composed.folder)


@pytest.fixture(scope="module")
def towns(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight films of one car each and twelve roads, every one a scene of its own."""
    folder = tmp_path_factory.mktemp("towns")
    for number in range(8):
        x, y = 60 + 28 * number, 60 + 17 * number
        saved(folder / "cars" / f"film{number}-0.jpg", with_car(pavement(SIZE, 20 + number), (x, y), 60))
        yolo(folder / "cars" / f"film{number}-0.txt", f"0 {x / 320} {y / 240} 0.1875 0.1")
    for number in range(12):
        saved(folder / "roads" / f"{number}.jpg", pavement(SIZE, number, 100 + 5 * number))
        voc(folder / "roads" / f"{number}.xml", [("LC", (11, 1, 310, 240))], SIZE)
    return merge(
        [imported("uav-cars", folder / "cars", None), imported("uapd", folder / "roads", 60)], folder / "all"
    ).folder


@pytest.mark.parametrize(("seed", "later"), [(0, 0), (0, 5), (3, 0)])
def test_no_cut_out_is_in_two_splits(towns: Path, tmp_path: Path, seed: int, later: int) -> None:
    """Neither on two roads nor on a road and in its own picture, also where the split draws other numbers."""
    composed = compose(towns, tmp_path / "out", SETTINGS, seed=seed)
    split_dataset(composed.folder, (0.7, 0.2, 0.1), later)
    split_of = {name: split for split, names in split_names(composed.folder).items() for name in names}
    seen: dict[str, set[str]] = defaultdict(set)
    for image in read_images(composed.folder):
        for each in image.labelled:
            if (cut_out := each.attributes.get("cut_out")) is not None:
                seen[cut_out] |= {split_of[image.name], split_of[cut_out.rpartition("-")[0]]}
    assert len(seen) >= 3
    assert {name: splits for name, splits in seen.items() if len(splits) > 1} == {}
    assert set(split_of.values()) == {"train", "val", "test"}


def test_a_split_with_too_few_cut_outs_says_how_many_it_has(towns: Path, tmp_path: Path) -> None:
    composed = compose(towns, tmp_path / "out", SETTINGS)
    told = {each.file: each.text for each in composed.report if "cut-outs" in each.text}
    split_dataset(composed.folder, (0.7, 0.2, 0.1))
    names = split_names(composed.folder)
    for split, text in told.items():
        roads = sum(name.startswith("uapd") and not name.endswith("composite") for name in names[split])
        cars = sum(name.startswith("uav-cars") for name in names[split])
        assert f"of its {roads} road images have fewer objects than drawn; its own cut-outs: {cars or 'none'}" in text
    assert "test" in told


def test_images_that_no_composite_needs_are_free_for_another_split(towns: Path, tmp_path: Path) -> None:
    few = compose(towns, tmp_path / "out", SETTINGS.model_copy(update={"share": 30, "most": 1}))
    images = {image.name: image for image in read_images(few.folder)}
    needed = {
        images[name].group
        for image in images.values()
        if "composite_of" in image.attributes
        for name in (
            image.name,
            *(each.attributes["cut_out"].rpartition("-")[0] for each in image.labelled if each.category == "Car"),
        )
    }
    given = {image.group for image in images.values() if "split" in image.attributes}
    assert given == needed
    assert 2 <= len(given) < len({image.group for image in images.values()})


def test_cars_of_one_film_have_one_ground_resolution(tmp_path: Path) -> None:
    for number, length in enumerate((60, 60, 30)):
        saved(tmp_path / "cars" / f"film-{number}.jpg", with_car(pavement(SIZE, number), (150, 120), length))
        share = length / 320
        yolo(tmp_path / "cars" / f"film-{number}.txt", f"0 0.46875 0.5 {share} {length * 0.4 / 240}")
    merged = merge([imported("uav-cars", tmp_path / "cars", None)], tmp_path / "all").folder
    (tmp_path / "out" / "CutOuts").mkdir(parents=True)
    report = Report()
    found = cut_out_all(merged, tmp_path / "out", tmp_path, ("uav-cars",), report, lambda _share, _what: None)
    # 4.5 m over the median of 30, 60 and 60 pixels; at that, the smallest is not a car.
    assert [(each.name, each.gsd_mm) for _, each in found] == [
        (f"uav-cars-film-{at}-000", pytest.approx(75, rel=0.08)) for at in (0, 1)
    ]
    assert len({(scene, each.gsd_mm) for scene, each in found}) == 1
    assert any(each.file == "uav-cars-film-2-000" and "size of its class" in each.text for each in report)


def test_a_road_is_scaled_down_for_coarser_objects_and_told_by_its_lane_lines(tmp_path: Path) -> None:
    """Cars of 75 mm a pixel on a road of 25: they are enlarged to 1.5 times, the road becomes half as large."""
    for number in range(2):
        saved(tmp_path / "cars" / f"film-{number}.jpg", with_car(pavement(SIZE, 9 + number), (150, 120), 60))
        yolo(tmp_path / "cars" / f"film-{number}.txt", "0 0.46875 0.5 0.1875 0.1")
    road = pavement((640, 480), 3)
    road[:, 300:306] = 210
    saved(tmp_path / "roads" / "a.jpg", road)
    voc(tmp_path / "roads" / "a.xml", [("LC", (401, 101, 500, 300))], (640, 480))
    merged = merge(
        [imported("uav-cars", tmp_path / "cars", None), imported("uapd", tmp_path / "roads", None)], tmp_path / "all"
    ).folder
    compose(merged, tmp_path / "out", SETTINGS.model_copy(update={"gap_m": 0.5}), shares=ALL_TRAIN)
    (image,) = (each for each in read_images(tmp_path / "out") if "composite_of" in each.attributes)
    gsd_mm = float(image.attributes["estimated_gsd_mm"])
    assert image.gsd_mm is None
    assert gsd_mm == pytest.approx(75 / 1.5, rel=0.08)
    assert image.size_px[0] == pytest.approx(640 * 25 / gsd_mm, rel=0.1)
    crack = next(each for each in image.annotations if each.category == "Single Crack")
    assert crack.box[1] == pytest.approx(100 * image.size_px[0] / 640, abs=1)
    for car in (each for each in image.labelled if each.category == "Car"):
        corners = np.array(car.outline)
        longest = np.linalg.norm(corners[:, None] - corners[None], axis=2).max()
        assert longest == pytest.approx(4500 / gsd_mm, rel=0.12)


@pytest.mark.parametrize("own_deg", [-35.0, 25.0])
def test_a_vehicle_stands_along_the_road_however_it_stood_before(tmp_path: Path, own_deg: float) -> None:
    """Two lane lines, 20° clockwise from the columns; the car stood at another angle."""
    car = with_car(pavement(SIZE, 9), (150, 120), 60, own_deg)
    rows, columns = np.nonzero(np.abs(car.astype(int) - pavement(SIZE, 9)).sum(axis=2) > 60)
    middle = (columns.min() + columns.max()) / 2 / SIZE[0], (rows.min() + rows.max()) / 2 / SIZE[1]
    side = np.ptp(columns) / SIZE[0], np.ptp(rows) / SIZE[1]
    saved(tmp_path / "cars" / "film-0.jpg", car)
    yolo(tmp_path / "cars" / "film-0.txt", f"0 {middle[0]} {middle[1]} {side[0]} {side[1]}")
    drawn = Image.fromarray(pavement(SIZE, 1))
    for top in (-40, 170):
        ImageDraw.Draw(drawn).line((0, top, 320, top + 320 * np.tan(np.radians(20))), fill=(210, 210, 210), width=5)
    saved(tmp_path / "roads" / "0.jpg", np.asarray(drawn))
    voc(tmp_path / "roads" / "0.xml", [("LC", (11, 1, 310, 240))], SIZE)
    merged = merge(
        [imported("uav-cars", tmp_path / "cars", None), imported("uapd", tmp_path / "roads", 60)], tmp_path / "all"
    ).folder
    compose(merged, tmp_path / "out", SETTINGS.model_copy(update={"most": 1, "gap_m": 0.5}), shares=ALL_TRAIN)
    (stands,) = (
        each for image in read_images(tmp_path / "out") for each in image.labelled if each.original == "cut out"
    )
    spread = np.array(stands.outline) - np.mean(np.array(stands.outline), axis=0)
    along = np.linalg.svd(spread)[2][0]
    assert abs((np.degrees(np.arctan2(along[1], along[0])) - 20 + 90) % 180 - 90) < 12


def test_road_masks_say_where_objects_may_stand(dataset: Path, tmp_path: Path) -> None:
    mask = np.zeros(SIZE[::-1], dtype=np.uint8)
    mask[:, :150] = 255
    for number in range(4):
        saved(tmp_path / "masks" / f"uapd-{number}.png", mask)
    summary = compose(
        dataset, tmp_path / "out", SETTINGS.model_copy(update={"road_masks": tmp_path / "masks"}), shares=ALL_TRAIN
    )
    cars = [each for image in read_images(summary.folder) for each in image.labelled if each.original == "cut out"]
    assert cars
    assert max(car.box[2] for car in cars) <= 152


def stands_on(folder: Path) -> Counter[str]:
    """On how many images each cut-out stands."""
    return Counter(
        each.attributes["cut_out"]
        for image in read_images(folder)
        for each in image.labelled
        if each.original == "cut out"
    )


def test_no_cut_out_stands_on_too_many_images(dataset: Path, tmp_path: Path, composed: CompositeSummary) -> None:
    many = SETTINGS.model_copy(update={"gap_m": 0})
    for limit, expected in ((1, {1}), (2, {1, 2})):
        few = compose(dataset, tmp_path / f"{limit}", many.model_copy(update={"repeat": limit}), shares=ALL_TRAIN)
        assert set(stands_on(few.folder).values()) <= expected
        assert sum(each.count for each in few.report if f"stands on {limit} images already" in each.text) >= 3
    assert max(stands_on(composed.folder).values()) > 2


def test_composites_are_no_roads_again(tmp_path: Path, composed: CompositeSummary) -> None:
    again = compose(composed.folder, tmp_path / "again", SETTINGS, shares=ALL_TRAIN)
    assert (again.composites, again.images) == (0, composed.images)
    (told,) = (each for each in again.report if each.text == compositing.THERE)
    assert told.count == 4
    # Without those they were made from, composites stay what they are.
    for name in ("uapd-0", "uapd-1", "uapd-2", "uapd-3"):
        (again.folder / "Annotations" / f"{name}.xml").unlink()
    third = compose(again.folder, tmp_path / "third", SETTINGS, shares=ALL_TRAIN)
    assert (third.composites, third.images) == (0, 6)


def test_what_does_not_fit_is_told(dataset: Path, tmp_path: Path) -> None:
    cars = dataset.parent / "cars-set"
    for gsd_mm, words in (
        (None, "its ground resolution is not known"),
        (12, "no cut-out has a ground resolution and a size that fit"),
    ):
        roads = tmp_path / f"roads-{gsd_mm}"
        saved(roads / "a.jpg", pavement(SIZE, 3))
        voc(roads / "a.xml", [("LC", (11, 1, 310, 240))], SIZE)
        merged = merge([cars, imported("uapd", roads, gsd_mm)], tmp_path / f"all-{gsd_mm}").folder
        summary = compose(merged, tmp_path / f"out-{gsd_mm}", SETTINGS, shares=ALL_TRAIN)
        assert summary.composites == 0
        assert any(words in each.text for each in summary.report)


def test_the_command_and_its_refusals(dataset: Path, tmp_path: Path) -> None:
    ask = ("data", "composite", dataset, "-o", tmp_path / "out", "--objects", "uav-cars")
    done = pavetwin(*ask, "--roads", "uapd", "--share", "100", "--shares", "100/0/0")
    assert done.returncode == 0, done.stderr
    assert "Cut-outs: 2 of Car. Composites: 4." in done.stdout
    for more, words in (
        ((), "Name sources that show roads"),
        (("--roads", "uadp"), "--roads: no source of this dataset 'uadp' (did you mean 'uapd'?)"),
        (("--roads", "uapd", "--share", "0.3"), "--share: it must be a percentage, from 1 to 100 (got 0.3)"),
        (("--roads", "uapd", "--road-masks", tmp_path / "no"), "--road-masks: there is no folder"),
    ):
        assert words in plain_refusal(pavetwin(*ask, *more))
    refused = plain_refusal(pavetwin(*ask[:-1], "uav-car", "--roads", "uapd"))
    assert "--objects: no source of this dataset 'uav-car' (did you mean 'uav-cars'?)" in refused


def test_shares_are_percent_and_it_is_told_that_no_road_was_drawn(dataset: Path, tmp_path: Path) -> None:
    ask = ("data", "composite", dataset, "-o", tmp_path / "out", "--objects", "uav-cars", "--roads", "uapd")
    done = pavetwin(*ask, "--share", "1", "--shares", "100/0/0")
    assert done.returncode == 0, done.stderr
    assert "Composites: 0." in done.stdout
    assert "no composites: 0 of 4 road images were drawn for a share of 1 %" in " ".join(done.stderr.split())
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(
        "sources: [{source: uav-cars, folder: cars}, {source: uapd, folder: roads}]\n"
        "composite: {objects: [uav-cars], roads: [uapd], share: 0.3}\n"
    )
    refused = plain_refusal(pavetwin("data", "build", recipe, "-o", tmp_path / "built"))
    assert "composite.share: it must be a percentage, from 1 to 100 (got 0.3)" in refused


def test_a_recipe_composes_before_it_balances(dataset: Path, tmp_path: Path) -> None:
    saved(tmp_path / "roads" / "1.jpg", pavement(SIZE, 1, 110))
    voc(tmp_path / "roads" / "1.xml", [("LC", (11, 1, 310, 240))], SIZE)
    (tmp_path / "recipe.yaml").write_text(
        f"sources:\n  - {{source: uav-cars, folder: {dataset.parent}/cars}}\n"
        f"  - {{source: uapd, folder: {tmp_path}/roads, gsd_mm: 60}}\n"
        "composite: {objects: [uav-cars], roads: [uapd], share: 100}\n"
        "balance: {copies: 1}\nexport: []\nsplit: [100, 0, 0]\n"
    )
    done = pavetwin("data", "build", tmp_path / "recipe.yaml", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "uapd-1-composite" in {image.name for image in read_images(tmp_path / "out" / "balanced")}


def test_captures_tell_where_shadows_fall() -> None:
    camera = {"gsd_mm": 10.0, "heading_deg": 350.0}
    light = {"sun_azimuth_deg": 200.0, "sun_elevation_deg": 30.0, "cloud_cover": 0.25}
    layout: CaptureLayout = source_of("pavetwin")[1].labels  # type: ignore[assignment]
    details: Callable[..., dict[str, dict[str, str]]] = layout.details
    told = details("instances_train.json", {"camera": camera, "light": light})["attributes"]
    assert (told["shadow_deg"], told["sun_elevation_deg"], told["cloud_cover"]) == ("30.0", "30.0", "0.25")
    tilted = details("instances_train.json", {"camera": {"heading_deg": 350.0}, "light": light})
    assert "shadow_deg" not in tilted["attributes"]
