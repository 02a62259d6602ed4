"""Views that the training device draws are those that a processor draws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet, read_coco
from pavetwin.training.trainer import pictures as pictures_module
from pavetwin.training.trainer.batches import TrainingViews, batches
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.pictures import (
    DevicePictures,
    Drawing,
    drawing_of,
    drawn_together,
    images_of,
    room_of,
)
from pavetwin.training.trainer.trainer import draws_views
from pavetwin.training.trainer.views import GREY, Member, ViewOptions, ViewPlan, fitted, planned_view, random_view
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


def test_what_is_out_of_the_canvas_is_not_drawn(roads: list[Member]) -> None:
    pictures, (data, example) = DevicePictures(roads, CPU), roads[0]
    shown, hidden = fitted(data, example, 64), replace(fitted(data, example, 64), left=500.0)
    plans = [ViewPlan((shown, hidden), None), ViewPlan((shown,), None), ViewPlan((hidden,), None)]
    both, one, none = (pictures.draw(drawing_of(plan, pictures.rows, 64))[0] for plan in plans)
    assert torch.equal(both, one)
    assert (none == GREY / 255).all()


def test_many_parts_are_drawn_in_little_room(roads: list[Member], monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, options = DevicePictures(roads, CPU), VARIED["mosaic"]
    plans = [planned_view(roads[0], roads, options, np.random.default_rng(seed)) for seed in range(4)]
    drawing = drawn_together([drawing_of(plan, pictures.rows, options.size_px) for plan in plans])
    whole, counts, resampled = pictures.draw(drawing), [], pictures._resampled
    monkeypatch.setattr(pictures_module, "WORKING_BYTES", 1_000_000)
    monkeypatch.setattr(
        pictures, "_resampled", lambda stack, parts, size: counts.append(len(parts)) or resampled(stack, parts, size)
    )
    torch.testing.assert_close(pictures.draw(drawing), whole, atol=1e-5, rtol=0)
    assert len(counts) > 2
    assert max(counts) < len(drawing.parts) / 2


def test_pictures_take_a_byte_for_each_colour_of_a_pixel(roads: list[Member]) -> None:
    assert room_of(roads, 96) == 4 * 3 * (96 * 72 + 160 * 160) + pictures_module.WORKING_BYTES
    assert room_of([], 96) == pictures_module.WORKING_BYTES


@pytest.mark.parametrize(
    ("views", "free_gb", "there"), [("", 80, True), ("", 6, False), ("processor", 80, False), ("device", 6, True)]
)
def test_a_graphics_card_that_has_room_draws(
    roads: list[Member],
    monkeypatch: pytest.MonkeyPatch,
    views: str,
    free_gb: float,
    *,
    there: bool,
) -> None:
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _: (int(free_gb * 1e9), int(80e9)))
    machine, options = TrainingMachine(views=views), TrainingOptions()
    assert draws_views(roads, options, machine, torch.device("cuda")) is there
    assert draws_views(roads, options, machine, CPU) is (views == "device")


def test_a_card_without_room_is_refused_where_it_is_asked_for(
    roads: list[Member], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _: (10**9, 10**10))
    with pytest.raises(PaveTwinError, match=r"take 2\.0 GB, and cuda has 1\.0 free; leave `views` out"):
        draws_views(roads, TrainingOptions(), TrainingMachine(views="device"), torch.device("cuda"))


def test_a_picture_that_cannot_be_read_is_named(roads: list[Member], tmp_path: Path) -> None:
    _, example = roads[0]
    lost = replace(example, place="lost.png")
    with pytest.raises(PaveTwinError, match=example.name):
        DevicePictures([(ExampleSet(tmp_path, "", (lost,)), lost)], CPU)
