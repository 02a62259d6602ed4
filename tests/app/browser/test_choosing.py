"""The page in Chromium: choice of streets, and messages where nothing can be flown."""

import json
from typing import Any

import pytest

from scenes.browser import BrowserTab, tab_of
from scenes.page import running_page

pytestmark = pytest.mark.slow


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
    for text, reported in (("haupts", "Hauptstra"), ("BOGEN", "Bogen"), ("nowhere", "no street"), ("stra", "Several")):
        tab.page.fill("#find", text)
        tab.page.keyboard.press("Enter")
        assert (
            reported in tab.page.locator("#selection" if text.lower() in reported.lower() else "#notice").inner_text()
        )
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


def test_missions_that_cannot_be_flown_are_explained_in_the_page(tab: BrowserTab) -> None:
    tab.open("#world=cross&traffic=low&seed=1&count=2000")
    tab.ready()
    tab.wait("document.querySelector('#selection .bad')")
    assert "2000" in tab.page.locator("#selection .bad").inner_text()


def test_without_a_town_the_page_explains_how_to_make_one(browser: Any) -> None:
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


def test_without_webgl_the_panel_shows_a_message(tab: BrowserTab) -> None:
    tab.open("#world=cross")
    tab.ready()
    assert "no WebGL 2" in tab.page.locator("#town .empty").inner_text()
    assert not tab.page.locator("#town .tools").is_visible()
    tab.page.click("#solid")
    assert not tab.page.locator("#town").is_visible()
    tab.page.reload()
    tab.ready()
    assert not tab.page.locator("#town").is_visible(), "the choice is kept"
