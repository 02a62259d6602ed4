"""Progress, tables and files of flown missions."""

from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import polars as pl
import pytest
from rich.console import Console
from rich.table import Table

from pavetwin.cli import flight_report
from pavetwin.cli.console import Bar
from pavetwin.cli.flight_report import FlightProgress
from pavetwin.draw import mission_map
from pavetwin.errors import PaveTwinError
from pavetwin.mission import summary
from pavetwin.mission.events import ProgressMade
from pavetwin.mission.replay import FIRST_DURATION_S, Replay, grown_s
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import save_mission, save_missions
from scenes import tiny
from scenes.folders import digests
from scenes.parking import EMPTY, FULL, narrow_street

NUMBERS = {
    "streets.csv",
    *("mission.parquet", "track.parquet", "detections.parquet", "captures.geojson"),
    *("defects.gpkg", "defects.csv", "mission.yaml"),
}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def save(
    missions: Iterator[MissionResult] | list[MissionResult], folder: Path, *, several: bool
) -> list[MissionResult]:
    results = flight_report.save(missions, folder, several=several)
    flight_report.draw(results, folder, several=several)
    return results


def test_the_visible_share_next_to_parked_vehicles_is_reported() -> None:
    stands, empty = (narrow_street().fly("hover", parking) for parking in (FULL, EMPTY))
    at_most = f"{100 * (1 - stands.rows[0].permanently_hidden):.1f}"
    for table in (flight_report.segments_table(stands), flight_report.comparison_table([stands, stands])):
        (column,) = [column for column in table.columns if column.header == summary.AT_MOST]
        assert at_most in [str(cell) for cell in column.cells]
    assert f"% of the surface seen (of at most {at_most} % next to parked vehicles)" in summary.sentence([stands])
    assert summary.missed_lines([stands]) == ["Missed 1 of 2: 1 under or behind a parked vehicle."]
    for table in (flight_report.segments_table(empty), flight_report.comparison_table([empty, empty])):
        assert summary.AT_MOST not in [column.header for column in table.columns]
    assert "at most" not in summary.sentence([empty])


def test_segments_without_defects_have_no_share_and_are_counted() -> None:
    result = tiny.result("lively_street", "hover")
    (row,) = result.rows
    empty = replace(row, defects=0, swept=0, confirmed=0, recovered=0, coverage=None, swath_coverage=None)
    both = replace(result, rows=(row, empty))
    (found,) = (
        column for column in flight_report.segments_table(both).columns if str(column.header).startswith("found")
    )
    assert [str(cell) for cell in found.cells] == [f"{100 * row.confirmed / row.defects:.1f}", "–"]
    assert str(found.footer) == f"{100 * row.confirmed / row.defects:.1f}"
    assert summary.without_defects(both.rows) == [
        "1 of the segments has no defects: what is found there is no share, neither 0 nor 100 %."
    ]
    assert summary.without_defects(result.rows) == []
    alone = replace(result, rows=(empty,))
    assert summary.sentence([alone]).startswith("No defects to find, ")
    assert summary.without_defects(alone.rows) == []


def test_streets_of_one_policy_are_summed_with_what_was_seen_of_them() -> None:
    result = tiny.result("lively_street", "hover")
    (row,) = result.rows
    half = replace(row, surface_coverage=0.5, area_m2=row.area_m2 * 3, defects=10, confirmed=1, time_s=50.0)
    table = flight_report.streets_table([replace(result, rows=(replace(row, surface_coverage=1.0), half))])
    cells = {str(column.header).replace("\n", " "): [str(cell) for cell in column.cells] for column in table.columns}
    assert cells["segments"] == ["2"]
    assert cells["found %"] == [f"{100 * (row.confirmed + 1) / (row.defects + 10):.1f}"]
    assert cells["surface seen %"] == ["62.5"]
    assert cells["time s"] == [f"{row.time_s + 50:.0f}"]
    assert "1 of 10 defects found (10 %; 0 to 73 % on streets like these), " in summary.sentence(
        [replace(result, rows=(half,))]
    )
    headings = [str(column.header) for column in flight_report.comparison_table([result, result]).columns]
    assert headings[1] == f"found of\n{row.defects}\ndefects"
    compared = flight_report.streets_table([result, result])
    assert not [column for column in compared.columns if "surface" in str(column.header)]


@pytest.mark.parametrize("error", [ValueError("one point is not a line"), PaveTwinError("No segment in common.")])
def test_a_picture_that_fails_leaves_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(mission_map, "save_mission_map", fail)
    result = tiny.result("lively_street", "hover")
    with pytest.raises(PaveTwinError, match=r"map\.png.*" + str(error)) as said:
        save([result], tmp_path / "m", several=False)
    assert "The numbers are in" in str(said.value) or "the numbers are in" in str(said.value)
    assert "\n" not in str(said.value)
    assert names(tmp_path / "m") == NUMBERS
    with pytest.raises(PaveTwinError, match=r"hover/map\.png"):
        save([result, tiny.result("lively_street", "skip")], tmp_path / "all", several=True)
    assert names(tmp_path / "all") == {"hover", "skip", "mission.parquet", "streets.csv", "comparison.png"}
    assert names(tmp_path / "all" / "skip") == NUMBERS


