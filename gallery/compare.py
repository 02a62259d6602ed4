"""`python -m gallery.compare PHOTOGRAPHS`: how frames of the twin differ from photographs, in numbers.

Frames are crops of a drone's camera at its own resolution, taken in flight along streets and stored as the photographs
were. Of every picture: mean lightness and its spread, chroma, and how much detail there is at one, four and sixteen
pixels (standard deviation of the difference between two Gaussian blurs, in lightness). Each is given as the median and
the middle 80 % over the pictures. Then how well a classifier on texture statistics (`gallery.texture`) tells the two
apart.

Once more by ground resolution: of the photographs in which the width of a painted line tells it
(`pavetwin.training.datasets.markings`) and as many frames, each of the resolution of one photograph, over damage of the same
kind, with a line too.
"""

import argparse
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from gallery.frame_matcher import FrameMatcher
from gallery.matched import (
    Pair,
    Photograph,
    flight_view,
    is_padded,
    metres,
    photographs,
    pictures_in,
    stored,
)
from gallery.paired import paired_sheet
from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer
from gallery.scenes import scenes_of
from gallery.sheet import save
from gallery.texture import GROUPS, SIDE_PX, texture_statistics, told_apart
from pavetwin.capture.daylight import draw_compensation_ev
from pavetwin.cli.console import fail, out
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.markings import LINE_WIDTH_M
from pavetwin.training.datasets.sources.base import source_of

FRAMES: Final = 120
PHOTOGRAPHS: Final = 240
GSD_M: Final = (0.003, 0.017)
"""Range of the frames' ground resolutions, even in their logarithm: by their markings, that of the China drone subset
of RDD2022. A Phantom 4 Pro has 3 mm a pixel from 11 m, and 17 mm from 62 m."""
BORDERS_M: Final = (0.0, 0.006, 0.012, math.inf)
"""Between ground resolutions that are compared by themselves."""
FEWEST: Final = 20
"""Pairs that a comparison needs."""
MOST: Final = 36
"""Pairs that a comparison has."""
SCALES_PX: Final = (1.0, 4.0, 16.0)
READINGS: Final = ("lightness L*", "spread of L*", "chroma", *(f"detail at {scale:g} px" for scale in SCALES_PX))

Float = npt.NDArray[np.float64]


def readings(picture: Image.Image) -> Float:
    """Mean L*, its standard deviation, mean chroma, and the detail at `SCALES_PX`, of one picture."""
    lab = np.asarray(picture.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS).convert("LAB"), dtype=np.float64)
    lightness = lab[..., 0] * 100 / 255
    # Pillow stores a* and b* as signed bytes.
    chroma = np.hypot(*(((lab[..., band] + 128) % 256) - 128 for band in (1, 2)))
    detail = [_band(lightness, scale) for scale in SCALES_PX]
    return np.array([lightness.mean(), lightness.std(), chroma.mean(), *detail])


def _band(lightness: Float, scale_px: float) -> float:
    image = Image.fromarray(lightness.astype(np.float32) * 2.55).convert("L")
    fine, coarse = (
        np.asarray(image.filter(ImageFilter.GaussianBlur(scale)), dtype=np.float64)
        for scale in (scale_px / 2, scale_px)
    )
    return float((fine - coarse).std() / 2.55)


