"""Datasets for other tools, read back by other tools."""

from pathlib import Path

import pytest
import supervision as sv
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pavetwin.errors import PaveTwinError
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    class_names,
    read_images,
    write_description,
)
from pavetwin.training.datasets.exporting import export
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.splitting import split_dataset
from scenes.photographs import picture

SIZE = (64, 48)
POTHOLE = Annotation("Pothole", (10, 20, 30, 40), outline=((10.0, 20.0), (30.0, 20.0), (20.0, 40.0)), original="D40")
CAR = Annotation("Car", (0, 0, 64, 48), attributes={"kind": "van"})
BLOCK = Annotation(None, (5, 6, 9, 10), ignored="class 'Block crack'", original="Block crack")
HIDDEN = Annotation("Car", (40, 0, 50, 5), ignored="hidden")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images in three scenes, so that each split has one."""
    folder = tmp_path_factory.mktemp("dataset")
    held = {"a": (POTHOLE, BLOCK), "b": (CAR, HIDDEN), "c": ()}
    (folder / "Annotations").mkdir()
    for number, (name, annotations) in enumerate(held.items()):
        picture(folder / "JPEGImages" / f"{name}.jpg", SIZE, number)
        image = AnnotatedImage(
            name,
            ".jpg",
            SIZE,
            "uapd",
            name,
            name,
            2.5,
            is_background=not annotations,
            annotations=annotations,
            attributes={"shadow_deg": "30.0"},
        )
        annotation_path(folder, name).write_bytes(as_xml(image))
    write_description(folder, {"complete": True})
    split_dataset(folder, (0.34, 0.33, 0.33))
    return folder


@pytest.fixture(scope="module")
def exported(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("exported") / "out"
    assert export(dataset, output, ("yolo", "yolo-seg", "coco")) == {"yolo": 3, "yolo-seg": 2, "coco": 3}
    return output


def place(exported: Path, name: str) -> str:
    (path,) = (exported / "images").rglob(f"{name}.jpg")
    return path.parent.name


def test_yolo_is_read_by_supervision(exported: Path) -> None:
    for name, annotation in (("a", POTHOLE), ("b", CAR)):
        split = place(exported, name)
        found = sv.DetectionDataset.from_yolo(
            str(exported / "images" / split), str(exported / "labels" / split), str(exported / "data.yaml")
        )
        assert tuple(found.classes) == class_names()
        (_, _, detections) = next(iter(found))
        assert detections.xyxy.tolist() == [pytest.approx(annotation.box, abs=1e-3)]
        assert found.classes[detections.class_id[0]] == annotation.category
    assert (
        exported / "labels" / place(exported, "a") / "a.txt"
    ).read_text() == "2 0.312500 0.625000 0.312500 0.416667\n"
    assert (exported / "labels" / place(exported, "c") / "c.txt").read_text() == ""


def test_polygons_are_there_for_images_whose_labels_have_outlines(exported: Path) -> None:
    labels = exported / "yolo-seg" / "labels"
    assert sorted(path.name for path in labels.rglob("*.txt")) == ["a.txt", "c.txt"]
    split = place(exported, "a")
    assert (labels / split / "a.txt").read_text() == "2 0.156250 0.416667 0.468750 0.416667 0.312500 0.833333\n"
    assert (exported / "yolo-seg" / "images" / split / "a.jpg").is_file()


def test_coco_is_read_by_pycocotools(exported: Path) -> None:
    cocos = {split: COCO(str(exported / f"annotations/instances_{split}.json")) for split in ("train", "val", "test")}
    ids = [each["id"] for coco in cocos.values() for each in coco.dataset["annotations"]]
    assert len(ids) == len(set(ids)) == 1 + len(class_names()) + 2
    first = cocos[place(exported, "a")]
    pothole, *blocks = first.dataset["annotations"]
    assert pothole["bbox"] == [10, 20, 20, 20]
    assert first.loadCats(pothole["category_id"])[0]["name"] == "Pothole"
    assert first.annToMask(pothole).sum() == pytest.approx(200, abs=30)
    assert [first.loadCats(each["category_id"])[0]["name"] for each in blocks] == list(class_names())
    assert all(each["iscrowd"] == 1 and first.annToMask(each).sum() == 16 for each in blocks)
    (image,) = first.dataset["images"]
    assert (image["gsd_mm"], image["group"], image["source"]) == (2.5, "a", "uapd")
    assert image["attributes"] == {"shadow_deg": "30.0"}
    assert [each["area"] for each in (pothole, *blocks)] == [200, *[16] * len(blocks)]
    second = cocos[place(exported, "b")].dataset["annotations"]
    assert [(each["iscrowd"], each["ignored"], each["attributes"]) for each in second] == [
        (0, None, {"kind": "van"}),
        (1, "hidden", {}),
    ]
    with pytest.raises(IndexError):  # the docs tell to leave these out
        cocos[place(exported, "b")].annToMask(second[0])
    assert [(each["area"], each["segmentation"] == []) for each in second] == [(64 * 48, True), (10 * 5, False)]


def test_what_a_region_of_no_class_hides_is_neither_right_nor_wrong(exported: Path) -> None:
    """By COCO's own evaluation, class by class: a detection in it is left out, and one beside it counts."""
    truth = COCO(str(exported / f"annotations/instances_{place(exported, 'a')}.json"))
    (image,) = truth.dataset["images"]
    pothole = truth.getCatIds(["Pothole"])[0]
    left, top, right, bottom = BLOCK.box
    for category in truth.getCatIds():
        right_one = {"image_id": image["id"], "category_id": pothole, "bbox": [10, 20, 20, 20], "score": 0.5}
        for corner, expected in (((left, top), 0), ((50, 0), 1)):
            box = [*corner, right - left, bottom - top]
            other = {"image_id": image["id"], "category_id": category, "bbox": box, "score": 0.9}
            evaluation = COCOeval(truth, truth.loadRes([right_one, other]), "bbox")
            evaluation.evaluate()
            counted = [each for each in evaluation.evalImgs if each is not None and each["aRng"] == [0, 1e10]]
            wrong = sum(
                int((~each["dtIgnore"][0].astype(bool) & (each["dtMatches"][0] == 0)).sum()) for each in counted
            )
            assert wrong == expected, (category, corner)


