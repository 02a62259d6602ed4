"""State of a running server: shown worlds, playable missions, and a folder of files for the browser, which is removed
when the server ends."""

import asyncio
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from pavetwin.app.exhibits import REPORT, SHEET, Exhibit, exhibit_kind
from pavetwin.app.frames import FrameRenderer
from pavetwin.app.requests import FramePart
from pavetwin.app.task_pool import KeptProcess, Messages, OnReport, TaskPool
from pavetwin.app.uploads import Uploads
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import staging_folder
from pavetwin.world.folder import DESCRIPTION, check_world

WORLDS: Final = "worlds"
"""The folder here whose worlds are shown where none is named, and that gets those built from maps."""

BY_HAND: Final = ("pilot", "drive")
"""Tasks that take stick positions while they run."""

PILOTS: Final = 2
"""Such tasks at a time; more wait."""

FOLDER: Final = "pavetwin-app"
"""A part of the name of a server's temporary folder. Those of servers that were killed go with the next start."""


@dataclass(frozen=True, slots=True)
class ShownWorld:
    """A world that the page may name."""

    id: str
    folder: Path

    @property
    def name(self) -> str:
        return self.folder.name


@dataclass(frozen=True, slots=True)
class TownFile:
    """A file of a town in 3-D."""

    path: Path
    tag: str | None
    """Another whenever the bytes may be others; None where they differ each time."""


@dataclass(frozen=True, slots=True)
class Played:
    """Missions that the browser can play: their files, and where their results are."""

    folder: Path
    results: Path
    names: tuple[str, ...]
    """Names of the results for download."""
    captures: tuple[int, ...]
    """How many each mission has."""
    policies: tuple[str, ...]
    """Policy of each mission."""
    world: Path
    """Folder of the world."""

    @property
    def made(self) -> Path:
        """The folder of files made from missions on request."""
        return self.folder / "made"

    def mission(self, number: int) -> Path:
        """The folder of one of the missions."""
        return self.results / self.policies[number] if len(self.policies) > 1 else self.results


