"""Datasets as they stand on disk: their laws, the tools that read them, and what interruptions leave."""

import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import supervision
import yaml
from PIL import ExifTags, Image
from pycocotools.coco import COCO

from pavetwin.capture.contact_sheet import save_sheet
from pavetwin.capture.context import _check_reached
from pavetwin.capture.disk_space import bytes_of
from pavetwin.capture.names import platform_prefix
from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.statistics import counted
from pavetwin.errors import PaveTwinError
from pavetwin.labels.rle import decode
from pavetwin.mission import versions
from pavetwin.navigation.domain import flight_domain
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.folders import contents
from scenes.painter import Painter, full_disk, slow_painter

UAV = CaptureSettings(
    platforms=("uav",), images=60, altitudes_m=(5.0, 6.0, 8.0), densities=("medium",), seed=3, size_px=(320, 320)
)
FEW = UAV.model_copy(update={"images": 20})
SPLITS = ("train", "val", "test")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("capture") / "cross"
    save_world(damaged("cross", 12), folder)
    return folder


@pytest.fixture(scope="module")
def dataset(world: Path) -> Path:
    folder = world.parent / "dataset"
    capture(world, UAV, folder, frame_source_factory=Painter)
    return folder


@pytest.fixture(scope="module")
def few(world: Path) -> dict[str, bytes]:
    """The contents of a dataset of few images, to compare with what interruptions leave."""
    folder = world.parent / "few"
    capture(world, FEW, folder, frame_source_factory=Painter)
    return contents(folder)


@pytest.fixture(scope="module")
def records(dataset: Path) -> list[Record]:
    return list(read_records(dataset))


@pytest.fixture(scope="module")
def cocos(dataset: Path) -> dict[str, COCO]:
    return {split: COCO(str(dataset / "annotations" / f"instances_{split}.json")) for split in SPLITS}


# --- Laws -----------------------------------------------------------------------------------------------------------


def test_every_box_is_the_tight_box_of_its_mask(cocos: dict[str, COCO]) -> None:
    checked = 0
    for coco in cocos.values():
        for annotation in coco.anns.values():
            rows, columns = np.nonzero(coco.annToMask(annotation))
            left, top = columns.min(), rows.min()
            assert annotation["bbox"] == [left, top, columns.max() + 1 - left, rows.max() + 1 - top]
            assert annotation["area"] == len(rows)
            checked += 1
    assert checked > 60


def test_no_defect_is_seen_in_two_splits(records: list[Record]) -> None:
    """Also none that is ignored."""
    seen: dict[str, set[str]] = {}
    for record in records:
        for obj in record.objects:
            if obj.id.startswith("defect"):
                seen.setdefault(obj.id, set()).add(record.split)
    assert len(seen) > 20
    assert {name: splits for name, splits in seen.items() if len(splits) > 1} == {}


def test_streets_belong_to_one_split_and_every_split_has_images(dataset: Path, records: list[Record]) -> None:
    manifest = yaml.safe_load((dataset / "manifest.yaml").read_text())
    street_of = {street: split for split, streets in manifest["streets"].items() for street in streets}
    for record in records:
        streets = {obj.details["street"] for obj in record.objects if "street" in obj.details}
        assert {street_of[street] for street in streets} <= {record.split}
    assert set(manifest["images"]) == set(SPLITS)
    assert manifest["credit"] == "© OpenStreetMap contributors"
    assert manifest["images"]["train"] == pytest.approx(42, abs=3)


def test_an_image_is_empty_by_design_or_shows_what_it_aims_at(records: list[Record]) -> None:
    for record in records:
        defects = [obj for obj in record.objects if obj.id.startswith("defect")]
        if not record.aim["met"]:
            assert defects == []
        else:
            assert {obj.category for obj in defects if obj.ignored is None} & set(record.aim["met"])
    empty = sum(not record.aim["met"] for record in records)
    assert 3 <= empty <= 12
    kinds = [record.aim["requested"][0] for record in records if record.aim["requested"]]
    assert {kind: kinds.count(kind) for kind in kinds} == pytest.approx(
        {"Single Crack": 17, "Crocodile Crack": 17, "Pothole": 17}, abs=3
    )


