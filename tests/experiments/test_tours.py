"""Studies of tours: every segment in one mission, judged as a whole, with the batteries it takes."""

from pathlib import Path

import polars as pl
import pytest

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import advise
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Single
from pavetwin.experiments.planning import plan
from pavetwin.experiments.report import page as pages
from pavetwin.experiments.report.proposals import options_table
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.run import run
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.experiments.statistics.recommend import batteries_to_bring
from pavetwin.experiments.store import Store
from pavetwin.experiments.tours import by_mission
from pavetwin.experiments.units import Unit
from pavetwin.mission.environment import prepare
from pavetwin.mission.planning import choose_targets
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.report_studies import page_of

THREE = ["s0001", "s0003", "s0005"]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tours") / "cross"
    save_world(damaged("cross", 3), folder)
    return folder


def tours(world: Path, **values: object) -> Design:
    usual = {
        "worlds": [str(world)],
        "densities": ["low"],
        "altitudes_m": [6, 10],
        "policies": ["baseline"],
        "segments": "all",
        "order": "near",
        "replicates": 5,
    }
    return Design.parse(usual | values, where="the design")


@pytest.fixture(scope="module")
def study(world: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tour-study") / "study"
    run(tours(world, streets=THREE), folder, Single())
    return folder


def test_a_tour_inspects_every_segment_in_the_order_of_fly(world: Path) -> None:
    there = load_world(world)
    made = plan(tours(world, altitudes_m=[10]), [there])
    environment = prepare(there, load_settings(altitude_m=10.0), ())
    assert made.segments(Unit(0, 0, "low")) == choose_targets(environment, order="near")
    random = plan(tours(world, order="random"), [there])
    first, second = (random.segments(Unit(0, replicate, "low")) for replicate in (0, 1))
    assert sorted(first) == sorted(second) == list(range(len(there.segments)))
    assert first != second


def test_the_permanently_hidden_share_is_that_of_a_whole_mission(study: Path) -> None:
    """By area: here of the first segment of each mission alone."""
    rows = Store(study).table().with_columns(permanently_hidden=pl.when(pl.col("order") == 0).then(0.5).otherwise(0.0))
    missions = by_mission(rows)
    of = (rows.filter(pl.col("order") == 0)["area_m2"] / missions["area_m2"]).to_numpy()
    assert missions["permanently_hidden"].to_numpy() == pytest.approx(0.5 * of)
    assert "permanently_hidden" not in by_mission(rows.drop("permanently_hidden")).columns


def test_a_row_of_a_mission_is_the_whole_flight(study: Path) -> None:
    rows = Store(study).table()
    assert rows.height == 2 * 5 * 3
    missions = by_mission(rows)
    assert missions.height == 2 * 5
    assert (missions["segments"] == 3).all()
    sums = rows.group_by("altitude_m", "replicate", maintain_order=True).agg(pl.col("time_s", "confirmed").sum())
    assert missions["confirmed"].to_list() == sums["confirmed"].to_list()
    assert (missions["coverage"] * missions["defects"] - missions["confirmed"]).abs().max() < 1e-9
    # The way home comes after the last segment.
    assert ((missions["time_s"] - sums["time_s"]) > 5).all()
    assert (missions["energy"] > 0).all()
    assert by_mission(missions) is missions


def test_a_recommendation_states_the_batteries_to_bring(study: Path) -> None:
    rows = Store(study).table()
    # Four missions of a cell take one battery, the fifth three.
    three = (pl.col("replicate") == 4) & (pl.col("altitude_m") == 6)
    rows = rows.with_columns(mission_batteries=pl.when(three).then(3).otherwise(1))
    (advice,) = advise(rows.filter(altitude_m=6), MissionLimits())
    assert advice.sentences[0].endswith("per mission.")
    table = options_table(advice.recommendation)
    assert {row[table.heads.index("Batteries to bring")].text for row in table.rows} == {"3"}
    (advice,) = advise(rows.filter(altitude_m=10), MissionLimits())
    assert batteries_to_bring(advice.recommendation.options.row(0, named=True)) == 1


def test_a_report_of_tours_speaks_of_missions(study: Path, world: Path) -> None:
    store = Store(study)
    made = gather("tours", store.description()["design"], store.table(), {"cross": load_world(world)})
    assert dict(pages.facts(made))["Missions"] == "10"
    words = pages.design_words(made)
    assert "10 missions, each a tour judged as a whole (30 segment missions in the table)" in words
    assert "The numbers rest on 3 of the 14 segments of cross (" in words
    page = page_of(made)
    assert "From take-off to landing" in page
    assert "The unit is a mission" in page
    assert "<dt>Batteries</dt>" in page


def test_a_part_of_a_tour_s_segments_is_flown_along_the_tour(world: Path) -> None:
    there = load_world(world)
    whole = plan(tours(world), [there]).targets[0]
    made = plan(tours(world, segments=2), [there])
    for replicate in range(5):
        first, second = made.segments(Unit(0, replicate, "low"))
        assert whole.index(first) < whole.index(second)


@pytest.mark.parametrize("segments", ["every", 0])
def test_another_word_for_all_is_refused_by_its_key(world: Path, segments: object) -> None:
    with pytest.raises(PaveTwinError, match="segments"):
        tours(world, segments=segments)


def test_studies_by_segment_keep_their_table(world: Path, tmp_path: Path) -> None:
    run(tours(world, segments=2, order="random", altitudes_m=[10], replicates=1), tmp_path / "study", Single())
    table = Store(tmp_path / "study").table()
    assert not [name for name in table.columns if name.startswith("mission_")]
    assert by_mission(table) is table
