"""The town in 3-D in a real browser without a GPU: tiles, traffic, cameras, picks, and a browser without WebGL."""

import asyncio
import functools
import gzip
import json
import os
import shutil
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pavetwin.app.task_pool import KeptProcess
from pavetwin.errors import PaveTwinError
from pavetwin.scene.scene import Scene
from pavetwin.scene.web import WebTown
from pavetwin.scene.web.town import FACADES, LEAVES, MANIFEST
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.page import RunningPage, running_page
from scenes.processes import children, command_line, is_gone, is_over

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make setup)")

STATIC = Path(__file__).resolve().parents[2] / "src" / "pavetwin" / "app" / "static"
CHROMIUM = shutil.which("chromium")
POLICY = "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'"
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
]


class TownHandler(SimpleHTTPRequestHandler):
    """Serves the client, a page and a town's files, which are made when they are asked for."""

    def __init__(self, *arguments: Any, town: WebTown, **options: Any) -> None:
        self.town = town
        super().__init__(*arguments, **options)

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        try:
            if path == f"/web/{MANIFEST}":
                body = json.dumps(self.town.manifest()).encode()
            elif path.startswith("/web/"):
                body = self.town.file(path.removeprefix("/web/"))
            elif path.startswith("/static/"):
                body = (STATIC / path.removeprefix("/static/")).read_bytes()
            else:
                body = b"" if path == "/favicon.ico" else Path(__file__).with_name("town.html").read_bytes()
        except (KeyError, OSError):
            self.send_error(404)
            return
        kind = {".js": "text/javascript", "": "text/html"}.get(Path(path).suffix, "application/octet-stream")
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with suppress(BrokenPipeError, ConnectionResetError):  # the page may be gone
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@dataclass
class Shown:
    """A page with a town, and what the browser complained of."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    hosts: set[str] = field(default_factory=set)

    def settle(self) -> dict[str, Any]:
        self.page.evaluate("town.render()")  # asks for what the camera needs now
        # `wait_for_function` evaluates texts, which the Content-Security-Policy refuses.
        while self.page.evaluate("town.stats().pending > 0 && !town.stats().failed"):
            self.page.wait_for_timeout(200)
        self.page.evaluate("town.render()")
        stats: dict[str, Any] = self.page.evaluate("town.stats()")
        assert stats["failed"] is None
        return stats

    def picture(self) -> np.ndarray[Any, np.dtype[np.uint8]]:
        return np.asarray(Image.open(BytesIO(self.page.screenshot())).convert("RGB"))


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("town")
    save_world(built("cross"), folder / "cross")
    world = load_world(folder / "cross")
    at = world.base
    town = WebTown(Scene(world, seed=1), bounds=(at.x - 20, at.y - 20, at.x + 20, at.y + 20))
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(TownHandler, town=town))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


def opened(browser: Any, address: str) -> Shown:
    shown = Shown(browser.new_page(viewport={"width": 640, "height": 360}))
    page = shown.page
    page.on("console", lambda line: shown.complaints.append(line.text) if line.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: shown.complaints.append(str(error)))
    page.on("request", lambda request: shown.hosts.add(request.url.split("/")[2]))
    page.goto(address)
    page.evaluate("town.ready")
    return shown


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        yield started.chromium


@pytest.fixture(scope="module")
def shown(chromium: Any, address: str) -> Iterator[Shown]:
    browser = chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
    yield opened(browser, address)
    browser.close()


def test_the_town_is_drawn(shown: Shown, address: str) -> None:
    stats = shown.settle()
    assert "SwiftShader" in stats["renderer"] or "llvmpipe" in stats["renderer"]
    assert 0 < stats["drawCalls"] <= 400
    assert 1000 < stats["triangles"] <= 400_000
    assert stats["bytes"] <= 15e6
    assert shown.picture().std(axis=(0, 1)).mean() > 10, "the canvas is blank"
    assert shown.hosts == {address.removeprefix("http://")}
    assert shown.complaints == []
    smooth = "town.renderer.getContext().getContextAttributes().antialias"
    assert not shown.page.evaluate(smooth), "smooth edges take a processor most of its time"


def test_levels_come_with_the_distance(shown: Shown) -> None:
    west, south, east, north = shown.page.evaluate("town.manifest.bounds")
    x, y = shown.page.evaluate("town.manifest.base")
    shown.page.evaluate(f"town.lookAt({x}, {y}, 25)")
    near = shown.settle()
    assert near["tiles"][0] > 0
    shown.page.evaluate(f"town.lookAt({(west + east) / 2}, {(south + north) / 2}, 2000)")
    far = shown.settle()
    assert far["tiles"][:2] == [0, 0]
    assert far["tiles"][2] > 0
    assert far["triangles"] < near["triangles"]
    drawn = shown.page.evaluate("[...town.tiles.pools.pools].filter(([, pool]) => pool.count).map(([name]) => name)")
    crowns = {name.rpartition(":")[2] for name in drawn if ":crown:" in name}
    assert crowns == {"3"}, "far trees are bodies where the processor draws"


def test_agents_are_instances(shown: Shown) -> None:
    x, y = shown.page.evaluate("town.manifest.base")
    shown.page.evaluate(f"town.lookAt({x}, {y}, 60)")
    before, blank = shown.settle(), shown.picture()
    shown.page.evaluate(
        f"""town.setAgents(Array.from({{length: 1500}}, (_, id) => ({{
            id, x: {x} + 1.5 * (id % 40 - 20), y: {y} + 3 * (Math.floor(id / 40) - 18), yaw: id,
            pedestrian: id % 3 === 0, kind: ["saloon", "bus", "van", "delivery", "passenger"][id % 5],
            length_m: id % 3 ? 4.5 : undefined }})))"""
    )
    after = shown.settle()
    assert after["agents"] == 1500
    assert after["drawCalls"] - before["drawCalls"] <= 60
    assert np.abs(shown.picture().astype(int) - blank).mean() > 5
    shown.page.evaluate("town.setAgents([])")
    cleared = shown.settle()
    assert cleared["triangles"] == before["triangles"]


def test_of_another_flight_the_same_number_is_another_agent(shown: Shown) -> None:
    x, y = shown.page.evaluate("town.manifest.base")
    agent = f"{{id: 7, x: {x}, y: {y}, yaw: 0, "
    size = "town.agents.appearance(town.list[0]).size[0]"
    shown.page.evaluate(f"town.forgetAgents(); town.setAgents([{agent} kind: 'saloon', length_m: 4.6}}])")
    assert shown.page.evaluate(size) == 4.6
    shown.page.evaluate(f"town.forgetAgents(); town.setAgents([{agent} kind: 'bus', length_m: 12}}])")
    assert shown.page.evaluate(size) == 12
    shown.page.evaluate("town.forgetAgents(); town.setAgents([])")


def test_a_reset_graphics_processor_is_reported_until_it_is_back(shown: Shown) -> None:
    message = "document.querySelector('#message').textContent"
    shown.page.evaluate(
        "window.lost = town.renderer.getContext().getExtension('WEBGL_lose_context'); lost.loseContext()"
    )
    while "reset" not in shown.page.evaluate(message):
        shown.page.wait_for_timeout(50)
    shown.page.evaluate("lost.restoreContext()")
    while shown.page.evaluate("town.lost"):
        shown.page.wait_for_timeout(50)
    assert shown.page.evaluate(message) == ""
    shown.settle()
    assert shown.picture().std() > 10, "it is drawn again"
    shown.complaints[:] = [each for each in shown.complaints if "context" not in each.lower()]


def test_a_tile_that_does_not_come_is_asked_for_again(shown: Shown) -> None:
    x, y = shown.page.evaluate("town.manifest.base")
    shown.page.evaluate(f"town.lookAt({x}, {y}, 60)")
    shown.settle()
    shown.page.evaluate(
        f"""(async () => {{
            const {{ tiles }} = town, fetched = tiles.files.meshes, node = window.node = [...tiles.shown][0];
            tiles.files.meshes = () => Promise.reject(new Error('lost'));
            node.state = 'none';
            town.lookAt({x} + 5, {y}, 60);
            town.render();
            await Promise.all([...tiles.working]);
            town.render();
            window.lost = town.stats().failed;
            tiles.files.meshes = fetched;
        }})()"""
    )
    assert shown.page.evaluate("lost") == "lost"
    for _ in range(300):
        if shown.page.evaluate("(town.render(), town.stats().failed)") is None:
            break
        shown.page.wait_for_timeout(100)
    assert shown.settle()["failed"] is None
    assert shown.page.evaluate("node.state") == "ready"
    assert shown.page.evaluate("town.message") == ""


def test_cameras_follow_what_they_follow(shown: Shown) -> None:
    x, y = shown.page.evaluate("town.manifest.base")
    shown.page.evaluate(f"town.setAgents([{{id: 7, x: {x}, y: {y}, yaw: 0.5, kind: 'saloon', length_m: 4.6}}])")
    shown.page.evaluate(f"town.setUav({{x: {x}, y: {y}, z: 15, yaw: 1.2, pitch: -Math.PI / 2}})")
    place = "[town.cameras.camera.position.z, town.cameras.camera.position.x, town.cameras.camera.position.y]"
    for mode, height in (("uav", 15.0), ("follow", 21.0), ("car", 1.25)):
        shown.page.evaluate(f"town.setCamera('{mode}', {{agent: 7}})")
        shown.settle()
        east, north, up = shown.page.evaluate(place)
        assert up == pytest.approx(height, abs=0.01), mode
        assert np.hypot(east - x, north - y) < 15
    ahead = shown.page.evaluate("town.cameras.camera.getWorldDirection(town.cameras.camera.position.clone()).toArray()")
    assert np.arctan2(ahead[0], ahead[2]) == pytest.approx(0.5, abs=0.02), "the driver looks along the road"
    shown.page.evaluate("town.setCamera('orbit'); town.setUav(null); town.setAgents([])")


def test_a_click_picks_a_place_and_its_object(shown: Shown) -> None:
    x, y = shown.page.evaluate("town.manifest.base")
    shown.page.evaluate(f"town.lookAt({x}, {y}, 30); town.render()")
    shown.page.mouse.click(320, 180)
    (pick,) = shown.page.evaluate("picks.splice(0)")
    assert (pick["x"], pick["y"]) == pytest.approx((x, y), abs=0.3)
    assert pick["agent"] is None
    shown.page.evaluate(f"town.setAgents([{{id: 9003, x: {x}, y: {y}, yaw: 0, kind: 'van'}}]); town.render()")
    shown.page.mouse.click(320, 180)
    (pick,) = shown.page.evaluate("picks.splice(0)")
    assert pick["agent"] == 9003
    shown.page.evaluate("town.setAgents([])")
    # Tiles of before the reset above are let go of when others come: their buffers are of the context that was lost.
    assert [each for each in shown.complaints if "does not belong to this context" not in each] == []


WAITS = """(async () => {
  const drawn = [], render = town.render.bind(town), until = async count => {
    for (let tries = 0; tries < 600 && drawn.length < count; tries++) await new Promise(next => setTimeout(next, 50));
  };
  let asked = 0;
  const isBusy = town.isBusy;
  town.render = () => { drawn.push(asked); render(); };
  town.isBusy = () => { asked += 1; return asked < 2; };
  town.dirty = true;
  await until(1);
  town.isBusy = () => { asked += 1; return true; };
  town.dirty = true;
  await until(2);
  delete town.render;
  town.isBusy = isBusy;
  return drawn;
})()"""
"""Messages to the town before each image: first that something is made, then that it is
there; then never."""


def test_a_picture_by_the_processor_waits_for_what_is_made_but_not_for_long(shown: Shown) -> None:
    shown.settle()
    while shown.page.evaluate("town.scale !== 1"):
        shown.page.wait_for_timeout(100)
    # Where a turn of the browser takes as long as a picture may wait, it is not asked twice: hence several tries.
    tries = [shown.page.evaluate(WAITS) for _ in range(5)]
    assert any(first == 2 for first, _ in tries)
    assert all(second > first for first, second in tries)


def test_without_webgl_there_is_a_message_and_no_error(chromium: Any, address: str) -> None:
    browser = chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-3d-apis"])
    shown = opened(browser, address)
    assert shown.page.evaluate("town.available") is False
    assert "no WebGL" in shown.page.text_content("#message")
    shown.page.evaluate("town.setAgents([{id: 1}]); town.setCamera('car'); town.setUav(null); town.dispose()")
    assert shown.complaints == []
    browser.close()


TILE = "/town/w0/2/{}_{}.glb.gz"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("town-files") / "cross"
    save_world(built("cross"), folder)
    return folder


def processes() -> set[int]:
    return {child for child in children(os.getpid()) if b"pavetwin.app.task_process" in command_line(child)}


@pytest.mark.slow
def test_the_manifest_and_the_tiles_that_it_lists_are_served(page: RunningPage, world: Path) -> None:
    before = processes()
    answer = page.get("/town/w0/manifest.json")
    assert answer.status == 200
    assert answer.headers["Content-Type"].startswith("application/json")
    manifest = answer.values
    base = load_world(world).base
    assert manifest["base"] == pytest.approx([base.x, base.y], abs=0.01)
    column, row = manifest["levels"][2]["tiles"][0][:2]
    with ThreadPoolExecutor(4) as several:
        first, *others = several.map(page.get, [TILE.format(column, row)] * 4)
    assert first.status == 200
    assert gzip.decompress(first.body)[:4] == b"glTF"
    assert all(other.body == first.body for other in others)
    assert len(processes() - before) == 1, "one process makes all files"
    again = page.get(TILE.format(column, row), If_None_Match=first.headers["ETag"])
    assert (again.status, again.body) == (304, b"")
    assert page.get("/town/w0/leaves.png").body[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    "name",
    [
        "2/99999_0.glb.gz",
        "9/0_0.glb.gz",
        "0/0_0.glb",
        "nothing",
        "../manifest.json",
        "..%2fmanifest.json",
        "..%2f..%2fworld.yaml",
        "2/..%2f..%2fworld.yaml",
        "%2fetc%2fpasswd",
        "defects/0_0_9999.glb.gz",
        f"{FACADES}%00",
        "x" * 5000,
    ],
)
def test_other_names_are_not_found(page: RunningPage, name: str) -> None:
    answer = page.get(f"/town/w0/{name}")
    assert answer.status == 404
    assert "error" in answer.values


def test_unknown_worlds_are_not_found(page: RunningPage) -> None:
    for key in ("w1", "x", "..%2fw0"):
        assert page.get(f"/town/{key}/manifest.json").status == 404


def test_without_the_token_no_file_is_served(page: RunningPage) -> None:
    for name in ("manifest.json", LEAVES):
        assert page.get(f"/town/w0/{name}", Cookie="").status == 403
        assert page.get(f"/town/w0/{name}", Origin="http://evil.example").status == 403


@pytest.mark.slow
def test_a_process_that_died_is_replaced_and_the_last_ends_with_the_server(world: Path) -> None:
    before = processes()
    with running_page([world]) as own:
        assert own.get("/town/w0/manifest.json").status == 200
        (first,) = processes() - before
        os.kill(first, signal.SIGKILL)
        assert is_over(lambda: is_gone(first))
        assert own.get("/town/w0/manifest.json").status == 200
        (second,) = processes() - before
    assert is_over(lambda: is_gone(second))


def test_a_closed_one_starts_no_process() -> None:
    async def late() -> None:
        kept = KeptProcess()
        await kept.close()
        await kept.run({"do": "town"})

    before = processes()
    with pytest.raises(PaveTwinError, match="ends"):
        asyncio.run(late())
    assert processes() == before
