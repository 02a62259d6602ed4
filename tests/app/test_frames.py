"""Rendered frames of captures: the images that `fly --save-frames` saves; the latest request first; no process left."""

import asyncio
import base64
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image

from pavetwin.app import frame_source, frames, task_pool
from pavetwin.app.frame_source import FILE, SHOWN_PX, _sources, shown_frame, write_frame_source
from pavetwin.app.frames import FrameRenderer
from pavetwin.app.requests import FramePart
from pavetwin.app.session import Played
from pavetwin.app.task_pool import KeptProcess, Messages
from pavetwin.app.tasks import run
from pavetwin.capture.mission_frames import CAPTURES, FOLDER, save_frames
from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.record import read_records
from pavetwin.capture.scene_renderer import SceneRenderer
from pavetwin.mission.fly import fly
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.saving import save_mission
from scenes.page import RunningPage, running_page
from scenes.processes import is_gone, is_over

FIRST = 3
"""Captures that are rendered."""


KEY = "0123456789abcdef0123"


@pytest.fixture(scope="module")
def page(world: Path) -> Iterator[RunningPage]:
    with running_page([world]) as running:
        yield with_mission(running)


def with_mission(page: RunningPage) -> RunningPage:
    """A page that knows a mission of five captures, which nobody has flown."""
    folder = page.session.folder / KEY
    folder.mkdir()
    (folder / FILE).write_text("[]")
    page.session._played[KEY] = Played(folder, folder, (), (5,), ("hover",), folder)
    return page


def ask(page: RunningPage, key: Any = KEY, **frame: Any) -> dict[str, Any]:
    (answer,) = page.ask({"do": "frame", "key": key, "mission": 0, "capture": 0, "part": "labelled", **frame})
    return answer


class KeepingImages(MissionImages):
    """Keeps the pixels of each image, before they are encoded."""

    def rendered(self, *asked: Any, **how: Any) -> Any:
        frame = super().rendered(*asked, **how)
        self.__dict__.setdefault("pixels", []).append(frame.rgb)
        return frame


def pixels_of(shown: Mapping[str, Any]) -> Any:
    with Image.open(BytesIO(base64.b64decode(shown["jpeg"]))) as image:
        return np.asarray(image, dtype=float)


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_a_frame_has_the_pixels_and_labels_of_the_saved_one(page: RunningPage, tmp_path: Path) -> None:
    request = {"traffic": "low", "seed": 1, "count": 1, "policies": ["baseline"], "altitude_m": 12.0}
    (flown,) = page.ask({"do": "fly", "request": request})
    spec = MissionFolder(Path(flown["done"]["folder"]) / "mission.yaml").spec
    inputs = load_inputs(spec)
    result = fly(spec, inputs=inputs)
    first = replace(result, captures={name: column[:FIRST] for name, column in result.captures.items()})
    images = KeepingImages(inputs.environment.inspected_world, inputs.replay, spec.seed, inputs.environment.parked)
    save_mission(result, tmp_path / "m")
    assert save_frames(first, images, tmp_path / "m", every=True) == FIRST
    write_frame_source([result], tmp_path)
    (source,) = _sources(tmp_path)
    records = list(read_records(tmp_path / "m" / FOLDER))
    assert (tmp_path / "m" / FOLDER / CAPTURES).read_text().startswith("capture,image\n0,")
    for capture, (record, pixels) in enumerate(zip(records, images.__dict__["pixels"], strict=True)):
        assert np.array_equal(source.rendered(capture)[0].rgb, pixels)
        shown = shown_frame(tmp_path, 0, capture, FramePart.LABELLED)
        assert [each["id"] for each in shown["labels"]] == [each.id for each in record.labelled]
        for label, saved in zip(shown["labels"], record.labelled, strict=True):
            assert np.allclose(np.multiply(label["box"], [*record.size_px, *record.size_px]), saved.box, atol=0.02)
    preview = shown_frame(tmp_path, 0, capture, FramePart.PREVIEW)
    small, first = pixels_of(shown), pixels_of(preview)
    assert max(small.shape) == SHOWN_PX
    whole = Image.fromarray(pixels).resize(small.shape[1::-1], Image.Resampling.LANCZOS)
    assert np.abs(small - np.asarray(whole, float)).mean() < 4
    same, upside_down = (np.abs(first - each).mean() for each in (small, small[::-1]))
    assert same < upside_down / 2, "the same picture, but for noise and sharpness"
    assert preview["labels"] is None
    assert preview["detections"] == shown["detections"]
    assert any(record.labelled for record in records), "a scene without anything to label shows nothing"
    served = ask(page, flown["done"]["key"], capture=FIRST - 1)
    assert served["done"] == shown


