"""`pavetwin handover` as a user types it."""

import os
import re
import shutil
import signal
import sqlite3
import subprocess
import zipfile
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import polars as pl
import pytest

from pavetwin.sensing.fitted_sensor import DEFAULT, sensor_path
from pavetwin.world.store import save_world
from scenes import built, damaged
from scenes.command_line import command, pavetwin, plain_refusal

FILES = {"handover.pdf", "handover.html", "map.png", "defects.csv", "units.csv", "streets.csv"} | {
    "handover.gpkg",
    "handover.xlsx",
    "plan",
}


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("handover")
    save_world(damaged("cross", 8), folder / "cross")
    flown = pavetwin(
        *("fly", folder / "cross", "--density", "low", "--segments", "2", "--policy", "hover"),
        *("--seed", "1", "--no-map", "-o", folder / "m"),
    )
    assert flown.returncode == 0, flown.stderr
    return folder / "m"


@pytest.fixture(scope="module")
def made(mission: Path) -> Path:
    done = pavetwin("handover", mission)
    assert done.returncode == 0, done.stderr
    assert "The pilot is responsible" in done.stdout
    return mission / "handover"


def sheets_of(path: Path) -> dict[str, list[list[str]]]:
    """The cells of a workbook by sheet, as its XML has them; a reader that knows nothing of who wrote it."""
    space = {"m": "http://schemas.openxmlformats.org/spreadsheetml/2006/main"}
    with zipfile.ZipFile(path) as book:
        texts = ["".join(node.itertext()).strip() for node in ElementTree.fromstring(book.read("xl/sharedStrings.xml"))]
        names = [sheet.attrib["name"] for sheet in ElementTree.fromstring(book.read("xl/workbook.xml")).iter(
            f"{{{space['m']}}}sheet"
        )]  # fmt: skip
        found = {}
        for number, name in enumerate(names, 1):
            root = ElementTree.fromstring(book.read(f"xl/worksheets/sheet{number}.xml"))
            rows = []
            for row in root.findall(".//m:row", space):
                cells: dict[str, str] = {}
                for cell in row.findall("m:c", space):
                    value = cell.findtext("m:v", "", space)
                    column = re.sub(r"\d", "", cell.attrib["r"])
                    cells[column] = texts[int(value)] if cell.attrib.get("t") == "s" else value
                rows.append(cells)
            heads = list(rows[0])
            found[name] = [[row.get(column, "") for column in heads] for row in rows]
    return found


def same(one: object, other: object) -> bool:
    """Whether two cells hold the same: numbers as such, and nothing as nothing."""
    texts = ["" if each is None else str(each) for each in (one, other)]
    try:
        return abs(float(texts[0]) - float(texts[1])) < 1e-9
    except ValueError:
        return texts[0] == texts[1]


