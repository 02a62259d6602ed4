"""Datasets that are killed, find a full disk, or are continued with other settings."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image

from pavetwin.capture.images import bytes_of
from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.capture.settings import CaptureSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission import versions
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.folders import contents
from scenes.painter import FEW, UAV, Painter, full_disk, slow_painter


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
        ({"picture": "png"}, "begun with JPG images, not with PNG images;"),
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
