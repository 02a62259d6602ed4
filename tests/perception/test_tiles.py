"""Tiles cover an image, and what several of them see is one object."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.detections import Detections, MaskPart
from pavetwin.labels.boxes import FloatBox, PixelBox, within
from pavetwin.perception.tiles import OVERLAP, merged, tile_windows

SIDE = 128
SIZE = (300, 220)
CRACK, POTHOLE, CAR = "single_crack", "pothole", "car"

FEW = settings(max_examples=40, deadline=None)


def detections(names: list[str], boxes: list[FloatBox], confidence: float, masks: list[MaskPart]) -> Detections:
    """Detections in the image, whose masks go to defects."""
    count = len(names)
    return Detections(
        names,
        np.full(count, confidence, dtype=np.float32),
        size_px=SIZE,
        box_px=np.array(boxes, dtype=np.float32),
        mask=[(masks[row],) if masks and name != CAR else () for row, name in enumerate(names)],
        detection_confidence=np.full(count, confidence),
        subtype_confidence=np.ones(count),
    )


def seen(box: FloatBox, tiles: list[PixelBox], *, kind: str = POTHOLE, confidence: float = 0.8) -> list[Detections]:
    """What each tile says of an object, if it sees it: the part within the tile, fully covered by its mask."""
    found = []
    for tile in tiles:
        part = within(box, tile)
        parts = [part] if part is not None and part[2] - part[0] > 1 and part[3] - part[1] > 1 else []
        count = len(parts)
        grid = np.ones((4, 4), dtype=np.float32)
        found.append(detections([kind] * count, parts, confidence, [MaskPart(each, grid) for each in parts]))
    return found


def seen_crack(
    start: tuple[float, float], end: tuple[float, float], tiles: list[PixelBox], *, masks: bool = True
) -> list[Detections]:
    """What each tile says of a straight thin crack: the box and the mask of what it sees of it."""
    along = np.linspace(start, end, 2001)
    found = []
    for tile in tiles:
        inside = along[((along >= tile[:2]) & (along <= tile[2:])).all(axis=1)]
        count = int(len(inside) > 240)  # of less a network says nothing
        boxes, parts = [], []
        if count:
            low, high = inside.min(axis=0) - 2, inside.max(axis=0) + 2
            cells = np.floor((inside - low) / (high - low) * 28).astype(int)
            grid = np.zeros((28, 28), dtype=np.float32)
            grid[cells[:, 1], cells[:, 0]] = 1
            boxes = np.array([[*low, *high]], dtype=np.float32).tolist()
            parts = [MaskPart(tuple(boxes[0]), grid)] if masks else []
        found.append(detections([CRACK] * count, boxes, 0.8, parts))
    return found


def together(*scenes: list[Detections]) -> list[Detections]:
    """What each tile says of several objects."""
    return [Detections.concatenated(each) for each in zip(*scenes, strict=True)]


@FEW
@given(st.integers(1, 900), st.integers(1, 900), st.sampled_from([64, 96, 320]))
def test_tiles_cover_the_image_and_overlap(width: int, height: int, side: int) -> None:
    tiles = tile_windows((width, height), side)
    for along, length in ((0, width), (1, height)):
        spans = sorted({(tile[along], tile[along + 2]) for tile in tiles})
        assert spans[0][0] == 0
        assert spans[-1][1] == length
        assert all(end - start == min(side, length) for start, end in spans)
        for one, other in pairwise(spans):
            assert one[1] - other[0] >= OVERLAP * side - 1  # starts are whole pixels
    assert len(set(tiles)) == len(tiles)


@FEW
@given(st.data())
def test_what_lies_within_a_tile_comes_out_once_and_unchanged(data: st.DataObject) -> None:
    tiles = tile_windows(SIZE, SIDE)
    tile = data.draw(st.sampled_from(tiles))
    left, top = (data.draw(st.integers(tile[at] + 5, tile[at + 2] - 30)) for at in (0, 1))
    width, height = data.draw(st.integers(12, 24)), data.draw(st.integers(12, 24))
    box = (float(left), float(top), float(left + width), float(top + height))
    result = merged(seen(box, tiles, kind=data.draw(st.sampled_from([POTHOLE, CAR]))), tiles)
    assert result.box_px.tolist() == [list(box)]
    assert result.confidence.tolist() == [pytest.approx(0.8)]


@FEW
@given(st.integers(0, 60), st.integers(180, 290), st.integers(5, 60), st.integers(80, 210))
def test_what_crosses_seams_comes_out_once_with_the_whole_box(left: int, right: int, top: int, bottom: int) -> None:
    tiles = tile_windows(SIZE, SIDE)
    box = (float(left), float(top), float(right), float(bottom))
    parts = seen(box, tiles)
    assert sum(map(len, parts)) > 1
    result = merged(parts, tiles)
    np.testing.assert_allclose(result.box_px, [box], atol=3)
    mask = result.mask_pixels(0)
    assert mask is not None
    assert mask[1].mean() > 0.98


@FEW
@given(st.floats(10, 40), st.floats(5, 205), st.floats(260, 290), st.floats(5, 205))
def test_a_crack_across_seams_at_any_angle_comes_out_once(x0: float, y0: float, x1: float, y1: float) -> None:
    tiles = tile_windows(SIZE, SIDE)
    result = merged(seen_crack((x0, y0), (x1, y1), tiles), tiles)
    around = [x0, min(y0, y1), x1, max(y0, y1)]
    np.testing.assert_allclose(result.box_px[0], around, atol=8)
    assert len(result) == 1


def test_the_masks_are_what_joins_a_slanting_crack() -> None:
    tiles = tile_windows(SIZE, SIDE)
    slanting = ((20.0, 10.0), (280.0, 200.0))
    assert len(merged(seen_crack(*slanting, tiles), tiles)) == 1
    assert len(merged(seen_crack(*slanting, tiles, masks=False), tiles)) > 1


FRAME = tile_windows((2048, 1536), 480)
LONG = ((100.0, 100.0), (1900.0, 1400.0))


@pytest.mark.parametrize("end", [(260.0, 1500.0), (1990.0, 110.0), (1900.0, 1400.0)])
def test_a_crack_over_a_frame_is_one_steep_or_flat(end: tuple[float, float]) -> None:
    result = merged(seen_crack((100, 100), end, FRAME), FRAME)
    np.testing.assert_allclose(result.box_px, [[100, 100, *end]], atol=3)


@pytest.mark.parametrize("second", [((900.0, 100.0), (1900.0, 820.0)), ((400.0, 100.0), (1900.0, 1180.0))])
def test_a_crack_within_the_box_of_another_stays_its_own(second: tuple[tuple[float, float], ...]) -> None:
    result = merged(together(seen_crack(*LONG, FRAME), seen_crack(*second, FRAME)), FRAME)
    wanted = sorted([*start, *end] for start, end in (LONG, second))
    np.testing.assert_allclose(sorted(result.box_px.tolist()), wanted, atol=3)


def test_a_pothole_within_the_box_of_a_crack_stays() -> None:
    pothole = (1000.0, 346.0, 1110.0, 486.0)
    assert all(len(each) == 0 or pothole != tuple(each.box_px[0]) for each in seen(pothole, FRAME))
    result = merged(together(seen_crack(*LONG, FRAME), seen(pothole, FRAME, confidence=0.7)), FRAME)
    assert [*result.class_name] == [CRACK, POTHOLE]
    assert result.box_px[1].tolist() == list(pothole)


def test_a_box_that_ends_before_the_seam_is_a_part_too() -> None:
    """The networks' boxes of thin cracks often end some pixels early."""
    parts = seen_crack((20, 60), (280, 60), tile_windows(SIZE, SIDE))
    early = [
        each.with_columns(box_px=each.box_px - np.array([0, 0, 10, 0])) if at == 0 else each
        for at, each in enumerate(parts)
    ]
    result = merged(early, tile_windows(SIZE, SIDE))
    assert len(result) == 1
    np.testing.assert_allclose(result.box_px[0], [20, 60, 280, 60], atol=3)