class Words(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.text = ""

    def handle_data(self, data: str) -> None:
        self.text += f"{data} "


def test_tables_are_the_same_in_csv_workbook_and_geopackage(made: Path) -> None:
    sheets = sheets_of(made / "handover.xlsx")
    assert list(sheets) == ["defects", "sample units", "streets"]
    for sheet, name in zip(sheets.values(), ("defects", "units", "streets"), strict=True):
        heads, *rows = pl.read_csv(made / f"{name}.csv", has_header=False).rows()
        assert sheet[0] == list(heads)
        assert len(sheet) == len(rows) + 1
        assert all(
            same(*pair) for one, other in zip(sheet[1:], rows, strict=True) for pair in zip(one, other, strict=True)
        )
    with sqlite3.connect(made / "handover.gpkg") as base:
        for layer, qml in base.execute("SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault").fetchall():
            renderer = ElementTree.fromstring(qml.partition("\n")[2]).find("renderer-v2")
            assert renderer is not None
            values = {row[0] for row in base.execute(f"SELECT {renderer.get('attr')} FROM {layer}")}
            assert values <= {each.get("value") for each in renderer.iter("category")}, layer
        assert base.execute("SELECT count(*) FROM layer_styles").fetchone() == (2,)
        for layer, name in (("defects", "defects"), ("sample_units", "units")):
            table = pl.read_csv(made / f"{name}.csv")
            columns = ", ".join(f'"{column}"' for column in table.columns if column != "geom")
            there = base.execute(f"SELECT {columns} FROM {layer}").fetchall()
            assert len(there) == table.height
            assert all(
                same(*pair)
                for one, other in zip(there, table.rows(), strict=True)
                for pair in zip(one, other, strict=True)
            )


def test_the_page_shows_the_numbers_of_the_tables(made: Path) -> None:
    defects, streets = pl.read_csv(made / "defects.csv"), pl.read_csv(made / "streets.csv")
    found = defects.filter(outcome="found").height
    assert 0 < found < defects.height
    assert (streets["found"].sum(), streets["defects"].sum()) == (found, defects.height)
    assert streets["missed"].sum() == defects.filter(outcome="missed").height
    reader = Words()
    reader.feed((made / "handover.html").read_text(encoding="utf-8"))
    assert f"{found} of {defects.height}" in reader.text
    units = pl.read_csv(made / "units.csv")
    for column in ("pci", "pci_found"):
        mean = (units[column] * units["area_m2"]).sum() / units["area_m2"].sum()
        assert any(f"{mean + slip:.1f}," in reader.text for slip in (-0.05, 0.0, 0.05)), column
    for row in streets.iter_rows(named=True):
        assert re.search(
            rf"{re.escape(row['street'])}\s+{row['length_m']:.0f}\s+{100 * row['surface_coverage']:.0f}\s+"
            rf"{row['found']} of {row['defects']}\s+{row['pci']:.1f}\s+{row['pci_found']:.1f}\s+{row['rating_found']}",
            reader.text,
        )
    for (kind, severity), some in defects.group_by("class", "severity"):
        hit = some.filter(outcome="found").height
        row = rf"{str(kind).replace('_', ' ')}, {severity}\s+{some.height}\s+{hit}\s+{some.height - hit}\s"
        assert re.search(row, reader.text)
    for reason, count in defects["reason"].drop_nulls().value_counts().rows():
        assert f"{count} " in reader.text.split("What will not be seen")[1], reason


def test_condition_and_plans_are_those_of_their_own_commands(mission: Path, made: Path, tmp_path: Path) -> None:
    assert pavetwin("pci", mission, "-o", tmp_path / "pci").returncode == 0
    assert (made / "units.csv").read_bytes() == (tmp_path / "pci" / "units.csv").read_bytes()
    shared = pl.read_csv(tmp_path / "pci" / "streets.csv").columns
    assert pl.read_csv(made / "streets.csv").select(shared).equals(pl.read_csv(tmp_path / "pci" / "streets.csv"))
    assert pavetwin("plan", "export", mission, "-o", tmp_path / "plan").returncode == 0
    (plan,) = (made / "plan").iterdir()
    assert plan.read_bytes() == (tmp_path / "plan" / plan.name).read_bytes()


def test_the_sheet_is_one_page_of_a4(made: Path) -> None:
    content = (made / "handover.pdf").read_bytes()
    (width, height) = map(float, re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)[0])
    assert (round(width), round(height)) == (595, 842)
    assert content.count(b"/Type /Page ") == 1


def test_a_policy_that_needs_an_observer_is_marked(made: Path) -> None:
    reader = Words()
    reader.feed((made / "handover.html").read_text(encoding="utf-8"))
    assert "hover: with an observer. An observer sees on the live picture that the road is hidden" in reader.text
    assert "baseline (anyone); skip (with an observer); micro (nobody by hand)" in reader.text


def test_the_same_mission_gives_the_same_bytes(mission: Path, made: Path, tmp_path: Path) -> None:
    assert pavetwin("handover", mission, "-o", tmp_path / "out").returncode == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    for path in made.iterdir():
        if path.is_file():
            assert path.read_bytes() == (tmp_path / "out" / path.name).read_bytes(), path.name


def _drop_column(path: Path) -> None:
    pl.read_csv(path / "streets.csv").drop("surface_coverage").write_csv(path / "streets.csv")


def _another_outcome(path: Path) -> None:
    table = pl.read_csv(path / "defects.csv", infer_schema_length=None)
    one = table.filter(outcome="found")["id"][0]
    table.with_columns(
        pl.when(id=one).then(pl.lit("missed")).otherwise("outcome").alias("outcome")
    ).write_csv(path / "defects.csv")  # fmt: skip


def _no_id(path: Path) -> None:
    text = (path / "captures.geojson").read_text()
    (path / "captures.geojson").write_text(re.sub(r'"id": \d+', '"id": null', text))


