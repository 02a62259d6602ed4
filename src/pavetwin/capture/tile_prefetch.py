"""A process that prefetches tiles: it makes those of images that are taken next, so that the cache has them then."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final, Self

from pavetwin.plugins import load_plugins
from pavetwin.render.nearby import make_missing
from pavetwin.scene.light import Light
from pavetwin.scene.scene import LOOK_SEED, Scene
from pavetwin.scene.view import View
from pavetwin.workers import OnTick, WaitingProcess
from pavetwin.world.store import load_world

LitView = tuple[View, Light]


class TilePrefetcher:
    """Begins with what all tiles of a world need, and ends with the `with` block, wherever it has got to.

    Nothing depends on it: what it has not made, and what it fails to make, is made by who needs it.
    """

    def __init__(self, world: Path, look: str, plugins: Sequence[str] = ()) -> None:
        """Args:
        world: its folder, with its defects.
        look: of its streets: a name, or a YAML file.
        plugins: modules that the world or the look need.
        """
        self._process = WaitingProcess(ahead=partial(_begin, world, look, tuple(plugins)))
        # The process reads when it has begun, and a pipe holds little: nobody else waits for that.
        self._sender = ThreadPoolExecutor(1)
        self._sender.submit(self._send, _start)

    def make(self, views: Sequence[LitView]) -> None:
        """Make what some frames need, in this order, after those that were asked for before."""
        self._sender.submit(self._send, views)

    def _send(self, message: object) -> None:
        with suppress(OSError):  # it has died, or been stopped
            self._process.connection.send(message)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.stop()
        self._sender.shutdown(cancel_futures=True)
        self._process.connection.close()


_SCENE: Final[list[Scene]] = []
"""In the process: the scene, once there is one."""


def _begin(world: Path, look: str, plugins: Sequence[str]) -> None:
    load_plugins(plugins)
    _SCENE[:] = [Scene(load_world(world), seed=LOOK_SEED, look=look)]
    _SCENE[0].make_plan(ahead=True)


def _start(on_tick: OnTick) -> Callable[[Sequence[LitView]], None]:  # noqa: ARG001 - nobody watches
    return _make


def _make(views: Sequence[LitView]) -> None:
    for view, light in views if _SCENE else ():
        with suppress(Exception):  # who takes the image meets it too, and tells it
            make_missing(_SCENE[0], view, light)
