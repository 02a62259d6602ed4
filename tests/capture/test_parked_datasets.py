"""Datasets with parked vehicles: drawn and labelled in every image, the same each time, part of what a dataset is."""

import datetime as dt
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from pavetwin.capture.image_spec import DefectIndex, ImageSpec
from pavetwin.capture.platforms import CaptureContext, Platform, Pose
from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.capture.samples import ParkedBodies, draw_sample, platform_prefix, prefix
from pavetwin.capture.settings import FILE, CaptureSettings
from pavetwin.capture.truth import SceneState, labelled_objects
from pavetwin.config import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.errors import PaveTwinError
from pavetwin.labels.classes import category_of_defect
from pavetwin.plugins import plugin_hashes
from pavetwin.render.frame import RenderedFrame
from pavetwin.scene.values import parked_label
from pavetwin.scene.view import View, look
from pavetwin.traffic.parked import ParkedVehicles, parked_vehicles
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.folders import contents
from scenes.painter import Painter
from scenes.parking import kerb_place, with_places
from scenes.tiny import CAR, defect, parked, straight, trace_of

NONE, HALF, FULL = ParkingSettings(enabled=False), ParkingSettings(occupancy=0.5), ParkingSettings(occupancy=1.0)
PARKED = CaptureSettings(
    platforms=("uav",),
    images=10,
    altitudes_m=(8.0,),
    densities=("medium",),
    seed=3,
    size_px=(320, 320),
    formats=("yolo",),
    parking=FULL,
)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = damaged("cross", 12)
    assert len(made.world.parking) > 10
    folder = tmp_path_factory.mktemp("capture") / "cross"
    save_world(made, folder)
    return folder


@pytest.fixture(scope="module")
def dataset(world: Path) -> Path:
    folder = world.parent / "parked"
    capture(world, PARKED, folder, frame_source_factory=Painter)
    return folder


@pytest.fixture(scope="module")
def records(dataset: Path) -> list[Record]:
    return list(read_records(dataset))


def test_truth_says_who_is_parked_and_where(world: Path, records: list[Record]) -> None:
    places = load_world(world).parking
    cars = [obj for record in records for obj in record.objects if obj.id.startswith("parked ")]
    assert len(cars) >= 5
    for car in cars:
        place = places[int(car.id.removeprefix("parked "))]
        assert (car.category, car.details["parked"], car.details["speed_mps"]) == ("Car", True, 0.0)
        assert car.details["place"] == place.id
        assert np.hypot(car.position_m[0] - place.centre.x, car.position_m[1] - place.centre.y) < 1.0
    moving = [obj for record in records for obj in record.objects if obj.id.startswith("agent ")]
    assert moving
    assert not any("parked" in obj.details for obj in moving)
    assert any(car.ignored is None for car in cars)


def test_a_smaller_dataset_is_the_beginning_of_a_larger_one(world: Path, dataset: Path, tmp_path: Path) -> None:
    capture(world, PARKED.model_copy(update={"images": 3}), tmp_path / "grown", frame_source_factory=Painter)
    assert capture(world, PARKED, tmp_path / "grown", frame_source_factory=Painter).taken == PARKED.images - 3
    assert contents(tmp_path / "grown") == contents(dataset)


def test_parking_is_part_of_a_name_where_there_is_any(world: Path) -> None:
    """Parking changes the names of images only where vehicles are parked."""
    loaded = load_world(world)

    def name(settings: ParkingSettings, of: World = loaded) -> str:
        return platform_prefix(of, PARKED.model_copy(update={"parking": settings}), "uav")

    others = {"images", "platforms", "formats", "plugins", "parking", "gsd_mm"}
    before = PARKED.model_dump(mode="json", exclude=others) | {"plugins": sorted(plugin_hashes(()).values())}
    assert name(NONE) == prefix(loaded, PARKED.seed, "uav", before)
    assert len({name(each) for each in (NONE, HALF, FULL, ParkingSettings(enabled=True))}) == 4
    nowhere = replace(loaded, parking=())
    assert name(FULL, nowhere) == name(NONE, nowhere)


@pytest.mark.parametrize(
    ("begun", "now", "words"),
    [
        (NONE, FULL, "begun with `parking` none, not with `parking` 1; give the same, or choose another folder"),
        (FULL, NONE, "begun with `parking` 1, not with `parking` none;"),
        (FULL, ParkingSettings(enabled=True), "begun with `parking` 1, not with `parking` by-time;"),
    ],
)
def test_a_dataset_with_other_parking_is_refused(
    world: Path, dataset: Path, tmp_path: Path, begun: ParkingSettings, now: ParkingSettings, words: str
) -> None:
    folder = begun_with(begun, dataset, tmp_path)
    with pytest.raises(PaveTwinError, match=words) as refused:
        capture(world, PARKED.model_copy(update={"parking": now}), folder, frame_source_factory=Painter)
    assert "\n" not in str(refused.value)