@pytest.mark.parametrize(
    "frame",
    [
        {"capture": -1},
        {"capture": 5},
        {"capture": 10**9},
        {"capture": 1.0},
        {"capture": True},
        {"capture": "0"},
        {"capture": None},
        {"mission": 1},
        {"mission": -1},
        {"mission": [0]},
        {"key": "0" * 20},
        {"key": "../x"},
        {"key": ["x"]},
        {"key": None},
        {"part": "search"},
        {"part": ["preview"]},
        {"part": None},
    ],
)
def test_what_is_no_capture_is_refused_in_one_line(page: RunningPage, frame: dict[str, Any]) -> None:
    answer = ask(page, **frame)
    assert "done" not in answer
    assert "\n" not in answer["error"]
    assert "Unexpected" not in answer["error"]
    assert not renderers(page)


def test_a_mission_of_another_server_is_foreign(page: RunningPage, world: Path) -> None:
    assert page.session.played(KEY)
    with running_page([world]) as other:
        assert "no longer exists" in ask(other)["error"]


def test_the_poses_of_captures_cannot_be_fetched_as_a_file(page: RunningPage) -> None:
    assert (page.session.folder / KEY / FILE).is_file()
    assert page.get(f"/api/played/{KEY}/{FILE}").status == 404


def renderers(page: RunningPage) -> list[int]:
    """The process that renders, if there is one."""
    process = page.session._renders._process
    return [] if process is None else [process.id]


@pytest.mark.parametrize("how", ["disconnect", "close"])
def test_the_process_is_gone_with_the_page_and_with_the_server(world: Path, how: str) -> None:
    seen: list[int] = []

    async def ask_and_go(page: RunningPage) -> None:
        client = await page.connect()
        await client.write_message(
            json.dumps({"id": 1, "do": "frame", "key": KEY, "mission": 0, "capture": 0, "part": "preview"})
        )
        while not renderers(page):
            await asyncio.sleep(0.02)
        seen.extend(renderers(page))
        if how == "disconnect":
            client.close()
            assert await asyncio.to_thread(is_over, lambda: not renderers(page))

    with running_page([world]) as page:
        asyncio.run(ask_and_go(with_mission(page)))
    assert seen
    assert is_over(lambda: all(is_gone(process) for process in seen))


@dataclass
class Stand:
    """A process whose tasks end on request."""

    ran: list[Any] = field(default_factory=list)
    is_let: bool = False
    is_alive: bool = True
    dies: bool = False

    async def run(self, task: Mapping[str, Any], reported: Any, messages: Messages | None = None) -> Mapping[str, Any]:  # noqa: ARG002
        (shown,) = [name for name in ("capture", "name") if name in task]
        self.ran.append(task[shown])
        while not self.is_let:
            await asyncio.sleep(0.005)
            if messages is not None and messages.is_new:
                return {}
        if self.dies:
            raise task_pool.ProcessDiedError
        return {} if "world" in task else {shown: task[shown]}

    async def stop(self) -> None:
        self.is_alive, self.is_let = False, True


class StandProcesses:
    """In place of `TaskProcess`."""

    def __init__(self) -> None:
        self.started: list[Stand] = []

    async def start(self) -> Stand:
        self.started.append(Stand())
        return self.started[-1]


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> StandProcesses:
    made = StandProcesses()
    monkeypatch.setattr(task_pool, "TaskProcess", made)
    return made


def test_of_a_page_only_the_latest_request_waits(processes: StandProcesses) -> None:
    async def scrub() -> list[Any]:
        renderer = FrameRenderer(KeptProcess())
        asked = []
        for capture in range(6):
            asked.append(asyncio.create_task(renderer.frame("one", {"capture": capture, "part": "preview"})))
            await asyncio.sleep(0.01)
        other = asyncio.create_task(renderer.frame("two", {"capture": 50}))
        await asyncio.sleep(0.01)
        processes.started[0].is_let = True
        answers = await asyncio.gather(*asked, other, return_exceptions=True)
        await renderer.close()
        return answers

    first, *dropped, last, other = asyncio.run(scrub())
    assert (first, last, other) == ({"capture": 0}, {"capture": 5}, {"capture": 50})
    assert all(isinstance(each, asyncio.CancelledError) for each in dropped)
    (process,) = processes.started
    assert process.ran == [0, 5, 50]
    assert not process.is_alive


