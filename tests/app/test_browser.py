"""The page in Chromium: streets are clicked, a mission is started, and what is shown is what the command line says."""

import json
import re
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from pavetwin.capture.platforms.car import REAR
from pavetwin.mission.again import read_mission
from pavetwin.mission.fly import MissionResult, fly
from pavetwin.mission.timeline import Timeline
from pavetwin.uav import camera_of
from scenes.browser import NO_WEBGL, PATIENCE_S, SOFTWARE, BrowserTab, Launch, chromium, tab_of
from scenes.command_line import pavetwin
from scenes.page import RunningPage, running_page
from scenes.photographs import picture, voc

DROP = """(() => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(['<osm'], 'dropped.osm'));
  const drop = new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer });
  document.querySelector('#map').dispatchEvent(drop);
})()"""
"""A file that is dropped on the map."""

CROSS = (Path(__file__).parents[1] / "scenes" / "cross.osm").read_bytes()

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def launch() -> Iterator[Launch]:
    with chromium() as start:
        yield start


@pytest.fixture(scope="module")
def browser(launch: Launch) -> Iterator[Any]:
    """Without WebGL: all but the town in 3-D works."""
    started = launch(*NO_WEBGL)
    yield started
    started.close()


@pytest.fixture(scope="module")
def server(world: Path) -> Iterator[RunningPage]:
    with running_page([world]) as running:
        yield running


@pytest.fixture
def tab(browser: Any, server: RunningPage) -> Iterator[BrowserTab]:
    """Closed with the proof that nothing went wrong, and that no other host was asked."""
    made = tab_of(browser, server)
    yield made
    made.page.close()
    assert made.errors == []
    assert made.hosts == {f"127.0.0.1:{server.port}"}


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
    building.wait("document.querySelector('#pilot .told').textContent.includes('no farther this way')")
    page.keyboard.up("w")
    page.keyboard.up("Shift")
    building.wait("document.querySelector('#pilot .told').textContent === 'The stick is yours.'")
    page.keyboard.press("l")
    building.wait("pavetwin.mission && !pavetwin.mission.isLive && !document.querySelector('#start').disabled")
    assert building.value("pavetwin.mission.policy") == "by-hand"
    assert building.value("pavetwin.mission.captures.t_s.length") >= captures
    assert not page.locator("#pilot").is_visible()
    assert not building.value("document.querySelector('#mission').inert")
    assert "no mission of this town" in page.locator("#notice").inner_text()


def test_a_car_is_driven_by_keys_and_the_drive_is_played(building: BrowserTab) -> None:
    page = building.page
    building.value(f"(location.hash = '#world=cross&traffic=low&seed=1&segments={SEGMENTS[0]}', location.reload())")
    building.ready()
    page.keyboard.press("r")
    building.wait("pavetwin.mission?.isLive && pavetwin.mission.car")
    told = page.locator("#pilot").inner_text()
    assert "You drive" in told
    assert "does not see you" in told, "the traffic does not react"
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


def test_a_contact_sheet_is_looked_at_and_a_damaged_study_told(browser: Any, tmp_path: Path) -> None:
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


@dataclass(frozen=True)
class Flown:
    tab: BrowserTab
    folder: Path
    result: MissionResult


@pytest.fixture(scope="module")
def flown(browser: Any, server: RunningPage, world: Path) -> Iterator[Flown]:
    """Two streets that were clicked, and their mission flown from the page; and again in this process."""
    tab = tab_of(browser, server)
    tab.open("#world=cross&traffic=low&seed=1")
    tab.ready()
    for segment in SEGMENTS:
        tab.click_street(segment)
    tab.fly()
    (folder,) = (world / "missions").iterdir()
    yield Flown(tab, folder, fly(read_mission(folder / "mission.yaml").spec))
    tab.page.close()
    assert tab.errors == []
    assert tab.hosts == {f"127.0.0.1:{server.port}"}


SEGMENTS = ("s0002", "s0001")


def test_two_clicked_streets_are_the_command_lines_mission(flown: Flown, world: Path, tmp_path: Path) -> None:
    chosen = [word for segment in SEGMENTS for word in ("--segment", segment)]
    done = pavetwin("fly", world, "--density", "low", "--seed", "1", *chosen, "-o", tmp_path / "m", "--no-map")
    assert done.returncode == 0, done.stderr
    assert (flown.folder / "mission.yaml").read_bytes() == (tmp_path / "m" / "mission.yaml").read_bytes()
    printed = [" ".join(line.split()) for line in done.stdout.splitlines()]
    cells = "row => [...row.cells].map(cell => cell.textContent)"
    _, *shown = zip(*flown.tab.value(f"[...document.querySelectorAll('#table tr')].map({cells})"), strict=True)
    assert len(shown) == len(SEGMENTS) + 1
    assert all(" ".join(" ".join(each).split()).removeprefix("all ") in printed for each in shown)
    too_wide = "(({ scrollWidth, clientWidth }) => scrollWidth > clientWidth)(document.querySelector('#table'))"
    assert not flown.tab.value(too_wide)
    for selector in (".sentence", ".remark"):
        assert all(text in done.stdout for text in flown.tab.page.locator(f"#table {selector}").all_inner_texts())


