"""`python -m gallery.page_states WORLD FOLDER`: pictures of every panel and state of the page, to be looked at.

Each state comes after the one before it in the same tab, in three sizes, light and dark:
 FOLDER/laptop-light/02-chosen.png
and so on.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

from benchmarks.browser import Tab, browser, page_server, tab
from benchmarks.visitor import VISITOR

SIZES_PX: Final = {"laptop": (1366, 768), "desktop": (1920, 1080), "tablet": (820, 1180)}
THEMES: Final = ("light", "dark")
MISSION: Final = "traffic=high&seed=1"

Come = Callable[[Tab], None]
"""Brings the page into a state."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m gallery.page_states", description=__doc__)
    parser.add_argument("world", type=Path, help="which is shown; it gets missions")
    parser.add_argument("folder", type=Path, help="for the pictures")
    parser.add_argument("--size", choices=tuple(SIZES_PX), nargs="*", default=list(SIZES_PX))
    parser.add_argument("--theme", choices=THEMES, nargs="*", default=list(THEMES))
    parser.add_argument("--without-town", action="store_true", help="leave the town in 3-D out, which is quicker")
    options = parser.parse_args()
    with browser() as started, page_server(options.world) as (address, _):
        for size in options.size:
            for theme in options.theme:
                with tab(started, SIZES_PX[size], color_scheme=theme) as shown:
                    place = f"{address}#world={options.world.name}&{MISSION}"
                    _take(shown, place, options.folder / f"{size}-{theme}", has_town=not options.without_town)


def _take(shown: Tab, place: str, folder: Path, *, has_town: bool) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    shown.page.add_init_script(VISITOR)
    if not has_town:
        shown.page.add_init_script("localStorage.setItem('pavetwin-3d', 'no')")
    shown.open(place)
    shown.wait("document.documentElement?.dataset.ready === 'yes'")
    for number, (name, come) in enumerate(STATES.items()):
        if has_town or name not in OF_TOWN:
            come(shown)
            _settle(shown)
            path = folder / f"{number:02}-{name.replace(' ', '-')}.png"
            shown.page.screenshot(path=path)
            print(path)


def _settle(shown: Tab) -> None:
    """Until all tiles in view are there, and what follows a frame."""
    shown.wait("!window.pavetwin?.town?.tiles || !pavetwin.town.stats().pending")
    shown.value("(pavetwin.town?.render(), null)")
    shown.page.wait_for_timeout(700)


def _click(place: str) -> Come:
    return lambda shown: shown.page.click(place)


def _press(*keys: str) -> Come:
    def press(shown: Tab) -> None:
        shown.value("(document.activeElement.blur(), null)")
        for key in keys:
            shown.page.keyboard.press(key)

    return press


def _tour(shown: Tab) -> None:
    """Its last step, each step before having been gone through."""
    for _ in range(4):
        shown.page.click("#tour .main")


def _choose(shown: Tab) -> None:
    shown.page.click("#tour .main")
    names = shown.value("[...document.querySelectorAll('#streets option')].map(each => each.value)")
    shown.page.fill("#find", names[len(names) // 2])
    shown.page.keyboard.press("Enter")
    shown.wait("!document.querySelector('#selection').classList.contains('busy')")


def _fly(shown: Tab) -> None:
    _press("Escape")(shown)  # so that several segments are drawn
    shown.page.fill("#count", "5")
    shown.page.keyboard.press("Tab")
    shown.wait("!document.querySelector('#selection').classList.contains('busy')")
    _start(shown)


def _start(shown: Tab) -> None:
    shown.page.click("#start")
    shown.wait("document.querySelector('#start').disabled || pavetwin.mission")
    shown.wait("pavetwin.mission && !document.querySelector('#start').disabled")
    shown.page.wait_for_timeout(4000)  # a notice that tells something goes by itself


def _occlusion(shown: Tab) -> None:
    _press("n")(shown)
    shown.wait("pavetwin.frame?.labels || document.querySelector('#shown').textContent.includes('sun')")


def _search(shown: Tab) -> None:
    shown.page.check("#camera [name=search]")
    shown.wait("pavetwin.frame?.searched || /pip install|detector:/.test(document.querySelector('#shown').textContent)")


def _defect(shown: Tab) -> None:
    shown.page.uncheck("#camera [name=search]")
    shown.page.click("#defects .list button >> nth=1")
    shown.wait("document.querySelector('#defects .seen-by .told')?.textContent !== 'Frames are being rendered …'")


def _too_many(shown: Tab) -> None:
    _press("Escape")(shown)
    shown.page.fill("#count", "2000")
    shown.page.keyboard.press("Tab")
    shown.wait("document.querySelector('#selection .bad')")


def _compare(shown: Tab) -> None:
    shown.page.fill("#count", "2")
    shown.page.keyboard.press("Tab")
    shown.page.click("#compare")
    shown.wait("!document.querySelector('#selection').classList.contains('busy')")
    _start(shown)
    _press("n")(shown)
    shown.wait("pavetwin.frame")


def _take_control(key: str) -> Come:
    def take(shown: Tab) -> None:
        shown.page.fill("#count", "2")
        shown.page.keyboard.press("Tab")
        shown.wait("!document.querySelector('#selection').classList.contains('busy')")
        _press(key)(shown)
        shown.wait("pavetwin.mission?.isLive && pavetwin.time > 0.5")
        shown.wait("!['take_off', 'ground'].includes(pavetwin.stateAt(pavetwin.time).mode.name)")
        shown.page.keyboard.down("w")
        shown.page.wait_for_timeout(6000)
        shown.page.keyboard.up("w")

    return take


def _give_up(shown: Tab) -> None:
    shown.page.click("#pilot button:text-is('Give up')")
    shown.wait("!document.querySelector('#start').disabled")


STATES: Final[dict[str, Come]] = {
    "tour, its first step": lambda _: None,
    "tour, its last step": _tour,
    "chosen": _choose,
    "keys": _press("?"),
    "new town": _press("Escape", "m"),
    "nothing chosen": _press("Escape", "Escape"),
    "layers of the map": _click("#layers summary"),
    "more settings": _click("#more summary"),
    "flown before": _click("#flown summary"),
    "flown": _fly,
    "an occlusion": _occlusion,
    "searched by the detector": _search,
    "defects": _click("#tab-defects"),
    "a defect": _defect,
    "files": _click("#tab-files"),
    "UAV's eye": _press("3"),
    "car's eye": _press("4"),
    "orbit": _press("1"),
    "layers of the town": _click("#town .menu summary"),
    "compared": _compare,
    "the other policy, table": lambda shown: (_press("v")(shown), shown.page.click("#tab-table"))[0],
    "an error": _too_many,
    "flown by hand": _take_control("u"),
    "given up": _give_up,
    "driven by hand": _take_control("r"),
    "given up again": _give_up,
}
"""One after the other in one tab."""

OF_TOWN: Final = ("UAV's eye", "car's eye", "orbit", "layers of the town")


if __name__ == "__main__":
    main()
