"""What a mission's spec names, read: how much traffic is recorded before take-off."""

import pytest

from pavetwin.mission import inputs, plan_mission
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.replay import FIRST_DURATION_S, FIRST_PER_TARGET_S
from pavetwin.traffic.area import TrafficArea
from scenes import damaged


class RecordingAsked(Exception):  # noqa: N818 - no failure
    pass


@pytest.mark.parametrize(
    ("segments", "expected_s"), [(1, FIRST_PER_TARGET_S), (2, 2 * FIRST_PER_TARGET_S), (None, FIRST_DURATION_S)]
)
def test_as_much_traffic_is_recorded_as_the_segments_need(
    segments: int | None, expected_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[TrafficArea | None, float]] = []

    def replay_of(*_: object, area: TrafficArea | None, first_s: float, **__: object) -> None:
        asked.append((area, first_s))
        raise RecordingAsked

    monkeypatch.setattr(inputs, "replay_of", replay_of)
    monkeypatch.setattr(inputs, "FIRST_DURATION_S", FIRST_DURATION_S if segments else 2.5 * FIRST_PER_TARGET_S)
    world = damaged("cross", 1).world
    spec = plan_mission(world, density="low", segments=segments, seed=1)
    with pytest.raises(RecordingAsked):
        load_inputs(spec, world=world)
    most_s = inputs.FIRST_DURATION_S
    assert asked == [(None, min(most_s, expected_s))]
    assert len(spec.targets) * FIRST_PER_TARGET_S > most_s or segments is not None