def test_agents_and_uav_are_where_the_trace_and_the_timeline_have_them(flown: Flown) -> None:
    timeline, result = Timeline(flown.result), flown.result
    assert flown.tab.value("pavetwin.mission.duration_s") == pytest.approx(result.duration_s, abs=1e-3)
    for time_s in np.linspace(0.0, result.duration_s, 10):
        moment = float(time_s)
        flown.tab.value(f"pavetwin.seek({moment!r})")
        flown.tab.value(f"pavetwin.fetchAgents({moment!r}).then(() => null)")
        shown = {agent["agent"]: agent for agent in flown.tab.value("pavetwin.agentsAt(pavetwin.time)")}
        true = result.trace.agents_at(min(moment, result.trace.duration_s))
        assert sorted(shown) == sorted(true["agent"].tolist())
        for row, agent in enumerate(true["agent"].tolist()):
            away = np.hypot(shown[agent]["x"] - true["x_m"][row], shown[agent]["y"] - true["y_m"][row])
            assert away < 0.05
            assert shown[agent]["length"] == pytest.approx(true["length_m"][row], abs=0.01)
        uav, state = flown.tab.value("pavetwin.stateAt(pavetwin.time)"), timeline.at(min(moment, timeline.duration_s))
        assert np.hypot(uav["x"] - state.uav.position[0], uav["y"] - state.uav.position[1]) < 0.01
        assert uav["battery"] == pytest.approx(state.uav.battery, abs=1e-4)
        assert uav["mode"]["name"] == state.uav.mode.value
        assert uav["captures"] == state.captures


def test_the_map_and_the_curves_are_drawn_and_follow_the_clock(flown: Flown) -> None:
    tab = flown.tab
    tab.value("pavetwin.seek(0)")
    tab.page.wait_for_timeout(500)
    before = {place: tab.picture(place) for place in ("#map", "#camera canvas", "#plots")}
    assert all(picture.std() > 5 for picture in before.values()), "a blank canvas"
    tab.value("pavetwin.seek(pavetwin.mission.duration_s / 2)")
    tab.page.wait_for_timeout(500)
    for place, shown in before.items():
        assert np.abs(tab.picture(place) - shown).max() > 50, place


def test_keys_play_pause_seek_and_show_the_keys(flown: Flown) -> None:
    tab = flown.tab
    tab.value("(pavetwin.seek(10), document.activeElement.blur())")
    tab.page.keyboard.press("ArrowRight")
    assert tab.value("pavetwin.time") == pytest.approx(11)
    tab.page.keyboard.press("Shift+ArrowLeft")
    assert tab.value("pavetwin.time") == pytest.approx(1)
    tab.page.keyboard.press("Space")
    tab.wait("pavetwin.time > 3")
    tab.page.keyboard.press("Space")
    stopped = tab.value("pavetwin.time")
    tab.page.wait_for_timeout(300)
    assert tab.value("pavetwin.time") == stopped
    tab.page.keyboard.press("?")
    assert tab.page.locator("dialog#keys").is_visible()
    tab.page.keyboard.press("Escape")


def test_a_defect_says_why_and_leads_to_its_moment(flown: Flown) -> None:
    tab = flown.tab
    tab.page.click("#tab-defects")
    listed = tab.page.locator("#defects .list button")
    assert listed.count() == len(flown.result.inspected_defects)
    missed = next(
        each for each in flown.result.inspected_defects if each.reason is not None and each.time_s is not None
    )
    row = tab.page.locator(f"#defects .list button[data-id='{missed.defect.id}']")
    assert missed.reason is not None
    assert missed.reason.words in row.inner_text()
    row.click()
    assert tab.value("pavetwin.time") == pytest.approx(missed.time_s, abs=1e-3)


