"""Groups of detections of one defect, and pieces of one crack."""

from itertools import combinations, permutations
from random import Random

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Polygon

from pavetwin.detections import Detections
from pavetwin.inventory.merging import MOST_APART, alignment, are_beside, looks_of
from scenes.observed import entry_of, merged, observed


def seen(image: str, x: float, y: float, *, kind: str = "pothole", error_m: float = 0.0, **size: float) -> Detections:
    """A rectangle around a place, half a metre wide unless said otherwise."""
    width, height = size.get("width", 0.5), size.get("height", 0.5)
    shape = shapely.box(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    assert isinstance(shape, Polygon)
    return observed(kind, 0.8, image, shape, position_error_m=error_m)


def test_overlapping_looks_of_three_images_are_one_defect() -> None:
    assert merged([seen("a", 0, 0), seen("b", 0.1, 0), seen("c", 0.2, 0.1)]) == [[0, 1, 2]]


def test_another_class_is_another_defect() -> None:
    assert merged([seen("a", 0, 0), seen("b", 0, 0, kind="single_crack")]) == [[0], [1]]


def test_neighbours_that_touch_stay_two() -> None:
    assert merged([seen("a", 0, 0), seen("b", 0.49, 0)]) == [[0], [1]]


def test_two_of_one_image_are_never_one_though_a_third_look_lies_between_them() -> None:
    """The third overlaps both, the second more."""
    assert merged([seen("a", 0, 0), seen("a", 0.6, 0), seen("b", 0.35, 0)]) == [[0], [1, 2]]


def test_pieces_of_one_image_are_one_where_another_shows_the_whole() -> None:
    pieces = [seen("a", -1, 0, width=1.0), seen("a", 1, 0, width=1.0)]
    whole = seen("b", 0, 0, width=3.2)
    assert merged([*pieces, whole]) == [[0, 1, 2]]
    assert merged(pieces) == [[0], [1]]


def test_one_image_that_reports_a_defect_twice_over_shows_one() -> None:
    assert merged([seen("a", 0, 0), seen("a", 0.1, 0)]) == [[0, 1]]


@pytest.mark.parametrize(("away_m", "groups"), [(2.0, [[0, 1]]), (4.0, [[0, 1]]), (4.5, [[0], [1]])])
def test_with_a_stated_error_places_within_three_deviations_are_one(away_m: float, groups: list[list[int]]) -> None:
    """Both are wrong by 1 m: their difference by √2 m."""
    assert merged([seen("a", 0, 0, error_m=1.0), seen("b", away_m, 0, error_m=1.0)]) == groups
    assert merged([seen("a", 0, 0), seen("b", away_m, 0)]) == [[0], [1]]


def test_with_a_stated_error_the_nearest_are_joined() -> None:
    first = [seen("a", 0, 0, error_m=1.0), seen("a", 3, 0, error_m=1.0)]
    second = [seen("b", 0.8, 0, error_m=1.0), seen("b", 3.7, 0, error_m=1.0)]
    assert merged([*first, *second]) == [[0, 2], [1, 3]]


def test_without_places_nothing_is_joined() -> None:
    assert merged([observed("pothole", 0.5, name, None) for name in "aab"]) == [[0], [1], [2]]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 12), st.integers(0, 12)), max_size=12, unique=True))
def test_every_observation_is_in_one_group_and_two_that_lie_apart_in_one_image_in_two(
    looks: list[tuple[str, int, int]],
) -> None:
    observations = [seen(image, 0.3 * x, 0.3 * y) for image, x, y in looks]
    groups = merged(observations)
    assert sorted(index for group in groups for index in group) == list(range(len(looks)))
    for group in groups:
        for one, other in combinations(group, 2):
            if looks[one][0] == looks[other][0]:
                assert abs(looks[one][1] - looks[other][1]) <= 1 >= abs(looks[one][2] - looks[other][2])


