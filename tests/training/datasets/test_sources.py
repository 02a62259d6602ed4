"""What each source's files become, against boxes that were worked out by hand from the published formats."""

import json
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.labels.common_form import AnnotatedImage, class_names, read_images
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.recipe import backgrounds_in
from pavetwin.training.datasets.report import Report
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import SOURCES, source_of
from scenes.photographs import coco, picture, voc, yolo

AS_IT_IS = ImageSize(longest_px=16384)
SINGLE, CROCODILE, POTHOLE, PERSON, CAR = "Single Crack", "Crocodile Crack", "Pothole", "Person", "Car"


def imported(
    source: str, folder: Path, size: ImageSize = AS_IT_IS, **how: object
) -> tuple[list[AnnotatedImage], Report]:
    name, found = source_of(source)
    output = folder.parent / f"{folder.name}-{name}"
    summary = import_source(name, found, folder, output, size=size, **how)  # type: ignore[arg-type]
    images = list(read_images(output))
    assert len(images) == summary.images
    return images, summary.report


def labels(image: AnnotatedImage) -> list[tuple[str | None, tuple[int, int, int, int]]]:
    return [(each.category, each.box) for each in image.labelled]


@pytest.fixture
def copied(shared_file: Callable[[str], Path], tmp_path: Path) -> Callable[..., Path]:
    """A folder with copies of real files, in the folders in which they are published."""

    def copy(folder: str, *names: str) -> Path:
        for name in names:
            target = tmp_path / "photos" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(shared_file(f"real/{folder}/{name}"), target)
        return tmp_path / "photos"

    return copy


def test_uav_pdd2023(copied: Callable[..., Path]) -> None:
    one, four = (
        "sample_01_c3_Oblique_crack-Pothole-Transverse_crack",
        "sample_04_c3_Longitudinal_crack-Repair-Transverse_crack",
    )
    folder = copied(
        "uav_pdd2023_samples",
        *(f"{name}.jpg" for name in (one, four)),
        *(f"annotations/{name}_annotation.xml" for name in (one, four)),
    )
    (first, second), report = imported("uav-pdd2023", folder)
    assert first.size_px == (1280, 960)
    assert labels(first) == [
        (SINGLE, (996, 925, 1058, 942)),
        (SINGLE, (1030, 471, 1045, 485)),
        (SINGLE, (127, 472, 149, 485)),
        (POTHOLE, (115, 472, 128, 486)),
        (SINGLE, (116, 927, 157, 943)),
    ]
    text = (folder / f"annotations/{four}_annotation.xml").read_text()
    assert text.count("<name>Repair</name>") > 0
    assert len(second.annotations) == text.count("<object>") - text.count("<name>Repair</name>")
    assert list(report) == []
    (half, _), _ = imported("uav-pdd2023", folder.rename(folder.parent / "again"), ImageSize())
    assert half.size_px == (640, 480)
    assert labels(half)[0] == (SINGLE, (498, 463, 529, 471))


def test_rdd2022_china_drone(copied: Callable[..., Path]) -> None:
    names = [f"China_Drone_{number:06d}" for number in (1, 170, 835)]
    folder = copied(
        "rdd2022_china_drone",
        *(f"China_Drone/train/images/{name}.jpg" for name in names),
        *(f"China_Drone/train/annotations/xmls/{name}.xml" for name in names),
    )
    (first, block), report = imported("rdd2022-china-drone", folder)
    assert labels(first) == [(SINGLE, (13, 69, 198, 99)), (SINGLE, (94, 113, 120, 272))]
    assert len(block.labelled) == 4
    (region,) = [each for each in block.annotations if each.ignored]
    assert (region.category, region.box, region.original) == (None, (288, 13, 376, 201), "Block crack")
    assert [str(each) for each in report] == [
        "China_Drone/train/annotations/xmls/China_Drone_000170.xml: no valid box, and not listed as verified "
        "background; the image is left out"
    ]
    listed = folder.parent / f"{folder.name}-rdd2022-china-drone" / "unlabelled.txt"
    assert listed.read_text() == "China_Drone/train/images/China_Drone_000170.jpg\n"
    moved = folder.rename(folder.parent / "again")
    again, report = imported("rdd2022-china-drone", moved, backgrounds=backgrounds_in(listed))
    assert [each.original for each in again if each.is_background] == listed.read_text().split()
    assert not list(report)
    assert not (folder.parent / "again-rdd2022-china-drone" / "unlabelled.txt").exists()


def test_pothole_recognition(copied: Callable[..., Path]) -> None:
    folder = copied("silva2020_labels", "dataset/1.txt", "dataset/100.txt", "dataset/classes.txt")
    picture(folder / "dataset" / "1.jpg", (1920, 1080))
    (image,), report = imported("pothole-recognition", folder)
    assert Counter(each.category for each in image.labelled) == {POTHOLE: 7, SINGLE: 1}
    assert labels(image)[0] == (POTHOLE, (517, 510, 623, 558))
    assert [str(each) for each in report] == ["dataset/100.txt: there is no picture of this name; left out"]


