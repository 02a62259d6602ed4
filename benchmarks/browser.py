"""`pavetwin app` as a user starts it, and a headless Chromium that has its page open and draws without a GPU."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from pavetwin.errors import PaveTwinError

PROGRAMS: Final = ("chromium", "chromium-browser", "google-chrome")

SOFTWARE: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Chromium's own software renderer, whatever the machine has."""

HARDWARE: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=vulkan", "--enable-features=Vulkan")
"""A graphics processor, where the machine has one."""

PATIENCE_S: Final = 600.0
SIZE_PX: Final = (1366, 768)


def chromium() -> str | None:
    """The browser's program; None where it or Playwright is not installed."""
    if find_spec("playwright") is None:
        return None
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Tab:
    """The page in a browser."""

    def __init__(self, page: Any) -> None:
        self.page = page

    def value(self, expression: str) -> Any:
        """Of an expression; a promise's when it is settled."""
        return self.page.evaluate(expression)

    def wait(self, condition: str) -> float:
        """Until a condition is true, as often as the page can look.

        Returns:
            Seconds since the page was asked for.

        Raises:
            PaveTwinError: it was not true in ten minutes.
        """
        looked = f"""(async () => {{
            const last = performance.now() + {1000 * PATIENCE_S};
            while (!({condition})) {{
                if (performance.now() > last) return -1;
                await new Promise(next => setTimeout(next, 5));
            }}
            return performance.now() / 1000;
        }})()"""
        passed_s = float(self.value(looked))
        if passed_s < 0:
            raise PaveTwinError(f"the page was to be measured, and this never was true: {condition}")
        return passed_s

    def open(self, address: str) -> None:
        self.page.goto(address, timeout=1000 * PATIENCE_S, wait_until="commit")


@contextmanager
def browser(options: Sequence[str] = SOFTWARE) -> Iterator[Any]:
    """A running browser; tabs come from `tab`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=chromium(), args=list(options))
        try:
            yield started
        finally:
            started.close()


@contextmanager
def tab(started: Any, size_px: tuple[int, int] = SIZE_PX, **options: Any) -> Iterator[Tab]:
    """A tab that shares neither cookies nor cache with another; `options` are those of the browser's context."""
    wide, tall = size_px
    context = started.new_context(viewport={"width": wide, "height": tall}, **options)
    try:
        context.set_default_timeout(1000 * PATIENCE_S)
        yield Tab(context.new_page())
    finally:
        context.close()


@contextmanager
def page_server(world: Path) -> Iterator[tuple[str, float]]:
    """`pavetwin app` with a world: its address, and when the command was given (`time.perf_counter`).

    Raises:
        PaveTwinError: it ended without an address.
    """
    words = [sys.executable, "-c", "from pavetwin.cli import main; main()", "app", str(world)]
    begun = time.perf_counter()
    process = subprocess.Popen(
        [*words, "--port", "0", "--no-browser"], stdout=subprocess.PIPE, env={**os.environ, "COLUMNS": "200"}, text=True
    )
    try:
        assert process.stdout is not None
        said = ""
        while not (found := re.search(r"http://\S+?token=[\w-]+", said)):
            line = process.stdout.readline()
            if not line:
                raise PaveTwinError(f"`pavetwin app` ended and printed no address: {said.strip()[-200:]}")
            said += line
        yield found.group(), begun
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
