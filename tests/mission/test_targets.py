"""Which segments a mission inspects: those that are named, by id or by street."""

from dataclasses import replace

import pytest

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.planning import choose_targets
from scenes.tiny import street, world

NAMES = ("Bell Lane", "Hill", "Bell Lane")


@pytest.fixture(scope="module")
def environment() -> MissionEnvironment:
    """Three pieces of one street in a row, the middle one of another name."""
    pieces = [street(name, (50 * k, 0), (50 * k + 50, 0)) for k, name in enumerate(("s0001", "s0002", "s0003"))]
    named = [replace(piece, street=name) for piece, name in zip(pieces, NAMES, strict=True)]
    return prepare(world(named), load_settings())


def test_a_street_stands_for_all_its_segments(environment: MissionEnvironment) -> None:
    assert choose_targets(environment, names=["Bell Lane"]) == [0, 2]
    assert choose_targets(environment, names=["s0002", "bell lane"]) == [1, 0, 2]


def test_a_segment_and_its_street_are_the_same_place(environment: MissionEnvironment) -> None:
    with pytest.raises(PaveTwinError, match="`names` Bell Lane, s0003: given more than once"):
        choose_targets(environment, names=["s0003", "s0002", "Bell Lane"])