def test_a_defect_shows_the_images_that_have_it_in_them(flown: Flown) -> None:
    tab, result = flown.tab, flown.result
    indices = {segment.id: index for index, segment in enumerate(result.environment.world.segments)}
    seen = tab.value(
        "import('/static/defect_frames.js').then(({ capturesOf }) => Object.fromEntries(pavetwin.mission.defects.map("
        "defect => [defect.id, capturesOf(pavetwin.mission, defect)])))"
    )
    across_m, along_m = camera_of(result.settings).footprint_m(result.settings.altitude_m)
    for each in result.inspected_defects:
        captures = seen[str(each.defect.id)]
        assert sum(capture["inWindow"] for capture in captures) == each.captures, "as defects.csv counts them"
        if each.capture is not None:
            assert each.capture in [capture["capture"] for capture in captures]
        for capture in captures:
            row = capture["capture"]
            yaw, x, y = (result.captures[name][row] for name in ("yaw_rad", "x_m", "y_m"))
            ahead, left = (0.5 - capture["down"]) * along_m, (0.5 - capture["right"]) * across_m
            place = (x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw))
            assert np.hypot(place[0] - each.defect.centre.x, place[1] - each.defect.centre.y) < 0.01
            if capture["inWindow"]:
                assert result.captures["segment"][row] == indices[each.defect.segment]
    chosen = next(each for each in result.inspected_defects if each.captures)
    tab.page.click("#tab-defects")
    tab.page.click(f"#defects .list button[data-id='{chosen.defect.id}']")
    thumbs = tab.page.locator("#defects .thumbs button")
    assert thumbs.count() == min(6, len(seen[str(chosen.defect.id)]))
    times = sorted(capture["time"] for capture in seen[str(chosen.defect.id)])
    thumbs.first.click()
    assert tab.value("pavetwin.time") in times


@pytest.mark.needs_adapter
@pytest.mark.timeout(600)
def test_without_webgl_frames_are_rendered_and_cut_to_the_defect(flown: Flown) -> None:
    """The label of a defect lies where its place in the image is computed to be."""
    tab = flown.tab
    assert tab.value("document.createElement('canvas').getContext('webgl2')") is None
    chosen = max(flown.result.inspected_defects, key=lambda each: (each.captures > 0, each.defect.area_m2))
    tab.page.click("#tab-defects")
    tab.page.click(f"#defects .list button[data-id='{chosen.defect.id}']")
    tab.wait("pavetwin.frame && document.querySelector('#defects .seen-by .told').textContent === ''")
    drawn = "[...document.querySelectorAll('#defects .thumbs canvas')].map(each => each.toDataURL('image/png'))"
    for content in tab.value(drawn):
        with Image.open(BytesIO(b64decode(content.partition(",")[2]))) as image:
            assert np.asarray(image.convert("RGB"), dtype=float).std() > 5, "a blank image"
    frame = tab.value("({ labels: pavetwin.frame.labels, capture: pavetwin.frame.capture })")
    labels = [each for each in frame["labels"] if each["id"].startswith("defect ")]
    assert labels
    captures = tab.value(
        "import('/static/defect_frames.js').then(({ capturesOf }) => pavetwin.mission.defects.map(defect => "
        f"[defect.id, capturesOf(pavetwin.mission, defect).find(each => each.capture === {frame['capture']})]))"
    )
    places = {f"defect {number}": place for number, place in captures if place}
    for label in labels:
        left, top, right, bottom = label["box"]
        if min(left, top) > 0.02 and max(right, bottom) < 0.98 and label["id"] in places:
            place = places[label["id"]]
            assert left - 0.03 < place["right"] < right + 0.03
            assert top - 0.03 < place["down"] < bottom + 0.03


def test_two_policies_are_compared_over_the_same_agents_by_one_clock(tab: BrowserTab) -> None:
    tab.open("#world=cross&traffic=low&seed=1&segments=s0001&policy=baseline&against=hover")
    tab.ready()
    tab.fly()
    names = tab.value("pavetwin.flight.missions.map(each => each.policy)")
    assert names == ["baseline", "hover"]
    last_s = min(tab.value("pavetwin.flight.missions.map(each => each.duration_s)"))
    places = set()
    for moment in np.linspace(0.0, last_s, 20).tolist():
        tab.value(f"pavetwin.seek({moment!r})")
        tab.value(f"pavetwin.fetchAgents({moment!r}).then(() => null)")
        sides = []
        for name in names:
            tab.page.click(f"#policies button:text-is('{name}')")
            assert tab.value("[pavetwin.mission.policy, pavetwin.time]") == [name, pytest.approx(moment)]
            sides.append(tab.value("pavetwin.agentsAt(pavetwin.time)"))
            uav = tab.value("pavetwin.stateAt(pavetwin.time)")
            places.add((name, round(uav["x"], 2), round(uav["y"], 2)))
        assert sides[0] == sides[1] != []
        assert sides[0] == tab.value(f"pavetwin.agentsAt({moment!r})")
    assert len({place[1:] for place in places}) > 20, "the UAVs are not where each other is"
    tab.page.keyboard.press("v")
    assert tab.value("pavetwin.mission.policy") == "baseline"


