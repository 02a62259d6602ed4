"""How the page looks and behaves for everyone: axe finds nothing serious in any state, nothing jumps while it loads,
and a first visit is shown around."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from pavetwin.world.store import save_world
from scenes import damaged
from scenes.browser import BrowserTab, tab_of
from scenes.page import RunningPage, running_page

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed (make setup)")

pytestmark = pytest.mark.slow

SIZES = {"laptop": (1366, 768), "desktop": (1920, 1080), "tablet": (820, 1180)}
SERIOUS = {"serious", "critical"}

SHIFTS = """new PerformanceObserver(list => {
  for (const entry of list.getEntries())
    if (!entry.hadRecentInput) window.shifted = entry.value + (window.shifted ?? 0);
}).observe({ type: 'layout-shift', buffered: true });"""

VISITOR = "Object.defineProperty(Navigator.prototype, 'webdriver', { get: () => false });"
"""A browser that no program drives, for the page."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningPage]:
    folder = tmp_path_factory.mktemp("looks") / "cross"
    save_world(damaged("cross", 8), folder)
    with running_page([folder]) as running:
        yield running


def opened(browser: Any, server: RunningPage, size: str, **options: Any) -> BrowserTab:
    wide, tall = SIZES[size]
    tab = tab_of(browser, server, viewport={"width": wide, "height": tall}, reduced_motion="reduce", **options)
    tab.page.add_init_script(SHIFTS)
    tab.open("#world=cross&traffic=low&seed=1&segments=s0001")
    tab.ready()
    tab.wait("document.querySelectorAll('#selection .numbers span').length === 6")
    return tab


def fly_and_compare(tab: BrowserTab) -> None:
    tab.page.click("#compare")
    tab.fly()
    tab.value("pavetwin.seek(20)")


def ask_for_too_many(tab: BrowserTab) -> None:
    tab.page.fill("#count", "2000")
    tab.page.keyboard.press("Tab")
    tab.wait("document.querySelector('#selection .bad')")


def click(selector: str) -> Callable[[BrowserTab], None]:
    return lambda tab: tab.page.click(selector)


def press(key: str) -> Callable[[BrowserTab], None]:
    def pressed(tab: BrowserTab) -> None:
        tab.value("document.activeElement.blur()")
        tab.page.keyboard.press(key)

    return pressed


STATES: dict[str, Callable[[BrowserTab], None]] = {
    "start": lambda _: None,
    "map's layers": click("#layers summary"),
    "missions flown before": click("#flown summary"),
    "keys": press("?"),
    "tour": click("#again"),
    "no keys": click("#tour .skip"),
    "a new town": press("m"),
    "no new town": press("Escape"),
    "nothing chosen": press("Escape"),
    "flown twice": fly_and_compare,
    "defects": click("#tab-defects"),
    "a defect": click("#defects .list button"),
    "files": click("#tab-files"),
    "an error": ask_for_too_many,
}
"""One after the other in one page."""


@pytest.mark.timeout(900)
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", ["laptop", "tablet"])
def test_axe_finds_nothing_serious_in_any_state(browser: Any, server: RunningPage, size: str, theme: str) -> None:
    tab = opened(browser, server, size, color_scheme=theme)
    found = {}
    for state, come in STATES.items():
        come(tab)
        tab.page.wait_for_timeout(200)
        for violation in axe.Axe().run(tab.page).response["violations"]:
            if violation["impact"] in SERIOUS:
                found[f"{state}: {violation['id']}"] = [node["html"][:160] for node in violation["nodes"]]
    tab.page.close()
    assert found == {}
    assert tab.errors == []


@pytest.mark.parametrize("size", SIZES)
def test_nothing_jumps_while_it_loads_and_flies(browser: Any, server: RunningPage, size: str) -> None:
    tab = opened(browser, server, size)
    loaded = tab.value("window.shifted ?? 0")
    tab.fly()
    tab.page.wait_for_timeout(1000)
    assert loaded < 0.05
    assert tab.value("window.shifted ?? 0") - loaded < 0.05
    overflow = "[document.documentElement, document.body].some(each => each.scrollWidth > innerWidth)"
    assert not tab.value(overflow)
    tab.page.close()


