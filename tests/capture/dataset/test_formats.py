"""Datasets as they stand on disk: the tools that open them see the same in each format."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import supervision
from PIL import ExifTags, Image
from pycocotools.coco import COCO

from pavetwin.capture.record import Record, counted
from pavetwin.capture.sheets import save_sheet
from pavetwin.errors import PaveTwinError
from pavetwin.labels.rle import decode
from pavetwin.world.store import load_world
from scenes.painter import SPLITS


def test_the_formats_agree(dataset: Path, records: list[Record], cocos: dict[str, COCO]) -> None:
    voc = supervision.DetectionDataset.from_pascal_voc(
        str(dataset / "voc" / "JPEGImages"), str(dataset / "voc" / "Annotations")
    )
    by_name = {Path(path).stem: found for path, found in voc.annotations.items()}
    assert len(by_name) == len(records)
    for record in records:
        wanted = sorted((obj.category, *obj.box) for obj in record.objects)
        found = by_name[record.name]
        classes = [voc.classes[number] for number in found.class_id]
        assert sorted((name, *box) for name, box in zip(classes, found.xyxy.tolist(), strict=True)) == wanted
        coco = cocos[record.split]
        names = {category["id"]: category["name"] for category in coco.loadCats(coco.getCatIds())}
        annotations = coco.loadAnns(coco.getAnnIds(imgIds=[record.index]))
        boxes = [(names[a["category_id"]], *a["bbox"][:2], *np.add(a["bbox"][:2], a["bbox"][2:])) for a in annotations]
        assert sorted(boxes) == wanted
        assert [a["iscrowd"] for a in annotations] == [int(t.ignored is not None) for t in record.objects]


def test_yolo_labels_are_those_that_are_not_ignored(dataset: Path, records: list[Record]) -> None:
    for split in SPLITS:
        yolo = supervision.DetectionDataset.from_yolo(
            str(dataset / "images" / split), str(dataset / "labels" / split), str(dataset / "data.yaml")
        )
        by_name = {Path(path).stem: found for path, found in yolo.annotations.items()}
        ours = [record for record in records if record.split == split]
        assert set(by_name) == {record.name for record in ours}
        for record in ours:
            found = by_name[record.name]
            boxes = sorted(map(tuple, np.round(found.xyxy).astype(int).tolist()))
            assert boxes == sorted(obj.box for obj in record.labelled)
            assert sorted(yolo.classes[k] for k in found.class_id) == sorted(t.category for t in record.labelled)


def test_polygons_of_yolo_are_the_masks(dataset: Path, records: list[Record]) -> None:
    """Filled by another reader they are the exact masks, but for the simplification."""
    shares = []
    for split in SPLITS:
        folder = dataset / "yolo-seg"
        yolo = supervision.DetectionDataset.from_yolo(
            str(folder / "images" / split), str(folder / "labels" / split), str(folder / "data.yaml"), force_masks=True
        )
        by_name = {Path(path).stem: found for path, found in yolo.annotations.items()}
        ours = [record for record in records if record.split == split]
        assert set(by_name) == {record.name for record in ours}
        for record in ours:
            found = by_name[record.name]
            assert [yolo.classes[number] for number in found.class_id] == [obj.category for obj in record.labelled]
            for mask, obj in zip(found.mask if record.labelled else (), record.labelled, strict=True):
                wanted = decode(obj.mask, (320, 320))
                shares.append((mask & wanted).sum() / (mask | wanted).sum())
    assert len(shares) > 60
    assert min(shares) > 0.8
    assert np.mean(shares) > 0.97


def test_pictures_are_stored_once(dataset: Path, records: list[Record]) -> None:
    for record in records:
        for linked in (f"voc/JPEGImages/{record.name}.jpg", f"yolo-seg/{record.image}"):
            assert (dataset / linked).samefile(dataset / record.image)
    names = [(dataset / "voc" / "ImageSets" / "Main" / f"{split}.txt").read_text().split() for split in SPLITS]
    assert sorted(name for part in names for name in part) == [record.name for record in records]


def test_a_picture_says_where_and_when_it_was_taken(world: Path, dataset: Path, records: list[Record]) -> None:
    record = next(record for record in records if record.camera["pitch_deg"] > -86)
    with Image.open(dataset / record.image) as image:
        exif, xmp = image.getexif(), image.getxmp()
    assert (exif[ExifTags.Base.Make], exif[ExifTags.Base.Model]) == ("PaveTwin", "Virtual camera of arXiv 2606.20742")
    gps, photo = exif.get_ifd(ExifTags.IFD.GPSInfo), exif.get_ifd(ExifTags.IFD.Exif)
    lat, lon = (sum(float(part) / 60**k for k, part in enumerate(gps[tag])) for tag in (2, 4))
    place = load_world(world).georeference.to_wgs84(record.camera["position_m"][:2])
    assert (lon, lat) == pytest.approx(tuple(place), abs=2e-8 * 5)
    assert float(gps[ExifTags.GPS.GPSAltitude]) == record.camera["altitude_m"]
    assert float(gps[ExifTags.GPS.GPSImgDirection]) == pytest.approx(record.camera["heading_deg"], abs=0.001)
    assert float(photo[ExifTags.Base.ExposureTime]) == pytest.approx(0.001)
    assert gps[ExifTags.GPS.GPSDateStamp].replace(":", "-") == record.light["utc"][:10]
    pose = xmp["xmpmeta"]["RDF"]["Description"]
    assert float(pose["GimbalPitchDegree"]) == pytest.approx(record.camera["pitch_deg"], abs=0.01)
    assert float(pose["GimbalYawDegree"]) % 360 == pytest.approx(record.camera["heading_deg"], abs=0.01)


def test_a_class_that_a_split_lacks_is_named(records: list[Record]) -> None:
    lacking = counted(records).missing_classes()
    assert "Pothole" not in lacking.get("val", [])
    without = [
        replace(record, objects=tuple(obj for obj in record.objects if obj.category != "Pothole"))
        if record.split == "val"
        else record
        for record in records
    ]
    missing = counted(without).missing_classes()
    assert sorted(missing["val"]) == sorted(["Pothole", *lacking.get("val", [])])
    assert {**missing, "val": None} == {**lacking, "val": None}
    labels = counted(without).as_dict()["labels"]["Pothole"]
    assert labels["val"] == 0
    assert labels["train"] > 0


def test_a_contact_sheet_shows_the_labels(dataset: Path, tmp_path: Path) -> None:
    assert save_sheet(dataset, tmp_path / "sheet.png", count=4, split="train") == 4
    with Image.open(tmp_path / "sheet.png") as sheet:
        colours = {colour for _, colour in sheet.convert("RGB").getcolors(1 << 24)}
    assert (0x56, 0xB4, 0xE9) in colours
    with pytest.raises(PaveTwinError, match="did you mean 'train'"):
        save_sheet(dataset, tmp_path / "x.png", split="trian")
