"""The page that `pavetwin app` opens, in a headless browser without a GPU, and the tiles of its town in 3-D."""

import shutil
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.browser import HARDWARE, Tab, browser, chromium, page_server, tab
from benchmarks.measure import Kind, Line, Size
from benchmarks.visitor import first_visit
from pavetwin.scene.scene import SCENE_SEED, Scene
from pavetwin.scene.web.packing import WEB_LEVELS
from pavetwin.scene.web.town import FACADES, LEAVES, MODELS, WebTown, tile_name
from pavetwin.world.model import World
from pavetwin.world.segments import point_at
from pavetwin.world.store import load_world

RUNS, SEGMENTS, SEED = 3, 3, 1
ANSWER_S: Final = 120.0
AGENTS, UPDATES = 1500, 60
PICTURE_PX: Final = (480, 270)
GPU_PICTURE_PX: Final = (1920, 1080)
FRAMES_S = 4.0
FAR_M = 150.0
"""Between places of which one is rendered while nothing of the other is there."""
AHEAD = 20
"""Captures around a moment that is shown, of which the page makes some too; it begins with the take-off."""

CROWD: Final = """(count, updates) => {
    const town = pavetwin.town, [x, y] = town.manifest.base, kinds = ['passenger', 'delivery', 'bus', 'motorcycle'];
    town.agents.times.length = 0;
    for (let at = 0; at < updates; at++) {
        town.setAgents(Array.from({ length: count }, (_, id) => ({
            id, x: x + 7 * (id % 40 - 20) + 0.3 * at, y: y + 7 * (Math.floor(id / 40) - 18), yaw: id + 0.01 * at,
            pedestrian: id % 2 === 0, kind: kinds[id % 4], moving: true })));
        town.agents.update(town.cameras.camera.position);
    }
    const median = town.agents.median;
    town.setAgents([]);
    return median;
}"""
"""As many vehicles and people, who move; the median of an update in milliseconds."""

RATE: Final = """async ([wide, tall, seconds, mode]) => {
    const { town } = pavetwin, { canvas, renderer } = town, [x, y] = town.manifest.base, gl = renderer.getContext();
    Object.assign(canvas.style, { width: `${wide}px`, height: `${tall}px` });
    town.resize();
    let at = 0;
    const draw = () => {
        at += 1;
        if (mode === 'follow') town.setUav({ x: x + 0.2 * at, y, z: 10, yaw: 0, pitch: -Math.PI / 2 });
        else town.cameras.controls.target.x += 0.2;
        town.render();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    };
    if (mode === 'follow') { town.setUav({ x, y, z: 10, yaw: 0, pitch: -Math.PI / 2 }); town.setCamera('follow'); }
    draw();
    while (town.stats().pending) { await new Promise(next => setTimeout(next, 50)); town.render(); }
    draw();
    const begun = performance.now(), first = at;
    while (performance.now() - begun < 1000 * seconds) { draw(); await new Promise(next => setTimeout(next, 0)); }
    return 1000 * (at - first) / (performance.now() - begun);
}"""
"""Images of this size a second while the camera moves, each waited for until its pixels are there."""


def lines(town: Path, folder: Path, size: Size) -> Iterator[Line]:
    """Tiles, and where there is a browser the page.

    Args:
        town: a world.
        folder: for a copy of it, which gets missions.
    """
    world = load_world(town)
    yield from _tiles(world, folder / "tiles", size)
    if chromium() is None:
        return
    copy = Path(shutil.copytree(town, folder / "page" / town.name, ignore=shutil.ignore_patterns("missions")))
    with browser() as started:
        visit = first_visit(started, town, folder)
        what = "from the command to an answer about one street, first visit"
        note = f"{visit.own_s:.0f} s of it the visitor's own, and the traffic is recorded on the way; one run"
        yield Line(what, visit.taken_s, Kind.SECONDS, ANSWER_S, note=note)
        yield from _page(started, copy, min(size.runs, RUNS))
    yield from _on_a_gpu(copy)


