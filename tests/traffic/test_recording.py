"""A recording as a value: its prefix, its file, its numbers, states of its agents, and its export. No SUMO needed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin._core import Trace
from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.agent_states import PARTS_KEPT, AgentStateReader
from pavetwin.traffic.demand import DENSITIES, Capacity, density_named, density_of
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS, VEHICLES, sumo_types
from pavetwin.traffic.recording import Agents, Origin, Recording
from pavetwin.traffic.recording_file import export_fcd, load_recording, save_recording
from pavetwin.traffic.trace import KeyFrameColumns, trace_arguments, trace_of
from pavetwin.traffic.tracks import PART_STEPS, POSE_COLUMNS, AgentTracks, PoseRows, TrackPart, from_columns, to_columns
from scenes.command_line import pavetwin, plain_refusal
from scenes.recordings import Pose, recording


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


def test_a_missed_density_is_reported() -> None:
    sparse = recording_of([3, 3, 3])  # 2 vehicles on 0.5 km: 4 instead of 6; 1 pedestrian on 0.05 km: 20 as asked
    assert sparse.remarks[0].startswith("4.0 vehicles per lane-kilometre instead of 6")
    assert "removed after blocking traffic (SUMO teleports); treat the density with care" in sparse.remarks[1]
    pathless = replace(sparse, origin=replace(sparse.origin, capacity=Capacity(2 / 6, 0.0)), removals=())
    assert pathless.remarks == ("the world has no sidewalks, so there are no pedestrians",)


def test_a_file_without_a_recording_is_refused(tmp_path: Path) -> None:
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
    message = json.dumps(metadata | {"format": 99}).encode()
    pq.write_table(table.replace_schema_metadata({b"pavetwin": message}), path)
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


def test_a_place_off_the_earth_is_refused() -> None:
    rows = recording_of([1, 1]).tracks.rows
    with pytest.raises(ValueError, match="not a number of metres on Earth"):
        TrackPart.of(replace(rows, x=np.full(2, -1073741824.0, np.float32)))


def test_a_standing_agent_needs_two_key_frames() -> None:
    standing = recording(["suv", "man"], lambda agent, time_s: (agent * (5.0 + time_s), 0.0, 0.0, 0.0), frames=200)
    (part,) = standing.tracks.parts
    assert [int((part.load().agent == agent).sum()) for agent in (0, 1)] == [2, 200]


def test_a_damaged_part_is_reported_when_the_clock_reaches_it(tmp_path: Path) -> None:
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


def east_then_north(agent: int, t: float) -> Pose:
    """The first drives east at 10 m/s, the second walks north at 1 m/s."""
    return (10 * t, 5.0, 0.0, 10.0) if agent == 0 else (-3.0, t, np.pi / 2, 1.0)


@pytest.fixture
def long(tmp_path: Path) -> Recording:
    """A recording of three parts."""
    made = recording(("van", "man"), east_then_north, frames=601)
    return save_recording(made, tmp_path / "long.parquet")


def test_rows_are_those_of_fcd(long: Recording, tmp_path: Path) -> None:
    assert export_fcd(long, tmp_path / "all.parquet") == 2 * long.frames
    table = pl.read_parquet(tmp_path / "all.parquet")
    assert table.columns[:7] == ["time", "id", "type", "x", "y", "angle", "speed"]
    van, man = (table.filter(pl.col("type") == kind) for kind in ("van", "man"))
    half_m = long.agents.length_m[0] / 2
    np.testing.assert_allclose(van["time"], np.arange(long.frames) * long.step_s)
    np.testing.assert_allclose(van["x"], 10 * van["time"].to_numpy() + half_m, atol=2e-3)
    assert van["angle"].unique().to_list() == [90.0]
    assert man["angle"].unique().to_list() == [0.0]
    np.testing.assert_allclose(man["y"], man["time"], atol=2e-3)
    assert (van["class"].unique().to_list(), man["class"].unique().to_list()) == (["vehicle"], ["pedestrian"])


@pytest.mark.parametrize(("start_s", "end_s"), [(0.0, 0.0), (0.0, 7.5), (110.0, 130.5), (240.0, 300.0), (60.0, 60.0)])
def test_a_stretch_is_that_of_the_whole(long: Recording, tmp_path: Path, start_s: float, end_s: float) -> None:
    export_fcd(long, tmp_path / "all.parquet")
    export_fcd(long, tmp_path / "some.csv", start_s, end_s)
    whole, some = pl.read_parquet(tmp_path / "all.parquet"), pl.read_csv(tmp_path / "some.csv")
    expected = whole.filter(pl.col("time").is_between(start_s, end_s))
    assert some.height == expected.height == 2 * ((end_s - start_s) * 2 + 1)
    for name in ("time", "x", "y", "angle", "speed"):
        np.testing.assert_allclose(some[name], expected[name], atol=1e-9)
    assert some["id"].cast(str).to_list() == expected["id"].to_list()


def test_what_is_not_in_it_is_refused(long: Recording, tmp_path: Path) -> None:
    for start_s, end_s in ((-1.0, 5.0), (5.0, 4.0), (0.0, 300.5), (float("nan"), 5.0)):
        with pytest.raises(PaveTwinError, match="lasts from 0 to 300 s"):
            export_fcd(long, tmp_path / "x.csv", start_s, end_s)
    file = long.path
    assert "must end in .parquet or .csv" in plain_refusal(pavetwin("traffic", "export", file, tmp_path / "x.txt"))
    assert "There is no recording" in plain_refusal(pavetwin("traffic", "export", tmp_path / "no", tmp_path / "x.csv"))
    assert not list(tmp_path.glob("x.*"))
    done = pavetwin("traffic", "export", file, tmp_path / "x.csv", "--from", 10, "--to", 12)
    assert "10 rows in" in done.stdout


@pytest.mark.parametrize(
    ("start_s", "end_s", "times"), [(0.25, 1.2, [0.5, 1.0]), (0.3, 0.9, [0.5]), (0.5, 0.5, [0.5]), (0.0, 0.49, [0.0])]
)
def test_a_stretch_holds_the_moments_within_it_alone(
    long: Recording, tmp_path: Path, start_s: float, end_s: float, times: list[float]
) -> None:
    export_fcd(long, tmp_path / "some.csv", start_s, end_s)
    some = pl.read_csv(tmp_path / "some.csv").filter(pl.col("type") == "man")
    assert some["time"].to_list() == some["y"].to_list() == times


def test_a_stretch_between_two_moments_is_refused(long: Recording, tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"No moment of the recording lies from 0.3 to 0.4 s: it has one every 0.5"):
        export_fcd(long, tmp_path / "x.csv", 0.3, 0.4)
    assert not list(tmp_path.glob("x.*"))


def test_a_recording_and_other_files_are_not_replaced_by_themselves(long: Recording, tmp_path: Path) -> None:
    assert long.path is not None
    before = long.path.read_bytes()
    (tmp_path / "link.parquet").symlink_to(long.path)
    (tmp_path / "there.csv").write_text("mine")
    for target in (long.path, tmp_path / "there.csv"):
        reported = plain_refusal(pavetwin("traffic", "export", long.path, target))
        assert "exists; choose another name, or add --force" in reported
    for target in (long.path, tmp_path / "link.parquet"):
        with pytest.raises(PaveTwinError, match="it is the recording itself, which this would replace"):
            export_fcd(long, target)
    assert (tmp_path / "there.csv").read_text() == "mine"
    assert long.path.read_bytes() == before
    assert pavetwin("traffic", "export", long.path, tmp_path / "there.csv", "--force").returncode == 0


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


def test_no_agent_is_present_after_the_end_or_in_empty_traffic() -> None:
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
