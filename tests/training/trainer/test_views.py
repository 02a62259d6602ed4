"""What the network is shown: pictures and labels stay together, whatever is scaled, moved and mirrored."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import ROAD_DEFECT
from pavetwin.training.datasets.examples import Example, ExampleSet, read_coco
from pavetwin.training.trainer.batches import TrainingViews, ValidationViews, batches, collated, labelled
from pavetwin.training.trainer.pictures import HeldExampleSet
from pavetwin.training.trainer.views import (
    LabelledView,
    Member,
    ViewOptions,
    _turned,
    fitted,
    in_colours,
    mask_of,
    random_view,
    tiles,
    varied_colours,
    view_of,
)
from scenes.drawn_roads import drawn_roads

DARK = 70
"""Defects are drawn darker than this, the road brighter."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ExampleSet:
    folder = tmp_path_factory.mktemp("roads")
    return read_coco(drawn_roads(folder, {"train": 8}, names=("Pothole", "Single Crack")), ("train",))


def members(data: ExampleSet) -> list[Member]:
    return [(data, example) for example in data.examples]


def dark_box(view: LabelledView, inside: tuple[float, ...]) -> list[float]:
    """The box around the dark pixels near a labelled box."""
    left, top, right, bottom = (round(each) for each in inside)
    dark = (view.pixels.max(axis=2) < DARK)[top:bottom, left:right]
    rows, columns = np.flatnonzero(dark.any(1)), np.flatnonzero(dark.any(0))
    return [left + columns[0], top + rows[0], left + columns[-1] + 1, top + rows[-1] + 1]


PLAIN = ViewOptions(size_px=128, hue=0, saturation=0, brightness=0)
VARIED = {
    "mosaic": replace(PLAIN, mosaic=1.0, upside_down=0.5),
    "mirrored": replace(PLAIN, mosaic=0.0, mirror=1.0),
    "upside down": replace(PLAIN, mosaic=0.0, mirror=0.0, upside_down=1.0),
    "native": replace(PLAIN, size_px=96, mosaic=0.0, native=True),
}


@pytest.mark.parametrize("name", VARIED)
def test_boxes_lie_where_the_picture_shows_the_thing(data: ExampleSet, name: str) -> None:
    checked = 0
    for seed in range(30):
        view = random_view(members(data)[seed % 8], members(data), VARIED[name], np.random.default_rng(seed))
        for each in view.objects:
            if each.is_ignored or min(each.box[2] - each.box[0], each.box[3] - each.box[1]) < 8:
                continue
            assert dark_box(view, each.box) == pytest.approx(list(each.box), abs=2.6)
            checked += 1
    assert checked > 15


@pytest.mark.parametrize("name", VARIED)
def test_masks_lie_where_the_picture_shows_the_thing(data: ExampleSet, name: str) -> None:
    """Also of a crack from one corner to another, which no mirror image of it covers."""
    agreement = []
    for seed in range(20):
        view = random_view(members(data)[seed % 8], members(data), VARIED[name], np.random.default_rng(seed))
        dark = Image.fromarray(np.uint8(255 * (view.pixels.max(axis=2) < 90)))
        for each in view.objects:
            if each.is_ignored or min(each.box[2] - each.box[0], each.box[3] - each.box[1]) < 20:
                continue
            mask = mask_of(each, each.box, 14)
            shown = np.asarray(dark.resize((14, 14), Image.Resampling.BOX, box=each.box), dtype=np.float64)
            agreement.append(np.corrcoef(mask.ravel(), shown.ravel())[0, 1])
    assert len(agreement) > 4
    assert np.mean(agreement) > 0.8


def test_what_a_car_has_taken_stays_upright(data: ExampleSet) -> None:
    """And the rest of the view is the same."""
    other = replace(data, examples=tuple(replace(each, is_from_road=True) for each in data.examples))
    for seed in range(4):
        views = [
            random_view(members(each)[seed], members(each), VARIED["upside down"], np.random.default_rng(seed))
            for each in (data, other)
        ]
        assert (views[0].pixels[::-1] == views[1].pixels).all()
        assert views[0].pixels.std() > 1


