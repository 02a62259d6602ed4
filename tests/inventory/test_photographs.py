"""The inventory of a folder of photographs, whose places are known from what they say of themselves."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import Entry
from pavetwin.inventory.files import write_inventory
from pavetwin.inventory.of_photographs import photographed
from pavetwin.inventory.reading import Reading, entries_of, has_sizes
from pavetwin.perception.detector import Detector
from pavetwin.perception.model_file import DEFAULT
from pavetwin.perception.photograph import PhotographPose, pose_of
from pavetwin.world.georeference import from_wgs84
from scenes.aerial import aerial_photograph
from scenes.spots import SpotDetector
from scenes.survey import ALTITUDE_M, PLACE, SPOTS, captures, photograph, photographs

DEFECTS = [(name, shape) for name, shape in SPOTS if name != "car"]


def world_xy(entry: Entry, reading: Reading) -> np.ndarray:
    assert entry.place is not None
    assert reading.frame is not None
    return from_wgs84(PLACE, reading.frame.to_wgs84((entry.place.x, entry.place.y)))


def test_each_defect_is_listed_once_at_its_place_with_its_size(tmp_path: Path) -> None:
    """The error of the places is that of EXIF's digits, of the rolled-off heading and of the pixels."""
    reading = photographed(SpotDetector(), photographs(tmp_path / "p"))
    assert reading.remarks == ()
    found = entries_of(reading)
    assert sorted(entry.class_name for entry in found) == sorted(name for name, _ in DEFECTS)
    for name, shape in DEFECTS:
        centre = np.array([shape.centroid.x, shape.centroid.y])
        away_m = [float(np.hypot(*(world_xy(entry, reading) - centre))) for entry in found]
        nearest = found[int(np.argmin(away_m))]
        assert nearest.class_name == name
        assert min(away_m) < 0.05
        assert nearest.sizes["area_m2"].value == pytest.approx(shape.area, rel=0.06)
        assert nearest.looks > 1
        assert nearest.place_error_m is not None
        assert nearest.place_error_m < 0.05
    crack = next(entry for entry in found if entry.class_name == "single_crack")
    assert crack.sizes["length_m"].value == pytest.approx(2.0, rel=0.1)


def test_one_without_exif_among_others_is_told_and_the_rest_goes_on(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "p")
    Image.fromarray(captures()[1].image()).save(folder / "bare.png")
    (folder / "broken.jpg").write_bytes(b"no picture")
    reading = photographed(SpotDetector(), folder)
    bare, broken = reading.remarks
    assert bare.startswith("1 of 6 photographs, such as 'bare.png': no position; its defects are given in pixels")
    assert bare.endswith(", sizes with `gsd_mm` only.")
    assert broken.startswith("Left out: 1 that cannot be read, such as this: ")
    found = entries_of(reading)
    assert sum(entry.place is not None for entry in found) == len(DEFECTS)
    assert all(entry.best.image[0] == "bare.png" and not entry.sizes for entry in found if entry.place is None)


def written(folder: Path, name: str = "one.jpg", **said: Any) -> Path:
    folder.mkdir(exist_ok=True)
    picture = Image.fromarray(captures()[1].image()).resize((640, 480), Image.Resampling.NEAREST)
    (folder / name).write_bytes(aerial_photograph(picture, **said))
    return folder


@pytest.mark.parametrize(
    ("dji", "words"),
    [
        ({"GimbalPitchDegree": -20.0}, "the gimbal looks more than 30° from straight down"),
        ({"GimbalPitchDegree": -170.0}, "the gimbal looks more than 30° from straight down"),
        ({"RelativeAltitude": 0.0}, "a height above the ground of 0 m or less; give it by `height_m`, sizes with"),
        ({"RelativeAltitude": -3.0}, "a height above the ground of 0 m or less; give it by `height_m`, sizes with"),
        ({"orientation": 6}, "stored turned (EXIF Orientation), so that its direction of view is not known; give it"),
        ({"latitude": 88.0}, "a position beyond 84° north or 80° south"),
        (
            {"RelativeAltitude": 431.0},
            "no height above the ground but one above the sea, or none; give it by `height_m`",
        ),
    ],
)
def test_what_a_place_needs_and_a_photograph_does_not_say_is_told(
    tmp_path: Path, dji: dict[str, float], words: str
) -> None:
    reading = photographed(SpotDetector(), written(tmp_path / "p", **dji))
    (remark,) = reading.remarks
    assert remark.startswith(f"1 of 1 photographs, such as 'one.jpg': {words}")
    assert reading.frame is None
    assert len(reading.detections)
    assert all(footprint is None for footprint in reading.detections.footprint)