YAML = """text => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([text], 'mission.yaml'));
  const drop = new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer });
  document.querySelector('#map').dispatchEvent(drop);
}"""
"""A mission.yaml that is dropped on the map."""


def test_a_dropped_mission_is_flown_byte_for_byte(tab: BrowserTab, world: Path, tmp_path: Path) -> None:
    chosen = ("--segment", "s0003", "--altitude", "12.5", "--policy", "skip", "--aircraft", "phantom4pro")
    done = pavetwin("fly", world, "--density", "low", "--seed", "5", "--time", "15:20", *chosen, "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "m" / "mission.yaml").read_text()
    tab.open("#world=cross&seed=9")
    tab.ready()
    tab.page.evaluate(YAML, text)
    tab.wait("document.querySelector('#notice').textContent.includes('Start flies it')")
    assert tab.page.input_value("#mission [name=altitude_m]") == "12.5"
    assert not tab.page.locator("#new-town").is_visible()
    before = set((world / "missions").glob("*"))
    tab.fly()
    (folder,) = set((world / "missions").glob("*")) - before
    assert (folder / "mission.yaml").read_text() == text
    tab.page.evaluate(YAML, text.replace("name: skip", "name: /tmp/own.py:Skip"))
    tab.wait("document.querySelector('#notice').textContent.includes('does not take')")
    assert tab.page.input_value("#mission [name=policy]") == "skip", "the form is as it was"


def test_what_was_missed_is_chosen_and_flown_again(flown: Flown) -> None:
    tab, missed = flown.tab, read_mission(flown.folder / "mission.yaml").missed_segments()
    tab.page.click("#tab-defects")
    tab.page.click("#defects .again button:text-is('Choose')")
    assert tab.value("location.hash").endswith("segments=" + "%2C".join(missed))
    tab.page.click("#defects .again button:text-is('Fly them again')")
    tab.wait("document.querySelector('#start').disabled")
    tab.wait("!document.querySelector('#start').disabled")
    tab.page.click("#tab-files")
    tab.wait("document.querySelector('#files .remark')?.textContent.includes('-missed')")
    assert tab.page.locator("#files .make small").inner_text() == f"pavetwin replay {flown.folder}-missed"
    assert tab.value("pavetwin.mission.targets") == list(missed)
    again = flown.folder.with_name(f"{flown.folder.name}-missed")
    assert read_mission(again / "mission.yaml").spec.targets == missed


def test_a_flight_plan_that_is_made_again_is_listed_once(flown: Flown) -> None:
    tab, links = flown.tab, flown.tab.page.locator("#files a[href*='/made/']")
    tab.page.click("#tab-files")
    for what in ("csv", "litchi", "csv"):
        tab.page.select_option("#files .make select", what)
        with tab.page.expect_download():
            tab.page.click("#files .make button")
        tab.wait("!document.querySelector('#files .make button').disabled")
    assert links.count() == 2, "one for each form, and a form does not take the other away"
    paths = [link.get_attribute("href") for link in links.all()]
    assert [tab.server.get(f"/{path}").status for path in paths] == [200, 200]


def test_the_offline_page_plays_the_mission_without_a_server(launch: Launch, flown: Flown, tmp_path: Path) -> None:
    done = pavetwin("replay", flown.folder, "-o", tmp_path / "replay.html")
    assert done.returncode == 0, done.stderr
    browser = launch("--disable-3d-apis")
    context = browser.new_context(viewport={"width": 1366, "height": 768}, offline=True)
    tab = BrowserTab(context.new_page(), flown.tab.server)
    asked: list[str] = []
    tab.page.on("console", lambda message: tab.errors.append(message.text) if message.type == "error" else None)
    tab.page.on("pageerror", lambda error: tab.errors.append(str(error)))
    tab.page.on("request", lambda request: asked.append(request.url.partition(":")[0]))
    tab.page.goto((tmp_path / "replay.html").as_uri())
    tab.ready()
    moment = flown.result.duration_s / 3
    tab.value(f"pavetwin.seek({moment!r})")
    tab.value(f"pavetwin.fetchAgents({moment!r}).then(() => null)")
    shown = {agent["agent"]: agent for agent in tab.value("pavetwin.agentsAt(pavetwin.time)")}
    true = flown.result.trace.agents_at(moment)
    assert sorted(shown) == sorted(true["agent"].tolist())
    for row, agent in enumerate(true["agent"].tolist()):
        assert np.hypot(shown[agent]["x"] - true["x_m"][row], shown[agent]["y"] - true["y_m"][row]) < 0.05
    state = Timeline(flown.result).at(moment)
    uav = tab.value("pavetwin.stateAt(pavetwin.time)")
    assert np.hypot(uav["x"] - state.uav.position[0], uav["y"] - state.uav.position[1]) < 0.01
    for place in ("#map", "#camera canvas", "#plots"):
        assert tab.picture(place).std() > 5, f"{place} is blank"
    assert tab.page.locator("#table thead th").count() == len(SEGMENTS) + 2
    tab.page.keyboard.press("Space")
    tab.wait(f"pavetwin.time > {moment + 2}")
    tab.page.click("#tab-defects")
    tab.page.click("#defects .list button >> nth=0")
    assert not tab.page.locator("#start, #new-town, #tab-files").count(), "what needs the server is not there"
    assert tab.errors == []
    assert set(asked) <= {"file", "data"}
    browser.close()


def test_an_address_makes_the_same_choices(tab: BrowserTab) -> None:
    tab.open("#world=cross&altitude_m=14&policy=skip&traffic=los-D&seed=7&aircraft=phantom4&segments=s0003,s0001")
    tab.ready()
    values = "Object.fromEntries(new FormData(document.getElementById('mission')))"
    chosen = tab.value(values)
    wanted = {"altitude_m": "14", "policy": "skip", "traffic": "los-D", "seed": "7", "aircraft": "phantom4"}
    assert wanted.items() <= chosen.items()
    tab.wait("location.hash.includes('s0003')")
    assert "2 segments chosen" in tab.page.locator("#selection").inner_text()
    assert "token" not in tab.value("location.href")
    tab.page.reload()
    tab.ready()
    assert tab.value(values) == chosen


def test_streets_are_chosen_by_a_box_and_by_name_and_let_go(tab: BrowserTab) -> None:
    tab.open("#world=cross&traffic=low&seed=1")
    tab.ready()
    box = tab.page.locator("#map .moving").bounding_box()
    tab.page.keyboard.down("Shift")
    tab.page.mouse.move(box["x"] + 2, box["y"] + 60)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + box["width"] - 2, box["y"] + box["height"] - 2, steps=4)
    tab.page.mouse.up()
    tab.page.keyboard.up("Shift")
    names = tab.value("[...document.querySelectorAll('#streets option')].map(each => each.value)")
    assert "segments chosen" in tab.page.locator("#selection").inner_text()
    tab.page.locator("#map .moving").focus()
    tab.page.keyboard.press("Escape")
    assert "chosen by the seed" in tab.page.locator("#selection").inner_text()
    tab.page.fill("#find", names[0])
    tab.page.keyboard.press("Enter")
    assert "chosen by the seed" not in tab.page.locator("#selection").inner_text()
    tab.page.keyboard.press("Escape")
    for text, told in (("haupts", "Hauptstra"), ("BOGEN", "Bogen"), ("nowhere", "No street"), ("stra", "Several")):
        tab.page.fill("#find", text)
        tab.page.keyboard.press("Enter")
        assert told in tab.page.locator("#selection" if text.lower() in told.lower() else "#notice").inner_text()
    tab.wait("document.querySelectorAll('#selection .numbers span').length == 6")
    assert "empty streets" in tab.page.locator("#selection small").inner_text()