def test_a_letterbox_shows_the_whole_image_in_the_middle(data: ExampleSet) -> None:
    """128 × 96 in 256 × 256: twice as large, 32 rows of grey above and below."""
    view = view_of([fitted(data, data.examples[0], 256)], 256)
    assert (view.pixels[:32] == 114).all()
    assert (view.pixels[-32:] == 114).all()
    assert (view.pixels[33:-33].std(axis=(0, 1)) > 3).all()
    for seen, true in zip(view.objects, data.examples[0].objects, strict=True):
        left, top, right, bottom = true.box
        assert seen.box == (2 * left, 2 * top + 32, 2 * right, 2 * bottom + 32)


def test_tiles_cover_the_image_at_its_own_resolution(data: ExampleSet) -> None:
    example = data.examples[0]
    parts = tiles(data, example, 64)
    assert sorted((-part.left, -part.top) for part in parts) == [(0, 0), (0, 32), (64, 0), (64, 32)]
    whole = view_of([fitted(data, example, 128)], 128).pixels[16:112]
    for part in parts:
        x, y = int(-part.left), int(-part.top)
        assert (view_of([part], 64).pixels == whole[y : y + 64, x : x + 64]).all()


@pytest.mark.parametrize(
    ("category", "scale", "share", "ignored"),
    [
        ("Pothole", 1.0, 0.2, True),
        ("Pothole", 1.0, 0.5, False),
        ("Pothole", 4.0, 0.2, True),
        ("Single Crack", 4.0, 0.2, False),
        ("Single Crack", 0.5, 0.2, True),
    ],
)
def test_what_is_cut_to_a_rest_is_ignored_but_for_cracks(
    data: ExampleSet, category: str, scale: float, share: float, ignored: bool
) -> None:
    """A part of a crack that is long enough is a crack."""
    example, true = next((one, each) for one in data.examples for each in one.objects if each.category == category)
    example = replace(example, objects=(true,))
    left, right = (scale * side for side in (true.box[0], true.box[2]))
    part = replace(fitted(data, example, 128), top=-scale * true.box[1], scale=scale)
    part = replace(part, left=-(right - share * (right - left)))
    (seen,) = view_of([part], 128).objects
    assert 0 <= seen.box[0] < 5
    assert seen.is_ignored is ignored


def test_the_same_key_gives_the_same_views_in_any_process(data: ExampleSet) -> None:
    def made(key: tuple[int, ...], workers: int, first: int = 0) -> list[torch.Tensor]:
        views = TrainingViews(
            members(data), list(range(8)), {"drawn roads": frozenset({ROAD_DEFECT})}, PLAIN, 28, key
        )  # fmt: skip
        return [batch.images for batch in batches(views, 3, first=first, workers=workers)]

    one, two = made((5, 0, 1), 0), made((5, 0, 1), 2)
    assert len(one) == 2  # of 8 images, the last two fill no batch
    assert all(torch.equal(a, b) for a, b in zip(one, two, strict=True))
    assert torch.equal(made((5, 0, 1), 0, first=1)[0], one[1])
    assert not torch.equal(made((5, 0, 2), 0)[0], one[0])
    assert not torch.equal(made((6, 0, 1), 0)[0], one[0])


def test_a_class_counts_where_every_image_of_a_view_labels_it(data: ExampleSet) -> None:
    other = Example(**{name: getattr(data.examples[1], name) for name in Example.__slots__} | {"source": "other"})
    known = {"drawn roads": frozenset({0, 1, 2}), "other": frozenset({0, 2})}
    alone, both = (
        view_of([fitted(data, each, 64) for each in examples], 64)
        for examples in ((data.examples[0],), (data.examples[0], other))
    )
    assert labelled(torch.empty(0), alone.labels, known, 28, None).known.tolist() == [True, True, True]
    assert labelled(torch.empty(0), both.labels, known, 28, None).known.tolist() == [True, False, True]


