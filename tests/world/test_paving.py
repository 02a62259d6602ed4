"""What is not inspected is said: junctions, and pavements to which the defect classes do not apply."""

from pathlib import Path

import pytest

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.osm import paving_m2, paving_words
from pavetwin.world.store import save_world
from scenes import HERE, built, damaged
from scenes.command_line import pavetwin


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the crossing, one of whose streets is of setts."""
    text = (HERE / "cross.osm").read_text(encoding="utf-8")
    first = text.index('<tag k="name" v="Nebenstraße"/>')
    path = tmp_path_factory.mktemp("paving") / "cross.osm"
    path.write_text(text[:first] + '<tag k="surface" v="sett"/>' + text[first:], encoding="utf-8")
    return path


def test_the_area_of_setts_is_that_of_the_street_s_segments(mapped: Path) -> None:
    made = build_world(mapped, BuildOptions(seed=1))
    area_m2 = made.record.paving_m2["sett"]
    assert list(made.record.paving_m2) == ["sett"]
    assert 50 < area_m2 < 0.9 * sum(segment.area_m2 for segment in made.world.segments)
    # The pavement is said, and is no part of the world.
    assert made.world.content_hash == built("cross").world.content_hash


def test_asphalt_is_not_mentioned() -> None:
    segments = built("cross").world.segments
    ways = {int(edge.lstrip("-").split("#")[0]) for segment in segments for edge in segment.edges}
    assert paving_m2(segments, dict.fromkeys(ways, "asphalt")) == {}
    assert paving_words({}) == ""
    (area_m2,) = paving_m2(segments, dict.fromkeys(ways, "cobblestone")).values()
    assert area_m2 == pytest.approx(sum(segment.area_m2 for segment in segments), abs=0.1)


def test_what_is_not_inspected_and_not_surveyed_is_said(mapped: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cross"
    world = save_world(add_defects(build_world(mapped), DefectOptions(population="paper", per_segment=2)), folder)
    assert 0 < world.outside_segments_m2 < world.carriageway.area / 2
    said = " ".join(pavetwin("world", "info", folder).stdout.split())
    outside = f"{world.outside_segments_m2:.0f} m² of junctions and crossings"
    assert outside in said
    assert "placed by the program, not surveyed" in said
    assert "damage classes are those of asphalt" in said
    flown = pavetwin("fly", folder, "--density", "low", "--segments", "1", "-o", tmp_path / "m").stdout
    assert f"Defects are placed by the program, not surveyed; not inspected: {outside}" in flown


def test_streets_are_listed_with_their_segments(tmp_path: Path) -> None:
    folder = tmp_path / "cross"
    world = save_world(damaged("cross", 0), folder)
    lines = pavetwin("world", "info", folder, "--streets").stdout.splitlines()
    names = {segment.street_name for segment in world.segments}
    assert len(lines) == 1 + len(names)
    for name in names:
        own = [segment for segment in world.segments if segment.street_name == name]
        (line,) = [line for line in lines if line.startswith(name)]
        assert all(segment.id in line for segment in own)
        assert line.split()[-1] == f"{sum(segment.area_m2 for segment in own):.0f}"
