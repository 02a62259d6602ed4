"""`pavetwin capture` and `fly --save-frames` as a user types them, and one dataset by the real renderer."""

import json
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import ExifTags, Image

from pavetwin.capture.context import prepare
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.mission_frames import frame_size, save_frames
from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.platforms import PLATFORMS, Platform, Pose
from pavetwin.capture.record import read_records
from pavetwin.capture.settings import CaptureSettings, description
from pavetwin.capture.sheets import pose_text
from pavetwin.cli.capture import show, stats
from pavetwin.errors import PaveTwinError
from pavetwin.labels.rle import decode
from pavetwin.mission.replay import Replay
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import detections_geojson, save_mission
from pavetwin.mission.versions import software_versions
from pavetwin.render.adapter import find_adapter
from pavetwin.render.frame import Exposure, RenderedFrame
from pavetwin.scene.values import defect_label
from pavetwin.scene.view import View
from pavetwin.world.model import Defect
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.command_line import pavetwin, pavetwin_process, plain_refusal
from scenes.recordings import recording
from scenes.tiny import empty_street


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("capture-cli") / "cross"
    save_world(damaged("cross", 6), folder)
    return folder


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--images", "0"), "--images 0: it must be greater than or equal to 1."),
        (("--altitude", "6", "--altitude", "-3"), "--altitude -3: the UAV flies at 5 m or higher"),
        (("--seed", "-1"), "--seed -1: it must be greater than or equal to 0."),
        (("--quality", "30"), "--quality 30: it must be greater than or equal to 50."),
        (("--size", "640"), "--size 640: expected WIDTHxHEIGHT"),
        (("--size", "20x20"), "--size 20x20: it must be greater than or equal to 64 (got 20)."),
        (("--split", "70/30"), "--split 70/30: expected the percentages of train/val/test"),
        (("--split", "70/20/20"), "--split 70/20/20: the shares of train, val and test sum to 1.1, not to 1."),
        (("--empty", "2"), "--empty 2: it must be less than or equal to 1."),
        (("--platform", "boat"), "--platform: no platform 'boat'"),
        (("--platform", "car", "--altitude", "6"), "--altitude: a car does not fly"),
        (("--platform", "car", "--camera", "paper"), "--camera: a car has cameras of its own"),
        (("--density", "heigh"), "--density: no density 'heigh' (did you mean 'high'?)"),
        (("--density", "extreme"), "--density: no density 'extreme'; known are low, medium, high, los-A"),
        (("--camera", "phantom5"), "--camera: no camera 'phantom5'"),
        (("--style", "variedd"), "--style: no street style 'variedd' (did you mean 'varied'?)"),
        (("--formats", "yolo,cocoo"), "--formats: no label format 'cocoo' (did you mean 'coco'?)"),
        (("--parking", "few"), "--parking: expected a share of the places (0 to 1), by-time, or none, not 'few'."),
        (("--parking", "1.2"), "--parking: expected a share of the places"),
        (("--jobs", "0"), "--jobs 0: at least one"),
        (("--altitude", "2"), "--altitude 2: the UAV flies at 5 m or higher, 1 m clear of vehicles of up to 4 m"),
        (
            ("--altitude", "10", "--altitude", "3000"),
            "--altitude 3000: the UAV flies at 120 m or lower, the legal ceiling",
        ),
        (
            ("--altitude", "10", "--altitude", "20"),
            "--altitude 20: images are to show defects",
        ),
        (("--altitude", "10", "--altitude", "20"), "choose a lower altitude, or images that show none (--empty 1)."),
    ],
)
def test_wrong_options_are_refused_and_leave_nothing(
    world: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    _needs_an_adapter()
    assert words in plain_refusal(pavetwin("capture", world, "-o", tmp_path / "d", *options))
    assert not (tmp_path / "d").exists()


def test_an_error_in_a_street_style_comes_before_the_search_for_traffic(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    style = tmp_path / "mine.yaml"
    style.write_text("title: mine\nmain: {tarmac: 1}\n")
    monkeypatch.setattr("pavetwin.capture.context.record", lambda *_, **__: pytest.fail("traffic is recorded"))
    settings = CaptureSettings(platforms=("car",), images=1, style=str(style))
    with pytest.raises(PaveTwinError, match=r"^`style`: street style '.*mine\.yaml', line \d: [^\n]*$"):
        prepare(load_world(world), settings)


@pytest.fixture
def glider() -> Iterator[None]:
    class Glider(Platform):
        uses_altitude = True

        def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose | None:  # noqa: ARG002 - of the class
            return None

    PLATFORMS.add("glider", Glider)
    yield
    PLATFORMS.restore("glider", None)


@pytest.mark.usefixtures("glider")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--camera", "phantom5"), "--camera: no camera 'phantom5'"),
        (("--jobs", "0"), "--jobs 0: at least one"),
        (("--altitude", "3000"), "--altitude 3000: the UAV flies at 120 m or lower"),
    ],
)
def test_a_platform_of_ones_own_takes_altitudes_and_a_camera_where_it_flies(
    world: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    _needs_an_adapter()
    arguments = ("capture", world, "-o", tmp_path / "d", "--platform", "car,glider", *options)
    assert words in plain_refusal(pavetwin(*arguments))


@pytest.mark.usefixtures("glider")
@pytest.mark.parametrize(
    ("platform", "text"), [("glider", "7.5 m, tilted 30°"), ("uav", "7.5 m, tilted 30°"), ("car", "eye"), ("?", "eye")]
)
def test_a_contact_sheet_states_the_altitude(platform: str, text: str) -> None:
    assert pose_text({"platform": platform, "altitude_m": 7.5, "pitch_deg": -60.0, "mount": "eye"}) == text


@pytest.mark.needs_adapter
def test_a_dataset_of_another_format_is_refused(world: Path, tmp_path: Path) -> None:
    folder = tmp_path / "d"
    (folder / "images").mkdir(parents=True)
    begun = description(
        CaptureSettings(platforms=("uav",), images=1, altitudes_m=(8.0,)),
        load_world(world),
        software_versions(images=True),
    )
    (folder / "capture.yaml").write_text(yaml.safe_dump(begun | {"format": 6}), encoding="utf-8")
    for command in (("capture", world, "-o", folder, "--images", 2), ("capture", "stats", folder)):
        reported = plain_refusal(pavetwin(*command))
        assert "has format 6; this version reads only format 1" in reported


def test_a_folder_that_holds_something_else_is_refused(world: Path, tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    assert "exists and holds no dataset" in plain_refusal(pavetwin("capture", world, "-o", tmp_path))
    assert "holds no dataset" in plain_refusal(pavetwin("capture", "show", tmp_path))
    assert "--images 0: it must be" in plain_refusal(pavetwin("capture", world, "-o", tmp_path / "d", "--images", 0))
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.slow
def test_a_dataset_by_the_real_renderer(world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its boxes are tight, its shares are shares, its pictures show something, and it can be shown and counted."""
    _needs_an_adapter()
    options = ("--images", 2, "--size", "160x160", "--altitude", 6, "--density", "low", "--seed", 2)
    done = pavetwin("capture", world, "-o", tmp_path / "d", *options)
    assert done.returncode == 0, done.stderr
    assert "2 images taken" in done.stdout
    # A slow machine prints a line again.
    assert [line for line in dict.fromkeys(done.stderr.splitlines()) if line.startswith("Taking")] == [
        f"Taking images {n}/2 ({50 * n}%)" for n in (1, 2)
    ]
    records = list(read_records(tmp_path / "d"))
    assert [record.index for record in records] == [0, 1]
    assert all(re.fullmatch(r"cross-s2-uav-[0-9a-f]{8}-00000\d", record.name) for record in records)
    objects = [(record, obj) for record in records for obj in record.objects]
    assert objects
    for record, obj in objects:
        rows, columns = np.nonzero(decode(obj.mask, (160, 160)))
        assert obj.box == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        assert 0 < obj.visible_fraction <= 1
        assert obj.area_px <= obj.amodal_px
        with Image.open(tmp_path / "d" / record.image) as image:
            assert np.asarray(image).std() > 5
    stats(tmp_path / "d")
    show(tmp_path / "d")
    printed = capsys.readouterr().out
    labelled = {obj.category for _, obj in objects if obj.ignored is None}
    assert labelled
    assert all(category in printed for category in labelled)
    assert "without defects" in printed
    assert "2 images on" in printed
    assert (tmp_path / "d" / "contact-sheet.png").is_file()


def test_without_an_adapter_the_package_is_named(world: Path, tmp_path: Path) -> None:
    blind = {"env": {**os.environ, "VK_DRIVER_FILES": "/dev/null"}}
    done = pavetwin_process("capture", world, "-o", tmp_path / "d", "--images", 1, **blind)
    assert "mesa-vulkan-drivers" in plain_refusal(done)
    assert not (tmp_path / "d").exists()
    result = pavetwin_process("fly", world, "--segments", 1, "--save-frames", "hits", "-o", tmp_path / "m", **blind)
    assert "mesa-vulkan-drivers" in plain_refusal(result)
    assert not (tmp_path / "m").exists()


def test_a_group_without_a_command_prints_its_help_and_asks_for_one() -> None:
    for group in ("capture", "world"):
        done = pavetwin(group)
        assert done.returncode == 2
        assert "Usage:" in done.stdout
        assert done.stderr == "Error: Choose one of these commands.\n"


# --- Frames of a mission --------------------------------------------------------------------------------------------


FAR_OFF = recording(("suv",), lambda *_: (500.0, 500.0, 0.0, 0.0), frames=600)
"""Traffic that no frame shows."""


class Polaroid:
    """A scene renderer whose images show a box a defect and nothing else, and that records its requests."""

    def __init__(self, defects: Sequence[Defect]) -> None:
        self.defects = defects
        self.views: list[tuple[View, float]] = []

    def picture(self, view: View, *asked: object, **_: object) -> RenderedFrame:
        time_s = asked[-1]
        assert isinstance(time_s, float)
        self.views.append((view, time_s))
        size = (view.size_px[1], view.size_px[0])
        labels = np.zeros(size, np.uint32)
        rgb = np.random.default_rng(0).integers(88, 93, (*size, 3), np.uint8)
        defect_free = rgb.copy()
        for defect in self.defects:
            left, top, right, bottom = self.box(view, defect)
            labels[top:bottom, left:right] = defect_label(defect.id)
            rgb[top:bottom, left:right] = 20
        alone = {int(label): int((labels == label).sum()) for label in np.unique(labels) if label}
        return RenderedFrame(view, rgb, None, labels, alone, Exposure(1e-3, 2.8, 100), defect_free)

    @staticmethod
    def box(view: View, defect: Defect) -> tuple[int, int, int, int]:
        """40 pixels around the middle, as far as they are in the picture."""
        column, row = np.round(view.project((defect.centre.x, defect.centre.y, 0.0))).astype(int).tolist()
        (left, right), (top, bottom) = (
            np.clip([middle - 20, middle + 20], 0, size).tolist()
            for middle, size in zip((column, row), view.size_px, strict=True)
        )
        return left, top, right, bottom


def images_by(scene_renderer: Polaroid, result: MissionResult, start_s: float = 0.0) -> MissionImages:
    """The images of a mission that took off at a time of `FAR_OFF`, by a scene renderer of ours."""
    replay = Replay(result.environment.world, FAR_OFF, start_s=start_s)
    images = MissionImages(result.environment.inspected_world, replay, result.seed)
    images.scene_renderer = scene_renderer
    return images


def test_the_frames_of_a_mission_show_where_each_defect_was_confirmed(tmp_path: Path) -> None:
    result = empty_street((20, 1), (20.4, -1), (45, 1)).fly("baseline")
    assert len(result.detections) == 3
    scene_renderer = Polaroid(result.environment.defects)
    save_mission(result, tmp_path / "m")
    taken = save_frames(result, images_by(scene_renderer, result), tmp_path / "m")
    content = json.loads((tmp_path / "m" / "captures.geojson").read_text())
    named = {feature["properties"]["frame"] for feature in content["features"]}
    taken_files = (tmp_path / "m").glob("frames/images/test/*.jpg")
    assert {str(path.relative_to(tmp_path / "m")) for path in taken_files} == named
    assert taken == len(named) == len(scene_renderer.views) == len(set(result.detections.time_s))
    for view, time_s in scene_renderer.views:
        here = result.detections[result.detections.time_s == time_s]
        assert tuple(view.position) == (*result.log.frames[int(here.capture[0])].position, 6.0)
        for defect in here.defect:
            centre = result.environment.defects[defect].centre
            pixel = view.project((centre.x, centre.y, 0.0))
            assert ((pixel > 0) & (pixel < view.size_px)).all()
    with Image.open(tmp_path / "m" / content["features"][0]["properties"]["frame"]) as image:
        gps = image.getexif().get_ifd(ExifTags.IFD.GPSInfo)
    lat, lon = (sum(float(part) / 60**k for k, part in enumerate(gps[tag])) for tag in (2, 4))
    first = content["features"][0]["properties"]
    assert (lon, lat) == pytest.approx((first["camera_longitude"], first["camera_latitude"]), abs=1e-7)


def test_the_frames_of_a_mission_are_labelled_as_a_dataset_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = empty_street((20, 1), (20.4, -1), (45, 1)).fly("baseline")
    scene_renderer = Polaroid(result.environment.defects)
    save_mission(result, tmp_path / "m")
    taken = save_frames(result, images_by(scene_renderer, result), tmp_path / "m")
    frames = tmp_path / "m" / "frames"
    confirmed = []
    for record, (view, _) in zip(read_records(frames), scene_renderer.views, strict=True):
        seen = {obj.id: obj for obj in record.labelled}
        for name in record.aim["confirmed"]:
            defect = result.environment.defects[int(name.removeprefix("defect "))]
            assert seen[name].box == Polaroid.box(view, defect)
            confirmed.append(name)
        assert len((frames / "labels" / "test" / f"{record.name}.txt").read_text().splitlines()) == len(seen)
        assert (frames / "voc" / "JPEGImages" / f"{record.name}.jpg").is_file()
    assert sorted(confirmed) == sorted(f"defect {defect}" for defect in result.detections.defect)
    coco = json.loads((frames / "annotations" / "instances_test.json").read_text())
    assert len(coco["images"]) == taken
    keys = yaml.safe_load((frames / "data.yaml").read_text())
    assert (keys["train"], keys["val"], keys["test"]) == (None, None, "images/test")  # Ultralytics asks for all of them
    show(frames)
    stats(frames)
    assert f"{taken} images on {frames}/contact-sheet.png" in capsys.readouterr().out.replace("\n", "")


def test_frames_show_the_traffic_of_a_mission_that_took_off_later_in_the_recording(tmp_path: Path) -> None:
    result = empty_street((20, 1)).fly("baseline")
    scene_renderer = Polaroid(result.environment.defects)
    save_mission(result, tmp_path / "m")
    assert save_frames(result, images_by(scene_renderer, result, start_s=30.0), tmp_path / "m") == 1
    ((_, time_s),) = scene_renderer.views
    assert time_s == pytest.approx(30.0 + result.detections.time_s[0])
    (record,) = read_records(tmp_path / "m" / "frames")
    assert record.traffic["time_s"] == pytest.approx(time_s, abs=1e-4)


def test_frames_of_all_captures_name_theirs(tmp_path: Path) -> None:
    result = empty_street((20, 1)).fly("baseline")
    save_mission(result, tmp_path / "m")
    scene_renderer = Polaroid(result.environment.defects)
    taken = save_frames(result, images_by(scene_renderer, result), tmp_path / "m", every=True)
    assert taken == len(result.captures["t_s"]) == len(scene_renderer.views)
    frames = tmp_path / "m" / "frames"
    captures, images = zip(*(line.split(",") for line in (frames / "captures.csv").read_text().split()), strict=True)
    assert captures == ("capture", *map(str, range(taken)))
    assert all((frames / name).is_file() for name in images[1:])
    places = zip(result.captures["t_s"], result.captures["x_m"], strict=True)
    assert [(time_s, view.position[0]) for view, time_s in scene_renderer.views] == list(places)
    (feature,) = json.loads((tmp_path / "m" / "captures.geojson").read_text())["features"]
    assert feature["properties"]["frame"] == f"frames/{images[1 + feature['properties']['capture']]}"


def test_a_mission_that_found_nothing_has_no_frames(tmp_path: Path) -> None:
    result = empty_street().fly("baseline")
    save_mission(result, tmp_path / "m")
    assert save_frames(result, images_by(Polaroid(()), result), tmp_path / "m") == 0
    assert not list((tmp_path / "m" / "frames").iterdir())


def test_without_frames_a_mission_names_none(tmp_path: Path) -> None:
    result = empty_street((20, 1)).fly("baseline")
    assert all("frame" not in feature["properties"] for feature in detections_geojson(result)["features"])
    save_mission(result, tmp_path / "m")
    assert not (tmp_path / "m" / "frames").exists()


def test_a_camera_of_many_pixels_is_drawn_with_fewer() -> None:
    assert frame_size((1270, 950)) == (1270, 950)
    assert frame_size((5472, 3648)) == (2048, 1365)


def _needs_an_adapter() -> None:
    try:
        find_adapter()
    except PaveTwinError as error:
        pytest.skip(f"no adapter to draw with: {error}")
