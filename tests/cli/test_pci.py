"""`pavetwin pci` as a user types it."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pyogrio
import pytest

from pavetwin.pci import Survey, sample_units
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.command_line import pavetwin, plain_refusal


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pci") / "cross"
    save_world(damaged("cross", 8), folder)
    return folder


def test_a_world_is_rated_by_unit_and_street(world: Path) -> None:
    done = pavetwin("pci", world)
    assert done.returncode == 0, done.stderr
    survey = Survey(sample_units(damaged("cross", 8).world.segments), damaged("cross", 8).world.defects)
    assert f"PCI {survey.pci():.1f}" in done.stdout
    units = pl.read_csv(world / "pci" / "units.csv")
    assert units["pci"].to_list() == [round(each.pci, 1) for each in survey.conditions()]
    streets = pl.read_csv(world / "pci" / "streets.csv")
    assert streets["pci"].to_list() == sorted(streets["pci"]), "the worst first"
    assert streets["units"].sum() == units.height
    assert streets["street"][0] in done.stdout
    meta, _, shapes, _ = pyogrio.raw.read(world / "pci" / "pci.gpkg", layer="sample_units")
    assert len(shapes) == units.height
    assert list(meta["fields"]) == units.columns
    assert (world / "pci" / "pci.png").stat().st_size > 10_000


def test_a_mission_is_rated_by_what_it_found(world: Path, tmp_path: Path) -> None:
    flown = pavetwin(
        *("fly", world, "--density", "low", "--segments", "2", "--seed", "1", "--no-map", "-o", tmp_path / "m")
    )
    assert flown.returncode == 0, flown.stderr
    done = pavetwin("pci", tmp_path / "m", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "points too high" in done.stdout
    rows = pl.read_parquet(tmp_path / "m" / "mission.parquet")
    assert (rows["pci_error"] - (rows["pci_found"] - rows["pci"])).abs().max() < 1e-9
    assert rows["pci_error"].min() >= 0
    assert rows["pci_error"].max() > 0
    by_area = (rows["pci_found"] * rows["area_m2"]).sum() / rows["area_m2"].sum()
    assert f"it would be {by_area:.1f}" in done.stdout
    units = pl.read_csv(tmp_path / "out" / "units.csv")
    assert (units["pci_found"] >= units["pci"]).all()
    assert (tmp_path / "out" / "pci-found.png").is_file()
    streets = pl.read_csv(tmp_path / "m" / "streets.csv").sort("street")
    mine = pl.read_csv(tmp_path / "out" / "streets.csv").sort("street")
    assert streets.select("pci", "pci_found").rows() == mine.select("pci", "pci_found").rows()


def test_defects_that_do_not_count_are_told(world: Path, tmp_path: Path) -> None:
    built = damaged("cross", 8)
    heaves = [replace(built.world.defects[0], kind="frost_heave"), *built.world.defects[1:]]
    save_world(replace(built, world=replace(built.world, defects=tuple(heaves))), tmp_path / "w")
    done = pavetwin("pci", tmp_path / "w")
    assert done.returncode == 0, done.stderr
    assert "Not counted: a defect of the class 'frost_heave'" in done.stdout
    assert "Not counted" not in pavetwin("pci", world).stdout


def test_what_is_neither_world_nor_mission_is_refused(world: Path, tmp_path: Path) -> None:
    assert "neither the folder of a world nor of a mission" in plain_refusal(pavetwin("pci", tmp_path))
    (tmp_path / "hover").mkdir()
    (tmp_path / "hover" / "mission.yaml").write_text("format: 5\n", encoding="utf-8")
    assert f"name one: {tmp_path / 'hover'}" in plain_refusal(pavetwin("pci", tmp_path))
    line = plain_refusal(pavetwin("pci", tmp_path / "hover" / "mission.yaml"))
    assert line.startswith(f"Error: There is no folder '{tmp_path / 'hover' / 'mission.yaml'}'; name that of a world")
    (tmp_path / "taken").write_text("", encoding="utf-8")
    assert "--output" in plain_refusal(pavetwin("pci", world, "-o", tmp_path / "taken"))


def test_a_place_that_cannot_be_written_is_one_line(world: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    for target in (Path("/proc/pci"), tmp_path / "file" / "pci"):
        assert plain_refusal(pavetwin("pci", world, "-o", target)).startswith(f"Error: Cannot write '{target}")


def test_maps_of_a_former_survey_do_not_stay(world: Path, tmp_path: Path) -> None:
    for name in ("pci-found.png", "pci-detected.png", "mine.png"):
        (tmp_path / name).write_text("", encoding="utf-8")
    assert pavetwin("pci", world, "-o", tmp_path).returncode == 0
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["mine.png", "pci.png"]
