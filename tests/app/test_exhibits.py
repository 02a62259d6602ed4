"""Studies and datasets in the page: the command line's report and contact sheet, of folders that the command names."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from PIL import Image

from pavetwin.app.exhibits import _MARKS, REPORT, SHEET, ExhibitKind, exhibit_kind
from pavetwin.app.session import Session
from pavetwin.capture.settings import FILE as CAPTURED
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.store import DESIGN
from pavetwin.labels.common_form import DESCRIPTION as PHOTOGRAPHS
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.command_line import pavetwin
from scenes.folders import digests
from scenes.page import RunningPage, running_page
from scenes.photographs import picture, voc


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flown study over a world, a dataset of photographs, and one that is damaged."""
    folder = tmp_path_factory.mktemp("exhibits")
    save_world(damaged("cross", 6), folder / "worlds" / "cross")
    assert pavetwin("experiment", "init", "study.yaml", "--world", "worlds/cross", cwd=folder).returncode == 0
    values = yaml.safe_load((folder / "study.yaml").read_text())
    values |= {"densities": ["low"], "replicates": 2, "policies": ["baseline"], "altitudes_m": [10.0]}
    (folder / "study.yaml").write_text(yaml.safe_dump(values))
    done = pavetwin("experiment", "run", "study.yaml", "-o", "study", "--jobs", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    for number in range(3):
        picture(folder / "source" / f"{number}.jpg", seed=number)
        voc(folder / "source" / f"{number}.xml", [("PH", (8, 8, 30, 30))])
    done = pavetwin("data", "import", "uapd", folder / "source", "-o", folder / "photographs")
    assert done.returncode == 0, done.stderr
    (folder / "damaged").mkdir()
    (folder / "damaged" / "design.yaml").write_text("format: [")
    return folder


@pytest.fixture(scope="module")
def page(place: Path) -> Iterator[RunningPage]:
    with running_page([place / name for name in ("study", "photographs", "worlds/cross", "damaged")]) as running:
        yield running


def show(page: RunningPage, exhibit: Any) -> dict[str, Any]:
    (answer,) = page.ask({"do": "show", "exhibit": exhibit})
    return answer


def test_the_page_lists_worlds_apart_from_studies_and_datasets(page: RunningPage) -> None:
    start = page.get("/api/start").values
    assert [world["name"] for world in start["worlds"]] == ["cross"]
    assert [(each["id"], each["name"], each["kind"]) for each in start["exhibits"]] == [
        ("x0", "study", "study"),
        ("x1", "photographs", "photographs"),
        ("x3", "damaged", "study"),
    ]


@pytest.mark.slow
def test_a_study_shows_the_report_that_the_command_line_writes(page: RunningPage, place: Path, tmp_path: Path) -> None:
    before = digests(place / "study")
    done = show(page, "x0")["done"]
    assert done["file"] == REPORT
    answer = page.get(f"/api/exhibits/{done['key']}/{REPORT}")
    assert pavetwin("experiment", "report", place / "study", "-o", tmp_path).returncode == 0
    assert answer.body == (tmp_path / REPORT).read_bytes()
    assert answer.headers["Content-Type"].startswith("text/html")
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox;")
    assert "script-src" not in policy
    assert "default-src 'none'" in policy
    assert digests(place / "study") == before, "the study itself is only read"
    assert show(page, "x0")["done"] == done
    (place / "study" / "notes.txt").write_text("a change")
    assert show(page, "x0")["done"]["key"] != done["key"]
    (place / "study" / "notes.txt").unlink()


def test_a_dataset_shows_its_contact_sheet(page: RunningPage, place: Path, tmp_path: Path) -> None:
    done = show(page, "x1")["done"]
    answer = page.get(f"/api/exhibits/{done['key']}/{SHEET}")
    assert pavetwin("data", "show", place / "photographs", "-o", tmp_path / "sheet.jpg").returncode == 0
    assert answer.body == (tmp_path / "sheet.jpg").read_bytes()
    (tmp_path / "served.jpg").write_bytes(answer.body)
    with Image.open(tmp_path / "served.jpg") as image:
        assert image.width > 100
    assert not (place / "photographs" / "contact-sheet.png").exists()


def test_a_damaged_exhibit_is_reported_in_one_line(page: RunningPage) -> None:
    assert "is damaged" in show(page, "x3")["error"]


@pytest.mark.parametrize("exhibit", ["x9", "../study", "/etc", None, ["x0"], {"a": 1}, 0])
def test_others_than_those_of_the_command_are_refused(page: RunningPage, exhibit: Any) -> None:
    assert "no study or dataset" in show(page, exhibit)["error"]


@pytest.mark.parametrize("path", ["x/report.html", "{key}/table.csv", "{key}/..%2fstudy", "..%2f..%2fetc/passwd"])
def test_other_files_are_not_served(page: RunningPage, path: str) -> None:
    key = show(page, "x1")["done"]["key"]
    assert page.get(f"/api/exhibits/{path.format(key=key)}").status == 404


def test_kinds_follow_from_the_files_of_the_commands(tmp_path: Path) -> None:
    assert list(_MARKS) == [DESIGN, CAPTURED, PHOTOGRAPHS]
    for name in (DESIGN, CAPTURED, PHOTOGRAPHS):
        (tmp_path / name).mkdir()
    assert exhibit_kind(tmp_path) is None
    (tmp_path / DESIGN).rmdir()
    (tmp_path / DESIGN).write_text("")
    assert exhibit_kind(tmp_path) is ExhibitKind.STUDY


def test_a_folder_that_is_nothing_of_these_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="is not a world"):
        Session.of([tmp_path])


def test_worlds_here_are_shown_where_only_studies_are_given(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    session = Session.of([Path("study")])
    assert [world.name for world in session.worlds] == ["cross"]
    session._held.close()