def begun_with(parking: ParkingSettings, dataset: Path, folder: Path) -> Path:
    """A folder with the settings of a dataset and one image."""
    content = yaml.safe_load((dataset / FILE).read_text())
    content["settings"] |= {"parking": parking.model_dump(mode="json"), "images": 10}
    (folder / FILE).write_text(yaml.safe_dump(content))
    (folder / "images").mkdir()
    return folder


# --- One street -----------------------------------------------------------------------------------------------------

STREET = with_places(replace(straight(), defects=(defect(0, 30, 2), defect(1, 45, 2))), kerb_place(30, 2))
MEDIUM = trace_of([parked(30, 2.5), parked(30, -2)], 1.0)
"""The first agent stands where a car is parked."""


def context(parking: ParkingSettings, world: World = STREET) -> CaptureContext:
    index = DefectIndex(world, {segment.street: "train" for segment in world.segments})
    settings = PARKED.model_copy(update={"parking": parking})
    return CaptureContext(world, settings, index, {}, {"medium": MEDIUM}, {})


def from_above(x: float, y: float) -> View:
    return look((x, y, 8.0), yaw_rad=0.0, pitch_rad=-np.pi / 2, size_px=(320, 320), vertical_fov_rad=np.pi / 4)


class Fixed(Platform):
    """Always the same pose: over a defect, or on a car."""

    x, ego = 30.0, None

    def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose:  # noqa: ARG002
        return Pose(from_above(self.x, 2.0), 0.5, 0.0, -np.pi / 2, find_camera("paper"), "test", ego=self.ego)


SPEC = ImageSpec("uav", 0, 0, "i", "train", (category_of_defect("pothole"),), "medium", 8.0, None, 0.5)


@pytest.mark.parametrize(("x", "parking", "found"), [(30.0, NONE, True), (30.0, FULL, False), (45.0, FULL, True)])
def test_an_image_does_not_aim_at_a_defect_below_a_parked_car(x: float, parking: ParkingSettings, found: bool) -> None:
    platform = Fixed(context(parking))
    platform.x = x
    assert (draw_sample(platform, SPEC, 0) is not None) is found


@pytest.mark.parametrize(("ego", "parking", "found"), [(0, NONE, True), (0, FULL, False), (1, FULL, True)])
def test_no_image_is_taken_from_a_car_that_stands_in_a_parked_one(
    ego: int, parking: ParkingSettings, found: bool
) -> None:
    platform = Fixed(context(parking))
    platform.x, platform.ego = 45.0, ego
    assert (draw_sample(platform, SPEC, 0) is not None) is found


def test_who_is_parked_follows_the_time_of_the_image() -> None:
    """Nobody stands in a loading bay in its hours; the draw of an image's date and time says which those are."""
    (place,) = STREET.parking
    bay = with_places(STREET, replace(place, closed="08:00-12:00"))
    taken = context(FULL, bay)
    assert [len(taken.parked(Conditions(time=dt.time(hour)), "medium")) for hour in (7, 9, 13)] == [1, 0, 1]
    assert len(context(NONE, bay).parked(Conditions(time=dt.time(7)), "medium")) == 0
    assert len(context(FULL, straight()).parked(Conditions(), "medium")) == 0


def test_an_image_parks_the_mix_of_its_traffic() -> None:
    row = with_places(STREET, *(kerb_place(10.0 + 6 * k, 2.0, name=f"p{k}") for k in range(8)))
    taken = context(FULL, row)
    kinds = {mix: set(taken.parked(Conditions(), mix).kind) for mix in ("medium", "medium+east_asia", "los-C")}
    assert "scooter" in kinds["medium+east_asia"]
    assert "scooter" not in kinds["medium"] == kinds["los-C"]


def test_outlines_are_those_of_the_vehicles() -> None:
    stands = parked_vehicles(STREET, FULL, Conditions(), 3)
    assert ParkedBodies.of(stands).covered(DefectIndex(STREET, {})).tolist() == [0]
    assert len(ParkedBodies.of(ParkedVehicles.empty()).covered(DefectIndex(STREET, {}))) == 0


def test_a_parked_vehicle_that_is_not_there_is_refused() -> None:
    stands = parked_vehicles(STREET, FULL, Conditions(), 3)
    labels = np.full((320, 320), parked_label(0), dtype=np.uint32)
    grey = np.zeros((320, 320, 3), dtype=np.uint8)
    frame = RenderedFrame(from_above(30, 2), grey, None, labels, {parked_label(0): 320**2}, defect_free=grey)
    (car,) = labelled_objects(frame, SceneState(STREET, MEDIUM.agents_at(0.5), ("suv", "suv"), stands))
    assert (car.id, car.details["kind"], car.details["length_m"]) == ("parked 0", stands.kind[0], stands.length_m[0])
    assert car.details["length_m"] != CAR.length_m
    with pytest.raises(ValueError, match="parked in place 0"):
        labelled_objects(frame, SceneState(STREET, MEDIUM.agents_at(0.5), ("suv", "suv")))