def _another_format(path: Path) -> None:
    text = (path / "mission.yaml").read_text()
    (path / "mission.yaml").write_text(text.replace("format: 1\n", "format: 9\n"))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (_another_format, "reads only format 1"),
        (_drop_column, "has no column 'surface_coverage': it is damaged; fly"),
        (_another_outcome, "is not of the same mission as mission.yaml"),
        (
            lambda path: (path / "defects.csv").write_bytes(b"\x00\xff"),
            "defects.csv' has no column 'id': it is damaged;",
        ),
        (lambda path: (path / "streets.csv").unlink(), "streets.csv' is missing or damaged; fly the mission again."),
        (
            lambda path: (path / "track.parquet").write_bytes(b"PAR1"),
            "track.parquet' is damaged; fly the mission again",
        ),
        (lambda path: (path / "captures.geojson").unlink(), "has no captures.geojson"),
        (_no_id, "captures.geojson' is damaged; fly the mission again."),
    ],
)
def test_a_damaged_mission_is_one_line(
    mission: Path, tmp_path: Path, damage: Callable[[Path], object], words: str
) -> None:
    shutil.copytree(mission, tmp_path / "m", ignore=shutil.ignore_patterns("handover"))
    damage(tmp_path / "m")
    assert words in plain_refusal(pavetwin("handover", tmp_path / "m"))
    assert not (tmp_path / "m" / "handover").exists()


def test_a_world_that_has_changed_is_refused(mission: Path, tmp_path: Path) -> None:
    shutil.copytree(mission, tmp_path / "m", ignore=shutil.ignore_patterns("handover"))
    description = (mission / "mission.yaml").read_text()
    changed = description.replace(str(mission.parent / "cross"), str(tmp_path / "cross"))
    (tmp_path / "m" / "mission.yaml").write_text(changed)
    save_world(damaged("cross", 7), tmp_path / "cross")
    reported = plain_refusal(pavetwin("handover", tmp_path / "m"))
    assert reported.startswith("Error: The mission's inputs have changed: the world 'cross'")


def test_only_a_handover_is_replaced(mission: Path, made: Path, tmp_path: Path) -> None:
    assert "holds a handover; choose another folder, or replace it (--force)" in plain_refusal(
        pavetwin("handover", mission)
    )
    shutil.copytree(made, tmp_path / "old")
    (tmp_path / "old" / "plan" / "flight-7.plan").write_text("{}")
    assert pavetwin("handover", mission, "-o", tmp_path / "old", "--force").returncode == 0
    assert not (tmp_path / "old" / "plan" / "flight-7.plan").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    reported = plain_refusal(pavetwin("handover", mission, "-o", tmp_path / "mine", "--force"))
    assert "exists and holds no handover" in reported
    assert (tmp_path / "mine" / "notes.txt").read_text() == "keep"
    assert "it is a file" in plain_refusal(pavetwin("handover", mission, "-o", tmp_path / "mine" / "notes.txt"))