def test_a_batch_numbers_its_objects_and_regions_by_image(data: ExampleSet) -> None:
    views = ValidationViews(members(data)[:3], {"drawn roads": frozenset({0, 1, 2})}, PLAIN, 28)
    batch = collated([views[at] for at in range(3)])
    assert batch.images.shape == (3, 3, 128, 128)
    assert batch.targets.images.tolist() == [0, 0, 1, 1, 2, 2]
    assert batch.targets.regions[:, 0].tolist() == [0, 0, 1, 1, 2, 2]
    assert torch.equal(batch.targets.regions[:, 1:], batch.targets.boxes)
    assert batch.targets.subtypes.tolist() == batch.final.tolist()
    assert batch.targets.has_mask.all()


def test_a_picture_of_another_size_than_its_labels_say_is_refused(data: ExampleSet) -> None:
    example = replace(data.examples[0], size_px=(64, 64))
    with pytest.raises(PaveTwinError, match=r"'000.png' of '.*' is 128 × 96, not 64 × 64 as labelled."):
        view_of([fitted(data, example, 64)], 64)


def test_a_damaged_picture_is_refused_by_name(tmp_path: Path) -> None:
    damaged = read_coco(drawn_roads(tmp_path, {"train": 1}), ("train",))
    path = tmp_path / "images" / "train" / "000.png"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(PaveTwinError, match=r"The picture '000.png' of '.*' cannot be read"):
        view_of([fitted(damaged, damaged.examples[0], 64)], 64)


def test_a_picture_is_decoded_once_and_stays_the_same(data: ExampleSet, monkeypatch: pytest.MonkeyPatch) -> None:
    held, read, encoded = HeldExampleSet.of(data, 10**9), [], ExampleSet.encoded

    def counted(self: ExampleSet, example: Example) -> bytes:
        if self is held:
            read.append(example.name)
        return encoded(self, example)

    monkeypatch.setattr(ExampleSet, "encoded", counted)
    for _ in range(3):
        for example in data.examples:
            assert np.array_equal(np.asarray(held.picture(example)), np.asarray(data.picture(example)))
    assert read == [example.name for example in data.examples]


def test_pictures_are_kept_only_while_there_is_room(data: ExampleSet) -> None:
    """128 × 96 in three channels take 36,864 bytes: two of eight fit, the first two."""
    at_need, at_once = HeldExampleSet.of(data, 80_000), HeldExampleSet.of(data, 80_000)
    for example in (*data.examples, *data.examples):
        at_need.picture(example)
    at_once.hold(threads=3)
    for held in (at_need, at_once):
        assert held.held_bytes == 2 * 36_864
        assert list(held._held) == [example.place for example in data.examples[:2]]
    for example in data.examples:
        assert np.array_equal(np.asarray(at_once.picture(example)), np.asarray(data.picture(example)))


COLOURS = np.uint8([[[120, 120, 120], [200, 40, 60], [30, 90, 160]]])


def coloured(seed: int, **spread: float) -> np.ndarray:
    options = replace(PLAIN, **spread)
    return in_colours(COLOURS, varied_colours(options, np.random.default_rng(seed))).astype(float)


@pytest.mark.parametrize("seed", range(5))
def test_colours_vary_at_the_same_luma_and_grey_stays_grey(seed: int) -> None:
    luma = np.array([0.213, 0.715, 0.072])
    for spread in ({"hue": 0.05}, {"saturation": 0.3}):
        found = coloured(seed, **spread)
        assert not np.array_equal(found, COLOURS)
        assert found[0, 0] == pytest.approx(120, abs=1)
        assert found @ luma == pytest.approx(COLOURS @ luma, abs=1.5)


@pytest.mark.parametrize("seed", range(5))
def test_brightness_scales_all_channels_alike(seed: int) -> None:
    found = coloured(seed, brightness=0.2)
    assert found == pytest.approx(COLOURS * (found[0, 0, 0] / 120), abs=1.5)
    assert abs(found[0, 0, 0] / 120 - 1) <= 0.21


def test_a_third_of_a_circle_turns_red_to_green() -> None:
    """As W3C's `hueRotate` of 120°, which moves red's luma to the other channels."""
    turned = _turned(2 * np.pi / 3) @ (255, 0, 0)
    assert int(np.argmax(turned)) == 1
    assert _turned(2 * np.pi) == pytest.approx(np.eye(3), abs=1e-12)