def _tiles(world: World, folder: Path, size: Size) -> Iterator[Line]:
    """Processor time of a file of each level that nobody has asked for, over streets; the median of the places."""
    town = WebTown(Scene(world, seed=SCENE_SEED), folder=folder)
    near = world.base.x, world.base.y
    begun = time.process_time()
    reliefs = town.manifest()["defects"]["parts"]
    for name in (MODELS, FACADES, LEAVES, *_names(near)):
        town.file(name)
    note = "processor time; models, plans of paint, repairs and furniture, and a tile of each level; one run"
    yield Line("what all tiles of a town in 3-D need, once", time.process_time() - begun, Kind.SECONDS, note=note)
    times: dict[str, list[float]] = {}
    for segment in world.segments[:: max(1, len(world.segments) // size.places)][: size.places]:
        names = _names(point_at(segment.centre_line, segment.length_m / 2))
        parts = {f"level {level.number}": name for level, name in zip(reversed(WEB_LEVELS), names, strict=True)}
        key = names[-1].removeprefix("0/").partition(".")[0]
        if key in reliefs:
            parts["three defects"] = f"defects/{key}_0.glb.gz"
        for what, name in parts.items():
            if (folder / name).is_file():
                continue
            begun = time.process_time()
            town.file(name)
            times.setdefault(what, []).append(time.process_time() - begun)
    for what, taken in times.items():
        note = f"processor time, the first time; the median of {len(taken)} places, at most {max(taken):.2f} s"
        yield Line(f"a tile of the town in 3-D, {what}", statistics.median(taken), Kind.SECONDS, 0.5, note=note)


def _names(place: tuple[float, float]) -> list[str]:
    """The tile of each level at a place, the coarsest first."""
    keys = [(level, (int(place[0] // level.side_m), int(place[1] // level.side_m))) for level in reversed(WEB_LEVELS)]
    return [tile_name(level, key) for level, key in keys]


def _page(started: Any, world: Path, runs: int) -> Iterator[Line]:
    usable = [_usable_s(started, world) for _ in range(runs)]
    note = f"the command, the browser's request and the map; wall clock, median of {runs}, in 1366 × 768"
    yield Line("the page can be used, after the command", statistics.median(usable), Kind.SECONDS, 3.0, note=note)
    with page_server(world) as (address, _):
        with tab(started) as shown:
            shown.open(f"{address}#world={world.name}&count={SEGMENTS}&seed={SEED}")
            shown.wait("document.documentElement.dataset.ready === 'yes'")
            _fly(shown, 9)  # records the traffic
            flown = [_fly(shown, 10 + run) for run in range(runs)]
            note = f"hover, its traffic recorded; the town in 3-D drawn beside it; wall clock, median of {runs}"
            what = f"from Start to map, table and curves of a mission, segments: {SEGMENTS}"
            yield Line(what, statistics.median(flown), Kind.SECONDS, 3.0, note=note)
            yield from _frames(shown)
        with tab(started) as shown:  # all tiles of the start view are made now
            shown.open(f"{address}#world={world.name}")
            shown.wait("window.pavetwin?.town?.tiles && !pavetwin.town.stats().pending")
        with tab(started) as shown:
            shown.open(f"{address}#world={world.name}")
            yield from _town(shown)


def _usable_s(started: Any, world: Path) -> float:
    with tab(started) as shown, page_server(world) as (address, begun):
        shown.open(f"{address}#world={world.name}")
        shown.wait("document.documentElement?.dataset.ready === 'yes'")
        return time.perf_counter() - begun


def _fly(shown: Tab, altitude_m: int) -> float:
    """Seconds from Start to the mission on map, table and curves."""
    shown.page.fill("[name=altitude_m]", str(altitude_m))
    shown.page.press("[name=altitude_m]", "Tab")
    begun = shown.wait("!document.querySelector('#selection').classList.contains('busy')")
    shown.value("(document.querySelector('#start').click(), null)")
    drawn = "document.querySelector('#table tbody tr') && document.querySelector('#plots canvas')"
    ended = shown.wait(f"window.pavetwin?.mission?.altitude_m === {altitude_m} && {drawn}")
    shown.wait("!document.querySelector('#start').disabled")
    return ended - begun


def _frames(shown: Tab) -> Iterator[Line]:
    """Rendered frames of captures: the first of all, of one before it at the same place, and of a far place."""
    captures = shown.value("(({ t_s, x_m, y_m }) => ({ t_s, x_m, y_m }))(pavetwin.mission.captures)")
    places = np.column_stack([captures["x_m"], captures["y_m"]])
    first = len(places) // 2
    away = np.hypot(*(places - places[first]).T)
    away[max(0, first - AHEAD) : first + AHEAD + 1] = away[:AHEAD] = 0  # the page makes frames of these
    far = int(np.argmax(away)) if away.max() < FAR_M else int(np.flatnonzero(away >= FAR_M)[0])

    def rendered_s(capture: int, also: str = "") -> float:
        begun = shown.wait("true")
        shown.value(f"(pavetwin.seek({captures['t_s'][capture]!r}), null)")
        return shown.wait(f"pavetwin.frame?.capture === {capture} {also}") - begun

    first_s = rendered_s(first)
    note = "the process of the renderer starts and reads the world"
    yield Line("the first rendered frame of a mission in the page", first_s, Kind.SECONDS, note=note)
    shown.wait("!window.pavetwin?.town?.tiles || !pavetwin.town.stats().pending")  # which takes the cores else
    shown.page.wait_for_timeout(1000 * min(60.0, 3.0 + 5 * first_s))  # the next ones are made ahead
    warm = [rendered_s(capture) for capture in range(first - 1, first - 6, -1)]
    note = f"seek to a capture beside one that is there; from the command to the picture; median of {len(warm)}"
    what = "a rendered frame at a moment that is chosen"
    yield Line(f"{what}, place warm", statistics.median(warm), Kind.SECONDS, 0.3, note=note)
    labelled = [rendered_s(capture, "&& pavetwin.frame.labels") for capture in range(first - 6, first - 9, -1)]
    note = f"as saved by fly --save-frames, once the moment has stayed for 0.4 s; median of {len(labelled)}"
    yield Line(f"{what}, with its labels", statistics.median(labelled), Kind.SECONDS, note=note)
    note = f"{away[far]:.0f} m away, where nothing was rendered before; one run"
    yield Line(f"{what}, place cold", rendered_s(far), Kind.SECONDS, 3.0, note=note)


def _town(shown: Tab) -> Iterator[Line]:
    """The town in 3-D whose tiles are there: until it is complete, what it takes, and how fast it is drawn."""
    taken_s = shown.wait("window.pavetwin?.town?.tiles && !pavetwin.town.stats().pending")
    stats = shown.value("(pavetwin.town.render(), pavetwin.town.stats())")
    sent = "performance.getEntriesByType('resource').reduce((sum, each) => sum + each.transferSize, 0)"
    note = f"start view, tiles {'/'.join(map(str, stats['tiles']))} by level; since the page was asked for; wall clock"
    yield Line("the town in 3-D from cached tiles", taken_s, Kind.SECONDS, 10.0, note=note)
    yield Line("transferred for it, the page included", shown.value(sent) / 2**20, Kind.MEBIBYTES, 15e6 / 2**20)
    yield Line("its draw calls", stats["drawCalls"], Kind.COUNT, 400)
    yield Line("its triangles", stats["triangles"], Kind.COUNT, 400_000, note=stats["renderer"])
    update_ms = shown.value(f"({CROWD})({AGENTS}, {UPDATES})")
    note = f"median of {UPDATES}; places, models and colours, without drawing"
    yield Line(f"an update of {AGENTS:,} agents in 3-D", update_ms / 1000, Kind.SECONDS, 0.004, note=note)
    yield from _rates(shown, PICTURE_PX, 15.0, "in software")


def _rates(shown: Tab, size_px: tuple[int, int], target: float, note: str) -> Iterator[Line]:
    wide, tall = size_px
    for what, mode in (("start view", "orbit"), ("behind the UAV", "follow")):
        rate = shown.value(f"({RATE})([{wide}, {tall}, {FRAMES_S}, '{mode}'])")
        yield Line(f"the town in 3-D at {wide} × {tall} px, {what}", rate, Kind.PER_SECOND, target, note=note)


def _on_a_gpu(world: Path) -> Iterator[Line]:
    """Images a second of a browser that draws with a graphics processor; where there is none, that is said."""
    with browser(HARDWARE) as started, page_server(world) as (address, _), tab(started) as shown:
        shown.open(f"{address}#world={world.name}")
        shown.wait("window.pavetwin?.town && (!pavetwin.town.available || pavetwin.town.tiles)")
        stats = shown.value("pavetwin.town.stats()")
        if not stats["available"] or shown.value("pavetwin.town.isSlow"):
            wide, tall = GPU_PICTURE_PX
            what, note = f"the town in 3-D at {wide} × {tall} px on a GPU", "not measured: this machine has none"
            yield Line(what, None, Kind.PER_SECOND, 60.0, note=note)
            return
        shown.wait("!pavetwin.town.stats().pending")
        yield from _rates(shown, GPU_PICTURE_PX, 60.0, stats["renderer"])