def test_a_burst_of_requests_renders_the_first_and_the_last(processes: StandProcesses, world: Path) -> None:
    async def scrub(page: RunningPage) -> dict[int, dict[str, Any]]:
        client = await page.connect()
        for number in range(30):
            frame = {"id": number, "do": "frame", "key": KEY, "mission": 0, "capture": number % 5, "part": "preview"}
            await client.write_message(json.dumps(frame))
        answers: dict[int, dict[str, Any]] = {}
        while len(answers) < 30:
            answer = json.loads(await client.read_message() or "{}")
            answers[answer.pop("id")] = answer
            processes.started[0].is_let = len(answers) >= 28
        client.close()
        return answers

    with running_page([world]) as page:
        answers = asyncio.run(scrub(with_mission(page)))
    assert processes.started[0].ran == [0, 4]
    assert answers.pop(0) == {"done": {"capture": 0}}
    assert answers.pop(29) == {"done": {"capture": 4}}
    assert all(answer == {"cancelled": True} for answer in answers.values())


def test_the_latest_frames_are_kept_and_no_more(processes: StandProcesses, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "KEPT", 4)

    async def look() -> None:
        renderer = FrameRenderer(KeptProcess())
        first = asyncio.create_task(renderer.frame("one", {"capture": 0}))
        await asyncio.sleep(0.01)
        processes.started[0].is_let = True
        await first
        for capture in (1, 2, 3, 4, 4, 2, 0):
            assert await renderer.frame("one", {"capture": capture}) == {"capture": capture}
        assert len(renderer._kept) == 4
        await renderer.close()

    asyncio.run(look())
    assert processes.started[0].ran == [0, 1, 2, 3, 4, 0]


def test_a_page_that_stays_keeps_the_process_that_another_one_leaves(processes: StandProcesses) -> None:
    async def come_and_go() -> None:
        renderer = FrameRenderer(KeptProcess())
        asked = [asyncio.create_task(renderer.frame(page, {"capture": at})) for at, page in enumerate(("one", "two"))]
        await asyncio.sleep(0.01)
        await renderer.leave("one")
        assert processes.started[0].is_alive
        processes.started[0].is_let = True
        assert await asked[1] == {"capture": 1}
        await renderer.leave("two")
        assert not processes.started[0].is_alive
        again = asyncio.create_task(renderer.frame("three", {"capture": 7, "part": "preview"}))
        await asyncio.sleep(0.01)
        assert len(processes.started) == 2
        await renderer.leave("three")
        assert await again == {"capture": 7}
        assert not processes.started[1].is_alive

    asyncio.run(come_and_go())


def test_the_frames_and_the_town_are_made_by_one_process(processes: StandProcesses, world: Path) -> None:
    """A page that shows the town keeps the process that another one leaves; with the last one it ends."""

    async def look(page: RunningPage) -> None:
        first, other = await page.connect(), await page.connect()
        await first.write_message(
            json.dumps({"id": 1, "do": "frame", "key": KEY, "mission": 0, "capture": 3, "part": "preview"})
        )
        assert await asyncio.to_thread(is_over, lambda: processes.started and processes.started[0].ran == [3])
        tile = asyncio.create_task(asyncio.to_thread(page.get, "/town/w0/manifest.json"))
        await asyncio.sleep(0.05)
        assert processes.started[0].ran == [3], "one at a time"
        processes.started[0].is_let = True
        assert json.loads(await first.read_message() or "{}")["done"] == {"capture": 3}
        assert (await tile).status == 404, "the stand-in has no town"
        first.close()
        await asyncio.sleep(0.1)
        assert processes.started[0].is_alive
        other.close()
        assert await asyncio.to_thread(is_over, lambda: not processes.started[0].is_alive)

    with running_page([world]) as page:
        asyncio.run(look(with_mission(page)))
    assert len(processes.started) == 1
    assert processes.started[0].ran == [3, "manifest.json"]


def test_labels_are_given_up_for_another_capture_and_previews_are_not(processes: StandProcesses) -> None:
    async def look() -> list[Any]:
        renderer, answers = FrameRenderer(KeptProcess()), []
        for page, capture, part in (
            ("one", 0, "labelled"),
            ("two", 1, "preview"),
            ("one", 2, "preview"),
            ("one", 3, "labelled"),
        ):
            answers.append(asyncio.create_task(renderer.frame(page, {"capture": capture, "part": part})))
            await asyncio.sleep(0.03)
        processes.started[0].is_let = True
        found = await asyncio.gather(*answers, return_exceptions=True)
        await renderer.close()
        return found

    first, other, dropped, last = asyncio.run(look())
    assert isinstance(first, asyncio.CancelledError), "its page asked for capture 2"
    assert (other, last) == ({"capture": 1}, {"capture": 3})
    assert isinstance(dropped, asyncio.CancelledError), "it waited when its page asked for capture 3"
    assert processes.started[0].ran == [0, 1, 3]


