"""`python -m gallery.compare PHOTOGRAPHS`: how frames of the twin differ from photographs, in numbers.

Both are 512 × 512 pixels and stored as JPEG; frames have the ground resolutions that drones' photographs of roads have.
Of every picture: mean lightness and its spread, chroma, and how much detail there is at one, four and sixteen pixels
(standard deviation of the difference between two Gaussian blurs, in lightness). Each is given as the median and the
middle 80 % over the pictures. Then how well a classifier on texture statistics (`gallery.texture`) tells them apart.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterable
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer, Picture
from gallery.sheet import grid, save
from gallery.texture import GROUPS, SIDE_PX, texture_statistics, told_apart
from pavetwin.cli.console import fail, out
from pavetwin.scene.view import look

FRAMES: Final = 120
PHOTOGRAPHS: Final = 240
ALTITUDE_M: Final = 10.0
GSD_M: Final = (0.002, 0.008)
"""Range of the frames' ground resolutions, even in their logarithm: a Phantom 4 Pro has 1.6 mm a pixel from 6 m and
8 mm from 30 m."""
SHOWN: Final = 24
CELL_PX: Final = (240, 240)
BLANK: Final = 0.01
"""Photographs with more of pure black than this were padded."""
SCALES_PX: Final = (1.0, 4.0, 16.0)

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


def frames(renderer: GalleryRenderer, take: Callable[..., Picture]) -> Iterable[Image.Image]:
    """Frames of empty streets over evenly chosen defects, at even steps of ground resolution, under three skies."""
    defects = renderer.world.defects[:: max(1, len(renderer.world.defects) // FRAMES)][:FRAMES]
    finest, coarsest = GSD_M
    for index, defect in enumerate(defects):
        gsd_m = finest * (coarsest / finest) ** (index * 0.618034 % 1)
        view = look(
            (defect.centre.x, defect.centre.y, ALTITUDE_M),
            yaw_rad=0.7 * index,
            pitch_rad=-math.pi / 2,
            size_px=(SIDE_PX, SIDE_PX),
            vertical_fov_rad=2 * math.atan(SIDE_PX * gsd_m / 2 / ALTITUDE_M),
        )
        stored = BytesIO()
        Image.fromarray(take(view, (MORNING, LOW_SUN, OVERCAST)[index % 3])).save(stored, "JPEG", quality=92)
        yield Image.open(stored).convert("RGB")


def photographs(found: list[Path]) -> Iterable[Image.Image]:
    """At most `PHOTOGRAPHS`, evenly chosen."""
    for path in found[:: max(1, math.ceil(len(found) / PHOTOGRAPHS))]:
        picture = Image.open(path).convert("RGB")
        if float((np.asarray(picture).max(axis=2) < 4).mean()) < BLANK:
            yield picture


def main() -> int:
    """Print both sides' readings beside each other."""
    parser = argparse.ArgumentParser(prog="python -m gallery.compare", description=__doc__)
    parser.add_argument("photographs", type=Path, help="folder of photographs of roads from above")
    parser.add_argument("--work", type=Path, default=Path("out/gallery"), help="folder of the town")
    parser.add_argument("--held-out", action="store_true", help="use every second photograph only, by name")
    parser.add_argument("--sheet", type=Path, help="a picture to write: photographs on the left, frames on the right")
    parser.add_argument("--keep", type=Path, help="folder to keep the frames in")
    options = parser.parse_args()
    found = sorted(path for path in options.photographs.rglob("*") if path.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not found:
        fail(f"'{options.photographs}' holds no JPEG or PNG.")
        return 2
    pictures = list(photographs(found[1::2] if options.held_out else found))
    renderer = GalleryRenderer(options.work)
    made = list(frames(renderer, renderer.take))
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        for index, frame in enumerate(made):
            frame.save(options.keep / f"{index:03}.png")
    if options.sheet:
        save(_sheet(pictures, made), options.sheet)
    _print_readings(np.array([readings(each) for each in pictures]), np.array([readings(each) for each in made]))
    ours, real = (np.array([texture_statistics(each) for each in side]) for side in (made, pictures))
    out.print("\ntold apart by texture: AUC (95 %)")
    for name, part in GROUPS.items():
        auc, low, high = told_apart(ours[:, part], real[:, part])
        out.print(f"{name:32} {auc:.3f} ({low:.3f} … {high:.3f})")
    return 0


def _sheet(pictures: list[Image.Image], made: list[Image.Image]) -> Picture:
    """`SHOWN` of each side, evenly chosen."""
    halves = []
    for side in (pictures, made):
        shown = side[:: max(1, len(side) // SHOWN)][:SHOWN]
        halves.append(grid([np.asarray(each.resize(CELL_PX)) for each in shown], columns=4))
    return grid(halves, columns=2)


def _print_readings(real: Float, ours: Float) -> None:
    names = ["lightness L*", "spread of L*", "chroma", *(f"detail at {scale:g} px" for scale in SCALES_PX)]
    out.print(f"{len(real)} photographs, {len(ours)} frames: median (10 % … 90 %)")
    for index, name in enumerate(names):
        low, middle, high = np.quantile(real[:, index], (0.1, 0.5, 0.9))
        low_o, middle_o, high_o = np.quantile(ours[:, index], (0.1, 0.5, 0.9))
        out.print(
            f"{name:16} photographs {middle:5.1f} ({low:5.1f} … {high:5.1f})   "
            f"frames {middle_o:5.1f} ({low_o:5.1f} … {high_o:5.1f})"
        )


if __name__ == "__main__":
    sys.exit(main())
