"""What is chosen, lost or pressed in the page while something else is on its way."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scenes.browser import BrowserTab, tab_of
from scenes.page import RunningPage, running_page

pytestmark = pytest.mark.slow

SOCKETS = """
window.sockets = [];
window.WebSocket = class extends WebSocket { constructor(...words) { super(...words); sockets.push(this); } };
"""
"""Keeps what the page opens, so that a test can close it."""

REFUSED = """(
window.there = WebSocket,
window.WebSocket = class extends there { constructor() { super(`ws://${location.host}/nowhere`); } },
null)"""
"""From now on nobody answers."""

WATCHED = """(
window.notices = [],
new MutationObserver(([{ target }]) => {
  const notice = target.closest?.('#notice') ?? target.parentElement.closest('#notice');
  if (!notice.hidden) notices.push(notice.firstElementChild.textContent);
}).observe(document.querySelector('#notice'), { attributes: true, childList: true, subtree: true }),
null)"""
"""Keeps what the line over the page says from now on."""

IDLE = "!document.querySelector('#selection').classList.contains('busy')"
NOTICE = "(by => by.hidden ? '' : by.firstElementChild.textContent)(document.querySelector('#notice'))"


@pytest.fixture(scope="module")
def server(world: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningPage]:
    """Of two towns, one with a long name."""
    other = tmp_path_factory.mktemp("towns") / "a_town_with_a_long_name"
    shutil.copytree(world, other, ignore=shutil.ignore_patterns("missions"))
    with running_page([world, other]) as running:
        yield running


@pytest.fixture
def tab(browser: Any, server: RunningPage) -> Iterator[BrowserTab]:
    made = tab_of(browser, server)
    made.page.add_init_script(SOCKETS)
    made.open("#world=cross&traffic=low&seed=1&count=1")
    made.ready()
    made.wait(IDLE)
    yield made
    made.page.close()
    assert made.errors == []


def choose_world(tab: BrowserTab, number: int) -> None:
    tab.page.select_option("[name=world]", index=number)


def test_what_is_started_without_a_connection_waits_for_the_next(tab: BrowserTab) -> None:
    tab.value("(sockets.at(-1).close(), null)")
    tab.page.wait_for_timeout(300)
    tab.fly()
    assert tab.value("sockets.length") == 2
    assert "not answer" not in tab.value(NOTICE), "it answers again"


def test_a_server_that_does_not_answer_is_reported_once(tab: BrowserTab) -> None:
    """Until it answers again; what was asked of it fails, and can be asked again."""
    tab.value(WATCHED)
    tab.value(REFUSED)
    tab.value("(sockets.at(-1).close(), null)")
    tab.wait(f"{NOTICE}.includes('not answer')")
    tab.page.click("#notice button")
    tab.page.click("#start")
    tab.wait("sockets.length >= 3 && !document.querySelector('#start').disabled")
    tab.wait("sockets.length >= 4")
    assert tab.value("notices.filter(words => words.includes('not answer')).length") == 1
    tab.errors[:] = [error for error in tab.errors if "/nowhere" not in error]
    tab.value("(window.WebSocket = there, null)")
    tab.fly()


def test_a_town_is_not_changed_under_a_mission(tab: BrowserTab) -> None:
    tab.page.click("#start")
    assert tab.page.is_disabled("[name=world]")
    assert tab.page.is_disabled("#start")
    tab.page.click("#flown summary")
    tab.page.keyboard.press("Escape")
    tab.wait("pavetwin.mission && !document.querySelector('#start').disabled")
    assert tab.page.is_enabled("[name=world]")
    assert tab.value("pavetwin.mission.planning.every(id => pavetwin.map.segment(id))")


def test_of_two_towns_the_one_that_was_chosen_last_is_shown(tab: BrowserTab) -> None:
    """Though its map comes first."""
    held: list[Any] = []
    tab.page.route("**/api/worlds/w1/map", lambda route: held.append(route))
    choose_world(tab, 1)
    tab.page.wait_for_timeout(200)
    choose_world(tab, 0)
    tab.wait("document.title.startsWith('cross')")
    held[0].continue_()
    tab.page.wait_for_timeout(500)
    assert tab.value("document.title").startswith("cross")
    assert tab.value("document.querySelector('[name=world]').selectedOptions[0].text") == "cross"


def test_a_later_address_is_read_and_missing_parts_are_reported(tab: BrowserTab) -> None:
    tab.value("(location.hash = '#world=cross&traffic=low&seed=5&altitude_m=12&segments=s0001', null)")
    tab.wait("document.querySelector('#selection b').textContent.startsWith('1 segment chosen')")
    assert tab.page.input_value("[name=seed]") == "5"
    tab.value("(location.hash = '#world=cross&segments=s0001,s9999', null)")
    tab.wait(f"{NOTICE}.includes('1 segment that cross does not have')")
    assert tab.page.input_value("[name=altitude_m]") == "10", "what an address leaves out is as usual"
    tab.value("(location.hash = '#world=elsewhere&count=3', null)")
    tab.wait(f"{NOTICE}.includes(\"'elsewhere'\")")


def test_escape_closes_a_menu_before_it_lets_streets_go(tab: BrowserTab) -> None:
    tab.page.locator("#map .moving").focus()
    tab.page.keyboard.press("a")
    tab.page.click("#layers summary")
    tab.page.keyboard.press("Escape")
    assert not tab.value("document.querySelector('#layers').open")
    assert "chosen by the seed" not in tab.page.locator("#selection").inner_text()
    tab.page.keyboard.press("Escape")
    assert "chosen by the seed" in tab.page.locator("#selection").inner_text()


def test_the_slider_stands_over_its_moment_and_space_plays_from_it(tab: BrowserTab) -> None:
    tab.fly()
    tab.value("(pavetwin.seek(pavetwin.mission.duration_s / 4), null)")
    head, left, width = tab.value(
        "[document.querySelector('#plots .head').getBoundingClientRect().left, "
        "...(({ left, width }) => [left, width])(document.querySelector('#scrub').getBoundingClientRect())]"
    )
    thumb_px = 16
    assert abs(left + thumb_px / 2 + (width - thumb_px) / 4 - head) < 1.5
    tab.page.focus("#scrub")
    tab.page.keyboard.press("Space")
    assert tab.page.get_attribute("#play", "aria-label") == "Pause"


def test_a_field_that_cannot_be_flown_with_is_named(tab: BrowserTab) -> None:
    tab.page.fill("[name=altitude_m]", "500")
    tab.page.keyboard.press("Tab")
    tab.wait("document.querySelector('#selection .bad')")
    assert tab.page.locator("#selection .bad").inner_text().startswith("Altitude, m: ")
    assert tab.value(IDLE)


def test_errors_of_the_library_are_shown_in_the_words_of_the_page(tab: BrowserTab) -> None:
    tab.page.fill("#count", "2000")
    tab.page.keyboard.press("Tab")
    tab.wait("document.querySelector('#selection .bad')")
    reported = tab.page.locator("#selection .bad").inner_text()
    assert reported.startswith("Number of segments 2000: ")
    assert "`" not in reported


def test_a_long_name_leaves_the_header_on_its_line(tab: BrowserTab) -> None:
    choose_world(tab, 1)
    tab.wait("document.title.startsWith('a_town')")
    before = tab.value("document.querySelector('header').offsetHeight")
    tab.page.click("#compare")
    assert tab.value("document.querySelector('header').offsetHeight") == before


def test_a_mission_that_is_played_again_brings_its_choices(tab: BrowserTab) -> None:
    tab.page.fill("[name=altitude_m]", "13")
    tab.page.click("#compare")
    tab.wait(IDLE)
    tab.fly()
    policies = "pavetwin.flight.missions.map(({ policy }) => policy)"
    flown = tab.value(policies)
    tab.page.reload()
    tab.ready()
    tab.value("(location.hash = '#world=cross&seed=9', null)")
    tab.wait("document.querySelector('[name=seed]').value === '9'")
    tab.page.click("#flown summary")
    tab.page.click("#flown button:has-text('13m')")
    tab.wait("pavetwin.mission && location.hash.includes('altitude_m=13')")
    first, second = tab.value(policies)
    assert {first, second} == {*flown}
    assert tab.page.input_value("[name=seed]") == "1"
    assert [tab.page.input_value(f"[name={name}]") for name in ("policy", "against")] == [first, second]
    assert f"against={second}" in tab.value("location.hash")


def test_controls_wait_for_the_page(browser: Any, server: RunningPage) -> None:
    tab = tab_of(browser, server)
    tab.page.route("**/api/start", lambda route: (tab.page.wait_for_timeout(300), route.continue_()))
    tab.open("#world=cross&count=1")
    assert tab.value("document.querySelector('header').inert")
    tab.ready()
    assert not tab.value("document.querySelector('header').inert")
    tab.page.close()
    assert tab.errors == []
