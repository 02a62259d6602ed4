"""A mission that is watched in Chromium: what the map, the curves and the town in 3-D show of it, layer by layer, and
how its time passes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from pavetwin.app.colours import page_colours
from pavetwin.mission.events import OcclusionStarted
from pavetwin.mission.fly import fly
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline
from scenes.browser import BrowserTab, tab_of
from scenes.page import RunningPage

pytestmark = pytest.mark.slow

ADDRESS = "#world=cross&traffic=high&seed=3&policy=hover&segments=s0001,s0002"


@dataclass(frozen=True)
class Watched:
    tab: BrowserTab
    result: MissionResult

    def seek(self, time_s: float) -> None:
        """Go to a moment, with its traffic."""
        self.tab.value(f"(pavetwin.seek({time_s!r}), document.activeElement.blur())")
        self.tab.value(f"pavetwin.fetchAgents({time_s!r}).then(() => null)")
        self.tab.page.wait_for_timeout(150)

    def show(self, x_m: float, y_m: float, pixels_per_m: float) -> None:
        self.tab.value(f"(pavetwin.map.showPlace({x_m!r}, {y_m!r}, {pixels_per_m!r}), null)")
        self.tab.page.wait_for_timeout(150)


@pytest.fixture(scope="module")
def watched(browser: Any, page: RunningPage) -> Iterator[Watched]:
    """A mission in dense traffic, and the same in this process."""
    tab = tab_of(browser, page)
    tab.open(ADDRESS)
    tab.ready()
    tab.fly()
    folder = tab.page.locator("#files .remark").text_content().split(", as ")[0].removeprefix("In ")
    yield Watched(tab, fly(MissionFolder(f"{folder}/mission.yaml").spec))
    tab.page.close()
    assert tab.errors == []


def test_keys_and_buttons_go_from_occlusion_to_occlusion(watched: Watched) -> None:
    tab = watched.tab
    moments = [event.time_s for event in watched.result.events if isinstance(event, OcclusionStarted)]
    assert len(moments) > 1, "a scene without occlusions shows nothing"
    watched.seek(0.0)
    for moment in moments[:-1]:
        tab.page.keyboard.press("n")
        assert tab.value("pavetwin.time") == pytest.approx(moment, abs=2e-3)
    tab.page.click("#next")
    assert tab.value("pavetwin.time") == pytest.approx(moments[-1], abs=2e-3)
    tab.page.click("#next")
    assert "no later occlusion" in tab.page.locator("#notice").inner_text()
    assert tab.value("pavetwin.time") == pytest.approx(moments[-1], abs=2e-3)
    tab.value("document.activeElement.blur()")
    tab.page.keyboard.press("p")
    assert tab.value("pavetwin.time") == pytest.approx(moments[-2], abs=2e-3)


def test_the_lanes_of_the_timeline_are_those_of_the_mission(watched: Watched) -> None:
    """At moments in the middle between samples of the track, which lanes may be rounded to."""
    spans, timeline = watched.tab.value("pavetwin.mission.spans()"), Timeline(watched.result)
    threshold, times_s = watched.result.settings.visibility.threshold, timeline.track["t_s"]
    seen = set()
    for time_s in ((times_s[1:] + times_s[:-1]) / 2)[::3].tolist():
        state = timeline.at(time_s)
        lanes = {"occlusion"} if state.visibility is not None and state.visibility < threshold else set()
        lanes |= {state.uav.mode.value} & {"wait", "displace", "revisit", "swap"}
        assert {span["what"] for span in spans if span["from"] <= time_s < span["to"]} == lanes, time_s
        seen |= lanes
    assert seen >= {"occlusion", "wait"}


def test_the_curves_are_those_of_the_mission_and_all_of_the_key_is_drawn(watched: Watched) -> None:
    tab, timeline = watched.tab, Timeline(watched.result)
    confirmed, count = watched.result.memory.confirmed, len(watched.result.inspected_defects)
    for time_s in np.linspace(0.0, timeline.duration_s, 12).tolist():
        found = sum(each.time_s <= time_s for each in confirmed.values())
        assert tab.value(f"pavetwin.mission.foundUpTo({time_s!r})") == found == len(timeline.at(time_s).found)
    assert tab.value("pavetwin.mission.defects.length") >= count
    watched.seek(0.0)
    picture = tab.picture("#plots")
    key = tab.value(
        "[...document.querySelectorAll('#key span')].map(({ textContent, firstChild }) => "
        "[textContent, getComputedStyle(firstChild).backgroundColor.match(/\\d+/g).map(Number)])"
    )
    curves = ["battery", "defects found", "visibility o", "threshold of o"]
    assert [words for words, _ in key] == [*curves, "hidden", "waits"]
    for words, colour in key:
        assert (np.abs(picture - colour).max(axis=2) < 12).sum() > 20, words


def test_a_click_and_a_drag_over_the_curves_go_to_their_moment(watched: Watched) -> None:
    tab = watched.tab
    box, whole_s = tab.page.locator("#plots .u-over").bounding_box(), watched.result.duration_s
    tab.page.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
    tab.page.mouse.down()
    assert tab.value("pavetwin.time") == pytest.approx(whole_s / 4, abs=0.01 * whole_s)
    tab.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=3)
    tab.page.mouse.up()
    assert tab.value("pavetwin.time") == pytest.approx(whole_s / 2, abs=0.01 * whole_s)


def test_each_layer_of_the_map_is_shown_and_hidden(watched: Watched) -> None:
    tab = watched.tab
    watched.seek(watched.result.duration_s / 2)
    tab.page.keyboard.press("0")
    names = tab.value("[...document.querySelectorAll('#layers label')].map(each => each.textContent)")
    assert len(names) == 8
    for at, name in enumerate(names):
        before = tab.picture("#map")
        differing = []
        for _ in ("hidden", "shown"):
            tab.value(f"document.querySelectorAll('#layers input')[{at}].click()")
            tab.page.wait_for_timeout(150)
            differing.append(int((np.abs(tab.picture("#map") - before).max(axis=2) > 20).sum()))
        hidden, shown = differing
        assert hidden > 30, name
        assert shown == 0, name


def test_found_and_missed_defects_have_their_marks_once_it_is_known(watched: Watched) -> None:
    tab, outcomes = watched.tab, page_colours()["outcomes"]
    defects = tab.value("pavetwin.mission.defects.map(({ place_m, outcome }) => [place_m, outcome])")
    assert {"found", "missed"} <= {outcome for _, outcome in defects}
    for outcome in ("found", "missed"):
        lone = [place for place, each in defects if each == outcome and _is_alone(place, [at for at, _ in defects])]
        colour = [int(outcomes[outcome][at : at + 2], 16) for at in (1, 3, 5)]
        shown = []
        for time_s in (0.0, watched.result.duration_s):
            watched.seek(time_s)
            watched.show(lone[0][0], lone[0][1], 12.0)
            picture = tab.picture("#map .moving")
            middle = tuple(side // 2 for side in picture.shape[:2])
            shown.append(np.abs(picture[middle] - colour).max() < 40)
        assert shown == [False, True], outcome


def _is_alone(place: list[float], others: list[list[float]]) -> bool:
    return sum(bool(np.hypot(place[0] - x, place[1] - y) < 2.0) for x, y in others) == 1


def test_the_map_follows_the_uav_until_it_is_dragged(watched: Watched) -> None:
    tab, timeline = watched.tab, Timeline(watched.result)
    watched.show(0.0, 0.0, 3.0)
    watched.seek(1.0)
    tab.page.keyboard.press("f")
    for time_s in (20.0, 40.0):
        watched.seek(time_s)
        view = tab.value("pavetwin.map.view")
        assert (view["x"], view["y"]) == pytest.approx(timeline.at(time_s).uav.position, abs=0.02)
    box = tab.page.locator("#map .moving").bounding_box()
    tab.page.mouse.move(box["x"] + 150, box["y"] + 150)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 220, box["y"] + 180, steps=3)
    tab.page.mouse.up()
    view = tab.value("pavetwin.map.view")
    watched.seek(60.0)
    assert tab.value("pavetwin.map.view") == view
    assert tab.page.get_attribute("#follow", "aria-pressed") == "false"


def test_time_passes_as_fast_as_is_chosen(browser: Any, page: RunningPage, watched: Watched) -> None:
    """By a clock of the page that the test moves on."""
    assert watched.result.duration_s > 40
    tab = tab_of(browser, page)
    tab.page.clock.install(time="2026-01-01T08:00:00")
    tab.open(ADDRESS)
    tab.ready()
    tab.fly()
    tab.page.clock.pause_at("2026-01-01T20:00:00")
    tab.value("document.activeElement.blur()")
    for _ in range(8):
        tab.page.keyboard.press("[")
    for speed in (1, 2, 4, 8, 16, 32):
        assert tab.page.input_value("#speed") == str(speed)
        tab.value("(pavetwin.seek(0), null)")
        tab.page.keyboard.press("Space")
        tab.page.clock.run_for(1000)
        tab.page.keyboard.press("Space")
        assert tab.value("pavetwin.time") == pytest.approx(speed, rel=0.03)
        tab.page.clock.run_for(1000)
        assert tab.value("pavetwin.time") == pytest.approx(speed, rel=0.03), "it stands"
        tab.page.keyboard.press("]")
    tab.page.close()
    assert tab.errors == []


def test_the_address_that_is_shared_makes_the_same_choices(browser: Any, page: RunningPage) -> None:
    tab = tab_of(browser, page, permissions=["clipboard-read", "clipboard-write"])
    tab.open(f"{ADDRESS}&altitude_m=12&against=skip&date=2026-06-21&time=15:30&clouds=0.4")
    tab.ready()
    tab.wait("location.hash.includes('clouds')")
    tab.page.click("#share")
    tab.wait("document.querySelector('#notice').textContent.includes('Copied the address')")
    address = tab.value("navigator.clipboard.readText()")
    assert "token" not in address
    choices = "Object.fromEntries(new FormData(document.getElementById('mission')))"
    chosen = tab.value(choices)
    tab.page.goto("about:blank")
    tab.page.goto(address)
    tab.ready()
    assert tab.value(choices) == chosen
    assert (chosen["clouds"], chosen["against"], chosen["time"]) == ("0.4", "skip", "15:30")
    assert "2 segments chosen" in tab.page.locator("#selection").inner_text()
    tab.value("Object.defineProperty(navigator, 'clipboard', { value: undefined })")
    tab.page.click("#share")
    tab.wait("document.querySelector('#notice').textContent.startsWith('http://127.0.0.1')")
    tab.page.close()
    assert tab.errors == []


def test_a_table_of_many_segments_is_that_of_the_command_line(browser: Any, page: RunningPage) -> None:
    tab = tab_of(browser, page)
    tab.open("#world=cross&traffic=low&seed=1&count=5")
    tab.ready()
    tab.fly()
    rows = tab.value(
        "[...document.querySelectorAll('#table [data-of=segments] tbody tr')]"
        ".map(row => [...row.cells].map(cell => cell.textContent))"
    )
    columns = tab.value("pavetwin.flight.tables[0].columns.map(({ cells }) => cells)")
    assert len(columns[0]) == 5
    assert rows == [list(row) for row in zip(*columns, strict=True)]
    assert tab.page.locator("#table [data-of=segments] tfoot td").count() == len(columns)
    tab.value("(document.querySelector('#table').scrollLeft = 10_000, null)")
    head = tab.page.locator("#table [data-of=segments] tbody td").first.bounding_box()
    panel = tab.page.locator("#table").bounding_box()
    assert panel["x"] <= head["x"] < panel["x"] + 20, "the names of the segments stay"
    last = tab.page.locator("#table [data-of=segments] tbody tr").first.locator("td").last.bounding_box()
    assert last["x"] + last["width"] <= panel["x"] + panel["width"], "all columns can be reached"
    tab.page.close()
    assert tab.errors == []