def test_uav_cars(copied: Callable[..., Path]) -> None:
    folder = copied("aerial_cars", *(f"DJI_0005-0{n}.{suffix}" for n in ("041", "118") for suffix in ("jpg", "txt")))
    words = (folder / "DJI_0005-0041.txt").read_text().splitlines()[0]
    assert words == "2 0.354166666667 0.433796296296 0.109375 0.0564814814815"
    (first, second), _ = imported("uav-cars", folder)
    assert labels(first)[0] == (CAR, (575, 438, 785, 499))
    assert first.group == second.group == "uav-cars:DJI_0005"
    assert len(first.labelled) == len((folder / "DJI_0005-0041.txt").read_text().splitlines())


def test_a_cyclist_is_neither_a_car_nor_a_person(tmp_path: Path) -> None:
    picture(tmp_path / "photos" / "a.jpg", (100, 100))
    yolo(tmp_path / "photos" / "a.txt", "4 0.5 0.5 0.2 0.2", "3 0.25 0.25 0.1 0.1", "0 0.75 0.25 0.1 0.1")
    (image,), _ = imported("uav-cars", tmp_path / "photos")
    assert labels(image) == [(CAR, (20, 20, 30, 30)), (CAR, (70, 20, 80, 30))]
    assert [(each.category, each.box) for each in image.annotations if each.ignored] == [(None, (40, 40, 60, 60))]


def test_a_picture_that_shows_something_is_not_offered_as_background(tmp_path: Path) -> None:
    """Such as a region to ignore, or a car whose box is wrong."""
    for name, labels_of in (("cyclist", ["4 0.25 0.25 0.1 0.1"]), ("wrong", ["0 1.5 0.5 0.1 0.1"]), ("empty", [])):
        picture(tmp_path / "photos" / f"{name}.jpg", (100, 100))
        yolo(tmp_path / "photos" / f"{name}.txt", *labels_of)
    images, report = imported("uav-cars", tmp_path / "photos")
    assert (images, report.unlabelled) == ([], ["empty.jpg"])
    left_out = [each.count for each in report if "no valid box" in each.text]
    assert left_out == [3]


