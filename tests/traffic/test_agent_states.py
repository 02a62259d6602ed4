"""How far agents have come is what the poses of all frames say, wherever one asks first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.arrays import Float64Array
from pavetwin.traffic.agent_states import PARTS_KEPT, AgentStateReader
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.tracks import PART_STEPS, AgentTracks, PoseRows
from scenes.recordings import recording

AGENTS = 7


def wandering(seed: int, frames: int) -> Recording:
    """Agents that come and go, stand for long, and move by all amounts."""
    rng = np.random.default_rng(seed)
    place = np.cumsum(rng.normal(0, 1, (frames, AGENTS, 2)) * (rng.random((frames, AGENTS, 1)) < 0.3), axis=0)
    speed = np.round(rng.random((frames, AGENTS)) * 3, 1) * (rng.random((frames, AGENTS)) < 0.3)
    there = np.cumsum(rng.random((frames, AGENTS)) < 0.02, axis=0) % 3 > 0
    made = recording(["man"] * AGENTS, lambda _agent, _time: (0.0, 0.0, 0.0, 0.0))
    frame, agent = np.nonzero(there)
    rows = PoseRows(
        np.concatenate([[0], np.cumsum(there.sum(axis=1))]).astype(np.uint32),
        agent.astype(np.uint32),
        *(place[frame, agent, axis].astype(np.float32) for axis in (0, 1)),
        np.zeros(len(agent), dtype=np.float32),
        speed[frame, agent].astype(np.float32),
    )
    tracks = AgentTracks.of(rows, made.agents.is_pedestrian, made.step_s)
    return Recording(made.origin, made.step_s, made.agents, tracks, made.removals, {}, None)


def by_all_poses(made: Recording) -> tuple[Float64Array, Float64Array]:
    """(frames, agents) each: the way moved, NaN where an agent is not there; and the speed."""
    moved = np.full((made.frames, AGENTS), np.nan)
    speed = np.full((made.frames, AGENTS), np.nan)
    last: dict[int, tuple[float, float, float]] = {}
    for frame in range(made.frames):
        for row in range(int(made.step_offsets[frame]), int(made.step_offsets[frame + 1])):
            agent, x, y = int(made.agent[row]), float(made.x[row]), float(made.y[row])
            before_x, before_y, way = last.get(agent, (x, y, 0.0))
            way += float(np.hypot(x - before_x, y - before_y))
            last[agent] = x, y, way
            moved[frame, agent], speed[frame, agent] = way, made.speed_mps[row]
    return moved, speed


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000), start=st.sampled_from([0, 1, 100, PART_STEPS, PART_STEPS + 37]))
def test_states_are_those_of_all_poses(seed: int, start: int) -> None:
    whole = wandering(seed, 2 * PART_STEPS + 50)
    made = whole.after(start * whole.step_s)
    moved, speed = by_all_poses(made)
    ways, who = AgentStateReader(made), np.arange(AGENTS)
    for frame in np.random.default_rng(seed).permutation(made.frames).tolist():
        found = ways.at(who, frame)
        there = ~np.isnan(moved[frame])
        assert np.array_equal(found.is_there, there)
        assert found.speed_mps[there] == pytest.approx(speed[frame, there], abs=1e-6)
        assert found.travelled_m == pytest.approx(np.where(there, moved[frame], 0.0), abs=1e-6)


def test_nobody_is_there_after_the_end_or_where_nobody_ever_was() -> None:
    made = wandering(1, 300)
    for ways, frame in ((AgentStateReader(made), 300), (AgentStateReader(made), -1)):
        assert not ways.at(np.arange(AGENTS), frame).is_there.any()
    assert AgentStateReader(made).at(np.zeros(0, dtype=np.int64), 0).is_there.shape == (0,)
    empty = PoseRows(np.zeros(4, np.uint32), np.zeros(0, np.uint32), *(np.zeros(0, np.float32) for _ in range(4)))
    tracks = AgentTracks.of(empty, made.agents.is_pedestrian, made.step_s)
    nobody = Recording(made.origin, made.step_s, made.agents, tracks, made.removals, {}, None)
    assert not AgentStateReader(nobody).at(np.arange(AGENTS), 1).is_there.any()


def test_few_parts_stay_in_memory() -> None:
    ways = AgentStateReader(wandering(2, 8 * PART_STEPS))
    for frame in range(0, 8 * PART_STEPS, 50):
        ways.at(np.arange(AGENTS), frame)
    assert ways._read.cache_info().currsize == PARTS_KEPT
    assert "rows" not in vars(ways._tracks), "all poses were read"