def test_images_vary(records: list[Record]) -> None:
    cameras = [record.camera for record in records]
    assert {camera["altitude_m"] for camera in cameras} == set(UAV.altitudes_m)
    tilted = sum(camera["pitch_deg"] > -86 for camera in cameras)
    assert 5 <= tilted <= 25
    elevations = [record.light["sun_elevation_deg"] for record in records]
    assert min(elevations) >= 12
    assert np.ptp(elevations) > 30
    assert np.ptp([record.traffic["time_s"] for record in records]) > 300
    assert len({round(camera["heading_deg"] / 20) for camera in cameras}) > 8


def test_the_uav_stays_where_it_may_fly(world: Path, records: list[Record]) -> None:
    loaded = load_world(world)
    free = {altitude: flight_domain(loaded, altitude).surface.buffer(-0.45) for altitude in UAV.altitudes_m}
    assert all(free[r.camera["altitude_m"]].contains(shapely.Point(r.camera["position_m"][:2])) for r in records)


def test_every_part_of_the_work_is_told(world: Path, tmp_path: Path) -> None:
    told: list[str] = []
    settings = UAV.model_copy(update={"images": 2, "altitudes_m": (6.0,)})
    capture(
        world, settings, tmp_path / "d", frame_source_factory=Painter, on_progress=lambda _, what: told.append(what)
    )
    assert [what for what in dict.fromkeys(told) if "Recording" not in what] == [
        "Loading the world",
        "Preparing the scene",
        "Drawing poses 1/2",
        "Drawing poses 2/2",
        "Taking images 1/2",
        "Taking images 2/2",
        "Writing label files",
    ]


@pytest.mark.slow
def test_a_smaller_dataset_is_the_beginning_of_a_larger_one(world: Path, dataset: Path, tmp_path: Path) -> None:
    small = capture(world, UAV.model_copy(update={"images": 12}), tmp_path / "grown", frame_source_factory=Painter)
    assert small.taken == 12
    grown = capture(world, UAV, tmp_path / "grown", frame_source_factory=Painter)
    assert grown.taken == 48
    assert contents(tmp_path / "grown") == contents(dataset)


@pytest.mark.slow
def test_more_processes_take_the_same_images(world: Path, few: dict[str, bytes], tmp_path: Path) -> None:
    capture(world, FEW, tmp_path / "two", frame_source_factory=Painter, jobs=2)
    assert contents(tmp_path / "two") == few


@pytest.mark.slow
def test_a_process_that_dies_is_replaced_and_costs_no_image(world: Path, few: dict[str, bytes], tmp_path: Path) -> None:
    killed: list[int] = []

    def kill_one(share: float, what: str) -> None:  # noqa: ARG001 - the signature of who is told of progress
        if what.startswith("Taking images 5/") and not killed:
            worker = multiprocessing.active_children()[0]
            killed.append(worker.pid or 0)
            os.kill(killed[0], signal.SIGKILL)

    folder = tmp_path / "disturbed"
    capture(world, FEW, folder, frame_source_factory=slow_painter, jobs=2, on_progress=kill_one)
    assert killed
    assert contents(folder) == few


@pytest.mark.slow
def test_another_seed_takes_other_images(world: Path, dataset: Path, tmp_path: Path) -> None:
    few = UAV.model_copy(update={"images": 3, "seed": 0})
    capture(world, few, tmp_path / "other", frame_source_factory=Painter)
    assert not set(contents(tmp_path / "other" / "truth").values()) & set(contents(dataset / "truth").values())


# --- Tools ----------------------------------------------------------------------------------------------------------


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


