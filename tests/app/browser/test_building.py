"""The page in Chromium: towns from maps, flights by keys, sheets of captures and reports of studies."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pavetwin.capture.platforms.car import REAR
from scenes.browser import PATIENCE_S, BrowserTab, tab_of
from scenes.command_line import pavetwin
from scenes.page import running_page
from scenes.photographs import picture, voc

DROP = """(() => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(['<osm'], 'dropped.osm'));
  const drop = new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer });
  document.querySelector('#map').dispatchEvent(drop);
})()"""
"""A file that is dropped on the map."""

CROSS = (Path(__file__).parents[2] / "scenes" / "cross.osm").read_bytes()

pytestmark = pytest.mark.slow


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "worlds"


@pytest.fixture
def building(browser: Any, world: Path, place: Path) -> Iterator[BrowserTab]:
    """A page of a server of its own, which may build towns."""
    with running_page([world], place) as running:
        made = tab_of(browser, running)
        made.open("#world=cross&traffic=low&seed=1&count=1")
        made.ready()
        yield made
        made.page.close()
        assert made.errors == []


def test_a_map_becomes_a_town_that_is_shown(building: BrowserTab, place: Path) -> None:
    page = building.page
    building.value(DROP)
    assert page.input_value("#new-town [name=name]") == "dropped"
    page.keyboard.press("Escape")
    building.wait("!document.querySelector('#new-town').open")
    page.keyboard.press("m")
    building.wait("document.querySelector('#new-town').open")
    page.set_input_files("#new-town [name=file]", files=[{"name": "a.txt", "mimeType": "", "buffer": b"x"}])
    assert "none of these" in page.locator("#new-town .bad").inner_text()
    assert page.locator("#new-town .main").is_disabled()
    broken = {"name": "../my town.osm", "mimeType": "", "buffer": CROSS[:3000]}
    page.set_input_files("#new-town [name=file]", files=[broken])
    assert page.input_value("#new-town [name=name]") == "my-town"
    page.click("#new-town .main")
    building.wait("document.querySelector('#new-town .bad').textContent.includes('cut short')")
    assert not place.exists()
    page.set_input_files("#new-town [name=file]", files=[{**broken, "buffer": CROSS}])
    page.click("#new-town .main")
    building.wait("!document.querySelector('#new-town').open && document.title.startsWith('my-town')")
    assert [folder.name for folder in place.iterdir()] == ["my-town"]
    building.fly()
    assert building.value("pavetwin.mission.duration_s") > 0
    page.keyboard.press("m")
    page.keyboard.press("Escape")
    assert not page.locator("#new-town").is_visible()


def test_the_uav_is_flown_by_keys_and_the_flight_is_played(building: BrowserTab) -> None:
    page = building.page
    page.keyboard.press("u")
    building.wait("pavetwin.mission?.isLive && pavetwin.stateAt(pavetwin.time).mode.name === 'inspect'")
    page.keyboard.down("w")
    building.wait("pavetwin.stateAt(pavetwin.time).speed > 4")
    building.wait("pavetwin.mission.captures.t_s.length > 3")
    page.keyboard.up("w")
    building.wait("pavetwin.stateAt(pavetwin.time).speed === 0")
    assert "%" in page.locator("#pilot li").first.inner_text()
    assert building.value("document.querySelector('#mission').inert")
    page.keyboard.press("Space")
    page.keyboard.press("c")
    assert not building.value("document.querySelector('#compare').ariaPressed === 'true'")
    yaw = building.value("pavetwin.stateAt(pavetwin.time).yaw")
    page.keyboard.down("q")
    building.wait(f"pavetwin.stateAt(pavetwin.time).yaw > {yaw} + 0.3")
    page.keyboard.up("q")
    captures = building.value("pavetwin.mission.captures.t_s.length")
    page.keyboard.down("Shift")
    page.keyboard.down("w")
    building.wait("document.querySelector('#pilot .status').textContent.includes('flight domain ends here')")
    page.keyboard.up("w")
    page.keyboard.up("Shift")
    building.wait("document.querySelector('#pilot .status').textContent === 'You have control.'")
    page.keyboard.press("l")
    building.wait("pavetwin.mission && !pavetwin.mission.isLive && !document.querySelector('#start').disabled")
    assert building.value("pavetwin.mission.policy") == "by-hand"
    assert building.value("pavetwin.mission.captures.t_s.length") >= captures
    assert not page.locator("#pilot").is_visible()
    assert not building.value("document.querySelector('#mission').inert")
    assert "not a mission of this town" in page.locator("#notice").inner_text()


def test_a_car_is_driven_by_keys_and_the_drive_is_played(building: BrowserTab) -> None:
    page = building.page
    building.value("(location.hash = '#world=cross&traffic=low&seed=1&segments=s0002', location.reload())")
    building.ready()
    page.keyboard.press("r")
    building.wait("pavetwin.mission?.isLive && pavetwin.mission.car")
    reported = page.locator("#pilot").inner_text()
    assert "You drive" in reported
    assert "does not react to you" in reported, "the traffic is recorded"
    page.keyboard.down("w")
    building.wait("pavetwin.stateAt(pavetwin.time).speed > 4")
    building.wait("pavetwin.mission.captures.t_s.length > 3")
    page.keyboard.up("w")
    building.wait("pavetwin.stateAt(pavetwin.time).speed === 0")
    now, eye = building.value("(now => [now, pavetwin.mission.cameraOf(now)])(pavetwin.stateAt(pavetwin.time))")
    assert np.hypot(now["x"] - eye["x"], now["y"] - eye["y"]) == pytest.approx(-REAR.x_m, abs=1e-6)
    assert "%" in page.locator("#pilot li").first.inner_text()
    yaw = now["yaw"]
    page.keyboard.down("ArrowUp")
    page.keyboard.down("a")
    building.wait(f"pavetwin.stateAt(pavetwin.time).yaw > {yaw} + 0.1")
    page.keyboard.up("a")
    page.keyboard.up("ArrowUp")
    page.click("#pilot .end")
    building.wait("pavetwin.mission && !pavetwin.mission.isLive && !document.querySelector('#start').disabled")
    assert building.value("pavetwin.mission.policy") == "by-car"
    assert not page.locator("#pilot").is_visible()
    assert "its guest" in page.locator("#table").inner_text()
    page.click("#tab-files")
    assert "by-car.json" in page.locator("#files").inner_text()
    building.value("pavetwin.seek(pavetwin.mission.duration_s / 2)")
    page.wait_for_timeout(300)
    assert all(building.picture(place).std() > 5 for place in ("#map", "#camera canvas", "#plots"))


def test_a_contact_sheet_is_shown_and_a_damaged_study_reported(browser: Any, tmp_path: Path) -> None:
    for number in range(2):
        picture(tmp_path / "source" / f"{number}.jpg", seed=number)
        voc(tmp_path / "source" / f"{number}.xml", [("PH", (8, 8, 30, 30))])
    assert pavetwin("data", "import", "uapd", tmp_path / "source", "-o", tmp_path / "photographs").returncode == 0
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "design.yaml").write_text("[")
    with running_page([tmp_path / "photographs", tmp_path / "study"], tmp_path / "worlds") as running:
        tab = tab_of(browser, running)
        tab.open()
        tab.page.click("#exhibits summary")
        tab.page.click("text=photographs (dataset)")
        tab.wait("document.querySelector('#exhibit img')?.naturalWidth > 100")
        tab.page.keyboard.press("Escape")
        tab.page.click("#exhibits summary")
        tab.page.click("text=study (study)")
        tab.wait("document.querySelector('#exhibit .bad')?.textContent.includes('is damaged')")
        assert not tab.page.locator("#exhibit .shown *").count()
        tab.page.close()
        assert tab.errors == []


def test_the_report_of_a_study_is_looked_at(browser: Any, world: Path, tmp_path: Path) -> None:
    design = tmp_path / "study.yaml"
    assert pavetwin("experiment", "init", design, "--world", world).returncode == 0
    few = {"densities": ["low"], "replicates": 2, "policies": ["baseline"], "altitudes_m": [10.0]}
    design.write_text(yaml.safe_dump(yaml.safe_load(design.read_text()) | few))
    done = pavetwin("experiment", "run", design, "-o", tmp_path / "study", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    with running_page([world, tmp_path / "study"]) as running:
        tab = tab_of(browser, running)
        tab.open()
        tab.ready()
        tab.page.click("#compare")
        assert tab.page.locator("#exhibits").is_visible()
        boxes = [
            tab.page.locator(part).bounding_box() for part in ("[name=world]", "[name=against]", "#start", "#help")
        ]
        assert len({box["y"] for box in boxes}) == 1, "the header stays on one line"
        tab.page.click("#exhibits summary")
        tab.page.click("text=study (study)")
        report = tab.page.frame_locator("#exhibit iframe")
        report.locator("h1").wait_for(timeout=1000 * PATIENCE_S)
        assert report.locator("svg, img").count() > 3
        tab.page.goto(tab.page.locator("#exhibit a").evaluate("link => link.href"))
        assert tab.page.locator("h1").inner_text()
        tab.page.close()
        assert tab.errors == []
