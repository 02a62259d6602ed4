"""`pavetwin experiment …`, and the note on worlds that differ from the published setup."""

import io
import re
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
import yaml

from pavetwin.cli.published import note_difference
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.experiments.store import Store
from pavetwin.world.store import load_world, save_world
from scenes import built, damaged
from scenes.command_line import command, pavetwin, plain_refusal


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a world, a design over it, and the study that was flown."""
    folder = tmp_path_factory.mktemp("studies")
    save_world(damaged("cross", 6), folder / "worlds" / "cross")
    made = pavetwin("experiment", "init", "study.yaml", "--world", "worlds/cross", cwd=folder)
    assert made.returncode == 0, made.stderr
    assert "Wrote study.yaml with the preset default. Next: pavetwin experiment run study.yaml -o study" in made.stdout
    values = yaml.safe_load((folder / "study.yaml").read_text())
    assert values["presets"] == ["default"]
    values |= {"densities": ["low"], "replicates": 4, "policies": ["baseline", "hover"]}
    (folder / "study.yaml").write_text(yaml.safe_dump(values))
    done = pavetwin("experiment", "run", "study.yaml", "-o", "study", "--jobs", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "16 missions flown, preset default" in done.stdout
    assert "16/16 (100%)" in done.stderr
    return folder


def test_the_next_command_can_be_copied_where_a_path_holds_spaces(tmp_path: Path) -> None:
    made = pavetwin("experiment", "init", "my study.yaml", cwd=tmp_path)
    assert "Next: pavetwin experiment run 'my study.yaml' -o 'my study'" in made.stdout


def test_a_design_explains_itself_and_is_not_replaced(place: Path) -> None:
    fresh = pavetwin("experiment", "init", "paper.yaml", "--preset", "paper", cwd=place)
    assert "with the preset paper" in fresh.stdout
    text = (place / "paper.yaml").read_text()
    assert yaml.safe_load(text)["presets"] == ["paper"]
    assert sum(line.startswith("#") for line in text.splitlines()) >= 8
    assert "exists" in plain_refusal(pavetwin("experiment", "init", "paper.yaml", cwd=place))
    assert "did you mean 'paper'" in plain_refusal(
        pavetwin("experiment", "init", "x.yaml", "--preset", "papr", cwd=place)
    )


def test_questions_are_answered_as_a_table_and_as_csv(place: Path) -> None:
    sql = "select policy, count(*) n from segments group by policy order by policy"
    shown = pavetwin("experiment", "query", "study", sql, cwd=place)
    assert shown.returncode == 0
    assert "baseline" in shown.stdout
    assert shown.stdout.rstrip().endswith("2 rows")
    piped = pavetwin("experiment", "query", "study", sql, "--csv", cwd=place)
    assert pl.read_csv(io.StringIO(piped.stdout)).rows() == [("baseline", 8), ("hover", 8)]


def test_a_recommendation_names_the_best_that_keeps_the_limits(place: Path) -> None:
    table = Store(place / "study").table()
    means = table.group_by("altitude_m", "policy").agg(pl.col("coverage", "time_s").mean())
    limit_s = float(means["time_s"].median())
    best = (
        means.filter(pl.col("time_s") <= limit_s)
        .sort("coverage", "time_s", descending=[True, False])
        .row(0, named=True)
    )
    done = pavetwin("experiment", "recommend", "study", "--max-time", limit_s, cwd=place)
    assert done.returncode == 0, done.stderr
    assert f"Fly {best['policy']} at {best['altitude_m']:g} m" in done.stdout
    assert done.stdout.count(" m  ") >= 4


@pytest.mark.slow
def test_wind_is_no_option_and_an_unfinished_study_is_noted(place: Path) -> None:
    values = yaml.safe_load((place / "study.yaml").read_text())
    values |= {
        "sweep": {"conditions.wind_mps": [0, 8], "tau_o": [0.5, 0.9]},
        "set": {"sensing.recall": 0.7},
        "altitudes_m": [10],
        "replicates": 2,
    }
    (place / "windy.yaml").write_text(yaml.safe_dump(values))
    assert pavetwin("experiment", "run", "windy.yaml", "-o", "windy", cwd=place).returncode == 0
    next((place / "windy" / "segments.parquet").glob("*r00001*")).unlink()
    done = pavetwin("experiment", "recommend", "windy", cwd=place)
    assert "only 8 of 16 missions are flown" in done.stdout
    headings = done.stdout.partition("0.5")[0]
    assert "tau_o" in headings
    assert "wind" not in headings
    assert "average over" in done.stdout
    asked = ("--choose", "highest", "--min-coverage", 1)
    assert pavetwin("experiment", "report", "windy", *asked, cwd=place).returncode == 0
    report = (place / "windy" / "report.html").read_text()
    assert "Of 2 replicates 1 are flown so far" in report
    assert "flies highest in" in report


def test_sensors_and_presets_are_no_options_and_have_an_advice_each(place: Path) -> None:
    values = yaml.safe_load((place / "study.yaml").read_text())
    values |= {"sensors": ["ideal", "recall"], "presets": ["paper", "default"], "altitudes_m": [10], "replicates": 2}
    (place / "assumed.yaml").write_text(yaml.safe_dump(values))
    assert pavetwin("experiment", "run", "assumed.yaml", "-o", "assumed", cwd=place).returncode == 0
    done = pavetwin("experiment", "recommend", "assumed", cwd=place)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\nFly ") == 4
    assert "With the sensor ideal with the preset default." in done.stdout
    assert not re.search("^Fly .*(sensor|preset)", done.stdout, re.MULTILINE)
    assert "With fewer than 5 replicates the probability" in done.stdout


def test_limits_that_no_option_meets_have_an_exit_code(place: Path) -> None:
    done = pavetwin("experiment", "recommend", "study", "--max-time", "1", cwd=place)
    assert done.returncode == 1
    assert "No option keeps the limits on average; the nearest is " in done.stdout


def test_the_highest_option_that_finds_enough_is_chosen(place: Path) -> None:
    done = pavetwin("experiment", "recommend", "study", "--choose", "highest", "--min-coverage", "1", cwd=place)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^Fly (baseline|hover) at 10 m:", done.stdout, re.MULTILINE)
    assert "Its lead over the next option" in done.stdout
    asked = ("experiment", "recommend", "study", "--choose", "fastest", "--max-energy", "50")
    refused = plain_refusal(pavetwin(*asked, cwd=place))
    assert refused.startswith("Error: --choose fastest: without a least coverage")
    assert "give --min-coverage" in refused


def test_a_report_lies_in_the_study_s_folder(place: Path) -> None:
    done = pavetwin("experiment", "report", "study", cwd=place)
    assert done.returncode == 0, done.stderr
    for name in ("report.html", "table.csv", "table.md", "table.tex"):
        assert (place / "study" / name).stat().st_size > 500
        assert name in done.stdout
    assert "Ignoring" not in done.stderr
    assert pavetwin("experiment", "run", "study.yaml", "-o", "study", cwd=place).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "none.yaml", "-o", "x"), "experiment init"),
        (("run", "study.yaml", "-o", "x", "--engine", "spark"), "known are local and dask"),
        (("run", "study.yaml", "-o", "x", "--scheduler", "tcp://a:1"), "only with --engine dask"),
        (("run", "study.yaml", "-o", "worlds"), "holds no study"),
        (("query", "nowhere", "from segments"), "holds no study"),
        (("query", "study", "drop view segments"), "not a query"),
        (("report", "worlds"), "holds no study"),
        (("recommend", "study", "--traffic", "hihg"), "--traffic hihg: the study has low"),
        (("recommend", "study", "--min-coverage", "120"), "less than or equal to 100"),
    ],
)
def test_a_mistake_is_one_plain_line(place: Path, arguments: tuple[str, ...], words: str) -> None:
    assert words in plain_refusal(pavetwin("experiment", *arguments, cwd=place))
    assert not (place / "x").exists()


def test_a_missing_world_is_reported(place: Path) -> None:
    (place / "gone.yaml").write_text("worlds: [worlds/gone]\n")
    printed = plain_refusal(pavetwin("experiment", "run", "gone.yaml", "-o", "x", cwd=place))
    assert "worlds/gone' does not exist" in printed


def test_another_design_is_refused_and_nothing_is_mixed(place: Path) -> None:
    before = {path: path.read_bytes() for path in (place / "study" / "segments.parquet").iterdir()}
    values = yaml.safe_load((place / "study.yaml").read_text()) | {"seed": 9}
    (place / "other.yaml").write_text(yaml.safe_dump(values))
    printed = plain_refusal(pavetwin("experiment", "run", "other.yaml", "-o", "study", cwd=place))
    assert "its seed is 1, not 9" in printed
    assert {path: path.read_bytes() for path in before} == before


SCHEDULER = """
import sys
from distributed import LocalCluster