def test_the_yolo_folder_follows_ultralytics_rules(dataset: Path) -> None:
    """As in its documentation: data.yaml names folders beside it, /images/ becomes /labels/, lines are five numbers."""
    data = yaml.safe_load((dataset / "data.yaml").read_text())
    assert list(data["names"]) == list(range(len(data["names"])))
    assert "path" not in data
    for split in SPLITS:
        images = sorted((dataset / data[split]).iterdir())
        assert images
        for image in images:
            label = Path(str(image).replace(f"{os.sep}images{os.sep}", f"{os.sep}labels{os.sep}")).with_suffix(".txt")
            rows = [line.split() for line in label.read_text().splitlines()]
            assert all(len(row) == 5 and 0 <= int(row[0]) < len(data["names"]) for row in rows)
            assert all(0 <= float(value) <= 1 for row in rows for value in row[1:])
            assert len({tuple(row) for row in rows}) == len(rows)


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


# --- The car --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_car_drives_in_the_recorded_traffic_and_does_not_see_itself(world: Path, tmp_path: Path) -> None:
    settings = CaptureSettings(
        platforms=("car",),
        images=12,
        densities=("medium",),
        seed=3,
        size_px=(256, 256),
        split=(1, 0, 0),
        formats=("yolo",),
    )
    capture(world, settings, tmp_path / "drive", frame_source_factory=Painter)
    taken = list(read_records(tmp_path / "drive"))
    assert {record.camera["mount"] for record in taken} == {"front", "rear"}
    from pavetwin.traffic.record import record as record_traffic
    from pavetwin.traffic.trace import trace_of

    recording = record_traffic(load_world(world), "medium", 3, 600.0)
    trace, asides = trace_of(recording), []
    for record in taken:
        ego = int(record.traffic["ego"].removeprefix("agent "))
        assert recording.agents.kind[ego] == "hatchback"
        assert f"agent {ego}" not in {obj.id for obj in record.objects}
        poses = trace.agents_at(record.traffic["time_s"])
        row = poses["agent"].tolist().index(ego)
        yaw = poses["yaw_rad"][row]
        away = np.array(record.camera["position_m"][:2]) - (poses["x_m"][row], poses["y_m"][row])
        along, aside = away @ [np.cos(yaw), np.sin(yaw)], away @ [-np.sin(yaw), np.cos(yaw)]
        assert along == pytest.approx({"front": 1.80, "rear": -3.30}[record.camera["mount"]], abs=0.05)
        assert abs(aside) < 0.7
        asides.append(aside)
    # Drivers do not keep to the middle of their lanes as SUMO's do.
    assert 0.05 < np.std(asides) < 0.4


@pytest.mark.slow
def test_where_no_hatchback_drives_another_car_gives_way(world: Path, tmp_path: Path) -> None:
    """In low traffic one street sees no hatchback for ten minutes: pictures are taken there all the same."""
    from pavetwin.traffic.record import record as record_traffic
    from pavetwin.traffic.trace import trace_of

    settings = CaptureSettings(
        platforms=("car",),
        images=16,
        densities=("low",),
        seed=3,
        size_px=(256, 256),
        split=(0.5, 0, 0.5),
        formats=("yolo",),
    )
    capture(world, settings, tmp_path / "drive", frame_source_factory=Painter)
    loaded, recording = load_world(world), record_traffic(load_world(world), "low", 3, 600.0)
    streets = shapely.STRtree([segment.polygon for segment in loaded.segments])
    kinds, trace = np.array(recording.agents.kind), trace_of(recording)
    hatchbacks = kinds[recording.agent] == "hatchback"
    found = streets.query(shapely.points(recording.x[hatchbacks], recording.y[hatchbacks]), predicate="within")[1]
    with_some = {loaded.segments[number].street for number in found.tolist()}
    driven: dict[bool, set[str]] = {}
    for record in read_records(tmp_path / "drive"):
        poses = trace.agents_at(record.traffic["time_s"])
        row = poses["agent"].tolist().index(int(record.traffic["ego"].removeprefix("agent ")))
        number = int(streets.nearest(shapely.Point(poses["x_m"][row], poses["y_m"][row])))
        driven.setdefault(loaded.segments[number].street in with_some, set()).add(kinds[poses["agent"][row]])
    assert driven[True] == {"hatchback"}
    assert driven[False] <= {"compact", "saloon", "suv", "van"}