def test_streets_are_chosen_by_the_keyboard(tab: BrowserTab) -> None:
    tab.open("#world=cross&traffic=low&seed=1")
    tab.ready()
    tab.page.locator("#map .moving").focus()
    tab.page.keyboard.press("a")
    assert "segments chosen" in tab.page.locator("#selection").inner_text()
    tab.page.keyboard.press("Escape")
    box = tab.page.locator("#map .moving").bounding_box()
    x, y = tab.value("pavetwin.screenOf('s0002')")
    tab.value(f"pavetwin.map.move({(x - box['width'] / 2) / box['width']}, {(box['height'] / 2 - y) / box['height']})")
    tab.page.keyboard.press("x")
    tab.wait("location.hash.endsWith('segments=s0002')")
    tab.page.keyboard.press("x")
    assert "chosen by the seed" in tab.page.locator("#selection").inner_text(), "again lets it go"


def test_what_cannot_be_flown_is_told_in_the_page(tab: BrowserTab) -> None:
    tab.open("#world=cross&traffic=low&seed=1&count=2000")
    tab.ready()
    tab.wait("document.querySelector('#selection .bad')")
    assert "2000" in tab.page.locator("#selection .bad").inner_text()


def test_without_a_town_the_page_says_how_to_make_one(browser: Any) -> None:
    with running_page([]) as empty:
        tab = tab_of(browser, empty)
        tab.open()
        tab.wait("document.getElementById('start').disabled")
        assert "pavetwin world build" in tab.page.locator("#selection").inner_text()
        assert tab.errors == []
        tab.page.close()


