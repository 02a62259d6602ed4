"""Cracks that are detected in pieces, in scenes drawn by hand."""

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Polygon

from pavetwin.inventory.entry import entry_of
from pavetwin.inventory.merging import merged
from pavetwin.inventory.observation import Observation
from pavetwin.inventory.pieces import continues, looks_of

Line = tuple[tuple[float, float], tuple[float, float]]


def stroke(line: Line, width_m: float = 0.1) -> Polygon:
    shape = LineString(line).buffer(width_m / 2, cap_style="flat")
    assert isinstance(shape, Polygon)
    return shape


def piece(image: str, line: Line, *, kind: str = "Single Crack", confidence: float = 0.5) -> Observation:
    shape = stroke(line)
    sizes = {"area_m2": 0.02 * LineString(line).length, "length_m": LineString(line).length, "mean_width_mm": 20.0}
    return Observation(kind, confidence, image, None, shape, sizes=sizes, pixel_m=0.01)


FIRST: Line = ((0, 0), (1, 0))

OTHERS: dict[str, tuple[Line, bool]] = {
    "further along": (((1.6, 0), (2.6, 0.05)), True),
    "a little turned": (((1.3, 0.05), (2.2, 0.25)), True),
    "over the end of it": (((0.8, 0.02), (2.0, 0.02)), True),
    "beyond the gap": (((2.1, 0), (3.1, 0)), False),
    "beside it": (((0, 0.5), (1, 0.5)), False),
    "further along and beside": (((1.3, 0.4), (2.3, 0.4)), False),
    "at an angle": (((1.3, 0), (2.0, 0.4)), False),
    "across its end": (((1.1, -0.5), (1.1, 0.5)), False),
}


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("images", ["aa", "ab"])
def test_pieces_along_one_line_are_one_crack_and_others_are_not(name: str, images: str) -> None:
    line, is_one = OTHERS[name]
    looks = [piece(images[0], FIRST), piece(images[1], line)]
    assert merged(looks) == ([[0, 1]] if is_one else [[0], [1]])


def test_only_thin_classes_come_in_pieces() -> None:
    assert merged([piece("a", FIRST, kind="Pothole"), piece("a", OTHERS["further along"][0], kind="Pothole")]) == [
        [0],
        [1],
    ]


@given(
    turn=st.floats(0, 180),
    gap_m=st.floats(0, 2),
    aside_m=st.floats(0, 1),
    angle_deg=st.floats(0, 90),
    east=st.floats(-1e3, 1e3),
)
def test_whether_a_crack_goes_on_does_not_depend_on_the_frame_nor_on_the_order(
    turn: float, gap_m: float, aside_m: float, angle_deg: float, east: float
) -> None:
    one = stroke(FIRST)
    other = shapely.affinity.rotate(
        stroke(((1 + gap_m, aside_m), (2 + gap_m, aside_m))), angle_deg, (1 + gap_m, aside_m)
    )
    moved = [
        shapely.affinity.translate(shapely.affinity.rotate(each, turn, (0, 0)), east, 3.0) for each in (one, other)
    ]
    assert continues(one, other) == continues(other, one)
    if all(abs(value - edge) > 1e-3 for value, edge in ((gap_m, 1.0), (angle_deg, 15.0))) and aside_m < 0.1:
        assert continues(*moved) == continues(one, other) == (gap_m < 1.0 and angle_deg < 15.0)


def test_what_one_image_shows_in_pieces_is_one_look_with_all_its_length() -> None:
    first, second = piece("a", FIRST), piece("a", ((1.5, 0), (3, 0)), confidence=0.8)
    again = piece("a", ((0.2, 0.01), (0.9, 0.01)))
    (look,) = looks_of([first, second, again])
    assert look.sizes["length_m"] == pytest.approx(3.0, abs=0.01)
    assert look.sizes["area_m2"] == pytest.approx(0.02 * 2.5)
    assert look.footprint is not None
    assert look.footprint.centroid.x == pytest.approx(1.5, abs=0.01)
    assert look.confidence == 0.8


def test_an_entry_of_pieces_lies_in_the_middle_of_the_whole() -> None:
    whole: Line = ((0, 0), (3, 0))
    entry = entry_of(1, [piece("a", FIRST), piece("a", ((1.5, 0), (3, 0))), piece("b", whole)])
    assert entry.looks == 2
    assert entry.place is not None
    assert entry.place.x == pytest.approx(1.5, abs=0.01)
    assert entry.sizes["length_m"].value == pytest.approx(3.0, abs=0.01)
    assert entry.sizes["length_m"].error < 0.02