# --- Two platforms --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_dataset_of_two_platforms_is_that_of_the_one_and_that_of_the_other(
    world: Path, dataset: Path, tmp_path: Path
) -> None:
    both = UAV.model_copy(update={"platforms": ("uav", "car"), "images": 8})
    taken = capture(world, both, tmp_path / "both", frame_source_factory=Painter)
    assert taken.taken == 16
    manifest = yaml.safe_load((tmp_path / "both" / "manifest.yaml").read_text())
    assert {name: sum(row.values()) for name, row in manifest["images_by_platform"].items()} == {"uav": 8, "car": 8}
    car = both.model_copy(update={"platforms": ("car",), "altitudes_m": ()})
    capture(world, car, tmp_path / "car", frame_source_factory=Painter)
    joined = contents(tmp_path / "both")
    alone = contents(dataset) | contents(tmp_path / "car")
    images = [name for name in joined if name.startswith(("images/", "labels/", "yolo-seg/labels/", "voc/Ann"))]
    assert len(images) == 4 * 16
    assert all(joined[name] == alone[name] for name in images)
    ids = [record.index for record in read_records(tmp_path / "both")]
    assert len(set(ids)) == 16


@pytest.mark.slow
def test_datasets_of_one_world_and_seed_can_be_joined(world: Path, records: list[Record], tmp_path: Path) -> None:
    """Whatever the platform, the traffic, the number and the size of the images: no street and no defect is in two
    splits, and no two images have one name."""
    others = [
        {"platforms": ("car",), "altitudes_m": (), "densities": ("high",)},
        {"altitudes_m": (8.0,), "densities": ("low", "high"), "size_px": (256, 320), "empty": 0.0},
    ]
    joined, manifests = list(records), []
    for number, change in enumerate(others):
        folder = tmp_path / str(number)
        capture(world, UAV.model_copy(update={"images": 12, **change}), folder, frame_source_factory=Painter)
        joined += read_records(folder)
        manifests.append(yaml.safe_load((folder / "manifest.yaml").read_text())["streets"])
    assert manifests[0] == manifests[1]
    seen: dict[str, set[str]] = {}
    for record in joined:
        for obj in record.objects:
            if "street" in obj.details:
                seen.setdefault(obj.id, set()).add(record.split)
                seen.setdefault(obj.details["street"], set()).add(record.split)
    assert len(seen) > 20
    assert all(len(splits) == 1 for splits in seen.values())
    assert len({record.name for record in joined}) == len(joined) == 84


def test_names_of_images_tell_world_seed_and_platform_apart(world: Path) -> None:
    loaded = load_world(world)
    other = replace(loaded, defects=loaded.defects[1:])
    changes = [{"seed": 4}, {"size_px": (64, 64)}, {"densities": ("low",)}, {"altitudes_m": (6.0,)}]
    names = {platform_prefix(loaded, UAV.model_copy(update=change), "uav") for change in changes}
    names |= {platform_prefix(loaded, UAV, "uav"), platform_prefix(other, UAV, "uav")}
    names |= {platform_prefix(loaded, UAV, "car")}
    assert len(names) == 7
    assert all(re.fullmatch(r"cross-s[34]-(uav|car)-[0-9a-f]{8}", name) for name in names)
    more = UAV.model_copy(update={"images": 99, "platforms": ("car", "uav"), "formats": ("coco",)})
    assert platform_prefix(loaded, more, "uav") == platform_prefix(loaded, UAV, "uav")


def test_a_platform_that_can_not_reach_a_split_says_so() -> None:
    splits = {"a": "train", "b": "val"}
    with pytest.raises(PaveTwinError, match="No car comes to a street of the split val"):
        _check_reached("car", splits, {"a", "c"})
    _check_reached("car", splits, {"a", "b"})