cluster = LocalCluster(1, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None)
print(cluster.scheduler_address, flush=True)
sys.stdin.read()
"""


@pytest.mark.slow
def test_the_same_command_continues_after_a_dead_scheduler(place: Path) -> None:
    piped = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", SCHEDULER], **piped) as scheduler:
        address = scheduler.stdout.readline().strip()
        flown = command("experiment", "run", "study.yaml", "-o", "gone", "--engine", "dask", "--scheduler", address)
        with subprocess.Popen(flown, **piped, cwd=place) as study:
            while not any((place / "gone").glob("segments.parquet/*.parquet")):
                assert study.poll() is None
                time.sleep(0.01)
            scheduler.kill()
            _, words = study.communicate()
    assert study.returncode == 2
    lines = [line for line in words.splitlines() if not line.endswith((" …", "%)"))]
    assert lines == [
        f"Error: The Dask scheduler {address} has stopped; flown missions are kept. Once one runs again, the same "
        "command "
        "continues."
    ]
    assert pavetwin("experiment", "run", "study.yaml", "-o", "gone", cwd=place).returncode == 0


BUILD = "pavetwin world build … --parking-rule none"
WITH, WITHOUT = "europe", "none"


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a world of each parking rule, named as the rule."""
    folder = tmp_path_factory.mktemp("published")
    for rule in (WITH, WITHOUT):
        made = add_defects(built("cross", parking_rule=rule), DefectOptions(population="paper", per_segment=2))
        save_world(made, folder / rule)
    return folder