def test_controls_have_names(tab: BrowserTab) -> None:
    tab.open("#world=cross")
    tab.ready()
    unnamed = tab.value(
        "[...document.querySelectorAll('button, input, select, canvas[tabindex], summary')]"
        ".filter(each => !(each.getAttribute('aria-label') || each.labels?.length || each.textContent.trim()))"
        ".map(each => each.outerHTML)"
    )
    assert json.dumps(unnamed) == "[]"


def test_without_webgl_the_panel_says_so(tab: BrowserTab) -> None:
    tab.open("#world=cross")
    tab.ready()
    assert "no WebGL 2" in tab.page.locator("#town .empty").inner_text()
    assert not tab.page.locator("#town .tools").is_visible()
    tab.page.click("#solid")
    assert not tab.page.locator("#town").is_visible()
    tab.page.reload()
    tab.ready()
    assert not tab.page.locator("#town").is_visible(), "the choice is kept"


@pytest.fixture(scope="module")
def drawn(launch: Launch, server: RunningPage) -> Iterator[BrowserTab]:
    """A mission over a street, in a browser that draws in 3-D without a GPU."""
    browser = launch(*SOFTWARE)
    tab = tab_of(browser, server)
    tab.open("#world=cross&traffic=low&seed=1&segments=s0001")
    tab.ready()
    yield tab
    browser.close()
    assert tab.errors == []
    assert tab.hosts == {f"127.0.0.1:{server.port}"}


def settled(tab: BrowserTab) -> dict[str, Any]:
    tab.wait("!pavetwin.town.stats().pending")
    tab.value("pavetwin.town.render()")
    stats: dict[str, Any] = tab.value("pavetwin.town.stats()")
    assert stats["failed"] is None
    return stats


@pytest.mark.timeout(900)
def test_the_town_is_drawn_in_3d_within_its_limits(drawn: BrowserTab) -> None:
    stats = settled(drawn)
    assert "SwiftShader" in stats["renderer"] or "llvmpipe" in stats["renderer"]
    assert 0 < stats["drawCalls"] <= 400
    assert 1000 < stats["triangles"] <= 400_000
    assert stats["bytes"] <= 15e6
    assert drawn.picture("#town canvas").std(axis=(0, 1)).mean() > 10, "a blank canvas"
    assert not drawn.page.locator("#town .empty").is_visible()
    drawn.page.keyboard.press("2")
    assert drawn.value(CAMERA)["mode"] == "orbit", "there is no UAV to follow yet"


TILES = re.compile(r"/town/.*/\d+/[\d_-]+\.glb\.gz$")


@pytest.mark.timeout(900)
def test_it_is_told_how_many_tiles_still_load(drawn: BrowserTab, server: RunningPage) -> None:
    tab = tab_of(drawn.page.context.browser, server)
    held: list[Any] = []
    released = Event()
    tab.page.route(TILES, lambda route: route.continue_() if released.is_set() else held.append(route))
    tab.open("#world=cross")
    tab.wait("!document.querySelector('#town .loading').hidden")
    line = tab.page.locator("#town .loading")
    count = int(line.inner_text().removesuffix(" tiles still loading"))
    assert len(held) <= count == tab.value("pavetwin.town.stats().pending")
    assert not tab.page.locator("#town .empty").is_visible()
    released.set()
    for route in held:
        route.continue_()
    settled(tab)
    assert not line.is_visible()
    assert tab.errors == []
    tab.page.close()


@pytest.mark.timeout(900)
def test_a_long_first_drawing_is_told(drawn: BrowserTab, server: RunningPage) -> None:
    tab = tab_of(drawn.page.context.browser, server)
    held: list[Any] = []
    tab.page.route("**/town/*/manifest.json", lambda route: held.append(route))
    tab.open("#world=cross")
    tab.ready()
    words = tab.page.locator("#town .empty")
    assert words.inner_text() == "The town is being drawn …"
    tab.wait("document.querySelector('#town .empty').textContent.includes('a minute or so')")
    held[0].continue_()
    settled(tab)
    assert not words.is_visible()
    tab.page.close()


CAMERA = """(({ camera, mode }) => ({ mode, x: camera.position.z, y: camera.position.x, z: camera.position.y }))
(pavetwin.town.cameras)"""


