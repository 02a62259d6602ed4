"""Which observations are one defect, in scenes drawn by hand."""

from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from pavetwin.detections import Detections
from scenes.observed import merged, observed


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