WIDE = (1201, 1240, 1280, 1341, 1366, 1440, 1481, 1536, 1681, 1920)
"""Of windows: common ones, and those beside which the header changes its form."""

HEADER = """(() => {
  const boxes = [...document.querySelectorAll('header :is(label, button, summary, h1)')]
    .filter(each => each.checkVisibility() && !each.closest('.menu ul')).map(each => each.getBoundingClientRect());
  const outside = boxes.filter(({ left, right }) => left < 0 || right > innerWidth).length;
  const isOver = (one, other) => one.left < other.right - 1 && one.top < other.bottom - 1;
  const overlapping = boxes.flatMap((one, at) =>
    boxes.slice(at + 1).filter(other => isOver(one, other) && isOver(other, one)));
  return [outside, overlapping.length, document.querySelector('header').offsetHeight];
})()"""
"""Of the header: what lies outside of the window, what lies over each other, and its height in pixels."""

ROW_PX = 66
"""Height of a header of one row, at most; another one has 50 more."""


def test_the_header_keeps_its_form_at_every_width(browser: Any, server: RunningPage) -> None:
    tab = opened(browser, server, "laptop")
    found = {}
    for shown in ("plain", "studies", "studies and two policies", "two policies"):
        tab.value(f"(document.querySelector('#exhibits').hidden = {str('studies' not in shown).lower()}, null)")
        pressed = tab.page.get_attribute("#compare", "aria-pressed") == "true"
        if pressed != ("two" in shown):
            tab.page.click("#compare")
        for wide in WIDE:
            tab.page.set_viewport_size({"width": wide, "height": 768})
            has_two = shown != "plain" and wide <= 1365
            outside, overlapping, tall = tab.value(HEADER)
            if outside or overlapping or tall > ROW_PX + 50 * has_two:
                found[f"{shown}, {wide} px"] = (outside, overlapping, tall)
    tab.page.close()
    assert found == {}


def test_the_focus_goes_through_the_page_in_its_order_and_is_seen(browser: Any, server: RunningPage) -> None:
    tab = opened(browser, server, "laptop")
    places = []
    for _ in range(60):
        tab.page.keyboard.press("Tab")
        place = """(({ id, name, className, parentElement }) => id || name || className || parentElement?.id || '')
            (document.activeElement)"""
        places.append(tab.value(place))
        if places[-1] in ("tab-table", "table"):
            break
        if places[-1] and places[-1] not in ("date", "time"):  # their parts have the focus, and show it
            ring = tab.value("getComputedStyle(document.activeElement).outlineStyle")
            assert ring != "none", places[-1]
    order = ["world", "policy", "start", "control", "share", "help", "find", "follow", "moving", "tab-table"]
    assert [place for place in places if place in order] == order
    tab.page.close()


def test_a_first_visit_is_shown_around_once_and_by_keys(browser: Any, server: RunningPage) -> None:
    tab = tab_of(browser, server)
    tab.page.add_init_script(VISITOR)
    tab.open("#world=cross")
    tab.ready()
    card = tab.page.get_by_role("dialog", name="1 of 5: Choose streets")
    assert card.is_visible()
    for step in range(2, 6):
        tab.page.keyboard.press("Enter")
        assert tab.page.locator("#tour h2").inner_text().startswith(f"{step} of 5: ")
        box = tab.page.locator("#tour").bounding_box()
        assert 0 <= box["x"] <= 1366 - box["width"]
        assert 0 <= box["y"] <= 768 - box["height"]
    tab.page.keyboard.press("ArrowLeft")
    assert tab.page.locator("#tour h2").inner_text().startswith("4 of 5: ")
    tab.page.keyboard.press("Escape")
    assert not tab.page.locator("#tour").is_visible()
    assert tab.page.locator(".toured").count() == 0
    tab.page.reload()
    tab.ready()
    assert not tab.page.locator("#tour").is_visible()
    tab.page.keyboard.press("?")
    tab.page.click("#again")
    assert tab.page.locator("#tour").is_visible()
    assert tab.errors == []
    tab.page.close()