@pytest.mark.timeout(900)
def test_the_town_shows_the_moment_of_the_clock_from_four_cameras(drawn: BrowserTab) -> None:
    drawn.fly()
    drawn.value("(pavetwin.seek(20), document.activeElement.blur())")
    settled(drawn)
    listed = drawn.value("pavetwin.town.list")
    moving = {agent["agent"]: agent for agent in drawn.value("pavetwin.agentsAt(20)") if agent["group"] != "aircraft"}
    shown = {agent["id"]: agent for agent in listed if agent["id"] in moving}
    assert len(moving) > 0
    assert shown.keys() == moving.keys()
    assert all(agent["x"] == moving[key]["x"] and agent["yaw"] == moving[key]["yaw"] for key, agent in shown.items())
    assert len(listed) - len(shown) == len(drawn.value("pavetwin.mission.parked.x_m"))
    now = drawn.value("pavetwin.stateAt(20)")
    pictures = []
    for key, mode in enumerate(("orbit", "follow", "uav", "car"), start=1):
        drawn.page.keyboard.press(str(key))
        settled(drawn)
        camera = drawn.value(CAMERA)
        assert camera["mode"] == mode
        away = np.hypot(camera["x"] - now["x"], camera["y"] - now["y"])
        if mode == "uav":
            assert (away, camera["z"]) == pytest.approx((0.0, now["altitude"]), abs=1e-6)
        if mode == "follow":
            assert 1 < away < 20
        if mode == "car":
            nearest = min(np.hypot(camera["x"] - each["x"], camera["y"] - each["y"]) for each in moving.values())
            assert nearest < 5
        pictures.append(drawn.picture("#town canvas"))
    for one, other in pairwise(pictures):
        assert np.abs(one - other).mean() > 5
    drawn.page.keyboard.press("1")
    drawn.value("pavetwin.town.render()")
    camera = drawn.value(CAMERA)
    assert np.hypot(np.hypot(camera["x"] - now["x"], camera["y"] - now["y"]), camera["z"]) == pytest.approx(90, abs=1)
    assert camera["z"] > 30, "from above, as before the other cameras"
    drawn.page.keyboard.press("3")
    settled(drawn)
    before = drawn.picture("#town canvas")
    drawn.value("pavetwin.seek(40)")
    settled(drawn)
    assert np.abs(drawn.picture("#town canvas") - before).mean() > 2


DOWN = """(() => {
  const { town, mission } = pavetwin, now = pavetwin.stateAt(pavetwin.time);
  const eye = document.querySelector('#town canvas');
  const size = { width: 200, height: Math.round(200 * eye.height / eye.width) };
  const canvas = () => Object.assign(document.createElement('canvas'), size);
  const [down, own] = [canvas(), canvas()].map(each => each.getContext('2d', { willReadFrequently: true }));
  const fov = 2 * Math.atan(mission.footprint_m[1] / 2 / mission.altitude_m) * 180 / Math.PI;
  const pose = { x: now.x, y: now.y, z: now.altitude, yaw: now.yaw };
  const isDrawn = town.drawDown(down, [0, 0, down.canvas.width, down.canvas.height], pose, fov);
  own.drawImage(eye, 0, 0, own.canvas.width, own.canvas.height);
  const pixels = [down, own].map(pen => [...pen.getImageData(0, 0, pen.canvas.width, pen.canvas.height).data]);
  return { isDrawn, width: down.canvas.width, down: pixels[0], own: pixels[1] };
})()"""
"""What the camera's panel draws of the town, and what the town itself shows after that, at the size of the first."""


@pytest.mark.timeout(900)
def test_the_camera_shows_the_town_in_3d_until_a_frame_is_ready(drawn: BrowserTab) -> None:
    """It sees what the town shows from the UAV's eye, which stays as it is."""
    if drawn.value("!pavetwin.mission"):
        drawn.fly()
    drawn.value("(pavetwin.seek(pavetwin.mission.captures.t_s[0] - 3), document.activeElement.blur())")
    drawn.page.keyboard.press("3")
    settled(drawn)
    drawn.wait("document.querySelector('#shown').textContent.startsWith('Drawn in 3-D')")
    seen = drawn.value(DOWN)
    assert seen["isDrawn"]
    down, own = (np.array(seen[name], dtype=float).reshape(-1, seen["width"], 4)[..., :3] for name in ("down", "own"))
    assert down.std() > 10, "a blank canvas"
    assert np.abs(down - own).mean() < 6
    assert np.abs(down - own[::-1]).mean() > 12, "so near would be no other picture"


LAYER = """layer => {
  const { town } = pavetwin, labels = [...document.querySelectorAll('#town .menu label')], told = () => {
    for (let times = 0; times < 2; times++) town.render(); // the first may draw shadows too
    const { triangles, lines } = town.renderer.info.render, agents = town.list.length;
    return { triangles, lines, agents, stands: town.tiles.objects.visible };
  };
  const box = labels.find(({ textContent }) => textContent === layer).querySelector('input');
  return [told(), (box.click(), told()), (box.click(), told())];
}"""
"""What is drawn of the town before a click on the box of a layer, after it, and after another one."""


