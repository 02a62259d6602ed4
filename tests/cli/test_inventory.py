"""`pavetwin inventory` and `pavetwin pci`: their files, and refused input."""

import csv
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import polars as pl
import pyogrio
import pytest
import shapely
from PIL import Image

from pavetwin.mission.saving import save_mission
from pavetwin.pci import Survey, sample_units
from pavetwin.world.store import save_world
from scenes import built, damaged
from scenes.aerial import FOCAL_PX, HEIGHT_M, LATITUDE, LONGITUDE, aerial_photograph
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_detector import FILE, drawn
from scenes.tiny import empty_street

STREET = drawn((640, 480), ("pothole", (100, 100, 160, 150)), ("crocodile_crack", (300, 200, 420, 330)))


@pytest.fixture(scope="module")
def listed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Inventory of two photographs of one place, and of one without metadata."""
    folder = tmp_path_factory.mktemp("inventory")
    (folder / "in").mkdir()
    for name in ("a.jpg", "b.jpg"):
        (folder / "in" / name).write_bytes(aerial_photograph(STREET))
    drawn((96, 96), ("pothole", (30, 10, 60, 90))).save(folder / "in" / "c.png")
    done = pavetwin("inventory", folder / "in", "--model", FILE, "-o", folder / "out")
    assert done.returncode == 0, done.stderr
    return folder / "out", done.stdout


def test_detections_and_missing_metadata_are_printed(listed: tuple[Path, str]) -> None:
    lines = listed[1].splitlines()
    assert lines[0] == "5 detections in 3 images: 3 entries (Pothole 2, Crocodile Crack 1)."
    assert lines[1].startswith(
        "1 of 3 photographs, such as 'c.png': no position; its defects are given in pixels, sizes"
    )
    assert "with --gsd-mm only." in lines[1]


def test_photographs_may_be_looked_at_in_tiles_and_as_a_whole(listed: tuple[Path, str], tmp_path: Path) -> None:
    """Other confidences are those of another look."""
    done = pavetwin("inventory", listed[0].parent / "in", "--model", FILE, "-o", tmp_path / "out", "--overview")
    assert done.returncode == 0, done.stderr
    both, usual = (
        [float(row["confidence"]) for row in csv.DictReader((folder / "inventory.csv").open())]
        for folder in (tmp_path / "out", listed[0])
    )
    assert len(both) > 0
    assert both != usual


def test_the_table_has_all_entries_and_the_maps_those_with_a_place(listed: tuple[Path, str]) -> None:
    folder = listed[0]
    rows = list(csv.DictReader((folder / "inventory.csv").open()))
    assert sorted((row["class"], row["looks"], bool(row["longitude"])) for row in rows) == [
        ("Crocodile Crack", "2", True),
        ("Pothole", "1", False),
        ("Pothole", "2", True),
    ]
    assert {row["probability"] for row in rows} == {""}, "no sensor was fitted to this detector"
    (bare,) = [row for row in rows if not row["longitude"]]
    assert (bare["image"], bare["left"], bare["area_m2"]) == ("c.png", "30.0", "")
    features = json.loads((folder / "inventory.geojson").read_text())["features"]
    assert len(features) == 2
    pothole = next(each for each in features if each["properties"]["class"] == "Pothole")
    gsd_m = HEIGHT_M / FOCAL_PX
    east, north = (130 - 320) * gsd_m, (240 - 125) * gsd_m
    metres = 111_265.0
    longitude, latitude = pothole["geometry"]["coordinates"]
    assert (latitude - LATITUDE) * metres == pytest.approx(north, abs=0.03)
    assert (longitude - LONGITUDE) * metres * np.cos(np.radians(LATITUDE)) * 1.002 == pytest.approx(east, abs=0.03)
    assert pothole["properties"]["area_m2"] == pytest.approx(60 * 50 * gsd_m**2, rel=0.1)
    assert pothole["properties"]["area_m2_error"] > 0


def test_the_geopackage_opens_in_the_style_that_it_holds(listed: tuple[Path, str]) -> None:
    path = listed[0] / "inventory.gpkg"
    layers = dict(map(tuple, pyogrio.list_layers(path)))
    assert {"defects": "Point", "outlines": "Polygon"}.items() <= layers.items()
    about, _, places, columns = pyogrio.raw.read(path, layer="defects")
    assert about["crs"] == "EPSG:32633"
    kinds = list(columns[list(about["fields"]).index("class")])
    assert sorted(kinds) == ["Crocodile Crack", "Pothole"]
    _, _, outlines, _ = pyogrio.raw.read(path, layer="outlines")
    middles = shapely.centroid(shapely.from_wkb(outlines))
    assert (shapely.distance(middles, shapely.from_wkb(places)) < 0.05).all()
    with closing(sqlite3.connect(path)) as base:
        styles = base.execute(
            "SELECT f_table_name, f_geometry_column, styleQML, useAsDefault FROM layer_styles"
        ).fetchall()
        contents = base.execute("SELECT data_type FROM gpkg_contents WHERE table_name = 'layer_styles'").fetchall()
    assert contents == [("attributes",)]
    assert {name for name, *_ in styles} == {"defects", "outlines"}
    for _, column, qml, is_default in styles:
        assert (column, is_default) == ("geom", 1)
        root = fromstring(qml.partition("\n")[2])
        renderer = root.find("renderer-v2")
        assert renderer is not None
        assert renderer.get("attr") == "class"
        named = {each.get("value"): each.get("symbol") for each in renderer.iter("category")}
        assert set(kinds) <= set(named)
        assert {each.get("name") for each in renderer.iter("symbol")} == set(named.values())


def test_every_entry_has_a_crop_and_a_place_on_a_page(listed: tuple[Path, str]) -> None:
    folder = listed[0]
    rows = list(csv.DictReader((folder / "inventory.csv").open()))
    for row in rows:
        with Image.open(folder / row["crop"]) as crop:
            assert crop.width == crop.height >= 420
    assert [path.name for path in sorted(folder.glob("crops-*.jpg"))] == ["crops-01.jpg"]


def test_a_world_is_no_folder_of_photographs(tmp_path: Path) -> None:
    save_world(built("cross"), tmp_path / "town")
    line = plain_refusal(pavetwin("inventory", tmp_path / "town"))
    assert (
        line == f"Error: '{tmp_path / 'town'}' is a world; name the folder of one of its missions, or of photographs."
    )
    assert not (tmp_path / "town" / "inventory").exists()


def test_a_mission_needs_no_model(tmp_path: Path) -> None:
    save_mission(empty_street((20, 1), (45, 1)).fly("baseline"), tmp_path / "m")
    done = pavetwin("inventory", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert "2 entries (Pothole 2)." in done.stdout
    assert "pavetwin fly WORLD --save-frames hits" in done.stdout
    assert len(list(csv.DictReader((tmp_path / "m" / "inventory" / "inventory.csv").open()))) == 2
    again = pavetwin("inventory", tmp_path / "m")
    assert "exists and is not empty" in plain_refusal(again)
    assert pavetwin("inventory", tmp_path / "m", "--force").returncode == 0
    assert plain_refusal(pavetwin("inventory", tmp_path / "m", "-o", tmp_path / "o", "--gsd-mm", 2)) == (
        "Error: --gsd-mm is for photographs; omit it for missions, which hold their detections."
    )


def test_several_missions_are_one_inventory_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    """Both fly over the same two potholes; the third folder has a damaged table."""
    for name in ("a", "b", "old"):
        save_mission(empty_street((20, 1), (40, -1)).fly("baseline"), tmp_path / name)
    old = tmp_path / "old" / "detections.parquet"
    pl.read_parquet(old).drop("footprint").write_parquet(old)
    folders = [tmp_path / name for name in ("a", "old", "b")]
    done = pavetwin("inventory", *folders, "-o", tmp_path / "all")
    assert done.returncode == 0, done.stderr
    (reported,) = [line for line in done.stdout.splitlines() if "is damaged" in line]
    assert reported == f"'{old}' is damaged: it has no column 'footprint'; fly the mission again."
    rows = list(csv.DictReader((tmp_path / "all" / "inventory.csv").open()))
    alone = pavetwin("inventory", tmp_path / "a")
    assert alone.returncode == 0
    once = list(csv.DictReader((tmp_path / "a" / "inventory" / "inventory.csv").open()))
    assert len(rows) == len(once) == 2
    assert [int(row["looks"]) for row in rows] == [2 * int(row["looks"]) for row in once]
    refused = pavetwin("inventory", old.parent, "-o", tmp_path / "none")
    assert "is damaged" in plain_refusal(refused)
    assert "Name a folder for the inventory of several missions with --output." in plain_refusal(
        pavetwin("inventory", *folders)
    )
    (tmp_path / "photographs").mkdir()
    mixed = pavetwin("inventory", tmp_path / "a", tmp_path / "photographs", "-o", tmp_path / "none")
    assert "only missions are listed together" in plain_refusal(mixed)
    assert not (tmp_path / "none").exists()


def test_options_of_missions_count(tmp_path: Path) -> None:
    save_mission(empty_street((20, 1), (45, 1)).fly("baseline"), tmp_path / "m")
    path = tmp_path / "m" / "detections.parquet"
    table = pl.read_parquet(path)
    surer = pl.col("longitude") > table["longitude"].mean()
    table.with_columns(confidence=pl.when(surer).then(0.6).otherwise(0.4)).write_parquet(path)
    done = pavetwin("inventory", tmp_path / "m", "-o", tmp_path / "o", "--confidence", 0.5, "--position-error-m", 3)
    assert "1 entry (Pothole 1)." in done.stdout, done.stderr
    (row,) = csv.DictReader((tmp_path / "o" / "inventory.csv").open())
    assert row["confidence"] == "0.6"
    assert float(row["position_error_m"]) == pytest.approx(3 / np.sqrt(int(row["looks"])), abs=0.01)
    for option, value, words in (
        ("--confidence", 7, "it is from 0 to 1."),
        ("--confidence", "nan", "it is from 0 to 1."),
        ("--position-error-m", -1, "it must be 0 or more."),
        ("--position-error-m", "nan", "it must be a finite number."),
    ):
        refused = pavetwin("inventory", tmp_path / "m", "-o", tmp_path / "none", option, value)
        assert plain_refusal(refused) == f"Error: {option} {value}: {words}"
    assert not (tmp_path / "none").exists()


def test_wrong_options_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    STREET.save(tmp_path / "in" / "a.png")
    for arguments, words in (
        ((tmp_path / "none", "-o", tmp_path / "o"), "There is no folder"),
        ((tmp_path / "in", "-o", tmp_path / "o", "--model", "none-1"), "--model: There is no model 'none-1': name one"),
        ((tmp_path / "in", "-o", tmp_path / "o", "--model", FILE, "--gsd-mm", 0), "--gsd-mm 0: it must be above 0."),
        (
            (tmp_path / "in", "-o", tmp_path / "o", "--model", FILE, "--height-m", -3),
            "--height-m -3: it must be above 0",
        ),
        (
            (tmp_path / "in", "-o", tmp_path / "o", "--model", FILE, "--position-error-m", -1),
            "--position-error-m -1: it must be 0 or more.",
        ),
        (
            (tmp_path / "in", "-o", tmp_path / "o", "--model", FILE, "--height-m", "nan"),
            "--height-m nan: it must be a finite number.",
        ),
    ):
        assert words in plain_refusal(pavetwin("inventory", *arguments))
        assert not (tmp_path / "o").exists()


def test_without_a_detection_the_table_has_its_columns_alone(tmp_path: Path) -> None:
    save_mission(empty_street().fly("baseline"), tmp_path / "m")
    done = pavetwin("inventory", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert "0 entries." in done.stdout
    (header,) = (tmp_path / "m" / "inventory" / "inventory.csv").read_text().splitlines()
    assert header.startswith("id,class,severity,area_m2,area_m2_error,")
    assert not (tmp_path / "m" / "inventory" / "inventory.gpkg").exists()


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


def test_defects_that_do_not_count_are_listed(world: Path, tmp_path: Path) -> None:
    built = damaged("cross", 8)
    heaves = [replace(built.world.defects[0], kind="frost_heave"), *built.world.defects[1:]]
    save_world(replace(built, world=replace(built.world, defects=tuple(heaves))), tmp_path / "w")
    done = pavetwin("pci", tmp_path / "w")
    assert done.returncode == 0, done.stderr
    assert "Not counted: a defect of the class 'frost_heave'" in done.stdout
    assert "Not counted" not in pavetwin("pci", world).stdout


def test_a_folder_that_is_neither_world_nor_mission_is_refused(world: Path, tmp_path: Path) -> None:
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
