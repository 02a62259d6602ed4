"""The section of a report on the flow of each level of traffic."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from pavetwin.experiments.report.study_sections import traffic_section
from pavetwin.reports.blocks import Table
from pavetwin.traffic.flow import flow_of
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import save_recording
from pavetwin.world.model import World
from scenes.report_studies import study_of, table_of
from scenes.traffic import ROUTES, scene_world


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> World:
    return scene_world("cross", tmp_path_factory.mktemp("worlds"))


def rows_of(world: World, traffic: str, entry: object) -> list[list[str]]:
    """Rows of the section for a study of three replicates (traffic seeds 0, 1, 2)."""
    study = study_of(table_of({"world": (world.name,), "traffic": (traffic,)}, 3))
    section = traffic_section(replace(study, worlds={world.name: world}, design={**study.design, "worlds": [entry]}))
    return [[cell.text for cell in row] for part in section.blocks if isinstance(part, Table) for row in part.rows]


def numbers_of(recording: Recording) -> list[str]:
    flow = flow_of(recording)
    return [
        f"{flow.speed_kmh:.0f}", f"{100 * (flow.ratio or 0):.0f} %", str(flow.level),
        f"{100 * (flow.standing or 0):.0f} %", f"{flow.flow_per_lane_h:.0f}", f"{flow.removed_per_vehicle_hour:.2f}",
    ]  # fmt: skip


def test_a_density_is_described_from_the_recordings_of_its_seeds(cross: World) -> None:
    recording = record(cross, "low", 1, 30.0)
    ((world, traffic, count, *numbers),) = rows_of(cross, "low", str(cross.folder))
    assert (world, traffic, count) == (cross.name, "low", "1")
    assert numbers == numbers_of(recording)


def test_own_recordings_are_described(cross: World, tmp_path: Path) -> None:
    recording = save_recording(record(cross, "low", 1, 30.0), tmp_path / "rush.parquet")
    entry = {"path": str(cross.folder), "routes": [], "recordings": [str(tmp_path / "rush.parquet")]}
    ((_, traffic, count, *numbers),) = rows_of(cross, "rush", entry)
    assert (traffic, count) == ("rush", "1")
    assert numbers == numbers_of(recording)


def test_own_routes_are_described(cross: World, tmp_path: Path) -> None:
    routes = tmp_path / "mine.rou.xml"
    routes.write_text(ROUTES)
    record(cross, None, 1, 30.0, routes=[routes])
    routes.write_text(re.sub("<person.*?</person>", "", ROUTES, flags=re.DOTALL))
    recording = record(cross, None, 2, 30.0, routes=[routes])
    entry = {"path": str(cross.folder), "routes": [str(routes)], "recordings": []}
    ((_, _, count, *numbers),) = rows_of(cross, "routes", entry)
    assert count == "1", "the recording of seed 1 is of other routes of the same name"
    assert numbers == numbers_of(recording)


def test_the_section_is_empty_without_recordings(cross: World, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))
    assert rows_of(cross, "medium", str(cross.folder)) == []
