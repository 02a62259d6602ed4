"""The page in Chromium, with what goes wrong in it."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from scenes.page import RunningPage

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 120

NO_WEBGL = ("--disable-3d-apis",)
"""All but the town in 3-D works, and nothing waits for its pictures."""

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""WebGL without a GPU."""


Launch = Callable[..., Any]
"""Starts a browser with options."""


@contextmanager
def chromium() -> Iterator[Launch]:
    """Chromium, to be started as often as wanted; tests are skipped where it is not installed."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make setup)")
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(PROGRAMS)}")
    with playwright.sync_playwright() as driver:
        yield lambda *options: driver.chromium.launch(executable_path=program, args=["--no-sandbox", *options])


@dataclass
class BrowserTab:
    """A tab with the page, and what went wrong in it."""

    page: Any
    server: RunningPage
    errors: list[str] = field(default_factory=list)
    hosts: set[str] = field(default_factory=set)

    def value(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def wait(self, expression: str) -> None:
        """Until an expression is true. The page's policy forbids what Playwright's own waiting evaluates."""
        for _ in range(PATIENCE_S * 10):
            if self.value(f"Boolean({expression})"):
                return
            self.page.wait_for_timeout(100)
        raise AssertionError(f"never: {expression}")

    def open(self, address: str = "") -> None:
        place = f"http://127.0.0.1:{self.server.port}/?token={self.server.guard.token}{address}"
        self.page.goto(place, timeout=1000 * PATIENCE_S)

    def ready(self) -> None:
        self.page.wait_for_selector("html[data-ready=yes]", timeout=1000 * PATIENCE_S)

    def click_street(self, segment: str) -> None:
        box = self.page.locator("#map .moving").bounding_box()
        x, y = self.value(f"pavetwin.screenOf('{segment}')")
        self.page.mouse.click(box["x"] + x, box["y"] + y)

    def fly(self) -> None:
        self.page.click("#start")
        self.wait("pavetwin.mission && !document.querySelector('#start').disabled")

    def picture(self, selector: str) -> np.ndarray:
        with Image.open(BytesIO(self.page.locator(selector).screenshot())) as image:
            return np.asarray(image.convert("RGB"), dtype=np.float64)


def tab_of(browser: Any, server: RunningPage, **options: Any) -> BrowserTab:
    """Args:
    options: of the browser's page; 1366 × 768 unless another `viewport` is given.
    """
    tab = BrowserTab(browser.new_page(**{"viewport": {"width": 1366, "height": 768}, **options}), server)
    tab.page.on("console", lambda message: tab.errors.append(message.text) if message.type == "error" else None)
    tab.page.on("pageerror", lambda error: tab.errors.append(str(error)))
    tab.page.on("request", lambda request: tab.hosts.add(urlsplit(request.url).netloc))
    return tab
