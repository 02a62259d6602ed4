"""Views that the training device draws are those that a processor draws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pavetwin.errors import PaveTwinError
from pavetwin.perception.examples.coco import read_coco
from pavetwin.perception.examples.example import ExampleSet
from pavetwin.perception.training.augment import Member, ViewOptions, planned_view, random_view
from pavetwin.perception.training.batches import TrainingViews, batches
from pavetwin.perception.training.device_pictures import (
    DevicePictures,
    Drawing,
    drawing_of,
    drawn_together,
    images_of,
    room_of,
)
from pavetwin.perception.training.options import TrainingMachine
from scenes.drawn_roads import drawn_roads

CPU = torch.device("cpu")
STILL = {"hue": 0.0, "saturation": 0.0, "brightness": 0.0}
VARIED = {
    "whole": ViewOptions(96, mosaic=0, scale=0, mirror=0, **STILL),
    "scaled": ViewOptions(96, mosaic=0, scale=0.5, **STILL),
    "native": ViewOptions(64, native=True, mosaic=0, scale=0.5, upside_down=0.5, **STILL),
    "mosaic": ViewOptions(96, mosaic=1, scale=0.5, upside_down=0.5, **STILL),
    "colours": ViewOptions(96, mosaic=0.5, scale=0.5, upside_down=0.5),
}


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> list[Member]:
    """Pictures of two datasets and of two sizes."""
    found: list[Member] = []
    for name, size in (("small", (96, 72)), ("large", (160, 160))):
        folder = tmp_path_factory.mktemp(name)
        data = read_coco(drawn_roads(folder, {"train": 4}, size, names=("Pothole", "Single Crack")), ("train",))
        found += [(data, example) for example in data.examples]
    return found


@pytest.mark.parametrize("name", VARIED)
def test_the_device_draws_what_a_processor_draws(roads: list[Member], name: str) -> None:
    pictures, options = DevicePictures(roads, CPU), VARIED[name]
    drawings, wanted = [], []
    for seed in range(16):
        member = roads[seed % len(roads)]
        plan = planned_view(member, roads, options, np.random.default_rng(seed))
        drawings.append(drawing_of(plan, pictures.rows, options.size_px))
        wanted.append(random_view(member, roads, options, np.random.default_rng(seed)).pixels.transpose(2, 0, 1))
    drawn = 255 * pictures.draw(drawn_together(drawings)).numpy()
    apart = np.abs(drawn - np.stack(wanted))
    # Pillow rounds twice to whole numbers, and once more where colours vary.
    assert apart.max() <= (4.0 if name == "colours" else 1.1)
    assert apart.mean() < 0.7


def test_single_views_are_as_in_a_batch(roads: list[Member]) -> None:
    pictures, options = DevicePictures(roads, CPU), VARIED["mosaic"]
    plans = [planned_view(roads[0], roads, options, np.random.default_rng(seed)) for seed in range(3)]
    drawings = [drawing_of(plan, pictures.rows, options.size_px) for plan in plans]
    together = pictures.draw(drawn_together(drawings))
    for at, each in enumerate(drawings):
        torch.testing.assert_close(pictures.draw(each)[0], together[at], atol=1e-5, rtol=0)


def test_batches_have_the_same_labels_and_the_same_images(roads: list[Member]) -> None:
    known = {"drawn roads": frozenset({0, 1, 2})}
    pictures, options = DevicePictures(roads, CPU), VARIED["mosaic"]
    views = TrainingViews(roads, range(8), known, options, 28, (3, 0, 1))
    (plain,) = batches(views, 8)
    views = TrainingViews(roads, range(8), known, options, 28, (3, 0, 1), held=pictures.rows)
    for workers in (0, 2):
        (drawn,) = batches(views, 8, workers=workers)
        assert isinstance(drawn.images, Drawing)
        assert torch.equal(drawn.targets.boxes, plain.targets.boxes)
        assert torch.equal(drawn.targets.masks, plain.targets.masks)
        shown = images_of(drawn.images, CPU, pictures)
        torch.testing.assert_close(shown, images_of(plain.images, CPU), atol=1.1 / 255, rtol=0)


def test_pictures_take_a_byte_for_each_colour_of_a_pixel(roads: list[Member]) -> None:
    assert room_of(roads) == 4 * 3 * (96 * 72 + 160 * 160)


def test_a_picture_that_cannot_be_read_is_named(roads: list[Member], tmp_path: Path) -> None:
    _, example = roads[0]
    lost = replace(example, place="lost.png")
    with pytest.raises(PaveTwinError, match=example.name):
        DevicePictures([(ExampleSet(tmp_path, "", (lost,)), lost)], CPU)


def test_another_place_for_views_is_refused() -> None:
    with pytest.raises(PaveTwinError, match="device"):
        TrainingMachine(views="devise")