def test_a_street_of_noisy_looks_has_as_many_entries_as_defects() -> None:
    """200 defects, 2 m apart and more, each seen in 1 to 6 images of a strip; outlines jitter by 5 cm."""
    rng = np.random.default_rng(0)
    looks, truth = [], []
    for number in range(200):
        x, y = 3.0 * (number % 50), 2.2 * (number // 50)
        for look in range(int(rng.integers(1, 7))):
            dx, dy = rng.normal(0, 0.05, 2)
            wide = 0.5 * rng.uniform(0.7, 1.4)
            looks.append(seen(f"{int(x // 6) + look}", x + dx, y + dy, width=wide, height=wide))
            truth.append(number)
    groups = merged(looks)
    assert {len({truth[index] for index in group}) for group in groups} == {1}
    assert len(groups) == 200


Line = tuple[tuple[float, float], tuple[float, float]]


def stroke(line: Line, width_m: float = 0.1) -> Polygon:
    shape = LineString(line).buffer(width_m / 2, cap_style="flat")
    assert isinstance(shape, Polygon)
    return shape


def piece(image: str, line: Line, *, kind: str = "single_crack", confidence: float = 0.5) -> Detections:
    shape = stroke(line)
    sizes = {"area_m2": 0.02 * LineString(line).length, "length_m": LineString(line).length, "mean_width_mm": 20.0}
    return observed(kind, confidence, image, shape, pixel_m=0.01, **sizes)


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
    assert merged([piece("a", FIRST, kind="pothole"), piece("a", OTHERS["further along"][0], kind="pothole")]) == [
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
    is_one = alignment(one, other) is not None
    assert is_one == (alignment(other, one) is not None)
    if all(abs(value - edge) > 1e-3 for value, edge in ((gap_m, 1.0), (angle_deg, 15.0))) and aside_m < 0.1:
        assert (alignment(*moved) is not None) == is_one == (gap_m < 1.0 and angle_deg < 15.0)


def test_what_one_image_shows_in_pieces_is_one_look_with_all_its_length() -> None:
    first, second = piece("a", FIRST), piece("a", ((1.5, 0), (3, 0)), confidence=0.8)
    again = piece("a", ((0.2, 0.01), (0.9, 0.01)))
    look = looks_of(Detections.concatenated([first, second, again]))
    assert len(look) == 1
    assert look.length_m[0] == pytest.approx(3.0, abs=0.01)
    assert look.area_m2[0] == pytest.approx(0.02 * 2.5)
    assert look.footprint[0].centroid.x == pytest.approx(1.5, abs=0.01)
    assert look.confidence[0] == 0.8


def test_an_entry_of_pieces_lies_in_the_middle_of_the_whole() -> None:
    whole: Line = ((0, 0), (3, 0))
    entry = entry_of(1, [piece("a", FIRST), piece("a", ((1.5, 0), (3, 0))), piece("b", whole)])
    assert entry.looks == 2
    assert entry.place is not None
    assert entry.place.x == pytest.approx(1.5, abs=0.01)
    assert entry.sizes["length_m"].value == pytest.approx(3.0, abs=0.01)
    assert entry.sizes["length_m"].error < 0.02


LONG: Line = ((0, 0), (3, 0))
BESIDE: Line = ((1, 0.25), (3.5, 0.3))
"""Parallel, a quarter of a metre away."""


def wide(image: str, line: Line) -> Detections:
    """The outline of a crooked crack, which its mask is the hull of: 0.2 m wide."""
    return observed("single_crack", 0.5, image, stroke(line, 0.2), pixel_m=0.01)


def test_cracks_that_one_image_shows_side_by_side_are_two() -> None:
    """By angle and distance alone they would go on in one another."""
    assert alignment(stroke(LONG, 0.2), stroke(BESIDE, 0.2))
    assert merged([wide("a", LONG), wide("a", BESIDE), wide("b", LONG), wide("b", BESIDE)]) == [[0, 2], [1, 3]]
    assert merged([wide("a", LONG), wide("b", BESIDE)]) == [[0, 1]], "no image shows both"


@pytest.mark.parametrize(
    ("line", "is_beside"),
    [
        (BESIDE, True),
        (((2.9, 0.3), (5, 0.3)), False),
        (((1.7, 0.3), (4.0, 0.3)), True),
        (((2.0, 0.3), (4.4, 0.3)), False),
        (((1, -0.3), (1.4, -0.3)), True),
    ],
)
def test_what_has_half_its_length_in_common_lies_beside(line: Line, *, is_beside: bool) -> None:
    assert are_beside(stroke(LONG), stroke(line)) == is_beside
    assert are_beside(stroke(line), stroke(LONG)) == is_beside


@pytest.mark.parametrize(("images", "groups"), [(MOST_APART, 1), (MOST_APART + 1, 2)])
def test_a_break_at_the_same_place_in_many_images_is_the_end_of_a_crack(images: int, groups: int) -> None:
    further = ((1.5, 0.0), (2.5, 0.0))
    looks = [piece(f"{number}", line) for number in range(images) for line in (FIRST, further)]
    assert len(merged(looks)) == groups
    whole = [piece(f"w{number}", ((0, 0), (2.5, 0))) for number in range(images // 2 + 1)]
    assert len(merged([*looks, *whole])) == 1, "half as many images show it whole"


def test_one_image_in_many_that_shows_two_neighbours_as_one_does_not_join_them() -> None:
    """Potholes: what no rule for pieces joins later."""
    here, there = (shapely.box(x, 0.0, x + 1.0, 1.0) for x in (0.0, 1.3))
    whole = shapely.box(0.0, 0.0, 2.3, 1.0)

    def seen(image: str, outline: Polygon) -> Detections:
        return observed("pothole", 0.8, image, outline)

    looks = [seen(f"{number}", outline) for number in range(6) for outline in (here, there)]
    few, half = ([seen(f"w{number}", whole) for number in range(count)] for count in (2, 3))
    assert len(merged([*looks, *few])) == 2
    assert len(merged([*looks, *half])) == 1


def test_of_two_cracks_side_by_side_a_piece_goes_to_the_nearer_whatever_the_order() -> None:
    """Both lie along its line; it follows the second after 0.4 m and the first after 0.9 m."""
    lines: dict[str, Line] = {
        "long": ((0, 0), (3, 0)),
        "near": ((1, 0.25), (3.5, 0.3)),
        "piece": ((3.9, 0.15), (6, 0.15)),
    }
    looks = {
        name: observed("single_crack", 0.5, "b" if name == "piece" else "a", stroke(line, 0.2), pixel_m=0.01)
        for name, line in lines.items()
    }
    for names in permutations(looks):
        groups = [{names[index] for index in group} for group in merged([looks[name] for name in names])]
        assert {"piece", "near"} in groups


@given(
    cells=st.dictionaries(
        st.tuples(st.integers(0, 4), st.integers(0, 2)),
        st.tuples(st.sampled_from("abc"), st.floats(0, 0.9), st.floats(-0.02, 0.02)),
        min_size=2,
        max_size=8,
    ),
    random=st.randoms(use_true_random=False),
)
def test_the_order_of_observations_decides_nothing(
    cells: dict[tuple[int, int], tuple[str, float, float]], random: Random
) -> None:
    """Strokes in three rows, none over another."""
    looks = [
        observed(
            "single_crack",
            0.5,
            image,
            stroke(((2 * place + cut, 0.25 * row), (2 * place + 1.95, 0.25 * row + turn)), 0.2),
        )
        for (place, row), (image, cut, turn) in cells.items()
    ]
    order = random.sample(range(len(looks)), len(looks))
    shuffled = [sorted(order[index] for index in group) for group in merged([looks[index] for index in order])]
    assert sorted(shuffled) == merged(looks)