# --- Interruptions and refusals -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_run_leaves_whole_images_and_goes_on(world: Path, few: dict[str, bytes], tmp_path: Path) -> None:
    """Killed when none of its processes gets further, each with less than a shard."""
    folder = tmp_path / "killed"
    script = (
        "from pathlib import Path; from pavetwin.capture.run import capture; from scenes.painter import tired_painter\n"
        "from pavetwin.capture.settings import CaptureSettings\n"
        "if __name__ == '__main__':\n"
        f" settings = CaptureSettings.model_validate_json({FEW.model_dump_json()!r})\n"
        f" capture(Path({str(world)!r}), settings, Path({str(folder)!r}), frame_source_factory=tired_painter, jobs=2)\n"
    )
    (tmp_path / "run.py").write_text(script)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    run = subprocess.Popen([sys.executable, tmp_path / "run.py"], env=environment, start_new_session=True)
    deadline = time.monotonic() + 120
    while not list(folder.glob("truth/*/*.json")) and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    run.kill()
    run.wait()
    while _alive(run.pid) and time.monotonic() < deadline:  # its children notice by themselves
        time.sleep(0.02)
    assert not _alive(run.pid)
    there = list(read_records(folder))
    assert 0 < len(there) <= 12
    names = {record.name for record in there}  # of the image it was killed in there may be files too: they are redone
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("*/*/*.*") if path.stem in names}
    assert len(kept) >= 5 * len(there)
    for record in there:
        with Image.open(folder / record.image) as image:
            image.load()
        assert (folder / "labels" / record.split / f"{record.name}.txt").is_file()
        assert (folder / "voc" / "Annotations" / f"{record.name}.xml").is_file()
    rest = capture(world, FEW, folder, frame_source_factory=Painter)
    assert rest.taken == FEW.images - len(there)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert contents(folder) == few


def _alive(group: int) -> bool:
    """Whether any process of a group is left that is not merely waiting to be collected."""
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = status.read_text().rpartition(")")
        except OSError:
            continue
        state, _, process_group = rest.split()[:3]
        if int(process_group) == group and state != "Z":
            return True
    return False


