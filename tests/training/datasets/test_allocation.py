"""How often images are copied so that all classes have equally many instances."""

from collections.abc import Sequence

import numpy as np
import pytest

from pavetwin.arrays import Int64Array
from pavetwin.training.datasets.allocation import TOLERANCE, CopyPlan, plan_copies
from pavetwin.training.datasets.balancing import shortfalls


def planned(
    *kinds: tuple[int, Sequence[int]], most: int = 30, target: int | None = None, leave_out: bool = False
) -> CopyPlan:
    """The plan for so many images of each kind, given by the instances of a class that one shows."""
    counts = np.array([shown for number, shown in kinds for _ in range(number)], dtype=np.int64)
    plan = plan_copies(counts, most, lambda image, _copy: counts[image], target=target, leave_out=leave_out)
    assert plan.reached.tolist() == ((plan.copies + 1) @ counts).tolist()
    return plan


def test_images_that_show_several_classes_are_balanced_together() -> None:
    """2,500 images, in most of which a frequent class is beside the rare ones; copies lose some of what they show."""
    rng = np.random.default_rng(1)
    mix = rng.dirichlet((3.0, 0.5, 0.12, 0.06, 0.8), size=2500)
    counts = np.array([rng.multinomial(rng.poisson(3) + 1, each) for each in mix])
    assert counts.sum(axis=0).max() > 30 * counts.sum(axis=0).min()

    def shown(image: int, copy: int) -> Int64Array:
        return np.random.default_rng((image, copy)).binomial(counts[image], 0.9).astype(np.int64)

    plan = plan_copies(counts, 30, shown, leave_out=True)
    totals = np.zeros(5, dtype=np.int64)
    for image, number in enumerate(plan.copies.tolist()):
        totals += counts[image] * (number >= 0) + sum((shown(image, copy) for copy in range(number)), np.zeros(5, int))
    assert plan.reached.tolist() == totals.tolist()
    assert 1 - totals.min() / totals.max() <= TOLERANCE
    assert plan.copies.max() <= 30


def test_a_frequent_class_stays_as_it_is_where_others_can_be_copied() -> None:
    plan = planned((90, (1, 0)), (10, (0, 2)))
    assert (plan.target, plan.reached.tolist()) == (90, [90, 90])
    assert plan.copies[:90].tolist() == [0] * 90
    assert set(plan.copies[90:].tolist()) <= {3, 4}


def test_an_image_with_more_instances_is_copied_no_more_often_than_others() -> None:
    plan = planned((100, (1, 0)), (4, (0, 1)), (4, (0, 4)))
    assert plan.reached.tolist() == [100, 100]
    assert np.ptp(plan.copies[100:]) <= 1


def test_the_number_rises_where_a_frequent_class_is_beside_the_rare_one() -> None:
    """Each copy of the second kind adds one of the frequent class and two of the rare one: 80 + x = 40 + 2 x."""
    plan = planned((60, (1, 0)), (20, (1, 2)))
    assert (plan.target, plan.reached.tolist()) == (120, [120, 120])
    assert plan.copies[:60].tolist() == [0] * 60


def test_classes_become_as_equal_as_copies_allow() -> None:
    plan = planned((90, (1, 0)), (2, (0, 1)), most=4)
    assert (plan.reached.tolist(), plan.spread) == ([90, 10], pytest.approx(8 / 9))
    # Each copy of the second kind adds one of both: the more, the more equal.
    plan = planned((8, (1, 0)), (2, (1, 1)), most=30)
    assert 0.11 <= plan.spread < 0.12


def test_images_are_left_out_where_that_is_allowed() -> None:
    plan = planned((90, (1, 0)), (2, (0, 1)), most=4, leave_out=True)
    assert (plan.target, plan.reached.tolist()) == (10, [10, 10])
    assert ((plan.copies < 0).sum(), plan.copies[90:].tolist()) == (80, [4, 4])


def test_a_number_that_is_asked_for_is_reached_from_above_and_below() -> None:
    plan = planned((90, (1, 0)), (10, (0, 1)), target=40, leave_out=True)
    assert (plan.reached.tolist(), int((plan.copies < 0).sum())) == ([40, 40], 50)
    assert planned((90, (1, 0)), (10, (0, 1)), target=200).reached.tolist() == [200, 200]
    assert planned((90, (1, 0)), (10, (0, 1)), target=40).reached.tolist() == [90, 90]


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (
            planned((90, (1, 0)), (2, (0, 1)), most=4),
            {"Crocodile Crack": "10 of 90: 2 instances become at most 10 with 4 copies of each image"},
        ),
        (
            planned((90, (1, 0)), (2, (0, 1)), most=4, target=50, leave_out=True),
            {"Crocodile Crack": "10 of 50: 2 instances become at most 10 with 4 copies of each image"},
        ),
        (planned((9, (2, 1))), {"Crocodile Crack": "images that show it show more frequent classes too"}),
        (planned((90, (1, 0)), (10, (0, 1))), {}),
    ],
)
def test_a_class_that_cannot_be_balanced_is_told_why(plan: CopyPlan, words: dict[str, str]) -> None:
    sums = (np.pad(each, (0, 3)) for each in (plan.present, plan.reached, plan.can_reach))
    told = dict(shortfalls(CopyPlan(plan.copies, plan.target, *sums), 4))
    for name in ("Pothole", "Person", "Car"):
        assert told.pop(name) == "the dataset shows none, so it cannot be balanced"
    assert told.keys() == words.keys()
    for name, sentence in words.items():
        assert sentence in told[name]


def test_nothing_to_balance() -> None:
    assert planned((3, (0, 0))).copies.tolist() == [0, 0, 0]
