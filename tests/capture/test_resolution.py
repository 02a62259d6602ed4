"""Images of a drawn ground resolution: what a pixel covers, where crops lie, and what the camera cannot reach."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pycocotools.coco import COCO

from pavetwin.capture.context import check
from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.capture.samples import image_specs
from pavetwin.capture.settings import CaptureSettings
from pavetwin.config.mission import LOWEST_M
from pavetwin.errors import PaveTwinError
from pavetwin.navigation.navmesh import flight_domain
from pavetwin.scene.view import View
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.painter import Painter

CROPS = CaptureSettings(
    platforms=("uav",),
    images=24,
    gsd_mm=(1.5, 12.0),
    camera="phantom4pro",
    densities=("low",),
    seed=3,
    size_px=(480, 320),
    formats=("coco",),
)
FRAME = (5472, 3648)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("crops") / "cross"
    save_world(damaged("cross", 12), place)
    return place


@pytest.fixture(scope="module")
def world(folder: Path) -> World:
    return load_world(folder)


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Path:
    place = folder.parent / "dataset"
    capture(folder, CROPS, place, frame_source_factory=Painter)
    return place


@pytest.fixture(scope="module")
def records(dataset: Path) -> list[Record]:
    return list(read_records(dataset))


def view_of(record: Record) -> View:
    """Read back from the record, as a user would."""
    camera = record.camera
    return View(
        np.array(camera["position_m"]),
        np.array(camera["rotation"]),
        record.size_px,
        camera["focal_px"],
        frame_px=tuple(camera["frame_px"]),
        corner_px=tuple(camera["corner_px"]),
    )


def test_resolutions_are_drawn_evenly_by_ratio(world: World) -> None:
    drawn = [spec.gsd_mm for spec in image_specs(CROPS, world, "uav", 300)]
    assert min(drawn) >= 1.5
    assert max(drawn) <= 12.0
    # Three octaves: a third of the images each.
    counts, _ = np.histogram(np.log2(np.array(drawn) / 1.5), bins=[0, 1, 2, 3])
    assert counts.tolist() == pytest.approx([100, 100, 100], abs=4)


def test_a_pixel_covers_what_the_record_says(dataset: Path, records: list[Record], world: World) -> None:
    """The outlines of the world's defects, filled in the image, have the area in pixels that their area on the road
    gives; the resolution is as drawn, and stands in COCO."""
    specs = {spec.name: spec for spec in image_specs(CROPS, world, "uav", CROPS.images)}
    images = [image for split in ("train", "val", "test") for image in _images(dataset, split)]
    assert {image["file_name"][:-4]: image["gsd_mm"] for image in images} == {
        record.name: record.camera["gsd_mm"] for record in records
    }
    measured = []
    for record in records:
        gsd_mm = record.camera["gsd_mm"]
        if record.aim["attempt"] < 8:
            assert gsd_mm == pytest.approx(specs[record.name].gsd_mm, rel=1e-3)
        width, height = record.size_px
        ground = shapely.Polygon(view_of(record).ground([(0, 0), (width, 0), (width, height), (0, height)]))
        for obj in record.objects:
            if obj.id.startswith("defect") and obj.visible_fraction == 1:
                outline = world.defects[int(obj.id.removeprefix("defect "))].polygon.intersection(ground)
                # Pillow fills every pixel that an outline touches: half a pixel more all around.
                grown_m2 = outline.buffer(0.5 * gsd_mm / 1000).intersection(ground).area
                if grown_m2 > 400 * (gsd_mm / 1000) ** 2:
                    measured.append((obj.area_px * (gsd_mm / 1000) ** 2 / grown_m2, record.camera["pitch_deg"]))
    shares, pitches = np.array(measured).T
    straight = np.abs(pitches + 90) < 2
    assert straight.sum() >= 12
    assert shares[straight] == pytest.approx(1.0, abs=0.06)
    assert np.median(shares[~straight]) == pytest.approx(1.0, abs=0.05)  # nearer and farther than the middle


def _images(dataset: Path, split: str) -> list[dict]:
    return list(COCO(str(dataset / "annotations" / f"instances_{split}.json")).imgs.values())


def test_from_straight_above_the_altitude_gives_the_resolution_anywhere_in_the_frame(records: list[Record]) -> None:
    nadir = [record.camera for record in records if abs(record.camera["pitch_deg"] + 90) < 0.25]
    assert len(nadir) >= 4
    for camera in nadir:  # 2.41 µm pixels behind a lens of 8.8 mm
        assert camera["gsd_mm"] == pytest.approx(camera["altitude_m"] * 13.2 / FRAME[0] / 8.8 * 1000, rel=5e-3)


def test_crops_lie_all_over_the_whole_frame(records: list[Record], world: World) -> None:
    for record in records:
        assert tuple(record.camera["frame_px"]) == FRAME
        assert (np.add(record.camera["corner_px"], CROPS.size_px) <= FRAME).all()
    corners = np.array([record.camera["corner_px"] for record in records]) / np.subtract(FRAME, CROPS.size_px)
    assert (corners.min(axis=0) < 0.2).all()
    assert (corners.max(axis=0) > 0.8).all()
    for record in records:  # a box lies where the off-centre view projects its object
        for obj in record.labelled:
            if obj.id.startswith("defect") and obj.inside_fraction == obj.visible_fraction == 1:
                ring = shapely.get_coordinates(world.defects[int(obj.id[7:])].polygon.exterior)
                seen = view_of(record).project(np.column_stack([ring, np.zeros(len(ring))]))
                assert (seen.min(axis=0) - obj.box[:2] > -2).all()
                assert (seen.max(axis=0) - obj.box[2:] < 2).all()


def test_the_uav_stays_where_it_may_fly_at_any_altitude(records: list[Record], world: World) -> None:
    for record in records:
        *xy, altitude_m = record.camera["position_m"]
        assert altitude_m >= LOWEST_M
        assert flight_domain(world, altitude_m).surface.buffer(-0.45).contains(shapely.Point(xy))


def test_the_coarsest_resolution_that_is_told_is_taken() -> None:
    check(CROPS.model_copy(update={"gsd_mm": (2.0, 13.3)}))


@pytest.mark.parametrize("high", [{"gsd_mm": (14.0, 32.0)}, {"gsd_mm": None, "altitudes_m": (20.0, 45.0, 120.0)}])
def test_only_images_of_damage_are_taken_from_low(high: dict[str, Any]) -> None:
    check(CROPS.model_copy(update={**high, "empty": 1.0, "road_users": 1.0}))
    with pytest.raises(PaveTwinError, match="defects"):
        check(CROPS.model_copy(update={**high, "empty": 0.99, "road_users": 1.0}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gsd_mm": (2.0, 33.0), "empty": 1.0}, "`gsd_mm` 2 33: .* covers 32.9 mm from 120 m, the highest; choose"),
        ({"gsd_mm": (1.0, 8.0)}, "`gsd_mm` 1 8: .*'phantom4pro' covers 1.37 mm from 5 m, .*between 1.38 and 13.3 mm"),
        ({"gsd_mm": (2.0, 14.0)}, "`gsd_mm` 2 14: .* covers 13.3 mm from 48.5 m, .*defects are seen"),
        ({"camera": "paper"}, "`gsd_mm` 1.5 12: .*'paper' covers 6.08 mm"),
        ({"size_px": (6000, 640)}, "`size_px` 6000x640: more than the 5472x3648 pixels"),
        ({"altitudes_m": (10.0,)}, "`gsd_mm`: the ground resolution decides the altitude"),
        ({"platforms": ("car",)}, "`gsd_mm`: a car does not fly"),
    ],
)
def test_what_the_camera_cannot_reach_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(PaveTwinError, match=message) as error:
        check(CROPS.model_copy(update=changes))
    assert "\n" not in str(error.value)