def test_an_interrupted_drawing_leaves_the_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mission_map, "save_mission_map", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save([tiny.result("lively_street", "hover")], tmp_path / "m", several=False)
    assert names(tmp_path / "m") == NUMBERS


def test_a_flight_that_ends_badly_costs_none_before_it(tmp_path: Path) -> None:
    def missions() -> Iterator[MissionResult]:
        yield tiny.result("lively_street", "baseline")
        yield tiny.result("lively_street", "hover")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save(missions(), tmp_path / "all", several=True)
    assert names(tmp_path / "all") == {"baseline", "hover", "mission.parquet", "streets.csv"}
    assert pl.read_parquet(tmp_path / "all" / "mission.parquet")["policy"].to_list() == ["baseline", "hover"]
    assert names(tmp_path / "all" / "hover") == NUMBERS


def test_a_mission_has_the_same_bytes_alone_and_among_others(tmp_path: Path) -> None:
    missions = [tiny.result("lively_street", policy) for policy in ("baseline", "micro")]
    save(missions, tmp_path / "all", several=True)
    save(missions[1:], tmp_path / "alone", several=False)
    assert digests(tmp_path / "all" / "micro") == digests(tmp_path / "alone")


def test_without_maps_there_is_no_comparison_either(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missions = [tiny.result("lively_street", policy) for policy in ("baseline", "micro")]
    flight_report.save(missions, tmp_path, several=True)
    flight_report.draw(missions, tmp_path, several=True, maps=False)
    assert not [*tmp_path.rglob("*.png")]
    flight_report.print_files(missions, tmp_path, maps=False, animate=False, frames=False)
    assert ".png" not in capsys.readouterr().out


def test_files_of_a_former_mission_are_removed(tmp_path: Path) -> None:
    result = tiny.result("lively_street", "hover")
    save_mission(result, tmp_path / "m")
    (tmp_path / "m" / "mission.gif").write_bytes(b"GIF89a")
    save_missions([result], tmp_path / "m")
    assert names(tmp_path / "m") == {"hover", "mission.parquet", "streets.csv"}
    save_mission(result, tmp_path / "m")
    assert names(tmp_path / "m") == NUMBERS


def printed(table: Table, width: int = 80) -> list[str]:
    console = Console(width=width, record=True, file=StringIO())
    console.print(table)
    return console.export_text().splitlines()


def busy() -> MissionResult:
    """A mission with all columns, long names and large numbers."""
    result = tiny.result("queue_that_leaves", "skip")
    (row,) = result.rows
    large = replace(
        row, street="Straße des 17. Juni [Ost]", length_m=1234.0, defects=700, confirmed=699, swept=700, recovered=5,
        coverage=1.0, swath_coverage=1.0, recovery=1.0, surface_coverage=1.0, occlusions=12345, revisits=9,
        wait_s=12345.0, time_s=23456.0, energy=1.234,
    )  # fmt: skip
    return replace(result, rows=(replace(large, segment="s0001"), replace(large, segment="s0002")), policy="hover")


def test_only_the_street_gives_way_on_a_narrow_page() -> None:
    lines = printed(flight_report.segments_table(busy()))
    assert all(len(line) <= 80 for line in lines)
    assert [line.split()[-9:] for line in lines[-3:]] == [
        ["1234", "699/700", "100.0", "100.0", "100.0", "12345", "12345", "23456", "123.4"],
        ["1234", "699/700", "100.0", "100.0", "100.0", "12345", "12345", "23456", "123.4"],
        ["2468", "1398/1400", "99.9", "0.7", "100.0", "24690", "24690", "46912", "246.8"],
    ]
    assert lines[-3].split()[1].startswith("Str")
    assert sum("…" in line for line in lines) == 2
    assert len(lines) == 7
    assert "Straße des 17. Juni [Ost]" in printed(flight_report.segments_table(busy()), 120)[-3]


def test_only_the_policy_gives_way_in_a_comparison() -> None:
    missions = [replace(busy(), policy=f"a_very_long_name_of_a_policy_{number}") for number in "ab"]
    lines = printed(flight_report.comparison_table(missions))
    assert all(len(line) <= 80 for line in lines)
    assert len(lines) == 6
    assert all(line.count("…") == 1 for line in lines[4:])
    assert lines[4].split()[1:6] == ["1398", "99.9", "99.9", "0.7", "100.0"]


def test_the_headings_are_words_that_a_stranger_reads() -> None:
    headings = " ".join(column.header.replace("\n", " ") for column in flight_report.comparison_table([busy()]).columns)
    assert "found of what the camera passed %" in headings
    assert "found on return %" in headings


def test_a_mission_over_several_batteries_reports_their_number() -> None:
    tired = replace(tiny.result("queue_that_leaves", "skip"), swaps=2, energy=2.24)
    tired = replace(tired, rows=tuple(replace(row, swaps=2) for row in tired.rows))
    assert summary.sentence([tired]).endswith("with 2 battery changes: bring 3 batteries.")
    lines = printed(flight_report.comparison_table([tired, tired]))
    assert lines[-1].split()[-2] == "3"
    assert "to bring" in lines[3]


def test_a_comparison_without_occlusions_is_noted() -> None:
    free, queue = (tiny.result(scene, "baseline") for scene in ("empty_street", "queue_at_light"))
    line = "Visibility never fell below 0.7: no policy had to react. They differ in denser traffic."
    assert summary.unprovoked([free, free]) == [line]
    assert summary.remarks([free, free])[0] == line
    assert summary.unprovoked([free]) == summary.unprovoked([free, queue]) == []


def test_what_was_missed_is_counted_by_reason() -> None:
    hidden, all_found = tiny.result("queue_at_light", "baseline"), tiny.result("empty_street", "baseline")
    assert summary.missed_lines([hidden]) == ["Missed 7 of 7: 7 hidden by vehicles in traffic."]
    assert summary.missed_lines([all_found, hidden]) == ["baseline missed 7 of 7: 7 hidden by vehicles in traffic."]


FLYING, SIMULATING = 0.002, 0.02
"""Real seconds that a second takes."""


class Flight:
    """A mission whose segments take alike, and what its bar showed."""

    def __init__(self, recorded_s: float, segments: int = 50) -> None:
        self.now_s, self.segments = 0.0, segments
        self.shown: list[tuple[float, float, str, float | None]] = []
        """Real time, share, text and time left."""
        self.traffic = SimpleNamespace(
            recording=SimpleNamespace(duration_s=recorded_s),
            recorder=SimpleNamespace(pace=SIMULATING),
            start_s=0.0,
            extending_s=0.0,
        )
        self.progress = FlightProgress(
            cast("Bar", self.report), "Flying", cast("Replay", self.traffic), clock=lambda: self.now_s
        )

    def report(self, share: float, what: str, remaining_s: float | None) -> None:
        self.shown.append((self.now_s, share, what, remaining_s))

    def fly(self, lasts_s: float, *, from_the_beginning: bool = False) -> None:
        """Args: from_the_beginning: whether the first extension simulates what is known, too."""
        time_s = 0.0
        for done in range(1, self.segments + 1):
            then_s = lasts_s * done / self.segments
            while self.traffic.recording.duration_s < then_s:
                known_s: float = self.traffic.recording.duration_s
                self.traffic.extending_s = grown_s(known_s) - (0.0 if from_the_beginning else known_s)
                from_the_beginning = False
                for step in range(1, 21):
                    self.now_s += SIMULATING * self.traffic.extending_s / 20
                    self.progress.extended(step / 20)
                self.traffic.recording.duration_s = grown_s(known_s)
            self.now_s += FLYING * (then_s - time_s)
            time_s = then_s
            self.progress(ProgressMade(time_s, done / self.segments))


def test_the_time_left_is_right_within_a_third_from_the_first_pass_on() -> None:
    flight = Flight(FIRST_DURATION_S)
    flight.fly(8000.0)
    checked = 0
    for now_s, share, _, left_s in flight.shown:
        if (truth_s := flight.now_s - now_s) > 5.0:
            assert left_s == pytest.approx(truth_s, rel=1 / 3), share
            checked += 1
    assert checked > 50


def test_a_recording_from_the_disk_is_simulated_again_at_first() -> None:
    """What that takes is not known before it begins, and misleads nobody afterwards."""
    flight = Flight(FIRST_DURATION_S)
    flight.fly(8000.0, from_the_beginning=True)
    extended = next(number for number, (*_, what, _left) in enumerate(flight.shown) if "recording" in what)
    for now_s, share, _, left_s in flight.shown[extended:]:
        if (truth_s := flight.now_s - now_s) > 5.0:
            assert left_s == pytest.approx(truth_s, rel=1 / 3), share


def test_without_more_traffic_only_the_flight_is_left() -> None:
    flight = Flight(10_000.0)
    flight.fly(8000.0)
    lefts: list[Any] = [left for *_, left in flight.shown]
    assert lefts == pytest.approx([0.0 + 16.0 * (1 - done / 50) for done in range(1, 51)])


def test_the_share_is_that_of_the_mission_while_more_is_recorded() -> None:
    flight = Flight(FIRST_DURATION_S)
    flight.fly(2000.0)
    shares = [share for _, share, *_ in flight.shown]
    assert shares == sorted(shares)
    assert {what for _, _, what, _ in flight.shown} == {"Flying", "Flying, recording more traffic"}
