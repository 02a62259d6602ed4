"""Which streets go to train, val and test."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from pavetwin.capture import context, splits
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.splits import SAMPLED_S, presence, split_streets, street_splits
from pavetwin.errors import PaveTwinError
from pavetwin.labels import SPLITS
from pavetwin.traffic.record import record
from pavetwin.traffic.tracks import AgentTracks, PoseRows
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import damaged


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = tmp_path_factory.mktemp("splits") / "cross"
    save_world(damaged("cross", 12), folder)
    return load_world(folder)


def test_every_split_gets_a_street_that_is_driven_where_there_are_enough(world: World) -> None:
    streets = sorted({world.segment(defect.segment).street for defect in world.defects})
    assert len(streets) > 3
    for seed in range(8):
        for driven in (set(streets[:3]), set(streets[:2])):
            agents = {street: np.array([float(street in driven), 0.0]) for street in streets}
            assigned = split_streets(world, (0.7, 0.15, 0.15), np.random.default_rng(seed), agents)
            assert set(assigned) == set(streets)
            assert set(assigned.values()) == set(SPLITS)
            assert len(driven) == 2 or {assigned[street] for street in driven} == set(SPLITS)


def test_a_world_with_one_street_can_not_be_split(world: World) -> None:
    street = world.segments[0].street
    lone = replace(world, defects=tuple(d for d in world.defects if world.segment(d.segment).street == street))
    with pytest.raises(PaveTwinError, match=r"1 street with defects.*`split` 100/0/0"):
        split_streets(lone, (0.7, 0.15, 0.15), np.random.default_rng(0))
    assert set(split_streets(lone, (1, 0, 0), np.random.default_rng(0)).values()) == {"train"}


def test_a_world_with_one_street_is_refused_before_traffic_is_recorded(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    street = world.segments[0].street
    lone = replace(world, defects=tuple(d for d in world.defects if world.segment(d.segment).street == street))
    asked: list[str] = []
    for module in (context, splits):
        monkeypatch.setattr(module, "record", lambda _world, density, *_, **__: asked.append(density))
    monkeypatch.setattr(context, "flight_domain", lambda *_: asked.append("a flight domain"))
    with pytest.raises(PaveTwinError, match="1 street with defects"):
        context.prepare(lone, CaptureSettings(platforms=("uav",), images=3, altitudes_m=(10.0,)))
    assert asked == []


def test_splits_are_found_once_and_read_afterwards(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    searched: list[int] = []

    def split(_world: World, shares: Sequence[float], rng: np.random.Generator, _agents: object) -> dict[str, str]:
        searched.append(int(rng.integers(1 << 30)))
        return {street.name: SPLITS[len(shares) - 1] for street in world.streets}

    monkeypatch.setattr(splits, "record", lambda *_, **__: None)
    monkeypatch.setattr(splits, "presence", lambda *_: {})
    monkeypatch.setattr(splits, "split_streets", split)
    thirds = (0.4, 0.3, 0.3)
    first = street_splits(world, 1, thirds)
    assert street_splits(world, 1, thirds) == first
    assert len(searched) == 1
    street_splits(world, 2, thirds)
    street_splits(world, 1, (0.5, 0.3, 0.2))
    street_splits(replace(world, defects=world.defects[1:]), 1, thirds)
    monkeypatch.setattr(splits, "made_by", lambda *_: "by other code")
    street_splits(world, 1, thirds)
    assert len(searched) == 5
    street_splits(replace(world, content_hash=""), 1, thirds)
    street_splits(replace(world, content_hash=""), 1, thirds)
    assert len(searched) == 7, "of a world that was never built nothing is kept"


def test_splits_share_out_the_traffic_too(world: World) -> None:
    """Of streets with equally many defects two have half of the vehicles each, and may not both fall to train."""
    street_of = {segment.id: segment.street for segment in world.segments}
    least = min(Counter(street_of[defect.segment] for defect in world.defects).values())
    taken, left = Counter[str](), []
    for defect in world.defects:
        taken[street_of[defect.segment]] += 1
        left += [defect] if taken[street_of[defect.segment]] <= least else []
    even = replace(world, defects=tuple(left))
    for busy in combinations(sorted(taken), 2):
        agents = {street: np.array([50.0 if street in busy else 0.0, 10.0]) for street in taken}
        assigned = split_streets(even, (0.5, 0.0, 0.5), np.random.default_rng(0), agents)
        assert {assigned[street] for street in busy} == {"train", "test"}


def test_an_agent_is_present_on_the_street_it_is_on(world: World) -> None:
    recording = record(world, "high", 1, 60.0)
    found = presence(world, [recording, recording])
    vehicles, people = recording.counts
    assert set(found) == {segment.street for segment in world.segments}
    sampled = slice(None, None, round(SAMPLED_S / recording.step_s))
    total = sum(found.values(), np.zeros(2))
    # Some are in the middle of a junction, or on its far corners.
    assert 0.5 * 2 * vehicles[sampled].mean() < total[0] <= 2 * vehicles[sampled].mean() + 1e-9
    assert 0.5 * 2 * people[sampled].mean() < total[1] <= 2 * people[sampled].mean() + 1e-9
    middle = world.segments[0].centre_line.interpolate(0.5, normalized=True)
    one, place = np.array([0, 1], dtype=np.uint32), np.float32([[middle.x], [middle.y], [0.0], [0.0]])
    lone = replace(
        recording,
        agents=recording.agents.first(1),
        tracks=AgentTracks.of(
            PoseRows(one, one[:1], *place), recording.agents.first(1).is_pedestrian, recording.step_s
        ),
    )
    alone = presence(world, [lone])
    walks = int(recording.agents.is_pedestrian[0])
    for street, there in alone.items():
        assert there.tolist() == ([1 - walks, walks] if street == world.segments[0].street else [0, 0])
