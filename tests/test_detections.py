"""The columnar record of detections: columns that stages add, rows that are chosen, and records that are joined."""

import numpy as np
import pytest
from shapely import Point

from pavetwin.detections import NO_DETECTIONS, Detections, MaskPart, possible_severities

BOXES = [[0, 0, 4, 2], [10, 10, 12, 14], [5, 5, 6, 6]]


def record() -> Detections:
    return Detections(["pothole", "car", "pothole"], [0.9, 0.5, 0.2], size_px=(20, 16), box_px=BOXES)


def test_a_column_reads_as_missing_until_a_stage_adds_it() -> None:
    found = record()
    assert np.isnan(found.length_m).all()
    assert found.footprint.tolist() == [None] * 3
    assert found.severity.tolist() == [""] * 3
    longer = found.with_columns(length_m=[1.0, 2.0, 3.0])
    assert longer.length_m.tolist() == [1.0, 2.0, 3.0]
    assert "length_m" not in found.columns
    assert longer.without("length_m") == found


def test_rows_are_chosen_by_index_mask_and_slice() -> None:
    found = record()
    assert found[found.confidence > 0.4] == found[[True, True, False]] == found[[0, 1]] == found[:2]
    assert found[found.is_defect].class_name.tolist() == ["pothole", "pothole"]
    assert found[[]] == Detections.concatenated([]) == NO_DETECTIONS
    assert found.class_number.tolist() == [2, 4, 2]
    assert (found[:1].box(0), found[:1].size_px) == ((0, 0, 4, 2), (20, 16))


def test_joined_records_have_the_columns_of_both() -> None:
    outline = Point(0, 0).buffer(1)
    placed = Detections(["pothole"], 1.0, footprint=[outline])
    joined = Detections.concatenated([placed, NO_DETECTIONS, record()])
    assert len(joined) == 4
    assert joined.footprint.tolist() == [outline, None, None, None]
    assert np.isnan(joined.box_px[0]).all()
    assert joined[1:].without("footprint") == record()
    assert joined != placed


@pytest.mark.parametrize(
    ("columns", "error", "message"),
    [
        ({"confidence": 1.5, "box_px": BOXES}, ValueError, "between 0 and 1"),
        ({"confidence": 0.5}, ValueError, "`footprint` on the ground or a `box_px`"),
        ({"confidence": 0.5, "box_px": BOXES[:2]}, ValueError, "`box_px` has 2 rows, not 3"),
        ({"confidence": 0.5, "box_px": [1, 2, 3]}, ValueError, "`box_px` has the shape"),
        ({"confidence": 0.5, "box_px": BOXES, "severty": ["", "", ""]}, TypeError, "did you mean 'severity'"),
    ],
)
def test_a_column_that_does_not_fit_is_refused(
    columns: dict[str, object], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Detections(["pothole"] * 3, **columns)  # type: ignore[arg-type]


def test_a_mask_covers_the_pixels_of_its_parts() -> None:
    grid = np.ones((2, 4), dtype=np.float32)
    grid[:, :2] = 0
    found = record()[:1].with_columns(mask=[(MaskPart((0.0, 0.0, 4.0, 2.0), grid),)])
    mask = found.mask_pixels(0)
    assert mask is not None
    assert mask[0] == (0, 0, 4, 2)
    assert mask[1].sum(axis=0).tolist() == [0, 0, 2, 2]
    assert record().mask_pixels(0) is None


@pytest.mark.parametrize(
    ("severity", "ranks"),
    [("low", (0,)), ("low to medium", (0, 1)), ("not resolvable", ()), ("low to high", None), ("bad", None)],
)
def test_a_severity_allows_one_two_or_none(severity: str, ranks: tuple[int, ...] | None) -> None:
    assert possible_severities(severity) == ranks