def test_a_full_disk_is_said_plainly_and_leaves_nothing_half_written(
    world: Path, few: dict[str, bytes], tmp_path: Path
) -> None:
    folder = tmp_path / "full"
    script = (
        "import resource; from pathlib import Path; from pavetwin.capture.run import capture\n"
        "from scenes.painter import Painter; from pavetwin.capture.settings import CaptureSettings\n"
        "from pavetwin.errors import PaveTwinError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))\n"
        f"settings = CaptureSettings.model_validate_json({FEW.model_dump_json()!r})\n"
        f"try: capture(Path({str(world)!r}), settings, Path({str(folder)!r}), frame_source_factory=Painter)\n"
        "except PaveTwinError as error: print(error)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False)
    assert "Cannot write" in done.stdout, done.stderr
    assert "Free some space" in done.stdout
    left = {name: content for name, content in contents(folder).items() if name != "capture.yaml"}
    assert len(left) < len(few)
    assert left.items() <= few.items()
    capture(world, FEW, folder, frame_source_factory=Painter)
    assert contents(folder) == few


def test_a_disk_too_small_is_noticed_at_once(world: Path, tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"10000000 images take about \d.* GB are free.*fewer `images`"):
        capture(
            world,
            UAV.model_copy(update={"images": 10_000_000, "size_px": (8192, 8192)}),
            tmp_path,
            frame_source_factory=Painter,
        )
    assert not list(tmp_path.iterdir())


def test_the_room_that_is_asked_for_is_about_what_is_taken() -> None:
    """By the real renderer an image of 640 × 640 pixels at quality 92 takes 0.11 MB, labels included."""
    assert bytes_of(CaptureSettings(platforms=("uav",), images=1), 2235) == pytest.approx(0.13e6 * 2235, rel=0.1)


def test_a_failure_in_another_process_is_ours_too(world: Path, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space"):
        capture(world, FEW, tmp_path / "failing", frame_source_factory=full_disk, jobs=2)
    assert not list((tmp_path / "failing").glob("images/*/*"))


def test_what_can_not_be_planned_leaves_nothing(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_place(*_: object) -> None:
        raise PaveTwinError("nowhere")

    monkeypatch.setattr("pavetwin.capture.run.draw_sample", no_place)
    with pytest.raises(PaveTwinError, match="nowhere"):
        capture(world, FEW, tmp_path / "d", frame_source_factory=Painter)
    assert not (tmp_path / "d").exists()


@pytest.mark.slow
def test_a_run_that_came_to_no_image_is_no_obstacle(
    world: Path, few: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("pavetwin.capture.images.meets_spec", lambda *_: False)
        with pytest.raises(PaveTwinError, match="no place was found"):
            capture(world, FEW.model_copy(update={"seed": 4}), tmp_path / "d", frame_source_factory=Painter)
    assert list(contents(tmp_path / "d")) == ["capture.yaml"]
    assert capture(world, FEW, tmp_path / "d", frame_source_factory=Painter).taken == FEW.images
    assert contents(tmp_path / "d") == few


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"platforms": ("uav", "car")}, "with `platforms` uav, not with `platforms` uav, car;"),
        ({"seed": 4}, "begun with `seed` 3, not with `seed` 4; give the same, or choose another folder"),
        ({"altitudes_m": (6.0,)}, "with `altitudes_m` 5, 6, 8, not with `altitudes_m` 6;"),
        ({"densities": ("low",)}, "with `densities` medium, not with `densities` low;"),
        ({"size_px": (320, 256)}, "with `size_px` 320x320, not with `size_px` 320x256;"),
        ({"split": (0.8, 0.1, 0.1)}, "with `split` 70/15/15, not with `split` 80/10/10;"),
        ({"formats": ("yolo",)}, "with `formats` yolo,yolo-seg,voc,coco, not with `formats` yolo;"),
        ({"empty": 0.0}, r"with `empty` 0\.15, not with `empty` 0;"),
        ({"picture": "png"}, "begun with `picture=jpg`, not with `picture=png`;"),
        ({"images": 59}, "`images` 60, more than 59"),
    ],
)
def test_a_folder_with_other_settings_is_refused(world: Path, dataset: Path, changed: dict, words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        capture(world, UAV.model_copy(update=changed), dataset, frame_source_factory=Painter)


def test_a_folder_of_another_version_or_adapter_is_refused(
    world: Path, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, real = contents(dataset), versions._version
    more = UAV.model_copy(update={"images": 61})
    with pytest.raises(PaveTwinError, match=r"begun with adapter none \(now a card\), whose pictures may differ"):
        capture(world, more, dataset, frame_source_factory=Painter, adapter="a card")
    for name in ("pavetwin", "numpy", "wgpu"):
        with monkeypatch.context() as patch:
            patch.setattr(versions, "_version", lambda asked, name=name: "99.0" if asked == name else real(asked))
            with pytest.raises(PaveTwinError, match=rf"begun with {name} \S+ \(now 99\.0\), whose"):
                capture(world, more, dataset, frame_source_factory=Painter)
    assert contents(dataset) == before


def test_a_folder_of_another_world_is_refused(world: Path, dataset: Path, tmp_path: Path) -> None:
    changed = tmp_path / "cross"
    shutil.copytree(world, changed)
    save_world(damaged("cross", 7), changed, force=True)
    with pytest.raises(PaveTwinError, match="other defects"):
        capture(changed, UAV, dataset, frame_source_factory=Painter)


def test_a_complete_dataset_is_left_as_it_is(world: Path, dataset: Path) -> None:
    before = contents(dataset)
    assert capture(world, UAV, dataset, frame_source_factory=slow_painter).taken == 0
    assert contents(dataset) == before


def test_an_altitude_inside_what_stands_everywhere_is_refused(world: Path, tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"`altitude_m` 0\.5"):
        capture(world, UAV.model_copy(update={"altitudes_m": (0.5,)}), tmp_path / "low", frame_source_factory=Painter)


def test_json_of_a_record_reads_back(dataset: Path, records: list[Record]) -> None:
    for record in records[:5]:
        path = dataset / "truth" / record.split / f"{record.name}.json"
        assert path.read_bytes() == record.as_bytes()
        assert json.loads(path.read_text())["image"] == record.image
