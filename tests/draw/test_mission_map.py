"""The map of a mission: what is read from it, what its marks stand for, and the file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from pavetwin.draw import lettering, style
from pavetwin.draw.lettering import OccupiedSpace
from pavetwin.draw.mission_layers import CLOSE, MapTransform, draw_reactions, legend_of, main_numbers
from pavetwin.draw.mission_map import (
    _comparison_figure,
    _traffic_words,
    flown_bounds,
    mission_figure,
    save_comparison_map,
    save_mission_map,
)
from pavetwin.draw.mission_marks import DefectOutcome, notable_segments, outcomes, rectangles, windows
from pavetwin.draw.strip import caption
from pavetwin.errors import PaveTwinError
from pavetwin.mission.detections import DetectionLog
from pavetwin.mission.environment import window_m
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import TrafficInput
from pavetwin.mission.track import MODE_NUMBER, displacements, revisits, waits
from pavetwin.twin import Mode
from pavetwin.world.model import World
from scenes import tiny
from scenes.parking import EMPTY, FULL, narrow_street

POLICIES = ("baseline", "hover", "micro", "skip")


def figure_of(result: MissionResult) -> Figure:
    with style.styled():
        return mission_figure(result)


def marks(figure: Figure, name: str) -> list[int]:
    """How many marks of a kind each map of the figure has, the town first; their name is the collection's gid."""
    return [
        len(np.asarray(collection.get_offsets()))
        for axes in figure.axes
        for collection in axes.collections
        if collection.get_gid() == name
    ]


def test_every_defect_has_the_outcome_that_the_mission_gave_it() -> None:
    for policy in POLICIES:
        result = tiny.result("queue_that_leaves", policy)
        found = outcomes(result)
        assert len(found) == sum(row.defects for row in result.rows)
        detections = result.detections
        confirmed = dict(zip(detections.defect.tolist(), detections.on_revisit.tolist(), strict=True))
        for defect, outcome in found.items():
            if defect in confirmed:
                recovered = confirmed[defect]
                assert outcome is (DefectOutcome.RECOVERED if recovered else DefectOutcome.CONFIRMED)
            else:
                assert outcome is DefectOutcome.MISSED


@pytest.mark.parametrize("policy", POLICIES)
def test_the_map_has_a_mark_for_every_defect(policy: str) -> None:
    result = tiny.result("queue_that_leaves", policy)
    figure, found = figure_of(result), list(outcomes(result).values())
    for outcome in DefectOutcome:
        town, *_ = marks(figure, f"defects-{outcome}")
        assert town == found.count(outcome)


@pytest.mark.parametrize(
    ("traffic", "words"),
    [
        (TrafficInput(density="los-C"), "traffic los-C"),
        (TrafficInput(density="los-D", instead_of="los-C"), "traffic los-D instead of los-C"),
        (TrafficInput(density="high", seed=4), "traffic high, seed 4"),
        (TrafficInput(), "traffic user"),
    ],
)
def test_the_heading_names_the_traffic_and_its_seed_only_where_it_differs(traffic: TrafficInput, words: str) -> None:
    result = tiny.result("queue_that_leaves", "baseline")
    spec = result.spec.model_copy(update={"traffic": traffic, "seed": 0})
    assert _traffic_words(replace(result, spec=spec)) == words


def test_parked_vehicles_and_what_they_hide_are_on_the_map_and_in_its_legend() -> None:
    result = narrow_street().fly("hover", FULL)
    assert [outcome.value for outcome in outcomes(result).values()] == ["behind parked vehicle", "found"]
    figure = figure_of(result)
    boxes = [c for axes in figure.axes for c in axes.collections if c.get_gid() == "parked"]
    assert len(boxes) == 2, "the town and the close view"
    assert all(len(each.get_paths()) == 1 for each in boxes)
    legend, _ = legend_of([result], town=True)[::-1]
    assert {"Parked vehicle", "Defect behind parked vehicle"} <= set(legend)
    empty = narrow_street().fly("hover", EMPTY)
    assert "Parked vehicle" not in legend_of([empty], town=True)[1]
    names = [name for name, _ in main_numbers(result)]
    assert "Surface that can be seen" in names
    assert "Surface that can be seen" not in [name for name, _ in main_numbers(empty)]


def test_waits_are_as_long_as_the_metrics_state() -> None:
    result = tiny.result("car_that_leaves", "hover")
    stays = waits(result.track)
    assert stays
    assert sum(stay.seconds for stay in stays) == pytest.approx(sum(row.wait_s for row in result.rows), abs=1.0)
    assert marks(figure_of(result), "waits")[0] == len(stays)
    assert waits(tiny.result("car_that_leaves", "baseline").track) == []


