"""Maps that pages send: announced, received, built in a separate process, and removed.

A page announces a map over its WebSocket, gets a key, and sends the map to that key over HTTP. All of it is one task of
the page: where that ends, by its result, an error, cancelling or the page's end, nothing of the map is left.
"""

import asyncio
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final

from pavetwin.app.requests import TownRequest
from pavetwin.app.task_pool import OnReport, TaskPool
from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable, writing_folder
from pavetwin.world.folder import check_target

AT_ONCE: Final = 2
"""Maps that are on their way or being built."""

SENDING_S: Final = 900.0
BUILDING_S: Final = 1200.0
"""Longest times, by the clock."""

_PROGRESS_BYTES: Final = 1 << 20


class Upload:
    """A map on its way into a file, up to its announced size."""

    def __init__(self, path: Path, size: int, on_progress: OnReport) -> None:
        """Raises:
        PaveTwinError: the file cannot be made.
        """
        self.size = size
        self._on_progress = on_progress
        self._taken = self._reported = 0
        try:
            self._file: BinaryIO | None = path.open("wb")
        except OSError as error:
            raise unwritable(Path("the map"), error) from error
        self._is_begun = False
        self.arrived: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def begin(self, size: int) -> None:
        """Raises:
        PaveTwinError: another request sends it already, or it is not as large as announced.
        """
        if self._is_begun or size != self.size:
            raise PaveTwinError("This map is already being sent, or differs from the announced one.")
        self._is_begun = True

    def take(self, block: bytes) -> None:
        """Raises:
        PaveTwinError: its task has ended, or the disk is full.
        """
        if self._file is None:
            raise PaveTwinError("The upload of this map has ended.")
        try:
            self._file.write(block)
        except OSError as error:
            self.fail(str(unwritable(Path("the map"), error)))
            raise PaveTwinError("The map cannot be kept.") from error
        self._taken += len(block)
        if self._taken - self._reported >= _PROGRESS_BYTES:
            self._reported = self._taken
            self._on_progress({"share": round(self._taken / self.size, 3), "what": "Sending the map"})

    def end(self) -> None:
        """All of it has been taken."""
        self.close()
        if not self.arrived.done():
            self.arrived.set_result(None)

    def fail(self, words: str = "The map did not arrive whole; send it again.") -> None:
        self.close()
        if not self.arrived.done():
            self.arrived.set_exception(PaveTwinError(words))

    def close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError as error:  # what was written last does not fit
                if not self.arrived.done():
                    self.arrived.set_exception(unwritable(Path("the map"), error))


class Uploads:
    """The maps of all pages."""

    def __init__(self, folder: Path, tasks: TaskPool, place: Path) -> None:
        """Args:
        folder: for maps on their way, and for what is built of them.
        place: the folder that new worlds are written to.
        """
        self._folder, self._tasks, self._place = folder, tasks, place
        self._expected: dict[str, Upload] = {}
        self._count = 0

    def begin(self, key: str, size: int) -> Upload:
        """The upload that a page announced.

        Raises:
            PaveTwinError: there is none of this key, or it is not to be sent now.
        """
        upload = self._expected.get(key)
        if upload is None:
            raise PaveTwinError("No map is expected under this address; announce it first.")
        upload.begin(size)
        return upload

    async def build(self, values: Any, on_progress: OnReport) -> Path:
        """The folder of a requested town, once its map has arrived and the town is built.

        Args:
            on_progress: called with the key as `{"ready": {"upload": key}}`, then progress.

        Raises:
            PaveTwinError: the request or the map does not fit, or no town comes of it.
        """
        request = TownRequest.of(values)
        target = (self._place / request.name).absolute()
        _check_free(target)
        with self._room() as folder:
            source, made = folder / f"{request.name}{request.kind}", folder / "built" / request.name
            await self._receive(Upload(source, request.bytes, on_progress), on_progress)
            options = {"left_hand": request.left_hand, "parking_rule": request.parking_rule}
            task = {"do": "build", "source": str(source), "folder": str(made), "options": options}
            try:
                async with asyncio.timeout(BUILDING_S):
                    await self._tasks.run(task, on_progress, is_alone=True)
            except TimeoutError as error:
                raise PaveTwinError(
                    f"Building it takes longer than {BUILDING_S / 60:.0f} minutes; cut out a smaller area."
                ) from error
            _check_free(target)
            with writing_folder(target) as place:
                shutil.copytree(made, place, dirs_exist_ok=True)
        return target

    @contextmanager
    def _room(self) -> Iterator[Path]:
        """A temporary folder for one map."""
        if self._count >= AT_ONCE:
            raise PaveTwinError("Other maps are being built; wait for one of them to end.")
        try:
            folder = Path(tempfile.mkdtemp(prefix="map-", dir=self._folder))
        except OSError as error:
            raise unwritable(Path("the map"), error) from error
        self._count += 1
        try:
            yield folder
        finally:
            self._count -= 1
            shutil.rmtree(folder, ignore_errors=True)

    async def _receive(self, upload: Upload, on_progress: OnReport) -> None:
        key = secrets.token_urlsafe(16)
        self._expected[key] = upload
        try:
            on_progress({"ready": {"upload": key}})
            async with asyncio.timeout(SENDING_S):
                await upload.arrived
        except TimeoutError as error:
            raise PaveTwinError(f"The map did not arrive within {SENDING_S / 60:.0f} minutes.") from error
        finally:
            del self._expected[key]
            upload.close()


def _check_free(target: Path) -> None:
    if target.exists():
        raise PaveTwinError(f"There is a town '{target.name}' already; choose another name.")
    check_target(target)
