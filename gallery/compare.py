"""`python -m gallery.compare PHOTOGRAPHS`: how frames of the twin differ from photographs, in numbers.

Frames are crops of a drone's camera at its own resolution, taken in flight along streets and stored as the photographs
were. Of every picture: mean lightness and its spread, chroma, and how much detail there is at one, four and sixteen
pixels (standard deviation of the difference between two Gaussian blurs, in lightness). Each is given as the median and
the middle 80 % over the pictures. Then how well a classifier on texture statistics (`gallery.texture`) tells the two
apart.
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
from pavetwin.world.segments import direction_at

FRAMES: Final = 120
PHOTOGRAPHS: Final = 240
GSD_M: Final = (0.003, 0.017)
"""Range of the frames' ground resolutions, even in their logarithm: by their markings, that of the China drone subset
of RDD2022. A Phantom 4 Pro has 3 mm a pixel from 11 m, and 17 mm from 62 m."""
HOVERING: Final = 4
"""Every so many frames is taken while hovering; the others while flying along the street at `SPEED_MPS`, as those of
datasets are. (Photographs show it: without motion their finest detail is told apart more easily.)"""
SPEED_MPS: Final = (2.0, 6.0)
STORED: Final = (75, 95)
"""Qualities at which pictures were stored one after the other, as JPEG with halved colours. The coefficients of all 40
photographs of RDD2022's China drone subset that were looked at are multiples of the table of quality 75, aligned with
the picture; the table of their files is that of 95."""
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
    focal_px = renderer.camera.image_px[1] / (2 * math.tan(renderer.camera.fov_rad / 2))
    for index, defect in enumerate(defects):
        gsd_m = finest * (coarsest / finest) ** (index * 0.618034 % 1)
        line = renderer.world.segment(defect.segment).centre_line
        dx, dy = direction_at(line, line.project(defect.centre))
        yaw = math.atan2(dy, dx) + 0.15 * math.sin(7 * index)
        slow, fast = SPEED_MPS
        speed = slow + (fast - slow) * (index * 0.414214 % 1) if index % HOVERING else 0.0
        view = look(
            (defect.centre.x, defect.centre.y, gsd_m * focal_px),
            yaw_rad=yaw,
            pitch_rad=-math.pi / 2,
            size_px=(SIDE_PX, SIDE_PX),
            vertical_fov_rad=2 * math.atan(SIDE_PX / 2 / focal_px),
            velocity_mps=(speed * math.cos(yaw), speed * math.sin(yaw), 0.0),
        )
        yield stored(Image.fromarray(take(view, (MORNING, LOW_SUN, OVERCAST)[index % 3])))


def stored(picture: Image.Image) -> Image.Image:
    """A picture after it was stored as the photographs were."""
    for quality in STORED:
        file = BytesIO()
        picture.save(file, "JPEG", quality=quality, subsampling="4:2:0")
        picture = Image.open(file).convert("RGB")
    return picture


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