def test_a_height_that_is_given_counts_for_more_than_what_photographs_say(tmp_path: Path) -> None:
    reading = photographed(SpotDetector(), written(tmp_path / "p", RelativeAltitude=431.0), height_m=10.0)
    assert reading.remarks == ()
    assert all(footprint is not None for footprint in reading.detections.footprint)


def test_the_error_of_a_receiver_with_corrections_is_read(tmp_path: Path) -> None:
    folder = written(tmp_path / "p", RtkStdLon=0.02, RtkStdLat=0.03)
    errors = set(photographed(SpotDetector(), folder).detections.position_error_m)
    assert errors == {0.03}
    given_error = photographed(SpotDetector(), folder, position_error_m=1.5)
    assert set(given_error.detections.position_error_m) == {1.5}


def test_without_position_sizes_come_with_a_resolution_that_is_given(tmp_path: Path) -> None:
    folder = tmp_path / "p"
    folder.mkdir()
    Image.fromarray(captures()[1].image()).save(folder / "bare.png")
    gsd_mm = 1000 * captures()[1].ground_resolution_m
    reading = photographed(SpotDetector(), folder, gsd_mm=gsd_mm)
    assert [remark.partition(": ")[2] for remark in reading.remarks] == [
        "no position; its defects are given in pixels."
    ]
    whole = reading.detections[(reading.detections.class_name == "pothole") & ~reading.detections.is_cut]
    assert len(whole)
    areas = [shape.area for name, shape in DEFECTS if name == "pothole"]
    for area_m2 in whole.area_m2:
        assert min(abs(area_m2 / area - 1) for area in areas) < 0.06


def test_a_folder_without_a_picture_that_can_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.jpg").write_bytes(b"no picture")
    with pytest.raises(PaveTwinError, match="cannot be read as an image"):
        photographed(SpotDetector(), tmp_path)


@given(
    x=st.floats(0, 960),
    y=st.floats(0, 720),
    heading_deg=st.floats(-180, 360),
    pitch_deg=st.floats(-90, -60),
    height_m=st.floats(3, 120),
    lon=st.floats(-179, 179),
    lat=st.floats(-75, 75),
)
def test_from_pixel_to_the_earth_and_back(
    x: float, y: float, heading_deg: float, pitch_deg: float, height_m: float, lon: float, lat: float
) -> None:
    pose = PhotographPose((960, 720), (lon, lat), height_m, heading_deg, pitch_deg, 800.0)
    places = pose.lonlats(np.array([[x, y]]))
    assert places is not None
    back = pose.pixels(np.array(places))
    assert back is not None
    tolerance_px = 0.003 * 800 / height_m + 1e-6  # places are rounded to 10⁻⁸ degrees, about 1 mm
    assert back[0] == pytest.approx((x, y), abs=tolerance_px)


def test_a_photograph_lies_where_the_view_that_took_it_looks(tmp_path: Path) -> None:
    """Two independent ways from a pixel to the ground: the renderer's camera, and what is written into the file."""
    frame = captures()[2]
    (tmp_path / "one.png").write_bytes(photograph(frame))
    with Image.open(tmp_path / "one.png") as held:
        pose = pose_of(held)
    corners = np.array([[0.0, 0.0], [960.0, 0.0], [960.0, 720.0], [0.0, 720.0], [480.0, 360.0]])
    places = pose.lonlats(corners)
    assert places is not None
    assert from_wgs84(PLACE, places) == pytest.approx(frame.view.ground(corners), abs=0.02)
    assert pose.height_m == ALTITUDE_M


def test_real_photographs_without_position_are_listed_in_pixels(shared_file: Callable[[str], Path]) -> None:
    """Of drones, 512 px across; nothing is known of where and from how high."""
    folder = shared_file("real/uapd_samples/Sample images")
    detector = Detector(DEFAULT)
    reading = photographed(detector, folder)
    (remark,) = reading.remarks
    count = len(list(folder.glob("*.JPG")))
    assert remark.startswith(f"{count} of {count} photographs, such as '")
    assert remark.endswith("no position; its defects are given in pixels, sizes with `gsd_mm` only.")
    assert reading.images == count
    assert len(reading.detections)
    assert not np.isnan(reading.detections.box_px).any()
    assert not has_sizes(reading.detections)
    sized = photographed(detector, folder, gsd_mm=2.5)
    assert len(sized.detections) == len(reading.detections)
    assert has_sizes(sized.detections)