def test_highrpd_leaves_out_every_image_with_a_pit(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    for number, lines in enumerate(
        [["0 0.5 0.25 1.0 0.1", "1 0.25 0.75 0.25 0.25"], ["0 0.5 0.5 0.5 0.5", "2 0.1 0.1 0.05 0.05"], []]
    ):
        picture(folder / "images" / f"{number}.jpg", (640, 640), number)
        yolo(folder / "labels" / f"{number}.txt", *lines)
    (image,), report = imported("highrpd", folder)
    assert labels(image) == [(SINGLE, (0, 128, 640, 192)), (CROCODILE, (80, 400, 240, 560))]
    assert [str(each) for each in report] == [
        "labels/1.txt:2: images with a 'pit' are left out",
        "labels/2.txt: no valid box, and not listed as verified background; the image is left out",
    ]


def test_pothrgbd_polygons_become_the_boxes_around_them(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "images" / "1.jpg", (640, 480))
    yolo(folder / "labels" / "1.txt", "0 0.25 0.5 0.5 0.25 0.75 0.5 0.5 0.75", "0 0.0 0.0 0.125 0.0 0.0 0.125")
    picture(folder / "images" / "2.jpg", (640, 480), 1)
    yolo(folder / "labels" / "2.txt", "")
    (image,), _ = imported("pothrgbd", folder)
    assert labels(image) == [(POTHOLE, (160, 120, 480, 360)), (POTHOLE, (0, 0, 80, 60))]
    assert image.annotations[0].outline == ((160, 240), (320, 120), (480, 240), (320, 360))


def test_uapd_names_are_spelled_out_or_abbreviated(tmp_path: Path) -> None:
    folder, box = tmp_path / "photos", (11, 21, 30, 40)
    spelled = ["Longitudinal crack", "transverse Crack", "OC", "lc", "Alligator_crack", "ac", "PH", "Repair", "rp"]
    picture(folder / "JPEGImages" / "a.JPG", (512, 512))
    objects = [(name, (box[0] + n, box[1], box[2] + n, box[3])) for n, name in enumerate(spelled)]
    voc(folder / "Annotations" / "a.xml", objects, (512, 512))
    (image,), report = imported("uapd", folder)
    assert [each.category for each in image.labelled] == [SINGLE] * 4 + [CROCODILE] * 2 + [POTHOLE]
    assert image.labelled[0].box == (10, 20, 30, 40)
    assert list(report) == []


def test_uav_people(tmp_path: Path) -> None:
    picture(tmp_path / "photos" / "train" / "images" / "p.jpg", (200, 100))
    yolo(tmp_path / "photos" / "train" / "labels" / "p.txt", "0 0.5 0.5 0.1 0.4")
    (image,), _ = imported("uav-people", tmp_path / "photos")
    assert labels(image) == [(PERSON, (90, 30, 110, 70))]


def test_own_captures_keep_what_is_ignored_and_the_ground_resolution(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    camera = {"platform": "uav", "altitude_m": 10.0, "gsd_mm": 2.5}
    picture(folder / "images" / "val" / "town-000001.jpg", (64, 64))
    picture(folder / "images" / "val" / "town-000002.jpg", (64, 64), 1)
    runs = {"size": [64, 64], "counts": [64 * 10 + 20, 5, 59, 5, 64 * 64 - 64 * 10 - 20 - 69]}
    one: dict[str, object] = {"segmentation": runs, "iscrowd": 0, "ignored": None, "severity": "low"}
    annotations: list[dict[str, object]] = [
        {"id": 1, "image_id": 1, "category_id": 3, "bbox": [10, 20, 2, 5], **one},
        {"id": 2, "image_id": 1, "category_id": 5, "bbox": [0, 0, 9, 9], "iscrowd": 1, "ignored": "hidden"},
        {"id": 3, "image_id": 2, "category_id": 4, "bbox": [1, 2, 3, 4], "iscrowd": 0},
    ]
    images: list[dict[str, object]] = [
        {"id": 1, "file_name": "town-000001.jpg", "width": 64, "height": 64, "camera": camera},
        {"id": 2, "file_name": "town-000002.jpg", "width": 64, "height": 64, "camera": {**camera, "gsd_mm": None}},
    ]
    images.append({"id": 3, "file_name": "town-000003.jpg", "width": 64, "height": 64, "camera": camera})
    annotations.append(
        {"id": 4, "image_id": 3, "category_id": 1, "bbox": [5, 5, 9, 9], "iscrowd": 1, "ignored": "faint"}
    )
    picture(folder / "images" / "val" / "town-000003.jpg", (64, 64), 2)
    picture(folder / "voc" / "JPEGImages" / "town-000001.jpg", (64, 64))
    coco(folder / "annotations" / "instances_val.json", images, annotations, list(class_names()[:5]))
    (nadir, tilted, empty), report = imported("pavetwin", folder)
    assert list(report) == []
    assert (empty.is_background, nadir.is_background) == (True, False)
    assert [each.ignored for each in empty.annotations] == ["faint"]
    assert labels(nadir) == [(POTHOLE, (10, 20, 12, 25))]
    assert nadir.labelled[0].attributes == {"severity": "low"}
    assert set(nadir.labelled[0].outline or ()) == {(10, 20), (12, 20), (12, 25), (10, 25)}
    assert [(each.category, each.ignored) for each in nadir.annotations[1:]] == [(CAR, "hidden")]
    assert (nadir.gsd_mm, nadir.attributes["split"]) == (2.5, "val")
    assert tilted.gsd_mm is None


def test_masks_become_boxes(copied: Callable[..., Path], tmp_path: Path) -> None:
    scene = "Dataset/1014627_RS_386_386RS124739_30061/1014627_RS_386_386RS124739_30061"
    folder = copied("cracks_and_potholes_br", *(f"{scene}_{end}" for end in ("RAW.jpg", "CRACK.png", "POTHOLE.png")))
    crack, pothole = (np.zeros((640, 1024, 3), dtype=np.uint8) for _ in range(2))
    crack[100, 200:210], crack[103, 213:220], crack[300, 400] = 255, 255, 255
    pothole[500:520, 30:60] = (0, 255, 0)
    Image.fromarray(crack).save(folder / f"{scene}_CRACK.png")
    Image.fromarray(pothole).save(folder / f"{scene}_POTHOLE.png")
    mapping = tmp_path / "brazil.yaml"
    mapping.write_text(
        json.dumps(
            {
                "labels": {
                    "format": "masks",
                    "picture": "_RAW",
                    "masks": {"crack": "_CRACK.png", "pothole": "_POTHOLE.png"},
                    "join_px": 4,
                    "least_px": 2,
                },
                "classes": {"crack": SINGLE, "pothole": POTHOLE},
            }
        )
    )
    (image,), report = imported(str(mapping), folder)
    assert labels(image) == [(SINGLE, (200, 100, 220, 104)), (POTHOLE, (30, 500, 60, 520))]
    assert [each.text for each in report] == ["parts of a mask of fewer than 2 pixels are left out"]


def test_every_source_keeps_the_rules_of_one() -> None:
    assert len(SOURCES.names()) >= 9
    for name, source in zip(SOURCES.names(), SOURCES.values(), strict=True):
        assert SOURCES.broken_rules(source) == [], name


def test_the_rules_of_a_source_find_what_is_missing() -> None:
    lacking = SOURCES.get("uapd").model_copy(update={"title": "", "home": "http://x", "classes": {"a": "drop"}})
    assert len(SOURCES.broken_rules(lacking)) == 3
