"""A first visit to the page by somebody who has read nothing: from the command to an answer about one street.

The visitor reads what the page says, at the speed at which people read, does what it says, and types and aims as people
do. Nobody has recorded traffic of the town before.
"""

import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.browser import Tab, page_server, tab
from pavetwin.world.store import load_world

WORDS_A_MINUTE: Final = 238
"""Silent reading of English prose by adults, mean: Brysbaert (2019), Journal of Memory and Language 109."""

KEY_S: Final = 0.28
"""A key of an average typist who does not look for it: operator K of the keystroke-level model, Card, Moran and Newell
(1980), Communications of the ACM 23 (7)."""

AIM_S: Final = 1.3
"""A pointer moved to a target, and the button: operators P and K of that model."""

VISITOR: Final = "Object.defineProperty(Navigator.prototype, 'webdriver', { get: () => false });"
"""A browser that no program drives, so that the page shows its visitor around."""


class Visitor:
    """What somebody does in the page, and how long they took for it themselves."""

    def __init__(self, shown: Tab) -> None:
        self._shown, self.own_s = shown, 0.0

    def read(self, place: str) -> str:
        """The text of a part of the page, read to its end."""
        text: str = self._shown.page.locator(place).inner_text()
        self._take(60 * len(text.split()) / WORDS_A_MINUTE)
        return text

    def click(self, place: str) -> None:
        self._take(AIM_S)
        self._shown.page.click(place)

    def type(self, place: str, text: str) -> None:
        self.click(place)
        self._take(KEY_S * (len(text) + 1))
        self._shown.page.fill(place, text)
        self._shown.page.keyboard.press("Enter")

    def _take(self, seconds: float) -> None:
        self.own_s += seconds
        self._shown.page.wait_for_timeout(1000 * seconds)


@dataclass(frozen=True)
class Visit:
    """A first visit, from the command to the answer."""

    taken_s: float
    own_s: float
    """Of that, what the visitor took to read, type and aim."""
    street: str
    answer: str


def first_visit(started: Any, town: Path, folder: Path) -> Visit:
    """Ask the page about the longest street.

    Args:
        started: a browser.
        town: a world, of which a copy without traffic and missions is visited.
        folder: for that copy.
    """
    ignored = shutil.ignore_patterns("missions", "traffic")
    world = Path(shutil.copytree(town, folder / "visited" / town.name, ignore=ignored))
    street = max(load_world(world).segments, key=lambda segment: segment.length_m).street_name
    with tab(started) as shown, page_server(world) as (address, begun):
        shown.page.add_init_script(VISITOR)
        shown.open(address)
        shown.wait("document.documentElement?.dataset.ready === 'yes'")
        visitor = Visitor(shown)
        while shown.value("!document.querySelector('#tour').hidden"):
            visitor.read("#tour")
            visitor.click("#tour .main")
        visitor.type("#find", street)
        shown.wait("!document.querySelector('#selection').classList.contains('busy')")
        visitor.read("#selection")
        visitor.click("#start")
        shown.wait("document.querySelector('#table .sentence')")
        answer = visitor.read("#table .sentence")
        return Visit(time.perf_counter() - begun, visitor.own_s, street, answer)
