"""Why entries hold several defects, in scenes drawn by hand: what the benchmark counts."""

import shapely
from benchmarks.eyes.joined import Cause, HoldsTwo, holding_two, markdown
from shapely import Polygon

from pavetwin.inventory.observation import Observation

HERE, THERE = (shapely.box(x, 0.0, x + 1.0, 0.2) for x in (0.0, 1.5))
BOTH = shapely.box(0.0, 0.0, 2.5, 0.2)


def causes(looks: list[Polygon], matching: list[int | None], place: list[int | None]) -> list[HoldsTwo]:
    """Of one entry with these looks, an image each."""
    seen = [Observation("Single Crack", 0.5, f"{at}", None, outline) for at, outline in enumerate(looks)]
    judged = {"matching": matching, "place": place}
    return [*holding_two(seen, [[*range(len(looks))]], judged, {1: HERE, 2: THERE}, 0.05)]


def test_each_cause_is_told() -> None:
    assert causes([HERE, HERE], [1, 1], [1, 1]) == []
    assert causes([HERE, HERE, HERE], [1, 1, None], [1, 1, None]) == []
    of = {
        Cause.MATCHING: causes([HERE, HERE], [1, 2], [1, 1]),
        Cause.APART: causes([HERE, THERE], [1, 2], [1, 2]),
        Cause.ONE_OFTEN: causes([HERE, THERE, BOTH], [1, 2, 1], [1, 2, 1]),
        Cause.ONE_RARELY: causes([HERE, THERE, BOTH, HERE], [1, 2, 1, 1], [1, 2, 1, 1]),
    }
    for cause, found in of.items():
        assert [each.cause for each in found] == [cause]
    text = markdown([each for found in of.values() for each in found])
    assert "Entries that hold several defects: 4, 4 of the class Single Crack." in text
    assert "In 0 of them the defects overlap in the world. They lie 0.50 to 0.50 m apart." in text
    assert "none" in markdown([])