@pytest.mark.parametrize(
    ("rule", "preset", "is_told"), [(WITH, "paper", True), (WITHOUT, "paper", False), (WITH, "default", False)]
)
def test_parking_lanes_are_noted_once_with_the_preset_paper(
    worlds: Path, tmp_path: Path, rule: str, preset: str, is_told: bool
) -> None:
    def notice(*arguments: object) -> list[str]:
        done = pavetwin(*arguments)
        assert done.returncode == 0, done.stderr
        return [line for line in (done.stdout + done.stderr).splitlines() if BUILD in line]

    design = tmp_path / "study.yaml"
    printed = [notice("experiment", "init", design, "--world", worlds / rule, "--preset", preset)]
    values = yaml.safe_load(design.read_text())
    values |= {"densities": ["low"], "altitudes_m": [10], "policies": ["baseline"], "replicates": 1, "segments": 1}
    design.write_text(yaml.safe_dump(values))
    printed.append(notice("experiment", "run", design, "-o", tmp_path / "study", "--jobs", "1"))
    short = ("--density", "low", "--segments", "1", "-o", tmp_path / "mission")
    printed.append(notice("fly", worlds / rule, *short, "--preset", preset))
    assert [len(lines) for lines in printed] == [int(is_told)] * 3
    assert all("parking lanes" in line and "wider" in line for (line,) in filter(None, printed))


@pytest.mark.parametrize(("placed_by", "reported"), [("survey", "damage population in other (survey)"), ("paper", "")])
def test_defects_of_another_population_are_noted(
    tmp_path: Path, placed_by: str, reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = DefectOptions(population=placed_by, per_segment=1)
    save_world(add_defects(built("cross", parking_rule="none"), options), tmp_path / "other")
    for world in (tmp_path / "other", load_world(tmp_path / "other")):
        note_difference(["paper"], [world])
        printed = capsys.readouterr().out
        assert reported in printed
        assert ("--damage paper" in printed) == bool(reported)
    note_difference(["paper"], [tmp_path / "other"], "paper")
    note_difference(["default"], [tmp_path / "other"])
    assert capsys.readouterr().out == ""