@pytest.mark.timeout(900)
def test_each_layer_of_the_town_is_shown_and_hidden(drawn: BrowserTab) -> None:
    if drawn.value("!pavetwin.mission"):
        drawn.fly()
    drawn.value("(pavetwin.seek(20), document.activeElement.blur())")
    drawn.page.keyboard.press("2")
    settled(drawn)
    moving = drawn.value("pavetwin.agentsAt(20).filter(({ group }) => group !== 'aircraft').length")
    standing = drawn.value("pavetwin.mission.parked.x_m.length")
    found = {}
    for layer in ("traffic", "parked vehicles", "UAV", "trees and street furniture", "outlines of defects"):
        before, other, again = drawn.page.evaluate(LAYER, layer)
        assert again == before, layer
        found[layer] = before, other
    for layer, count in (("traffic", moving), ("parked vehicles", standing)):
        before, hidden = found[layer]
        assert before["agents"] - hidden["agents"] == count > 0
    before, hidden = found["UAV"]
    assert before["triangles"] > hidden["triangles"]
    before, hidden = found["trees and street furniture"]
    assert (before["stands"], hidden["stands"]) == (True, False)
    before, outlined = found["outlines of defects"]
    assert before["lines"] == 0 < outlined["lines"], "they are not shown at first"


FRAMES = """(async () => {
  const { Frames, frameLine } = await import('/static/frames.js');
  const { CancelledError } = await import('/static/server.js');
  const canvas = document.createElement('canvas'), asked = [], answers = [];
  const jpeg = canvas.toDataURL('image/jpeg').split(',')[1], wait = time => new Promise(over => setTimeout(over, time));
  const ask = ({ capture, part }) => {
    asked.push(`${part} ${capture}`);
    return { promise: new Promise((done, failed) => answers.push({ done, failed })) };
  };
  const answer = async (at, labels) => {
    answers[at].done({ jpeg, labels, sensor: 'recall', detections: [] });
    await wait(50);
  };
  const mission = { captures: { t_s: [0, 1, 2] } }, frames = new Frames({ ask }), known = [];
  frames.setMission({ key: 'k', missions: [mission] }, mission);
  for (const moment of [0, 1, 0]) frames.want(moment, 0, false);  // each in place of the last
  answers[1].failed(new CancelledError());
  await answer(2, null);
  known.push([frames.at(0).capture, frames.at(0).labels]);
  await answer(3, null);  // what is ahead, until the moment has stayed
  await answer(4, null);
  for (let tries = 0; tries < 100 && asked.length < 6; tries++) await wait(50);
  await answer(5, [{ id: 'a' }]);
  await answer(0, null);  // the first one comes late
  known.push([frames.at(0).capture, frames.at(0).labels?.length]);
  frames.want(2, 0, false);
  known.push([frames.at(2).capture, frames.at(2).labels]);
  frames.want(2, 0, true);
  for (let tries = 0; tries < 100 && !asked.at(-1).startsWith('searched'); tries++) {
    await wait(50);
    if (asked.at(-1).startsWith('labelled 2')) await answer(asked.length - 1, [{ id: 'b' }]);
  }
  answers.at(-1).failed(new Error('There is no detector.'));
  await wait(50);
  const search = [asked.at(-1), frameLine(frames, frames.at(2), true)];
  frames.want(1, 0, true);
  await wait(500);
  const later = asked.slice(asked.lastIndexOf('searched 2') + 1);
  frames.want(1, 0, false);
  search.push(frameLine(frames, frames.at(2), true));
  return { asked: asked.slice(0, 6), known, failure: frames.failure, search, later };
})()"""
"""Answers to requests of the page's frames, in an order that a server may have."""


def test_a_preview_comes_first_and_labels_of_its_own_capture_stay(tab: BrowserTab) -> None:
    tab.open("")
    found = tab.value(FRAMES)
    previews = ["preview 0", "preview 1", "preview 0", "preview 1", "preview 2"]
    assert found["asked"] == [*previews, "labelled 0"]
    assert found["known"] == [[0, None], [0, 1], [2, None]], "no labels of a moment over the frame of another one"
    assert found["failure"] == ""
    assert found["search"][0] == "searched 2"
    assert "There is no detector." in found["search"][1]
    assert "1 label" in found["search"][1]
    assert found["later"] == ["labelled 1"], "a search that fails stops neither previews nor labels"
    assert "no detector" not in found["search"][2], "who lets it be is not told of it"