def frames(renderer: GalleryRenderer) -> Iterable[Image.Image]:
    """Frames of empty streets over evenly chosen defects, at even steps of ground resolution, under three skies,
    exposed as datasets are."""
    defects = renderer.world.defects[:: max(1, len(renderer.world.defects) // FRAMES)][:FRAMES]
    finest, coarsest = GSD_M
    for index, defect in enumerate(defects):
        gsd_m = finest * (coarsest / finest) ** (index * 0.618034 % 1)
        view = flight_view(renderer, defect, (defect.centre.x, defect.centre.y), gsd_m, index, SIDE_PX)
        light = (MORNING, LOW_SUN, OVERCAST)[index % 3]
        stops = draw_compensation_ev(np.random.default_rng([20, index]))
        yield stored(Image.fromarray(renderer.take(view, light, compensation_ev=stops)))


def main() -> int:
    """Print both sides' readings beside each other."""
    parser = argparse.ArgumentParser(prog="python -m gallery.compare", description=__doc__)
    parser.add_argument("photographs", type=Path, help="folder of photographs of roads from above")
    parser.add_argument("--work", type=Path, default=Path("out/gallery"), help="folder of the town")
    parser.add_argument("--held-out", action="store_true", help="use every second photograph only, by name")
    parser.add_argument("--source", help="how the photographs' labels are read: a source of `pavetwin data import`")
    parser.add_argument("--gsd-mm", type=float, help="of all photographs; told by painted lines unless given")
    parser.add_argument("--line-width-m", type=float, default=LINE_WIDTH_M, help="width of painted lines in them")
    parser.add_argument("--markings", help="marking standard of the frames' streets, such as china")
    parser.add_argument("--sheet", type=Path, help="a picture to write: photographs, with frames to their right")
    parser.add_argument("--keep", type=Path, help="folder to keep the frames in")
    options = parser.parse_args()
    found = pictures_in(options.photographs)
    if not found:
        fail(f"'{options.photographs}' holds no JPEG or PNG.")
        return 2
    found = found[1::2] if options.held_out else found
    try:
        source = None if options.source is None else source_of(options.source)[1]
        renderer = GalleryRenderer.with_markings(options.work, options.markings)
        some = found[:: max(1, math.ceil(len(found) / PHOTOGRAPHS))]
        paths = [path for path in some if not is_padded(Image.open(path).convert("RGB"))]
        pictures = [Image.open(path).convert("RGB") for path in paths]
        made = list(frames(renderer))
        out.print(f"{len(pictures)} photographs, {len(made)} frames: median (10 % … 90 %)")
        _compare(pictures, made, scenes_of(paths))
        known = photographs(
            options.photographs, found, source=source, gsd_m=metres(options.gsd_mm), line_m=options.line_width_m
        )
        pairs = FrameMatcher(renderer).pairs(_some_of_each(known))
        _compare_by_resolution(pairs)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        for index, frame in enumerate((*made, *(frame for _, frame in pairs))):
            frame.save(options.keep / f"{index:03}.png")
    if options.sheet:
        save(paired_sheet(pairs, source), options.sheet)
    return 0


def _some_of_each(known: Iterable[Photograph]) -> Iterator[Photograph]:
    """At most `MOST` photographs of each range of ground resolutions, evenly chosen, in order of their names."""
    every = list(known)
    for finest, coarsest in pairwise(BORDERS_M):
        of = [each for each in every if finest <= each.gsd_m < coarsest]
        yield from (of[index * len(of) // MOST] for index in range(MOST)) if len(of) > MOST else of


def _compare_by_resolution(pairs: Sequence[Pair]) -> None:
    for finest, coarsest in pairwise(BORDERS_M):
        of = [pair for pair in pairs if finest <= pair[0].gsd_m < coarsest]
        if len(of) < FEWEST:
            continue
        low, high = (1000 * pick(photograph.gsd_m for photograph, _ in of) for pick in (min, max))
        out.print(f"\n{low:.1f} to {high:.1f} mm a pixel, {len(of)} pairs: median (10 % … 90 %)")
        scenes = scenes_of([photograph.path for photograph, _ in of])
        _compare([photograph.picture for photograph, _ in of], [frame for _, frame in of], scenes)


def _compare(pictures: Sequence[Image.Image], made: Sequence[Image.Image], scenes: Sequence[int]) -> None:
    """Print the readings of photographs, each of a scene, and of frames, and how well they are told apart."""
    real, ours = (np.array([readings(each) for each in side]) for side in (pictures, made))
    for index, name in enumerate(READINGS):
        low, middle, high = np.quantile(real[:, index], (0.1, 0.5, 0.9))
        low_o, middle_o, high_o = np.quantile(ours[:, index], (0.1, 0.5, 0.9))
        out.print(
            f"{name:16} photographs {middle:5.1f} ({low:5.1f} … {high:5.1f})   "
            f"frames {middle_o:5.1f} ({low_o:5.1f} … {high_o:5.1f})"
        )
    real, ours = (np.array([texture_statistics(each) for each in side]) for side in (pictures, made))
    out.print(f"told apart by texture: AUC (95 %); photographs of {len(set(scenes))} scenes")
    for name, part in GROUPS.items():
        auc, low, high = told_apart(ours[:, part], real[:, part], scenes=scenes)
        out.print(f"{name:32} {auc:.3f} ({low:.3f} … {high:.3f})")


if __name__ == "__main__":
    sys.exit(main())
