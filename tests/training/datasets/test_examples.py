"""Labelled images as training reads them, from COCO files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import (
    CLASS_LABELS,
    COARSE_LABELS,
    NO_SUBTYPE,
    ROAD_DEFECT,
    class_of,
    coarse_of,
    subtype_of,
)
from pavetwin.labels.classes import categories
from pavetwin.labels.coco import encode
from pavetwin.training.datasets.examples import (
    Outline,
    RunLengths,
    labelled_classes,
    mask_in,
    missing_classes,
    read_coco,
)
from pavetwin.training.datasets.packs import PackOptions, read_pack, write_pack
from scenes.drawn_roads import NAMES, drawn_roads

PERSON, CAR = 1, 2  # in `COARSE`


def test_the_classes_are_those_of_label_files() -> None:
    assert tuple(category.name for category in categories()[:5]) == CLASS_LABELS
    for number, name in enumerate(CLASS_LABELS):
        coarse = coarse_of(name, is_defect=False)
        assert coarse is not None
        assert class_of(coarse, subtype_of(name)) == number
        assert (COARSE_LABELS[coarse] == name) == (number >= 3)
    assert coarse_of("Spalling", is_defect=True) == ROAD_DEFECT
    assert class_of(ROAD_DEFECT, NO_SUBTYPE) is None
    assert coarse_of("Tree", is_defect=False) is None


def test_a_drawn_dataset_is_read(tmp_path: Path) -> None:
    data = read_coco(drawn_roads(tmp_path, {"train": 9, "val": 2}), ("train", "val"))
    assert [example.split for example in data.examples] == ["train"] * 9 + ["val"] * 2
    content = json.loads((tmp_path / "annotations" / "instances_train.json").read_text())
    rows = [row for row in content["annotations"] if row["image_id"] == 3]
    example = data.examples[3]
    assert [each.category for each in example.objects] == [NAMES[row["category_id"] - 1] for row in rows]
    left, top, width, height = rows[0]["bbox"]
    assert example.objects[0].box == (left, top, left + width, top + height)
    assert data.encoded(example) == (tmp_path / "images" / "train" / "003.png").read_bytes()
    assert not example.is_synthetic
    assert missing_classes(data.examples) == []


def changed(folder: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """A drawn dataset whose file of labels was changed."""
    path = drawn_roads(folder, {"train": 2, "val": 1}) / "annotations" / "instances_train.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return folder


def row(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["annotations"][0].update(values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (row(category_id=9), "annotation 1 has category 9, which is not listed there."),
        (row(bbox=[5, 5, 0, 8]), "annotation 1 has a box without area: left 5, top 5, right 5, bottom 13."),
        (row(bbox=[100, 5, 40, 8]), "1 has a box that reaches out of its image of 128 × 96: left 100, top 5"),
        (row(bbox=[float("nan"), 5, 40, 8]), "annotation 1 has a box without area: left nan"),
        (row(bbox=[1, 2, 3]), "annotation 1 has the box [1, 2, 3], which is not left, top, width and height."),
        (row(bbox=["a", 1, 2, 3]), "annotation 1 has the box ['a', 1, 2, 3], which is not left, top, width and"),
        (row(id=None), "annotation 'None' has the id None, which is no whole number."),
        (row(image_id="0"), "annotation 1 is of image '0', which is not listed there."),
        (row(segmentation=[[1, 2, 3, 4, 5, 6, 7]]), "annotation 1 has a polygon that is not pairs of numbers"),
        (row(segmentation=[[1, 2, 3, 4, 5, float("nan")]]), "annotation 1 has a polygon that is not pairs of numbers"),
        (lambda content: content["images"][0].update(id="img_7"), "has the id 'img_7', which is no whole number."),
        (lambda content: content["images"][1].update(id=0), "has two images of one id."),
        (lambda content: content["images"][0].update(width="wide"), "is not as COCO has it (ValueError: "),
        (row(segmentation={"size": [96, 128], "counts": [3, 4]}), "1 has run lengths that do not fill its mask."),
        (lambda content: content["categories"][4].update(name="Tram"), "has a class 'Tram', which the detector"),
        (lambda content: content.pop("images"), "is not as COCO has it (KeyError: 'images')"),
    ],
)  # fmt: skip
def test_labels_out_of_range_are_refused_by_file_and_number(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    with pytest.raises(PaveTwinError) as refused:
        read_coco(changed(tmp_path, change), ("train", "val"))
    assert message in str(refused.value)
    assert "instances_train.json'" in str(refused.value)


def test_a_folder_without_labels_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"holds no annotations/instances_train.json; make one with `pavetwin data"):
        read_coco(tmp_path, ("train",))


def test_what_has_iscrowd_is_ignored_and_its_class_may_be_missing(tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        for each in content["annotations"]:
            each["iscrowd"] = int(each["category_id"] in (3, 5))

    changed(tmp_path, change)
    (tmp_path / "annotations" / "instances_val.json").unlink()
    data = read_coco(tmp_path, ("train", "val"))
    ignored = {each.category for example in data.examples for each in example.objects if each.is_ignored}
    assert ignored <= {"Pothole", "Car"}
    assert {"Pothole", "Car"} <= set(missing_classes(data.examples))
    assert CAR not in labelled_classes(data.examples)["drawn roads"]


def test_what_was_pasted_tells_nothing_of_others_of_its_class_and_stays_so_when_packed(tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        for each in content["annotations"]:
            if each["category_id"] == 5:
                each["attributes"] = {"cut_out": "a car of another image"}

    folder = drawn_roads(tmp_path / "roads", {"train": 9})
    labels = folder / "annotations" / "instances_train.json"
    content = json.loads(labels.read_text())
    change(content)
    labels.write_text(json.dumps(content))
    data = read_coco(folder, ("train",))
    write_pack([data], tmp_path / "all.pack", PackOptions())
    for each in (data, read_pack(tmp_path / "all.pack", ("train",))):
        cars = [true for example in each.examples for true in example.objects if true.coarse == CAR]
        assert cars
        assert all(true.is_pasted for true in cars)
        assert labelled_classes(each.examples)["drawn roads"] == {ROAD_DEFECT, PERSON}


def test_a_capture_is_synthetic(tmp_path: Path) -> None:
    data = read_coco(drawn_roads(tmp_path, {"train": 1}, synthetic=True), ("train",))
    assert data.examples[0].is_synthetic


@pytest.mark.parametrize("told", [{"camera": {"platform": "car"}}, {"attributes": {"platform": "car"}}])
def test_what_a_car_has_taken_is_from_the_road_and_stays_so_when_packed(tmp_path: Path, told: dict[str, Any]) -> None:
    folder = drawn_roads(tmp_path, {"train": 3}, synthetic=True)
    labels = folder / "annotations" / "instances_train.json"
    content = json.loads(labels.read_text())
    content["images"][1] |= told
    content["images"][2] |= {section: {"platform": "uav"} for section in told}
    labels.write_text(json.dumps(content))
    data = read_coco(folder, ("train",))
    assert [each.is_from_road for each in data.examples] == [False, True, False]
    write_pack([data], tmp_path / "all.pack", PackOptions())
    packed = read_pack(tmp_path / "all.pack", ("train",))
    assert [each.is_from_road for each in packed.examples] == [False, True, False]


def test_masks_are_read_in_any_window() -> None:
    mask = np.zeros((20, 30), dtype=np.bool_)
    mask[5:9, 10:22] = True
    whole = RunLengths(encode(mask), (20, 30))
    part = RunLengths(encode(mask[4:12, 8:25]), (8, 17), origin=(8, 4))
    polygon = Outline(((10.0, 5.0, 21.0, 5.0, 21.0, 8.0, 10.0, 8.0),))
    for shape in (whole, part, polygon):
        assert (mask_in(shape, (0, 0, 30, 20)) == 255 * mask).all()
        assert (mask_in(shape, (-4, 6, 15, 40))[:14, 4:] == 255 * mask[6:, :15]).all()
        assert not mask_in(shape, (-4, 6, 15, 40))[:, :4].any()
