"""A crossing with defects and datasets of it, drawn by a painter."""

from pathlib import Path

import pytest
from pycocotools.coco import COCO

from pavetwin.capture.record import Record, read_records
from pavetwin.capture.run import capture
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.folders import contents
from scenes.painter import FEW, SPLITS, UAV, Painter


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("capture") / "cross"
    save_world(damaged("cross", 12), folder)
    return folder


@pytest.fixture(scope="session")
def dataset(world: Path) -> Path:
    folder = world.parent / "dataset"
    capture(world, UAV, folder, frame_source_factory=Painter)
    return folder


@pytest.fixture(scope="session")
def few(world: Path) -> dict[str, bytes]:
    """The contents of a dataset of few images, to compare with what interruptions leave."""
    folder = world.parent / "few"
    capture(world, FEW, folder, frame_source_factory=Painter)
    return contents(folder)


@pytest.fixture(scope="session")
def records(dataset: Path) -> list[Record]:
    return list(read_records(dataset))


@pytest.fixture(scope="session")
def cocos(dataset: Path) -> dict[str, COCO]:
    return {split: COCO(str(dataset / "annotations" / f"instances_{split}.json")) for split in SPLITS}
