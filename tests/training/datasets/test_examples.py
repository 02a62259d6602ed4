"""Labelled images as training reads them, from COCO files and from packed files."""

import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

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
from pavetwin.labels.rle import encode
from pavetwin.training.datasets.examples import (
    Example,
    ExampleSet,
    Outline,
    RunLengths,
    labelled_classes,
    mask_in,
    missing_classes,
    read_coco,
)
from pavetwin.training.datasets.packs import PackOptions, read_examples, read_pack, write_pack
from scenes.command_line import pavetwin, plain_refusal
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
        (row(id=None), "annotation 'None' has the id None, which is not a whole number."),
        (row(image_id="0"), "annotation 1 is of image '0', which is not listed there."),
        (row(segmentation=[[1, 2, 3, 4, 5, 6, 7]]), "annotation 1 has a polygon that is not pairs of numbers"),
        (row(segmentation=[[1, 2, 3, 4, 5, float("nan")]]), "annotation 1 has a polygon that is not pairs of numbers"),
        (lambda content: content["images"][0].update(id="img_7"), "has the id 'img_7', which is not a whole number."),
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


SPLITS = ("train", "val")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_roads(tmp_path_factory.mktemp("roads"), {"train": 6, "val": 2}, size=(160, 120))


@pytest.fixture(scope="module")
def data(folder: Path) -> ExampleSet:
    return read_coco(folder, SPLITS)


def pixels(data: ExampleSet, example: Example) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(data.encoded(example))).convert("RGB"), dtype=np.float64)


def test_a_packed_dataset_holds_the_same(data: ExampleSet, tmp_path: Path) -> None:
    path = tmp_path / "roads.pack"
    summary = write_pack([data], path, PackOptions())
    assert (summary.images, summary.quality) == (8, 90)
    assert summary.size_mb * 1e6 == path.stat().st_size
    (packed,) = read_examples([path])
    for one, other in zip(data.examples, packed.examples, strict=True):
        for name in ("name", "split", "size_px", "source", "is_synthetic"):
            assert getattr(one, name) == getattr(other, name)
        window = (0, 0, *one.size_px)
        for true, kept in zip(one.objects, other.objects, strict=True):
            assert (true.category, true.coarse, true.subtype, true.box) == (
                *(kept.category, kept.coarse, kept.subtype, kept.box),
            )
            assert (mask_in(true.shape, window) == mask_in(kept.shape, window)).all()
        assert np.abs(pixels(data, one) - pixels(packed, other)).mean() < 4
    again = tmp_path / "again.pack"
    write_pack([data], again, PackOptions())
    assert again.read_bytes() == path.read_bytes()
    assert [each.split for each in read_pack(path, ("val",)).examples] == ["val", "val"]


def test_datasets_with_pictures_of_one_name_keep_their_own(tmp_path: Path) -> None:
    colours = {"red": (200, 20, 20), "blue": (20, 20, 200)}
    for name, colour in colours.items():
        for path in drawn_roads(tmp_path / name, {"train": 1}).glob("images/train/*.png"):
            Image.new("RGB", (128, 96), colour).save(path)
    sets = [read_coco(tmp_path / name, SPLITS) for name in colours]
    write_pack(sets, tmp_path / "both.pack", PackOptions())
    packed = read_pack(tmp_path / "both.pack", SPLITS)
    assert [each.name for each in packed.examples] == ["000.png", "000.png"]
    for example, colour in zip(packed.examples, colours.values(), strict=True):
        assert pixels(packed, example).mean(axis=(0, 1)) == pytest.approx(colour, abs=12)


def test_the_quality_falls_until_the_file_is_small_enough(data: ExampleSet, tmp_path: Path) -> None:
    whole = write_pack([data], tmp_path / "a.pack", PackOptions())
    limit = 0.75 * whole.size_mb
    less = write_pack([data], tmp_path / "b.pack", PackOptions(most_mb=limit))
    assert less.size_mb <= limit
    assert less.quality < 90
    with pytest.raises(PaveTwinError, match=r"8 images need about .* MB at the lowest quality, and `most_mb` is 0.001"):
        write_pack([data], tmp_path / "c.pack", PackOptions(most_mb=0.001))
    assert not (tmp_path / "c.pack").exists()


def test_smaller_pictures_keep_their_labels_in_place(data: ExampleSet, tmp_path: Path) -> None:
    write_pack([data], tmp_path / "small.pack", PackOptions(longest_px=80))
    small = read_pack(tmp_path / "small.pack", SPLITS)
    for one, other in zip(data.examples, small.examples, strict=True):
        assert other.size_px == (80, 60)
        for true, kept in zip(one.objects, other.objects, strict=True):
            assert kept.box == tuple(value / 2 for value in true.box)
            if true.category not in ("Pothole", "Car"):
                continue  # thin lines may vanish
            mask = mask_in(true.shape, (0, 0, 160, 120)).reshape(60, 2, 80, 2).mean(axis=(1, 3)) > 127
            shared = mask & (mask_in(kept.shape, (0, 0, 80, 60)) > 0)
            assert shared.sum() > 0.97 * mask.sum()


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x05\x06" + 18 * b"\0"])
def test_a_file_that_is_no_packed_dataset_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.pack"
    path.write_bytes(content)
    with pytest.raises(PaveTwinError, match="is not a packed dataset, or damaged"):
        read_pack(path, SPLITS)


def test_the_commands_pack_and_refuse_plainly(folder: Path, tmp_path: Path) -> None:
    done = pavetwin("data", "pack", folder, "-o", tmp_path / "r.pack", "--splits", "val", "--quality", 50)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"2 images in {tmp_path / 'r.pack'}: 0.0 MB at quality 50")
    for words, told in (
        (("--splits", "vla"), "--splits: no split 'vla' (did you mean 'val'?)"),
        (("--max-mb", 0.001), "--max-mb is 0.001; pack fewer images or smaller ones (--longest)"),
        (("--quality", 500), "--quality 500: it must be from 1 to 100"),
    ):
        assert told in plain_refusal(pavetwin("data", "pack", folder, "-o", tmp_path / "n.pack", *words))
    path = folder / "annotations" / "instances_val.json"
    content = json.loads(path.read_text())
    content["annotations"][0]["bbox"] = [500, 0, 10, 10]
    broken = tmp_path / "broken" / "annotations"
    broken.mkdir(parents=True)
    (broken / "instances_val.json").write_text(json.dumps(content))
    line = plain_refusal(pavetwin("data", "pack", tmp_path / "broken", "-o", tmp_path / "n.pack"))
    assert "annotation 1 has a box that reaches out of its image" in line
    assert not (tmp_path / "n.pack").exists()
