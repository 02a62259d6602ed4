"""The Pareto front by its law."""

from hypothesis import given
from hypothesis import strategies as st

from pavetwin.experiments.report.figures import dominates, on_front

POINTS = st.lists(st.tuples(st.integers(0, 6).map(float), st.integers(0, 6).map(float)), max_size=30)


@given(POINTS)
def test_no_point_of_the_front_is_dominated_and_every_other_is_by_one_of_it(points: list[tuple[float, float]]) -> None:
    front = on_front(points)
    best = [point for point, chosen in zip(points, front, strict=True) if chosen]
    for point, chosen in zip(points, front, strict=True):
        better = [one for one in best if one[0] >= point[0] and one[1] <= point[1] and one != point]
        assert chosen == (not better)


@given(POINTS)
def test_something_is_always_on_the_front(points: list[tuple[float, float]]) -> None:
    assert any(on_front(points)) == bool(points)


def test_equal_points_share_the_front() -> None:
    assert on_front([(1.0, 1.0), (1.0, 1.0), (0.5, 2.0)]) == [True, True, False]


def test_more_gain_at_the_same_cost_dominates() -> None:
    assert dominates((2.0, 1.0), (1.0, 1.0))
    assert not dominates((1.0, 1.0), (1.0, 1.0))
    assert not dominates((2.0, 2.0), (1.0, 1.0))
