"""Datasets as they stand on disk: what holds for every image, whoever takes it."""

import multiprocessing
import os
import signal
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from pycocotools.coco import COCO

from pavetwin.capture.record import Record
from pavetwin.capture.run import capture
from pavetwin.navigation.navmesh import flight_domain
from pavetwin.world.store import load_world
from scenes.folders import contents
from scenes.painter import FEW, SPLITS, UAV, Painter, slow_painter


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