@pytest.mark.parametrize("where", ["inventory", ".", "results/monday"])
def test_pictures_that_an_inventory_wrote_are_no_photographs(tmp_path: Path, where: str) -> None:
    folder = photographs(tmp_path / "p")
    output = folder / where
    first = photographed(SpotDetector(), folder, output=output)
    assert first.frame is not None
    write_inventory(entries_of(first), first, output)
    assert list(output.glob("crops/*.jpg"))
    assert list(output.glob("crops-*.jpg"))
    assert photographed(SpotDetector(), folder).images == first.images
    Image.new("RGB", (64, 64)).save(output / "photograph.png")
    assert photographed(SpotDetector(), folder).images == first.images + 1, "what else lies there is looked at"
    (output / "inventory.csv").unlink()
    if where != ".":
        assert photographed(SpotDetector(), folder, output=output).images == first.images, "one that was interrupted"


def test_an_inventory_that_is_replaced_leaves_nothing_behind(tmp_path: Path) -> None:
    reading = photographed(SpotDetector(), photographs(tmp_path / "p"))
    entries = [replace(entry, number=number) for number, entry in enumerate(entries_of(reading) * 9, 1)]
    folder = tmp_path / "inventory"
    folder.mkdir()
    (folder / "crops-plan.txt").write_text("mine")
    write_inventory(entries, reading, folder)
    assert len(list(folder.glob("crops-*.jpg"))) == 2
    write_inventory(entries[:3], reading, folder)
    assert sorted(path.name for path in folder.glob("crops*/*")) == ["0001.jpg", "0002.jpg", "0003.jpg"]
    assert sorted(path.name for path in folder.glob("crops-*")) == ["crops-01.jpg", "crops-plan.txt"]
    write_inventory([], replace(reading, frame=None), folder)
    assert sorted(path.name for path in folder.iterdir()) == ["crops", "crops-plan.txt", "inventory.csv"]


@pytest.mark.parametrize("said", [{"AbsoluteAltitude": 12.3}, {"above_sea_m": 11.7}])
def test_a_height_that_is_the_one_above_the_sea_is_told(tmp_path: Path, said: dict[str, float]) -> None:
    folder = written(tmp_path / "p", RelativeAltitude=12.0, **said)
    reading = photographed(SpotDetector(), folder)
    (remark,) = reading.remarks
    assert "'one.jpg': the same height above the ground as above the sea" in remark
    assert all(footprint is not None for footprint in reading.detections.footprint), "the ground may lie at sea level"
    assert photographed(SpotDetector(), folder, height_m=10.0).remarks == ()
    for other in ({"AbsoluteAltitude": 43.0}, {"above_sea_m": -12.0}):
        assert photographed(SpotDetector(), written(tmp_path / "p", RelativeAltitude=12.0, **other)).remarks == ()


def test_a_photograph_far_from_the_others_is_told_and_the_rest_goes_on(tmp_path: Path) -> None:
    """Whether it comes first or last; the others are where they are without it."""
    folder = written(tmp_path / "p", "b.jpg")
    written(folder, "c.jpg", latitude=52.5003)
    alone = photographed(SpotDetector(), folder).detections[[0]]
    for name, latitude in (("a.jpg", 17.0), ("d.jpg", 88.0)):
        written(folder, name, latitude=latitude)
    reading = photographed(SpotDetector(), folder)
    assert [remark.partition(";")[0] for remark in reading.remarks] == [
        "1 of 4 photographs, such as 'a.jpg': taken more than 20 km from the middle of all positions",
        "1 of 4 photographs, such as 'd.jpg': a position beyond 84° north or 80° south, where no map in metres is",
    ]
    placed = {
        image for image, outline in zip(reading.detections.image, reading.detections.footprint, strict=True) if outline
    }
    assert placed == {"b.jpg", "c.jpg"}
    same = reading.detections[reading.detections.image == alone.image[0]][[0]]
    assert same.footprint == alone.footprint