def test_labels_are_given_up_for_a_frame_that_is_known_and_with_their_page(processes: StandProcesses) -> None:
    async def look() -> list[Any]:
        renderer, answers = FrameRenderer(KeptProcess()), []
        known = {"capture": 0, "part": "preview"}
        first = asyncio.create_task(renderer.frame("one", known))
        await asyncio.sleep(0.03)
        processes.started[0].is_let = True
        await first
        processes.started[0].is_let = False
        renderer.enter("two")
        for capture, leaves in ((1, False), (2, True)):
            answers.append(asyncio.create_task(renderer.frame("one", {"capture": capture, "part": "labelled"})))
            await asyncio.sleep(0.03)
            if leaves:
                await renderer.leave("one")
            else:
                assert await renderer.frame("one", known) == {"capture": 0}
        found = await asyncio.wait_for(asyncio.gather(*answers, return_exceptions=True), 5)
        await renderer.close()
        return found

    found = asyncio.run(look())
    assert [type(each) for each in found] == 2 * [asyncio.CancelledError]
    assert processes.started[0].ran == [0, 1, 2]


def test_a_frame_that_is_not_wanted_is_given_up_between_its_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    class Renderer:
        on_step: Any = staticmethod(lambda: None)

    scene = SceneRenderer.__new__(SceneRenderer)
    scene._renderer = Renderer()

    class Source:
        sensor, captures, images = "recall", [{"detections": []}], SimpleNamespace(scene_renderer=scene)

        def preview(self, capture: int) -> Any:  # noqa: ARG002
            scene._renderer.on_step()
            return np.zeros((3, 4, 3), dtype=np.uint8)

    monkeypatch.setattr(frame_source, "_sources", lambda _: (Source(),))
    task = {"do": "frame", "folder": "x", "mission": 0, "capture": 0, "part": "preview"}
    quiet, telling = SimpleNamespace(messages=list), SimpleNamespace(messages=lambda: [{"stop": True}])
    assert run(task, quiet)["jpeg"]
    assert run(task, telling) == {}
    assert scene._renderer.on_step() is None, "it is asked no more"


def test_a_frame_goes_before_the_tiles_that_wait(processes: StandProcesses) -> None:
    async def load() -> list[Any]:
        kept = KeptProcess()
        tiles = [asyncio.create_task(kept.run({"name": f"tile {at}"}, is_patient=True)) for at in range(4)]
        await asyncio.sleep(0.01)
        frames = [asyncio.create_task(kept.run({"capture": at})) for at in range(2)]
        await asyncio.sleep(0.01)
        frames[0].cancel()  # who waits and goes away holds nobody up
        await asyncio.sleep(0.01)
        processes.started[0].is_let = True
        await asyncio.gather(*tiles, frames[1])
        await kept.close()
        return processes.started[0].ran

    assert asyncio.run(load()) == ["tile 0", 1, "tile 1", "tile 2", "tile 3"]


@pytest.mark.usefixtures("processes")
def test_a_frame_that_goes_away_as_a_tile_gets_its_turn_leaves_the_server_running() -> None:
    class Lock(asyncio.Lock):
        asked = 0

        async def acquire(self) -> Literal[True]:
            self.asked += 1
            assert self.asked < 50, "it asks for its turn without an end, and nothing else runs"
            return await super().acquire()

    async def load() -> list[str]:
        kept, taken, over = KeptProcess(), [], asyncio.Event()
        kept._turn = Lock()

        async def take(what: str, *, is_patient: bool = False) -> None:
            async with kept._in_turn(is_patient=is_patient):
                taken.append(what)
                if what == "first":
                    await over.wait()

        first = asyncio.create_task(take("first"))
        await asyncio.sleep(0)
        tile = asyncio.create_task(take("tile", is_patient=True))
        await asyncio.sleep(0)
        frame = asyncio.create_task(take("frame"))
        await asyncio.sleep(0)
        over.set()
        await asyncio.sleep(0)  # the first ends, and the turn is the tile's, which has not run yet
        frame.cancel()
        await asyncio.gather(first, tile)
        return taken

    assert asyncio.run(load()) == ["first", "tile"]


def test_a_tile_is_made_again_where_its_process_is_ended_meanwhile(processes: StandProcesses) -> None:
    async def load() -> Mapping[str, Any]:
        kept = KeptProcess()
        tile = asyncio.create_task(kept.run({"name": "tile"}, is_patient=True, again=True))
        frame = asyncio.create_task(kept.run({"capture": 1}))
        await asyncio.sleep(0.01)
        processes.started[0].dies = True
        await kept.end()
        await asyncio.sleep(0.01)
        processes.started[1].is_let = True
        answers = await asyncio.gather(tile, frame)
        await kept.close()
        return answers[0]

    assert asyncio.run(load()) == {"name": "tile"}
    assert [each.ran for each in processes.started] == [["tile"], ["tile", 1]]