def test_limits_of_plans_hold(mission: Path, tmp_path: Path) -> None:
    reported = plain_refusal(pavetwin("handover", mission, "-o", tmp_path / "out", "--highest", "9"))
    assert reported.startswith("Error: --highest 9: flight 1 goes up to 10 m above take-off")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_handover_that_is_killed_leaves_nothing_that_looks_like_one(mission: Path, tmp_path: Path) -> None:
    """It is stopped within the block that writes, and cleared away by the next one."""
    target = tmp_path / "out"
    with subprocess.Popen(command("handover", mission, "-o", target), stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not any(tmp_path.glob(".out-*/handover.xlsx")):
            os.sched_yield()
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not target.exists()
    assert pavetwin("handover", mission, "-o", target).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
    assert {path.name for path in target.iterdir()} == FILES


def test_a_folder_that_is_no_mission_is_refused(mission: Path) -> None:
    reported = plain_refusal(pavetwin("handover", mission.parent / "cross"))
    assert reported.endswith("is neither the folder of a mission (mission.yaml) nor of a study (design.yaml).")


def test_what_a_sensor_measured_is_listed_as_an_inventory_lists_it(mission: Path, tmp_path: Path) -> None:
    """Sizes as the sensor `detector` states them, in a mission of one that states none."""
    shutil.copytree(mission, tmp_path / "m", ignore=shutil.ignore_patterns("handover"))
    table = pl.read_parquet(mission / "detections.parquet")
    measured = {"area_m2": pl.lit(0.25), "pixel_mm": pl.lit(4.0), "is_cut": pl.lit(False)}
    table.with_columns(**measured).write_parquet(tmp_path / "m" / "detections.parquet")
    done = pavetwin("handover", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert " inventory/, " in done.stdout
    assert pavetwin("inventory", tmp_path / "m", "-o", tmp_path / "alone").returncode == 0
    inside = tmp_path / "m" / "handover" / "inventory"
    for name in ("inventory.csv", "inventory.geojson"):
        assert (inside / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert pl.read_csv(inside / "inventory.csv").height > 0


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    save_world(damaged("cross", 6), folder / "cross")
    (folder / "d.yaml").write_text(
        "worlds: [cross]\ndensities: [low]\naltitudes_m: [10]\npolicies: [baseline, hover]\nreplicates: 2\n"
        "presets: [paper]\nsensors: [calibrated]\n"
    )
    done = pavetwin("experiment", "run", "d.yaml", "-o", "s", "--jobs", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    text = (folder / "s" / "design.yaml").read_text()
    assert f"fitted: {DEFAULT}" in text
    # The default at the time of the study was another fitted sensor.
    shutil.copyfile(sensor_path(DEFAULT), folder / "other.json")
    (folder / "s" / "design.yaml").write_text(text.replace(f"fitted: {DEFAULT}", f"fitted: {folder / 'other.json'}"))
    return folder / "s"


@pytest.mark.slow
def test_a_study_hands_over_what_it_recommends(study: Path) -> None:
    advised = pavetwin("experiment", "recommend", study).stdout
    done = pavetwin("handover", study, cwd=study.parent)
    assert done.returncode == 0, done.stderr
    sentence = next(line for line in advised.splitlines() if line.startswith("Fly "))
    assert sentence in done.stdout
    made = study / "handover"
    assert {path.name for path in made.iterdir()} == FILES | {"mission"}
    policy = sentence.split()[1]
    streets = pl.read_csv(made / "streets.csv")
    assert set(streets["fly"]) == {f"{policy} at 10\u00a0m"}
    flown = pl.read_parquet(made / "mission" / "mission.parquet")
    assert set(flown["policy"]) == {policy}
    assert f"fitted: {study.parent / 'other.json'}" in (made / "mission" / "mission.yaml").read_text(), (
        "the study's, not today's default"
    )
    assert set(flown["segment"]) == set(" ".join(streets["segments"]).split())
    assert set(flown["segment"]) == set(pl.read_parquet(study / "segments.parquet")["segment"])
    reader = Words()
    reader.feed((made / "handover.html").read_text(encoding="utf-8"))
    assert "Handover of s, simulated" in reader.text
    assert sentence in reader.text
    again = pavetwin("handover", made / "mission", "--study", study, "-o", study.parent / "again")
    assert again.returncode == 0, again.stderr
    for name in ("defects.csv", "units.csv", "streets.csv"):
        assert (study.parent / "again" / name).read_bytes() == (made / name).read_bytes()


def test_a_study_over_another_world_of_the_same_name_is_refused(study: Path, tmp_path: Path) -> None:
    save_world(built("cross", parking_rule="north_america"), tmp_path / "cross")
    flown = pavetwin("fly", tmp_path / "cross", "--segments", "1", "--density", "low", "--no-map", "-o", tmp_path / "m")
    assert flown.returncode == 0, flown.stderr
    reported = plain_refusal(pavetwin("handover", tmp_path / "m", "--study", study))
    assert reported.startswith("Error: --study: its world 'cross' (")
    assert reported.endswith("though it has the same name; name a study over the mission's world.")
    assert not (tmp_path / "m" / "handover").exists()


def test_the_world_of_a_study_must_be_there(study: Path, tmp_path: Path) -> None:
    shutil.copytree(study, tmp_path / "s", ignore=shutil.ignore_patterns("handover"))
    text = (study / "design.yaml").read_text()
    (tmp_path / "s" / "design.yaml").write_text(re.sub(r"(- path: ).*cross", r"\1gone", text))
    reported = plain_refusal(pavetwin("handover", tmp_path / "s", cwd=tmp_path))
    assert reported.endswith("of the study is no longer at 'gone'; put it back.")
    save_world(built("cross", parking_rule="north_america"), tmp_path / "gone")
    reported = plain_refusal(pavetwin("handover", tmp_path / "s", cwd=tmp_path))
    assert reported.endswith("is not what the study flew over.")
    assert {path.name for path in tmp_path.iterdir()} == {"s", "gone"}
    assert not (tmp_path / "s" / "handover").exists()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--study", "gone"), "Error: --study gone: this folder holds no study."),
        (("--traffic", "low"), "Error: --traffic low: it is for a study; name one, or add --study."),
        (("--choose", "best"), "Error: --choose: no objective 'best'"),
    ],
)
def test_options_of_studies_are_refused_without_one(mission: Path, words: tuple[str, ...], line: str) -> None:
    assert plain_refusal(pavetwin("handover", mission, *words)).startswith(line)
