"""Datasets of a car and of several platforms, and how they are joined."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from pavetwin.capture.context import _check_reached
from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.capture.samples import platform_prefix
from pavetwin.capture.settings import CaptureSettings
from pavetwin.errors import PaveTwinError
from pavetwin.world.store import load_world
from scenes.folders import contents
from scenes.painter import UAV, Painter


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