class Session:
    """The state of a server. The browser names worlds and missions by keys of it, never by paths."""

    def __init__(self, folders: Sequence[Path], place: Path = Path(WORLDS), tasks: TaskPool | None = None) -> None:
        """Args:
            folders: of worlds, studies and datasets.
            place: the folder that gets the worlds built from maps.
            tasks: pool whose processes run the page's tasks; default: a new one.

        Raises:
            PaveTwinError: a folder is none of these.
        """
        kinds = {folder: exhibit_kind(folder) for folder in folders}
        worlds = [folder for folder in folders if kinds[folder] is None]
        for folder in worlds:
            check_world(folder)
        self._worlds = {world.id: world for world in map(_shown, enumerate(worlds))}
        self._exhibits = {
            f"x{number}": Exhibit(f"x{number}", folder.absolute(), kind)
            for number, (folder, kind) in enumerate(kinds.items())
            if kind is not None
        }
        self._held = ExitStack()
        self.folder = self._held.enter_context(staging_folder(Path(tempfile.gettempdir()) / FOLDER))
        self.tasks = tasks or TaskPool()
        self._making: dict[str, asyncio.Task[Mapping[str, Any]]] = {}
        self.uploads = Uploads(self.folder, self.tasks, place)
        self._flights = TaskPool(PILOTS)
        self._renders = KeptProcess()
        self.frames = FrameRenderer(self._renders)
        self._played: dict[str, Played] = {}

    @property
    def worlds(self) -> list[ShownWorld]:
        return list(self._worlds.values())

    @property
    def exhibits(self) -> list[Exhibit]:
        return list(self._exhibits.values())

    def shown_file(self, key: str, name: str) -> Path | None:
        """File of an exhibit; None where there is no such file."""
        file = self.folder / f"exhibit-{key}" / name
        return file if name in (REPORT, SHEET) and file.is_file() else None

    def world(self, key: Any) -> ShownWorld:
        """Raises:
        PaveTwinError: there is none of this key.
        """
        found = self._worlds.get(key) if isinstance(key, str) else None
        if found is None:
            raise PaveTwinError(no_such("town", str(key)[:40], self._worlds, key="`world`"))
        return found

    def played(self, key: str) -> Played | None:
        return self._played.get(key)

    async def map_file(self, key: str) -> Path:
        """The map of a world; made on first request, and again after the world was rebuilt.

        Raises:
            PaveTwinError: there is no such world, or it cannot be read.
        """
        world = self.world(key)
        try:
            changed_ns = (world.folder / DESCRIPTION).stat().st_mtime_ns
        except OSError as error:
            raise PaveTwinError(f"The world '{world.folder}' no longer exists.") from error
        file = self.folder / f"{world.id}-{changed_ns}.json.gz"
        if not file.is_file():
            await self._once(file.name, {"do": "map", "world": str(world.folder), "file": str(file)})
        return file

    async def town_file(self, key: str, name: str) -> TownFile | None:
        """A file of a world's town in 3-D; None where the town has none of that name.

        Raises:
            PaveTwinError: there is no such world, it cannot be read, or it has no street.
        """
        world = self.world(key)
        task = {"do": "town", "world": str(world.folder), "name": name, "folder": str(self.folder / "town")}
        found = await self._renders.run(task, is_patient=True, again=True)  # a page that loads again may end it
        return TownFile(Path(found["path"]), found.get("tag")) if found else None

    async def choices(self) -> Mapping[str, Any]:
        """Choices for a mission: names of policies, sensors, aircraft and traffic, with defaults."""
        return await self._once("choices", {"do": "choices"})

    async def _once(self, name: str, task: Mapping[str, Any]) -> Mapping[str, Any]:
        """Run a task, or wait for the same one that runs already."""
        if (made := self._making.get(name)) is None:
            made = self._making[name] = asyncio.create_task(self._made(name, task))
            made.add_done_callback(lambda done: done.cancelled() or done.exception())  # no one may be waiting
        return await asyncio.shield(made)

    async def _made(self, name: str, task: Mapping[str, Any]) -> Mapping[str, Any]:
        try:
            return await self.tasks.run(task)
        finally:
            del self._making[name]

    async def read_ahead(self) -> None:
        """Prepare the first requests of a browser in advance."""
        with suppress(PaveTwinError):
            await self.choices()
            for world in self.worlds[:1]:
                await self.map_file(world.id)

    async def run(
        self, asked: Mapping[str, Any], on_progress: OnReport, messages: Messages | None = None
    ) -> Mapping[str, Any]:
        """Run a browser's request: `choose` by a mission.yaml, `estimate`, `fly`, `fly_missed`, `play`, list
        the `missions`, `build` a town, `pilot` a flight or `drive` a car by hand, `export` a mission, or `show` a study
        or a dataset.

        Args:
            messages: messages of the page to the running task.

        Raises:
            PaveTwinError: it is none of these, names what is not there, or cannot be done.
        """
        if asked.get("do") == "build":
            return await self._build(asked.get("town"), on_progress)
        if asked.get("do") == "show":
            return await self._show(asked.get("exhibit"), on_progress)
        if asked.get("do") == "choose":
            worlds = {world.id: str(world.folder) for world in self.worlds}
            return await self.tasks.run({"do": "choose", "text": asked.get("text"), "worlds": worlds}, on_progress)
        if asked.get("do") == "export":
            return await self._export(asked, on_progress)
        world = self.world(asked.get("world"))
        task: dict[str, Any] = {"do": asked.get("do"), "world": str(world.folder), "folder": str(self.folder)}
        match task["do"]:
            case "estimate" | "fly" | "pilot" | "drive":
                task["request"] = asked.get("request")
            case "play":
                task["mission"] = asked.get("mission")
            case "fly_missed":
                played, number = self._mission(asked)
                task["mission"] = str(played.mission(number))
            case "missions":
                pass
            case other:
                raise PaveTwinError(f"The page asked for '{str(other)[:40]}', which the server does not support.")

        def on_report(message: Mapping[str, Any]) -> None:
            on_progress({"ready": self._kept(message["ready"], world)} if "ready" in message else message)

        pool = self._flights if task["do"] in BY_HAND else self.tasks
        return self._kept(await pool.run(task, on_report, messages=messages), world)

    async def _export(self, asked: Mapping[str, Any], on_progress: OnReport) -> Mapping[str, Any]:
        played, number = self._mission(asked)
        if not isinstance(what := asked.get("what"), str):
            raise PaveTwinError(f"`what`: '{str(what)[:40]}' is not a file name.")
        places = {"made": played.made, "played": played.folder, "results": played.results, "world": played.world}
        task = {"do": "export", "what": what, "mission": str(played.mission(number)), **_texts(places)}
        return await self.tasks.run(task, on_progress)

    def made_file(self, key: str, name: str) -> Path | None:
        """File made of a mission; None where there is no such file."""
        played = self._played.get(key)
        if played is None or not played.made.is_dir():
            return None
        there = {str(path.relative_to(played.made)): path for path in played.made.rglob("*") if path.is_file()}
        return there.get(name)

    async def _build(self, town: Any, on_progress: OnReport) -> Mapping[str, Any]:
        folder = await self.uploads.build(town, on_progress)
        world = _shown((len(self._worlds), folder))
        self._worlds[world.id] = world
        return {"world": {"id": world.id, "name": world.name}}

    async def _show(self, key: Any, on_progress: OnReport) -> Mapping[str, Any]:
        exhibit = self._exhibits.get(key) if isinstance(key, str) else None
        if exhibit is None:
            raise PaveTwinError(no_such("study or dataset", str(key)[:40], self._exhibits, key="`exhibit`"))
        task = {"do": "show", "exhibit": str(exhibit.folder), "kind": exhibit.kind.value, "folder": str(self.folder)}
        return await self.tasks.run(task, on_progress)

    async def frame(self, page: object, asked: Mapping[str, Any]) -> Mapping[str, Any]:
        """The rendered frame of a capture, see `pavetwin.app.frame_source.shown_frame`.

        Args:
            page: who asks; a later request of it drops this one while it waits.

        Raises:
            PaveTwinError: there is no such mission or capture, or it cannot be rendered.
            asyncio.CancelledError: it was dropped.
        """
        played, mission = self._mission(asked)
        capture = _index("capture", asked.get("capture"), played.captures[mission])
        if (part := asked.get("part")) not in tuple(FramePart):
            raise PaveTwinError(f"`part`: {str(part)[:40]!r} is none of {', '.join(FramePart)}.")
        task = {"folder": str(played.folder), "mission": mission, "capture": capture, "part": part}
        return await self.frames.frame(page, {"do": "frame", **task})

    def _mission(self, asked: Mapping[str, Any]) -> tuple[Played, int]:
        """The missions that `key` names, and which of them `mission` does."""
        key = asked.get("key")
        played = self._played.get(key) if isinstance(key, str) else None
        if played is None:
            raise PaveTwinError("This mission no longer exists; fly it again.")
        return played, _index("mission", asked.get("mission"), len(played.captures))

    def _kept(self, result: Mapping[str, Any], world: ShownWorld) -> Mapping[str, Any]:
        """A result as the browser gets it: what it may fetch of missions is noted here."""
        if "key" not in result:
            return result
        key, results, names = result["key"], Path(result["results"]), tuple(result["names"])
        self._played[key] = Played(
            self.folder / key, results, names, tuple(result["captures"]), tuple(result["policies"]), world.folder
        )
        return {"key": key, "folder": str(results), "files": names}

    async def close(self) -> None:
        """End all tasks and remove what was made for the browser."""
        await asyncio.gather(self.tasks.close(), self._flights.close(), self.frames.close())
        self._held.close()

    @classmethod
    def of(cls, folders: Sequence[Path], tasks: TaskPool | None = None) -> Self:
        """A session of these folders, with the worlds in the folder `worlds` here where no world is named.

        Raises:
            PaveTwinError: a folder is none of these.
        """
        place = Path(WORLDS)
        has_world = any(exhibit_kind(folder) is None for folder in folders)
        here = sorted(place.iterdir()) if not has_world and place.is_dir() else []
        return cls([*folders, *(folder for folder in here if (folder / DESCRIPTION).is_file())], place, tasks)


def _texts(places: Mapping[str, Path]) -> dict[str, str]:
    return {name: str(place) for name, place in places.items()}


def _shown(numbered: tuple[int, Path]) -> ShownWorld:
    number, folder = numbered
    return ShownWorld(f"w{number}", folder.absolute())


def _index(what: str, value: Any, count: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < count:
        raise PaveTwinError(f"`{what}`: {str(value)[:40]!r} is none of 0 … {count - 1}.")
    return value
