"""A recording as a value: its prefix, its file, its numbers. No SUMO needed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin._core import Trace
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import DENSITIES, Capacity, density_named, density_of
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS, VEHICLES, sumo_types
from pavetwin.traffic.recording import Agents, Origin, Recording
from pavetwin.traffic.recording_file import load_recording, save_recording
from pavetwin.traffic.trace import KeyFrameColumns, trace_arguments, trace_of
from pavetwin.traffic.tracks import POSE_COLUMNS, AgentTracks, PoseRows, TrackPart, from_columns, to_columns
from scenes.recordings import recording


def recording_of(counts: list[int], walkers: int = 1) -> Recording:
    """Frame k holds the agents 0 … counts[k] − 1; the first `walkers` of all are pedestrians."""
    agents = max(counts, default=0)
    agent = np.concatenate([np.arange(count) for count in counts]).astype(np.uint32)
    rows = len(agent)
    place = np.arange(rows, dtype=np.float32)
    return Recording.of_rows(
        origin=Origin("world", "inputs", 3, DENSITIES["low"], Capacity(0.5, 0.05), "SUMO 1.28.0", 120.0),
        step_s=0.5,
        agents=Agents(
            id=tuple(f"a{i}" for i in range(agents)),
            kind=tuple("man" if i < walkers else "suv" for i in range(agents)),
            length_m=np.full(agents, 4.6, dtype=np.float32),
            width_m=np.full(agents, 1.86, dtype=np.float32),
            height_m=np.linspace(1, 2, agents).round(3).astype(np.float32),
            is_pedestrian=np.arange(agents) < walkers,
        ),
        rows=PoseRows(
            step_offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.uint32),
            agent=agent,
            x=place,
            y=place + 1,
            yaw_rad=np.radians(place % 90).astype(np.float32),
            speed_mps=place * np.float32(0.1),
        ),
        removals=((0, 1), (len(counts) - 1, 2)),
        signals={"tls": ((0, "Gr"), (len(counts) - 1, "rG"))},
    )


frame_counts = st.lists(st.integers(0, 6), min_size=2, max_size=12)


@given(frame_counts, st.data())
def test_a_prefix_is_what_a_shorter_recording_would_be(counts: list[int], data: st.DataObject) -> None:
    recording = recording_of(counts)
    frames = data.draw(st.integers(1, len(counts)))
    prefix = recording.until((frames - 1) * 0.5)
    assert prefix.frames == frames
    assert len(prefix.agent) == sum(counts[:frames])
    assert len(prefix.agents) == max(counts[:frames])
    assert np.array_equal(prefix.x, recording.x[: sum(counts[:frames])])
    assert prefix.vehicles_per_lane_km == pytest.approx(np.mean([max(0, c - 1) for c in counts[:frames]]) / 0.5)
    assert prefix.pedestrians_per_sidewalk_km == pytest.approx(np.mean([min(1, c) for c in counts[:frames]]) / 0.05)
    assert all(step < frames for _, states in prefix.signals.items() for step, _ in states)


def test_a_prefix_cannot_be_longer_than_the_whole() -> None:
    with pytest.raises(ValueError, match=r"lasts 0\.5 s"):
        recording_of([1, 2]).until(1.0)


@given(frame_counts, st.data())
def test_what_is_left_from_a_time_on_is_the_same_traffic_earlier(counts: list[int], data: st.DataObject) -> None:
    recording = recording_of(counts)
    first = data.draw(st.integers(0, len(counts) - 1))
    later = recording.after(first * 0.5)
    assert later.frames == len(counts) - first
    assert later.agents.id == recording.agents.id
    for frame in range(later.frames):
        mine, theirs = (
            slice(*each.step_offsets[at : at + 2]) for each, at in ((later, frame), (recording, first + frame))
        )
        for name in ("agent", "x", "y", "yaw_rad", "speed_mps"):
            assert np.array_equal(getattr(later, name)[mine], getattr(recording, name)[theirs])
    last = len(counts) - 1
    assert later.signals["tls"] == (((0, "rG"),) if first == last else ((0, "Gr"), (last - first, "rG")))
    assert later.removals == tuple((step - first, count) for step, count in recording.removals if step >= first)


def test_nothing_is_left_after_the_end() -> None:
    with pytest.raises(ValueError, match=r"holds nothing from 1 s on"):
        recording_of([1, 2]).after(1.0)


@given(frame_counts)
def test_the_file_gives_back_what_was_saved(tmp_path_factory: pytest.TempPathFactory, counts: list[int]) -> None:
    path = tmp_path_factory.mktemp("trace") / "low-3.parquet"
    recording = recording_of(counts)
    saved = save_recording(recording, path)
    loaded = load_recording(path)
    assert loaded.same_traffic(recording)
    assert loaded.origin == recording.origin
    assert loaded.removals == recording.removals
    assert saved.path == path
    before = path.read_bytes()
    save_recording(loaded, path)
    assert path.read_bytes() == before


def test_the_file_is_sorted_and_small_in_type(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    save_recording(recording_of([2, 0, 3]), path)
    table = pq.read_table(path)
    assert table.column_names == ["agent", "step", "x", "y", "yaw", "speed", "is_last"]
    assert [str(column.type) for column in table.columns] == [*["int32"] * 6, "bool"]
    part = from_columns({name: table[name].to_numpy() for name in table.column_names}, 0, 2)
    assert part.agent.tolist() == [0, 0, 1, 1, 2]
    assert part.step.tolist() == [0, 2, 0, 2, 2]


def test_columns_have_the_types_of_the_kernel() -> None:
    columns = trace_arguments(recording_of([2, 3]))
    arrays = {**columns, **columns["read"](0)}.items()
    kinds = {name: value.dtype.name for name, value in arrays if isinstance(value, np.ndarray)}
    assert kinds == {
        **dict.fromkeys(("agent", "step"), "uint32"),
        **dict.fromkeys(("x_m", "y_m", "yaw_rad", "speed_mps", "length_m", "width_m", "height_m", "base_m"), "float32"),
        **dict.fromkeys(("is_pedestrian", "is_last"), "bool"),
    }


def test_a_density_that_was_missed_is_said() -> None:
    sparse = recording_of([3, 3, 3])  # 2 vehicles on 0.5 km: 4 instead of 6; 1 pedestrian on 0.05 km: 20 as asked
    assert sparse.remarks[0].startswith("4.0 vehicles per lane-kilometre instead of 6")
    assert "removed after blocking traffic (SUMO teleports); treat the density with care" in sparse.remarks[1]
    pathless = replace(sparse, origin=replace(sparse.origin, capacity=Capacity(2 / 6, 0.0)), removals=())
    assert pathless.remarks == ("the world has no sidewalks, so there are no pedestrians",)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "low-1.parquet"
    with pytest.raises(PaveTwinError, match="no recording"):
        load_recording(path)
    path.write_bytes(b"PAR1 not really")
    with pytest.raises(PaveTwinError, match="not a complete recording"):
        load_recording(path)
    save_recording(recording_of([1, 2]), path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(PaveTwinError, match="not a complete recording"):
        load_recording(path)


def test_a_recording_of_another_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "low-1.parquet"
    save_recording(recording_of([1, 2]), path)
    table = pq.read_table(path)
    metadata = json.loads(pq.read_metadata(path).metadata[b"pavetwin"])
    said = json.dumps(metadata | {"format": 99}).encode()
    pq.write_table(table.replace_schema_metadata({b"pavetwin": said}), path)
    with pytest.raises(PaveTwinError, match="has format 99; this version reads only format 1"):
        load_recording(path)


def test_densities_by_name_and_number() -> None:
    assert density_named("high").vehicles_per_lane_km == 30
    with pytest.raises(PaveTwinError, match="did you mean 'medium'"):
        density_named("mediun")
    assert density_of(12, 40.5).name == "v12-p40.5"
    assert density_named("v12-p40.5") == density_of(12, 40.5)
    for bad in (-1.0, float("nan"), 200.0):
        with pytest.raises(PaveTwinError):
            density_of(bad, 0)


def test_the_kinds_are_whole() -> None:
    for kinds in (VEHICLES, PEDESTRIANS):
        assert sum(kind.share for kind in kinds) == pytest.approx(1.0)
    assert all(kind.source for kind in KINDS.values())
    hatchback = KINDS["hatchback"]
    assert (hatchback.length_m, hatchback.width_m, hatchback.height_m) == (3.77, 1.66, 1.52)
    assert KINDS["bus"].length_m == 12.0
    assert sumo_types(KINDS.values()).count("<vType") == len(KINDS)
    rng = np.random.default_rng(0)
    heights = [KINDS["man"].height_of_one(rng) for _ in range(500)]
    assert 1.6 < min(heights) < 1.7 < 1.83 < max(heights) < 1.92


@given(frame_counts, st.integers(1, 5), st.data())
def test_key_frames_give_all_poses_back(counts: list[int], length: int, data: st.DataObject) -> None:
    made = recording_of(counts)
    stands = made.agent < data.draw(st.integers(0, 6))
    columns = {name: np.where(stands, np.float32(0), getattr(made, name)) for name in POSE_COLUMNS}
    rows, walks = PoseRows(made.step_offsets, made.agent, **columns), made.agents.is_pedestrian
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("pavetwin.traffic.tracks.PART_STEPS", length)
        tracks = AgentTracks.of(rows, walks, 0.5)
        cut = data.draw(st.integers(1, len(counts) - 1))
        grown = AgentTracks.of(rows.between(0, cut), walks, 0.5)
        assert grown.begin_alike(tracks)
        assert tracks.begin_alike(grown)
        moved = AgentTracks.of(replace(rows, x=rows.x + np.float32(1) * (rows.frame == cut - 1)), walks, 0.5)
        assert moved.begin_alike(grown) == (counts[cut - 1] == 0)
        grown = grown.followed_by(rows.between(cut, len(counts)), walks, 0.5)
    assert len(tracks.parts) == -(-(len(counts) - 1) // length)
    for each in (tracks, grown):
        assert all(part.load().is_as(other.load()) for part, other in zip(each.parts, tracks.parts, strict=True))
        for name in ("step_offsets", "agent", *POSE_COLUMNS):
            assert np.array_equal(getattr(each.rows, name), getattr(rows, name))
    assert grown.fastest_mps == tracks.fastest_mps
    assert np.array_equal(grown.numbers.known, tracks.numbers.known)


@st.composite
def journeys(draw: st.DrawFn) -> tuple[Recording, PoseRows]:
    """A recording of agents that come and go, stand, drive and are put elsewhere; and the poses it was made of."""
    counts = draw(st.lists(st.integers(0, 5), min_size=2, max_size=9))
    made, rng = recording_of(counts), np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    moves_m = rng.choice([0.0, 0.004, 0.7, 6.9, 900.0], len(made.agent)) * rng.normal(1.0, 0.1, len(made.agent))
    rows = PoseRows(
        made.step_offsets,
        made.agent,
        x=(draw(st.floats(-9e3, 9e3)) + np.cumsum(moves_m)).astype(np.float32),
        y=(draw(st.floats(-9e3, 9e3)) - np.cumsum(moves_m)).astype(np.float32),
        yaw_rad=rng.uniform(-np.pi, np.pi, len(made.agent)).astype(np.float32),
        speed_mps=(moves_m / made.step_s).astype(np.float32),
    )
    tracks = AgentTracks.of(rows, made.agents.is_pedestrian, made.step_s)
    return replace(made, tracks=tracks), rows


@given(journeys(), st.floats(0, 0.999))
def test_every_pose_lies_within_the_stated_error(journey: tuple[Recording, PoseRows], share: float) -> None:
    """2 cm, 1° and 0.1 m/s of SUMO's own rows, also between two steps, where the kernel interpolates.

    All of a step later is the next step, where other agents may be, and those that jumped are elsewhere.
    """
    made, rows = journey
    kept = made.tracks.rows
    assert np.array_equal(kept.agent, rows.agent)
    single = 1e-3  # places 10 km away, as single precision has them
    assert np.hypot(kept.x - rows.x, kept.y - rows.y).max(initial=0) <= 0.02 + single
    assert np.abs(np.angle(np.exp(1j * (kept.yaw_rad - rows.yaw_rad)))).max(initial=0) <= np.radians(1.0)
    assert np.abs(kept.speed_mps - rows.speed_mps).max(initial=0) <= 0.1
    trace, whole = trace_of(made), np.float64
    for frame in range(rows.frames - 1):
        poses = trace.agents_at((frame + share) * made.step_s)
        now, then = (rows.between(at, at + 1) for at in (frame, frame + 1))
        for agent, x, y in zip(poses["agent"], poses["x_m"], poses["y_m"], strict=True):
            at, follows = np.flatnonzero(now.agent == agent)[0], np.flatnonzero(then.agent == agent)
            here = np.array([now.x[at], now.y[at]], whole)
            there = np.array([then.x[follows[0]], then.y[follows[0]]], whole) if len(follows) else here
            moves = np.hypot(*(there - here)) <= 40.0 * made.step_s
            wanted = here + (share if moves else 0.0) * (there - here)
            assert np.hypot(*(wanted - [x, y])) <= 0.02 + single


@given(journeys())
def test_rounded_poses_stay_as_they_are(journey: tuple[Recording, PoseRows]) -> None:
    made, rows = journey
    again = TrackPart.of(made.tracks.rows)
    assert again.is_as(TrackPart.of(rows))
    assert from_columns(to_columns(again), again.first_step, again.last_step).is_as(again)


def test_a_walk_takes_little_more_than_a_byte_a_pose(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    ways_m = np.cumsum(rng.normal(0.65, 0.05, (100, 240)), axis=1)
    walking = recording(
        ["man"] * 100, lambda agent, time_s: (500.0, ways_m[agent, round(2 * time_s)], 1.57, 1.3), frames=240
    )
    path = tmp_path / "t.parquet"
    save_recording(walking, path)
    group = pq.ParquetFile(path).metadata.row_group(0)
    assert sum(group.column(each).total_compressed_size for each in range(group.num_columns)) < 1.3 * ways_m.size


def test_a_place_that_is_none_is_refused() -> None:
    rows = recording_of([1, 1]).tracks.rows
    with pytest.raises(ValueError, match="not a number of metres on Earth"):
        TrackPart.of(replace(rows, x=np.full(2, -1073741824.0, np.float32)))


def test_a_standing_agent_needs_two_key_frames() -> None:
    standing = recording(["suv", "man"], lambda agent, time_s: (agent * (5.0 + time_s), 0.0, 0.0, 0.0), frames=200)
    (part,) = standing.tracks.parts
    assert [int((part.load().agent == agent).sum()) for agent in (0, 1)] == [2, 200]


def test_a_part_that_is_damaged_is_said_when_the_clock_gets_there(tmp_path: Path) -> None:
    moving = recording(["suv"] * 40, lambda agent, time_s: (7.3 * agent + time_s**1.5, 0.0, 0.0, 0.0), frames=300)
    path = tmp_path / "r.parquet"
    save_recording(moving, path)
    group = pq.ParquetFile(path).metadata.row_group(1).column(2)
    data = bytearray(path.read_bytes())
    begin = group.data_page_offset
    data[begin : begin + group.total_compressed_size] = bytes(group.total_compressed_size)
    path.write_bytes(data)
    trace = trace_of(load_recording(path))
    assert len(trace.agents_at(119.9)["agent"]) == 40
    with pytest.raises(PaveTwinError, match=f"The recording '{path}' is damaged; record it again"):
        trace.agents_at(120.0)


def test_parts_that_need_not_be_held_are_read_again_with_the_same_poses(tmp_path: Path) -> None:
    moving = recording(["suv"] * 4, lambda agent, time_s: (7.3 * agent + time_s, 0.0, 0.0, 0.0), frames=600)
    save_recording(moving, tmp_path / "r.parquet")
    arguments, read = trace_arguments(load_recording(tmp_path / "r.parquet")), []

    def counted(number: int) -> KeyFrameColumns:
        read.append(number)
        return arguments["read"](number)

    trace = Trace.of_parts(**{**arguments, "read": counted}, held_rows=0)
    first, later, again = (trace.agents_at(time_s)["x_m"].tolist() for time_s in (10.0, 200.0, 10.0))
    assert read == [0, 1, 0]
    assert first == again != later


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit, TimeoutError])
def test_what_ends_the_reading_of_a_part_passes_through_the_kernel(kind: type[BaseException]) -> None:
    raised = kind()

    def read(_: int) -> KeyFrameColumns:
        raise raised

    trace = Trace.of_parts(**{**trace_arguments(recording_of([1, 1])), "read": read})
    with pytest.raises(kind) as caught:
        trace.agents_at(0.0)
    assert caught.value is raised