def test_seconds_of_a_wait_stand_where_it_is_drawn_larger() -> None:
    result = tiny.result("queue_at_light", "hover")
    told = [
        [text.get_text() for text in axes.texts if text.get_text().endswith(" s")] for axes in figure_of(result).axes
    ]
    assert told[0] == []
    assert ["300 s"] in told
    (stay,) = waits(result.track)
    with style.styled():
        axes = Figure().subplots()
        axes.set(xlim=(0, 60), ylim=(-30, 30))
        draw_reactions(axes, result, MapTransform((0.0, 0.0), 0.0), CLOSE)
    assert [text.get_text() for text in axes.texts] == [f"{stay.seconds:.0f} s"]


def test_displacements_are_no_longer_than_the_policy_may() -> None:
    result = tiny.result("truck_beside_defects", "micro")
    steps = displacements(result.track)
    assert steps
    for step in steps:
        length = np.hypot(step.end[0] - step.start[0], step.end[1] - step.start[1])
        assert length <= result.settings.policy.max_displacement_m + result.settings.uav.stopping_distance_m


def test_revisits_last_as_long_as_the_policy_stays() -> None:
    result = tiny.result("queue_that_leaves", "skip")
    places = revisits(result.track)
    assert 1 <= len(places) <= sum(row.revisits for row in result.rows)
    assert sum(stay.seconds for stay in places) >= result.settings.policy.revisit_stay_s


def test_giving_way_is_marked_only_where_it_occurs() -> None:
    result = tiny.result("lively_street", "hover")
    mode = np.array(result.track["mode"])
    mode[20:30], mode[40:45] = MODE_NUMBER[Mode.AVOID], MODE_NUMBER[Mode.AVOID]
    avoided = replace(result, track={**result.track, "mode": mode})  # type: ignore[arg-type]
    for mission, stretches in ((result, 0), (avoided, 2)):
        figure = figure_of(mission)
        bands = [c for axes in figure.axes for c in axes.collections if c.get_gid() == "avoiding"]
        assert bands
        assert all(len(band.get_paths()) == stretches for band in bands)
        legends = [axes.get_legend() for axes in figure.axes if axes.get_legend() is not None]
        words = [text.get_text() for legend in legends for text in legend.get_texts()]
        assert ("Giving way to aircraft" in words) == bool(stretches)


def test_windows_have_the_size_of_the_inspection_window() -> None:
    result = tiny.result("lively_street", "hover")
    corners, visibility = windows(result)
    across, along = window_m(result.settings)
    assert shapely.area(shapely.polygons(corners)) == pytest.approx(across * along)
    assert len(visibility) == len(corners) <= len(result.captures["t_s"])


@given(st.floats(-3.2, 3.2), st.floats(0.5, 9), st.floats(0.5, 9))
def test_rectangles_lie_along_the_yaw(yaw: float, across: float, along: float) -> None:
    (corners,) = rectangles(np.array([2.0]), np.array([-1.0]), np.array([yaw]), across, along)
    assert corners.mean(axis=0) == pytest.approx((2.0, -1.0))
    ahead = (corners[0] + corners[1]) / 2 - corners.mean(axis=0)
    assert ahead == pytest.approx(np.array([np.cos(yaw), np.sin(yaw)]) * along / 2)
    assert np.hypot(*(corners[0] - corners[1])) == pytest.approx(across)


@given(st.floats(-7, 7), st.tuples(st.floats(-500, 500), st.floats(-500, 500)))
def test_a_turn_keeps_lengths_and_has_a_way_back(angle: float, origin: tuple[float, float]) -> None:
    turn = MapTransform(origin, angle)
    points = np.array([(0.0, 0.0), (30.0, -4.0), (100.0, 70.0)])
    page = turn.points(points)
    assert turn.back(page) == pytest.approx(points, abs=1e-6)
    assert np.hypot(*np.diff(page, axis=0).T) == pytest.approx(np.hypot(*np.diff(points, axis=0).T))


def test_a_segment_lies_along_the_page() -> None:
    for segment in tiny.bent().segments:
        turn = MapTransform.along(segment)
        ends = turn.points(shapely.get_coordinates(segment.centre_line)[[0, -1]])
        assert ends[0, 1] == pytest.approx(ends[1, 1], abs=1e-6)
        left, bottom, right, top = turn.shape(segment.polygon).bounds
        assert (left + right, bottom + top) == pytest.approx((0, 0), abs=1e-6)


