"""The page in Chromium: streets are clicked, and the shown mission is that of the command line."""

from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pavetwin.mission.fly import fly
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline
from pavetwin.uav import camera_of
from scenes.browser import BrowserTab, Launch, tab_of
from scenes.command_line import pavetwin
from scenes.page import RunningPage

pytestmark = pytest.mark.slow


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
    yield Flown(tab, folder, fly(MissionFolder(folder / "mission.yaml").spec))
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


def test_a_defect_shows_its_reason_and_leads_to_its_moment(flown: Flown) -> None:
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
    tab.wait("pavetwin.frame && document.querySelector('#defects .seen-by .status').textContent === ''")
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
    tab.wait("document.querySelector('#notice').textContent.includes('Press Start to fly')")
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
    tab, missed = flown.tab, MissionFolder(flown.folder / "mission.yaml").missed_segments()
    tab.page.click("#tab-defects")
    tab.page.click("#defects .again button:text-is('Choose')")
    assert tab.value("location.hash").endswith("segments=" + "%2C".join(missed))
    tab.page.click("#defects .again button:text-is('Fly them again')")
    tab.wait("document.querySelector('#start').disabled")
    tab.wait("!document.querySelector('#start').disabled")
    tab.page.click("#tab-files")
    tab.wait("document.querySelector('#files .remark')?.textContent.includes('-missed')")
    assert tab.page.locator("#files .make small").inner_text() == f"pavetwin replay {flown.folder}-missed"
    assert tab.value("pavetwin.mission.planning") == list(missed)
    again = flown.folder.with_name(f"{flown.folder.name}-missed")
    assert MissionFolder(again / "mission.yaml").spec.targets == missed


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
