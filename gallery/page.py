"""`python -m gallery.page [WORLD]`: images of the page for the documentation, and an animation of its use."""

import argparse
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from benchmarks.browser import Tab, browser, page_server, tab
from PIL import Image

from pavetwin.world.model import World
from pavetwin.world.store import load_world

IMAGES: Final = Path("docs/images")
LARGEST_BYTES: Final = 500_000

SHOWN_PX: Final = (600, 337)
COLOURS: Final = 80
HIGH: Final = "traffic=high&seed=1"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m gallery.page", description=__doc__)
    parser.add_argument("world", type=Path, nargs="?", default=Path("out/demo/town"), help="whose streets are shown")
    parser.add_argument("--street", default="High Street", help="which is flown over")
    parser.add_argument("--only", choices=tuple(PARTS), help="make these alone")
    options = parser.parse_args()
    segments = _segments(load_world(options.world), options.street)
    with browser() as started, page_server(options.world) as (address, _):
        place = f"{address}#world={options.world.name}&{HIGH}"
        for part in [options.only] if options.only else PARTS:
            with tab(started) as shown:
                PARTS[part](shown, place, segments)


def _segments(world: World, street: str) -> list[str]:
    """The two segments of a street that are nearest to the place of take-off."""
    named = [segment for segment in world.segments if segment.street_name == street]
    return [segment.id for segment in sorted(named, key=lambda each: each.polygon.distance(world.base))[:2]]


def _stills(shown: Tab, place: str, segments: Sequence[str]) -> None:
    """The town before a flight; a mission seen from behind the UAV."""
    _open(shown, place)
    _settle(shown)
    _save(shown, "app-start.jpg")
    shown.page.goto("about:blank")
    _open(shown, f"{place}&segments={','.join(segments)}")
    _fly(shown)
    shown.value("(pavetwin.seek(pavetwin.mission.occlusions[0] ?? 60), null)")
    shown.wait("pavetwin.frame?.labels")
    _settle(shown)
    _save(shown, "app.jpg")


def _comparison(shown: Tab, place: str, segments: Sequence[str]) -> None:
    """Two policies over the same traffic at an occlusion, in the dark, without the town in 3-D."""
    _open(shown, f"{place}&against=baseline&segments={','.join(segments)}")
    shown.page.click("#solid")
    shown.page.click("#theme")
    _fly(shown)
    shown.value("(pavetwin.seek(pavetwin.mission.occlusions.at(-1)), null)")
    shown.wait("pavetwin.frame?.labels")
    shown.page.wait_for_timeout(1500)
    _save(shown, "app-compare.jpg")


def _animation(shown: Tab, place: str, segments: Sequence[str]) -> None:
    """Select, fly, scrub, compare; without the town in 3-D, which changes too much from one image to the next."""
    _open(shown, f"{place}&count=2")
    shown.page.click("#solid")
    shown.page.wait_for_timeout(1500)
    frames: list[tuple[Image.Image, int]] = []

    def take(for_ms: int) -> None:
        shown.page.wait_for_timeout(150)
        picture = Image.open(BytesIO(shown.page.screenshot())).convert("RGB")
        frames.append((picture.resize(SHOWN_PX, Image.Resampling.LANCZOS), for_ms))

    take(1200)
    for segment in segments:
        box = shown.page.locator("#map .moving").bounding_box()
        x, y = shown.value(f"pavetwin.screenOf({segment!r})")
        shown.page.mouse.move(box["x"] + x, box["y"] + y)
        take(500)
        shown.page.mouse.click(box["x"] + x, box["y"] + y)
        take(600)
    _estimated(shown)
    take(1800)
    shown.page.hover("#start")
    _fly(shown)
    take(900)
    _scrub(shown, take, 5)
    shown.value("(document.activeElement.blur(), pavetwin.seek(0), null)")
    shown.page.keyboard.press("n")
    shown.wait("pavetwin.frame?.labels")
    take(1600)
    shown.page.click("#compare")
    take(900)
    _fly(shown)
    _scrub(shown, take, 4)
    shown.value("document.activeElement.blur()")
    shown.page.keyboard.press("v")
    take(1800)
    palette = _palette([picture for picture, _ in frames])
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture, _ in frames]
    path = IMAGES / "app.gif"
    durations = [for_ms for _, for_ms in frames]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=False)
    _check(path)


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """Of all images; a colour counts by the root of its pixels, so that curves and marks keep theirs."""
    pixels = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures])
    colours, counts = np.unique(pixels, axis=0, return_counts=True)
    weighted = np.repeat(colours, np.ceil(np.sqrt(counts)).astype(int), axis=0)
    return Image.fromarray(weighted[None]).quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=3)


def _scrub(shown: Tab, take: Callable[[int], None], count: int) -> None:
    """Moments over the middle of the mission."""
    for at in range(count):
        shown.value(f"(pavetwin.seek(pavetwin.mission.duration_s * {0.15 + 0.5 * at / count}), null)")
        take(350)


def _open(shown: Tab, place: str) -> None:
    shown.open(place)
    shown.wait("document.documentElement?.dataset.ready === 'yes'")
    _estimated(shown)


def _estimated(shown: Tab) -> None:
    shown.wait("!document.querySelector('#selection').classList.contains('busy')")


def _fly(shown: Tab) -> None:
    shown.page.click("#start")
    shown.wait("document.querySelector('#start').disabled || pavetwin.mission")
    shown.wait("pavetwin.mission && !document.querySelector('#start').disabled")


def _settle(shown: Tab) -> None:
    shown.wait("pavetwin.town.tiles && !pavetwin.town.stats().pending")
    shown.value("(pavetwin.town.render(), null)")
    shown.page.wait_for_timeout(500)


def _save(shown: Tab, name: str) -> None:
    path = IMAGES / name
    picture = Image.open(BytesIO(shown.page.screenshot())).convert("RGB")
    picture.save(path, quality=88, optimize=True, subsampling=0)
    _check(path)


def _check(path: Path) -> None:
    size = path.stat().st_size
    print(f"{path}: {size / 1000:.0f} kB")
    if size > LARGEST_BYTES:
        raise SystemExit(f"{path} has {size / 1000:.0f} kB; pictures of the documentation have at most 500.")


PARTS: Final = {"stills": _stills, "comparison": _comparison, "animation": _animation}


if __name__ == "__main__":
    main()