def test_the_segment_with_most_occlusions_is_the_most_notable() -> None:
    result = tiny.result("lively_street", "hover")
    (row,) = result.rows
    other = replace(row, segment="other", occlusions=row.occlusions + 1, length_m=1.0)
    assert notable_segments([replace(result, rows=(row, other))]) == ["other", row.segment]


def test_a_comparison_states_why_it_shows_that_segment() -> None:
    result = tiny.result("lively_street", "hover")
    (row,) = result.rows
    for change, reason in (
        ({}, "hidden most often"),
        ({"occlusions": 0, "wait_s": 3.0}, "waited over longest"),
        ({"occlusions": 0, "wait_s": 0.0, "revisits": 0}, "the longest"),
    ):
        shown = replace(result, rows=(replace(row, **change),))
        with style.styled():
            figure = _comparison_figure([shown, shown], row.segment)
        assert any(text.get_text().endswith(f", {reason} of 1 segments") for text in figure.texts)


def test_the_map_shows_all_that_was_flown_over() -> None:
    result = tiny.result("lively_street", "skip")
    west, south, east, north = flown_bounds(result)
    assert west < result.track["x_m"].min()
    assert result.track["x_m"].max() < east
    assert south < result.track["y_m"].min()
    assert result.track["y_m"].max() < north


def test_names_of_streets_find_a_place_clear_of_the_frames_first(monkeypatch: pytest.MonkeyPatch) -> None:
    kept_clear: list[shapely.Geometry] = []

    def recorded(_axes: Axes, _world: World, _segments: object, space: OccupiedSpace, *_style: object) -> set[str]:
        kept_clear.append(shapely.union_all(space.taken))
        return set()

    monkeypatch.setattr(lettering, "write_street_names", recorded)
    result = tiny.result("queue_that_leaves", "hover")
    figure = figure_of(result)
    (row,) = result.rows
    (letter,) = [text for text in figure.axes[0].texts if text.get_text() == "a"]
    assert kept_clear[0].contains(result.environment.world.segment(row.segment).polygon)
    assert kept_clear[0].contains(shapely.Point(letter.get_position())), "the frame's letter stands on its corner"
    assert kept_clear[0].area > kept_clear[1].area


def test_the_file_is_small_and_the_same_every_time(tmp_path: Path) -> None:
    result = tiny.result("lively_street", "hover")
    save_mission_map(result, tmp_path / "one" / "map.png")
    save_mission_map(result, tmp_path / "two.png")
    assert (tmp_path / "one" / "map.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "two.png").stat().st_size < 500_000
    with Image.open(tmp_path / "two.png") as image:
        assert image.width == 1800
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two.png"]


def test_a_mission_that_saw_nothing_has_a_map_too(tmp_path: Path) -> None:
    result = tiny.result("empty_street", "baseline")
    empty = {name: column[:0] for name, column in result.captures.items()}
    save_mission_map(
        replace(result, captures=empty, rows=(), log=DetectionLog(result.environment)), tmp_path / "map.png"
    )
    assert (tmp_path / "map.png").is_file()


def test_a_policy_of_the_users_own_has_one_colour_in_a_comparison_and_in_a_report() -> None:
    results = [tiny.result("queue_that_leaves", policy) for policy in ("baseline", "hover")]
    calm = replace(results[1], policy="calm")
    with style.styled():
        figure = _comparison_figure([*results, calm], notable_segments(results)[0])
    (named,) = [text for text in figure.texts if text.get_text() == "calm"]
    assert named.get_color() == style.policy_styles(["baseline", "calm"])["calm"].colour


def test_one_revisit_is_not_several() -> None:
    row = tiny.result("queue_that_leaves", "skip").rows[0]
    assert "1 revisit " in caption(replace(row, revisits=1))
    assert "2 revisits " in caption(replace(row, revisits=2))


def test_policies_are_compared_over_one_segment(tmp_path: Path) -> None:
    results = [tiny.result("queue_that_leaves", policy) for policy in POLICIES]
    save_comparison_map(results, tmp_path / "comparison.png")
    with Image.open(tmp_path / "comparison.png") as four:
        height = four.height
    save_comparison_map(results[:2], tmp_path / "two.png")
    with Image.open(tmp_path / "two.png") as two:
        assert two.height < height
    with pytest.raises(PaveTwinError, match="no segment in common"):
        save_comparison_map([results[0], replace(results[1], rows=())], tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"\.png"):
        save_mission_map(tiny.result("empty_street", "baseline"), tmp_path / "map.bmp")
    assert list(tmp_path.iterdir()) == []