def test_coco_is_imported_again_with_scenes_and_ground_resolution(exported: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "again.yaml"
    rules = "".join(f"  {name}: {name}\n" for name in class_names())
    mapping.write_text(f"labels: {{format: coco}}\nclasses:\n{rules}")
    name, source = source_of(str(mapping))
    import_source(name, source, exported, tmp_path / "out", size=ImageSize())
    first, second = sorted(read_images(tmp_path / "out"), key=lambda image: image.group)
    assert (first.group, second.group, first.gsd_mm) == ("again:a", "again:b", 2.5)
    assert [(each.category, each.box) for each in first.labelled] == [("Pothole", (10, 20, 30, 40))]
    assert first.labelled[0].outline == POTHOLE.outline
    assert [(each.category, each.box, each.ignored) for each in second.annotations] == [
        ("Car", CAR.box, None),
        ("Car", HIDDEN.box, "crowd"),
    ]


def test_again_gives_the_same_bytes(dataset: Path, exported: Path, tmp_path: Path) -> None:
    export(dataset, tmp_path / "again", ("yolo", "yolo-seg", "coco"))
    files = [path.relative_to(exported) for path in exported.rglob("*") if path.is_file()]
    assert len(files) == 3 * 2 + 2 * 2 + 2 + 3 + 1
    for path in files:
        assert (tmp_path / "again" / path).read_bytes() == (exported / path).read_bytes(), path


def test_labels_are_replaced_as_a_whole(dataset: Path, tmp_path: Path) -> None:
    """A file that was written in part, kept by a second link, is not written to."""
    export(dataset, tmp_path / "out", ("yolo",))
    (label,) = (tmp_path / "out" / "labels").rglob("a.txt")
    whole = label.read_text()
    label.write_text(whole[:5])
    (tmp_path / "kept").hardlink_to(label)
    export(dataset, tmp_path / "out", ("yolo",))
    assert (label.read_text(), (tmp_path / "kept").read_text()) == (whole, whole[:5])


def test_another_split_needs_another_folder(dataset: Path, tmp_path: Path) -> None:
    """Else images that were in train would stay there, and be in test too."""
    merged = merge([dataset], tmp_path / "merged").folder
    split_dataset(merged, (0.34, 0.33, 0.33))
    export(merged, tmp_path / "out", ("yolo",))
    export(merged, tmp_path / "out", ("coco",))
    split_dataset(merged, (1.0, 0.0, 0.0))
    with pytest.raises(PaveTwinError, match="made with another split; choose another folder"):
        export(merged, tmp_path / "out", ("yolo",))


def test_unknown_formats_and_the_dataset_itself_are_refused(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"`formats`: no format 'cocoo' \(did you mean 'coco'\?\)"):
        export(dataset, tmp_path / "out", ("cocoo",))
    with pytest.raises(PaveTwinError, match="a folder of its own"):
        export(dataset, dataset, ("yolo",))
