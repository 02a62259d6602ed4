"""The page in Chromium: the town in 3-D, and the frames next to it."""

import re
from collections.abc import Iterator
from itertools import pairwise
from threading import Event
from typing import Any

import numpy as np
import pytest

from scenes.browser import SOFTWARE, BrowserTab, Launch, tab_of
from scenes.page import RunningPage

pytestmark = pytest.mark.slow


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
def test_the_number_of_loading_tiles_is_shown(drawn: BrowserTab, server: RunningPage) -> None:
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
def test_a_long_first_drawing_is_explained(drawn: BrowserTab, server: RunningPage) -> None:
    tab = tab_of(drawn.page.context.browser, server)
    held: list[Any] = []
    tab.page.route("**/town/*/manifest.json", lambda route: held.append(route))
    tab.open("#world=cross")
    tab.ready()
    words = tab.page.locator("#town .empty")
    assert words.inner_text() == "The town is being drawn …"
    tab.wait("document.querySelector('#town .empty').textContent.includes('about a minute')")
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
    assert len(listed) - len(shown) == len(drawn.value("pavetwin.mission.environment.x_m"))
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
  const { town } = pavetwin, labels = [...document.querySelectorAll('#town .menu label')], reported = () => {
    for (let times = 0; times < 2; times++) town.render(); // the first may draw shadows too
    const { triangles, lines } = town.renderer.info.render, agents = town.list.length;
    return { triangles, lines, agents, stands: town.tiles.objects.visible };
  };
  const box = labels.find(({ textContent }) => textContent === layer).querySelector('input');
  return [reported(), (box.click(), reported()), (box.click(), reported())];
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
    standing = drawn.value("pavetwin.mission.environment.x_m.length")
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
    assert "no detector" not in found["search"][2], "no message without a search"
