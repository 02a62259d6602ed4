"""The presets default and paper: windows, passes, attempts, intervals and sensors, and the rows of the published setup.

`published.csv` holds columns of `mission.parquet` for the preset `paper` over a world without parking lanes."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import shapely
from polars.testing import assert_frame_equal

from pavetwin._core import Captured, Occluded
from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.mission.environment import prepare, window_m
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.mission import Mission, Traffic
from pavetwin.mission.planning import plan_mission
from pavetwin.mission.saving import segment_table
from pavetwin.navigation.patterns import from_nearest_end, half_widths, passes
from pavetwin.policies import load_policy
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.tiny import TRUCK, Scene, empty_street, parked, result, straight

STREET = straight().segments[0]


@pytest.mark.parametrize("altitude_m", [6.0, 10.0, 15.0])
def test_the_default_window_is_half_the_rows_and_the_whole_width(altitude_m: float) -> None:
    across, along = window_m(load_settings("default", altitude_m=altitude_m))
    assert along == pytest.approx(altitude_m * 13.0 / 12.3 / 2)  # of the Mavic 3 Enterprise
    assert across == pytest.approx(altitude_m * 13.0 / 12.3 * 5280 / 3956)


@pytest.mark.parametrize(
    ("altitude_m", "along_m", "across_m"), [(6, 1.896, 3.6), (10, 3.160, 6.0), (15, 4.740, 9.0)]
)  # computed by hand: 1.1547 h · 260/950
def test_the_window_that_a_mission_uses(altitude_m: float, along_m: float, across_m: float) -> None:
    """A defect is swept just when the flown window passes over its centre."""
    inside, outside = across_m / 2 - 0.05, across_m / 2 + 0.05
    line = 7.0 / 4  # passes run over the middle of each half
    scene = Scene(straight((30, line + inside), (30, line + outside), (1.0, line), width_m=20.0), altitude_m=altitude_m)
    settings = scene.settings("pattern.kind=boustrophedon", preset="paper")
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    assert mission.window_along_m == pytest.approx(along_m, abs=1e-3)
    flight = mission.flight
    flight.climb_to(altitude_m)
    flight.advance()
    flight.fly_to((5.0, line))
    flight.advance()
    flight.turn_to(0.0)
    flight.advance()
    flight.inspect(0, np.array([(5.0, line), (58.0, line)]))
    while flight.time_s < 30 and flight.position[0] < 56.9:
        flight.advance()
    assert list(flight.swept()) == [True, False, False]


def test_the_paper_flies_out_and_back_over_the_middle_of_each_half() -> None:
    settings = load_settings("paper")
    out, back = passes(STREET, window_m(settings)[0], settings.pattern)
    assert out == pytest.approx(np.array([(0, -1.75), (60, -1.75)]))
    assert back == pytest.approx(np.array([(60, 1.75), (0, 1.75)]))


@pytest.mark.parametrize("width_m", [3.5, 7.0, 12.0, 15.5, 22.0, 40.0])
@pytest.mark.parametrize("altitude_m", [6.0, 10.0, 15.0])
def test_the_default_flies_as_many_passes_as_window_and_overlap_need(width_m: float, altitude_m: float) -> None:
    settings = load_settings(altitude_m=altitude_m)
    across = window_m(settings)[0]
    flown_passes = passes(straight(width_m=width_m).segments[0], across, settings.pattern)
    offsets = [float(line[0][1]) for line in flown_passes]
    # Together they reach both edges, neighbours overlap by at least a fifth of the window, and one fewer would not do.
    swath = shapely.union_all([shapely.box(0, y - across / 2, 60, y + across / 2) for y in offsets])
    assert swath.buffer(1e-6).contains(shapely.box(0, -width_m / 2, 60, width_m / 2))
    if len(offsets) > 1:
        gap = np.diff(offsets)
        assert (gap <= 0.8 * across + 1e-9).all()
        assert np.ptp(gap) < 1e-9
        fewer = (width_m - across) / (len(offsets) - 2) if len(offsets) > 2 else np.inf
        assert fewer > 0.8 * across - 1e-9 or (len(offsets) == 2 and width_m > across)
    else:
        assert offsets == pytest.approx([0.0])
        assert width_m <= across
    directions = [np.sign(line[-1][0] - line[0][0]) for line in flown_passes]
    assert directions == [(-1) ** k for k in range(len(directions))]


def test_half_widths_are_those_of_a_lopsided_street() -> None:
    from dataclasses import replace

    lopsided = replace(STREET, polygon=shapely.box(0, -2, 60, 6))
    assert half_widths(lopsided) == pytest.approx((6.0, 2.0))


@pytest.mark.parametrize("start", [(-5.0, 0.0), (65.0, 0.0), (65.0, 9.0), (-5.0, 9.0)])
def test_passes_begin_at_the_nearest_end(start: tuple[float, float]) -> None:
    settings = load_settings("paper")
    plan = from_nearest_end(passes(STREET, 6.0, settings.pattern), start)
    ends = [line[k] for line in passes(STREET, 6.0, settings.pattern) for k in (0, -1)]
    nearest = min(np.hypot(*(end - start)) for end in ends)
    assert np.hypot(*(plan[0][0] - start)) == pytest.approx(nearest)
    assert np.hypot(*(plan[1][0] - plan[0][-1])) == pytest.approx(3.5)  # the next begins next to this one's end
    assert sorted(line[0][1] for line in plan) == pytest.approx([-1.75, 1.75])


# Attempts.


def attempts(scene: Scene, *overrides: str, preset: str, policy: str = "baseline") -> list[tuple[int, int, bool]]:
    """Every sighting of a mission whose sensor never confirms: (defect, attempt, on a revisit)."""
    settings = scene.settings("sensing.sensor=recall", "sensing.recall=0", *overrides, preset=preset)
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    decides, found = load_policy(policy, settings.policy), []
    for event in mission:
        match event:
            case Captured():
                frame = mission.frame(event)
                on_revisit = bool(mission.flight.captures()["on_revisit"][-1])
                found += [(sighting.defect.id, sighting.attempt, on_revisit) for sighting in frame.sightings]
            case Occluded():
                mission.act(decides.decide(mission.snapshot(event)))
    return found


def test_the_paper_gives_a_defect_one_attempt() -> None:
    assert attempts(Scene(straight((30, 1.75)), altitude_m=15.0), preset="paper") == [(0, 0, False)]


def test_the_default_tries_at_every_capture() -> None:
    tried = attempts(empty_street((30, 0)), preset="default")
    # At 6 m the window is 3.46 m long and captures are 3 m apart: one or two fall on the defect; at 15 m, three.
    assert [attempt for _, attempt, _ in tried] == list(range(len(tried)))
    high = attempts(Scene(straight((30, 0)), altitude_m=15.0), preset="default")
    assert [attempt for _, attempt, _ in high] in ([0, 1], [0, 1, 2])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_in_the_paper_each_revisit_may_try_once_more(side: float) -> None:
    """The truck hides the street next to the defect, so skip comes back; the defect itself is in full view.

    With the truck on the right, the revisit comes between the passes: the second does not try once more.
    """
    scene = Scene(straight((30, 0.5 * side)), (parked(30, 2.5 * side, TRUCK),), altitude_m=15.0)
    tried = attempts(scene, preset="paper", policy="skip")
    revisits = sum(on_revisit for _, _, on_revisit in tried)
    assert [attempt for _, attempt, _ in tried] == list(range(len(tried)))
    assert sum(not on_revisit for _, _, on_revisit in tried) == 1
    assert 1 <= revisits <= 3


def test_between_revisits_a_defect_that_was_tried_stays_tried() -> None:
    """Defect 1 is tried on the first pass, lies far from the revisit, and below the second pass."""
    scene = Scene(straight((30, -0.5), (10, -0.5)), (parked(30, -2.5, TRUCK),), altitude_m=15.0)
    tried = attempts(scene, preset="paper", policy="skip")
    assert any(on_revisit for _, _, on_revisit in tried)
    assert [attempt for defect, attempt, _ in tried if defect == 1] == [0]


def test_it_inspects_only_once_it_has_turned() -> None:
    """Out and back over a straight street: while inspecting it looks one way or the other."""
    track = empty_street((30, 1.75)).fly("baseline", preset="paper").track
    yaw = track["yaw_rad"][track["segment"] == 0]
    assert np.abs(np.sin(yaw)).max() < 1e-6
    assert 0 < (np.cos(yaw) > 0).mean() < 1


def test_a_capture_every_0_6_s_and_a_look_every_0_3_s_while_inspecting() -> None:
    track, captures = result("empty_street", "baseline").track, result("empty_street", "baseline").captures
    assert np.diff(captures["t_s"]) == pytest.approx(0.6)
    inspecting = track["segment"] == 0
    looks = track["t_s"][inspecting]
    assert np.diff(looks) == pytest.approx(0.3)
    assert np.isin(np.round(captures["t_s"], 6), np.round(looks, 6)).all()
    assert not np.isnan(track["visibility"][inspecting]).any()
    assert np.isnan(track["visibility"][~inspecting]).all()
    assert (captures["segment"] == 0).all()
    assert not captures["on_revisit"].any()


def test_the_recall_of_a_whole_mission_is_that_of_the_detector() -> None:
    """In the paper preset every defect of an empty street is tried once: 0.84 of them are confirmed."""
    places = [(2.0 + 0.1 * k, 1.75 if k % 2 else -1.75) for k in range(560)]
    scene = Scene(straight(*places), altitude_m=10.0)
    found = sum(
        len(scene.fly("baseline", "sensing.sensor=recall", preset="paper", seed=s).detections) for s in range(4)
    )
    swept = 4 * 560
    assert found / swept == pytest.approx(0.84, abs=4 * (0.84 * 0.16 / swept) ** 0.5)


STORED = Path(__file__).parent / "published.csv"
SEED = 2


def flown(folder: Path) -> pl.DataFrame:
    """The rows of the study's altitudes and policies in one recording, in the columns of the stored ones."""
    save_world(
        add_defects(built("cross", parking_rule="none"), DefectOptions(population="paper", per_segment=8)), folder
    )
    world, rows = load_world(folder), []
    traffic: Traffic | None = None
    for altitude_m in (6.0, 10.0, 15.0):
        settings = load_settings("paper", altitude_m=altitude_m)
        ready = prepare(world, settings, world.defects, parking_seed=SEED)
        spec = plan_mission(world, settings, density="low", segments=2, seed=SEED, environment=ready)
        inputs = MissionInputs(ready, traffic) if traffic else load_inputs(spec, world=world, environment=ready)
        traffic = inputs.traffic
        with inputs.replay:
            rows += [
                segment_table(fly(spec.with_policy(policy, settings), inputs=inputs)).with_columns(
                    altitude_m=pl.lit(altitude_m)
                )
                for policy in ("baseline", "hover", "micro", "skip")
            ]
    return pl.concat(rows).select(pl.read_csv(STORED, n_rows=0).columns)


def test_the_rows_of_the_published_setup_stay(tmp_path: Path) -> None:
    rows = flown(tmp_path / "cross")
    stored = pl.read_csv(STORED, schema=rows.schema)
    assert rows["occlusions"].sum() > 0
    assert rows["revisits"].sum() > 0
    assert_frame_equal(rows, stored, rel_tol=0.0, abs_tol=1e-9)