def test_two_cracks_that_meet_a_seam_apart_stay_two() -> None:
    tiles = tile_windows(SIZE, SIDE)
    seam = (tiles[0][2] + tiles[1][0]) / 2
    first = [each if at % 3 == 0 else each[[]] for at, each in enumerate(seen_crack((10, 20), (seam + 20, 60), tiles))]
    second = [each[[]] if at % 3 == 0 else each for at, each in enumerate(seen_crack((seam - 20, 20), (200, 5), tiles))]
    assert sum(map(len, first)) == 1
    assert sum(map(len, second)) >= 1
    result = merged(together(first, second), tiles)
    assert len(result) == 2


def test_neighbours_of_other_classes_or_places_stay_apart() -> None:
    tiles = tile_windows(SIZE, SIDE)
    first, second = (90.0, 40.0, 120.0, 70.0), (90.0, 80.0, 120.0, 110.0)
    scenes = [seen(first, tiles), seen(first, tiles, kind=CAR), seen(second, tiles, confidence=0.9)]
    result = merged(together(*scenes), tiles)
    assert [*result.class_name] == [POTHOLE, POTHOLE, CAR]
    assert result.box_px.tolist() == [list(second), list(first), list(first)]


@FEW
@given(st.data())
def test_doubtful_boxes_leave_a_confident_one_as_it_is(data: st.DataObject) -> None:
    tiles = tile_windows(SIZE, SIDE)
    box = (90.0, 90.0, data.draw(st.floats(110, 280)), data.draw(st.floats(110, 200)))
    alone = merged(seen(box, tiles, confidence=0.9), tiles)
    doubtful = []
    for _ in range(data.draw(st.integers(1, 8))):
        left, top = data.draw(st.floats(0, 200)), data.draw(st.floats(0, 150))
        other = (left, top, left + data.draw(st.floats(20, 100)), top + data.draw(st.floats(20, 70)))
        doubtful.append(seen(other, tiles, confidence=data.draw(st.floats(0.01, 0.4))))
    result = merged(together(seen(box, tiles, confidence=0.9), *doubtful), tiles)
    assert result.box_px[0].tolist() == alone.box_px[0].tolist()
    assert (result.confidence[1:] < 0.45).all()


def test_an_object_seen_whole_takes_the_place_of_a_more_confident_part() -> None:
    tiles = tile_windows(SIZE, SIDE)
    box = (60.0, 20.0, 120.0, 60.0)  # whole in the first tile, cut by the second
    part, whole = seen(box, tiles, confidence=0.9), seen(box, tiles, confidence=0.6)
    assert len(part[1]) == 1
    found = [whole[0], part[1], *whole[2:]]
    result = merged(found, tiles)
    assert result.box_px.tolist() == [list(box)]


def test_a_part_that_is_told_otherwise_is_not_a_second_object() -> None:
    """The second tile sees the end of the object alone, and takes less than half of that for it."""
    tiles = tile_windows(SIZE, SIDE)
    found = seen((60.0, 20.0, 120.0, 60.0), tiles, confidence=0.9)
    end = (float(tiles[1][0]), 20.0, float(tiles[1][0]) + 10, 30.0)
    found[1] = seen(end, tiles, confidence=0.5)[1]
    assert merged(found, tiles).box_px.tolist() == [[60.0, 20.0, 120.0, 60.0]]
